//! References are rendered once, kept, and rejected if they do not match the study.

use crate::support::{Fake, Place};
use dapple_core::render::Control;
use dapple_renderer::light::LightSelection;
use dapple_scene::image::{Image, Layer, encode_exr, encode_pfm, read_attributes, write_file};
use dapple_study::{Plan, ReferenceRecord, Study, StudyMonitor, StudyOptions, StudyProgress};
use std::path::{Path, PathBuf};

/// Records if a reference was rendered.
#[derive(Default)]
struct Ear {
    rendered: bool,
}

impl StudyMonitor for Ear {
    fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
        self.rendered |= progress.doing.ends_with(": reference");
        Control::Continue
    }
}

impl Place {
    /// The reference of a study, and true if the study rendered it. `shared` is a folder of references.
    fn reference(&self, plan: Plan, folder: &str) -> (ReferenceRecord, bool) {
        let mut ear = Ear::default();
        let options = StudyOptions { references: Some(self.path("shared")), ..StudyOptions::default() };
        let study = Study::open(plan, &self.path(folder), &options, &mut ear);
        let study = study.unwrap().expect("not stopped");
        (study.manifest().scenes[0].reference.clone(), ear.rendered)
    }

    fn with_reference(&self, file: &Path, sets: &[&str]) -> Plan {
        let scenes = self.scenes(&[&format!("reference = {file:?}")]);
        self.plan(&[&[scenes.as_str()], sets].concat())
    }

    fn refused(&self, plan: Plan) -> String {
        self.open(plan, "refused").err().expect("refused").to_string()
    }
}

#[test]
fn a_reference_is_rendered_once() {
    let place = Place::new();
    let (first, rendered) = place.reference(place.plan(&[]), "a");
    assert!(rendered);
    assert_eq!((first.spp, first.points.as_deref()), (Some(16), Some("halton")), "points that no method uses");
    let relmse = first.relmse.expect("its own variance is known");
    assert!((1e-7..1e-1).contains(&relmse), "{relmse}");
    // Another study's methods, seeds and budgets do not matter.
    let other = place.plan(&["spp=2", "seeds=[9]", "filters=gaussian"]);
    let (second, rendered) = place.reference(other, "b");
    assert_eq!((second, rendered), (first.clone(), false));
    let bytes = std::fs::read(&first.file).unwrap();
    let attributes = read_attributes(&bytes, "reference").unwrap();
    assert!(attributes.contains(&("dapple:study-key".into(), first.hash.clone())), "{attributes:?}");
}

#[test]
fn every_setting_that_matters_gives_another_reference() {
    let place = Place::new();
    let (first, _) = place.reference(place.plan(&[]), "a");
    let changes = [
        ("b", "resolution=8x7"),
        ("c", "reference_spp=18"),
        ("d", "max_depth=1"),
        ("e", "points=[\"halton\", \"sobol\"]"),
    ];
    let mut hashes = vec![first.hash.clone()];
    for (folder, change) in changes {
        let (other, rendered) = place.reference(place.plan(&[change]), folder);
        assert!(rendered && !hashes.contains(&other.hash), "{folder}");
        hashes.push(other.hash);
    }
    // An included file.
    std::fs::write(place.path("floor.pbrt"), format!("{}# a word\n", crate::support::FLOOR)).unwrap();
    let (other, rendered) = place.reference(place.plan(&[]), "f");
    assert!(rendered && !hashes.contains(&other.hash));
    // The control: the original file.
    std::fs::write(place.path("floor.pbrt"), crate::support::FLOOR).unwrap();
    assert_eq!(place.reference(place.plan(&[]), "g"), (first.clone(), false));
    // A broken reference is rendered again.
    std::fs::write(&first.file, b"nonsense").unwrap();
    assert_eq!(place.reference(place.plan(&[]), "h"), (first, true));
}

