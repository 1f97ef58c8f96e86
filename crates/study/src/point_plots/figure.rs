//! Figures with linear or logarithmic axes, as SVG files that stand alone.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

const SIZE: (u32, u32) = (480, 440);
const LEFT: i32 = 66;
const RIGHT: i32 = SIZE.0 as i32 - 16;
const TOP: i32 = 34;
const BOTTOM: i32 = SIZE.1 as i32 - 52;
const FONT: u32 = 13;

const INK: RGBColor = RGBColor(40, 40, 40);
const GRID: RGBColor = RGBColor(222, 222, 222);
/// Colours that people with colour blindness tell apart.
const CURVES: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(110, 110, 110)];

/// An axis: title, range and kind.
pub(super) struct Scale {
    title: &'static str,
    range: [f64; 2],
    logarithmic: bool,
}

impl Scale {
    pub(super) fn linear(title: &'static str, range: [f64; 2]) -> Self {
        Self { title, range, logarithmic: false }
    }

    pub(super) fn log(title: &'static str, range: [f64; 2]) -> Self {
        Self { title, range, logarithmic: true }
    }

    /// The place of a value on the axis, 0 to 1.
    fn share(&self, value: f64) -> f64 {
        let at = |v: f64| if self.logarithmic { libm::log10(v.max(1e-300)) } else { v };
        let [low, high] = self.range.map(at);
        ((at(value) - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// Four steps of a linear axis; powers of ten, or of four for counts, of a logarithmic one.
    fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.range;
        if !self.logarithmic {
            return (0..=4).map(|k| low + f64::from(k) / 4.0 * (high - low)).collect();
        }
        let base = if low >= 1.0 { 4.0_f64 } else { 10.0 };
        (-8..=8).map(|k| base.powi(k)).filter(|v| (low..=high).contains(v)).collect()
    }
}

/// A curve with its label.
pub(super) struct Curve {
    label: String,
    points: Vec<[f64; 2]>,
    dashed: bool,
}

impl Curve {
    pub(super) fn new(label: &str, points: Vec<[f64; 2]>) -> Self {
        Self { label: label.to_owned(), points, dashed: false }
    }

    pub(super) fn dashed(self) -> Self {
        Self { dashed: true, ..self }
    }
}

/// A figure: dots, or curves with a legend.
pub(super) struct Figure {
    title: String,
    x: Scale,
    y: Scale,
    dots: Vec<[f64; 2]>,
    curves: Vec<Curve>,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

impl Figure {
    pub(super) fn new(title: String, x: Scale, y: Scale) -> Self {
        Self { title, x, y, dots: Vec::new(), curves: Vec::new() }
    }

    pub(super) fn with_dots(self, dots: Vec<[f64; 2]>) -> Self {
        Self { dots, ..self }
    }

    pub(super) fn with_curve(mut self, curve: Curve) -> Self {
        self.curves.push(curve);
        self
    }

    /// The figure as an SVG file.
    pub(super) fn svg(&self) -> String {
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
            // Drawing into a string does not fail.
            let _ = self.draw(&root);
            let _ = root.present();
        }
        svg
    }

    fn place(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        let px = f64::from(LEFT) + self.x.share(x) * f64::from(RIGHT - LEFT);
        let py = f64::from(BOTTOM) - self.y.share(y) * f64::from(BOTTOM - TOP);
        (px.round() as i32, py.round() as i32)
    }

    fn draw<'a>(&self, root: &Area<'a>) -> Drawn<'a> {
        root.fill(&WHITE)?;
        self.draw_axes(root)?;
        for dot in &self.dots {
            root.draw(&Circle::new(self.place(*dot), if self.dots.len() > 300 { 2 } else { 3 }, CURVES[0].filled()))?;
        }
        for (number, curve) in self.curves.iter().enumerate() {
            let style = CURVES[number % CURVES.len()].stroke_width(2);
            let places: Vec<_> = curve.points.iter().map(|p| self.place(*p)).collect();
            draw_line(root, &places, curve.dashed, style)?;
            // A legend in the upper right corner.
            let y = TOP + 14 + 18 * number as i32;
            draw_line(root, &[(RIGHT - 190, y), (RIGHT - 160, y)], curve.dashed, style)?;
            root.draw(&Text::new(curve.label.clone(), (RIGHT - 152, y), text(Pos::new(HPos::Left, VPos::Center))))?;
        }
        Ok(())
    }

    fn draw_axes<'a>(&self, root: &Area<'a>) -> Drawn<'a> {
        for value in self.x.ticks() {
            let (px, _) = self.place([value, self.y.range[0]]);
            root.draw(&PathElement::new([(px, TOP), (px, BOTTOM)], GRID.stroke_width(1)))?;
            root.draw(&Text::new(value.to_string(), (px, BOTTOM + 6), text(Pos::new(HPos::Center, VPos::Top))))?;
        }
        for value in self.y.ticks() {
            let (_, py) = self.place([self.x.range[0], value]);
            root.draw(&PathElement::new([(LEFT, py), (RIGHT, py)], GRID.stroke_width(1)))?;
            root.draw(&Text::new(value.to_string(), (LEFT - 6, py), text(Pos::new(HPos::Right, VPos::Center))))?;
        }
        root.draw(&Rectangle::new([(LEFT, TOP), (RIGHT, BOTTOM)], INK.stroke_width(1)))?;
        let middle = (LEFT + RIGHT) / 2;
        root.draw(&Text::new(self.title.clone(), (middle, 10), text(Pos::new(HPos::Center, VPos::Top))))?;
        let below = (middle, SIZE.1 as i32 - 8);
        root.draw(&Text::new(self.x.title, below, text(Pos::new(HPos::Center, VPos::Bottom))))?;
        let turned = text(Pos::new(HPos::Center, VPos::Top)).transform(FontTransform::Rotate270);
        root.draw(&Text::new(self.y.title, (4, (TOP + BOTTOM) / 2), turned))
    }
}

fn text(anchor: Pos) -> TextStyle<'static> {
    ("sans-serif", FONT).into_font().color(&INK).pos(anchor)
}

/// A line through these places, or dashes of 6 pixels along it.
fn draw_line<'a>(root: &Area<'a>, places: &[(i32, i32)], dashed: bool, style: ShapeStyle) -> Drawn<'a> {
    if !dashed {
        return root.draw(&PathElement::new(places.to_vec(), style));
    }
    for ends in places.windows(2) {
        let [(ax, ay), (bx, by)] = [ends[0], ends[1]];
        let steps = ((bx - ax).abs().max((by - ay).abs()) / 6).max(1);
        let at = |k: i32| (ax + (bx - ax) * k / steps, ay + (by - ay) * k / steps);
        for k in (0..steps).step_by(2) {
            root.draw(&PathElement::new([at(k), at(k + 1)], style))?;
        }
    }
    Ok(())
}
