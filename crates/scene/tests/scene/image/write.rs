//! Writing images: bytes of PNG and OpenEXR files, and files that are written whole or not at all.

use dapple_scene::image::*;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the bytes of a PNG file's pixels, read as linear values from 0 to 1.
fn bytes_of(file: &[u8]) -> Vec<u8> {
    let image = read_image(file, "a.png", Encoding::Linear).unwrap();
    image.pixels.iter().flatten().map(|v| (v * 255.0).round() as u8).collect()
}

#[test]
fn every_float_has_its_byte_and_bytes_are_reproducible_i08() {
    let values = [f32::NAN, -f32::NAN, f32::NEG_INFINITY, -1e30, -1.0, -0.0, 1e-45, 1.0, 1e30, f32::INFINITY];
    let expected = [0, 0, 0, 0, 0, 0, 0, 255, 255, 255];
    let image = Image::new([10, 1], values.map(|v| [v; 3]).to_vec()).unwrap();
    for stops in [0.0, 3.5, 1e30] {
        let file = encode_png(&image, stops).unwrap();
        assert_eq!(file, encode_png(&image, stops).unwrap());
        let mut expected = expected.map(|b| [b; 3]);
        if stops == 1e30 {
            // The smallest denormal is bright by then.
            expected[6] = [255; 3];
        }
        assert_eq!(bytes_of(&file), expected.concat());
    }
    let dark = encode_png(&image, -1e30).unwrap();
    assert_eq!(bytes_of(&dark)[..27], [0; 27]);
    for stops in [f32::NAN, f32::INFINITY] {
        assert!(matches!(encode_png(&image, stops), Err(ImageError::Exposure { .. })));
    }
}

#[test]
fn eight_bit_images_survive_decoding_and_encoding() {
    let ramp: Vec<[u8; 3]> = (0..=255).map(|b| [b, 255 - b, b / 2]).collect();
    let file = encode_png_rgb([16, 16], &ramp).unwrap();
    let image = read_image(&file, "a.png", Encoding::Auto).unwrap();
    assert_eq!(encode_png(&image, 0.0).unwrap(), file);
    let gray: Vec<u8> = (0..=255).collect();
    let file = encode_png_gray([256, 1], &gray).unwrap();
    let image = read_image(&file, "a.png", Encoding::Srgb).unwrap();
    assert_eq!(bytes_of(&encode_png(&image, 0.0).unwrap()), gray.iter().flat_map(|&b| [b; 3]).collect::<Vec<_>>());
}

#[test]
fn lengths_are_checked() {
    assert!(matches!(encode_png_gray([2, 2], &[0; 3]), Err(ImageError::PixelCount { .. })));
    assert!(matches!(encode_png_rgb([0, 2], &[]), Err(ImageError::Empty { .. })));
}

fn attributes(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|&(n, v)| (n.to_owned(), v.to_owned())).collect()
}

fn extremes() -> Vec<f32> {
    let bits = [0x7fc0_0000, 0x7f80_0001, 0xffc1_2345, 0x0000_0001, 0x8000_0001, 0x007f_ffff];
    let mut values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
    values.extend([0.0, -0.0, 65504.0, 65505.0, -65505.0, 1e38, -1e38, f32::INFINITY, f32::NEG_INFINITY]);
    values
}

fn bits(plane: &Plane<'_>) -> Vec<u32> {
    match plane {
        Plane::U32(v) => v.to_vec(),
        floats => floats.floats().iter().map(|x| x.to_bits()).collect(),
    }
}

