//! Colour spaces and windows of image files.

use super::made_exr::{ACES, Made};
use dapple_scene::image::*;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{EnvironmentRadiance, LightKind};

/// A file of one pixel.
fn pixel(rgb: [f32; 3], space: Option<Chromaticities>) -> Vec<u8> {
    let window = Window { origin: [0, 0], size: [1, 1] };
    let of = |name: &str, _, _| rgb[["R", "G", "B"].iter().position(|letter| *letter == name).expect("a colour")];
    Made { space, ..Made::of(vec![Made::part("", window, &["R", "G", "B"], of)]) }.bytes()
}

#[test]
fn colours_of_other_chromaticities_become_rec709() {
    let color = |rgb: [f32; 3]| pixel(rgb, Some(ACES));
    let read = |bytes: &[u8]| read_image(bytes, "a.exr", Encoding::Auto).unwrap().pixels[0];
    // By the matrix from ACEScg to Rec. 709 with Bradford's adaptation, as colour-science prints it.
    let expected = [
        1.705_052 - 0.2 * 0.621_790 - 0.05 * 0.083_258,
        -0.130_257 + 0.2 * 1.140_803 - 0.05 * 0.010_548,
        -0.024_004 - 0.2 * 0.128_970 + 0.05 * 1.152_972,
    ];
    let found = read(&color([1.0, 0.2, 0.05]));
    (0..3).for_each(|c| assert!((found[c] - expected[c]).abs() < 1e-3, "{found:?}, {expected:?}"));
    assert_eq!(read(&color([0.25; 3])), [0.25; 3], "grey stays grey");
    assert_eq!(read(&pixel([1.0, 0.2, 0.05], None)), [1.0, 0.2, 0.05], "without the attribute it is Rec. 709");
    let linear = read_image(&color([1.0, 0.2, 0.05]), "a.exr", Encoding::Linear).unwrap().pixels[0];
    assert_eq!(linear, [1.0, 0.2, 0.05], "data, such as a normal map, has no colour space");
}

#[test]
fn textures_outside_of_rec709_are_clamped_with_one_notice() {
    let texture = |file: Vec<u8>| read_texture(&file, "a.exr", Encoding::Auto).unwrap();
    let (image, notices) = texture(pixel([0.0, 1.0, 0.0], Some(ACES)));
    assert_eq!(image.pixels[0][0], 0.0);
    assert!((image.pixels[0][1] - 1.1408).abs() < 1e-3);
    assert_eq!(notices, ["a.exr: pixels outside of Rec. 709: 1; their negative channels become 0"]);
    // Negative values of data that is not converted stay.
    assert_eq!(texture(pixel([-1.0, 1.0, 0.0], None)), (Image::filled([1, 1], [-1.0, 1.0, 0.0]).unwrap(), vec![]));
}

#[test]
fn textures_with_another_display_window_have_a_notice() {
    let window = Window { origin: [3, 0], size: [1, 1] };
    let display = Window { origin: [0, 0], size: [4, 2] };
    let bytes = Made { display, ..Made::of(vec![Made::part("", window, &["Y"], |_, _, _| 0.5)]) }.bytes();
    let (image, notices) = read_texture(&bytes, "a.exr", Encoding::Auto).unwrap();
    assert_eq!(image.size, [1, 1]);
    assert_eq!(notices, ["a.exr: only the data window (3,0)-(3,0) is read, not the display window (0,0)-(3,1)"]);
}

#[test]
fn chromaticities_of_no_colour_space_are_named() {
    let flat = Chromaticities { red: [0.0; 2], green: [0.0; 2], blue: [0.0; 2], white: [0.0; 2] };
    let file = pixel([1.0, 0.5, 0.25], Some(flat));
    let read = read_image_file(&file, "a.exr", Encoding::Auto, LayerQuery::default()).unwrap();
    assert_eq!(read.image.pixels, [[1.0, 0.5, 0.25]]);
    assert!(read.notices[0].contains("do not form a colour space; Rec. 709 is assumed"), "{:?}", read.notices);
}

