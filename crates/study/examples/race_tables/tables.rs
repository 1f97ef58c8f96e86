//! Tables of all measurements.

use crate::board::{At, Board, Figure, Mark, Metric, spent};
use crate::{Groups, Roles};
use dapple_study::{Method, Run};

/// A number with three significant digits.
pub(crate) fn number(value: f64) -> String {
    let digits = if value > 0.0 { (2 - value.log10().floor() as i32).clamp(0, 4) } else { 2 };
    format!("{value:.*}", digits as usize)
}

/// `0.21 [0.20, 0.23]`, and its mark.
pub(crate) fn cell(figure: Option<&Figure>) -> String {
    let Some(figure) = figure else { return "–".into() };
    let ends = figure.ends.map_or_else(String::new, |[low, high]| format!(" [{}, {}]", number(low), number(high)));
    let mark = match figure.mark {
        Mark::Plain => String::new(),
        Mark::Beyond => "†".into(),
        Mark::Slower(times) => format!(" ‡{times:.2}"),
    };
    format!("{}{ends}{mark}", number(figure.value))
}

/// A method's sampler and filter; the points are the same everywhere.
pub(crate) fn name(method: &Method) -> String {
    if method.filter == "none" { method.sampler.clone() } else { format!("{} + {}", method.sampler, method.filter) }
}

pub(crate) fn table(title: &str, heads: &[String], rows: &[Vec<String>]) -> String {
    let lines: String = rows.iter().map(|row| format!("| {} |\n", row.join(" | "))).collect();
    format!("\n**{title}**\n\n| {} |\n|{}\n{lines}", heads.join(" | "), "---|".repeat(heads.len()))
}

fn row(first: &str, rest: impl Iterator<Item = String>) -> Vec<String> {
    [first.to_owned()].into_iter().chain(rest).collect()
}

/// The head of the page: the measurements and their conventions.
pub(crate) fn head(board: &Board) -> String {
    let words = |all: Vec<String>| if all.is_empty() { "unknown".into() } else { all.join(", ") };
    let mut commits: Vec<String> = board.manifests.iter().filter_map(|m| m.commit.clone()).collect();
    commits.dedup();
    let seeds = board.manifests.first().map_or(0, |m| m.seeds.len());
    let threads = board.manifests.first().map_or(0, |m| m.machine.threads);
    let spp = words(board.spp.iter().map(u64::to_string).collect());
    let loads: Vec<f64> = board.runs().filter_map(|run| run.load).collect();
    let load = loads.iter().sum::<f64>() / loads.len().max(1) as f64;
    let limited = board.runs().filter(|run| run.reference_limited).count();
    let rejected: u64 = board.runs().map(|run| run.rejected).sum();
    let text = format!(
        "Commit {}; {} scenes, {} methods on `sobol`, {spp} spp, {seeds} seeds, {threads} thread a run; {} runs, {} missing; mean load \
         average {load:.2}; {limited} runs within 100 times the reference's own variance, which is taken out; {rejected} samples \
         rejected.\n\nRatios are over `uniform` at the same place unless said otherwise, the geometric mean over seeds, paired; [ , ] \
         are 95 % intervals over seeds. Over scenes: geometric means; their intervals are of the seeds, the scenes taken as \
         they are. Equal time: each seed's curve of error over median CPU seconds (of OIDN what it says of itself), interpolated on \
         logarithmic axes, at the median CPU seconds of `uniform`. †: followed beyond what was measured. ‡: the fewest samples that were tried took so many times \
         as long; the error is that of those.\n",
        words(commits),
        board.scenes.len(),
        board.methods.len(),
        board.runs().count(),
        board.missing,
    );
    let scenes = board.manifests.iter().flat_map(|manifest| &manifest.scenes);
    let described = scenes.map(|scene| {
        let own = scene.reference.relmse.map_or_else(|| "unknown".into(), |v| format!("{v:.1e}"));
        let spp = scene.reference.spp.map_or_else(|| "a file".into(), |n| format!("{n} spp"));
        let [width, height] = scene.resolution;
        format!("{} {width}x{height} ({spp}, relMSE of the reference {own})", scene.name)
    });
    // Several studies have the same ones.
    let mut once: Vec<String> = Vec::new();
    described.for_each(|scene| {
        if !once.contains(&scene) {
            once.push(scene)
        }
    });
    text + "\n" + &once.join("; ") + "\n"
}

