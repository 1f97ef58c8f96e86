//! Reports of studies with known results, and the files beside them; page and tables agree.

use crate::support::{Law, MadeUp, errors, example};
use dapple_study::summary::{RatioVerdict, Row};
use dapple_study::{RunBudget, Summary, write_report};
use std::collections::BTreeMap;
use std::path::Path;
use tempfile::TempDir;

struct Written {
    folder: TempDir,
    summary: Summary,
    page: String,
    table: Vec<Vec<String>>,
}

fn write(study: &mut MadeUp, images: bool) -> Written {
    let folder = tempfile::tempdir().unwrap();
    study.write(folder.path(), images);
    report(folder)
}

fn page(folder: &Path) -> (Summary, String) {
    (write_report(folder).unwrap(), std::fs::read_to_string(folder.join("report.html")).unwrap())
}

fn report(folder: TempDir) -> Written {
    let (summary, page) = page(folder.path());
    let mut reader = csv::Reader::from_path(folder.path().join("summary.csv")).unwrap();
    let headers: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let columns = ["scene", "sampler", "points", "filter", "budget", "metric", "value", "low", "high", "n", "note"];
    assert_eq!(headers, columns);
    let table = reader.records().map(|line| line.unwrap().iter().map(String::from).collect()).collect();
    Written { folder, summary, page, table }
}

/// The page's `<data>` elements: key, value, low, high, and the visible text.
fn figures(page: &str) -> Vec<[String; 5]> {
    let unescape = |s: &str| {
        let pairs = [("&#60;", "<"), ("&#62;", ">"), ("&#34;", "\""), ("&#39;", "'"), ("&#38;", "&")];
        pairs.iter().fold(s.to_owned(), |s, (from, to)| s.replace(from, to))
    };
    let parse = |element: &str| {
        let (tag, rest) = element.split_once('>').unwrap();
        let attribute = |name: &str| {
            let (_, after) = tag.split_once(&format!("{name}=\"")).unwrap_or_else(|| panic!("{tag} has no {name}"));
            unescape(after.split_once('"').unwrap().0)
        };
        let text = unescape(rest.split_once("</data>").unwrap().0);
        [attribute("data-key"), attribute("value"), attribute("data-low"), attribute("data-high"), text]
    };
    page.split("<data ").skip(1).map(parse).collect()
}

/// The differences between page and table.
fn differences(page: &str, table: &[Vec<String>]) -> Vec<String> {
    let rows: BTreeMap<String, &Vec<String>> = table.iter().map(|line| (line[..6].join("|"), line)).collect();
    let mut wrong = Vec::new();
    if rows.len() != table.len() {
        wrong.push("summary.csv has two lines of one figure".into());
    }
    for [key, value, low, high, text] in figures(page) {
        let Some(row) = rows.get(&key) else {
            wrong.push(format!("{key} is not in summary.csv"));
            continue;
        };
        if [&value, &low, &high] != [&row[6], &row[7], &row[8]] {
            wrong.push(format!("{key}: {value} [{low}, {high}] on the page, {:?} in summary.csv", &row[6..9]));
        }
        let shown = text.trim_end_matches(['§', '¶']).replace('−', "-");
        match (shown.parse::<f64>(), value.parse::<f64>()) {
            (Ok(rounded), Ok(exact)) if (rounded - exact).abs() <= 1.000_001 * half_unit(&shown) => {}
            (Err(_), Err(_)) if shown == "–" => {}
            _ => wrong.push(format!("{key}: {text} is shown for {value}")),
        }
    }
    wrong
}

/// Half a unit of a number's last digit: the largest rounding error.
fn half_unit(number: &str) -> f64 {
    let (digits, exponent) = number.split_once('e').unwrap_or((number, "0"));
    let decimals = digits.split_once('.').map_or(0, |(_, after)| after.len() as i32);
    0.5 * 10.0_f64.powi(exponent.parse::<i32>().unwrap() - decimals)
}

