#![no_main]
use libfuzzer_sys::fuzz_target;
use palpate::io::fuzz::Readers;

fuzz_target!(|data: &[u8]| {
    let (node, ele) = palpate_fuzz::halves(data);
    let _ = Readers::tetgen(node, ele);
});