#[test]
fn f32_and_u32_survive_bit_for_bit_and_f16_clamps_with_a_count_i07() {
    let values = extremes();
    let counts: Vec<u32> = (0..15).map(|i| u32::MAX - i * 0x0123_4567).collect();
    let layers = [
        Layer { name: String::new(), channels: ["R", "G", "B"].map(|c| (c, values.clone().into())).into() },
        Layer { name: "count".into(), channels: vec![("Y", counts.clone().into())] },
        Layer { name: "half".into(), channels: vec![("Y", Plane::F16(values.clone().into()))] },
    ];
    let encoded = encode_exr([5, 3], &layers, &[]).unwrap();
    let read = read_channels(&encoded.bytes, "a.exr").unwrap();
    assert_eq!(read.size, [5, 3]);
    let names: Vec<&str> = read.channels.iter().map(|(n, _)| n.as_str()).collect();
    assert_eq!(names, ["B", "G", "R", "count.Y", "half.Y"]);
    for channel in ["R", "G", "B"] {
        assert_eq!(bits(read.plane(channel).unwrap()), values.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
    }
    assert_eq!(bits(read.plane("count.Y").unwrap()), counts);
    // 65505, -65505, 1e38, -1e38; infinities and NaN survive.
    assert_eq!(encoded.clamped, 4);
    let Some(Plane::F16(halves)) = read.plane("half.Y") else { panic!("not f16") };
    assert_eq!(halves[8..], [65504.0, 65504.0, -65504.0, 65504.0, -65504.0, f32::INFINITY, f32::NEG_INFINITY]);
    assert!(halves[..3].iter().all(|v| v.is_nan()));
    let image = read_image(&encoded.bytes, "a.exr", Encoding::Auto).unwrap();
    let found: Vec<u32> = image.pixels.iter().flatten().map(|v| v.to_bits()).collect();
    assert_eq!(found, values.iter().flat_map(|v| [v.to_bits(); 3]).collect::<Vec<_>>());
}

#[test]
fn sizes_around_the_block_height_survive() {
    for size in [[1, 1], [1, 17], [3, 15], [2, 16], [7, 33], [129, 1]] {
        let count = size[0] * size[1];
        let values: Vec<f32> = (0..count).map(|i| i as f32 * 0.37).collect();
        let layer = Layer { name: "a".into(), channels: vec![("Z", values.clone().into())] };
        let encoded = encode_exr(size, &[layer], &[]).unwrap();
        let read = read_channels(&encoded.bytes, "a.exr").unwrap();
        assert_eq!((read.size, &read.channels[0].1), (size, &Plane::F32(values.into())));
    }
}

#[test]
fn bytes_are_reproducible_and_attributes_come_back() {
    let image = Image::new([2, 1], vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]).unwrap();
    let layer = Layer::of_image("", &image);
    let given: Vec<_> = (0..40).map(|i| (format!("dapple:key{i}"), format!("värde {i} 🎨\nzweite Zeile"))).collect();
    let once = encode_exr([2, 1], std::slice::from_ref(&layer), &given).unwrap();
    // A hash map of 40 keys has the same order twice once in 40! runs.
    assert_eq!(once, encode_exr([2, 1], &[layer], &given).unwrap());
    let read = read_attributes(&once.bytes, "a.exr").unwrap();
    assert!(given.iter().all(|pair| read.contains(pair)), "{read:?}");
    assert_eq!(read_image(&once.bytes, "a.exr", Encoding::Auto).unwrap(), image);
}

