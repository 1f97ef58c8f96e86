//! `dapple denoise` on files in the naming styles of several renderers.

use crate::common::Folder;
use dapple_scene::image::{Encoding, Layer, encode_exr, read_channels, read_image};

const SIZE: [u32; 2] = [40, 24];
const PIXELS: usize = 40 * 24;
const SPP: u32 = 8;

/// A number in 0 .. 1 for each pixel, sample and seed.
fn noise(pixel: usize, sample: u32, seed: u64) -> f32 {
    let mut x = (pixel as u64) << 32 ^ u64::from(sample) << 20 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for factor in [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb] {
        x = (x ^ (x >> 30)).wrapping_mul(factor);
    }
    ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
}

fn truth(pixel: usize) -> f32 {
    if pixel % 40 < 20 { 0.4 } else { 0.1 }
}

/// The mean, the sample variance and the second moment of each pixel.
fn samples(seed: u64) -> [Vec<f32>; 3] {
    let mut planes = [(); 3].map(|()| Vec::new());
    for pixel in 0..PIXELS {
        let values: Vec<f32> = (0..SPP).map(|s| truth(pixel) * 2.0 * noise(pixel, s, seed)).collect();
        let mean = values.iter().sum::<f32>() / SPP as f32;
        let m2 = values.iter().map(|v| v * v).sum::<f32>() / SPP as f32;
        let variance = (m2 - mean * mean) * SPP as f32 / (SPP - 1) as f32;
        for (plane, value) in planes.iter_mut().zip([mean, variance, m2]) {
            plane.push(value);
        }
    }
    planes
}

