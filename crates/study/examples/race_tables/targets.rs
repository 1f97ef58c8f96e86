//! Goals beside measured values.

use crate::board::{At, Board, Figure, Metric};
use crate::tables::{cell, number, table};
use crate::{Groups, Roles};
use dapple_study::Method;

/// A line of the table: a quantity and its limits.
struct Line {
    what: String,
    required: f64,
    goal: f64,
    /// The values at equal samples and in equal time, over all scenes.
    seen: [Option<Figure>; 2],
    /// The values at equal samples, over the scenes with and without tuning.
    apart: [Option<Figure>; 2],
    /// True if more is better.
    more: bool,
}

/// The first of goal and requirement that holds.
fn verdict(line: &Line, seen: Option<&Figure>) -> &'static str {
    let Some(value) = seen.map(|f| f.value) else { return "" };
    let within = |limit: f64| if line.more { value >= limit } else { value <= limit };
    match () {
        () if within(line.goal) => "goal met",
        () if within(line.required) => "required met",
        () => "**missed**",
    }
}

struct Ask<'a> {
    board: &'a Board,
    groups: &'a Groups<'a>,
    lines: Vec<Line>,
}

impl Ask<'_> {
    /// The geometric mean of `a` over `b`, at equal samples and in equal time.
    fn mean(&mut self, what: &str, a: &Method, b: &Method, spp: u64, metric: Metric, [required, goal]: [f64; 2]) {
        let of = |scenes: &[&str], at| self.board.mean(scenes, a, b, at, metric);
        let (all, equal) = (&self.groups.all, At::Spp(spp));
        self.lines.push(Line {
            what: format!("{what}, {spp} spp, {}", metric.name()),
            required,
            goal,
            seen: [of(all, equal), of(all, At::TimeOf(spp))],
            apart: [of(&self.groups.tuned, equal), of(&self.groups.held_out, equal)],
            more: false,
        });
    }

    /// The scene on which `a` over `b` is largest.
    fn worst(&mut self, what: &str, a: &Method, b: &Method, spp: u64, [required, goal]: [f64; 2]) {
        let worst = |scenes: &[&str], at| {
            let ratio = |s: &&str| Some((self.board.ratio((s, a), (s, b), at, Metric::RelMse)?, (*s).to_owned()));
            scenes.iter().filter_map(ratio).max_by(|x, y| x.0.value.total_cmp(&y.0.value))
        };
        let (all, equal) = (&self.groups.all, At::Spp(spp));
        let [samples, time] = [worst(all, equal), worst(all, At::TimeOf(spp))];
        let scene =
            |found: &Option<(Figure, String)>| found.as_ref().map_or_else(String::new, |(_, name)| name.clone());
        self.lines.push(Line {
            what: format!("{what}, {spp} spp, relMSE ({}; at equal time {})", scene(&samples), scene(&time)),
            required,
            goal,
            seen: [samples.map(|s| s.0), time.map(|s| s.0)],
            apart: [&self.groups.tuned, &self.groups.held_out].map(|group| worst(group, equal).map(|s| s.0)),
            more: false,
        });
    }

    /// Time to equal error, over scenes with interreflection.
    fn time(&mut self, what: &str, method: &Method, metric: Metric, [required, goal]: [f64; 2]) {
        let mean = |group: &[&str]| {
            let indirect = group.iter().filter(|s| self.groups.indirect.contains(s));
            let times: Option<Vec<Figure>> =
                indirect.map(|s| self.board.time_to_error(s, method, 32, metric)).collect();
            let times = times.filter(|times| !times.is_empty())?;
            let mean = |of: &dyn Fn(&Figure) -> f64| {
                (times.iter().map(|f| of(f).ln()).sum::<f64>() / times.len() as f64).exp()
            };
            let mark = times.iter().map(|f| f.mark).find(|mark| *mark != crate::board::Mark::Plain);
            Some(Figure { value: mean(&|f| f.value), ends: None, mark: mark.unwrap_or(crate::board::Mark::Plain) })
        };
        let seen = mean(&self.groups.all);
        self.lines.push(Line {
            what: format!("{what}, {}", metric.name()),
            required,
            goal,
            seen: [None, seen],
            apart: [mean(&self.groups.tuned), mean(&self.groups.held_out)],
            more: true,
        });
    }
}

