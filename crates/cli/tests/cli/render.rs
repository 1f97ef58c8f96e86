//! The output of `dapple render` and `dapple compare`.

use crate::common::{Folder, names};
use dapple_scene::image::read_channels;

const KEYS: &str = "scene sampler points filter seed threads resolution samples spp rays seconds render_s cpu predicted_relmse \
    predicted_relmse_filtered rejected effects without";
const PHASES: &str = "load bvh cluster first_hits plan trace filter write";

/// Positions of the keys in the line, in the order given.
fn in_order(line: &str, keys: &str) -> bool {
    let places: Vec<Option<usize>> = keys.split(' ').map(|key| line.find(&format!("\"{key}\":"))).collect();
    places.iter().all(Option::is_some) && places.is_sorted()
}

#[test]
fn json_holds_the_keys_and_budgets_are_exact() {
    let folder = Folder::new();
    let line = folder.done("render tiny.pbrt --json --filter none --spp 5 --seed 9 --threads 3 -o a.pfm");
    let (_, seconds) = line.split_once("\"seconds\":").expect("seconds");
    assert!(in_order(&line, KEYS) && in_order(seconds, PHASES), "{line}");
    let json: serde_json::Value = serde_json::from_str(&line).unwrap();
    assert_eq!(json.as_object().unwrap().len(), KEYS.split(' ').count());
    assert_eq!(json["seconds"].as_object().unwrap().len(), PHASES.split(' ').count());
    assert_eq!(json["samples"], 24 * 16 * 5);
    assert_eq!((&json["spp"], &json["seed"], &json["threads"]), (&5.0.into(), &9.into(), &3.into()));
    assert_eq!(json["resolution"], serde_json::json!([24, 16]));
    assert_eq!(json["effects"], serde_json::json!(["soft-shadows", "interreflection"]));
    assert!(json["predicted_relmse"].is_null() && json["rejected"] == 0);
    let seconds = |key: &str| json["seconds"][key].as_f64().unwrap();
    let sum = ["cluster", "first_hits", "plan", "trace", "filter"].map(seconds).iter().sum::<f64>();
    assert!((json["render_s"].as_f64().unwrap() - sum).abs() < 1e-9);
    if cfg!(target_os = "linux") {
        assert!(json["cpu"].as_f64().unwrap() > 0.0);
    }
    for (words, samples) in [
        ("--spp 7.25", 2784),
        ("--spp 16 --sampler uniform --crop 3,2,10,9", 16 * 49),
        ("--spp 8 --sampler variance:policy=cross", 8 * 384),
        ("--spp 8 --sampler variance:policy=discard", 8 * 384),
        ("--spp 3 --min-spp 3 --max-spp 3", 3 * 384),
        ("--spp 0.5 --min-spp 0 --sampler uniform", 192),
        ("--spp 2 --resolution 5x3", 30),
    ] {
        assert_eq!(folder.json(&format!("tiny.pbrt {words} -o a.pfm"))["samples"], samples, "{words}");
    }
}

#[test]
fn error_and_time_are_budgets() {
    let folder = Folder::new();
    for (of, key) in [("filtered", "predicted_relmse_filtered"), ("unfiltered", "predicted_relmse")] {
        let loose = folder.json(&format!("tiny.pbrt --error-of {of} --error 0.05 -o a.pfm"));
        let tight = folder.json(&format!("tiny.pbrt --error-of {of} --error 0.0005 -o a.exr"));
        assert!(tight[key].as_f64().unwrap() <= 0.0005, "{tight}");
        assert!(tight["samples"].as_u64() > loose["samples"].as_u64(), "{loose} {tight}");
    }
    let unfiltered = folder.json("cornell --resolution 48x36 --error-of unfiltered --error 0.004 -o a.exr");
    let filtered = folder.json("cornell --resolution 48x36 --error 0.004 -o a.exr");
    assert!(unfiltered["predicted_relmse_filtered"].is_null());
    assert!(unfiltered["samples"].as_u64() > filtered["samples"].as_u64(), "{filtered} {unfiltered}");
    let out = folder.done("render tiny.pbrt --error 1e-9 --max-spp 16 -o a.pfm");
    assert!(out.contains("predicted relMSE"), "{out}");
    assert_eq!(folder.json("tiny.pbrt --error 1e-9 --max-spp 16 -o a.pfm")["spp"], 16.0);
    let timed = folder.json("tiny.pbrt --time 0.3 -o a.pfm");
    assert!(timed["samples"].as_u64() > Some(384) && timed["render_s"].as_f64() < Some(3.0), "{timed}");
}

