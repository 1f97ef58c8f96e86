//! The memory of reading an image, measured in a process of its own for each file.
//!
//! At most 256 MiB + 16 times the file's length, under any header. Photographs of 4096 x 4096 pixels, everyday textures,
//! need more than the 64 MiB of the hard-case catalogue; they are read however well they are packed.

#![allow(clippy::print_stdout, clippy::print_stderr)] // The children's figures.

use dapple_scene::image::{Encoding, ImageError, read_channels, read_image};
use exr::prelude as exr;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ImageFormat, RgbImage, RgbaImage};
use std::path::Path;
use std::process::Command;

const FILE: &str = "DAPPLE_TEST_IMAGE";
const MIB: u64 = 1 << 20;

/// Bytes of these fields of the process' status.
fn status(fields: [&str; 2]) -> [u64; 2] {
    let status = std::fs::read_to_string("/proc/self/status").expect("/proc");
    fields.map(|field| {
        let line = status.lines().find(|line| line.starts_with(field)).expect(field);
        line.split_ascii_whitespace().nth(1).and_then(|n| n.parse::<u64>().ok()).expect(field) * 1024
    })
}

/// Reads the named file and prints the growth of the process: address space and resident memory.
#[test]
fn child() {
    let Some(path) = std::env::var_os(FILE) else { return };
    let path = Path::new(&path);
    let bytes = std::fs::read(path).unwrap_or_default();
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    let before = status(["VmSize", "VmRSS"]);
    let outcome = match name {
        "control" => {
            std::hint::black_box(vec![1_u8; 300 << 20]);
            Ok([0, 0])
        }
        _ if name.starts_with("channels") => read_channels(&bytes, name).map(|c| c.size),
        _ => read_image(&bytes, name, Encoding::Auto).map(|p| p.size),
    };
    let after = status(["VmPeak", "VmHWM"]);
    let word = match &outcome {
        Ok(_) => "read",
        Err(ImageError::TooLarge { .. }) => "refused",
        Err(_) => "error",
    };
    println!("grown {} {} {word} {outcome:?}", after[0] - before[0], after[1].saturating_sub(before[1]));
}

/// Bytes by which a process grew that read this file, and `read`, `refused` or `error`.
fn measure(folder: &Path, name: &str, bytes: &[u8]) -> (u64, String) {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("a temporary file");
    let mut run = Command::new(std::env::current_exe().expect("this test"));
    // A test runs in a thread of its own: without an arena of its own, too, which would count as address space.
    run.args(["--exact", "image_memory::child", "--nocapture"]).env(FILE, &path).env("MALLOC_ARENA_MAX", "1");
    let output = run.output().expect("this test again");
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.split("grown ").nth(1).unwrap_or_else(|| panic!("{name}: {text} {output:?}"));
    let mut words = line.split_ascii_whitespace();
    let mut grown = || words.next().and_then(|w| w.parse::<u64>().ok()).expect("a number");
    let most = grown().max(grown());
    let word = words.next().expect("an outcome").to_owned();
    let limit = 256 * MIB + 16 * bytes.len() as u64;
    eprintln!(
        "{name}: {} bytes, {:.1} MiB of {:.1}, {}",
        bytes.len(),
        most as f64 / MIB as f64,
        limit as f64 / MIB as f64,
        line.lines().next().unwrap_or_default().split_once(&word).map_or("", |l| l.1)
    );
    (most, word)
}

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Up);
    image.into().write_with_encoder(encoder).expect("encoded");
    bytes
}

/// A flat JPEG whose header states the side of an image of `claimed` pixels. What its data lack is filled up.
fn flat_jpeg(side: u32, claimed: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    flat(side, side).write_to(&mut bytes, ImageFormat::Jpeg).expect("encoded");
    let size = |side: u32| [(side as u16).to_be_bytes(); 2].concat();
    patch(&bytes.into_inner(), &size(side), &size(claimed))
}

fn patch(bytes: &[u8], old: &[u8], new: &[u8]) -> Vec<u8> {
    let at = bytes.windows(old.len()).position(|w| w == old).expect("what is to be replaced");
    [&bytes[..at], new, &bytes[at + old.len()..]].concat()
}

