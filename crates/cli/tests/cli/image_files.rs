//! Layers, parts, views, windows and colour spaces of image files, as `denoise`, `compare` and `info` take them.

use crate::common::{Folder, Said};
use crate::made_exr::{ACES, Made, MadePart};
use dapple_scene::image::{
    Chromaticities, Encoding, ExrFile, ExrPart, Layer, Window, encode_exr, encode_pfm, read_image,
};

pub(crate) const WINDOW: Window = Window { origin: [30, 7], size: [40, 28] };
pub(crate) const DISPLAY: Window = Window { origin: [0, 0], size: [100, 50] };

/// A number in 0 .. 1 for each pixel, channel and seed.
pub(crate) fn noise(x: i32, y: i32, salt: u64) -> f32 {
    let mut bits = (x as u64) << 40 ^ (y as u64) << 20 ^ salt.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for factor in [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb] {
        bits = (bits ^ (bits >> 30)).wrapping_mul(factor);
    }
    ((bits ^ (bits >> 31)) >> 40) as f32 / (1 << 24) as f32
}

/// Stripes of five pixels, of which every fifth is one that another view or layer has bright.
fn truth(x: i32, y: i32, salt: i32) -> f32 {
    if (x.div_euclid(5) + y.div_euclid(7) + salt).rem_euclid(2) == 0 { 0.8 } else { 0.1 }
}

/// A noisy image in R, G, B; the truth in a layer `albedo` or `Albedo`; 0.5 and noise in A; anything else elsewhere.
fn value(salt: i32, seed: u64) -> impl Fn(&str, i32, i32) -> f32 {
    move |name, x, y| {
        let lower = name.to_lowercase();
        let letter =
            lower.rsplit('.').next().unwrap_or_default().len() as u64 + u64::from(lower.as_bytes()[lower.len() - 1]);
        let noise = noise(x, y, seed << 8 | letter);
        match lower.rsplit('.').next() {
            _ if lower.contains("albedo") => truth(x, y, salt),
            _ if lower.contains("other") => noise * 9.0,
            Some("a") => 0.5 + 0.25 * noise,
            _ => truth(x, y, salt) * (0.5 + noise),
        }
    }
}

pub(crate) fn part(name: &str, window: Window, channels: &str, salt: i32, seed: u64) -> MadePart {
    Made::part(name, window, &channels.split(' ').collect::<Vec<_>>(), value(salt, seed))
}

pub(crate) fn file(parts: Vec<MadePart>) -> Made {
    Made { display: DISPLAY, ..Made::of(parts) }
}

pub(crate) fn open(folder: &Folder, name: &str) -> ExrFile<'static> {
    ExrFile::open(folder.read(name), name).unwrap_or_else(|e| panic!("{e}"))
}

pub(crate) fn floats(file: &ExrFile<'_>, part: usize, name: &str) -> Vec<f32> {
    let at = file.parts[part].channels.iter().position(|channel| channel.name == name);
    let at = at.unwrap_or_else(|| panic!("no {name} in {:?}", file.parts[part].channels));
    file.planes(part).expect("planes")[at].floats().into_owned()
}

/// The mean squared error of a channel against the truth at its place in the display.
fn error(file: &ExrFile<'_>, part: usize, name: &str, salt: i32) -> f32 {
    let Window { origin: [x0, y0], size } = file.parts[part].data_window;
    let places = (0..size[1] as i32).flat_map(|y| (0..size[0] as i32).map(move |x| (x0 + x, y0 + y)));
    let errors = floats(file, part, name).into_iter().zip(places).map(|(v, (x, y))| (v - truth(x, y, salt)).powi(2));
    errors.sum::<f32>() / (size[0] * size[1]) as f32
}

/// Saves two renders of these parts, made for each seed.
pub(crate) fn two(folder: &Folder, make: impl Fn(u64) -> Made) {
    for (name, seed) in [("a.exr", 1), ("b.exr", 2)] {
        folder.write(name, make(seed).bytes());
    }
}

