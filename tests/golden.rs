//! Golden bits: hashes of films and images, which no change of the code's structure may move, and no optimisation.
//!
//! `DAPPLE_UPDATE=1 cargo test --test golden` writes the hashes of now to `tests/golden`.

use dapple::{Film, Filtered, Session};
use dapple_core::{Frame, Integrator, Limits, Snapshot, Worker};
use dapple_denoise::{SampleBuffers, Variance, denoise};
use dapple_job::{BudgetSpec, LoadOptions, LoadedScene, PreparedScene, RenderSpec, RenderedImage, registry};
use dapple_scene::bundled;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

const SIZE: [u32; 2] = [64, 48];
const SEED: u64 = 5;

/// FNV-1a over the bits of numbers.
struct Hash(u64);

impl Hash {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn bits(&mut self, bits: u64) {
        for byte in bits.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn floats<'a>(&mut self, values: impl IntoIterator<Item = &'a f32>) {
        values.into_iter().for_each(|v| self.bits(u64::from(v.to_bits())));
    }

    fn film(&mut self, film: &Film) {
        self.bits(film.record().samples);
        for i in 0..film.frame().pixels() {
            self.bits(film.count(i));
            film.mean(i).iter().for_each(|v| self.bits(v.to_bits()));
            film.squared_error(i).iter().flatten().for_each(|v| self.bits(v.to_bits()));
            if let Some(f) = film.features(i) {
                self.bits(u64::from(f.samples));
                self.bits(u64::from(f.hits));
                self.floats([f.normal, f.albedo, f.position].as_flattened());
                self.floats(&[f.depth]);
                self.floats(f.variance.iter().flatten());
            }
        }
    }

    fn image(&mut self, image: &Filtered) {
        self.floats(image.radiance.as_flattened());
        self.floats(image.error.iter().flatten());
    }

    fn of(image: &RenderedImage) -> u64 {
        let mut hash = Self::new();
        hash.film(&image.film);
        hash.image(&image.filtered);
        hash.0
    }
}

fn spec(scene: &str) -> RenderSpec {
    RenderSpec::new(scene).resolution(SIZE[0], SIZE[1]).seed(SEED)
}

fn prepared(spec: &RenderSpec) -> PreparedScene {
    LoadedScene::read(spec, &LoadOptions::default()).expect("bundled").build().expect("sound")
}

/// The hash of a render with so many threads.
fn with_threads(scene: &PreparedScene, spec: &RenderSpec, threads: usize) -> u64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    Hash::of(&pool.install(|| scene.job(spec).expect("a job").render().expect("an image")))
}

/// The hash of a render, the same with one thread and with two.
fn rendered(scene: &PreparedScene, spec: &RenderSpec) -> u64 {
    let [one, two] = [1, 2].map(|threads| with_threads(scene, spec, threads));
    assert_eq!(one, two, "one thread and two: {} {} {}", spec.scene.display(), spec.sampler, spec.filter);
    one
}

/// The golden file, named after what its rows vary.
fn hold(name: &str, rows: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.txt"));
    if std::env::var_os("DAPPLE_UPDATE").is_some() {
        std::fs::write(&file, rows).expect("it can be written");
        return;
    }
    let known = std::fs::read_to_string(&file).expect("the golden file");
    let moved: Vec<_> = rows.lines().filter(|row| !known.lines().any(|line| line == *row)).collect();
    assert!(moved.is_empty(), "bits moved in {name}:\n{}", moved.join("\n"));
    assert_eq!(known.lines().count(), rows.lines().count(), "rows of {name}");
}

/// One row for each entry: its name and its hash.
fn rows(entries: impl IntoIterator<Item = (String, u64)>) -> String {
    entries.into_iter().fold(String::new(), |mut rows, (name, hash)| {
        writeln!(rows, "{name} {hash:016x}").expect("text");
        rows
    })
}