#[test]
fn the_same_words_give_the_same_bytes() {
    let folder = Folder::new();
    for (name, words) in [
        ("a", "--seed 3"),
        ("b", "--seed 3 --threads 1"),
        ("c", "--seed 3 --threads 3"),
        ("other", "--seed 4"),
        ("random", "--seed 3 --points random"),
        ("box", "--seed 3 --pixel-filter box"),
        ("shallow", "--seed 3 --max-depth 1"),
    ] {
        folder.done(&format!("render tiny.pbrt -q --spp 12 {words} -o {name}.pfm -o {name}.png"));
    }
    for extension in ["pfm", "png"] {
        let bytes = |name: &str| folder.read(&format!("{name}.{extension}"));
        assert!(bytes("a") == bytes("b") && bytes("a") == bytes("c"), "threads change nothing");
        for name in ["other", "random", "shallow"] {
            assert!(bytes("a") != bytes(name), "{name} changes something");
        }
        // The tiny scene has pbrt-v4's default filter, a Gaussian wider than a pixel.
        assert!(bytes("a") != bytes("box"));
    }
}

/// One lamp, and eight of them: those chosen by their power, since what is learned of a crop is not what the whole
/// image would teach.
#[test]
fn a_crop_is_the_whole_images_r06() {
    let folder = Folder::new();
    let words = "--sampler uniform --filter none --resolution 24x16";
    let red = |words: &str| {
        folder.done(&format!("render {words} -o a.exr"));
        let (size, channels) = read(&folder, "a.exr");
        (size, channels.into_iter().find(|c| c.0 == "R").expect("red").1)
    };
    for (scene, same) in
        [("tiny.pbrt --spp 4", true), ("room --spp 4 --light-choice power", true), ("room --spp 4", false)]
    {
        let (_, whole) = red(&format!("{words} {scene}"));
        let (size, part) = red(&format!("{words} {scene} --crop 5,3,15,11"));
        assert_eq!(size, [10, 8]);
        let cut: Vec<f32> = (0..part.len()).map(|i| whole[(3 + i / 10) * 24 + 5 + i % 10]).collect();
        assert_eq!(part == cut, same, "{scene}");
    }
}