/// A layer of three channels with these letters.
fn three(name: &str, letters: [&'static str; 3], of: impl Fn(usize, usize) -> f32) -> Layer<'static> {
    let channel = |c: usize| (letters[c], (0..PIXELS).map(|i| of(i, c)).collect::<Vec<f32>>().into());
    Layer { name: name.into(), channels: vec![channel(0), channel(1), channel(2)] }
}

fn one(name: &str, letter: &'static str, of: impl Fn(usize) -> f32) -> Layer<'static> {
    Layer { name: name.into(), channels: vec![(letter, (0..PIXELS).map(of).collect::<Vec<f32>>().into())] }
}

const RGB: [&str; 3] = ["R", "G", "B"];
const XYZ: [&str; 3] = ["X", "Y", "Z"];

fn normal(i: usize, c: usize) -> f32 {
    if c == usize::from(i % 40 < 20) { 1.0 } else { 0.0 }
}

/// The mean and the second moment of a noisy normal, whose noise has this standard deviation.
fn noisy_normal(deviation: f32) -> [Vec<[f32; 3]>; 2] {
    let of =
        |i: usize, c: usize, s: u32| normal(i, c) + deviation * (noise(i, 9 * s + c as u32, 77) - 0.5) * 12f32.sqrt();
    let mean =
        |i: usize, power: i32| [0, 1, 2].map(|c| (0..SPP).map(|s| of(i, c, s).powi(power)).sum::<f32>() / SPP as f32);
    [1, 2].map(|power| (0..PIXELS).map(|i| mean(i, power)).collect())
}

fn save(folder: &Folder, name: &str, layers: &[Layer<'_>], attributes: &[(&str, &str)]) {
    let attributes: Vec<_> = attributes.iter().map(|&(k, v)| (k.to_owned(), v.to_owned())).collect();
    folder.write(name, encode_exr(SIZE, layers, &attributes).expect("encoded").bytes);
}

/// The mean squared error of red.
fn error(folder: &Folder, name: &str) -> f32 {
    let image = read_image(&folder.read(name), name, Encoding::Auto).expect("an image");
    (0..PIXELS).map(|i| (image.pixels[i][0] - truth(i)).powi(2)).sum::<f32>() / PIXELS as f32
}

/// The layers of pbrt-v4's film "gbuffer".
fn pbrt() -> Vec<Layer<'static>> {
    let [mean, variance, _] = samples(1);
    vec![
        three("", RGB, |i, _| mean[i]),
        three("Albedo", RGB, |i, _| truth(i)),
        three("P", XYZ, |i, c| [(i % 40) as f32, (i / 40) as f32, 50.0][c]),
        three("N", XYZ, normal),
        three("Ns", XYZ, normal),
        three("Variance", RGB, |i, _| variance[i]),
        three("RelativeVariance", RGB, |_, _| 1e9),
    ]
}

#[test]
fn a_gbuffer_of_pbrt_is_denoised_with_all_its_layers() {
    let folder = Folder::new();
    save(&folder, "in.exr", &pbrt(), &[]);
    let said = folder.run("denoise in.exr -o out.exr -o out.png --spp 8");
    assert_eq!((said.status, said.err.as_str()), (Some(0), ""), "{}", said.out);
    let read = "read color (R, G, B), variance (Variance), normal (Ns), albedo (Albedo), position (P)\n";
    assert!(said.out.starts_with(read), "{}", said.out);
    assert!(said.out.contains("out.exr: the image") && said.out.contains("out.png: the image, sRGB"), "{}", said.out);
    assert!(error(&folder, "out.exr") < 0.1 * error(&folder, "in.exr"));
    let [mut expected, names] = ["in.exr", "out.exr"].map(|name| {
        let file = read_channels(&folder.read(name), name).expect("channels");
        file.channels.into_iter().map(|(name, _)| name).collect::<Vec<_>>()
    });
    expected.push("error.Y".into());
    assert_eq!(names, expected);
    assert_eq!(folder.names(), ["in.exr", "out.exr", "out.png"], "no other file is left");
}

#[test]
fn layers_of_other_renderers_are_found() {
    let folder = Folder::new();
    let [mean, variance, m2] = samples(1);
    let of_mean = |i: usize| variance[i] / SPP as f32;
    let cases: [(&str, Vec<Layer<'_>>, &str, &str); 5] = [
        (
            "arnold",
            vec![
                three("RGBA", RGB, |i, _| mean[i]),
                three("variance", RGB, |i, _| variance[i]),
                three("N", XYZ, normal),
                three("denoise_albedo", RGB, |i, _| truth(i)),
                one("", "Z", |_| 7.0),
            ],
            "--spp 8",
            "color (RGBA), variance (variance), normal (N), albedo (denoise_albedo), depth (Z)",
        ),
        (
            "renderman",
            vec![three("", RGB, |i, _| mean[i]), three("mse", RGB, |i, _| of_mean(i)), three("N", RGB, normal)],
            "",
            "color (R, G, B), variance-of-mean (mse), normal (N)",
        ),
        (
            "mitsuba",
            vec![
                three("", RGB, |i, _| mean[i]),
                three("img", XYZ, |i, _| mean[i]),
                three("m2_img", XYZ, |i, _| m2[i]),
                three("img.sh_normal", XYZ, normal),
                three("m2_img.sh_normal", XYZ, |_, _| 1.0),
                one("img.dd", "T", |_| 3.0),
                one("m2_img.dd", "T", |_| 9.0),
            ],
            "--spp 8",
            "color (R, G, B), second-moment (m2_img), normal (img.sh_normal), depth (img.dd)",
        ),
        (
            "own names",
            vec![
                three("", RGB, |i, _| mean[i]),
                three("mine.noise", RGB, |i, _| of_mean(i)),
                three("Facing", XYZ, normal),
            ],
            "--layer variance=mine.noise --layer normal=facing --variance-of-mean",
            "color (R, G, B), variance (mine.noise), normal (Facing)",
        ),
        (
            "old pbrt",
            vec![
                three("", RGB, |i, _| mean[i]),
                three("", ["Nx", "Ny", "Nz"], normal),
                three("Variance", RGB, |i, _| variance[i]),
            ],
            "--spp 8",
            "color (R, G, B), variance (Variance), normal (N)",
        ),
    ];
    for (style, layers, words, read) in cases {
        save(&folder, "in.exr", &layers, &[]);
        let said = folder.says(&format!("denoise in.exr -o out.exr {words}"), 0, &[]);
        assert!(said.out.starts_with(&format!("read {read}\n")), "{style}: {}", said.out);
        let [before, after] = ["in.exr", "out.exr"].map(|name| error(&folder, name));
        assert!(after < 0.15 * before, "{style}: {after} of {before}");
    }
}

/// Mitsuba's integrator `moment` around `aov`: second moments of the image and of its features, in both namings.
#[test]
fn second_moments_of_features_are_their_noise() {
    let folder = Folder::new();
    let ([mean, _, m2], [n, n2]) = (samples(1), noisy_normal(0.5));
    for (style, image, squares) in [("own", "nested", "m2_nested"), ("within", "img.nested", "img.m2_nested")] {
        let layers = |normals: &str, squares_of_normals: &str| {
            let mut layers = vec![
                three("", RGB, |i, _| mean[i]),
                three(image, XYZ, |i, _| mean[i]),
                three(squares, XYZ, |i, _| m2[i]),
                three(normals, XYZ, |i, c| n[i][c]),
            ];
            if !squares_of_normals.is_empty() {
                layers.push(three(squares_of_normals, XYZ, |i, c| n2[i][c]));
            }
            layers
        };
        save(&folder, "without.exr", &layers("nested.nn", ""), &[]);
        save(&folder, "with.exr", &layers("nested.nn", "m2_nested.nn"), &[]);
        let errors = |filter: &str| {
            ["without", "with"].map(|name| {
                let said = folder.run(&format!("denoise {name}.exr -o out.exr --spp 8 --filter {filter}"));
                let read = format!("read color (R, G, B), second-moment ({squares}), normal (nested.nn)\n");
                assert!(said.status == Some(0) && said.out.starts_with(&read), "{style}: {} {}", said.out, said.err);
                error(&folder, "out.exr")
            })
        };
        // The network averages over what the regressions left.
        for (filter, most) in
            [("cluster-regression:outside=1,network=false", 0.8), ("cluster-regression:outside=1", 0.9)]
        {
            let [without, with] = errors(filter);
            assert!(with < most * without, "{style}, {filter}: {with}, {without} without");
        }
    }
}

/// Cycles: no variance, so two renders; counts are shares of the header's number of samples.
#[test]
fn two_renders_of_cycles_are_halves() {
    let folder = Folder::new();
    for seed in [1, 2] {
        let [mean, ..] = samples(seed);
        let layers = [
            three("ViewLayer.Combined", RGB, |_, _| 99.0),
            three("ViewLayer.Noisy Image", RGB, |i, _| mean[i]),
            three("ViewLayer.Denoising Normal", XYZ, normal),
            three("ViewLayer.Denoising Albedo", RGB, |i, _| truth(i)),
            one("ViewLayer.Denoising Depth", "Z", |i| 5.0 + 0.001 * noise(i, 0, seed)),
            one("ViewLayer.Debug Sample Count", "X", |_| 1.0),
        ];
        save(&folder, &format!("{seed}.exr"), &layers, &[("cycles.ViewLayer.samples", "8")]);
    }
    let json = folder.done("denoise 1.exr 2.exr -o out.exr --json");
    let json: serde_json::Value = serde_json::from_str(&json).expect("one line of JSON");
    assert_eq!(json["layers"]["color"], "ViewLayer.Noisy Image");
    assert_eq!(json["layers"]["count"], "ViewLayer.Debug Sample Count");
    assert_eq!(json["layers"]["depth"], "ViewLayer.Denoising Depth");
    assert_eq!(json["notices"], serde_json::json!([]));
    assert!(error(&folder, "out.exr") < 0.01, "{}", error(&folder, "out.exr"));
    folder.says("denoise 1.exr -o alone.exr", 1, &["there is no variance"]);
    let said = folder.run("denoise 1.exr 1.exr -o alone.exr");
    assert!(
        said.err.contains("the image is identical to that of 1.exr") && said.err.contains("different seeds"),
        "{}",
        said.err
    );
}

#[test]
fn a_render_of_ours_is_denoised_from_its_own_layers() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --spp 8 --sampler uniform --filter none -o tiny.exr");
    let said = folder.says("denoise tiny.exr -o out.exr --filter nlm", 0, &[]);
    assert!(said.out.starts_with("read color (R, G, B), variance (variance), count (count)"), "{}", said.out);
    assert!(said.err.contains("no layer was found for normal or albedo or position"), "{}", said.err);
}

#[test]
fn broken_pixels_are_filled_with_a_warning() {
    let folder = Folder::new();
    let mut layers = pbrt();
    for (_, plane) in &mut layers[0].channels {
        let dapple_scene::image::Plane::F32(values) = plane else { panic!("floats") };
        values.to_mut()[123] = f32::NAN;
    }
    save(&folder, "in.exr", &layers, &[]);
    let said = folder.run("denoise in.exr -o out.exr --spp 8");
    assert!(said.err.contains("in.exr: NaN or infinite pixels: 1"), "{}", said.err);
    assert!(error(&folder, "out.exr") < 0.01);
}

#[test]
fn what_cannot_be_denoised_is_refused_with_advice() {
    let folder = Folder::new();
    save(&folder, "in.exr", &pbrt(), &[]);
    save(&folder, "plain.exr", &pbrt()[..5], &[]);
    save(&folder, "data.exr", &pbrt()[4..], &[]);
    let small = Layer { name: String::new(), channels: RGB.map(|c| (c, vec![1.0_f32; 6].into())).into() };
    folder.write("small.exr", encode_exr([3, 2], &[small], &[]).unwrap().bytes);
    let before = folder.read("in.exr");
    folder.write("a.png", b"\x89PNG");
    let cases: [(&str, i32, &[&str]); 15] = [
        ("a.png -o out.exr", 1, &["a.png: this is not an OpenEXR file", "save the image as OpenEXR"]),
        ("in.exr -o out.exr", 1, &["in.exr: layer \"Variance\"", "--spp N", "--variance-of-mean"]),
        (
            "plain.exr -o out.exr",
            1,
            &["plain.exr: there is no variance", "another seed", "among the layers Albedo, B, G, R, N, Ns, P"],
        ),
        ("data.exr -o out.exr", 1, &["no image was found", "--layer color=NAME"]),
        ("in.exr -o out.exr --spp 8 --layer normal=Nss", 1, &["no layer \"Nss\" for normal", "did you mean \"Ns\"?"]),
        (
            "in.exr -o out.exr --layer normals=Ns",
            2,
            &["unknown kind of layer \"normals\"", "choose among color, variance"],
        ),
        ("in.exr -o out.exr --layer Ns", 2, &["\"Ns\" is not of the form KIND=NAME"]),
        ("in.exr small.exr -o out.exr", 1, &["small.exr: the image has 3x2 pixels, but in.exr has 40x24"]),
        ("in.exr -o in.exr --spp 8", 1, &["in.exr: this output is also an input; choose another name"]),
        ("in.exr -o ./in.exr --spp 8", 1, &["this output is also an input"]),
        (
            "in.exr -o a.png -o ./a.png --spp 8",
            1,
            &["./a.png: this output is the same file as a.png; give each output"],
        ),
        ("in.exr -o out.jpg --spp 8", 1, &["give the output the extension .exr, .pfm or .png"]),
        ("nonesuch.exr -o out.exr", 1, &["nonesuch.exr: cannot read the file", "check the name"]),
        ("in.exr -o out.exr --filter nonesuch", 2, &["there is no filter \"nonesuch\""]),
        (
            "in.exr -o out.exr --spp 8 --filter bilateral:outside=0.5",
            1,
            &["needs the clusters of a scene", "outside=1"],
        ),
    ];
    for (words, status, parts) in cases {
        folder.says(&format!("denoise {words}"), status, parts);
    }
    assert!(!folder.names().iter().any(|name| name.starts_with("out")), "{:?}", folder.names());
    assert_eq!(folder.read("in.exr"), before);
}