/// The time that `uniform` takes to the error of the default, over the default's time.
pub(crate) fn times_to_error(board: &Board, roles: &Roles, groups: &Groups<'_>) -> String {
    let methods =
        [&roles.counts, &roles.default, &roles.oidn, &roles.oidn_on_ours, &roles.oidn_prefiltered, &roles.thesis];
    let heads = row("scene", methods.iter().map(|m| name(m)));
    let mut text = String::new();
    for metric in [Metric::Srgb, Metric::RelMse] {
        let figures = |scene: &str| methods.map(|m| board.time_to_error(scene, m, 32, metric));
        let mut rows: Vec<_> =
            groups.all.iter().map(|scene| row(scene, figures(scene).iter().map(|f| cell(f.as_ref())))).collect();
        let mean = |at: usize| {
            let all: Option<Vec<f64>> = groups.indirect.iter().map(|s| Some(figures(s)[at]?.value.ln())).collect();
            all.map_or_else(|| "–".into(), |logs| number((logs.iter().sum::<f64>() / logs.len() as f64).exp()))
        };
        rows.push(row("geometric mean, scenes with interreflection", (0..methods.len()).map(mean)));
        let title = format!("Times as long that `uniform` takes to the {} that each has with 32 spp", metric.name());
        text += &table(&title, &heads, &rows);
    }
    text
}

/// Seconds of each method, and of the filters.
pub(crate) fn costs(board: &Board, roles: &Roles) -> String {
    let Some(&spp) = board.spp.iter().find(|n| **n == 32).or(board.spp.last()) else { return String::new() };
    let heads = row("scene", board.methods.iter().map(name));
    let seconds = |scene: &str, of: fn(&Run) -> f64, scale: f64| {
        let own = |m: &Method| board.seconds(scene, m, spp, of).map_or_else(|| "–".into(), |s| number(s * scale));
        row(scene, board.methods.iter().map(own).collect::<Vec<_>>().into_iter())
    };
    let rows: Vec<_> = board.scenes.iter().map(|s| seconds(s, spent, 1.0)).collect();
    let mut text =
        table(&format!("Seconds of an image with {spp} spp, all but reading and building the scene"), &heads, &rows);
    let per_pixel = |scene: &&String| {
        let [w, h] = board.manifests.iter().flat_map(|m| &m.scenes).find(|s| s.name == **scene)?.resolution;
        Some(1e6 / (f64::from(w) * f64::from(h)))
    };
    let filters = |scene: &String| Some(seconds(scene, |r| r.seconds.filter, per_pixel(&scene)?));
    let rows: Vec<_> = board.scenes.iter().filter_map(filters).collect();
    text += &table(&format!("Microseconds a pixel of the filter alone, {spp} spp"), &heads, &rows);
    let plan = |scene: &String| {
        let share = |of: fn(&Run) -> f64| Some(board.seconds(scene, &roles.default, spp, of)? * 100.0);
        let share = share(|r| (r.seconds.plan + r.seconds.cluster + r.seconds.probe) / r.render_s);
        row(scene, [share.map_or_else(|| "–".into(), number)].into_iter())
    };
    let rows: Vec<_> = board.scenes.iter().map(plan).collect();
    let heads = ["scene", "%"].map(str::to_owned);
    text + &table(
        &format!("Clusters, probes and planning of {}, % of the time, {spp} spp", name(&roles.default)),
        &heads,
        &rows,
    )
}

