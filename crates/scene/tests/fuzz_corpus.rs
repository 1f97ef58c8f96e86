//! The fuzz targets' functions on their seeds, so that a build without `cargo fuzz` sees failures at once.
//!
//! Seeds are made here, from our own scenes; `DAPPLE_WRITE_SEEDS=1 cargo test -p dapple-scene --test fuzz_corpus`
//! writes them anew. Inputs that once broke something are in `fuzz/found`.

#![allow(clippy::print_stderr)] // How long the slowest input took is told.

#[allow(unreachable_pub)] // A library of its own where cargo-fuzz builds it.
#[path = "../../../fuzz/src/lib.rs"]
mod targets;

use dapple_scene::bundled;
use dapple_scene::image::{Image, Layer, encode_exr, encode_pfm};
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use rand::{RngExt, SeedableRng};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Name and function.
type Target = (&'static str, fn(&[u8]));

const TARGETS: [Target; 7] = [
    ("scene", targets::scene),
    ("ply", targets::ply),
    ("obj", targets::obj),
    ("gltf", targets::gltf),
    ("stl", targets::stl),
    ("image", targets::image),
    ("geometry", targets::geometry),
];

fn folder(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz")).join(name)
}

/// Target, name, bytes.
type Seed = (&'static str, String, Vec<u8>);

fn seeds() -> Vec<Seed> {
    let mut seeds: Vec<Seed> = Vec::new();
    let mut add = |target, name: &str, bytes: Vec<u8>| seeds.push((target, name.to_owned(), bytes));
    for name in bundled::names() {
        let bundle = bundled::files(name).unwrap();
        // Those of very many lines teach a fuzzer nothing more.
        let text = &bundle.files[0].1;
        let end = text.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(60).map_or(text.len(), |(at, _)| at + 1);
        add("scene", name, text[..end.min(6000)].to_vec());
    }
    add("scene", "small", include_bytes!("scenes/small.pbrt").to_vec());
    let header = |format: &str, count: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment ours\nelement vertex 4\nproperty float x\nproperty double y\nproperty short z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\nelement face 1\nproperty list {count} vertex_indices\nend_header\n"
        )
        .into_bytes()
    };
    let corners = [[0_i16, 0], [3, 0], [1, 1], [0, 3]];
    let vertex = |[x, y]: [i16; 2], big: bool| -> Vec<u8> {
        let single = |v: f32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let y = if big { f64::from(y).to_be_bytes() } else { f64::from(y).to_le_bytes() };
        let mut bytes = single(x.into()).to_vec();
        bytes.extend(y);
        bytes.extend([0, 0]);
        [0.0, 0.0, 1.0, x.into(), 0.5].into_iter().for_each(|v| bytes.extend(single(v)));
        bytes
    };
    for (name, big) in [("little", false), ("big", true)] {
        let mut bytes = header(if big { "binary_big_endian" } else { "binary_little_endian" }, "uchar int");
        corners.iter().for_each(|&corner| bytes.extend(vertex(corner, big)));
        bytes.push(4);
        (0..4_u32).for_each(|i| bytes.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() }));
        add("ply", name, bytes);
    }
    let mut ascii = header("ascii", "uchar uint");
    corners.iter().for_each(|[x, y]| ascii.extend(format!("{x} {y} 0 0 0 1 {x} 0.5\n").into_bytes()));
    ascii.extend(b"4 0 1 2 3\n");
    add("ply", "ascii", ascii);
    let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    add("obj", "plain", plain.into());
    let rich = "# ours\nmtllib m.mtl\nnewmtl a\nKd 1 0.5 0.25\nmap_Kd -s 1 1 1 m.pfm\no a\ng b\ns 1\nv 0 0 0 1\nv 3 0 0 1 1 1\nv 1 1 0\nv 0 3 0\nvt 0\nvt 1 0.5\nvn 0 0 1\nusemtl a\nf -4/1/1 -3/2/1 \\\n -2/1/1 -1/2/1\nusemtl b\nf 1//1 2//1 3//1\nl 1 2 3\nf 1/1 2/1 3/1 4/1\n";
    add("obj", "rich", rich.into());
    let (text, binary) = gltf();
    add("gltf", "text", text.into_bytes());
    add("gltf", "binary", binary);
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 -0.5\nendloop\nendfacet\nendsolid a\nsolid b\nendsolid b\n";
    add("stl", "text", text.into());
    for (name, word) in [("binary", b"ours ".as_slice()), ("solid", b"solid")] {
        let mut bytes = word.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(1_u32.to_le_bytes());
        bytes.resize(84 + 12, 0);
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -0.5].into_iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend([0, 0]);
        add("stl", name, bytes);
    }
    for (name, size) in [("small", 1e-15_f32), ("usual", 1.0), ("large", 1e15)] {
        let corners =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.2, 0.2], [-1.0, 0.5, 2.0]];
        let mut bytes = vec![6];
        corners.as_flattened().iter().for_each(|v: &f32| bytes.extend((v * size).to_le_bytes()));
        bytes.extend([0, 1, 2, 0, 1, 3, 0, 2, 3, 1, 2, 3, 0, 1, 2, 0, 0, 1]);
        add("geometry", name, bytes);
    }
    let rgb = RgbImage::from_fn(5, 3, |x, y| Rgb([(x * 60) as u8, (y * 100) as u8, (x * y * 20) as u8]));
    let save = |image: DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let image = DynamicImage::from(rgb);
    add("image", "8.png", save(image.clone(), ImageFormat::Png));
    add("image", "16.png", save(image.to_rgba16().into(), ImageFormat::Png));
    add("image", "gray.png", save(image.to_luma_alpha8().into(), ImageFormat::Png));
    add("image", "a.jpg", save(image.clone(), ImageFormat::Jpeg));
    add("image", "a.tga", save(image.to_rgba8().into(), ImageFormat::Tga));
    add("image", "a.hdr", save(image.to_rgb32f().into(), ImageFormat::Hdr));
    let image = Image::new([5, 3], (0..15).map(|i| [i as f32, 0.5, -1.0]).collect()).unwrap();
    add("image", "a.pfm", encode_pfm(&image).unwrap());
    add("image", "a.exr", encode_exr([5, 3], &[Layer::of_image("", &image)], &[]).unwrap().bytes);
    seeds
}

