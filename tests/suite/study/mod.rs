//! Studies: measurements are kept, resumed, and plotted.

mod elements;
mod frame;
mod motion;
mod pictures;
mod scaling;
mod scan;
mod stability;
mod trust;
