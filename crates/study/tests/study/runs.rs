//! Runs: order, resumption, rejected folders, and known results, each with a control that must differ.

use crate::support::{Fake, Place, copy, in_process, label};
use dapple_core::render::Control;
use dapple_metrics::log_log_fit;
use dapple_study::{Method, PlanSettings, Run, RunBudget, StudyError, StudyMonitor, StudyProgress, StudyStatus};

#[test]
fn methods_alternate_run_by_run() {
    let place = Place::new();
    let study = place.study(place.plan(&[]), "study", &mut Fake::default());
    let order: Vec<String> = study.runs().iter().map(label).collect();
    let expected = [
        "tiny uniform/sobol/none 4 1",
        "tiny variance/sobol/none 4 1",
        "tiny uniform/sobol/none 8 1",
        "tiny variance/sobol/none 8 1",
        "tiny uniform/sobol/none 4 2",
        "tiny variance/sobol/none 4 2",
        "tiny uniform/sobol/none 8 2",
        "tiny variance/sobol/none 8 2",
        "tiny uniform/sobol/none t4 1",
        "tiny variance/sobol/none t4 1",
        "tiny uniform/sobol/none t4 2",
        "tiny variance/sobol/none t4 2",
    ];
    assert_eq!(order, expected);
    assert_eq!(study.runs().len(), study.expected());
}

#[test]
fn a_study_killed_at_any_byte_resumes_to_the_same_end() {
    let place = Place::new();
    place.study(place.plan(&[]), "whole", &mut Fake::default());
    let whole = place.text("whole/runs.jsonl");
    let ends: Vec<usize> = whole.match_indices('\n').map(|(at, _)| at + 1).collect();
    for (line, end) in std::iter::once(0).chain(ends.iter().copied()).enumerate() {
        // At a line's end, within the next line, and before its newline.
        let next = ends.get(line).copied().unwrap_or(end);
        for cut in [end, end + (next - end) / 2, next.saturating_sub(1).max(end)] {
            let name = format!("cut-{cut}");
            copy(&place.path("whole"), &place.path(&name));
            std::fs::write(place.path(&name).join("runs.jsonl"), &whole[..cut]).unwrap();
            let mut fake = Fake::default();
            place.study(place.plan(&[]), &name, &mut fake);
            assert_eq!(place.text(&format!("{name}/runs.jsonl")), whole, "cut at {cut}");
            assert!(fake.asked >= ends.len() - line, "runs were made again or anew");
            // The first equal-time run may take several trials.
            assert!(fake.asked <= ends.len() - line + 2, "{} runs for {} lines", fake.asked, ends.len() - line);
        }
    }
}

#[test]
fn real_runs_are_the_same_after_a_stop() {
    struct After(usize);
    impl StudyMonitor for After {
        fn progress(&mut self, progress: &StudyProgress<'_>) -> Control {
            if progress.done >= self.0 { Control::Stop } else { Control::Continue }
        }
    }
    let place = Place::new();
    // Without equal time, whose sample counts depend on the clock.
    let plan = || place.plan(&["time_of=0"]);
    let whole = place.study(plan(), "whole", &mut in_process());
    let mut first = place.open(plan(), "stopped").unwrap();
    assert_eq!(first.run(&mut in_process(), &mut After(3)).unwrap(), StudyStatus::Stopped);
    assert_eq!(first.runs().len(), 3);
    drop(first);
    let second = place.study(plan(), "stopped", &mut in_process());
    let found = |runs: &[Run]| runs.iter().map(|r| (label(r), r.errors, r.samples, r.rays)).collect::<Vec<_>>();
    assert_eq!(found(second.runs()), found(whole.runs()));
    assert!(whole.runs().iter().all(|r| r.render_s > 0.0 && r.errors.get("mse") > 0.0 && r.corrected));
    for (run, study) in whole.runs().iter().map(|r| (r, "whole")).chain(second.runs().iter().map(|r| (r, "stopped"))) {
        assert_eq!(run.image.is_some(), run.seed == 1, "images are of the first seed");
        for file in run.image.iter().chain(&run.sample_map) {
            assert!(place.path(study).join(file).is_file(), "{file}");
        }
    }
}

#[test]
fn runs_of_equal_time_take_the_time_of_the_baseline() {
    let place = Place::new();
    let plan = place.plan(&["filters=[\"none\", \"gaussian\"]", "spp=[8, 16, 32]"]);
    let study = place.study(plan, "study", &mut Fake::default());
    let equal: Vec<&Run> = study.runs().iter().filter(|r| r.budget == RunBudget::TimeOf(16)).collect();
    assert_eq!(equal.len(), 4 * 2);
    let baseline = 16.0 * 64.0 * 1e-6;
    for run in &equal {
        assert!((run.render_s / baseline - 1.0).abs() < 0.01, "{}: {}", run.method, run.render_s);
    }
    let spp = |method: &str| equal.iter().find(|r| r.method.to_string() == method).unwrap().spp;
    assert_eq!(spp("uniform/sobol/none"), 16.0);
    assert!((spp("variance/sobol/none") - 16.0 / 1.5).abs() < 0.02);
    assert!((spp("uniform/sobol/gaussian") - (16.0 - 1e-4 / 1e-6 / 64.0)).abs() < 0.02);
}