fn row<'a>(found: &'a Written, study: &MadeUp, method: usize, budget: RunBudget, metric: &str) -> &'a Row {
    let words = budget.to_string();
    let scene = &study.manifest.scenes[0].name;
    let method = &study.manifest.methods[method];
    let row = found.summary.find(scene, method, &words, metric);
    row.unwrap_or_else(|| panic!("no {metric} of {method:?} at {words}"))
}

fn verdict(found: &Written, study: &MadeUp, method: usize, budget: RunBudget, metric: &str) -> RatioVerdict {
    RatioVerdict::of(row(found, study, method, budget, metric)).unwrap()
}

const SPP: [u64; 4] = [4, 8, 16, 32];
const TIMED: RunBudget = RunBudget::TimeOf(16);

#[test]
fn the_page_and_the_table_agree() {
    let found = write(&mut example(), true);
    assert_eq!(differences(&found.page, &found.table), Vec::<String>::new());
    assert!(figures(&found.page).len() > 500);
    // The page lacks none of the comparisons.
    let shown: Vec<String> = figures(&found.page).into_iter().map(|f| f[0].clone()).collect();
    for metric in ["relmse ratio", "flip ratio", "relmse", "seconds trace", "smape ratio"] {
        let missing = found.summary.rows().iter().filter(|r| r.metric == metric && !shown.contains(&r.key())).count();
        // Phases are shown at the first budget only.
        let expected = if metric == "seconds trace" { 5 * 2 * 6 } else { 0 };
        assert_eq!(missing, expected, "{metric}");
    }
    // The negative control: one digit of one figure, and one line.
    let mut table = found.table.clone();
    let line = table.iter_mut().find(|l| l[5] == "relmse ratio" && l[6].len() > 4).unwrap();
    line[6].push('1');
    assert!(!differences(&found.page, &table).is_empty());
    let less: Vec<_> = found.table.iter().filter(|l| l[5] != "flip ratio").cloned().collect();
    assert!(!differences(&found.page, &less).is_empty());
}

#[test]
fn the_same_study_gives_the_same_bytes() {
    let [a, b] = [write(&mut example(), true), write(&mut example(), true)];
    assert!(a.page == b.page && a.table == b.table);
    assert!(a.page.len() < 3_000_000, "{} bytes", a.page.len());
}

/// A study of seven scenes with fifteen methods has a page that still fits into a mail.
#[test]
fn a_large_study_has_a_page_of_a_few_megabytes() {
    let mut laws = Vec::new();
    for (i, sampler) in ["uniform", "variance", "mitchell", "cluster", "cluster-thesis"].into_iter().enumerate() {
        for (j, filter) in ["none", "gaussian", "cluster-gaussian"].into_iter().enumerate() {
            let (i, j) = (i as f64, j as f64);
            let law = Law::new(sampler, filter).errors(1.2 - 0.2 * i - 0.15 * j).slope(-1.2 + 0.1 * j);
            laws.push(law.overhead(0.01 * (i + j)));
        }
    }
    let scenes = ["cornell", "teapot", "garden", "glass", "hall", "dof", "terrain"];
    let mut study = MadeUp::new(&scenes, &laws, &[4, 8, 16, 32], None, 4).resized([128, 96]);
    let found = write(&mut study, true);
    assert!(found.page.len() < 6_000_000, "{} bytes", found.page.len());
    assert_eq!(differences(&found.page, &found.table), Vec::<String>::new());
}

