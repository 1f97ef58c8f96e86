//! Short scenes for tests of the pbrt reader.
#![allow(dead_code, unreachable_pub)]

use dapple_scene::ReadError;
use dapple_scene::image::{Image, encode_pfm};
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{LightKind, MaterialKind, Scene};
use image::{ImageFormat, RgbaImage};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;

pub const HEAD: &str = "Film \"rgb\" \"integer xresolution\" 4 \"integer yresolution\" 3\n";
pub const WORLD: &str = "Camera \"perspective\"\nWorldBegin\n";
pub const TAIL: &str = "LightSource \"infinite\"\nShape \"sphere\"\n";

pub fn pfm(size: [u32; 2], pixel: impl Fn(u32) -> [f32; 3]) -> Vec<u8> {
    let pixels = (0..size[0] * size[1]).map(pixel).collect();
    encode_pfm(&Image::new(size, pixels).unwrap()).unwrap()
}

/// Two pixels side by side.
fn rgba(format: ImageFormat, pixels: [[u8; 4]; 2]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let image = RgbaImage::from_raw(2, 1, pixels.concat()).unwrap();
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub fn read(text: &str) -> Result<Scene, ReadError> {
    let mut files: BTreeMap<PathBuf, Vec<u8>> = BTreeMap::new();
    files.insert("s.pbrt".into(), text.as_bytes().to_vec());
    files.insert("square.pfm".into(), pfm([32, 32], |_| [1.0, 2.0, 3.0]));
    files.insert("wide.pfm".into(), pfm([4, 2], |i| [i as f32, 0.5, 0.25]));
    // Two pixels each: the first one a fifth opaque but in the last file, the second one opaque.
    files.insert("leaf.png".into(), rgba(ImageFormat::Png, [[60, 120, 180, 51], [0, 0, 0, 255]]));
    files.insert("leaf.tga".into(), rgba(ImageFormat::Tga, [[60, 120, 180, 51], [0, 0, 0, 255]]));
    files.insert("opaque.png".into(), rgba(ImageFormat::Png, [[60, 120, 180, 255], [0, 0, 0, 255]]));
    files.insert("flat.spd".into(), b"# no colour\n400 0.25\n700 0.25\n".to_vec());
    files.insert("bad.spd".into(), b"400 1\n500 one\n".to_vec());
    read_scene_from(&files, "s.pbrt", &ReadOptions::default())
}

pub fn world(text: &str) -> Scene {
    read(&format!("{HEAD}{WORLD}{text}\n{TAIL}")).unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// The errors of this text in an otherwise valid world; its first line is line 4.
pub fn complaint(text: &str) -> String {
    read(&format!("{HEAD}{WORLD}{text}\n{TAIL}")).map(|_| ()).expect_err(text).to_string()
}

pub fn options(text: &str) -> Scene {
    read(&format!("{HEAD}{text}\nWorldBegin\n{TAIL}")).unwrap_or_else(|e| panic!("{text}: {e}"))
}

pub fn kind(text: &str) -> MaterialKind {
    let scene = world(&format!("{text}\nShape \"disk\""));
    scene.materials[scene.shapes[0].material.0 as usize].kind.clone()
}

pub fn light(text: &str) -> (LightKind, glam::DAffine3) {
    let light = world(text).lights[0].clone();
    (light.kind, light.to_world)
}

pub fn close(a: [f32; 3], b: [f32; 3], within: f32) -> bool {
    (0..3).all(|i| (a[i] - b[i]).abs() <= within)
}
