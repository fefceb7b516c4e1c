#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz;

fuzz_target!(|data: &[u8]| {
    let (header, voxels) = palpate_fuzz::halves(data);
    let _ = fuzz::volume(header, voxels);
    let _ = fuzz::volume(data, voxels);
    let _ = fuzz::volume_number("", data, 1);
});
