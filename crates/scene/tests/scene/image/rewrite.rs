//! Copies of OpenEXR files with other values in some channels.

use super::made_exr::{ACES, KEY_CODE, Made};
use ::exr::prelude as exr;
use dapple_scene::image::*;

const WINDOW: Window = Window { origin: [-3, 5], size: [20, 18] };

fn value(name: &str, x: i32, y: i32) -> f32 {
    (name.len() as i32 * 1000 + 31 * y + x) as f32 / 64.0
}

/// Two parts of other windows and names, in a space of their own.
fn made() -> Made {
    let inner = Window { origin: [0, 6], size: [7, 5] };
    let parts = vec![
        Made::part("rgba", WINDOW, &["A", "B", "G", "R", "light.B", "light.G", "light.R"], value),
        Made::part("depth", inner, &["Z"], value),
    ];
    let display = Window { origin: [-10, 0], size: [60, 40] };
    Made { display, aspect: 1.5, space: Some(ACES), ..Made::of(parts) }
}

fn edit(window: Window) -> ExrEdit<'static> {
    let plane = |value: f32| Plane::from(vec![value; window.pixels()]);
    ExrEdit { part: 0, window, channels: vec![("G".into(), plane(2.0)), ("error.Y".into(), plane(0.5))] }
}

fn floats(file: &ExrFile<'_>, part: usize, name: &str) -> Vec<f32> {
    let channel = file.parts[part].channels.iter().position(|channel| channel.name == name).expect(name);
    file.planes(part).unwrap()[channel].floats().into_owned()
}

#[test]
fn a_rewritten_file_keeps_all_but_its_edits() {
    let encodings = [
        (exr::Compression::ZIP16, exr::Blocks::ScanLines),
        (exr::Compression::PIZ, exr::Blocks::ScanLines),
        (exr::Compression::RLE, exr::Blocks::Tiles(exr::Vec2(4, 6))),
        (exr::Compression::PXR24, exr::Blocks::ScanLines),
        (exr::Compression::B44, exr::Blocks::Tiles(exr::Vec2(8, 8))),
    ];
    for ((compression, blocks), half) in
        encodings.into_iter().flat_map(|encoding| [(encoding, false), (encoding, true)])
    {
        let encoding = exr::Encoding { compression, blocks, line_order: exr::LineOrder::Increasing };
        let original = ExrFile::open(Made { half, encoding, ..made() }.bytes(), "a.exr").unwrap();
        let attributes = [("dapple:filter".to_owned(), "none".to_owned())];
        let rewritten = original.rewritten(&[edit(WINDOW)], &attributes).unwrap();
        let name = &original.parts[0].compression;
        let lossy = ["b44", "pxr24"].contains(&name.as_str());
        let notice = format!("its compression is now ZIP, not {name}, so that other channels keep their values");
        assert_eq!(rewritten.notices, if lossy { vec![notice] } else { Vec::new() });
        assert_eq!(rewritten, original.rewritten(&[edit(WINDOW)], &attributes).unwrap(), "the same bytes");
        let mut key_code = b"keyCode\0keycode\0\x1c\0\0\0".to_vec();
        key_code.extend(KEY_CODE.into_iter().flat_map(i32::to_le_bytes));
        let copies = rewritten.bytes.windows(key_code.len()).filter(|bytes| *bytes == key_code).count();
        assert_eq!(copies, 2, "the key code of each part");
        let copy = ExrFile::open(rewritten.bytes, "b.exr").unwrap();
        for (part, (new, old)) in copy.parts.iter().zip(&original.parts).enumerate() {
            let header = |part: &ExrPart| ExrPart { channels: Vec::new(), compression: String::new(), ..part.clone() };
            assert_eq!(header(new), header(old), "{compression}");
            for channel in old.channels.iter().filter(|channel| channel.name != "G") {
                assert!(new.channels.contains(channel), "{channel:?}");
                assert_eq!(floats(&copy, part, &channel.name), floats(&original, part, &channel.name), "{compression}");
            }
        }
        assert_eq!(copy.parts[1].compression, original.parts[1].compression, "a part without edits is copied");
        assert_eq!((floats(&copy, 0, "G"), floats(&copy, 0, "error.Y")), (vec![2.0; 360], vec![0.5; 360]));
        let type_of_g = copy.parts[0].channels.iter().find(|channel| channel.name == "G").unwrap().values;
        assert_eq!(type_of_g, if half { "half" } else { "float" });
        assert_eq!((copy.integers(0), copy.integers(1)), (original.integers(0), original.integers(1)));
        let mut texts = original.texts(0);
        texts.push(attributes[0].clone());
        texts.sort();
        assert_eq!((copy.texts(0), copy.texts(1)), (texts, original.texts(1)));
    }
}

#[test]
fn a_part_is_cut_to_the_pixels_of_its_edits() {
    let original = ExrFile::open(made().bytes(), "a.exr").unwrap();
    let window = Window { origin: [1, 5], size: [4, 2] };
    let copy = original.rewritten(&[edit(window)], &[]).unwrap();
    let copy = ExrFile::open(copy.bytes, "b.exr").unwrap();
    assert_eq!((copy.parts[0].data_window, copy.parts[1].data_window), (window, original.parts[1].data_window));
    assert_eq!(copy.parts[0].display_window, original.parts[0].display_window);
    assert_eq!(
        floats(&copy, 0, "light.R"),
        (5..7).flat_map(|y| (1..5).map(move |x| value("light.R", x, y))).collect::<Vec<_>>()
    );
    let apart = Window { origin: [500, 5], size: [4, 2] };
    assert!(original.rewritten(&[edit(apart)], &[]).unwrap_err().to_string().contains("no pixel in common"));
}

#[test]
fn smaller_versions_of_an_image_are_left_out_with_a_notice() {
    let mut channels = exr::SmallVec::new();
    let levels = exr::Levels::Mip {
        rounding_mode: ::exr::math::RoundingMode::Down,
        level_data: vec![
            exr::FlatSamples::F32(vec![1.0; 16]),
            exr::FlatSamples::F32(vec![1.0; 4]),
            exr::FlatSamples::F32(vec![1.0; 1]),
        ],
    };
    channels.push(exr::AnyChannel {
        name: exr::Text::from("Y"),
        sample_data: levels,
        quantize_linearly: false,
        sampling: exr::Vec2(1, 1),
    });
    let encoding = exr::Encoding {
        compression: exr::Compression::ZIP16,
        blocks: exr::Blocks::Tiles(exr::Vec2(2, 2)),
        line_order: exr::LineOrder::Increasing,
    };
    let layer = exr::Layer::new((4, 4), exr::LayerAttributes::default(), encoding, exr::AnyChannels::sort(channels));
    let mut bytes = std::io::Cursor::new(Vec::new());
    exr::WritableImage::write(&exr::Image::from_layer(layer)).non_parallel().to_buffered(&mut bytes).unwrap();
    let original = ExrFile::open(bytes.into_inner(), "a.exr").unwrap();
    assert!(original.parts[0].levels);
    let window = original.parts[0].data_window;
    let edit = ExrEdit { part: 0, window, channels: vec![("Y".into(), vec![3.0; 16].into())] };
    let copy = original.rewritten(&[edit], &[]).unwrap();
    assert_eq!(copy.notices, ["the smaller versions of the image (mip maps) are left out"]);
    let copy = ExrFile::open(copy.bytes, "b.exr").unwrap();
    assert_eq!((copy.parts[0].levels, floats(&copy, 0, "Y")), (false, vec![3.0; 16]));
}
