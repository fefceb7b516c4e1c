#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz::Readers;
use palpate_fuzz as _;

// VTK images, XML and legacy.
fuzz_target!(|data: &[u8]| {
    let _ = Readers::volume(data, &[]);
});