fn scenes(names: &[&str]) -> String {
    let mut entries = Vec::new();
    for (number, name) in names.iter().enumerate() {
        let base = spec(name);
        let scene = prepared(&base);
        for (counts, sampler) in [("uniform", Some("uniform")), ("adaptive", None)] {
            for (image, filter) in [("none", Some("none")), ("default", None)] {
                for spp in [1, 2, 16] {
                    let mut spec = base.clone().budget(BudgetSpec::Spp(f64::from(spp)));
                    spec = sampler.iter().fold(spec, |spec, name| spec.sampler(*name));
                    spec = filter.iter().fold(spec, |spec, name| spec.filter(*name));
                    // The rows are the same for one thread and two. Most samples are taken once, by one or the other.
                    let hash =
                        if spp < 16 { rendered(&scene, &spec) } else { with_threads(&scene, &spec, 1 + number % 2) };
                    entries.push((format!("{name} {counts} {image} {spp}"), hash));
                }
            }
        }
    }
    rows(entries)
}

/// Several tests, so that two cores work.
#[test]
fn bits_of_the_first_bundled_scenes_stay() {
    hold("scenes-1", &scenes(&bundled::names()[..5]));
}

#[test]
fn bits_of_the_second_bundled_scenes_stay() {
    hold("scenes-2", &scenes(&bundled::names()[5..9]));
}

#[test]
fn bits_of_the_third_bundled_scenes_stay() {
    hold("scenes-3", &scenes(&bundled::names()[9..12]));
}

#[test]
fn bits_of_the_last_bundled_scenes_stay() {
    hold("scenes-4", &scenes(&bundled::names()[12..]));
}

#[test]
fn bits_of_each_sampler_and_filter_and_point_set_stay() {
    // Motion of samples over a lens is what some methods read.
    let base = spec("chess").resolution(48, 36).budget(BudgetSpec::Spp(8.0));
    let scene = prepared(&base);
    let mut entries = Vec::new();
    for entry in registry::SAMPLERS {
        let mut spec = base.clone().sampler(entry.name).filter("none");
        if scene.job(&spec).is_err() {
            // Some refuse scenes with more kinds of randomness than they follow.
            spec = spec.sampler(format!("{}:force=1", entry.name));
        }
        entries.push((format!("sampler {}", entry.name), rendered(&scene, &spec)));
    }
    // Those of Open Image Denoise have the bits of its version and of the processor.
    for entry in registry::FILTERS.iter().filter(|entry| entry.feature != Some("oidn")) {
        let spec = base.clone().filter(entry.name);
        entries.push((format!("filter {}", entry.name), rendered(&scene, &spec)));
    }
    for entry in registry::POINTS {
        let spec = base.clone().points(entry.name).filter("none");
        entries.push((format!("points {}", entry.name), rendered(&scene, &spec)));
    }
    hold("methods", &rows(entries));
}

#[test]
fn bits_of_each_integrator_stay() {
    let base = spec("door").resolution(32, 24).budget(BudgetSpec::Spp(8.0));
    let scene = prepared(&base);
    let entries = dapple_transport::integrators().iter().map(|entry| {
        let spec = base.clone().integrator(entry.name).filter("none");
        (format!("integrator {}", entry.name), rendered(&scene, &spec))
    });
    hold("integrators", &rows(entries));
}

/// A session's image, killed after the first tiles of its second round and resumed.
fn pulled(integrator: &dyn Integrator) -> u64 {
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("a frame");
    let limits = || Limits::spp(8.0);
    let mut killed = Session::new(frame, limits(), dapple::default_pair(SEED)).expect("a session").with_tile_side(8);
    let trace = |round: &dapple::Round<'_>, at_most: usize| {
        for mut tile in std::iter::from_fn(|| round.next_tile()).take(at_most) {
            tile.sample_features(|draws| integrator.features_alone(draws));
            let samples: Vec<_> = tile.samples().collect();
            for sample in &samples {
                tile.add(sample, integrator.estimate(sample, &mut Worker::default()));
            }
            round.submit(tile).expect("complete");
        }
    };
    trace(&killed.next_round().expect("a round").expect("a first one"), usize::MAX);
    let second = killed.next_round().expect("a round").expect("a second one");
    trace(&second, 7);
    let snapshot = Snapshot::from_bytes(&second.snapshot()).expect("a snapshot");
    drop(second);
    let mut resumed = Session::resume(frame, limits(), dapple::default_pair(SEED), snapshot).expect("the same");
    while let Some(round) = resumed.next_round().expect("a round") {
        trace(&round, usize::MAX);
    }
    let mut hash = Hash::new();
    hash.image(&resumed.finish().expect("an image"));
    hash.0
}

