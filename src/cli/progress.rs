//! Progress bars, on a terminal; silence elsewhere.

use indicatif::{ProgressBar, ProgressStyle};

/// Shows a bar over `total` things called `what` while `work` is done.
pub fn over<T>(what: &'static str, total: u64, work: impl FnOnce(&ProgressBar) -> T) -> T {
    let bar = ProgressBar::new(total);
    let template = "{msg} {wide_bar} {pos}/{len} [{elapsed} < {eta}]";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(what);
    let result = work(&bar);
    bar.finish_and_clear();
    result
}

/// Shows what is being done, by name and fraction, while `work` is.
pub fn stages<T>(work: impl FnOnce(&(dyn Fn(&str, f64) + Sync)) -> T) -> T {
    const WHOLE: u64 = 1000;
    let bar = ProgressBar::new(WHOLE);
    if let Ok(style) = ProgressStyle::with_template("{msg:12} {wide_bar} [{elapsed}]") {
        bar.set_style(style);
    }
    let result = work(&|what, done| {
        bar.set_message(what.to_owned());
        bar.set_position((done * WHOLE as f64) as u64);
    });
    bar.finish_and_clear();
    result
}