/// A wrong model of a method's time is detected by the first run, and the count is corrected once.
#[test]
fn a_wrong_sample_count_is_corrected_once() {
    /// From the 9th run on, `variance` takes twice as long.
    struct Slower(Fake);
    impl dapple_study::Runner for Slower {
        fn run(&mut self, request: &dapple_study::RunRequest) -> Result<Run, StudyError> {
            let mut run = self.0.run(request)?;
            if self.0.asked > 8 && request.method.sampler == "variance" {
                run.seconds.trace *= 2.0;
                run.render_s *= 2.0;
            }
            Ok(run)
        }
    }
    let place = Place::new();
    let mut slower = Slower(Fake::default());
    let study = place.study(place.plan(&[]), "study", &mut slower);
    // 8 runs at given spp; at equal time, 2 of the baseline, and of the other method 2 trials, 1 corrected run and 1 for the
    // second seed.
    assert_eq!((slower.0.asked, study.runs().len()), (14, 12));
    let equal: Vec<&Run> = study.runs().iter().filter(|r| matches!(r.budget, RunBudget::TimeOf(_))).collect();
    for run in equal {
        assert!((run.render_s / (4.0 * 64.0 * 1e-6) - 1.0).abs() < 0.02, "{}: {}", label(run), run.render_s);
    }
}

#[test]
fn another_plan_in_the_folder_is_refused_with_the_difference() {
    let place = Place::new();
    place.study(place.plan(&[]), "study", &mut Fake::default());
    let before = place.text("study/runs.jsonl");
    let named = place.scenes(&["name = \"other\""]);
    let changes = [
        ("spp=[4, 16]", "spp: 4 8, not 4 16"),
        ("seeds=[1]", "seeds: 1 2, not 1"),
        (
            "filters=gaussian",
            "methods: uniform/sobol/none variance/sobol/none, not uniform/sobol/none uniform/sobol/gaussian",
        ),
        ("time_of=0", "time_of: 4, not none"),
        ("resolution=8x9", "scene tiny.resolution: 8 8, not 8 9"),
        ("reference_spp=32", "scene tiny.reference.spp: 16, not 32"),
        (&named, "scenes: tiny, not other"),
        ("fresh=true", "fresh: false, not true"),
    ];
    for (change, message) in changes {
        let said = place.open(place.plan(&[change]), "study").err().expect("refused").to_string();
        assert!(said.contains(message) && said.contains("choose another folder"), "{message}: {said}");
    }
    assert_eq!(place.text("study/runs.jsonl"), before);
    // The scene itself.
    std::fs::write(place.path("floor.pbrt"), crate::support::FLOOR.replace('9', "8")).unwrap();
    let said = place.open(place.plan(&[]), "study").err().expect("refused").to_string();
    assert!(said.contains("scene tiny or its reference has changed since the study began"), "{said}");
    // The control: the same plan is accepted wherever the scene's file lies.
    std::fs::write(place.path("floor.pbrt"), crate::support::FLOOR).unwrap();
    place.open(place.plan(&[]), "study").unwrap();
}

#[test]
fn broken_records_are_not_overwritten() {
    let place = Place::new();
    place.study(place.plan(&[]), "study", &mut Fake::default());
    let file = place.path("study/runs.jsonl");
    let whole = place.text("study/runs.jsonl");
    let cases = [
        (whole.replacen("\"seed\"", "\"sed\"", 1), "runs.jsonl:1: the line is not a run"),
        (format!("{whole}nonsense\n"), "runs.jsonl:13: the line is not a run"),
        (format!("{whole}{}\n", whole.lines().next().unwrap()), "runs.jsonl:13: this is the same run as line 1"),
    ];
    for (text, message) in cases {
        std::fs::write(&file, &text).unwrap();
        let said = place.open(place.plan(&[]), "study").err().expect("refused").to_string();
        assert!(said.contains(message), "{said}");
        assert_eq!(place.text("study/runs.jsonl"), text);
    }
    std::fs::write(&file, &whole).unwrap();
    std::fs::remove_file(place.path("study/study.json")).unwrap();
    let said = place.open(place.plan(&[]), "study").err().expect("refused").to_string();
    assert!(said.contains("runs.jsonl has runs, but their study.json is missing"), "{said}");
    assert_eq!(place.text("study/runs.jsonl"), whole);
}

#[test]
fn a_folder_is_locked_for_one_process() {
    let place = Place::new();
    let first = place.open(place.plan(&[]), "study").unwrap();
    let said = place.open(place.plan(&[]), "study").err().expect("refused").to_string();
    assert!(said.contains("another process is running the study"), "{said}");
    drop(first);
    place.open(place.plan(&[]), "study").unwrap();
}