/// The image of buffers: two halves with features, as another renderer passes them.
fn denoised(film: &Film) -> u64 {
    let pixels = film.frame().pixels();
    let half = |half: usize| {
        let of = |i: usize| film.half(half, i).expect("halves");
        let mean: Vec<[f32; 3]> = (0..pixels).map(|i| of(i).mean.map(|v| v as f32)).collect();
        let variance: Vec<[f32; 3]> =
            (0..pixels).map(|i| film.moments(i).variance().unwrap_or_default().map(|v| v as f32)).collect();
        let counts: Vec<u32> = (0..pixels).map(|i| of(i).count as u32).collect();
        (mean, variance, counts)
    };
    let [a, b] = [half(0), half(1)];
    let features: Vec<_> = (0..pixels).map(|i| film.features(i).expect("features")).collect();
    let normal: Vec<_> = features.iter().map(|f| f.normal).collect();
    let albedo: Vec<_> = features.iter().map(|f| f.albedo).collect();
    let depth: Vec<_> = features.iter().map(|f| f.depth).collect();
    let halves = [&a, &b].map(|h| SampleBuffers::new(&h.0, &h.2).variance(Variance::OfSamples(&h.1)));
    let image = denoise(SIZE, &halves[0], &halves[1]).normal(&normal).albedo(&albedo).depth(&depth).run();
    let mut hash = Hash::new();
    hash.image(&image.expect("an image"));
    hash.0
}

#[test]
fn bits_of_a_resumed_session_and_of_buffers_stay() {
    let mut entries = Vec::new();
    for name in ["cornell", "tea"] {
        let base = spec(name).budget(BudgetSpec::Spp(8.0));
        let scene = prepared(&base);
        let integrator = dapple_renderer::integrator(&scene.world);
        entries.push((format!("session {name}"), pulled(&*integrator)));
        let film = scene.job(&base.sampler("uniform")).expect("a job").render().expect("an image").film;
        entries.push((format!("buffers {name}"), denoised(&film)));
    }
    hold("hosts", &rows(entries));
}

/// Unoptimised, optimised and built for this machine's processor, the program writes the same bytes.
#[test]
#[ignore = "T2: builds the program three times, ten minutes"]
fn optimisation_changes_no_pixel_d04() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().expect("a folder");
    let image = |name: &str, flags: &str, level: &str, profile: &str| -> Vec<u8> {
        let out = folder.path().join(format!("{name}.pfm"));
        let output = Command::new(env!("CARGO"))
            .args(["run", "--quiet", "--profile", profile, "-p", "dapple-cli", "--", "render", "cornell"])
            .args(
                "--resolution 40x30 --spp 8 --sampler adaptive:epsilon=0.01 --filter cluster-regression -o".split(' '),
            )
            .arg(&out)
            .env("CARGO_TARGET_DIR", root.join("target/flavours").join(name))
            .env("RUSTFLAGS", flags)
            .env("CARGO_PROFILE_DEV_OPT_LEVEL", level)
            .current_dir(root)
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).expect("an image")
    };
    let plain = image("plain", "", "1", "dev");
    assert!(plain == image("release", "", "1", "release"), "release is another image");
    assert!(
        plain == image("native", "-C target-cpu=native", "2", "dev"),
        "this machine's processor makes another image"
    );
}
