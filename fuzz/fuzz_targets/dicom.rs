#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz::Readers;

fuzz_target!(|data: &[u8]| {
    let _ = Readers::dicom(data);
});
