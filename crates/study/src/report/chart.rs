//! Charts of error curves with logarithmic axes, as SVG in the page's colours, and the names and styles of methods in charts.

use crate::record::Method;
use askama::Template;

/// The number of line colours in the page. With more samplers, colours repeat with other markers.
const COLOURS: usize = 8;

/// The dash patterns of lines, as values of SVG's `stroke-dasharray`.
const DASHES: [&str; 5] = ["none", "7 4", "2 3", "10 3 2 3", "14 4"];

/// The shapes of markers around the origin, as SVG paths; the last two are outlined only.
const MARKS: [&str; 8] = [
    "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0",
    "M-4-4H4V4H-4Z",
    "M0-5L5 4H-5Z",
    "M0-6L6 0L0 6L-6 0Z",
    "M0 5L5-4H-5Z",
    "M-1-5H1V-1H5V1H1V5H-1V1H-5V-1H-1Z",
    "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0",
    "M-4-4L4 4M-4 4L4-4",
];
const FILLED: usize = 6;

/// The line style of a method: the indices of its colour and marker (by sampler and points), and of its dash pattern
/// (by filter).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MethodStyle {
    colour: usize,
    mark: &'static str,
    is_filled: bool,
    dashes: &'static str,
}

impl MethodStyle {
    /// A short piece of a method's line with its marker, as SVG for legends.
    pub(super) fn swatch(&self) -> String {
        let Self { mark, is_filled, dashes, .. } = self;
        let colour = format!("var(--c{})", self.colour);
        let fill = if *is_filled { colour.as_str() } else { "none" };
        format!(
            "<svg aria-hidden=\"true\" focusable=\"false\" width=\"34\" height=\"16\" viewBox=\"-17 -8 34 16\">\
             <path d=\"M-16 0H16\" stroke=\"{colour}\" stroke-dasharray=\"{dashes}\" stroke-width=\"2\"/>\
             <path d=\"{mark}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"/></svg>"
        )
    }
}

/// Chooses the styles of all methods, in the order of the methods.
pub(super) fn styles<'a>(methods: &'a [Method]) -> Vec<MethodStyle> {
    let (mut samplers, mut filters): (Vec<(&str, &str)>, Vec<&str>) = (Vec::new(), Vec::new());
    let style = |method: &'a Method| {
        let sampler = index(&mut samplers, (&*method.sampler, &*method.points));
        let dashes = DASHES[index(&mut filters, &*method.filter) % DASHES.len()];
        let mark = (sampler + sampler / COLOURS) % MARKS.len();
        MethodStyle { colour: sampler % COLOURS, mark: MARKS[mark], is_filled: mark < FILLED, dashes }
    };
    methods.iter().map(style).collect()
}

fn index<T: PartialEq>(known: &mut Vec<T>, one: T) -> usize {
    known.iter().position(|k| *k == one).unwrap_or_else(|| {
        known.push(one);
        known.len() - 1
    })
}

/// Short unique names of the methods: the sampler, the point set if methods have different ones, and the filter unless it is
/// `none`.
pub(super) fn names(methods: &[Method]) -> Vec<String> {
    let differ = methods.iter().any(|m| m.points != methods[0].points);
    let name = |m: &Method| {
        let points = if differ { format!(" / {}", m.points) } else { String::new() };
        let filter = if m.filter == "none" { String::new() } else { format!(" +\u{a0}{}", m.filter) };
        format!("{}{points}{filter}", m.sampler)
    };
    methods.iter().map(name).collect()
}

/// The curve of one method in a chart.
#[derive(Clone, Debug)]
pub(super) struct PlottedCurve {
    pub(super) style: MethodStyle,
    pub(super) points: Vec<PlottedPoint>,
}

/// A point of a curve: x, y, and the 95 % interval of y if there is one.
pub(super) type PlottedPoint = (f64, f64, Option<[f64; 2]>);

/// The ends of the x axis in pixels, left and right. [`Y`] holds the bottom and top of the y axis.
const X: [f64; 2] = [74.0, 464.0];
const Y: [f64; 2] = [294.0, 12.0];
/// The width of a digit in pixels: 0.6 of the font size, which the page's style enlarges to 17 on a phone.
const DIGIT: f64 = 0.6 * 17.0;

/// A logarithmic axis: the base-10 logarithms at its ends, and the ends in pixels.
struct Scale {
    logs: [f64; 2],
    pixels: [f64; 2],
}

