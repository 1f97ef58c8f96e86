//! Reports of studies with known results; page and table agree.

use crate::synthesis::{Law, Study, errors, example};
use dapple_study::summary::{RatioVerdict, Row};
use dapple_study::{RunBudget, Summary, write_report};
use std::collections::BTreeMap;
use std::path::Path;

struct Written {
    summary: Summary,
    page: String,
    table: Vec<Vec<String>>,
}

fn write(study: &mut Study, images: bool) -> Written {
    let folder = tempfile::tempdir().unwrap();
    study.write(folder.path(), images);
    read(folder.path())
}

fn read(folder: &Path) -> Written {
    let summary = write_report(folder).unwrap();
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    let mut reader = csv::Reader::from_path(folder.join("summary.csv")).unwrap();
    let headers: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let columns = ["scene", "sampler", "points", "filter", "budget", "metric", "value", "low", "high", "n", "note"];
    assert_eq!(headers, columns);
    let table = reader.records().map(|line| line.unwrap().iter().map(String::from).collect()).collect();
    Written { summary, page, table }
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
        let shown = text.trim_end_matches(['†', '‡', '§', '¶']).replace('−', "-");
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

fn row<'a>(found: &'a Written, study: &Study, method: usize, budget: Option<RunBudget>, metric: &str) -> &'a Row {
    let words = budget.map_or_else(String::new, |budget| budget.to_string());
    let scene = &study.manifest.scenes[0].name;
    let method = &study.manifest.methods[method];
    let row = found.summary.find(scene, method, &words, metric);
    row.unwrap_or_else(|| panic!("no {metric} of {method:?} at {words}"))
}

