//! Charts of error curves with logarithmic axes, as SVG in the page's colours.

use super::method_style::MethodStyle;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The curve of one method in a chart.
#[derive(Clone, Debug)]
pub(super) struct PlottedCurve {
    pub(super) style: MethodStyle,
    /// The points: x, y, and the 95 % interval of y if there is one.
    pub(super) points: Vec<(f64, f64, Option<[f64; 2]>)>,
}

/// An axis: its title and its ticks.
pub(super) struct Axis {
    pub(super) title: &'static str,
    /// The values at which ticks are drawn; `None` chooses round values, at most 1 to 9 times powers of ten.
    pub(super) ticks: Option<Vec<f64>>,
}

pub(super) const SIZE: (u32, u32) = (480, 346);
const MARGIN: Margins = Margins { left: 74, right: 16, top: 12, bottom: 52 };
/// The font size in pixels. The page's style enlarges it to 17 on a phone; margins and ticks leave room for that.
const FONT: u32 = 14;
const WIDEST_FONT: i32 = 17;

struct Margins {
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
}

/// Placeholder colours, one for each role (text, lines, bands): plotters cannot write CSS variables, so [`recolour`]
/// replaces these colours by them.
const TEXT: RGBColor = RGBColor(4, 0, 0);
const GRID: RGBColor = RGBColor(4, 0, 1);
const FRAME: RGBColor = RGBColor(4, 0, 2);

fn line_colour(style: MethodStyle) -> RGBColor {
    RGBColor(1, style.dash as u8, style.colour as u8)
}

fn band_colour(style: MethodStyle) -> RGBColor {
    RGBColor(2, 0, style.colour as u8)
}

fn mark_colour(style: MethodStyle) -> RGBColor {
    RGBColor(3, 0, style.colour as u8)
}

/// Draws the curves as an SVG chart with logarithmic axes; `None` without points.
pub(super) fn log_log(curves: &[PlottedCurve], x: &Axis, y: &Axis) -> Option<String> {
    let drawn = || curves.iter().flat_map(|curve| &curve.points);
    let x_range = range(drawn().map(|p| p.0), 0.03)?;
    let y_range = range(drawn().flat_map(|p| [p.1].into_iter().chain(p.2.into_iter().flatten())), 0.04)?;
    let area = PlotArea { x: x_range, y: y_range };
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        // Drawing into a string does not fail.
        let _ = draw(&root, &area, curves, [x, y]);
        let _ = root.present();
    }
    Some(recolour(&svg))
}

/// The base-10 logarithms of the smallest and the largest value, both moved outwards by the fraction `share` of their
/// distance, or by 0.15 if they nearly coincide. `None` without positive values.
fn range(values: impl Iterator<Item = f64>, share: f64) -> Option<[f64; 2]> {
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for value in values.filter(|v| *v > 0.0 && v.is_finite()) {
        let log = libm::log10(value);
        ends = [ends[0].min(log), ends[1].max(log)];
    }
    let width = ends[1] - ends[0];
    if !width.is_finite() {
        return None;
    }
    let by = if width < 0.05 { 0.15 } else { share * width };
    Some([ends[0] - by, ends[1] + by])
}

/// The mapping from values (on logarithmic axes) to pixels of the chart.
struct PlotArea {
    x: [f64; 2],
    y: [f64; 2],
}

impl PlotArea {
    fn place(&self, x: f64, y: f64) -> Option<(i32, i32)> {
        (x > 0.0 && y > 0.0).then(|| {
            let share = |v: f64, [low, high]: [f64; 2]| (libm::log10(v) - low) / (high - low);
            let [width, height] = inner();
            let px = f64::from(MARGIN.left) + share(x, self.x).clamp(0.0, 1.0) * width;
            let py = f64::from(MARGIN.top) + (1.0 - share(y, self.y).clamp(0.0, 1.0)) * height;
            (px.round() as i32, py.round() as i32)
        })
    }
}

