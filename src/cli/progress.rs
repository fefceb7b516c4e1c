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