fn verdict(found: &Written, study: &Study, method: usize, budget: RunBudget, metric: &str) -> RatioVerdict {
    RatioVerdict::of(row(found, study, method, Some(budget), metric)).unwrap()
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
    for metric in
        ["relmse ratio", "flip ratio", "relmse", "seconds trace", "relmse slope over spp", "relmse part of both"]
    {
        let missing = found.summary.rows().iter().filter(|r| r.metric == metric && !shown.contains(&r.key())).count();
        // The factorial is shown at the first budget only.
        let expected = match metric {
            "relmse part of both" => 5 * 2 * 2,
            "seconds trace" => 5 * 2 * 6,
            _ => 0,
        };
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
    let mut study = Study::new(&scenes, &laws, &[4, 8, 16, 32], Some(16), 4).resized([128, 96]);
    let found = write(&mut study, true);
    assert!(found.page.len() < 6_000_000, "{} bytes", found.page.len());
    assert_eq!(differences(&found.page, &found.table), Vec::<String>::new());
}

#[test]
fn a_slope_of_minus_one_is_found_exactly_and_another_is_not() {
    let laws = [Law::new("uniform", "none").deviation(0.0), Law::new("half", "none").deviation(0.0).slope(-0.5)];
    let mut study = Study::new(&["a"], &laws, &SPP, None, 4);
    let found = write(&mut study, false);
    for (method, slope) in [(0, -1.0), (1, -0.5)] {
        for metric in ["relmse slope over spp", "relmse slope over seconds"] {
            let row = row(&found, &study, method, None, metric);
            assert!((row.value.unwrap() - slope).abs() < 1e-12, "{row:?}");
            assert!((row.low.unwrap() - slope).abs() < 1e-12 && (row.high.unwrap() - slope).abs() < 1e-12);
        }
    }
}

/// With noise of 20 % in each seed, the interval of 16 seeds contains -1 and is narrow. That of a slope of -0.85 does
/// not contain -1. One study with a fixed seed; a false alarm has a probability of 5 %.
#[test]
fn a_noisy_slope_has_an_interval_that_holds_it() {
    let laws = [Law::new("uniform", "none").deviation(0.2), Law::new("slow", "none").deviation(0.2).slope(-0.85)];
    let mut study = Study::new(&["a"], &laws, &SPP, None, 16);
    let found = write(&mut study, false);
    let [low, high] = row(&found, &study, 0, None, "relmse slope over spp").interval().unwrap();
    assert!(low < -1.0 && -1.0 < high && high - low < 0.2, "[{low}, {high}]");
    assert!(row(&found, &study, 1, None, "relmse slope over spp").low.unwrap() > -1.0);
}

/// A filter that changes nothing and doubles the time loses at equal time. One that takes no time does not.
#[test]
fn a_slowed_filter_loses_at_equal_time() {
    let laws = [
        Law::new("uniform", "none"),
        Law::new("uniform", "slowed").seconds(0.02),
        Law::new("uniform", "free").seconds(0.01),
    ];
    let mut study = Study::new(&["a"], &laws, &SPP, Some(16), 16);
    let found = write(&mut study, false);
    for metric in ["relmse ratio", "relmse_trimmed ratio", "srgb8_mse ratio", "flip ratio"] {
        assert_eq!(verdict(&found, &study, 1, TIMED, metric), RatioVerdict::Loss, "{metric}");
        assert_eq!(verdict(&found, &study, 2, TIMED, metric), RatioVerdict::Undecided, "{metric}");
    }
    let ratio = row(&found, &study, 1, Some(TIMED), "relmse ratio");
    assert!((ratio.value.unwrap() - 2.0).abs() < 0.15, "{ratio:?}");
    // At equal samples the error is undecided, and error times time is lost.
    assert_eq!(verdict(&found, &study, 1, RunBudget::Spp(16), "relmse ratio"), RatioVerdict::Undecided);
    assert_eq!(verdict(&found, &study, 1, RunBudget::Spp(16), "relmse x seconds ratio"), RatioVerdict::Loss);
    let [time] = study_level(&found, &study, 1);
    assert!((time - 2.0).abs() < 0.15, "{time}");
    assert!(found.page.contains("loses on"));
}

/// The time to the middle level, over the baseline's.
fn study_level(found: &Written, study: &Study, method: usize) -> [f64; 1] {
    let method = &study.manifest.methods[method];
    let ratios: Vec<&Row> = found
        .summary
        .rows()
        .iter()
        .filter(|r| r.method == *method && r.metric.starts_with("seconds ratio to relmse 0.1"))
        .collect();
    assert_eq!(ratios.len(), 1, "{ratios:?}");
    assert!(ratios[0].note.contains("paired by seed"), "{ratios:?}");
    [ratios[0].value.unwrap()]
}

/// With twice the time under the name of equal time, a tenth less error is no win.
#[test]
fn unequal_time_wins_nothing() {
    let laws =
        [Law::new("uniform", "none"), Law::new("late", "none").errors(0.8), Law::new("fair", "none").errors(0.8)];
    let mut study = Study::new(&["a"], &laws, &SPP, Some(16), 16);
    for run in study.runs.iter_mut().filter(|run| run.method.sampler == "late") {
        run.render_s *= 2.0;
    }
    let found = write(&mut study, false);
    assert_eq!(verdict(&found, &study, 1, TIMED, "relmse ratio"), RatioVerdict::Undecided);
    assert!(row(&found, &study, 1, Some(TIMED), "relmse ratio").note.contains("2.00 times the time"));
    assert_eq!(verdict(&found, &study, 2, TIMED, "relmse ratio"), RatioVerdict::Win);
    assert!(row(&found, &study, 2, Some(TIMED), "relmse ratio").note.contains("holds for all together"));
}

/// Two names of one sampler: of 120 comparisons, 106 to 119 of the 95 % intervals contain 1. Fewer or more have a
/// probability of 4e-3. The intervals for all together all contain 1. The negative control, 15 % apart, is found.
#[test]
fn a_sampler_against_itself_wins_nothing() {
    let laws = [Law::new("uniform", "none"), Law::new("twin", "none"), Law::new("worse", "none").errors(1.15)];
    let names: Vec<String> = (0..40).map(|i| format!("scene {i}")).collect();
    let scenes: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut study = Study::new(&scenes, &laws, &[4, 16], Some(16), 8);
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
    let mut study = Study::new(&["a"], &itself, &SPP, Some(16), 4);
    let found = write(&mut study, false);
    let row = row(&found, &study, 1, Some(TIMED), "relmse ratio");
    assert_eq!((row.value, row.low, row.high), (Some(1.0), Some(1.0), Some(1.0)));
    assert_eq!(RatioVerdict::of(row), Some(RatioVerdict::Undecided));
}

/// With effects of 0.8 for counts, 0.5 for the filter and 0.3 for both, the parts are found. So is their interaction,
/// 0.75.
#[test]
fn the_factorial_separates_counts_filter_and_interaction() {
    let exact = |sampler, filter, scale| Law::new(sampler, filter).deviation(0.0).errors(scale);
    let laws = [
        exact("uniform", "none", 1.0),
        exact("adaptive", "none", 0.8),
        exact("uniform", "gaussian", 0.5),
        exact("adaptive", "gaussian", 0.3),
        exact("adaptive", "lonely", 0.1),
    ];
    let mut study = Study::new(&["a"], &laws, &[4], Some(4), 3);
    let found = write(&mut study, false);
    let parts = [("counts", 0.8), ("filter", 0.5), ("both", 0.3), ("their interplay", 0.75)];
    for (part, expected) in parts {
        let row = row(&found, &study, 3, Some(RunBudget::TimeOf(4)), &format!("relmse part of {part}"));
        assert!((row.value.unwrap() - expected).abs() < 1e-12, "{row:?}");
    }
    let lonely = &study.manifest.methods[4];
    assert!(found.summary.find("a", lonely, "time of 4 spp", "relmse part of both").is_none(), "no square of four");
}

/// At error 1/t the baseline reaches 0.1 at 0.1 s, and a method of twice the cost at 0.2 s. A curve that ends before
/// the level does not count as measured there.
#[test]
fn time_to_an_error_is_interpolated_and_nothing_else_passes_for_it() {
    let laws = [
        Law::new("uniform", "none").deviation(0.0),
        Law::new("slow", "none").deviation(0.0).seconds(0.02),
        Law::new("bad", "none").deviation(0.0).errors(6.0),
        Law::new("hopeless", "none").deviation(0.0).errors(100.0),
    ];
    let mut study = Study::new(&["a"], &laws, &SPP, None, 3);
    let found = write(&mut study, false);
    let metric = "seconds to relmse 0.1";
    let expected = [(0, 0.1), (1, 0.2)];
    for (method, seconds) in expected {
        let row = row(&found, &study, method, None, metric);
        assert!((row.value.unwrap() - seconds).abs() < 1e-12 && row.interval().is_some(), "{row:?}");
    }
    let extrapolated = row(&found, &study, 2, None, metric);
    assert!((extrapolated.value.unwrap() - 0.6).abs() < 1e-9, "{extrapolated:?}");
    assert!(extrapolated.interval().is_none() && extrapolated.note.contains("extrapolated"));
    assert!(found.page.contains("†"));
    let hopeless = row(&found, &study, 3, None, metric);
    assert_eq!(hopeless.value, None);
    assert!(hopeless.note.contains("not reached by 0.32"), "{hopeless:?}");
}

/// If half of the seeds do not reach the level, the others alone would flatter the method.
#[test]
fn seeds_that_do_not_reach_an_error_are_not_left_out() {
    let laws = [Law::new("uniform", "none").deviation(0.0), Law::new("uneven", "none").deviation(0.0)];
    let mut study = Study::new(&["a"], &laws, &[4, 8, 16, 64], None, 4);
    for run in study.runs.iter_mut().filter(|run| run.method.sampler == "uneven") {
        run.errors = errors(run.errors.relmse * if run.seed % 2 == 0 { 0.7 } else { 1.6 });
    }
    let found = write(&mut study, false);
    let low =
        found.summary.rows().iter().find(|r| r.metric == "seconds to relmse 0.02" && r.method.sampler == "uneven");
    let low = low.unwrap();
    assert!(low.interval().is_none() && low.note.contains("2 of 4 seeds cross"), "{low:?}");
}

/// Odd studies neither break the page nor put a NaN on it.
#[test]
fn odd_studies_have_a_report_with_remarks() {
    let laws = [Law::new("uniform", "none"), Law::new("mitchell", "none")];
    let whole = || Study::new(&["a"], &laws, &SPP, Some(16), 4);
    let mut cases: Vec<(&str, Study, &str)> = Vec::new();
    cases.push(("one seed", Study::new(&["a"], &laws, &SPP, Some(16), 1), "One seed: there are no intervals"));
    cases.push(("one method", Study::new(&["a"], &laws[..1], &SPP, None, 4), "the study has one method"));
    cases.push(("one budget", Study::new(&["a"], &laws, &[16], None, 4), "one budget: no slope"));
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
        (run.errors.relmse, run.errors.mse) = (-1e-9, 0.0);
    }
    cases.push(("corrected below 0", study, "arithmetic mean: 1 of 4 values are not above 0"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.errors = errors(0.0));
    study.runs.iter_mut().for_each(|run| run.errors.psnr = 1e6);
    cases.push(("exact", study, "No errors above 0 to draw"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.image = Some("images/gone.exr".into()));
    cases.push(("no images", study, "Not shown: images/gone.exr"));
    let mut study = whole();
    study.runs.iter_mut().for_each(|run| run.render_s = 0.0);
    cases.push(("no time", study, "a value is not above 0: no slope"));
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
    let mut study = Study::new(&["a&b'<i>"], &laws, &[4, 8], Some(8), 2);
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
    let mut study = Study::new(&["a"], &[Law::new("uniform", "none")], &[4, 8], None, 2);
    study.write(folder.path(), false);
    let runs = folder.path().join("runs.jsonl");
    let whole = std::fs::read_to_string(&runs).unwrap();
    // A full disk leaves an incomplete last line.
    std::fs::write(&runs, &whole[..whole.len() - 30]).unwrap();
    assert!(read(folder.path()).page.contains("3 of 4 runs are done"));
    std::fs::write(&runs, whole.replacen("\"seed\":1", "\"seed\":x", 1)).unwrap();
    assert!(error(folder.path()).contains("runs.jsonl:1: "));
    std::fs::write(&runs, whole.repeat(2)).unwrap();
    assert!(read(folder.path()).page.contains("4 runs were made twice"));
    study.manifest.baseline.filter = "other".into();
    study.write(folder.path(), false);
    assert!(error(folder.path()).contains("baseline"));
}

#[test]
fn other_pages_get_tables_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let study = &mut example();
    study.write(folder.path(), false);
    let found = read(folder.path());
    let tables = std::fs::read_to_string(folder.path().join("summary.md")).unwrap();
    // The page's values are the table's, in the order of its lines.
    let timed = RunBudget::TimeOf(study.manifest.time_of.unwrap()).to_string();
    let of_page: Vec<String> = figures(&found.page)
        .into_iter()
        .filter(|f| f[0].ends_with(&format!("|{timed}|relmse ratio")))
        .map(|f| f[4].clone())
        .collect();
    let compared = study.manifest.scenes.len() * (study.manifest.methods.len() - 1);
    assert!(of_page.len() >= compared, "{of_page:?}");
    let of_tables: Vec<&str> = tables
        .lines()
        .skip_while(|line| !line.starts_with("| scene | method |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.split(" | ").nth(3).unwrap().split(' ').next().unwrap())
        .collect();
    assert_eq!(of_tables.len(), compared);
    assert!(of_tables.iter().all(|figure| of_page.iter().any(|f| f == figure)), "{of_tables:?} {of_page:?}");
    for scene in &study.manifest.scenes {
        let plot = std::fs::read_to_string(folder.path().join(format!("plots/{}.svg", scene.name))).unwrap();
        assert!(plot.starts_with("<svg xmlns") && plot.contains("prefers-color-scheme: dark"));
        let drawing = roxmltree::Document::parse(&plot).unwrap_or_else(|e| panic!("{}: {e}", scene.name));
        assert!(
            drawing.descendants().filter(|node| node.has_tag_name(("http://www.w3.org/2000/svg", "svg"))).count() > 2
        );
        let curves = plot.matches("stroke-dasharray").count();
        assert!(curves >= 2 * study.manifest.methods.len(), "a line in the plot and one in the legend each: {curves}");
        for used in plot.split("var(").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            assert!(plot.contains(&format!("{used}: #")), "{used} has no colour");
        }
    }
}