fn inner() -> [f64; 2] {
    [f64::from(SIZE.0 as i32 - MARGIN.left - MARGIN.right), f64::from(SIZE.1 as i32 - MARGIN.top - MARGIN.bottom)]
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn draw<'a>(root: &Area<'a>, area: &PlotArea, curves: &[PlottedCurve], axes: [&Axis; 2]) -> Drawn<'a> {
    draw_axes(root, area, axes)?;
    for curve in curves {
        let ends =
            |end: usize| curve.points.iter().filter_map(move |p| area.place(p.0, p.2.map_or(p.1, |ends| ends[end])));
        if curve.points.iter().any(|p| p.2.is_some()) && curve.points.len() > 1 {
            let mut outline: Vec<_> = ends(0).collect();
            let upper: Vec<_> = ends(1).collect();
            outline.extend(upper.into_iter().rev());
            root.draw(&Polygon::new(outline, band_colour(curve.style).mix(0.13).filled()))?;
        } else if let ([(_, _, Some(_))], Some(low), Some(high)) = (&curve.points[..], ends(0).next(), ends(1).next()) {
            root.draw(&PathElement::new([low, high], mark_colour(curve.style).stroke_width(2)))?;
        }
    }
    for curve in curves {
        let places: Vec<_> = curve.points.iter().filter_map(|p| area.place(p.0, p.1)).collect();
        root.draw(&PathElement::new(places.clone(), line_colour(curve.style).stroke_width(2)))?;
        for place in places {
            draw_mark(root, place, curve.style)?;
        }
    }
    Ok(())
}

fn draw_mark<'a>(root: &Area<'a>, (x, y): (i32, i32), style: MethodStyle) -> Drawn<'a> {
    let colour = mark_colour(style);
    let polygon = |corners: &[(i32, i32)]| {
        Polygon::new(corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect::<Vec<_>>(), colour.filled())
    };
    match style.mark {
        0 => root.draw(&Circle::new((x, y), 4, colour.filled())),
        1 => root.draw(&polygon(&[(-4, -4), (4, -4), (4, 4), (-4, 4)])),
        2 => root.draw(&polygon(&[(0, -5), (5, 4), (-5, 4)])),
        3 => root.draw(&polygon(&[(0, -6), (6, 0), (0, 6), (-6, 0)])),
        4 => root.draw(&polygon(&[(0, 5), (5, -4), (-5, -4)])),
        5 => root.draw(&Circle::new((x, y), 4, colour.stroke_width(2))),
        6 => root.draw(&Cross::new((x, y), 4, colour.stroke_width(2))),
        _ => root.draw(&polygon(&[
            (-1, -5),
            (1, -5),
            (1, -1),
            (5, -1),
            (5, 1),
            (1, 1),
            (1, 5),
            (-1, 5),
            (-1, 1),
            (-5, 1),
            (-5, -1),
            (-1, -1),
        ])),
    }
}

fn draw_axes<'a>(root: &Area<'a>, area: &PlotArea, [x, y]: [&Axis; 2]) -> Drawn<'a> {
    let [left, top] = [MARGIN.left, MARGIN.top];
    let [right, bottom] = [SIZE.0 as i32 - MARGIN.right, SIZE.1 as i32 - MARGIN.bottom];
    let text = |size: u32, anchor| ("sans-serif", size).into_font().color(&TEXT).pos(anchor);
    let middle = 10.0_f64.powf(0.5 * (area.y[0] + area.y[1]));
    let mut room = i32::MIN;
    for value in ticks(x, area.x, 6) {
        let Some((px, _)) = area.place(value, middle) else { continue };
        root.draw(&PathElement::new([(px, top), (px, bottom)], GRID.stroke_width(1)))?;
        let label = tick_words(value);
        // Digits are about 0.6 of the font size wide.
        let half = (label.len() as i32 * WIDEST_FONT * 6) / 20;
        if px - half >= room {
            root.draw(&Text::new(label, (px, bottom + 6), text(FONT, Pos::new(HPos::Center, VPos::Top))))?;
            room = px + half + 6;
        }
    }
    let centre = 10.0_f64.powf(0.5 * (area.x[0] + area.x[1]));
    for value in ticks(y, area.y, 7) {
        let Some((_, py)) = area.place(centre, value) else { continue };
        root.draw(&PathElement::new([(left, py), (right, py)], GRID.stroke_width(1)))?;
        let label = tick_words(value);
        root.draw(&Text::new(label, (left - 6, py), text(FONT, Pos::new(HPos::Right, VPos::Center))))?;
    }
    root.draw(&Rectangle::new([(left, top), (right, bottom)], FRAME.stroke_width(1)))?;
    let place = ((left + right) / 2, SIZE.1 as i32 - 4);
    root.draw(&Text::new(x.title, place, text(FONT, Pos::new(HPos::Center, VPos::Bottom))))?;
    let turned = ("sans-serif", FONT).into_font().transform(FontTransform::Rotate270).color(&TEXT);
    let turned = turned.pos(Pos::new(HPos::Center, VPos::Top));
    root.draw(&Text::new(y.title, (0, (top + bottom) / 2), turned))
}