/// A sky of ACEScg colours in `beauty`, beside a layer that comes first by its name.
#[test]
fn skies_and_textures_show_the_image_of_a_file_in_rec709() {
    let window = Window { origin: [0, 0], size: [4, 2] };
    let names = ["AO.R", "AO.G", "AO.B", "beauty.R", "beauty.G", "beauty.B"];
    let of = |name: &str, _, _| [9.0, 9.0, 9.0, 0.05, 1.0, 0.2][names.iter().position(|n| *n == name).unwrap()];
    let make = |space| Made { space, ..Made::of(vec![Made::part("", window, &names, of)]) }.bytes();
    let text = b"Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\" \"string filename\" \"a.exr\"\n\
        Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"a.exr\"\nMaterial \"diffuse\" \"texture reflectance\" \"t\"\n\
        Shape \"sphere\"\n";
    let read = |space| {
        let exr = make(space);
        let files: [(&str, &[u8]); 2] = [("a.pbrt", text), ("a.exr", &exr)];
        let scene = read_scene_from(&files[..], "a.pbrt", &ReadOptions::default()).unwrap();
        let LightKind::Infinite { radiance: EnvironmentRadiance::LatLong { image, .. } } = &scene.lights[0].kind else {
            panic!("{:?}", scene.lights)
        };
        let warnings: Vec<String> = scene
            .notices
            .iter()
            .map(|notice| notice.message.clone())
            .filter(|message| message.contains("a.exr"))
            .collect();
        (image.pixels[0], warnings)
    };
    let (plain, warnings) = read(None);
    assert_eq!((plain, warnings), ([0.05, 1.0, 0.2], Vec::new()));
    let (converted, warnings) = read(Some(ACES));
    let expected =
        [0.0, 1.140_803 - 0.05 * 0.130_257 - 0.2 * 0.010_548, 0.2 * 1.152_972 - 0.128_970 - 0.05 * 0.024_004];
    (0..3).for_each(|c| assert!((converted[c] - expected[c]).abs() < 1e-3, "{converted:?}"));
    assert_eq!(warnings.len(), 1, "one for the file: {warnings:?}");
    assert!(warnings[0].starts_with("a.exr: pixels outside of Rec. 709: 8;"), "{warnings:?}");
}

#[test]
fn windows_have_their_common_pixels_cut() {
    let window = |x: i32, y: i32, w: u32, h: u32| Window { origin: [x, y], size: [w, h] };
    let (a, b) = (window(-2, 1, 4, 3), window(0, 0, 5, 3));
    let common = a.common(b).unwrap();
    assert_eq!(common, window(0, 1, 2, 2));
    assert_eq!(a.cut(&(0..12).collect::<Vec<i32>>(), common), [2, 3, 6, 7]);
    assert_eq!(b.cut(&(0..15).collect::<Vec<i32>>(), common), [5, 6, 10, 11]);
    assert_eq!((a.common(window(2, 1, 4, 3)), window(0, 0, 3, 3).common(window(0, 3, 3, 3))), (None, None));
    let far = window(i32::MIN, i32::MIN, u32::MAX, u32::MAX);
    assert_eq!(far.common(far), Some(far));
    assert_eq!(window(30, 7, 40, 28).to_string(), "(30,7)-(69,34)");
}

#[test]
fn views_that_are_not_read_are_named() {
    let window = Window { origin: [0, 0], size: [1, 1] };
    let names = ["R", "G", "B", "right.R", "right.G", "right.B"];
    let of = |name: &str, _, _| if name.starts_with("right") { 2.0 } else { 1.0 };
    let views = vec!["left".to_owned(), "right".to_owned()];
    let bytes = Made { views, ..Made::of(vec![Made::part("", window, &names, of)]) }.bytes();
    let file = read_image_file(&bytes, "a.exr", Encoding::Auto, LayerQuery::default()).unwrap();
    assert_eq!(
        (file.image.pixels[0], &file.notices[..]),
        ([1.0; 3], &["view \"left\" is read; not read: view \"right\"".to_owned()][..])
    );
}

/// An HDR file of one pixel, (1, 0.25, 0.125), with these header lines.
fn hdr(lines: &str) -> Vec<u8> {
    let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{lines}\n-Y 1 +X 1\n");
    [head.as_bytes(), &[128, 32, 16, 129]].concat()
}