#[test]
fn an_exr_file_tells_how_it_was_made() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --sampler variance --filter none --spp 12 --seed 5 -o a.exr --maps maps");
    let (size, channels) = read(&folder, "a.exr");
    assert_eq!(size, [24, 16]);
    let names: Vec<&str> = channels.iter().map(|c| c.0.as_str()).collect();
    for name in ["R", "G", "B", "variance.R", "count.Y", "albedo.G", "normal.X", "normal.Z", "depth.Y", "coverage.Y"] {
        assert!(names.contains(&name), "{name}: {names:?}");
    }
    let plane = |name: &str| channels.iter().find(|c| c.0 == name).map(|c| &c.1).expect("a channel");
    assert_eq!(plane("count.Y").iter().sum::<f32>(), 24.0 * 16.0 * 12.0);
    // From (0, 2, 6) to the sphere of radius 0.5 around (0, 1, 0), in the file's units: a pixel sees the sphere
    // from its front to nearly its middle. The renderer's own units are sixteen times as large.
    let middle = plane("depth.Y")[8 * 24 + 12];
    let centre = 37.0_f32.sqrt();
    assert!((centre - 0.5..centre).contains(&middle), "{middle}");

    let value = |key: &str| folder.header("a.exr", key);
    for (key, expected) in [
        ("version", env!("CARGO_PKG_VERSION")),
        ("scene", "tiny"),
        ("sampler", "variance:pilot=0,radius=2,exponent=1.3,epsilon=0.01,cap=6,policy=keep,cost=0"),
        ("points", "sobol:seed=5"),
        ("filter", "none"),
        ("seed", "5"),
        ("budget", "12 spp, 4608 samples"),
        ("samples", "4608"),
        ("spp", "12"),
        ("resolution", "24x16"),
        ("crop", "0,0,24,16"),
        ("max-depth", "5"),
        ("light-selection", "learned"),
        ("effects", "soft-shadows,interreflection"),
        ("rejected", "0"),
        ("notices", "none"),
        ("interrupted", "false"),
        ("bias", "biased: sample counts depend on samples that are or were in the image"),
    ] {
        assert_eq!(value(key), expected, "{key}");
    }
    assert!(value("budgets").split(',').all(|b| b == "4608") && value("seconds").contains("\"trace\":"));
    assert_eq!(crate::common::names(&folder.path("maps")), ["albedo.png", "depth.png", "normals.png", "samples.png"]);

    folder.done("render tiny.pbrt --filter none --error 0.01 -o b.exr --maps maps");
    assert!(read(&folder, "b.exr").1.iter().any(|c| c.0 == "error.Y"));
    assert!(names_of(&folder, "maps").contains(&"error.png".to_owned()));
    for (sampler, bias) in [
        ("uniform", "none: sample counts do not"),
        ("variance:policy=cross", "none: the sample counts of each half"),
        ("variance:policy=discard", "none: sample counts do not"),
        ("cluster-thesis", "none: sample counts do not"),
        ("cluster", "biased: "),
        ("cluster:policy=discard", "none: sample counts do not"),
        ("cluster:policy=cross", "none: the sample counts of each half"),
        ("mitchell", "biased: "),
        ("mitchell:policy=discard", "none: sample counts do not"),
        ("mitchell-pbrt", "biased: "),
        ("mitchell-pbrt:policy=discard", "none: sample counts do not"),
        ("uniform --filter gaussian", "biased by the filter, less with more samples; before filtering: none: "),
    ] {
        let filter = if sampler.contains("--filter") { "" } else { "--filter none" };
        folder.done(&format!("render tiny.pbrt --sampler {sampler} {filter} --spp 12 -o c.exr"));
        assert!(folder.header("c.exr", "bias").starts_with(bias), "{sampler}: {}", folder.header("c.exr", "bias"));
    }
}

/// Clusters show in the map, in the EXR file, in the seconds and in the rays.
#[test]
fn clusters_are_shown_and_charged() {
    let folder = Folder::new();
    let words = "tiny.pbrt --sampler cluster-thesis --filter cluster-gaussian --spp 4 --maps maps -o a.exr -o a.pfm";
    let json = folder.json(words);
    assert!(
        json["seconds"]["cluster"].as_f64().unwrap() > 0.0 && json["seconds"]["first_hits"].as_f64().unwrap() > 0.0
    );
    assert!(names_of(&folder, "maps").contains(&"clusters.png".to_owned()));
    let (size, channels) = read(&folder, "a.exr");
    let ids = &channels.iter().find(|c| c.0 == "cluster.Y").expect("a layer of clusters").1;
    assert_eq!((size, ids.len()), ([24, 16], 24 * 16));
    let mut known: Vec<f32> = ids.clone();
    known.sort_by(f32::total_cmp);
    known.dedup();
    assert!(known.len() > 1, "one cluster for all: {known:?}");
    assert_eq!(folder.header("a.exr", "first-hit-rays"), (24 * 16).to_string());
    assert_eq!(json["rays"].to_string(), folder.header("a.exr", "rays"));
    // The same without clusters has neither.
    folder.done("render tiny.pbrt --sampler uniform --filter none --spp 4 --maps plain -o b.exr");
    assert!(!names_of(&folder, "plain").contains(&"clusters.png".to_owned()));
    assert!(!read(&folder, "b.exr").1.iter().any(|c| c.0 == "cluster.Y"));
}

