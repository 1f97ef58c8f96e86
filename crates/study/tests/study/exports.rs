//! Files beside the report: tables and images; links and warnings of the page.

use crate::synthesis::{Law, Study, example};
use dapple_study::write_report;

fn written(study: &mut Study, images: bool) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    study.write(folder.path(), images);
    let _ = write_report(folder.path()).unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    (folder, page)
}

fn two() -> Study {
    Study::new(&["a"], &[Law::new("uniform", "none"), Law::new("mitchell", "none")], &[4, 8], Some(8), 3)
}

#[test]
fn every_link_of_the_page_leads_to_a_file() {
    let (folder, page) = written(&mut example(), true);
    let links: Vec<&str> = page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    let files: Vec<&&str> = links.iter().filter(|link| !link.starts_with('#') && !link.starts_with("data:")).collect();
    let missing: Vec<_> = files.iter().filter(|file| !folder.path().join(file).is_file()).collect();
    assert_eq!(missing, Vec::<&&&str>::new());
    for file in ["runs.csv", "runs.jsonl", "summary.csv", "study.json"] {
        assert!(files.iter().any(|link| **link == file), "{file}: {files:?}");
    }
    // The EXR image and the sample map of each method.
    assert_eq!(files.iter().filter(|file| file.starts_with("images/")).count(), 2 * 2 * 6);
}

#[test]
fn a_busy_machine_is_warned_of_at_the_top() {
    let mut study = two();
    study.manifest.machine.cores = Some(2);
    let (_, page) = written(&mut study, false);
    assert!(!page.contains("The machine was busy"));
    for run in study.runs.iter_mut().take(3) {
        run.load = Some(5.25);
    }
    let (_, page) = written(&mut study, false);
    let warning = "the load was up to 5.2 on 2 cores, and above the cores before 3 of 18 runs";
    assert!(page.find(warning).is_some_and(|at| at < page.find("<main>").unwrap()), "no warning");
    // The study's own threads are no other program.
    study.manifest.machine.cores = Some(6);
    let (_, page) = written(&mut study, false);
    assert!(!page.contains("The machine was busy"));
}

#[test]
fn an_unknown_commit_is_named_with_the_version() {
    let mut study = two();
    assert!(written(&mut study, false).1.contains("Made by Dapple 0.1.0, commit 0123abc+."));
    study.manifest.commit = None;
    assert!(written(&mut study, false).1.contains("commit unknown (this build of version 0.1.0 came without git)"));
}

#[test]
fn undecided_and_losses_in_flip_are_explained_where_they_stand() {
    let mut study = two();
    let (_, page) = written(&mut study, false);
    let verdicts = page.split("id=\"verdicts\"").nth(1).unwrap();
    assert!(verdicts.contains("<span class=\"why\">the interval contains 1</span>"), "no reason");
    // A third of the error in relMSE, twice that in FLIP.
    for run in study.runs.iter_mut().filter(|run| run.method.sampler == "mitchell") {
        run.errors.set("relmse", 0.3 * run.errors.get("relmse"));
        run.errors.set("flip", 2.0 * run.errors.get("flip"));
    }
    let (_, page) = written(&mut study, false);
    assert!(page.contains("loses in FLIP on") && page.contains("▼ 1 lost"), "no loss in FLIP");
    let cell = page.split("<td class=\"num loss\">").nth(1).expect("a marked cell");
    assert!(cell.contains("▼") && cell.contains("flip ratio"), "{cell:.200}");
    study.manifest.seeds = vec![1];
    let (_, page) = written(&mut study, false);
    assert!(page.contains("<span class=\"why\">one seed: no interval</span>"), "no reason");
}

