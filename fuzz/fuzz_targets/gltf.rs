#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| dapple_fuzz::gltf(data));