/// `--features` adds layers to the files of any filter, and leaves the image as it is.
#[test]
fn features_are_written_on_request_only() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --sampler uniform --filter none --spp 4 -o";
    folder.done(&format!("{words} plain.exr"));
    folder.done(&format!("{words} asked.exr --features"));
    let [plain, asked] = ["plain.exr", "asked.exr"].map(|name| read(&folder, name).1);
    let new = ["albedo.R", "normal.X", "normal.Y", "normal.Z", "depth.Y", "coverage.Y"];
    for name in new {
        let held = |channels: &[(String, Vec<f32>)]| channels.iter().any(|c| c.0 == name);
        assert!(held(&asked) && !held(&plain), "{name}");
    }
    let plane = |name: &str| &asked.iter().find(|c| c.0 == name).expect("a channel").1;
    assert!(plain.iter().all(|(name, values)| plane(name) == values), "the image changed");
    // The floor ends at the horizon: above it nothing is hit.
    let coverage = plane("coverage.Y");
    assert!(coverage[0] == 0.0 && coverage[15 * 24] == 1.0, "{coverage:?}");
    assert_eq!((plane("albedo.R")[15 * 24], plane("normal.Y")[15 * 24]), (0.5, 1.0));

    folder.says(&format!("{words} a.png --features"), 2, &["add --output FILE.exr"]);
}

/// A warning reports clusters that a far triangle made useless.
#[test]
fn a_far_triangle_that_spoils_the_clusters_is_told_k04() {
    let folder = Folder::new();
    let scene = String::from_utf8(folder.read("tiny.pbrt")).expect("text");
    let strip: Vec<String> = (0..24).map(|i| format!("{} 0.1 {}", i / 2, -1 - i % 2)).collect();
    let triangles: Vec<String> = (0..22).map(|i| format!("{i} {} {}", i + 1, i + 2)).collect();
    let near = format!(
        "{scene}Shape \"trianglemesh\" \"integer indices\" [ {} ] \"point3 P\" [ {} ]\n",
        triangles.join(" "),
        strip.join(" ")
    );
    let far = "Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 9e4 9e4 9e4  9.1e4 9e4 9e4  9e4 9.1e4 9e4 ]\n";
    folder.write("near.pbrt", &near);
    folder.write("far.pbrt", near + far);
    let words = |name: &str| format!("render {name}.pbrt --sampler cluster-thesis:insertion=centroid --spp 2 -o k.pfm");
    folder.says(&words("far"), 0, &["hardly separate objects"]);
    assert!(!folder.run(&words("near")).err.contains("hardly separate objects"));
}

fn names_of(folder: &Folder, name: &str) -> Vec<String> {
    names(&folder.path(name))
}

/// Size, and channels as floats.
fn read(folder: &Folder, name: &str) -> ([u32; 2], Vec<(String, Vec<f32>)>) {
    let channels = folder.exr(name);
    let planes = channels.channels.into_iter().map(|(name, plane)| (name, plane.floats().into_owned()));
    (channels.size, planes.collect())
}

#[test]
fn without_words_about_files_there_is_an_image_and_a_sample_map() {
    let folder = Folder::new();
    let out = folder.done("render tiny.pbrt --spp 8");
    assert_eq!(folder.names(), ["tiny-samples.png", "tiny.exr", "tiny.png"]);
    assert!(out.starts_with("tiny, 24x16: 8.00 spp (") && out.contains("tiny-samples.png: the sample map; white is "));
    let folder = Folder::new();
    folder.done("render tiny.pbrt --spp 8 --sampler uniform -q");
    assert_eq!(folder.names(), ["tiny.exr", "tiny.png"]);
    let folder = Folder::new();
    let quiet = folder.run("render cornell --spp 1 --resolution 16x16 -q");
    assert_eq!((quiet.out.as_str(), quiet.err.as_str()), ("", ""));
    assert_eq!(folder.names(), ["cornell-samples.png", "cornell.exr", "cornell.png"]);
}

#[test]
fn the_default_scene_is_the_bundled_teapot() {
    let folder = Folder::new();
    let json = folder.json("--spp 1 --resolution 16x10");
    assert_eq!(json["scene"], "teapot");
    assert_eq!(folder.names(), ["teapot-samples.png", "teapot.exr", "teapot.png"]);
    // A file of that name is meant before the bundled scene.
    std::fs::copy(folder.path("tiny.pbrt"), folder.path("cornell")).expect("copied");
    assert_eq!(folder.json("cornell --spp 1 -o a.png")["resolution"], serde_json::json!([24, 16]));
}

