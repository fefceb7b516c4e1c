//! Shared code of the fuzz targets: an allocator that aborts on large allocations.

use std::alloc::{GlobalAlloc, Layout, System};

/// Maximum size of one allocation, in bytes. Inputs are small, and compressed data grow at most a
/// thousandfold, so a larger allocation uses an unchecked count in the file.
const LARGEST: usize = 256 << 20;

struct Watched;

// SAFETY: every call is forwarded unchanged to the system's allocator.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST {
            eprintln!("allocation of {} bytes exceeds the limit", layout.size());
            std::process::abort();
        }
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST {
            eprintln!("allocation of {} bytes exceeds the limit", layout.size());
            std::process::abort();
        }
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static WATCHED: Watched = Watched;

/// Splits an input at its first zero byte after a newline, for formats with two files.
pub fn halves(data: &[u8]) -> (&[u8], &[u8]) {
    match data.windows(2).position(|w| w == b"\n\0") {
        Some(n) => (&data[..=n], &data[n + 2..]),
        None => (data, &[]),
    }
}
