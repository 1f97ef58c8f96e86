//! The tables, as Markdown.

use crate::measure::{
    CLUSTER_FILTER, CLUSTER_LD, CLUSTER_RANDOM, CLUSTER_SOBOL, FILTERS, GAUSSIAN, LD, Lowest, METHODS, METRICS, NONE,
    RANDOM, Results, SOBOL, SRGB,
};
use crate::statistics::{Ratio, exponent, floor, mean, on_curve, ratio};
use crate::{published, reference};

/// Prints the conventions of all tables.
pub(crate) fn preamble() {
    println!(
        "Methods: `random` and `ld` give each pixel the same count, on the points `random` and `lowdiscrepancy`; \
         `mitchell` (table 4-2) is on `lowdiscrepancy`; `cluster-P` (table 4-3) is `cluster-thesis` on the points P; \
         `-4-128` is the same with at least 4 and at most 128 samples; `sobol` and what is on it stand aside \
         (half of the seeds, unfiltered). `lowdiscrepancy` makes nets of the mean count for all of them; a \
         pixel with another count gets a part of one. All means are met exactly. Box pixel filter.\n"
    );
    println!(
        "8-bit MSE: of sRGB values clamped to 0..255, not rounded. The reference's own error is subtracted from all \
         errors. [ , ]: 95 % interval over the seeds (Student's t; of ratios geometric means, paired by seed).\n"
    );
    println!(
        "Time: medians of wall seconds on {} threads, methods in turns; clusters are charged to the sampler or filter \
         that used them, probes to the sampler, filtering to the filter, recording of first hits to \
         `cluster-gaussian` alone.\n",
        rayon::current_num_threads()
    );
}

/// Prints all tables of one scene.
pub(crate) fn scene(r: &Results) {
    let plan = r.plan;
    println!("## {}, {}x{} pixels\n", plan.scene, plan.side, plan.side);
    println!(
        "{} seed(s), k={}; reference {} spp on `{}`, own error {:.3} (8 bit) and {:.1e} (relMSE); recording first \
         hits takes {:+.1} % of tracing.\n",
        plan.seeds,
        plan.k,
        plan.reference_spp,
        reference::POINTS,
        r.own[0],
        r.own[1],
        100.0 * (r.recording - 1.0)
    );
    absolute(r);
    reduction(r);
    unfiltered(r);
    for (metric, title) in METRICS.iter().enumerate() {
        for (name, base) in [("random, none", (RANDOM, NONE)), ("ld, none", (LD, NONE))] {
            title_of(r, &format!("{title} over that of {name}, at equal samples"));
            ratios(r, |m, f, n| (equal_samples(r, metric, (m, f), base, n), false));
        }
    }
    for (metric, title) in METRICS.iter().enumerate() {
        let bases = [("random, none", RANDOM, Some(NONE)), ("ld, none", LD, Some(NONE)), ("ld, same filter", LD, None)];
        for (name, base, filter) in bases {
            title_of(r, &format!("{title} over that of {name}, at equal time (*: beyond its curve)"));
            ratios(r, |m, f, n| equal_time(r, metric, (m, f), (base, filter.unwrap_or(f)), n));
        }
    }
    times(r);
}

/// Table 4-4 for all filters, and the same in relMSE.
fn absolute(r: &Results) {
    for (metric, title) in METRICS.iter().enumerate() {
        let more = ["a of a + b/n", "exponent"];
        let of = if metric == SRGB { " (table 4-4)" } else { "" };
        header(r, &format!("{title}{of}"), &["sampler", "filter"], &more);
        let last = |curve: &[(u64, f64)]| format!("{} | {:.2}", error(floor(curve)), exponent(curve));
        for (m, f) in shown(r) {
            let cells = cells(r, |n| {
                let (mean, half) = mean(&r.errors(m, f, n, metric));
                half.map_or_else(|| error(mean), |h| format!("{} ± {}", error(mean), digits(h, 2)))
            });
            println!("| {} | {} | {cells} | {} |", METHODS[m].name, FILTERS[f], last(&r.curve(m, f, metric)));
        }
        if metric == SRGB && plan_is_teapot(r) {
            for (name, row) in &published::FILTERED {
                let curve: Vec<_> = published::SPP.into_iter().zip(*row).collect();
                println!("| *thesis* | *{name}* | {} | {} |", theirs(r, row, error), last(&curve));
            }
        }
        println!();
    }
}

