//! Shared helpers of all tests: the device, and the path to real data.

use palpate::gpu::Gpu;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Returns the shared device of these tests; without one they fail. A test that counts device
/// operations creates its own.
pub fn gpu() -> Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| Gpu::new().unwrap()).clone()
}

/// Returns a file of real data: in the folder `PALPATE_DATA`, or else in `../shared/data` next to
/// the checkout. If it is missing, prints a line that states what is skipped, and the caller
/// returns; with `PALPATE_DATA_REQUIRED` set, fails.
pub fn real_data(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("PALPATE_DATA").map_or_else(beside, PathBuf::from);
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(
        std::env::var_os("PALPATE_DATA_REQUIRED").is_none(),
        "{} is absent, and real data is required here",
        path.display()
    );
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    // Not by a macro: the line must appear in the output, whether or not the test passes.
    let _ = writeln!(
        std::io::stderr(),
        "left out: {test} needs {name} (set PALPATE_DATA to the folder of real data)"
    );
    None
}