#[test]
fn outputs_are_whole_or_not_there_i09() {
    let folder = Folder::new();
    folder.write("old.png", "old");
    let said = folder.run("render tiny.pbrt --spp 1 -o old.png -o missing/b.exr");
    assert_eq!((said.status, folder.names()), (Some(1), vec!["old.png".to_owned()]));
    assert_eq!(folder.read("old.png"), b"old");
    #[cfg(target_os = "linux")]
    {
        // A disk that is full only shows while writing: the other files are still whole.
        std::os::unix::fs::symlink("/dev/full", folder.path("full.exr")).expect("linked");
        let said = folder.says("render tiny.pbrt --spp 1 -o full.exr -o old.png", 1, &[]);
        assert!(said.err.starts_with("error: /dev/full: ") && said.err.contains("free some space"), "{}", said.err);
        assert!(folder.read("old.png").starts_with(b"\x89PNG"));
        assert_eq!(folder.names(), ["full.exr", "old.png"]);
        // The image is not lost with the disk: it lies where temporary files do, and the message says so.
        let (_, place) = said.err.split_once("was written to ").unwrap_or_else(|| panic!("{}", said.err));
        let place = std::path::Path::new(place.split(" instead").next().expect("a path"));
        let saved = std::fs::read(place).unwrap_or_else(|e| panic!("{}: {e}", place.display()));
        std::fs::remove_file(place).expect("removed");
        folder.done("render tiny.pbrt --spp 1 -o there.exr");
        let image = |bytes: &[u8]| format!("{:?}", read_channels(bytes, "there.exr").expect("an image"));
        assert!(image(&saved) == image(&folder.read("there.exr")));
    }
    // Names as people have them.
    let folder = Folder::new();
    let mut command = folder.command("render tiny.pbrt --spp 1 -o");
    let name = "\u{1f43e} mit Lücke.png";
    assert!(command.arg(name).output().expect("the program starts").status.success());
    assert!(folder.read(name).starts_with(b"\x89PNG"));
}

#[test]
fn an_image_equals_itself_and_no_other() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --spp 2 -o a.exr -o a.pfm -o a.png");
    folder.done("render tiny.pbrt --spp 2 --seed 2 -o b.exr");
    folder.done("render tiny.pbrt --spp 2 --resolution 4x4 -o small.pfm");
    for pair in ["a.exr a.exr", "a.exr a.pfm", "a.png a.png"] {
        let json = folder.line(&format!("compare {pair} --json"));
        for key in ["mse", "relmse", "relmse_trimmed", "smape", "srgb8_mse", "flip", "non_finite"] {
            assert_eq!(json[key].as_f64(), Some(0.0), "{pair}: {key}");
        }
        assert_eq!((json["psnr"].as_f64(), json["mean_ratio"].as_f64()), (Some(200.0), Some(1.0)));
        assert!(folder.done(&format!("compare {pair}")).starts_with("MSE             0 "), "{pair}");
    }
    let other = folder.line("compare b.exr a.exr --json");
    assert!(other["mse"].as_f64() > Some(0.0));
    assert!(other["flip"].as_f64().is_some_and(|seen| seen > 0.0 && seen < 1.0));
    assert!(folder.done("compare b.exr a.exr").contains("\nFLIP            0."));
    for (words, message) in [
        ("small.pfm a.exr", "error: the image is 4x4 and its reference 24x16; "),
        ("a.exr missing.exr", "error: missing.exr: cannot read the image: "),
        ("tiny.pbrt a.exr", "error: tiny.pbrt: unknown image format"),
    ] {
        let said = folder.says(&format!("compare {words}"), 1, &[]);
        assert!(said.err.starts_with(message) && said.out.is_empty(), "{}", said.err);
    }
}

/// The phases add up to the program's time, except its start and end.
#[test]
fn phases_sum_to_the_total_t01() {
    let folder = Folder::new();
    let words = "tiny.pbrt --resolution 192x128 --spp 128 --sampler variance --filter gaussian -o a.pfm";
    // A machine that is busy may stop the program while it starts: one of three times in a row is enough.
    let off = || {
        let clock = std::time::Instant::now();
        let line = folder.json(words);
        let total = clock.elapsed().as_secs_f64();
        let phases = line["seconds"].as_object().expect("phases");
        assert!(phases["plan"].as_f64() > Some(0.0), "what being adaptive costs is told: {line}");
        1.0 - phases.values().filter_map(serde_json::Value::as_f64).sum::<f64>() / total
    };
    assert!((0..3).any(|_| off().abs() <= 0.02));
}