/// A filter that changes nothing and doubles the time loses at equal time. One that takes no time does not.
#[test]
fn a_slowed_filter_loses_at_equal_time() {
    let laws = [
        Law::new("uniform", "none"),
        Law::new("uniform", "slowed").seconds(0.02),
        Law::new("uniform", "free").seconds(0.01),
    ];
    let mut study = MadeUp::new(&["a"], &laws, &SPP, Some(16), 16);
    let found = write(&mut study, false);
    for metric in ["relmse ratio", "relmse_trimmed ratio", "srgb8_mse ratio", "flip ratio"] {
        assert_eq!(verdict(&found, &study, 1, TIMED, metric), RatioVerdict::Loss, "{metric}");
        assert_eq!(verdict(&found, &study, 2, TIMED, metric), RatioVerdict::Undecided, "{metric}");
    }
    let ratio = row(&found, &study, 1, TIMED, "relmse ratio");
    assert!((ratio.value.unwrap() - 2.0).abs() < 0.15, "{ratio:?}");
    // At equal samples the error is undecided, and error times time is lost.
    assert_eq!(verdict(&found, &study, 1, RunBudget::Spp(16), "relmse ratio"), RatioVerdict::Undecided);
    assert_eq!(verdict(&found, &study, 1, RunBudget::Spp(16), "relmse x seconds ratio"), RatioVerdict::Loss);
    assert!(found.page.contains("loses on"));
}

/// A method with a tenth less error does not win if its equal-time runs take twice the time.
#[test]
fn unequal_time_wins_nothing() {
    let laws =
        [Law::new("uniform", "none"), Law::new("late", "none").errors(0.8), Law::new("fair", "none").errors(0.8)];
    let mut study = MadeUp::new(&["a"], &laws, &SPP, Some(16), 16);
    for run in study.runs.iter_mut().filter(|run| run.method.sampler == "late") {
        run.render_s *= 2.0;
    }
    let found = write(&mut study, false);
    assert_eq!(verdict(&found, &study, 1, TIMED, "relmse ratio"), RatioVerdict::Undecided);
    assert!(row(&found, &study, 1, TIMED, "relmse ratio").note.contains("2.00 times the time"));
    assert_eq!(verdict(&found, &study, 2, TIMED, "relmse ratio"), RatioVerdict::Win);
    assert!(row(&found, &study, 2, TIMED, "relmse ratio").note.contains("holds for all together"));
}

/// Two names of one sampler: of 120 comparisons, 106 to 119 of the 95 % intervals contain 1. Other numbers have a probability
/// of 4e-3. All intervals at joint confidence contain 1. The negative control, 15 % apart, is found.
#[test]
fn a_sampler_against_itself_wins_nothing() {
    let laws = [Law::new("uniform", "none"), Law::new("twin", "none"), Law::new("worse", "none").errors(1.15)];
    let names: Vec<String> = (0..40).map(|i| format!("scene {i}")).collect();
    let scenes: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut study = MadeUp::new(&scenes, &laws, &[4, 16], Some(16), 8);
    let found = write(&mut study, false);
    let of = |method: usize| -> Vec<&Row> {
        let method = &study.manifest.methods[method];
        found.summary.rows().iter().filter(|r| r.method == *method && r.metric == "relmse ratio").collect()
    };
    let twin = of(1);
    assert_eq!(twin.len(), 120);
    let undecided = twin.iter().filter(|r| RatioVerdict::of(r) == Some(RatioVerdict::Undecided)).count();
    assert!((106..120).contains(&undecided), "{undecided} of 120");
    assert!(twin.iter().all(|r| !r.note.contains("holds for all together")));
    assert!(of(2).iter().filter(|r| RatioVerdict::of(r) == Some(RatioVerdict::Loss)).count() > 100);
    // Exactly equal numbers: a ratio of exactly 1.
    let itself = [laws[0].clone(), Law { method: laws[1].method.clone(), ..laws[0].clone() }];
    let mut study = MadeUp::new(&["a"], &itself, &SPP, Some(16), 4);
    let found = write(&mut study, false);
    let row = row(&found, &study, 1, TIMED, "relmse ratio");
    assert_eq!((row.value, row.low, row.high), (Some(1.0), Some(1.0), Some(1.0)));
    assert_eq!(RatioVerdict::of(row), Some(RatioVerdict::Undecided));
}