#[test]
fn scenes_of_one_name_are_numbered() {
    let place = Place::new();
    let two = place.plan(&[&place.scenes(&["", ""]), "seeds=[1]"]);
    let study = place.study(two, "study", &mut Fake::default());
    let names: Vec<&str> = study.manifest().scenes.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["tiny", "tiny-2"]);
    let same = place.plan(&[&place.scenes(&["name = \"a\""; 2])]);
    let said = place.open(same, "other").err().expect("refused").to_string();
    assert!(said.contains("scene name \"a\" is empty or used twice"), "{said}");
    assert_eq!("uniform".parse::<Method>().unwrap(), study.manifest().baseline);
}

impl Place {
    /// The runs of uniform sampling with these points.
    fn runs(&self, points: &str, spp: &[u64], seeds: std::ops::Range<u64>, folder: &str) -> Vec<Run> {
        let method = Method::new("uniform", points, "none");
        let seeds: Vec<u64> = seeds.collect();
        let mut settings = self.settings(&method);
        (settings.spp, settings.seeds, settings.reference_spp) = (Some(spp.to_vec()), Some(seeds), 512);
        self.study(settings.resolve().unwrap(), folder, &mut in_process()).runs().to_vec()
    }

    /// Settings for a single method, without equal-time runs.
    fn settings(&self, method: &Method) -> PlanSettings {
        let settings = self.plan(&["time_of=0", "resolution=20x20"]).settings;
        PlanSettings { samplers: None, methods: vec![method.clone()], baseline: method.clone(), ..settings }
    }
}

fn mse(runs: &[Run], spp: u64) -> Vec<f64> {
    runs.iter().filter(|r| r.budget == RunBudget::Spp(spp)).map(|r| r.errors.get("mse")).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The MSE of independent samples falls with slope -1 +- 0.06.
#[test]
fn independent_sampling_has_slope_minus_one() {
    let place = Place::new();
    let spp = [1, 4, 16, 64];
    let slope = |points: &str| {
        let runs = place.runs(points, &spp, 1..9, points);
        let errors = spp.map(|n| mean(&mse(&runs, n)));
        log_log_fit(&spp.map(|n| n as f64), &errors, 0.95).unwrap().slope.value
    };
    let independent = slope("random");
    assert!((independent + 1.0).abs() < 0.06, "{independent}");
    // The control: points that are not independent converge faster.
    let scrambled = slope("sobol");
    assert!(scrambled < -1.06, "{scrambled}");
}

/// E (a - b)^2 = 2 var a for two independent images.
#[test]
fn two_seeds_differ_by_twice_the_variance() {
    let place = Place::new();
    // Against the reference: each image's variance.
    let spp = 16;
    let alone = place.runs("random", &[spp, 4 * spp], 1..9, "alone");
    let against = |file: &str| {
        let method = Method::new("uniform", "random", "none");
        let mut settings = place.settings(&method);
        // The first seed's image is the reference.
        (settings.spp, settings.seeds) = (Some(vec![spp]), Some((2..9).collect()));
        settings.scenes[0].reference = Some(place.path("alone").join(file));
        let folder = file.replace(['/', '.'], "-");
        let study = place.study(settings.resolve().unwrap(), &folder, &mut in_process());
        assert!(study.runs().iter().all(|r| !r.corrected), "an image's own variance is not known");
        mean(&mse(study.runs(), spp))
    };
    let variance = mean(&mse(&alone, spp));
    let pairs = against("images/tiny/uniform-none-16spp.exr");
    // With 1200 values per image, 7 pairs give the ratio within about 4 %.
    assert!((pairs / (2.0 * variance) - 1.0).abs() < 0.12, "{pairs} and {variance}");
    // The control: an image of four times the samples adds only a quarter.
    let other = against("images/tiny/uniform-none-64spp.exr");
    assert!((other / (2.0 * variance) - 0.625).abs() < 0.12, "{other} and {variance}");
}

#[test]
fn filters_share_samples_if_the_first_recorded_enough() {
    let place = Place::new();
    let runs = |first: &str, second: &str, name: &str, shares: bool| {
        let filters = format!("filters=[\"{first}\", \"{second}\"]");
        let sets = [&*filters, "baseline=uniform/sobol/none", "time_of=0"];
        let mut runner = if shares { in_process().sharing() } else { in_process() };
        place.study(place.plan(&sets), name, &mut runner).runs().to_vec()
    };
    let (own, shared) =
        (runs("cluster-gaussian", "none", "own", false), runs("cluster-gaussian", "none", "shared", true));
    let other = runs("none", "cluster-gaussian", "other", true);
    assert_eq!(own.len(), 16);
    for ((own, shared), other) in own.chunks(2).zip(shared.chunks(2)).zip(other.chunks(2)) {
        for (a, b) in own.iter().zip(shared).chain(own.iter().zip(other.iter().rev())) {
            assert_eq!((&a.method, a.seed, &a.errors), (&b.method, b.seed, &b.errors));
        }
        assert_eq!(shared[0].seconds.trace, shared[1].seconds.trace);
        assert_ne!(own[0].seconds.trace, own[1].seconds.trace);
        assert_ne!(other[0].seconds.trace, other[1].seconds.trace, "the unfiltered film lacks what the filter needs");
    }
}