/// Table 4-5: against LD with the Gaussian, as published, and against LD with the same filter.
fn reduction(r: &Results) {
    let percent = |x: f64| format!("{x:.1}");
    for (name, base) in [("ld, gaussian", Some(GAUSSIAN)), ("ld, same filter", None)] {
        header(
            r,
            &format!("Reduction of 8-bit MSE against {name}, in percent (table 4-5)"),
            &["sampler", "filter"],
            &[],
        );
        for (m, f) in shown(r).into_iter().filter(|&(m, f)| m != LD || base.is_some_and(|b| b != f)) {
            let cells = cells(r, |n| {
                let ratio = equal_samples(r, SRGB, (m, f), (LD, base.unwrap_or(f)), n);
                let reduced = |x: f64| percent(100.0 * (1.0 - x));
                let bounds = ratio.bounds.map(|[low, high]| format!(" [{}, {}]", reduced(high), reduced(low)));
                reduced(ratio.mean) + &bounds.unwrap_or_default()
            });
            println!("| {} | {} | {cells} |", METHODS[m].name, FILTERS[f]);
        }
        if base.is_some() && plan_is_teapot(r) {
            for (i, (name, row)) in published::REDUCTION.iter().enumerate() {
                println!("| *thesis, printed* | *{name}* | {} |", theirs(r, row, percent));
                let row = published::reduction(i + 1);
                println!("| *thesis, from its table 4-4* | *{name}* | {} |", theirs(r, &row, percent));
            }
        }
        println!();
    }
}

/// Table 4-6: clusters over uniform, unfiltered. Beside it the worst possible allocation if the error of a pixel falls
/// as 1/n: all error in the pixels with the fewest samples.
fn unfiltered(r: &Results) {
    header(r, "8-bit MSE unfiltered, clusters over uniform on the same points (table 4-6)", &["what"], &[]);
    let pairs = [(CLUSTER_RANDOM, RANDOM), (CLUSTER_LD, LD), (CLUSTER_SOBOL, SOBOL)];
    for (m, base) in pairs.into_iter().filter(|p| r.has(p.0)) {
        let cells = cells(r, |n| shown_ratio(&equal_samples(r, SRGB, (m, NONE), (base, NONE), n)));
        println!("| {} / {} | {cells} |", METHODS[m].name, METHODS[base].name);
    }
    let bound: [f64; 4] = std::array::from_fn(|i| published::SPP[i] as f64 / published::MIN[i]);
    println!("| bound: mean / min | {} |", theirs(r, &bound, |x| format!("{x:.3}")));
    let lowest = |m, n, of: fn(&Lowest) -> f64| r.lowest(m, n).iter().map(of).collect::<Vec<_>>();
    let percent = |m, n, of| format!("{:.1}", 100.0 * mean(&lowest(m, n, of)).0);
    println!("| pixels with the fewest samples, % | {} |", cells(r, |n| percent(CLUSTER_LD, n, |l| l.pixels)));
    for (m, base) in pairs.into_iter().filter(|p| r.has(p.0)) {
        let [name, other] = [METHODS[m].name, METHODS[base].name];
        println!("| part of the error of {other} in these pixels, % | {} |", cells(r, |n| percent(m, n, |l| l.part)));
        let loss = cells(r, |n| shown_ratio(&ratio(&lowest(m, n, |l| l.loss.ln()))));
        println!("| in these pixels: {name} / {other} | {loss} |");
    }
    if plan_is_teapot(r) {
        let [random, clusters] = published::UNFILTERED;
        let ratio: [f64; 4] = std::array::from_fn(|i| clusters[i] / random[i]);
        println!("| *thesis: random* | {} |", theirs(r, &random, error));
        println!("| *thesis: clusters* | {} |", theirs(r, &clusters, error));
        println!("| *thesis: ratio* | {} |", theirs(r, &ratio, |x| format!("{x:.3}")));
    }
    println!();
}

/// Rows of ratios, for all samplers and filters; `of` returns true with a ratio beyond a measured curve.
fn ratios(r: &Results, of: impl Fn(usize, usize, u64) -> (Ratio, bool)) {
    for (m, f) in shown(r) {
        let cells = cells(r, |n| {
            let (ratio, beyond) = of(m, f, n);
            shown_ratio(&ratio) + if beyond { " *" } else { "" }
        });
        println!("| {} | {} | {cells} |", METHODS[m].name, FILTERS[f]);
    }
    println!();
}

type Way = (usize, usize);

fn equal_samples(r: &Results, metric: usize, way: Way, base: Way, spp: u64) -> Ratio {
    let [errors, others] = [way, base].map(|(m, f)| r.errors(m, f, spp, metric));
    ratio(&errors.iter().zip(&others).map(|(e, o)| (e / o).ln()).collect::<Vec<_>>())
}