#[test]
fn a_file_written_block_by_block_from_computed_values_has_the_bytes_of_the_encoded_planes() {
    let size = [37, 150];
    let value = |i: usize| (i as f32 * 0.37).sin() * 1e5;
    let values: Vec<f32> = (0..37 * 150).map(value).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for is_half in [false, true] {
        let layer = |mut plane: Plane<'static>| {
            if is_half {
                plane.halve();
            }
            Layer { name: "a".into(), channels: vec![("Z", plane), ("Y", vec![7_u32; 37 * 150].into())] }
        };
        let attributes: Vec<_> = (0..40).map(|i| (format!("key{i}"), format!("value {i}"))).collect();
        let header = ExrHeader { attributes: &attributes, ..ExrHeader::default() };
        let encoded = encode_exr(size, &[layer(values.clone().into())], &attributes).unwrap();
        let clamped = write_exr(&path, size, &[layer(Plane::each(37 * 150, value))], &header).unwrap();
        assert_eq!((clamped > 0, clamped), (is_half, encoded.clamped));
        assert!(std::fs::read(&path).unwrap() == encoded.bytes, "half: {is_half}");
    }
    let refused = [("a\0".to_owned(), String::new())];
    let header = ExrHeader { attributes: &refused, ..ExrHeader::default() };
    let layer = Layer { name: String::new(), channels: vec![("Y", Plane::each(1, |_| 0.0))] };
    assert!(write_exr(&folder.path().join("b.exr"), [1, 1], &[layer], &header).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn what_a_file_cannot_hold_is_refused() {
    let layer = |name: &str| Layer { name: name.into(), channels: vec![("Y", vec![1.0_f32].into())] };
    let message = |size, layers: &[Layer<'_>], pairs: &[(&str, &str)]| {
        encode_exr(size, layers, &attributes(pairs)).unwrap_err().to_string()
    };
    assert!(message([1, 1], &[], &[]).contains("at least one channel"));
    assert!(message([0, 1], &[layer("a")], &[]).contains("0x1"));
    assert!(message([2, 1], &[layer("a")], &[]).contains("needs 2 pixels, not 1"));
    assert!(message([1, 1], &[layer("a"), layer("a")], &[]).contains("\"a.Y\" is given twice"));
    assert!(message([1, 1], &[layer(&"x".repeat(300))], &[]).contains("255"));
    assert!(message([1, 1], &[layer("a")], &[("b", "1"), ("b", "2")]).contains("given twice"));
    for name in ["compression", "channels", "near", "dataWindow", "chunkCount", "lineOrder", "type"] {
        let text = message([1, 1], &[layer("a")], &[(name, "x")]);
        assert!(text.contains(name) && text.contains("rename"), "{name}: {text}");
    }
    assert!(encode_exr([1, 1], &[layer("a")], &attributes(&[("made by", "me"), ("empty", "")])).is_ok());
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn files_are_replaced_whole_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.exr", "🎨 bild ü.exr", "no extension", ".exr"] {
        let path = folder.path().join(name);
        check_writable(&path).unwrap();
        assert!(!path.exists());
        write_file(&path, b"first").unwrap();
        check_writable(&path).unwrap();
        write_file(&path, b"2nd").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"2nd");
    }
    assert_eq!(names(folder.path()), [".exr", "a.exr", "no extension", "🎨 bild ü.exr"]);
}

#[test]
fn trouble_names_the_path_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there.png");
    fs::write(&there, b"old").unwrap();
    let mut read_only = fs::metadata(&there).unwrap().permissions();
    read_only.set_readonly(true);
    fs::set_permissions(&there, read_only).unwrap();
    let cases = [
        (folder.path().join("missing/a.png"), "create the directory first"),
        (there.join("a.png"), "create the directory first"),
        (there.clone(), "change the permissions"),
        (folder.path().to_owned(), "choose another path"),
        (folder.path().join(format!("{}.png", "x".repeat(300))), "choose a shorter"),
        (PathBuf::new(), "choose another path"),
    ];
    for (path, advice) in cases {
        for error in [check_writable(&path).unwrap_err(), write_file(&path, b"x").unwrap_err()] {
            let message = error.to_string();
            assert!(message.contains(&*path.to_string_lossy()) && message.contains(advice), "{message}");
        }
    }
    assert_eq!(fs::read(&there).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["there.png"]);
}

