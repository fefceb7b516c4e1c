//! What all fuzz targets share: an allocator that takes a large allocation for a finding.

use std::alloc::{GlobalAlloc, Layout, System};

/// Inputs are small, and compressed data grow at most a thousandfold: whoever asks for more than
/// this in one go believed a count in the file.
const LARGEST: usize = 256 << 20;

struct Watched;

// SAFETY: every call is passed on to the system's allocator as it is.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST {
            eprintln!("an allocation of {} bytes", layout.size());
            std::process::abort();
        }
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() > LARGEST {
            eprintln!("an allocation of {} bytes", layout.size());
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

/// Cuts an input in two at its first zero byte after a newline, for formats of two files.
pub fn halves(data: &[u8]) -> (&[u8], &[u8]) {
    match data.windows(2).position(|w| w == b"\n\0") {
        Some(n) => (&data[..=n], &data[n + 2..]),
        None => (data, &[]),
    }
}