#[test]
fn primaries_of_hdr_files_are_converted_as_those_of_openexr() {
    let aces = "PRIMARIES=0.713 0.293 0.165 0.83 0.128 0.044 0.32168 0.33767\n";
    let read = |bytes: &[u8], name: &str, encoding| read_image(bytes, name, encoding).unwrap().pixels[0];
    let color = [1.0, 0.25, 0.125];
    let expected = read(&pixel(color, Some(ACES)), "a.exr", Encoding::Auto);
    let found = read(&hdr(aces), "a.hdr", Encoding::Auto);
    (0..3).for_each(|c| assert!((found[c] - expected[c]).abs() < 1e-3, "{found:?}, {expected:?}"));
    assert!((expected[0] - color[0]).abs() > 0.1, "{expected:?}");
    assert_eq!(read(&hdr(aces), "a.hdr", Encoding::Linear), color, "data has no colour space");
    let wrong = read_image_file(&hdr("PRIMARIES=1 2\n"), "a.hdr", Encoding::Auto, LayerQuery::default()).unwrap();
    assert_eq!((wrong.image.pixels[0], wrong.notices.len()), (color, 1));
}

#[test]
fn fields_of_hdr_files_that_are_not_followed_are_named() {
    for field in ["EXPOSURE=2.0", "COLORCORR=2 1 1", "GAMMA=2.2", "PIXASPECT=2"] {
        let file =
            read_image_file(&hdr(&format!("{field}\n{field}\n")), "a.hdr", Encoding::Auto, LayerQuery::default())
                .unwrap();
        assert_eq!(file.image.pixels, [[1.0, 0.25, 0.125]]);
        assert_eq!(file.notices, [format!("its {field} is ignored; values are used as stored")]);
    }
    let usual =
        "EXPOSURE=1.0\nCOLORCORR=1 1 1\nGAMMA=1\nPIXASPECT=1\nPRIMARIES=0 0 0 0 0 0 0 0\nVIEW=-vta\nSOFTWARE=x\n";
    assert!(read_image_file(&hdr(usual), "a.hdr", Encoding::Auto, LayerQuery::default()).unwrap().notices.is_empty());
}

#[test]
fn hdr_files_may_have_crlf_and_a_byte_order_mark() {
    let file = hdr("EXPOSURE=1\n");
    let (head, pixels) = file.split_at(file.len() - 4);
    let crlf = [String::from_utf8_lossy(head).replace('\n', "\r\n").as_bytes(), pixels].concat();
    for bytes in [crlf.clone(), [b"\xef\xbb\xbf", &*file].concat(), [b"\xef\xbb\xbf", &*crlf].concat()] {
        assert_eq!(read_image(&bytes, "a", Encoding::Auto).unwrap().pixels, [[1.0, 0.25, 0.125]]);
    }
}

#[test]
fn chunks_of_png_files_that_state_other_colours_than_srgb_are_named() {
    let mut plain = std::io::Cursor::new(Vec::new());
    ::image::RgbImage::from_raw(1, 1, vec![255, 128, 0])
        .unwrap()
        .write_to(&mut plain, ::image::ImageFormat::Png)
        .unwrap();
    let plain = plain.into_inner();
    // The decoder doesn't read a chunk whose checksum is wrong, so that these have the right ones.
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    };
    let with = |kind: &str, content: &[u8]| {
        let chunk = [kind.as_bytes(), content].concat();
        let length = (content.len() as u32).to_be_bytes();
        [&plain[..33], &length, &chunk, &crc(&chunk).to_be_bytes(), &plain[33..]].concat()
    };
    let words = |numbers: &[u32]| numbers.iter().flat_map(|n| n.to_be_bytes()).collect::<Vec<u8>>();
    let notices =
        |file: Vec<u8>, encoding| read_image_file(&file, "a.png", encoding, LayerQuery::default()).unwrap().notices;
    let other = [
        ("gAMA", words(&[100_000])),
        ("cHRM", words(&[31_270, 32_900, 68_000, 32_000, 26_500, 69_000, 15_000, 6_000])),
        ("cICP", vec![9, 16, 0, 1]),
    ];
    for (kind, content) in other {
        let expected = format!("its {kind} is ignored; its colours are read as sRGB");
        assert_eq!(notices(with(kind, &content), Encoding::Auto), [expected]);
        assert!(notices(with(kind, &content), Encoding::Linear).is_empty());
    }
    let usual = [
        ("gAMA", words(&[45_455])),
        ("cHRM", words(&[31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000])),
        ("cICP", vec![1, 13, 0, 1]),
    ];
    for (kind, content) in usual {
        assert!(notices(with(kind, &content), Encoding::Auto).is_empty(), "{kind}");
    }
}
