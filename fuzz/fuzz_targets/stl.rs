#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz::Readers;
use palpate_fuzz as _;

fuzz_target!(|data: &[u8]| {
    let _ = Readers::surface("stl", data);
});