/// The error over that of `base` in the same seconds, on the curve of each seed's errors over the seconds.
fn equal_time(r: &Results, metric: usize, way: Way, base: Way, spp: u64) -> (Ratio, bool) {
    let seconds = r.seconds(way.0, way.1, spp).total();
    let clock: Vec<_> = r.plan.spp.iter().map(|&n| r.seconds(base.0, base.1, n).total()).collect();
    let others: Vec<_> = r.plan.spp.iter().map(|&n| r.errors(base.0, base.1, n, metric)).collect();
    let mut beyond = false;
    let log = |(seed, error): (usize, &f64)| {
        let points: Vec<_> = clock.iter().zip(&others).map(|(&t, e)| [t, e[seed]]).collect();
        let (other, outside) = on_curve(&points, seconds);
        beyond |= outside;
        (error / other).ln()
    };
    let logs: Vec<_> = r.errors(way.0, way.1, spp, metric).iter().enumerate().map(log).collect();
    (ratio(&logs), beyond)
}

/// The times by phase.
fn times(r: &Results) {
    let parts = "seconds of: clusters | probes | planning | tracing | gaussian | cluster-gaussian";
    let shares = "before tracing, % of all | the same in samples per pixel";
    println!("### Time, unfiltered, and what each filter takes besides\n");
    println!("| sampler | spp | {parts} | {shares} |\n|{}", "---|".repeat(10));
    let row = |m: usize, n: u64| {
        let s = r.seconds(m, NONE, n);
        let [plain, knowing] = [GAUSSIAN, CLUSTER_FILTER].map(|f| r.seconds(m, f, n).filter);
        let before = s.before_tracing();
        let [all, samples] = [100.0 * before / s.total(), before / s.trace * n as f64];
        let seconds = [s.cluster, s.probe, s.plan, s.trace, plain, knowing].map(|s| format!("{s:.4}")).join(" | ");
        println!("| {} | {n} | {seconds} | {all:.1} | {samples:.2} |", METHODS[m].name);
    };
    (0..METHODS.len()).filter(|&m| r.has(m)).for_each(|m| row(m, 16));
    r.plan.spp.iter().filter(|&&n| n != 16).for_each(|&n| row(CLUSTER_LD, n));
    for (_, spp, [cluster, probe, trace]) in published::TIMES.iter().filter(|t| t.0 == r.plan.scene) {
        let before = cluster + probe;
        let [all, samples] = [100.0 * before / (before + trace), before / trace * spp];
        println!("| *thesis, clusters* | {spp} | {cluster} | {probe} | | {trace} | | | {all:.1} | {samples:.2} |");
    }
    println!();
}

/// The samplers and filters with rows of their own.
fn shown(r: &Results) -> Vec<Way> {
    let ways = (0..FILTERS.len()).flat_map(|f| (0..METHODS.len()).map(move |m| (m, f)));
    ways.filter(|&(m, f)| r.has(m) && (f == NONE || !METHODS[m].aside)).collect()
}

fn plan_is_teapot(r: &Results) -> bool {
    r.plan.scene == "teapot"
}

fn title_of(r: &Results, title: &str) {
    header(r, title, &["sampler", "filter"], &[]);
}

fn header(r: &Results, title: &str, before: &[&str], after: &[&str]) {
    let spp = r.plan.spp.iter().map(|n| format!("{n} spp"));
    let heads: Vec<_> =
        before.iter().map(|&s| s.to_owned()).chain(spp).chain(after.iter().map(|&s| s.into())).collect();
    println!("### {title}\n\n| {} |\n|{}", heads.join(" | "), "---|".repeat(heads.len()));
}

fn cells(r: &Results, of: impl Fn(u64) -> String) -> String {
    r.plan.spp.iter().map(|&n| of(n)).collect::<Vec<_>>().join(" | ")
}

/// The thesis' numbers for the counts measured.
fn theirs(r: &Results, row: &[f64; 4], format: impl Fn(f64) -> String) -> String {
    cells(r, |n| published::at(row, n).map_or_else(String::new, &format))
}

fn shown_ratio(ratio: &Ratio) -> String {
    let bounds = ratio.bounds.map(|[low, high]| format!(" [{low:.3}, {high:.3}]"));
    format!("{:.3}{}", ratio.mean, bounds.unwrap_or_default())
}

fn error(x: f64) -> String {
    digits(x, 4)
}

/// A number with this many significant digits, and no fewer than those of its integer part.
fn digits(x: f64, wanted: usize) -> String {
    match x.abs() {
        0.0 => "0".into(),
        a if a < 0.01 => format!("{x:.*e}", wanted - 1),
        a => format!("{x:.*}", (wanted as i32 - 1 - a.log10().floor() as i32).max(0) as usize),
    }
}