#[test]
fn a_file_of_another_size_scene_or_setting_is_refused() {
    let place = Place::new();
    let image = |size: [u32; 2]| Image::filled(size, [0.5; 3]).unwrap();
    let exr = |name: &str, pairs: &[(&str, &str)]| {
        let pairs: Vec<_> = pairs.iter().map(|(k, v)| (format!("dapple:{k}"), (*v).to_owned())).collect();
        let bytes = encode_exr([8, 8], &[Layer::of_image("", &image([8, 8]))], &pairs).unwrap().bytes;
        write_file(&place.path(name), &bytes).unwrap();
        place.path(name)
    };
    write_file(&place.path("wide.pfm"), &encode_pfm(&image([9, 8])).unwrap()).unwrap();
    let cases = [
        (place.path("wide.pfm"), "it has 9x8 pixels, but the study uses 8x8"),
        (exr("scene.exr", &[("scene", "teapot")]), "its header states scene \"teapot\", but the study has \"tiny\""),
        (exr("depth.exr", &[("max-depth", "3")]), "its header states max depth \"3\", but the study has \"5\""),
        (exr("filter.exr", &[("pixel-filter", "Gaussian filter")]), "render the reference with --pixel-filter box"),
        (exr("without.exr", &[("without", "glossy")]), "render the reference with all effects"),
        (exr("half.exr", &[("interrupted", "true")]), "finish the render of the reference, which was stopped"),
        (exr("seed.exr", &[("points", "sobol:seed=2"), ("seed", "2")]), "render the reference with another seed"),
        (exr("content.exr", &[("study-scene", "0")]), "since the scene's files have changed"),
        (place.path("none.exr"), "cannot read the reference"),
        (place.path("tiny.pbrt"), "tiny.pbrt"),
    ];
    for (file, message) in cases {
        let said = place.refused(place.with_reference(&file, &[]));
        assert!(said.contains(message) && said.contains(&*file.to_string_lossy()), "{message}: {said}");
    }
    // The controls: a header that matches the study, and a file without one.
    let good = exr("good.exr", &[("scene", "tiny"), ("points", "sobol:seed=3"), ("seed", "3"), ("without", "none")]);
    let study = place.study(place.with_reference(&good, &[]), "good", &mut Fake::default());
    let reference = &study.manifest().scenes[0].reference;
    assert_eq!((reference.spp, reference.relmse), (None, None));
    write_file(&place.path("plain.pfm"), &encode_pfm(&image([8, 8])).unwrap()).unwrap();
    // Without a resolution in the plan, the reference's is used.
    let mut settings = place.with_reference(&place.path("plain.pfm"), &[]).settings;
    settings.resolution = None;
    let study = place.study(settings.resolve().unwrap(), "plain", &mut Fake::default());
    assert_eq!(study.manifest().scenes[0].resolution, [8, 8]);
}

#[test]
fn a_reference_of_a_study_keeps_its_variance() {
    let place = Place::new();
    let (made, _) = place.reference(place.plan(&[]), "a");
    let study = place.study(place.with_reference(made.file.as_ref(), &[]), "b", &mut crate::support::in_process());
    assert_eq!(study.manifest().scenes[0].reference.relmse, made.relmse);
    assert!(study.runs().iter().all(|r| r.corrected && r.reference_limited), "16 spp limit 8");
}

#[test]
fn unknown_scenes_list_the_known_ones() {
    let place = Place::new();
    let said = place.refused(place.plan(&["scenes=nonesuch"]));
    assert!(said.contains("nonesuch: no such file or bundled scene; the bundled scenes are teapot"), "{said}");
}

#[test]
fn a_reference_of_a_multiple_of_the_size_is_averaged() {
    let place = Place::new();
    let file = |name: &str, size: [u32; 2], value: &dyn Fn(u32, u32) -> f32| {
        let pixels = (0..size[0] * size[1]).map(|i| [value(i % size[0], i / size[0]); 3]).collect();
        write_file(&place.path(name), &encode_pfm(&Image::new(size, pixels).unwrap()).unwrap()).unwrap();
        place.path(name)
    };
    // Blocks of 2x3 pixels around the same means, with different values within each block.
    let mean = |x: u32, y: u32| 0.25 + 0.01 * x as f32 + 0.02 * y as f32;
    let small = file("small.pfm", [8, 8], &mean);
    let large = file("large.pfm", [16, 24], &|x, y| mean(x / 2, y / 3) + if x % 2 == 0 { 0.125 } else { -0.125 });
    let errors = |reference: PathBuf, folder: &str| {
        let plan = place.with_reference(&reference, &["time_of=0"]);
        place
            .study(plan, folder, &mut crate::support::in_process())
            .runs()
            .iter()
            .map(|r| r.errors.get("mse"))
            .collect::<Vec<_>>()
    };
    let [a, b] = [errors(small, "a"), errors(large, "b")];
    assert!(a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-4), "{a:?} {b:?}");
    let said = place.refused(place.with_reference(&file("odd.pfm", [16, 12], &mean), &[]));
    assert!(
        said.contains("it has 16x12 pixels, but the study uses 8x8") && said.contains("8x8 pixels or a multiple"),
        "{said}"
    );
}

#[test]
fn light_selections_share_a_reference() {
    let place = Place::new();
    let with = |lights: LightSelection, name: &str| {
        let scene = format!("scenes={{ source = \"room\", name = {name:?}, lights = {:?} }}", lights.name());
        place.plan(&[&scene, "samplers=uniform", "time_of=0"])
    };
    let (power, rendered) = place.reference(with(LightSelection::Power, "power"), "a");
    assert!(rendered);
    let (cells, rendered) = place.reference(with(LightSelection::Learned, "learned"), "b");
    assert!(!rendered && power == cells);
    // The runs differ.
    let errors = |lights: LightSelection, folder: &str| {
        let study = place.study(with(lights, "room"), folder, &mut crate::support::in_process());
        assert_eq!(study.manifest().scenes[0].lights, lights);
        study.runs().iter().map(|r| r.errors.get("mse")).collect::<Vec<_>>()
    };
    let [power, uniform, again] =
        [(LightSelection::Power, "c"), (LightSelection::Uniform, "d"), (LightSelection::Power, "e")]
            .map(|(lights, folder)| errors(lights, folder));
    assert!(power == again && power != uniform, "{power:?} {uniform:?}");
}