#[test]
fn each_run_is_a_line_of_the_table_with_its_cpu_seconds() {
    let mut study = two();
    study.runs[0].cpu_s = Some(0.25);
    let (folder, _) = written(&mut study, false);
    let mut reader = csv::Reader::from_path(folder.path().join("runs.csv")).unwrap();
    let head = reader.headers().unwrap().clone();
    let column = |name: &str| head.iter().position(|h| h == name).unwrap_or_else(|| panic!("no {name}: {head:?}"));
    let lines: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(lines.len(), study.runs.len());
    for (line, run) in lines.iter().zip(&study.runs) {
        assert_eq!(line[column("relmse")].parse::<f64>().unwrap(), run.errors.get("relmse"));
        assert_eq!(
            (&line[column("seed")], &line[column("sampler")]),
            (run.seed.to_string().as_str(), run.method.sampler.as_str())
        );
    }
    assert_eq!((&lines[0][column("cpu_seconds")], &lines[1][column("cpu_seconds")]), ("0.25", ""));
    assert_eq!((&lines[0][column("budget")], &lines[0][column("budget_spp")]), ("spp", "4"));
}

/// Images that are too large for the page are embedded smaller, and lie beside it at full resolution.
#[test]
fn large_images_lie_beside_the_page() {
    let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
    let mut study = Study::new(&["a"], &laws, &[4], None, 2).resized([1024, 640]);
    let (folder, page) = written(&mut study, true);
    for name in ["uniform-none", "mitchell-none", "reference"] {
        assert!(page.contains(&format!("data-full=\"viewer/a/{name}.png\"")), "{name}");
        let png = std::fs::read(folder.path().join(format!("viewer/a/{name}.png"))).unwrap();
        assert_eq!((&png[16..20], &png[20..24]), (&1024_u32.to_be_bytes()[..], &640_u32.to_be_bytes()[..]), "{name}");
    }
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
}

/// Runs of older versions lack a metric that was added since.
#[test]
fn a_metric_that_runs_lack_is_empty_in_all_tables() {
    for seeds in [1, 3] {
        let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
        let mut study = Study::new(&["a"], &laws, &[4, 8], Some(8), seeds);
        study.runs.iter_mut().for_each(|run| run.errors.set("flip", f64::NAN));
        let (folder, page) = written(&mut study, false);
        assert!(!page.contains("NaN"));
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(!read("summary.csv").contains("NaN") && !read("runs.csv").contains("NaN"));
        let text = read("runs.jsonl");
        assert!(text.contains("\"flip\":null"));
        std::fs::write(folder.path().join("runs.jsonl"), text.replace(",\"flip\":null", "")).unwrap();
        let _ = write_report(folder.path()).unwrap();
        assert!(std::fs::read_to_string(folder.path().join("report.html")).unwrap() == page);
    }
}

#[test]
fn charts_are_whole_drawings_with_a_curve_for_each_method() {
    let mut study = example();
    let (_, page) = written(&mut study, false);
    let charts: Vec<&str> =
        page.split("class=\"chart\"").skip(1).map(|rest| &rest[rest.find("<svg").unwrap()..]).collect();
    assert_eq!(charts.len(), 4);
    let curves = study.manifest.methods.len();
    for chart in charts {
        let chart = &chart[..chart.find("</svg>").unwrap() + 6];
        let drawing = roxmltree::Document::parse(chart).unwrap();
        let count = |tag: &str| drawing.descendants().filter(|node| node.tag_name().name() == tag).count();
        assert_eq!((count("polyline"), count("polygon")), (curves, curves));
        // A point of each curve for each budget, inside the frame.
        let numbers = drawing.descendants().filter_map(|node| node.attribute("points"));
        for place in numbers.flat_map(|points| points.split(' ')) {
            let (x, y) = place.split_once(',').unwrap();
            let [x, y] = [x, y].map(|text| text.parse::<f64>().unwrap());
            assert!((74.0..=464.0).contains(&x) && (12.0..=294.0).contains(&y), "{place}");
        }
        assert_eq!(chart.matches("transform=\"translate").count(), curves * study.manifest.spp.len());
        assert!(chart.contains(">relMSE</text>") && chart.matches("<text").count() > 8);
    }
}