pub(crate) fn denoise(folder: &Folder, words: &str) -> Said {
    folder.says(&format!("denoise a.exr b.exr -o out.exr --spp 16 {words}"), 0, &[])
}

/// The header without what an added channel changes.
fn header(part: &ExrPart) -> ExrPart {
    ExrPart { channels: Vec::new(), ..part.clone() }
}

#[test]
fn a_denoised_file_is_its_input_with_denoised_colours() {
    let folder = Folder::new();
    let channels = "A B G R other.B other.G other.R Albedo.B Albedo.G Albedo.R";
    two(&folder, |seed| Made { aspect: 2.0, space: Some(ACES), ..file(vec![part("", WINDOW, channels, 0, seed)]) });
    let said = denoise(&folder, "-o out.png");
    assert!(said.err.contains("out.png: the file has no alpha; write an EXR file as well"), "{}", said.err);
    let [a, b, out] = ["a.exr", "b.exr", "out.exr"].map(|name| open(&folder, name));
    assert_eq!(header(&out.parts[0]), header(&a.parts[0]));
    assert_eq!((out.parts[0].data_window, out.parts[0].display_window), (WINDOW, DISPLAY));
    assert_eq!(out.integers(0), a.integers(0), "attributes of others are kept");
    for name in ["other.R", "other.G", "other.B", "Albedo.R"] {
        assert_eq!(floats(&out, 0, name), floats(&a, 0, name), "{name}");
    }
    let mean: Vec<f32> = floats(&a, 0, "A").iter().zip(floats(&b, 0, "A")).map(|(a, b)| 0.5 * (a + b)).collect();
    assert_eq!(floats(&out, 0, "A"), mean, "alpha is the mean of both files");
    for name in ["R", "G", "B"] {
        assert!(error(&out, 0, name, 0) < 0.1 * error(&a, 0, name, 0), "{name}: {}", error(&out, 0, name, 0));
    }
    assert_eq!(floats(&out, 0, "error.Y").len(), WINDOW.pixels());
}

/// Every place that an image can have, crossed with views, windows and colour spaces.
#[test]
fn images_are_denoised_in_every_layout_view_window_and_space() {
    let folder = Folder::new();
    let layouts: [(&str, [&str; 3], &str); 5] = [
        ("plain", ["R", "G", "B"], "albedo.R albedo.G albedo.B"),
        (
            "layers",
            ["Front.Combined.R", "Front.Combined.G", "Front.Combined.B"],
            "Front.Albedo.R Front.Albedo.G Front.Albedo.B",
        ),
        ("nuke", ["rgba.red", "rgba.green", "rgba.blue"], "albedo.red albedo.green albedo.blue"),
        ("small letters", ["beauty.r", "beauty.g", "beauty.b"], "albedo.r albedo.g albedo.b"),
        ("parts", ["R", "G", "B"], ""),
    ];
    let shifted = Window { origin: [33, 5], size: [40, 28] };
    for (layout, colors, albedo) in layouts {
        for (views, window, space) in
            [(1, WINDOW, None), (1, shifted, Some(ACES)), (2, WINDOW, Some(ACES)), (2, shifted, None)]
        {
            let case = format!("{layout}, {views} views, {window}, {space:?}");
            let make = |seed: u64| {
                let window = if seed == 1 { WINDOW } else { window };
                let parts = (0..views).flat_map(|view| {
                    let name = ["left", "right"][view];
                    let one = |part_name: &str, channels: &str| MadePart {
                        view: (views > 1).then(|| name.to_owned()),
                        ..part(
                            &format!("{part_name}{}", if views > 1 { format!("_{name}") } else { String::new() }),
                            window,
                            channels,
                            view as i32,
                            seed,
                        )
                    };
                    match layout {
                        "parts" => vec![one("rgba", "R G B"), one("albedo", "R G B")],
                        _ if views > 1 => vec![one("main", &format!("{} {albedo}", colors.join(" ")))],
                        _ => vec![part("", window, &format!("{} {albedo}", colors.join(" ")), 0, seed)],
                    }
                });
                Made { space, ..file(parts.collect()) }
            };
            two(&folder, make);
            let said = denoise(&folder, "");
            let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
            let common = WINDOW.common(window).expect("an overlap");
            assert_eq!(
                said.err.contains(&format!("the output is cropped to them: {common}")),
                window != WINDOW,
                "{case}: {}",
                said.err
            );
            assert_eq!(said.out.matches("read color (").count(), views, "{case}: {}", said.out);
            assert_eq!(
                said.out.matches("lbedo").count() / said.out.matches("albedo (").count(),
                2,
                "{case}: {}",
                said.out
            );
            let step = if layout == "parts" { 2 } else { 1 };
            for view in 0..views {
                let part = view * step;
                assert_eq!((out.parts[part].data_window, out.parts[part].display_window), (common, DISPLAY), "{case}");
                assert_eq!(out.parts[part].chromaticities, space, "{case}");
                for name in colors {
                    let [before, after] = [&a, &out].map(|file| error(file, part, name, view as i32));
                    assert!(after < 0.15 * before, "{case}: {after} of {before} in {name} of part {part}");
                }
            }
        }
    }
}

