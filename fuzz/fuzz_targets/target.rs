//! The main file of every fuzz target. `Cargo.toml` builds this file once per target, and the program's name selects the
//! function.

#![no_main]

#[path = "../src/checkpoint.rs"]
mod checkpoint;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let target: fn(&[u8]) = match env!("CARGO_BIN_NAME") {
        "scene" => dapple_fuzz::scene,
        "ply" => dapple_fuzz::ply,
        "obj" => dapple_fuzz::obj,
        "gltf" => dapple_fuzz::gltf,
        "stl" => dapple_fuzz::stl,
        "geometry" => dapple_fuzz::geometry,
        "image" => dapple_fuzz::image,
        _ => checkpoint::checkpoint,
    };
    target(data);
});