pub(crate) fn seen(board: &Board, lights: &Board, roles: &Roles, groups: &Groups<'_>) -> String {
    let mut ask = Ask { board, groups, lines: Vec::new() };
    let (uniform, default) = (&roles.uniform, &roles.default);
    ask.mean("counts alone", &roles.counts, uniform, 32, Metric::Srgb, [0.85, 0.77]);
    ask.mean("counts alone", &roles.counts, uniform, 32, Metric::RelMse, [0.78, 0.70]);
    ask.worst("counts alone, worst scene", &roles.counts, uniform, 32, [1.05, 1.05]);
    for (spp, limits) in [(8, [0.63, 0.50]), (32, [0.58, 0.45])] {
        for metric in [Metric::RelMse, Metric::Srgb] {
            let over = |scene| lights.ratio((scene, uniform), ("room-uniform", uniform), At::Spp(spp), metric);
            let power = over("room").map_or_else(|| "–".into(), |f| number(f.value));
            ask.lines.push(Line {
                what: format!(
                    "light cells over uniform choice, room, {spp} spp, {} (by power: {power})",
                    metric.name()
                ),
                required: limits[0],
                goal: limits[1],
                seen: [over("room-cells"), None],
                apart: [None, None],
                more: false,
            });
        }
    }
    for (spp, limits) in [(8, [0.14, 0.10]), (32, [0.21, 0.17]), (64, [0.28, 0.23])] {
        ask.mean("default", default, uniform, spp, Metric::Srgb, limits);
    }
    for (spp, limits) in [(8, [0.3, 0.2]), (32, [0.2, 0.12]), (64, [0.18, 0.1])] {
        ask.mean("default over the thesis", default, &roles.thesis, spp, Metric::Srgb, limits);
    }
    for (spp, limits) in [(8, [0.95, 0.8]), (32, [0.8, 0.65]), (64, [0.75, 0.6])] {
        ask.mean("default over OIDN on uniform samples", default, &roles.oidn, spp, Metric::Srgb, limits);
    }
    ask.time("times less than `uniform` to the error at 32 spp", default, Metric::Srgb, [3.0, 5.0]);
    ask.time("times less than `uniform` to the error at 32 spp", default, Metric::RelMse, [3.0, 5.0]);
    for spp in [8, 16, 32, 64] {
        ask.worst("default, worst scene", default, uniform, spp, [1.05, 1.0]);
    }
    let heads = ["target", "required", "goal", "equal spp", "", "equal time", "", "equal spp, tuned on", "held out"];
    let rows: Vec<Vec<String>> = ask.lines.iter().map(words).collect();
    let heads = heads.map(str::to_owned);
    table("Targets", &heads, &rows) + &besides(board, roles, groups)
}

fn words(line: &Line) -> Vec<String> {
    let [samples, time] = line.seen.each_ref().map(Option::as_ref);
    let [tuned, held_out] = line.apart.each_ref().map(|figure| cell(figure.as_ref()));
    let said = |figure: Option<&Figure>| [cell(figure), verdict(line, figure).to_owned()];
    let [a, b] = said(samples);
    let [c, d] = said(time);
    vec![line.what.clone(), number(line.required), number(line.goal), a, b, c, d, tuned, held_out]
}

/// Comparisons without a goal: OIDN on the same samples, and other errors of the default.
fn besides(board: &Board, roles: &Roles, groups: &Groups<'_>) -> String {
    let pairs = [
        ("default over OIDN on the same counts", &roles.default, &roles.oidn_on_ours),
        ("OIDN on our counts over OIDN on uniform ones", &roles.oidn_on_ours, &roles.oidn),
        ("default over OIDN on uniform samples", &roles.default, &roles.oidn),
        ("default over OIDN with prefiltered features on uniform samples", &roles.default, &roles.oidn_prefiltered),
        ("default over the thesis", &roles.default, &roles.thesis),
        ("default over uniform", &roles.default, &roles.uniform),
    ];
    let mut rows = Vec::new();
    for (what, a, b) in pairs {
        for metric in Metric::ALL {
            let of = |at| cell(board.mean(&groups.all, a, b, at, metric).as_ref());
            let cells = board.spp.iter().flat_map(|&n| [of(At::Spp(n)), of(At::TimeOf(n))]);
            rows.push([format!("{what}, {}", metric.name())].into_iter().chain(cells).collect());
        }
    }
    let heads: Vec<String> = [String::new()]
        .into_iter()
        .chain(board.spp.iter().flat_map(|n| [format!("{n} spp"), format!("time of {n}")]))
        .collect();
    table("Besides, over all scenes", &heads, &rows)
}