impl Scale {
    /// An axis that contains all values, with margins of `share` times the values' range, or 0.15 decades if the values nearly
    /// coincide. `None` without positive values.
    fn over(values: impl Iterator<Item = f64>, share: f64, pixels: [f64; 2]) -> Option<Self> {
        let logs = values.filter(|v| *v > 0.0 && v.is_finite()).map(libm::log10);
        let [low, high] = logs.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], log| [a.min(log), b.max(log)]);
        let width = high - low;
        let by = if width < 0.05 { 0.15 } else { share * width };
        width.is_finite().then_some(Self { logs: [low - by, high + by], pixels })
    }

    fn place(&self, value: f64) -> f64 {
        let share = ((libm::log10(value) - self.logs[0]) / (self.logs[1] - self.logs[0])).clamp(0.0, 1.0);
        self.pixels[0] + share * (self.pixels[1] - self.pixels[0])
    }

    /// The values of ticks: the densest of four series with at most `most` ticks and at least two. The series are 1; 1
    /// and 3; 1, 2 and 5; and 1 to 9, times powers of ten.
    fn ticks(&self, most: usize) -> Vec<f64> {
        let [low, high] = self.logs;
        let decades = libm::floor(low) as i32..=libm::ceil(high) as i32;
        let series = |steps: &[u8]| -> Vec<f64> {
            let tick = |step: &u8, decade: i32| format!("{step}e{decade}").parse().unwrap_or(f64::NAN);
            let all = decades.clone().flat_map(|decade| steps.iter().map(move |step| tick(step, decade)));
            all.filter(|value| (low..=high).contains(&libm::log10(*value))).collect()
        };
        let all: [&[u8]; 4] = [&[1], &[1, 3], &[1, 2, 5], &[1, 2, 3, 4, 5, 6, 7, 8, 9]];
        let found = all.map(series);
        if found[0].len() > most {
            return found[0].iter().copied().step_by(found[0].len().div_ceil(most)).collect();
        }
        let fitting = found.iter().rev().find(|t| t.len() <= most && t.len() >= 2);
        fitting.or(found.iter().find(|t| t.len() >= 2)).unwrap_or(&found[3]).clone()
    }
}

/// The data of the chart's template; positions are in pixels with one decimal.
#[derive(Template)]
#[template(path = "chart.svg")]
struct Chart<'a> {
    title: &'a str,
    /// The position and the text of each tick; the text is empty if there is no room for it.
    x_ticks: Vec<(String, String)>,
    y_ticks: Vec<(String, String)>,
    curves: Vec<DrawnCurve>,
}

struct DrawnCurve {
    style: MethodStyle,
    places: Vec<(String, String)>,
    line: String,
    /// The outline of the intervals; empty without intervals.
    band: String,
}

/// Draws curves of relMSE as an SVG chart; `None` without points. `title` is the title of the x axis, and `at` holds the values
/// of its ticks; with `None`, round values are chosen.
pub(super) fn log_log(curves: &[PlottedCurve], title: &str, at: Option<&[f64]>) -> Option<String> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let x = Scale::over(points().map(|p| p.0), 0.03, X)?;
    let y = Scale::over(points().flat_map(|p| [p.1].into_iter().chain(p.2.into_iter().flatten())), 0.04, Y)?;
    let place = |scale: &Scale, value: f64| format!("{:.1}", scale.place(value));
    let join =
        |places: &[(String, String)]| places.iter().map(|(x, y)| format!("{x},{y}")).collect::<Vec<_>>().join(" ");
    let drawn = |curve: &PlottedCurve| {
        let along = |y_of: &dyn Fn(&PlottedPoint) -> f64| -> Vec<_> {
            curve.points.iter().map(|p| (place(&x, p.0), place(&y, y_of(p)))).collect()
        };
        let side = |end: usize| along(&|p| p.2.map_or(p.1, |ends| ends[end]));
        let outline: Vec<_> = side(0).into_iter().chain(side(1).into_iter().rev()).collect();
        let has_band = curve.points.iter().any(|p| p.2.is_some());
        let (places, band) = (along(&|p| p.1), if has_band { join(&outline) } else { String::new() });
        DrawnCurve { style: curve.style, line: join(&places), places, band }
    };
    let own = |at: &[f64]| at.iter().copied().filter(|v| (x.logs[0]..=x.logs[1]).contains(&libm::log10(*v))).collect();
    let mut room = f64::NEG_INFINITY;
    let x_tick = |value: f64| {
        let (text, middle) = (tick_text(value), x.place(value));
        let half = 0.5 * DIGIT * text.len() as f64;
        let fits = middle - half >= room;
        room = if fits { middle + half + 6.0 } else { room };
        (place(&x, value), if fits { text } else { String::new() })
    };
    let chart = Chart {
        title,
        x_ticks: at.map_or_else(|| x.ticks(6), own).into_iter().map(x_tick).collect(),
        y_ticks: y.ticks(7).into_iter().map(|value| (place(&y, value), tick_text(value))).collect(),
        curves: curves.iter().map(drawn).collect(),
    };
    chart.render().ok()
}

/// Formats a number for a tick, short and exact: `0.001`, `0.02`, `16`, `5e-6`.
fn tick_text(value: f64) -> String {
    if (1e-3..1e5).contains(&value) { value.to_string() } else { format!("{value:e}") }
}
