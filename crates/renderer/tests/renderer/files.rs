//! Third-party files: scenes compared with pbrt-v4's images (`shared/references`, `-rgb`: half the size, same depth and box
//! filter), single models, and unusual images in every position of a scene file.
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_job::registry::{self, MethodInputs, PointSettings};
use dapple_metrics::{Pixels, block_ratios, compare};
use dapple_scene::image::{Encoding, read_image};
use dapple_scene::pbrt::{ReadOptions, read_scene, read_scene_from};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

fn shared_scenes() -> PathBuf {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes"));
    std::env::var_os("DAPPLE_SCENES").map_or(beside, PathBuf::from)
}

/// A scene with its reference. Noise is estimated from renders with different seeds; the reference's noise is from its README.
struct Case {
    scene: Scene,
    reference: Image,
    /// The relative standard error of the reference's mean.
    noise: f64,
    /// The tolerance of means.
    bound: f64,
}

/// Returns an image of half the width and height, by a box filter.
fn halved(image: &Image) -> Image {
    let [w, h] = image.size.map(|n| n / 2);
    let at = |x: u32, y: u32| Vec3::from(image.pixels[(y * 2 * w + x) as usize]);
    let mean = |x: u32, y: u32| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
    let pixels = (0..w * h).map(|i| mean(i % w * 2, i / w * 2).to_array()).collect();
    Image::new([w, h], pixels).expect("as many as its size")
}

/// The name of each scene, the noise of the reference's mean, and the tolerance of the mean.
const CASES: [(&str, f64, f64); 3] = [("cornell-box", 1e-4, 5e-3), ("veach-mis", 2.1e-3, 1e-2), ("teapot", 4e-4, 5e-3)];