#[test]
fn views_among_the_channels_are_all_denoised_each_by_its_own_guides() {
    let folder = Folder::new();
    two(&folder, |seed| {
        let left = part("", WINDOW, "R G B albedo.R albedo.G albedo.B", 0, seed);
        let right = part("", WINDOW, "right.R right.G right.B albedo.right.R albedo.right.G albedo.right.B", 1, seed);
        let channels = left.channels.into_iter().chain(right.channels).collect();
        Made { views: vec!["left".into(), "right".into()], ..file(vec![MadePart { channels, ..right }]) }
    });
    let said = denoise(&folder, "-o out.png");
    assert!(
        said.out.starts_with("read color (R, G, B), albedo (albedo)\nread color (right), albedo (albedo.right)\n"),
        "{}",
        said.out
    );
    assert!(said.err.contains("out.png: the file holds only view \"left\"; write an EXR file as well"), "{}", said.err);
    let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
    assert_eq!(out.parts[0].views, ["left", "right"]);
    for (name, salt) in [("R", 0), ("right.R", 1)] {
        assert!(error(&out, 0, name, salt) < 0.1 * error(&a, 0, name, salt), "{name}");
    }
    assert_ne!(floats(&out, 0, "error.Y"), floats(&out, 0, "error.right.Y"));
    let said = denoise(&folder, "--layer color=right --json");
    let json: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!((&json["layers"]["color"], &json["layers"]["albedo"]), (&"right".into(), &"albedo.right".into()));
    assert!(said.err.contains("a.exr: layer \"R, G, B\" is not denoised"), "{}", said.err);
    assert_eq!(floats(&open(&folder, "out.exr"), 0, "R"), floats(&a, 0, "R"));
}

#[test]
fn guides_of_another_view_layer_are_never_read() {
    let folder = Folder::new();
    let combined = "Front.Combined.R Front.Combined.G Front.Combined.B Back.Combined.R Back.Combined.G Back.Combined.B";
    let back = "Back.Albedo.R Back.Albedo.G Back.Albedo.B";
    two(&folder, |seed| file(vec![part("", WINDOW, &format!("{combined} {back}"), 0, seed)]));
    let message =
        "a.exr: the file holds several images, Back.Combined, Front.Combined; choose one with --layer color=NAME";
    folder.says("denoise a.exr b.exr -o out.exr", 1, &[message]);
    assert!(denoise(&folder, "--layer color=Front.Combined").out.starts_with("read color (Front.Combined)\n"));
    let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
    assert_eq!(floats(&out, 0, "Back.Combined.R"), floats(&a, 0, "Back.Combined.R"));
    assert_ne!(floats(&out, 0, "Front.Combined.R"), floats(&a, 0, "Front.Combined.R"));
    let said = denoise(&folder, "--layer color=Back.Combined");
    assert!(said.out.starts_with("read color (Back.Combined), albedo (Back.Albedo)\n"), "{}", said.out);
}