/// A triangle in glTF, as text with everything that our reader reads, and as a plain binary file.
fn gltf() -> (String, Vec<u8>) {
    use base64::Engine;
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let buffer: Vec<u8> = corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let coded = base64::engine::general_purpose::STANDARD.encode(&buffer);
    let mesh = r#""bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]"#;
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":36,"uri":"data:;base64,{coded}"}}],{mesh},
"images":[{{"uri":"p.png"}},{{"bufferView":0,"mimeType":"image/png"}}],"textures":[{{"source":0}},{{"source":1}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,0.2,1],"baseColorTexture":{{"index":0}},"metallicFactor":0.5}},
"normalTexture":{{"index":1,"scale":2}},"emissiveFactor":[1,1,0],"alphaMode":"MASK","alphaCutoff":0.4,
"extensions":{{"KHR_materials_clearcoat":{{"clearcoatFactor":0.5}},"KHR_materials_transmission":{{"transmissionFactor":0.5}},
"KHR_materials_volume":{{"thicknessFactor":1,"attenuationDistance":2,"attenuationColor":[1,0.5,0]}}}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":0}},"material":0,"mode":5,"targets":[{{"POSITION":0}}]}}],"weights":[0.5]}},
{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":6}}]}}],
"extensionsUsed":["KHR_lights_punctual"],
"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"spot","intensity":9,"spot":{{"outerConeAngle":0.5}}}}]}}}},
"cameras":[{{"type":"perspective","perspective":{{"yfov":0.7,"znear":0.1}}}}],
"nodes":[{{"mesh":0,"children":[1,2]}},{{"mesh":1,"rotation":[0,0,1,0],"scale":[2,1,1]}},{{"mesh":1}},{{"camera":0}},
{{"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],"scenes":[{{"nodes":[0,3,4]}}],"scene":0}}"#
    );
    let mut small = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":36}}],{mesh},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"nodes":[{{"mesh":0}}]}}"#
    )
    .into_bytes();
    small.resize(small.len().next_multiple_of(4), b' ');
    let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
    let mut binary = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &[0; 4]].concat();
    for (kind, chunk) in [(b"JSON", small), (b"BIN\0", buffer)] {
        binary.extend([length(&chunk).as_slice(), kind, &chunk].concat());
    }
    let whole = length(&binary);
    binary[8..12].copy_from_slice(&whole);
    (text, binary)
}

#[test]
fn the_seeds_are_those_made_here() {
    let write = std::env::var_os("DAPPLE_WRITE_SEEDS").is_some();
    for (target, name, bytes) in seeds() {
        let path = folder("seeds").join(target).join(name);
        if write {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, bytes).unwrap();
        } else {
            let found = std::fs::read(&path).unwrap_or_default();
            assert!(found == bytes, "{} is not what is made here: set DAPPLE_WRITE_SEEDS=1", path.display());
        }
    }
}

/// Seeds, inputs that once broke something, and each damaged in a hundred ways: no panic, and none takes long.
#[test]
fn readers_survive_seeds_and_damaged_seeds_i01() {
    const MOST: Duration = Duration::from_secs(1);
    let slowest = std::thread::scope(|threads| {
        let running = TARGETS.map(|(target, run)| threads.spawn(move || slowest_of(target, run)));
        running.into_iter().map(|one| one.join().expect("no reader panics")).max()
    });
    let slowest = slowest.expect("there are targets");
    // Told, not judged: other tests share the machine.
    eprintln!("slowest input: {slowest:?} (at most {MOST:?} is asked for)");
    assert!(slowest < 10 * MOST, "{slowest:?}");
}

