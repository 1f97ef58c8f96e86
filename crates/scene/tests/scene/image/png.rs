//! PNG files of ours: bytes and exposure.

use dapple_scene::image::{Encoding, Image, ImageError, encode_png, encode_png_gray, encode_png_rgb, read_image};

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