#[cfg(unix)]
#[test]
fn a_read_only_directory_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let locked = folder.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    let path = locked.join("a.png");
    if fs::write(locked.join("probe"), b"").is_ok() {
        eprintln!("skipped: this user (root) may write to read-only directories");
    } else {
        assert!(check_writable(&path).unwrap_err().to_string().contains("change the permissions"));
        assert!(write_file(&path, b"x").is_err());
    }
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn devices_are_written_to_and_never_replaced() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let is_device = |path: &str| fs::metadata(path).unwrap().file_type().is_char_device();
    if !(is_device("/dev/full") && is_device("/dev/null")) {
        eprintln!("skipped: no /dev/full");
        return;
    }
    check_writable(Path::new("/dev/null")).unwrap();
    write_file(Path::new("/dev/null"), b"x").unwrap();
    let message = write_file(Path::new("/dev/full"), b"x").unwrap_err().to_string();
    assert!(message.contains("/dev/full") && message.contains("free some space"), "{message}");
    assert!(is_device("/dev/full") && is_device("/dev/null"));

    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("link.png");
    symlink("behind.png", &link).unwrap();
    for bytes in [b"1", b"2"] {
        write_file(&link, bytes).unwrap();
        assert_eq!(fs::read(folder.path().join("behind.png")).unwrap(), bytes);
    }
    assert!(fs::symlink_metadata(&link).unwrap().file_type().is_symlink());
}

#[test]
fn extensions_tell_the_format() {
    let of = |name: &str| Format::from_path(Path::new(name));
    assert_eq!(
        [of("a.exr").unwrap(), of("b/c.PFM").unwrap(), of("🎨.Png").unwrap()],
        [Format::Exr, Format::Pfm, Format::Png]
    );
    for name in ["a.jpg", "exr", ".png", "", "a."] {
        let message = of(name).unwrap_err().to_string();
        assert!(message.contains(".exr, .pfm or .png"), "{message}");
    }
}

#[test]
fn bytes_are_the_nearest_to_the_curve() {
    let values: Vec<f32> = (0..=200_000).map(|i| i as f32 / 200_000.0).collect();
    let image = Image::new([200_001, 1], values.iter().map(|v| [*v; 3]).collect()).unwrap();
    let bytes = bytes_of(&encode_png(&image, 0.0).unwrap());
    for (x, byte) in values.iter().zip(bytes.chunks_exact(3)) {
        assert!((f64::from(byte[0]) - 255.0 * srgb_encode(f64::from(*x))).abs() <= 0.5 + 1e-9, "{x}");
    }
}

/// A value turns from one byte to the next at the middle between both, divided by the power of two.
#[test]
fn exposure_is_a_power_of_two() {
    for i in -400i32..400 {
        let stops = i as f32 / 40.0;
        let middle = srgb_decode((f64::from(i.rem_euclid(255)) + 0.5) / 255.0) / f64::from(stops).exp2();
        let beside = [1.0 - 2e-7, 1.0 + 2e-7].map(|factor| [(middle * factor) as f32; 3]);
        let bytes = bytes_of(&encode_png(&Image::new([2, 1], beside.to_vec()).unwrap(), stops).unwrap());
        assert_eq!([bytes[0], bytes[3]].map(i32::from), [0, 1].map(|next| i.rem_euclid(255) + next), "{stops}");
    }
}

#[test]
fn the_curve_is_the_standards_within_1e_14() {
    for i in 0..=100_000 {
        let x = f64::from(i) / 100_000.0;
        let decoded = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        assert!((srgb_decode(x) - decoded).abs() < 1e-14, "decode {x}: {} {decoded}", srgb_decode(x));
        assert!((srgb_encode(x) - encoded).abs() < 1e-14, "encode {x}: {} {encoded}", srgb_encode(x));
    }
}

#[test]
fn out_of_range_is_clamped() {
    let clamped = |f: fn(f64) -> f64| [f64::NAN, -1.0, f64::NEG_INFINITY, 7.0, f64::INFINITY].map(f);
    assert_eq!([srgb_decode, srgb_encode].map(clamped), [[0.0, 0.0, 0.0, 1.0, 1.0]; 2]);
}