/// Gives a target its seeds and a hundred damaged copies of each. Returns the longest time that one took.
fn slowest_of(target: &str, run: fn(&[u8])) -> Duration {
    let mut random = rand_pcg::Pcg64::seed_from_u64(1);
    let mut slowest = Duration::ZERO;
    let mut timed = |bytes: &[u8]| {
        let start = Instant::now();
        run(bytes);
        slowest = slowest.max(start.elapsed());
    };
    let mut inputs: Vec<Vec<u8>> = seeds().into_iter().filter(|seed| seed.0 == target).map(|seed| seed.2).collect();
    let found = std::fs::read_dir(folder("found").join(target)).into_iter().flatten();
    let mut found: Vec<PathBuf> = found.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    inputs.extend(found.iter().map(|path| std::fs::read(path).unwrap()));
    for input in &inputs {
        timed(input);
        for _ in 0..100 {
            let mut bytes = input.clone();
            for _ in 0..random.random_range(1..6) {
                let (from, to) = (random.random_range(0..bytes.len()), random.random_range(0..bytes.len()));
                match random.random_range(0..4) {
                    0 => bytes[from] ^= 1 << random.random_range(0..8),
                    1 => bytes[from] = random.random(),
                    2 => bytes[from] = bytes[to],
                    // A piece twice: numbers grow, lists repeat.
                    _ => {
                        let piece = bytes[from.min(to)..from.max(to).min(from.min(to) + 16)].to_vec();
                        bytes.splice(from..from, piece);
                    }
                }
            }
            timed(&bytes);
        }
    }
    slowest
}

/// Ten minutes of damaged glTF files, those of the scenes of others included, without a panic or a slow file.
///
/// A stand-in for cargo-fuzz, without its guidance by coverage: each input that was read goes on to be damaged further.
#[test]
#[ignore = "ten minutes: cargo test -p dapple-scene --test fuzz_corpus -- --ignored --nocapture"]
fn gltf_survives_ten_minutes_of_damage_i01() {
    let mut pool: Vec<Vec<u8>> = seeds().into_iter().filter(|seed| seed.0 == "gltf").map(|seed| seed.2).collect();
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    let scenes = std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from).join("gltf");
    let shared = ["BoxTextured/glTF-Binary/BoxTextured.glb", "bevy/CornellBox/CornellBox.glb"];
    for path in shared.map(|name| scenes.join(name)) {
        match std::fs::read(&path) {
            Ok(bytes) => pool.push(bytes),
            Err(_) => eprintln!("skipped: {} is not there", path.display()),
        }
    }
    let first = pool.len();
    let mut random = rand_pcg::Pcg64::seed_from_u64(600);
    let (began, mut slowest, mut inputs, mut read) = (Instant::now(), Duration::ZERO, 0_u64, 0_u64);
    while began.elapsed() < Duration::from_secs(600) {
        let mut bytes = pool[random.random_range(0..pool.len())].clone();
        let other = pool[random.random_range(0..pool.len())].clone();
        (0..random.random_range(1..4)).for_each(|_| damage(&mut bytes, &other, &mut random));
        let start = Instant::now();
        targets::gltf(&bytes);
        slowest = slowest.max(start.elapsed());
        inputs += 1;
        let files: &[(&str, &[u8])] = &[("m.gltf", &bytes), ("p.png", &bytes)];
        if inputs.is_multiple_of(8) && dapple_scene::read_any_from(files, "m.gltf", &Default::default()).is_ok() {
            read += 1;
            // What is read replaces an earlier descendant, so that damage adds up, and the first files stay.
            if pool.len() < 256 {
                pool.push(bytes);
            } else {
                let at = random.random_range(first..pool.len());
                pool[at] = bytes;
            }
        }
    }
    eprintln!("{inputs} inputs in 600 s, slowest {slowest:?}; of every eighth, {read} could be read");
    assert!(read > inputs / 8 / 20, "too few files are read for their contents to be tried: {read}");
    assert!(slowest < Duration::from_secs(10), "{slowest:?}");
}

/// One damage: a bit, a byte, a number, a lost or doubled piece, or a piece of another file.
fn damage(bytes: &mut Vec<u8>, other: &[u8], random: &mut rand_pcg::Pcg64) {
    const NUMBERS: [&str; 12] =
        ["0", "-1", "1", "2", "3", "1e39", "-1e-30", "0.5", "255", "65536", "4294967295", "18446744073709551615"];
    if bytes.is_empty() || other.is_empty() {
        return;
    }
    let at = random.random_range(0..bytes.len());
    let end = (at + random.random_range(1..32)).min(bytes.len());
    match random.random_range(0..8) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => bytes[at] = random.random(),
        2 => drop(bytes.drain(at..end)),
        3 => {
            let piece = bytes[at..end].to_vec();
            bytes.splice(at..at, piece);
        }
        4 => {
            let from = random.random_range(0..other.len());
            let to = (from + random.random_range(1..64)).min(other.len());
            bytes.splice(at..end, other[from..to].iter().copied());
        }
        _ => {
            let digit = |b: &u8| b.is_ascii_digit() || b".-".contains(b);
            let Some(from) = bytes[at..].iter().position(digit).map(|n| at + n) else { return };
            let to = bytes[from..].iter().position(|b| !digit(b)).map_or(bytes.len(), |n| from + n);
            bytes.splice(from..to, NUMBERS[random.random_range(0..NUMBERS.len())].bytes());
        }
    }
}