/// Errors of the light selections.
pub(crate) fn lights(board: &Board, roles: &Roles) -> String {
    if board.scenes.is_empty() {
        return String::new();
    }
    let mut rows = Vec::new();
    for (scene, method) in board.scenes.iter().flat_map(|s| board.methods.iter().map(move |m| (s, m))) {
        let ratio = |metric: Metric| {
            let at = board.spp.iter().flat_map(|&n| [At::Spp(n), At::TimeOf(n)]).collect::<Vec<_>>();
            at.into_iter().map(move |at| {
                // The time is that of uniform selection with uniform counts: each scene's own time would hide the cost
                // of learning.
                match at {
                    At::Spp(_) => {
                        cell(board.ratio((scene, method), ("room-uniform", &roles.uniform), at, metric).as_ref())
                    }
                    At::TimeOf(n) => {
                        let of = |s: &str, m: &Method| board.seconds(s, m, n, spent);
                        let times = of(scene, method).zip(of("room-uniform", &roles.uniform));
                        times.map_or_else(|| "–".into(), |(a, b)| number(a / b))
                    }
                }
            })
        };
        for metric in [Metric::Srgb, Metric::RelMse] {
            rows.push(row(&format!("{scene}, {}: {}", name(method), metric.name()), ratio(metric)));
        }
    }
    let budgets = board.spp.iter().flat_map(|n| [format!("{n} spp"), "seconds over".into()]);
    table("Choice among lights: over `room-uniform` with uniform counts and no filter", &row("", budgets), &rows)
}

/// Errors against images of another renderer.
pub(crate) fn foreign(foreign: &Board, own: &Board, roles: &Roles) -> String {
    let mut rows = Vec::new();
    let methods: Vec<&Method> = foreign.methods.iter().filter(|m| **m != roles.uniform).collect();
    let budgets: Vec<u64> = foreign.spp.iter().copied().filter(|n| *n <= 64).collect();
    for (scene, method) in foreign.scenes.iter().flat_map(|s| methods.iter().map(move |m| (s, *m))) {
        for &spp in &budgets {
            let theirs = |metric| cell(foreign.above_floor(scene, method, &roles.uniform, spp, metric).as_ref());
            let ours =
                |metric| cell(own.ratio((scene, method), (scene, &roles.uniform), At::Spp(spp), metric).as_ref());
            let cells = [Metric::Srgb, Metric::RelMse].into_iter().flat_map(|m| [theirs(m), ours(m)]);
            rows.push(row(&format!("{scene}, {}, {spp} spp", name(method)), cells));
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let heads = ["", "sRGB MSE, theirs", "ours", "relMSE, theirs", "ours"].map(str::to_owned);
    let title = "Against references of pbrt-v4 (averaged down; what an image of the baseline with very many samples still differs by \
                 taken out) and, at the race's resolution, against our own";
    table(title, &heads, &rows)
}

/// Every method on every scene.
pub(crate) fn all(board: &Board, roles: &Roles, groups: &Groups<'_>) -> String {
    let methods: Vec<&Method> = board.methods.iter().filter(|m| **m != roles.uniform).collect();
    let heads = row("scene", methods.iter().map(|m| name(m)));
    let places = board.spp.iter().map(|&n| At::Spp(n)).chain(board.spp.iter().map(|&n| At::TimeOf(n)));
    let mut text = String::new();
    for (at, metric) in places.flat_map(|at| Metric::ALL.map(|metric| (at, metric))) {
        let of = |scene: &str| {
            let figures = methods.iter().map(|m| board.ratio((scene, m), (scene, &roles.uniform), at, metric));
            row(scene, figures.map(|f| cell(f.as_ref())).collect::<Vec<_>>().into_iter())
        };
        let mut rows: Vec<_> = groups.all.iter().map(|scene| of(scene)).collect();
        for (title, scenes) in [("all", &groups.all), ("tuned on", &groups.tuned), ("held out", &groups.held_out)] {
            if !scenes.is_empty() {
                let means = methods.iter().map(|m| cell(board.mean(scenes, m, &roles.uniform, at, metric).as_ref()));
                rows.push(row(&format!("**geometric mean, {title}**"), means));
            }
        }
        text += &table(&format!("{} at {}", metric.name(), at.words()), &heads, &rows);
    }
    text
}
