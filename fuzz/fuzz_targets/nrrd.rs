#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz::Readers;

fuzz_target!(|data: &[u8]| {
    let (header, voxels) = palpate_fuzz::halves(data);
    let _ = Readers::volume(header, voxels);
    let _ = Readers::volume(data, voxels);
    let _ = Readers::volume_number("", data, 1);
});