#[test]
fn an_empty_composite_does_not_win_over_a_view_layer() {
    let folder = Folder::new();
    let composite = ["Composite.Combined.R", "Composite.Combined.G", "Composite.Combined.B"];
    two(&folder, |seed| {
        let mut made = part("", WINDOW, "Layer.Combined.R Layer.Combined.G Layer.Combined.B", 0, seed);
        made.channels.extend(composite.map(|name| (name.to_owned(), vec![0.0; WINDOW.pixels()])));
        file(vec![made])
    });
    let said = denoise(&folder, "");
    assert!(said.out.starts_with("read color (Layer.Combined)\n"), "{}", said.out);
    let said = folder.says("compare out.exr a.exr --json", 0, &["layer \"Composite.Combined\" is 0 everywhere"]);
    assert!(serde_json::from_str::<serde_json::Value>(&said.out).expect("JSON")["mse"].as_f64() > Some(0.001));
}

#[test]
fn pixels_of_parts_are_paired_in_the_display() {
    let folder = Folder::new();
    let right = Window { origin: [40, 7], size: [40, 28] };
    let make = |albedo: Window| {
        move |seed| file(vec![part("rgba", WINDOW, "R G B", 0, seed), part("albedo", albedo, "R G B", 0, seed)])
    };
    two(&folder, make(right));
    let said = denoise(&folder, "");
    assert!(
        said.err.contains("rgba of a.exr has pixels (30,7)-(69,34), albedo of a.exr (40,7)-(79,34)"),
        "{}",
        said.err
    );
    let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
    assert_eq!(
        (out.parts[0].data_window, out.parts[1].data_window),
        (WINDOW.common(right).expect("an overlap"), right)
    );
    assert!(error(&out, 0, "R", 0) < 0.1 * error(&a, 0, "R", 0), "{}", error(&out, 0, "R", 0));
    assert_eq!(floats(&out, 1, "R"), floats(&a, 1, "R"));
    two(&folder, make(Window { origin: [70, 7], size: [30, 28] }));
    let message = "the data windows do not overlap: layer \"rgba\" of a.exr covers pixels (30,7)-(69,34), layer \"albedo\" of a.exr covers pixels (70,7)-(99,34)";
    folder.says("denoise a.exr b.exr -o none.exr", 1, &[message]);
}

#[test]
fn files_of_other_colour_spaces_are_refused_and_flat_outputs_converted() {
    let folder = Folder::new();
    let flat =
        |space: Option<Chromaticities>| move |seed| Made { space, ..file(vec![part("", WINDOW, "R G B", 0, seed)]) };
    two(&folder, flat(Some(ACES)));
    denoise(&folder, "-o out.pfm -o out.png");
    assert_eq!(open(&folder, "out.exr").parts[0].chromaticities, Some(ACES));
    // The reader converts EXR; a PFM file has no attribute, so it has to be converted already.
    let [exr, pfm] =
        ["out.exr", "out.pfm"].map(|name| read_image(&folder.read(name), name, Encoding::Auto).expect(name));
    assert_eq!(exr.pixels, pfm.pixels);
    assert_ne!(exr.pixels[0][0], floats(&open(&folder, "out.exr"), 0, "R")[0]);
    folder.write("b.exr", flat(None)(2).bytes());
    let parts =
        ["b.exr: the image is in colour space red (0.64, 0.33)", "a.exr is in red (0.713, 0.293)", "convert one"];
    folder.says("denoise a.exr b.exr -o none.exr", 1, &parts);
    folder.write("a.exr", flat(Some(Chromaticities::REC709))(1).bytes());
    denoise(&folder, "");
}

