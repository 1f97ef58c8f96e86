//! The reader against whole files, cut files, lying files and other people's files.

use ::exr::prelude as exr;
use ::image::{DynamicImage, ImageFormat};
use dapple_scene::image::*;
use rand::{RngExt, SeedableRng};
use std::path::{Path, PathBuf};

fn save(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// 5x3 pixels, all different.
fn image() -> Image {
    Image::new([5, 3], (0..15).map(|i| [i as f32 * 0.25, 1.0 / (i + 1) as f32, -(i as f32)]).collect()).unwrap()
}

fn rgb8() -> ::image::RgbImage {
    ::image::RgbImage::from_fn(5, 3, |x, y| ::image::Rgb([(x * 60) as u8, (y * 100) as u8, (x * y * 20) as u8]))
}

/// An EXR of another make: tiles, RLE, half floats, two parts of which the second holds the colours.
fn foreign_exr() -> Vec<u8> {
    let depth =
        exr::AnyChannels::sort([exr::AnyChannel::new("Z", exr::FlatSamples::F32(vec![7.0; 15]))].into_iter().collect());
    let color = ["R", "G", "B"].into_iter().enumerate().map(|(c, name)| {
        let values = image().pixels.iter().map(|p| exr::f16::from_f32(p[c])).collect();
        exr::AnyChannel::new(name, exr::FlatSamples::F16(values))
    });
    let layer = |name: &str, channels| {
        let encoding = exr::Encoding {
            compression: exr::Compression::RLE,
            blocks: exr::Blocks::Tiles(exr::Vec2(2, 2)),
            line_order: exr::LineOrder::Increasing,
        };
        exr::Layer::new((5, 3), exr::LayerAttributes::named(exr::Text::from(name)), encoding, channels)
    };
    let layers = [layer("depth", depth), layer("color", exr::AnyChannels::sort(color.collect()))];
    let mut attributes = exr::ImageAttributes::with_size((5, 3));
    attributes.other.insert(exr::Text::from("samplesPerPixel"), exr::AttributeValue::I32(16));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = exr::Image::from_layers(attributes, layers.into_iter().collect::<exr::SmallVec<[_; 2]>>());
    exr::WritableImage::write(&image).non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn whole_numbers_of_a_header_are_read() {
    let integers = |bytes: Vec<u8>| ExrFile::open(bytes, "a.exr").unwrap().integers(0);
    let found = integers(foreign_exr());
    assert!(found.contains(&("samplesPerPixel".to_owned(), 16)), "{found:?}");
    let ours = encode_exr([5, 3], &[Layer::of_image("", &image())], &[]).unwrap();
    assert!(integers(ours.bytes).iter().all(|(name, _)| name != "samplesPerPixel"));
}

/// A name and a small file of every format.
fn small_files() -> Vec<(&'static str, Vec<u8>)> {
    let floats = ::image::Rgb32FImage::from_fn(9, 3, |x, y| ::image::Rgb([x as f32, y as f32 * 0.1, 1e-3]));
    let words = DynamicImage::ImageRgb8(rgb8()).to_rgba16();
    vec![
        ("a.png", save(rgb8().into(), ImageFormat::Png)),
        ("16.png", save(words.into(), ImageFormat::Png)),
        ("a.jpg", save(rgb8().into(), ImageFormat::Jpeg)),
        ("a.tga", save(rgb8().into(), ImageFormat::Tga)),
        ("a.hdr", save(floats.into(), ImageFormat::Hdr)),
        ("a.pfm", encode_pfm(&image()).unwrap()),
        ("a.exr", encode_exr([5, 3], &[Layer::of_image("", &image())], &[]).unwrap().bytes),
        ("foreign.exr", foreign_exr()),
    ]
}

fn read(name: &str, bytes: &[u8]) -> Result<Image, ImageError> {
    read_image(bytes, name, Encoding::Auto)
}

#[test]
fn small_files_of_every_format_are_read() {
    for (name, bytes) in small_files() {
        let found = read(name, &bytes).unwrap();
        match name {
            "a.pfm" | "a.exr" => assert_eq!(found, image()),
            "foreign.exr" => {
                let half = |v: f32| exr::f16::from_f32(v).to_f32();
                assert_eq!(found.pixels, image().pixels.iter().map(|p| p.map(half)).collect::<Vec<_>>());
            }
            "a.hdr" => {
                assert_eq!(found.size, [9, 3]);
                let [r, g, b] = found.pixel(8, 2);
                assert!((r - 8.0).abs() < 0.04 && (g - 0.2).abs() < 0.04 && b < 0.04);
            }
            _ => {
                assert_eq!(found.size, [5, 3]);
                let tolerance = if name == "a.jpg" { 0.2 } else { 1e-6 };
                for (pixel, bytes) in found.pixels.iter().zip(rgb8().pixels()) {
                    for c in 0..3 {
                        let expected = srgb_decode(f64::from(bytes.0[c]) / 255.0);
                        assert!((f64::from(pixel[c]) - expected).abs() < tolerance, "{name}: {pixel:?} {bytes:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn encodings_are_followed_for_integers_and_ignored_for_floats() {
    let linear = |name: &str, bytes: &[u8]| read_image(bytes, name, Encoding::Linear).unwrap();
    for (name, bytes) in small_files() {
        let srgb = read_image(&bytes, name, Encoding::Srgb).unwrap();
        assert_eq!(srgb, read(name, &bytes).unwrap());
        assert_eq!(linear(name, &bytes) == srgb, ["a.hdr", "a.pfm", "a.exr", "foreign.exr"].contains(&name), "{name}");
    }
    let gray_alpha = ::image::GrayAlphaImage::from_raw(1, 1, vec![51, 0]).unwrap();
    let file = save(gray_alpha.into(), ImageFormat::Png);
    assert_eq!(linear("a.png", &file).pixels, [[0.2; 3]]);
    assert_eq!(linear("named.jpg", &file).pixels, [[0.2; 3]], "the content decides, not the name");
}

#[test]
fn files_cut_at_any_byte_are_errors() {
    for (name, bytes) in small_files() {
        for length in 0..bytes.len() {
            let outcome = read(name, &bytes[..length]);
            let error = outcome.expect_err(&format!("{name} cut to {length} of {} bytes", bytes.len()));
            assert!(error.to_string().starts_with(&format!("{name}: ")), "{error}");
        }
    }
}

#[test]
fn every_format_tells_what_it_holds() {
    let flat = |name: &str| {
        let bytes = small_files().into_iter().find(|(known, _)| *known == name).unwrap().1;
        match image_info(&bytes, name).unwrap() {
            ImageInfo::Flat { format, size: [w, h], channels, values } => {
                format!("{format} {w}x{h} {channels} {values}")
            }
            ImageInfo::Exr(parts) => parts.iter().map(|p| format!("{}:{} ", p.name, p.channels.len())).collect(),
        }
    };
    assert_eq!(flat("a.png"), "PNG 5x3 R, G, B 8 bits");
    assert_eq!(flat("16.png"), "PNG 5x3 R, G, B, A 16 bits");
    assert_eq!(flat("a.jpg"), "JPEG 5x3 R, G, B 8 bits");
    assert_eq!(flat("a.tga"), "TGA 5x3 R, G, B 8 bits");
    assert_eq!(flat("a.hdr"), "Radiance HDR 9x3 R, G, B 8 bits and a common exponent");
    assert_eq!(flat("a.pfm"), "PFM 5x3 R, G, B float");
    assert_eq!(flat("foreign.exr"), "depth:1 color:3 ");
}

#[test]
fn deep_data_is_refused_by_its_name() {
    let mut bytes = small_files()[6].1.clone();
    bytes[5] |= 0x08;
    let message = read("a.exr", &bytes).unwrap_err().to_string();
    assert_eq!(message, "a.exr: deep data in OpenEXR files is not supported; save the image as a flat image");
}

#[test]
fn damaged_files_never_panic() {
    let mut random = rand_pcg::Pcg64::seed_from_u64(8);
    for (name, bytes) in small_files() {
        for _ in 0..3000 {
            let mut bytes = bytes.clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] = if random.random() { bytes[at] ^ 1 << random.random_range(0..8) } else { random.random() };
            }
            if let Ok(found) = read(name, &bytes) {
                assert_eq!(found.pixels.len(), found.width() * found.height());
            }
            let _ = read_channels(&bytes, name);
            let _ = read_attributes(&bytes, name);
            let _ = image_info(&bytes, name);
            if let Ok(file) = ExrFile::open(bytes, name) {
                let window = file.parts[0].data_window;
                let edit = ExrEdit { part: 0, window, channels: vec![("R".into(), vec![1.0; window.pixels()].into())] };
                let _ = file.rewritten(&[edit], &[]);
            }
        }
    }
}

/// Replaces the only occurrence of `old`.
fn patch(bytes: &[u8], old: &[u8], new: &[u8]) -> Vec<u8> {
    let at: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i..].starts_with(old)).collect();
    assert_eq!(at.len(), 1, "{old:?} is found at {at:?}");
    [&bytes[..at[0]], new, &bytes[at[0] + old.len()..]].concat()
}

/// Small files that claim gigapixels.
fn lying_files() -> Vec<(&'static str, Vec<u8>)> {
    let le = |values: [i32; 4]| values.map(i32::to_le_bytes).concat();
    let exr = small_files().swap_remove(6).1;
    // displayWindow keeps the true size.
    let window = |last: [i32; 2]| {
        let old = [b"dataWindow\0box2i\0\x10\0\0\0".as_slice(), &le([0, 0, 4, 2])].concat();
        let new = [b"dataWindow\0box2i\0\x10\0\0\0".as_slice(), &le([0, 0, last[0], last[1]])].concat();
        patch(&exr, &old, &new)
    };
    let tiles = |size: u32| {
        let old = b"tiles\0tiledesc\0\t\0\0\0\x02\0\0\0\x02\0\0\0";
        let at: Vec<usize> = (0..foreign_exr().len()).filter(|&i| foreign_exr()[i..].starts_with(old)).collect();
        let mut bytes = foreign_exr();
        for i in at {
            bytes[i + 19..i + 23].copy_from_slice(&size.to_le_bytes());
            bytes[i + 23..i + 27].copy_from_slice(&size.to_le_bytes());
        }
        bytes
    };
    let mut png = small_files()[0].1.clone();
    png[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    let sum = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&sum.to_be_bytes());
    let jpeg =
        patch(&small_files()[2].1, &[0xff, 0xc0, 0, 17, 8, 0, 3, 0, 5], &[0xff, 0xc0, 0, 17, 8, 255, 255, 255, 255]);
    let mut tga = small_files()[3].1.clone();
    tga[12..16].fill(255);
    vec![
        ("png", png),
        ("jpeg", jpeg),
        ("a.tga", tga),
        ("hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4294967295 +X 4294967295\n\x02\x02\xff\xff".to_vec()),
        ("hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 40000\n\x02\x02\xff\xff".to_vec()),
        ("pfm", b"PF\n4294967295 4294967295\n-1.0\n0123".to_vec()),
        ("pfm", b"PF\n18446744073709551615 18446744073709551615\n-1.0\n0123".to_vec()),
        ("pfm", b"Pf\n1 4294967295\n1.0\n0123".to_vec()),
        ("exr window", window([65535, 65535])),
        ("exr window", window([i32::MAX - 1, i32::MAX - 1])),
        ("exr window", window([i32::MAX, 2])),
        ("exr window", window([4, 1 << 28])),
        ("exr tiles", tiles(0x7fff_ffff)),
        ("exr tiles", tiles(u32::MAX)),
        ("exr tiles", tiles(1 << 16)),
        ("exr tiles", tiles(0)),
    ]
}

/// The checksum of PNG chunks [ISO 15948, annex D], bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ c >> 1 } else { c >> 1 })
    })
}

#[test]
fn false_headers_are_errors_before_memory_is_allocated_i03() {
    const LIMITED: &str = "DAPPLE_TEST_MEMORY_LIMITED";
    for (name, bytes) in lying_files() {
        let error = read(name, &bytes).expect_err(name);
        if !name.starts_with("exr") {
            // The HDR decoder reports sizes that overflow itself.
            assert!(matches!(error, ImageError::TooLarge { .. } | ImageError::Unsupported { .. }), "{name}: {error}");
        }
        assert!(read_channels(&bytes, name).is_err());
    }
    if std::env::var_os(LIMITED).is_some() {
        // The negative control: what the smallest of these headers claims cannot be had.
        assert!(Vec::<[f32; 3]>::new().try_reserve_exact(40_000 * 40_000).is_err());
    } else if cfg!(target_os = "linux") {
        // The same once more in a process that has 400 MB of address space.
        let limited = "ulimit -v 400000 && exec \"$0\" --exact image::read::false_headers_are_errors_before_memory_is_allocated_i03";
        let mut run = std::process::Command::new("sh");
        run.args(["-c", limited]).arg(std::env::current_exe().unwrap()).env(LIMITED, "1").env("RUST_TEST_THREADS", "1");
        let output = run.output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && text.contains("1 passed"),
            "{text}{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
}

#[test]
fn empty_and_foreign_files_are_refused_with_advice() {
    let message = |name: &str, bytes: &[u8]| read(name, bytes).unwrap_err().to_string();
    for (name, bytes) in [("a.pfm", b"PF\n0 3\n-1\n".as_slice()), ("a.hdr", b"#?RADIANCE\n\n-Y 0 +X 0\n")] {
        assert!(message(name, bytes).contains("both sides must be at least 1"), "{}", message(name, bytes));
    }
    assert!(message("🎨.gif", b"GIF89a").starts_with("🎨.gif: unknown image format; convert it to PNG"));
    assert!(message("a.png", b"").contains("unknown image format"));
    assert!(
        message("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n0000").contains("save the image as RGBE")
    );
    let depth = ["Z", "ZBack"].map(|name| (name, vec![1.0_f32].into()));
    let depth = encode_exr([1, 1], &[Layer { name: String::new(), channels: depth.into() }], &[]).unwrap().bytes;
    assert!(message("a.exr", &depth).contains("its channels are Z, ZBack"));
    let chroma = ["BY", "RY", "Y"].map(|name| (name, vec![1.0_f32].into()));
    let chroma = encode_exr([1, 1], &[Layer { name: String::new(), channels: chroma.into() }], &[]).unwrap().bytes;
    assert!(message("a.exr", &chroma).contains("luminance and chroma"));
}

#[test]
fn the_main_layer_is_preferred_and_others_are_found() {
    let layer = |name: &str, value: f32, letters: &[&'static str]| Layer {
        name: name.into(),
        channels: letters.iter().map(|&c| (c, vec![value].into())).collect(),
    };
    let first = |layers: &[Layer<'_>]| {
        let file = encode_exr([1, 1], layers, &[]).unwrap().bytes;
        read("a.exr", &file).unwrap().pixels[0]
    };
    let rgb = ["R", "G", "B"];
    assert_eq!(first(&[layer("albedo", 1.0, &rgb), layer("", 2.0, &rgb)]), [2.0; 3]);
    assert_eq!(first(&[layer("albedo", 1.0, &rgb), layer("", 2.0, &["Y"])]), [2.0; 3]);
    assert_eq!(first(&[layer("depth", 1.0, &["Z"]), layer("view.left", 2.0, &rgb)]), [2.0; 3]);
    assert_eq!(first(&[layer("Y", 1.0, &["Y"])]), [1.0; 3]);
    // Subsets: a single channel is gray whatever its name, and what is missing of several is 0.
    for only in ["R", "A", "Z"] {
        assert_eq!(first(&[layer("", 2.0, &[only])]), [2.0; 3]);
    }
    assert_eq!(first(&[layer("", 2.0, &["R", "B", "Z"])]), [2.0, 0.0, 2.0]);
}

#[test]
fn alpha_is_kept_where_a_pixel_is_not_opaque() {
    let rgba = |alpha: [u8; 2]| ::image::RgbaImage::from_raw(2, 1, vec![9, 9, 9, alpha[0], 8, 8, 8, alpha[1]]).unwrap();
    let gray = |alpha: [u8; 2]| ::image::GrayAlphaImage::from_raw(2, 1, vec![9, alpha[0], 8, alpha[1]]).unwrap();
    let exr = |alpha: [u8; 2]| {
        let alpha = alpha.map(|a| f32::from(a) / 255.0).to_vec();
        let channels = [("R", vec![1.0, 2.0]), ("G", vec![3.0, 4.0]), ("B", vec![5.0, 6.0]), ("A", alpha)];
        let channels = channels.map(|(name, values)| (name, Plane::from(values))).into();
        encode_exr([2, 1], &[Layer { name: String::new(), channels }], &[]).unwrap().bytes
    };
    let files = |alpha: [u8; 2]| {
        let png = |image: DynamicImage| save(image, ImageFormat::Png);
        [
            ("8.png", png(rgba(alpha).into())),
            ("16.png", png(DynamicImage::from(rgba(alpha)).to_rgba16().into())),
            ("gray.png", png(gray(alpha).into())),
            ("gray16.png", png(DynamicImage::from(gray(alpha)).to_luma_alpha16().into())),
            ("a.tga", save(rgba(alpha).into(), ImageFormat::Tga)),
            ("a.exr", exr(alpha)),
        ]
    };
    for (name, bytes) in files([51, 255]) {
        for encoding in [Encoding::Auto, Encoding::Linear] {
            assert_eq!(read_image(&bytes, name, encoding).unwrap().alpha, [0.2, 1.0], "{name}");
        }
    }
    for (name, bytes) in files([255, 255]) {
        assert!(read(name, &bytes).unwrap().alpha.is_empty(), "{name}");
    }
    assert_eq!(read("a.exr", &exr([0, 0])).unwrap().pixels, [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]);
    let image = Image::filled([5, 1], [1.0; 3]).unwrap();
    assert!(matches!(image.clone().with_alpha(vec![1.0]), Err(ImageError::PixelCount { found: 1, .. })));
    let odd = vec![f32::NAN, -1.0, 7.0, f32::INFINITY, 0.5];
    assert_eq!(image.with_alpha(odd).unwrap().alpha, [1.0, 0.0, 1.0, 1.0, 0.5]);
}

#[test]
fn pfm_is_read_in_both_byte_orders_scaled_and_from_the_bottom_up() {
    let gray = |header: &str, bytes: [[u8; 4]; 2]| {
        let file = [header.as_bytes(), &bytes.concat()].concat();
        read("a.pfm", &file).map(|p| p.pixels.iter().map(|p| p[0]).collect::<Vec<_>>())
    };
    let [little, big] =
        [[1.5_f32.to_le_bytes(), 2.0_f32.to_le_bytes()], [1.5_f32.to_be_bytes(), 2.0_f32.to_be_bytes()]];
    assert_eq!(gray("Pf\n1 2\n-1.0\n", little).unwrap(), [2.0, 1.5]);
    assert_eq!(gray("Pf 2 1 1 ", big).unwrap(), [1.5, 2.0]);
    assert_eq!(gray("Pf\r\n2 1\r\n-10\r\n", little).unwrap(), [15.0, 20.0]);
    for header in
        ["Pf\n1 2\n0\n", "Pf\n1 2\nnan\n", "Pf\n-1 2\n-1\n", "Pf\n1 x\n-1\n", "Pf\n1 1\n-1\n", "Pfm\n1 2\n-1\n"]
    {
        let error = gray(header, little).unwrap_err();
        assert!(matches!(error, ImageError::Malformed { .. }), "{header}: {error}");
    }
}

#[test]
fn pfm_keeps_every_bit_at_any_size_i07() {
    for size in [[1, 1], [3, 1], [1, 3], [7, 5]] {
        let count = (size[0] * size[1]) as usize;
        let specials = [0.0, -0.0, 1e-45, 65505.0, 1e38, f32::NAN, f32::INFINITY, f32::from_bits(0xffa0_0001)];
        let pixels: Vec<[f32; 3]> = (0..count).map(|i| std::array::from_fn(|c| specials[(3 * i + c) % 8])).collect();
        let bits = |p: &[[f32; 3]]| p.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
        let file = encode_pfm(&Image::new(size, pixels.clone()).unwrap()).unwrap();
        let found = read("a.pfm", &file).unwrap();
        assert_eq!((found.size, bits(&found.pixels)), (size, bits(&pixels)));
    }
}

#[test]
fn images_check_their_length_and_find_what_is_not_finite() {
    assert!(matches!(Image::new([2, 2], vec![[0.0; 3]; 3]), Err(ImageError::PixelCount { found: 3, .. })));
    assert!(matches!(Image::filled([0, 2], [0.0; 3]), Err(ImageError::Empty { .. })));
    let mut image = image();
    assert_eq!((image.row(1)[2], image.pixel(2, 1)), (image.pixels[7], image.pixels[7]));
    assert_eq!(image.clone().checked_finite("a.pfm").unwrap(), image);
    image.pixels[7][2] = f32::NEG_INFINITY;
    image.pixels[14] = [f32::NAN; 3];
    let message = image.checked_finite("a.pfm").unwrap_err().to_string();
    assert!(message.starts_with("a.pfm: the pixel in column 2 of row 1 is NaN or infinite, and 1 more; "), "{message}");
}

/// A folder of `../shared` or beside the repository; `None` (with a line saying so) where there is none.
fn shared(variable: &str, name: &str) -> Option<PathBuf> {
    let beside = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(name);
    let folder = std::env::var_os(variable).map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: {} is not there; set {variable}", folder.display());
    None
}

fn read_path(path: &Path) -> Image {
    read(&path.display().to_string(), &std::fs::read(path).unwrap()).unwrap()
}

fn mean(image: &Image) -> [f64; 3] {
    std::array::from_fn(|c| image.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / image.pixels.len() as f64)
}

#[test]
fn images_of_the_scenes_have_the_means_that_other_readers_find() {
    let Some(scenes) = shared("DAPPLE_SCENES", "scenes") else { return };
    // Size and mean by Pillow, OpenEXR's own library, and a decoder in numpy for .hdr.
    for (name, size, expected) in [
        ("pbrt-v4/dining-room/textures/Skydome.pfm", [512, 512], [1.1781, 1.5024, 1.9782]),
        ("pbrt-v4/teapot/textures/envmap.hdr", [1024, 512], [0.6151, 0.5670, 0.5864]),
        ("env/venice_sunset_1k.hdr", [1024, 512], [0.4047, 0.4162, 0.5734]),
        ("mitsuba/common/textures/museum.exr", [512, 256], [0.3970, 0.3162, 0.2784]),
        ("pbrt-v2/textures/grace_latlong.exr", [1024, 512], [0.0196, 0.0118, 0.0157]),
        ("pbrt-v2/textures/lines.exr", [1024, 1024], [0.7238, 0.7238, 0.7238]),
        ("pbrt-v4/cornell-box/TungstenRender.exr", [1024, 1024], [0.1963, 0.1275, 0.0361]),
        ("pbrt-v4/veach-mis/TungstenRender.exr", [1280, 720], [0.6731, 0.6107, 0.5925]),
        ("pbrt-v4/dining-room/textures/Teacup.tga", [186, 300], [0.9169, 0.8885, 0.9087]),
        ("pbrt-v4/dining-room/textures/Tiles.tga", [894, 894], [0.6061, 0.4978, 0.3587]),
        ("pbrt-v4/dining-room/textures/image3.jpg", [1280, 1920], [0.2584, 0.1022, 0.0916]),
        ("pbrt-v4/staircase2/textures/Wallpaper.tga", [512, 512], [0.8040, 0.7423, 0.5363]),
        ("pbrt-v4/staircase2/textures/wood5.jpg", [1600, 1200], [0.3782, 0.0564, 0.0017]),
        ("pbrt-v4/teapot/TungstenRender.png", [1280, 720], [0.3778, 0.3781, 0.3730]),
        ("textures/brick.png", [512, 512], [0.1725, 0.1725, 0.1725]),
    ] {
        let path = scenes.join(name);
        if !path.is_file() {
            eprintln!("skipped: {} is not there", path.display());
            continue;
        }
        let image = read_path(&path);
        assert_eq!((image.size, image.non_finite()), (size, None), "{name}");
        // JPEG leaves the decoder free in how it enlarges chroma; measured 8e-4.
        let tolerance = if name.ends_with("jpg") { 1e-3 } else { 0.6e-4 };
        for (found, listed) in mean(&image).into_iter().zip(expected) {
            assert!((found - listed).abs() < tolerance, "{name}: {found} {listed}");
        }
    }
}

#[test]
fn reference_images_have_the_means_that_their_readme_lists() {
    let Some(folder) = shared("DAPPLE_REFERENCES", "references") else { return };
    for (name, size, expected) in [
        ("coffee", [256, 320], [0.1900, 0.1189, 0.0916]),
        ("coffee-rgb", [256, 320], [0.2077, 0.1183, 0.0931]),
        ("cornell-box-rgb", [320, 320], [0.1963, 0.1276, 0.0361]),
        ("dining-room-rgb", [320, 180], [0.3086, 0.3651, 0.4248]),
        ("staircase2-rgb", [320, 320], [0.6956, 0.5111, 0.2332]),
        ("teapot-rgb", [320, 180], [0.3558, 0.3534, 0.3633]),
        ("veach-bidir-rgb", [320, 320], [0.3886, 0.3531, 0.3283]),
        ("veach-mis", [320, 180], [1.1036, 0.8927, 0.8339]),
        ("water-caustic-rgb", [320, 320], [0.2330, 0.1427, 0.0363]),
    ] {
        let image = read_path(&folder.join(format!("{name}.exr")));
        assert_eq!(image.size, size);
        for (found, listed) in mean(&image).into_iter().zip(expected) {
            assert!((found - listed).abs() < 0.6e-4, "{name}: {found} {listed}");
        }
    }
}

#[test]
fn radiance_files_are_the_right_way_up_in_all_orders_of_pixels() {
    // 2 rows of 3: the value of a pixel is its column and its row.
    let image = |x: u8, y: u8| [16 * x + 16, 16 * y + 16, 16, 129];
    for (order, [across, down]) in [
        ("-Y +X", [1, 1]),
        ("-Y -X", [-1, 1]),
        ("+Y +X", [1, -1]),
        ("+Y -X", [-1, -1]),
        ("+X -Y", [1, 1]),
        ("-X -Y", [-1, 1]),
        ("+X +Y", [1, -1]),
        ("-X +Y", [-1, -1]),
    ] {
        let columns: Vec<u8> = if across == 1 { vec![0, 1, 2] } else { vec![2, 1, 0] };
        let rows: Vec<u8> = if down == 1 { vec![0, 1] } else { vec![1, 0] };
        let (first, second) = order.split_once(' ').unwrap();
        let by_rows = first.ends_with('Y');
        let (counts, pixels): (_, Vec<[u8; 4]>) = if by_rows {
            ([2, 3], rows.iter().flat_map(|&y| columns.iter().map(move |&x| image(x, y))).collect())
        } else {
            ([3, 2], columns.iter().flat_map(|&x| rows.iter().map(move |&y| image(x, y))).collect())
        };
        let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{first} {} {second} {}\n", counts[0], counts[1]);
        let bytes = [head.as_bytes(), pixels.as_flattened()].concat();
        let read = read_image(&bytes, "a.hdr", Encoding::Auto).unwrap();
        assert_eq!(read.size, [3, 2], "{order}");
        for (x, y) in [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)] {
            let found = read.pixel(x, y).map(|c| (c * 128.0).round() as u8);
            assert_eq!(found[..2], image(x as u8, y as u8)[..2], "{order}: {x}, {y}");
        }
        let cut = read_image(&bytes[..bytes.len() - 1], "a.hdr", Encoding::Auto).unwrap_err().to_string();
        assert!(cut.contains("ends at byte") || cut.contains("is damaged"), "{cut}");
    }
    let huge = b"#?RADIANCE\n\n+X 40000 -Y 40000\n\x02\x02\xff\xff";
    assert!(matches!(read_image(huge, "a.hdr", Encoding::Auto), Err(ImageError::TooLarge(_))));
}