fn case(&(name, noise, bound): &(&str, f64, f64)) -> Option<Case> {
    let file = shared_scenes().join(format!("pbrt-v4/{name}/scene-v4.pbrt"));
    let image = shared_scenes().join(format!("../references/{name}-rgb.exr"));
    if let Some(missing) = [&file, &image].into_iter().find(|p| !p.exists()) {
        eprintln!("skipped: {} is not there", missing.display());
        return None;
    }
    let mut scene = read_scene(&file, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let bytes = std::fs::read(&image).expect("it is there");
    let reference = halved(&read_image(&bytes, name, Encoding::Auto).unwrap_or_else(|e| panic!("{e}")));
    name.clone_into(&mut scene.name);
    (scene.film.resolution, scene.film.pixel_filter) = (reference.size, PixelFilter::default());
    Some(Case { scene, reference, noise, bound })
}

/// The ratio of means per channel, its standard error, and the 5, 50 and 95 % quantiles of the ratios of 5x5 blocks.
struct MeasuredRatio {
    ratio: [f64; 3],
    error: [f64; 3],
    percentiles: [[f64; 3]; 3],
}

fn render(case: &Case, replicates: u64, spp: u64) -> MeasuredRatio {
    let (world, size) = (world(&case.scene), case.reference.size);
    let films: Vec<Film> = (0..replicates).map(|seed| film_of(&world, size, spp, Sobol::new(500 + seed))).collect();
    assert!(films.iter().all(|f| f.record().rejected == 0), "{}", case.scene.name);
    let pixel = |i: usize| {
        let sum = films.iter().fold([0.0; 3], |s: [f64; 3], f| std::array::from_fn(|c| s[c] + f.mean(i)[c]));
        sum.map(|x| (x / replicates as f64) as f32)
    };
    let pixels: Vec<[f32; 3]> = (0..films[0].frame().pixels()).map(pixel).collect();
    let [ours, theirs] = [&pixels, &case.reference.pixels].map(|p| Pixels::new(size, p).expect("as many as its size"));
    let error = |c: usize| {
        let means: Mean = films.iter().map(|f| mean(f)[c]).collect();
        (means.standard_error() / means.mean).hypot(case.noise)
    };
    let blocks = block_ratios(ours, theirs, [5, 5]).expect("blocks fit");
    let found = MeasuredRatio {
        ratio: compare(ours, theirs).expect("of one size").channel_ratios,
        error: [0, 1, 2].map(error),
        percentiles: [5.0, 50.0, 95.0].map(|p| blocks.percentile(p)),
    };
    eprintln!("{}, {replicates} x {spp} spp: means {:.4?} +- {:.4?}", case.scene.name, found.ratio, found.error);
    eprintln!("  blocks: {:.4?}", found.percentiles);
    found
}

/// No deviation exceeds the sum of tolerance and noise, at a level of 1e-6, so that a failure with few samples is a bug.
/// Negative control: lamps brighter by 6 % are detected even with few samples.
#[test]
fn references_are_not_refuted() {
    let refuted = |case: &Case, found: &MeasuredRatio| {
        // 5 degrees of freedom and non-normal noise: twice the quantile of the normal distribution.
        let z = 2.0 * critical(sidak(FAMILY, 9) / 2.0);
        (0..3).any(|c| (found.ratio[c] - 1.0).abs() > case.bound + z * found.error[c])
    };
    for mut case in CASES.iter().filter_map(case) {
        let (found, name) = (render(&case, 6, 1), case.scene.name.clone());
        assert!(!refuted(&case, &found), "{name}: {:?}", found.ratio);
        let medians = found.percentiles[1];
        assert!(medians.iter().all(|m| (m - 1.0).abs() < 0.02), "{name}: the median block is {medians:?} of its own");
        if name == "cornell-box" {
            for emission in case.scene.shapes.iter_mut().filter_map(|shape| shape.emission.as_mut()) {
                emission.radiance = emission.radiance.map(|x| 1.06 * x);
            }
            let found = render(&case, 6, 1);
            assert!(refuted(&case, &found), "{:?}", found.ratio);
        }
    }
}

/// The means lie within the tolerances themselves.
#[test]
#[ignore = "minutes: cargo test --release -p dapple-renderer --test renderer files:: -- --ignored --nocapture"]
fn means_match_pbrt_within_their_tolerances() {
    let mut wrong = Vec::new();
    for case in CASES.iter().filter_map(case) {
        let name = &case.scene.name;
        // The edge of a small lamp of radiance 3040 decides veach-mis' mean: more samples there.
        let found = render(&case, 8, if name == "veach-mis" { 128 } else { 32 });
        for c in 0..3 {
            if found.ratio[c].is_nan() || (found.ratio[c] - 1.0).abs() >= case.bound {
                wrong.push(format!("{name}, channel {c}: means {:.4} +- {:.4}", found.ratio[c], found.error[c]));
            }
            let [low, _, high] = found.percentiles.map(|p| p[c]);
            if name == "teapot" && !(low > 0.98 && high < 1.02) {
                wrong.push(format!("{name}, channel {c}: 90 % of block means lie between {low:.4} and {high:.4}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Models of each format.
const MODELS: [(&str, &str); 3] = [
    ("a/Model.OBJ", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"),
    (
        "m.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ),
    (
        "m.stl",
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
    ),
];

#[test]
fn a_model_alone_can_be_built() {
    for (name, text) in MODELS {
        let files = BTreeMap::from([(PathBuf::from(name), text.as_bytes().to_vec())]);
        small(&read_any_from(&files, name, &AnyOptions::default()).unwrap(), [8, 8]);
    }
}

/// Clusters the world and renders it with counts from clusters and with counts from samples, with and without a filter
/// across clusters. Every pixel is finite, every sample is spent, and the model is visible.
fn check_clustered(name: &str, world: World) {
    let frame = Frame::new(32, 32).unwrap();
    let world = Arc::new(world);
    let mut inputs = MethodInputs::of(world.clone());
    for sampler in ["cluster-thesis", "cluster:policy=keep"] {
        let points = registry::points("sobol", PointSettings { seed: 1, spp: Some(2) }).unwrap();
        let made = registry::sampler(sampler, points, &inputs).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut sampler = made.sampler;
        inputs.clusters = made.clusters.or(inputs.clusters);
        let filter = registry::filter("cluster-gaussian", &inputs).unwrap_or_else(|e| panic!("{name}: {e}")).filter;
        let made = inputs.clusters.as_ref().expect("made by now");
        let used: BTreeSet<u32> = made.labels().iter().copied().collect();
        assert!(used.iter().all(|&label| (label as usize) < made.clusters().len()), "{name}");
        let film = film_in(&world, frame, filter.needs(), &mut *sampler, &Limits::samples(4 * 1024));
        assert_eq!((film.record().samples, film.record().rejected), (4 * 1024, 0), "{name}");
        let filtered = filter.apply(&film).unwrap_or_else(|e| panic!("{name}: {e}"));
        for image in [film.image(), filtered.radiance] {
            assert!(image.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}: not finite");
            // A model stands before a sky of one brightness, and its pixels are darker.
            let levels: BTreeSet<u32> = image.iter().map(|p| p[1].to_bits()).collect();
            assert!(levels.len() > 20, "{name}: {} levels", levels.len());
        }
    }
}

/// Every mesh of `../shared/scenes` is read, built, clustered and rendered, or rejected with the message listed here.
#[test]
fn downloaded_meshes_render_or_are_refused() {
    let mut waiting = vec![shared_scenes().join("meshes")];
    if !waiting[0].is_dir() {
        eprintln!("skipped: {} is not there; set DAPPLE_SCENES", waiting[0].display());
        return;
    }
    let mut paths = BTreeSet::new();
    while let Some(folder) = waiting.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|e| e != "md") {
                paths.insert(path);
            }
        }
    }
    for path in paths {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let is_refused = ["empty.ply", "points_emptyface.ply"].contains(&&*name);
        match read_any(&path, &AnyOptions::default()) {
            Ok(scene) if !is_refused => {
                let world = small(&scene, [16, 16]);
                assert!(world.geometry().triangle_count() > 0);
                check_clustered(&name, world);
            }
            Err(e) if is_refused => {
                let message = e.to_string();
                assert!(message.starts_with(&*path.to_string_lossy()) && message.contains("no triangles"), "{message}");
            }
            outcome => panic!("{name}: {:?}", outcome.err()),
        }
    }
}

/// Returns a PFM file of these pixels.
fn pfm(size: [u32; 2], value: impl Fn(u32) -> f32) -> Vec<u8> {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", size[0], size[1]).into_bytes();
    (0..3 * size[0] * size[1]).for_each(|i| bytes.extend(value(i).to_le_bytes()));
    bytes
}

/// Lines after `WorldBegin` that use the image in different positions, with the kind of the texture.
const PLACES: [(&str, &str, &str); 8] = [
    ("colour", "spectrum", "Material \"diffuse\" \"texture reflectance\" \"t\""),
    ("roughness", "float", "Material \"conductor\" \"texture roughness\" \"t\""),
    ("bump", "float", "Material \"diffuse\" \"texture displacement\" \"t\""),
    ("normal map", "", "Material \"diffuse\" \"string normalmap\" \"p.pfm\""),
    (
        "amount",
        "float",
        "Texture \"m\" \"spectrum\" \"mix\" \"texture amount\" \"t\"\nMaterial \"diffuse\" \"texture reflectance\" \"m\"",
    ),
    ("alpha", "float", "Material \"diffuse\""),
    ("coat", "spectrum", "Material \"coateddiffuse\" \"texture reflectance\" \"t\""),
    ("sky", "", "LightSource \"infinite\" \"string filename\" \"p.pfm\""),
];

fn outcome((place, kind, user): (&str, &str, &str), bytes: &[u8]) -> Result<[f64; 3], String> {
    let alpha = if place == "alpha" { " \"texture alpha\" \"t\"" } else { "" };
    let texture = match kind {
        "" => String::new(),
        kind => format!("Texture \"t\" \"{kind}\" \"imagemap\" \"string filename\" \"p.pfm\"\n"),
    };
    let scene = format!(
        "LookAt 0 2 4  0 0 0  0 1 0\nCamera \"perspective\"\nFilm \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 8\n\
         WorldBegin\nLightSource \"distant\" \"rgb L\" [ 1 1 1 ] \"point3 from\" [ 0 3 3 ]\n{texture}{user}\n\
         Shape \"sphere\"{alpha}\nShape \"bilinearmesh\" \"point3 P\" [ -2 -1 -2  2 -1 -2  -2 -1 2  2 -1 2 ] \
         \"point2 uv\" [ 0 0 1 0 0 1 1 1 ]{alpha}\n"
    );
    let files: &[(&str, &[u8])] = &[("s.pbrt", scene.as_bytes()), ("p.pfm", bytes)];
    let scene = read_scene_from(files, "s.pbrt", &ReadOptions::default()).map_err(|e| e.to_string())?;
    let film = image(&scene, 16, 1);
    assert_eq!(film.record().rejected, 0, "{place}");
    let mean = mean(&film);
    assert!(mean.iter().all(|m| m.is_finite() && *m >= 0.0), "{place}: {mean:?}");
    Ok(mean)
}

/// Images without pixels, of one pixel or with invalid pixels give a finite render, or an error that names the file.
#[test]
fn odd_images_are_read_or_refused_everywhere_i10() {
    for place in PLACES {
        let name = place.0;
        for value in [0.0, 1e-38, 0.5, 1.0] {
            outcome(place, &pfm([1, 1], |_| value)).unwrap_or_else(|e| panic!("{name}, {value}: {e}"));
        }
        for size in [[1, 9], [9, 1]] {
            // A sky is square or twice as wide as high.
            let found = outcome(place, &pfm(size, |i| (i % 5) as f32 * 0.2));
            assert!(found.is_ok() || found.is_err_and(|e| name == "sky" && e.contains("s.pbrt:6")), "{name} {size:?}");
        }
        let refused = |bytes: &[u8], parts: &[&str]| {
            let message = outcome(place, bytes).expect_err(name);
            assert!(parts.iter().all(|part| message.contains(part)), "{name}: {message}");
        };
        for size in ["0 0", "0 4", "4 0"] {
            let file = format!("PF\n{size}\n-1.0\n").into_bytes();
            refused(&file, &["s.pbrt:6", "p.pfm", "both sides must be at least 1"]);
        }
        refused(b"", &["p.pfm"]);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            // One channel of one pixel of four.
            let file = pfm([2, 2], |i| if i == 4 { bad } else { 0.5 });
            refused(&file, &["s.pbrt:6: p.pfm: the pixel in column 1 of row 1 is NaN"]);
        }
        refused(&pfm([2, 1], |_| f32::NAN), &["and 1 more"]);
    }
    // The image's content matters: a white one is brighter than a black one.
    let [black, white] = [0.0, 1.0].map(|v| outcome(PLACES[0], &pfm([1, 1], |_| v)).expect("read")[0]);
    assert!(black == 0.0 && white > 0.01, "{black} {white}");
}