/// The values of ticks within a range of logarithms: those set for the axis, or the densest of four series with at most
/// `most` ticks. The series are 1; 1 and 3; 1, 2 and 5; and 1 to 9, times powers of ten.
fn ticks(axis: &Axis, [low, high]: [f64; 2], most: usize) -> Vec<f64> {
    let inside = |v: &f64| (low..=high).contains(&libm::log10(*v));
    if let Some(own) = &axis.ticks {
        return own.iter().copied().filter(inside).collect();
    }
    let decades = libm::floor(low) as i32..=libm::ceil(high) as i32;
    let of = |steps: &[u8]| -> Vec<f64> {
        let parse = |step: &u8, decade: i32| format!("{step}e{decade}").parse().unwrap_or(f64::NAN);
        decades.clone().flat_map(|d| steps.iter().map(move |s| parse(s, d))).filter(inside).collect()
    };
    let all: [&[u8]; 4] = [&[1], &[1, 3], &[1, 2, 5], &[1, 2, 3, 4, 5, 6, 7, 8, 9]];
    let found: Vec<Vec<f64>> = all.into_iter().map(of).collect();
    if found[0].len() > most {
        let step = found[0].len().div_ceil(most);
        return found[0].iter().copied().step_by(step).collect();
    }
    // The densest series of at most `most` ticks, if it has at least two.
    let fitting = found.iter().rev().find(|t| t.len() <= most && t.len() >= 2);
    fitting.or(found.iter().find(|t| t.len() >= 2)).unwrap_or(&found[3]).clone()
}

/// Formats a number for a tick, short and exact: `0.001`, `0.02`, `16`, `5e-6`.
pub(super) fn tick_words(value: f64) -> String {
    if (1e-3..1e5).contains(&value) { value.to_string() } else { format!("{value:e}") }
}

/// Replaces the placeholder colours in an SVG by the page's CSS variables, and adds dashes to lines.
fn recolour(svg: &str) -> String {
    let start = svg.find("<svg").unwrap_or(0);
    let mut svg = svg[start..].replacen(&format!("width=\"{}\" height=\"{}\" ", SIZE.0, SIZE.1), "", 1);
    for (colour, name) in [(TEXT, "ink-soft"), (GRID, "grid"), (FRAME, "frame")] {
        svg = svg.replace(&hex(colour), &format!("var(--{name})"));
    }
    for colour in 0..super::method_style::COLOURS {
        let style = |dash| MethodStyle { colour, mark: 0, dash };
        for dash in 0..super::method_style::DASHES.len() {
            let new = format!("\"var(--c{colour})\" stroke-dasharray=\"{}\"", super::method_style::DASHES[dash]);
            svg = svg.replace(&format!("\"{}\"", hex(line_colour(style(dash)))), &new);
        }
        for old in [band_colour(style(0)), mark_colour(style(0))] {
            svg = svg.replace(&hex(old), &format!("var(--c{colour})"));
        }
    }
    svg.replacen("<svg", "<svg aria-hidden=\"true\" focusable=\"false\"", 1)
}

fn hex(RGBColor(r, g, b): RGBColor) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// An SVG of a short piece of a method's line with its marker, for legends.
pub(super) fn swatch(style: MethodStyle) -> String {
    let mut svg = String::new();
    let (width, height) = (34, 16);
    {
        let root = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        let middle = height as i32 / 2;
        let drawn =
            root.draw(&PathElement::new([(1, middle), (width as i32 - 1, middle)], line_colour(style).stroke_width(2)));
        let _ = drawn.and_then(|()| draw_mark(&root, (width as i32 / 2, middle), style));
        let _ = root.present();
    }
    recolour(&svg)
}