/// Odd studies neither break the page nor put a NaN on it.
#[test]
fn odd_studies_have_a_report_with_remarks() {
    let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
    let whole = || MadeUp::new(&["a"], &laws, &SPP, Some(16), 4);
    let mut cases: Vec<(&str, MadeUp, &str)> = Vec::new();
    cases.push(("one seed", MadeUp::new(&["a"], &laws, &SPP, Some(16), 1), "One seed: there are no intervals"));
    cases.push(("one method", MadeUp::new(&["a"], &laws[..1], &SPP, None, 4), "the study has one method"));
    cases.push(("one budget", MadeUp::new(&["a"], &laws, &[16], None, 4), "There are no equal-time runs"));
    let mut study = whole();
    study.runs.retain(|run| run.method.sampler == "uniform" && run.seed == 1);
    cases.push(("cut short", study, "5 of 40 runs are done"));
    let mut study = whole();
    study.runs.clear();
    cases.push(("no runs", study, "no run is done"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.reference_limited = true);
    cases.push(("limited", study, "reference-limited in 4 of 4"));
    let mut study = whole();
    for run in study.runs.iter_mut().filter(|run| run.seed == 2) {
        run.errors.set("relmse", -1e-9);
        run.errors.set("mse", 0.0);
    }
    cases.push(("corrected below 0", study, "arithmetic mean: 1 of 4 values are not above 0"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.errors = errors(0.0));
    study.runs.iter_mut().for_each(|run| run.errors.set("psnr", 1e6));
    cases.push(("exact", study, "No errors above 0 to draw"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.image = Some("images/gone.exr".into()));
    cases.push(("no images", study, "Not shown: images/gone.exr"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.render_s = 0.0);
    cases.push(("no time", study, "no ratio: a value is not above 0"));
    let mut study = whole();
    study.manifest.scenes.clear();
    cases.push(("no scenes", study, "belong to no scene"));
    for (name, mut study, words) in cases {
        let found = write(&mut study, false);
        assert!(found.page.contains(words), "{name}: no “{words}”");
        assert_eq!(differences(&found.page, &found.table), Vec::<String>::new(), "{name}");
        let numbers = found.table.iter().flat_map(|line| &line[6..9]);
        let bad = numbers.filter(|v| !v.is_empty() && !v.parse::<f64>().is_ok_and(f64::is_finite)).count();
        assert_eq!(bad, 0, "{name}");
        assert!(!found.page.contains("NaN") && !found.page.contains(">inf"), "{name}");
        for line in found.table.iter().filter(|line| line[6].is_empty()) {
            assert!(!line[10].is_empty(), "{name}: {line:?} lacks the reason for the missing value");
        }
    }
}

#[test]
fn names_cannot_break_the_page() {
    let laws = [Law::new("uniform", "none"), Law::new("<script>alert(1)</script>", "\"><img src=x>")];
    let mut study = MadeUp::new(&["a&b'<i>"], &laws, &[4, 8], Some(8), 2);
    study.runs.iter_mut().for_each(|run| run.image = Some("<b>gone</b>".into()));
    let found = write(&mut study, false);
    assert!(
        !found.page.contains("<script>alert") && !found.page.contains("<img src=x") && !found.page.contains("<b>gone")
    );
    assert_eq!(differences(&found.page, &found.table), Vec::<String>::new());
}

#[test]
fn broken_records_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = |folder: &Path| write_report(folder).unwrap_err().to_string();
    assert!(error(folder.path()).contains("study.json"));
    let mut study = MadeUp::new(&["a"], &[Law::new("uniform", "none")], &[4, 8], None, 2);
    study.write(folder.path(), false);
    let runs = folder.path().join("runs.jsonl");
    let whole = std::fs::read_to_string(&runs).unwrap();
    // A full disk leaves an incomplete last line.
    std::fs::write(&runs, &whole[..whole.len() - 30]).unwrap();
    assert!(page(folder.path()).1.contains("3 of 4 runs are done"));
    std::fs::write(&runs, whole.replacen("\"seed\":1", "\"seed\":x", 1)).unwrap();
    assert!(error(folder.path()).contains("runs.jsonl:1: "));
    std::fs::write(&runs, whole.repeat(2)).unwrap();
    assert!(page(folder.path()).1.contains("Repeated runs, of which only the last counts: 4."));
    study.manifest.baseline.filter = "other".into();
    study.write(folder.path(), false);
    assert!(error(folder.path()).contains("baseline"));
}

fn two() -> MadeUp {
    MadeUp::new(&["a"], &[Law::new("uniform", "none"), Law::new("mitchell", "none")], &[4, 8], Some(8), 3)
}

#[test]
fn every_link_of_the_page_leads_to_a_file() {
    let Written { folder, page, .. } = write(&mut example(), true);
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
    let Written { page, .. } = write(&mut study, false);
    assert!(!page.contains("The machine was busy"));
    for run in study.runs.iter_mut().take(3) {
        run.load = Some(5.25);
    }
    let Written { page, .. } = write(&mut study, false);
    let warning = "the load was up to 5.2 on 2 cores, and above the cores before 3 of 18 runs";
    assert!(page.find(warning).is_some_and(|at| at < page.find("<main>").unwrap()), "no warning");
    // The load of the study's own threads causes no warning.
    study.manifest.machine.cores = Some(6);
    let Written { page, .. } = write(&mut study, false);
    assert!(!page.contains("The machine was busy"));
}

#[test]
fn an_unknown_commit_is_named_with_the_version() {
    let mut study = two();
    assert!(write(&mut study, false).page.contains("Made by Dapple 0.1.0, commit 0123abc+."));
    study.manifest.commit = None;
    assert!(write(&mut study, false).page.contains("commit unknown (version 0.1.0 was built without git)"));
}

#[test]
fn undecided_and_losses_in_flip_are_explained_where_they_stand() {
    let mut study = two();
    let Written { page, .. } = write(&mut study, false);
    let verdicts = page.split("id=\"verdicts\"").nth(1).unwrap();
    assert!(verdicts.contains("<span class=\"why\">the interval contains 1</span>"), "no reason");
    // A third of the error in relMSE, twice that in FLIP.
    for run in study.runs.iter_mut().filter(|run| run.method.sampler == "mitchell") {
        run.errors.set("relmse", 0.3 * run.errors.get("relmse"));
        run.errors.set("flip", 2.0 * run.errors.get("flip"));
    }
    let Written { page, .. } = write(&mut study, false);
    assert!(page.contains("loses in FLIP on") && page.contains("▼ 1 lost"), "no loss in FLIP");
    let cell = page.split("<td class=\"num loss\">").nth(1).expect("a marked cell");
    assert!(cell.contains("▼") && cell.contains("flip ratio"), "{cell:.200}");
    study.manifest.seeds = vec![1];
    let Written { page, .. } = write(&mut study, false);
    assert!(page.contains("<span class=\"why\">one seed: no interval</span>"), "no reason");
}

#[test]
fn each_run_is_a_line_of_the_table_with_its_cpu_seconds() {
    let mut study = two();
    study.runs[0].cpu_s = Some(0.25);
    let Written { folder, .. } = write(&mut study, false);
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
    let mut study = MadeUp::new(&["a"], &laws, &[4], None, 2).resized([640, 400]);
    let Written { folder, page, .. } = write(&mut study, true);
    for name in ["uniform-none", "mitchell-none", "reference"] {
        assert!(page.contains(&format!("data-full=\"viewer/a/{name}.png\"")), "{name}");
        let png = std::fs::read(folder.path().join(format!("viewer/a/{name}.png"))).unwrap();
        assert_eq!((&png[16..20], &png[20..24]), (&640_u32.to_be_bytes()[..], &400_u32.to_be_bytes()[..]), "{name}");
    }
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
}

/// Runs of older versions lack a metric added later.
#[test]
fn a_metric_that_runs_lack_is_empty_in_all_tables() {
    for seeds in [1, 3] {
        let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
        let mut study = MadeUp::new(&["a"], &laws, &[4, 8], Some(8), seeds);
        study.runs.iter_mut().for_each(|run| run.errors.set("flip", f64::NAN));
        let Written { folder, page, .. } = write(&mut study, false);
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
    let Written { page, .. } = write(&mut study, false);
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
