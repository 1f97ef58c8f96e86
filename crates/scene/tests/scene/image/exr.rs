//! OpenEXR files of ours: bits, attributes and refusals.

use dapple_scene::image::{Encoding, Image, Layer, Plane, encode_exr, read_attributes, read_channels, read_image};

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
        Plane::F32(v) | Plane::F16(v) => v.iter().map(|x| x.to_bits()).collect(),
        Plane::U32(v) => v.to_vec(),
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