/// A flat JPEG with another marker for its frame, or with one component in its first scan.
fn odd_jpegs(side: u32, claimed: u32) -> [Vec<u8>; 2] {
    let plain = flat_jpeg(side, claimed);
    let scan = plain.windows(2).position(|w| w == [0xff, 0xda]).expect("a scan");
    let end = scan + 2 + usize::from(u16::from_be_bytes([plain[scan + 2], plain[scan + 3]]));
    let first = [0xff, 0xda, 0, 8, 1, plain[scan + 5], plain[scan + 6], 0, 63, 0];
    [patch(&plain, &[0xff, 0xc0], &[0xff, 0xc2]), [&plain[..scan], &first, &plain[end..]].concat()]
}

/// A flat EXR file of half floats with as many channels as asked for beside R, G, B and A.
fn flat_exr(side: usize, compression: exr::Compression, tile: Option<usize>, besides: usize) -> Vec<u8> {
    let names = ["R", "G", "B", "A"].map(str::to_owned).into_iter().chain((0..besides).map(|i| format!("z{i}")));
    let values = |_| exr::FlatSamples::F16(vec![exr::f16::from_f32(0.5); side * side]);
    let channels = names.map(|name| exr::AnyChannel::new(exr::Text::from(name.as_str()), values(())));
    let blocks = tile.map_or(exr::Blocks::ScanLines, |t| exr::Blocks::Tiles(exr::Vec2(t, t)));
    let encoding = exr::Encoding { compression, blocks, line_order: exr::LineOrder::Increasing };
    let channels = exr::AnyChannels::sort(channels.collect());
    let layer = exr::Layer::new((side, side), exr::LayerAttributes::default(), encoding, channels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    exr::WritableImage::write(&exr::Image::from_layer(layer)).to_buffered(&mut bytes).expect("encoded");
    bytes.into_inner()
}

/// The same with a side of 64 pixels, whose header states the side of an image of `claimed`.
fn claiming_exr(claimed: usize, tile: Option<usize>, besides: usize) -> Vec<u8> {
    let blocks = |side: usize| side.div_ceil(tile.unwrap_or(16)) as i32;
    let count = |side| [&b"chunkCount\0int\0\x04\0\0\0"[..], &blocks(side).to_le_bytes()].concat();
    let window = |side: usize| [0, 0, side as i32 - 1, side as i32 - 1].map(i32::to_le_bytes).concat();
    let bytes = flat_exr(64, exr::Compression::ZIP16, tile, besides);
    let bytes = patch(&bytes, &count(64), &count(claimed));
    let bytes = (0..2).fold(bytes, |bytes, _| patch(&bytes, &window(64), &window(claimed)));
    // The table of the blocks is as long as it should be.
    [bytes, vec![0; 8 * claimed]].concat()
}

/// A run-length encoded TGA of one colour, of `kind` 9 (indexed) or 10.
fn flat_tga(side: u16, kind: u8) -> Vec<u8> {
    let (map, depth, pixel): (_, _, &[u8]) = if kind == 9 { (1, 8, &[0]) } else { (0, 24, &[1, 2, 3]) };
    let [s0, s1] = side.to_le_bytes();
    let mut bytes = vec![0, map, kind, 0, 0, map, 0, 24 * map, 0, 0, 0, 0, s0, s1, s0, s1, depth, 0];
    bytes.extend([7; 3].iter().take(3 * usize::from(map)));
    for _ in 0..(usize::from(side).pow(2)).div_ceil(128) {
        bytes.push(0xff);
        bytes.extend(pixel);
    }
    bytes
}

/// A flat, run-length encoded HDR file.
fn flat_hdr(side: usize) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {side} +X {side}\n").into_bytes();
    for _ in 0..side {
        bytes.extend([2, 2, (side >> 8) as u8, side as u8]);
        for _ in 0..4 {
            let mut left = side;
            while left > 0 {
                let run = left.min(127);
                bytes.extend([128 + run as u8, 128]);
                left -= run;
            }
        }
    }
    bytes
}