#[test]
fn one_channel_stands_for_three_where_the_meaning_is_plain() {
    let folder = Folder::new();
    let layer = |name: &str, letters: &[&'static str], of: &dyn Fn(i32) -> f32| Layer {
        name: name.into(),
        channels: letters.iter().map(|letter| (*letter, (0..200).map(of).collect::<Vec<f32>>().into())).collect(),
    };
    let color = |i: i32| 0.5 + noise(i, 0, 5);
    let variance = |i: i32| 0.5 + 0.1 * (i % 7) as f32;
    let write = |layers: &[Layer<'_>]| folder.write("in.exr", encode_exr([20, 10], layers, &[]).expect("EXR").bytes);
    let rgb: &[&str] = &["R", "G", "B"];
    let denoised = |words: &str| {
        folder.done(&format!("denoise in.exr -o out.exr --spp 16 {words}"));
        read_image(&folder.read("out.exr"), "out.exr", Encoding::Auto).expect("an image").pixels
    };
    write(&[layer("", rgb, &color), layer("variance", rgb, &variance)]);
    let three = denoised("");
    for scalar in [
        layer("variance", &["V"], &variance),
        layer("variance", &["Y"], &variance),
        layer("", &["variance"], &variance),
    ] {
        write(&[layer("", rgb, &color), scalar]);
        assert_eq!(denoised(""), three);
        assert_eq!(denoised("--layer variance=variance"), three);
    }
    write(&[layer("", &["Y"], &color), layer("variance", &["Y"], &variance)]);
    let grey = denoised("");
    assert!(grey.iter().zip(&three).all(|(grey, three)| (grey[0] - three[0]).abs() < 1e-5), "a grey image");
    assert_eq!(floats(&open(&folder, "out.exr"), 0, "Y").len(), 200);
    // No message names as missing what is there.
    write(&[layer("", &["R", "G", "B", "Z"], &color), layer("variance", &["X", "Y"], &variance)]);
    let message = "layer \"variance\" has the channels X, Y, but layers of the kind variance have R, G, B";
    folder.says("denoise in.exr -o none.exr --spp 16", 1, &[message]);
    let message = "layer \"z\" has the channels Z, but layers of the kind normal have X, Y, Z or R, G, B";
    folder.says("denoise in.exr in.exr -o none.exr --layer normal=z", 1, &[message]);
    write(&[layer("color", &["c", "m", "k"], &color)]);
    let message = "layer \"color\" has the channels C, K, M, but layers of the kind color have R, G, B";
    folder.says("denoise in.exr -o none.exr --layer color=color", 1, &[message]);
    folder.says("denoise in.exr -o none.exr", 1, &["no image was found among the channels color.c, color.k, color.m"]);
}

#[test]
fn comparisons_find_the_image_pair_its_pixels_and_convert_its_colours() {
    let folder = Folder::new();
    let mse = |words: &str, parts: &[&str]| {
        let said = folder.says(&format!("compare {words} --json"), 0, parts);
        serde_json::from_str::<serde_json::Value>(&said.out).expect("JSON")["mse"].as_f64().expect("a number")
    };
    // The layer `beauty`, not `AO`, the first by its name.
    let layered = "AO.R AO.G AO.B beauty.R beauty.G beauty.B";
    folder.write("a.exr", file(vec![part("", WINDOW, layered, 0, 1)]).bytes());
    folder.write("plain.exr", file(vec![part("", WINDOW, "R G B", 0, 1)]).bytes());
    assert_eq!(mse("a.exr plain.exr", &[]), 0.0);
    // Other windows of one display.
    let shifted = Window { origin: [33, 5], size: [40, 28] };
    folder.write("shifted.exr", file(vec![part("", shifted, "R G B", 0, 1)]).bytes());
    let cut = "a.exr has pixels (30,7)-(69,34), shifted.exr has (33,5)-(72,32); only the common pixels (33,7)-(69,32) are compared";
    assert_eq!(mse("a.exr shifted.exr", &[cut]), 0.0);
    folder.write("apart.exr", file(vec![part("", Window { origin: [80, 7], ..WINDOW }, "R G B", 0, 1)]).bytes());
    folder.says("compare a.exr apart.exr", 1, &["and apart.exr (pixels (80,7)-(119,34)) have no pixel in common"]);
    // A file without windows is the data window, if it has its size.
    let image = read_image(&folder.read("plain.exr"), "plain.exr", Encoding::Auto).expect("an image");
    folder.write("plain.pfm", encode_pfm(&image).expect("PFM"));
    assert_eq!((mse("plain.pfm a.exr", &[]), mse("a.exr plain.pfm", &[])), (0.0, 0.0));
    // Colours of ACEScg and the same in Rec. 709.
    folder.write("aces.exr", Made { space: Some(ACES), ..file(vec![part("", WINDOW, "R G B", 0, 1)]) }.bytes());
    let image = read_image(&folder.read("aces.exr"), "aces.exr", Encoding::Auto).expect("an image");
    folder.write("rec709.exr", encode_exr([40, 28], &[Layer::of_image("", &image)], &[]).expect("EXR").bytes);
    assert_eq!(mse("aces.exr aces.exr", &[]), 0.0);
    assert!(mse("aces.exr plain.exr", &[]) > 0.001, "the same numbers in another space");
    // Several images.
    folder.write("two.exr", file(vec![part("", WINDOW, "AO.R AO.G AO.B diffuse.R diffuse.G diffuse.B", 0, 1)]).bytes());
    let message = "two.exr: several layers may be the image: AO, diffuse; save the right one as channels R, G and B without a layer name, or choose one with --layer NAME";
    folder.says("compare two.exr plain.exr", 1, &[message]);
    assert_eq!(mse("two.exr two.exr --layer AO", &[]), 0.0);
    folder.says(
        "compare two.exr plain.exr --layer A0",
        1,
        &["two.exr: no layer \"A0\" holds an image; choose among AO, diffuse"],
    );
}

#[test]
fn images_of_one_eye_are_never_paired_with_those_of_the_other() {
    let folder = Folder::new();
    let stereo = |eyes: [&str; 2], seed: u64| {
        let salt = |eye: &str| i32::from(eye == "right");
        let first = part("", WINDOW, "R G B", salt(eyes[0]), seed);
        let second =
            part("", WINDOW, &["R", "G", "B"].map(|c| format!("{}.{c}", eyes[1])).join(" "), salt(eyes[1]), seed);
        let channels = first.channels.into_iter().chain(second.channels).collect();
        Made { views: eyes.map(str::to_owned).into(), ..file(vec![MadePart { channels, ..second }]) }
    };
    folder.write("a.exr", stereo(["left", "right"], 1).bytes());
    folder.write("b.exr", stereo(["right", "left"], 2).bytes());
    let said = denoise(&folder, "");
    assert!(
        said.out.starts_with("read color (R, G, B), color (left)\nread color (R, G, B), color (right)\n"),
        "{}",
        said.out
    );
    let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
    for (name, salt) in [("R", 0), ("right.R", 1)] {
        assert!(error(&out, 0, name, salt) < 0.3 * error(&a, 0, name, salt), "{name}");
    }
    folder.write("c.exr", stereo(["right", "left"], 1).bytes());
    let said =
        folder.says("compare a.exr c.exr --json", 0, &["c.exr: view \"left\" is read; not read: view \"right\""]);
    assert_eq!(serde_json::from_str::<serde_json::Value>(&said.out).expect("JSON")["mse"].as_f64(), Some(0.0));
    for (name, eye) in [("a.exr", "left"), ("b.exr", "right")] {
        let parts = vec![MadePart { view: Some(eye.into()), ..part("main", WINDOW, "R G B", 0, 1) }];
        folder.write(name, file(parts).bytes());
    }
    let message = "b.exr: the image shows view \"right\", but a.exr shows view \"left\"";
    folder.says("denoise a.exr b.exr -o none.exr", 1, &[message]);
    folder.says("compare a.exr b.exr", 1, &["a.exr shows view \"left\", but b.exr shows view \"right\""]);
}

#[test]
fn comparisons_refuse_windows_of_displays_of_other_sizes() {
    let folder = Folder::new();
    let own = Made::of(vec![part("", Window { origin: [0, 0], ..WINDOW }, "R G B", 0, 1)]);
    folder.write("own.exr", own.bytes());
    folder.write("part.exr", file(vec![part("", WINDOW, "R G B", 0, 1)]).bytes());
    let message = "own.exr has pixels (0,0)-(39,27) of display window (0,0)-(39,27), but part.exr has pixels (30,7)-(69,34) of display window (0,0)-(99,49)";
    folder.says("compare own.exr part.exr", 1, &[message]);
}

#[test]
fn other_images_of_a_view_layer_are_named_and_stand_in_for_an_empty_one() {
    let folder = Folder::new();
    two(&folder, |seed| file(vec![part("", WINDOW, "rgba.R rgba.G rgba.B beauty.R beauty.G beauty.B", 0, seed)]));
    let said = denoise(&folder, "");
    assert!(said.err.contains("a.exr: \"rgba\" is denoised, \"beauty\" is not"), "{}", said.err);
    two(&folder, |seed| {
        let mut made = part("", WINDOW, "beauty.R beauty.G beauty.B", 0, seed);
        made.channels.extend(["R", "G", "B"].map(|name| (name.to_owned(), vec![0.0; WINDOW.pixels()])));
        file(vec![made])
    });
    let said = denoise(&folder, "");
    assert!(said.err.contains("a.exr: layer \"R, G, B\" is 0 everywhere; \"beauty\" is denoised"), "{}", said.err);
    assert!(said.out.starts_with("read color (beauty)\n"), "{}", said.out);
    folder.says("compare a.exr b.exr", 0, &["b.exr: layer \"R, G, B\" is 0 everywhere; layer \"beauty\" is read"]);
}

#[test]
fn info_shows_what_an_image_holds() {
    let folder = Folder::new();
    let parts = vec![
        MadePart { view: Some("left".into()), ..part("rgba", WINDOW, "R G B A light.R light.G light.B", 0, 1) },
        part("depth", Window { origin: [0, 0], size: [3, 2] }, "Z", 0, 1),
    ];
    let made = Made { aspect: 2.0, space: Some(ACES), ..file(parts) };
    folder.write("a.exr", made.bytes());
    let expected = "image       OpenEXR\n\
        parts       2\n\
        part 0      \"rgba\"\n\
        views       left\n\
        size        40x28\n\
        data        (30,7)-(69,34)\n\
        display     (0,0)-(99,49)\n\
        aspect      2 (width of a pixel divided by its height)\n\
        colours     red (0.713, 0.293), green (0.165, 0.83), blue (0.128, 0.044), white (0.32168, 0.33767)\n\
        compression zip block, scan lines\n\
        channels    A, B, G, R (float)\n\
        channels    light: B, G, R (float)\n\
        part 1      \"depth\"\n\
        size        3x2\n";
    let info = folder.done("info a.exr");
    assert!(info.starts_with(expected), "{info}");
    folder.write("b.exr", Made { half: true, space: None, ..file(vec![part("", WINDOW, "Y", 0, 1)]) }.bytes());
    let info = folder.done("info b.exr");
    assert!(info.contains("channels    Y (half)\n") && info.contains("colours     Rec. 709 (the file"), "{info}");
    folder.done("render tiny.pbrt --spp 1 -o c.png -o c.pfm");
    assert_eq!(folder.done("info c.png"), "image       PNG, 24x16\nchannels    R, G, B (8 bits)\n");
    assert_eq!(folder.done("info c.pfm"), "image       PFM, 24x16\nchannels    R, G, B (float)\n");
    folder.write("c.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n");
    assert_eq!(
        folder.done("info c.hdr"),
        "image       Radiance HDR, 3x2\nchannels    R, G, B (8 bits and a common exponent)\n"
    );
    folder.write("cut.png", &folder.read("c.png")[..40]);
    folder.says("info cut.png", 1, &["cut.png: the PNG file ends at byte 40"]);
}