/// An RGB image of one colour.
fn flat(width: u32, height: u32) -> RgbImage {
    RgbImage::from_pixel(width, height, image::Rgb([9, 99, 200]))
}

#[test]
fn reading_an_image_takes_256_mib_and_16_times_its_file_i01() {
    let folder = tempfile::tempdir().expect("a folder");
    let alpha = png(RgbaImage::from_pixel(3900, 3900, image::Rgba([9, 99, 200, 7])));
    let bomb = png(DynamicImage::new_luma8(9000, 9000));
    let files = vec![
        ("small.png", png(flat(4096, 4096)), "read"),
        ("alpha.png", alpha, "read"),
        ("row.png", png(flat(60_000, 140)), "read"),
        ("bomb.png", bomb, "refused"),
    ];
    check(folder.path(), files);
}

#[test]
fn reading_other_images_takes_as_little_i01() {
    let folder = tempfile::tempdir().expect("a folder");
    let (grown, _) = measure(folder.path(), "control", &[]);
    assert!(grown >= 300 * MIB, "the control was measured as {grown}");
    let [progressive, scans] = odd_jpegs(1200, 1200);
    let files = vec![
        ("small.jpg", flat_jpeg(64, 4096), "read"),
        ("progressive.jpg", progressive, ""),
        ("scans.jpg", scans, ""),
        ("small.tga", flat_tga(2900, 10), "read"),
        ("indexed.tga", flat_tga(1400, 9), "read"),
        ("small.hdr", flat_hdr(4096), "read"),
    ];
    check(folder.path(), files);
}

#[test]
fn reading_an_exr_file_takes_256_mib_and_16_times_its_length_i01() {
    let zip = exr::Compression::ZIP16;
    let mut files = vec![
        ("small.exr", flat_exr(1900, zip, None, 0), "read"),
        ("many.exr", flat_exr(1050, exr::Compression::RLE, None, 60), "read"),
        ("channels small.exr", flat_exr(1200, zip, None, 4), "read"),
        ("tile.exr", flat_exr(800, zip, Some(800), 0), "read"),
    ];
    for (name, compression) in [
        ("piz.exr", exr::Compression::PIZ),
        ("pxr.exr", exr::Compression::PXR24),
        ("b44.exr", exr::Compression::B44A),
        ("dwaa.exr", exr::Compression::DWAA(None)),
        ("dwab.exr", exr::Compression::DWAB(None)),
        ("rle.exr", exr::Compression::RLE),
    ] {
        files.push((name, flat_exr(700, compression, Some(500), 0), ""));
    }
    check(tempfile::tempdir().expect("a folder").path(), files);
}

/// Files that are too large for that are refused before their pixels are decoded.
#[test]
fn an_image_that_would_take_more_is_refused_i01() {
    let [large_progressive, large_scans] = odd_jpegs(64, 5000);
    let files = vec![
        ("large.png", png(flat(5200, 5200)), "refused"),
        ("large.jpg", flat_jpeg(64, 5400), "refused"),
        ("large progressive.jpg", large_progressive, "refused"),
        ("large scans.jpg", large_scans, "refused"),
        ("large.tga", flat_tga(6000, 9), "refused"),
        ("large.hdr", flat_hdr(8000), "refused"),
        ("channels many.exr", claiming_exr(1100, None, 60), "refused"),
        ("large.exr", claiming_exr(4200, None, 0), "refused"),
        ("large tile.exr", claiming_exr(3500, Some(3500), 0), "refused"),
    ];
    check(tempfile::tempdir().expect("a folder").path(), files);
}

/// Reads each file in a process of its own, and expects its outcome, if it is not empty, within the memory.
fn check(folder: &Path, files: Vec<(&str, Vec<u8>, &str)>) {
    let mut wrong = Vec::new();
    for (name, bytes, expected) in files {
        let (grown, word) = measure(folder, name, &bytes);
        if grown > 256 * MIB + 15 * bytes.len() as u64 {
            wrong.push(format!("{name}: {} MiB", grown / MIB));
        }
        if !expected.is_empty() && word != expected {
            wrong.push(format!("{name}: {word}, not {expected}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
