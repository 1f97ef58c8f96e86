//! A dark cabin that many small lamps of different colours light.

use super::cornell::{Quad, write_mesh};
use super::directions::{add, cross, normalize, scale};
use super::revolved::revolved;
use super::room::{Corners, sides};
use std::fmt::Write;

/// Hull, desk, frames, seats, as boxes: material, minimum and maximum corners.
const BOXES: [(&str, Corners); 25] = [
    ("hull", [[-1.3, -1.8, 0.0], [1.3, 1.4, 0.02]]),
    ("hull", [[-1.3, -1.8, 2.0], [1.3, 1.4, 2.02]]),
    ("hull", [[-1.32, -1.8, 0.0], [-1.3, 1.4, 2.0]]),
    ("hull", [[1.3, -1.8, 0.0], [1.32, 1.4, 2.0]]),
    ("hull", [[-1.3, -1.82, 0.0], [1.3, -1.8, 2.0]]),
    // Around the windscreen.
    ("hull", [[-1.3, 1.3, 0.0], [1.3, 1.34, 1.12]]),
    ("hull", [[-1.3, 1.3, 1.62], [1.3, 1.34, 2.0]]),
    ("hull", [[-1.3, 1.28, 1.12], [-1.2, 1.34, 1.62]]),
    ("hull", [[1.2, 1.28, 1.12], [1.3, 1.34, 1.62]]),
    ("hull", [[-0.04, 1.28, 1.12], [0.04, 1.34, 1.62]]),
    ("hull", [[-0.68, 1.28, 1.12], [-0.62, 1.34, 1.62]]),
    ("hull", [[0.62, 1.28, 1.12], [0.68, 1.34, 1.62]]),
    // Ribs of the walls.
    ("hull", [[-1.3, -0.5, 0.0], [-1.24, -0.42, 2.0]]),
    ("hull", [[1.24, -0.5, 0.0], [1.3, -0.42, 2.0]]),
    ("hull", [[-1.3, 0.3, 0.0], [-1.24, 0.38, 2.0]]),
    ("hull", [[1.24, 0.3, 0.0], [1.3, 0.38, 2.0]]),
    // Desk, its front, and the shade above the panel.
    ("desk", [[-1.3, 0.12, 0.66], [1.3, 0.62, 0.7]]),
    ("rubber", [[-1.3, 0.2, 0.0], [1.3, 0.24, 0.66]]),
    ("rubber", [[-1.3, 0.56, 1.16], [1.3, 1.3, 1.19]]),
    // The console between the seats.
    ("desk", [[-0.14, -0.9, 0.0], [0.2, 0.2, 0.6]]),
    // The other seat.
    ("leather", [[0.42, -0.9, 0.36], [0.98, -0.3, 0.5]]),
    ("leather", [[0.42, -1.02, 0.5], [0.98, -0.9, 1.16]]),
    ("leather", [[0.56, -1.0, 1.18], [0.84, -0.92, 1.38]]),
    ("leather", [[0.36, -0.84, 0.62], [0.42, -0.4, 0.67]]),
    ("leather", [[0.98, -0.84, 0.62], [1.04, -0.4, 0.67]]),
];

/// A flat panel: a corner, and its sides to the right and upwards.
type Panel = [[f64; 3]; 3];
/// The main panel, which leans back.
const MAIN: Panel = [[-1.3, 0.6, 0.7], [2.6, 0.0, 0.0], [0.0, 0.12, 0.46]];
/// The panel under the ceiling.
const OVERHEAD: Panel = [[0.55, 0.5, 1.72], [-1.1, 0.0, 0.0], [0.0, 0.5, -0.1]];
/// The top of the console.
const CONSOLE: Panel = [[-0.14, -0.9, 0.601], [0.34, 0.0, 0.0], [0.0, 1.1, 0.0]];

/// Screens of the main panel: left, right, low and high as parts of it, and radiance.
const SCREENS: [([f64; 4], [f64; 3]); 4] = [
    ([0.13, 0.25, 0.28, 0.82], [0.02, 0.09, 0.2]),
    ([0.29, 0.41, 0.28, 0.82], [0.02, 0.14, 0.05]),
    ([0.45, 0.57, 0.28, 0.82], [0.18, 0.1, 0.02]),
    ([0.66, 0.82, 0.28, 0.82], [0.03, 0.09, 0.12]),
];

/// Colours of the lamps: green, amber, red, white, blue.
const COLOURS: [[f64; 3]; 5] =
    [[0.15, 1.0, 0.3], [1.0, 0.55, 0.1], [1.0, 0.08, 0.05], [0.9, 0.9, 0.8], [0.15, 0.4, 1.0]];

/// Rows of lamps: the panel, height on it, first and last place along it, number, radius in metres, radiance.
const ROWS: [(Panel, f64, [f64; 2], usize, f64, f64); 9] = [
    (MAIN, 0.92, [0.08, 0.92], 17, 0.007, 90.0),
    (MAIN, 0.14, [0.12, 0.58], 13, 0.007, 90.0),
    (MAIN, 0.6, [0.86, 0.95], 3, 0.009, 90.0),
    (MAIN, 0.35, [0.86, 0.95], 3, 0.009, 90.0),
    (OVERHEAD, 0.2, [0.1, 0.9], 7, 0.01, 110.0),
    (OVERHEAD, 0.5, [0.1, 0.9], 7, 0.01, 110.0),
    (OVERHEAD, 0.8, [0.1, 0.9], 7, 0.01, 110.0),
    (CONSOLE, 0.75, [0.2, 0.8], 4, 0.007, 90.0),
    (CONSOLE, 0.92, [0.2, 0.8], 4, 0.007, 90.0),
];

/// Lamps in the open: place, radius, radiance.
const LAMPS: [([f64; 3], f64, [f64; 3]); 3] = [
    ([0.95, -0.2, 1.7], 0.02, [160.0, 110.0, 60.0]),
    ([-1.26, 0.1, 1.0], 0.014, [160.0, 24.0, 12.0]),
    ([1.1, 1.2, 1.08], 0.01, [30.0, 90.0, 180.0]),
];

/// The levers of the console: x, and the tilt towards the seats in degrees.
const LEVERS: [(f64, f64); 3] = [(-0.07, 24.0), (0.03, -12.0), (0.13, 12.0)];

/// Returns the point at parts `u` and `v` of a panel's sides, `above` metres over it.
fn on([corner, right, up]: Panel, [u, v]: [f64; 2], above: f64) -> [f64; 3] {
    let normal = normalize(cross(right, up));
    let point = add(add(corner, scale(right, u)), add(scale(up, v), scale(normal, above)));
    point.map(|x| (x * 1e4).round() / 1e4)
}

/// Returns the part of a panel between two places, `above` metres over it.
fn part(panel: Panel, [left, right, low, high]: [f64; 4], above: f64) -> Quad {
    [[left, low], [right, low], [right, high], [left, high]].map(|place| on(panel, place, above))
}

/// Adds a ball, with the given emission if it is a lamp.
fn ball(text: &mut String, [x, y, z]: [f64; 3], radius: f64, light: Option<[f64; 3]>) {
    let _ = writeln!(text, "AttributeBegin\nTranslate {x} {y} {z}");
    if let Some([r, g, b]) = light {
        let _ =
            writeln!(text, "NamedMaterial \"lamp\"\nAreaLightSource \"diffuse\" \"rgb L\" [ {r:.3} {g:.3} {b:.3} ]");
    }
    let _ = writeln!(text, "Shape \"sphere\" \"float radius\" [ {radius} ]\nAttributeEnd");
}

/// Half the cross-section of a rod of radius and length 1.
const ROD: [[f64; 2]; 8] =
    [[0.0, 0.0], [0.95, 0.0], [1.02, 0.0], [1.03, 0.02], [1.03, 0.94], [1.03, 0.99], [0.95, 1.0], [0.0, 1.0]];

/// Adds a rod that stands on `foot`, turned by `tilt` degrees about the x axis.
fn rod(text: &mut String, kind: &str, [x, y, z]: [f64; 3], [radius, length, tilt]: [f64; 3]) {
    let _ =
        writeln!(text, "AttributeBegin\nTranslate {x} {y} {z}\nRotate {tilt} 1 0 0\nScale {radius} {radius} {length}");
    let _ = writeln!(text, "ObjectInstance \"{kind}\"\nAttributeEnd");
}

/// Returns the lines of text on a screen, as parts of the main panel.
fn lines([left, right, low, high]: [f64; 4], screen: usize) -> Vec<Quad> {
    let (width, height) = (right - left, high - low);
    let mut quads = Vec::new();
    for row in 0..8 {
        let step = |times: usize, of: usize| ((row * times + screen * 3) % of) as f64;
        let from = left + width * (0.08 + 0.06 * step(2, 3));
        let to = from + width * (0.2 + 0.11 * step(3, 6));
        let foot = low + height * (0.08 + 0.11 * row as f64);
        quads.push(part(MAIN, [from, to, foot, foot + 0.05 * height], 0.006));
    }
    quads
}

/// Adds panels, screens and lamps.
fn lights(text: &mut String) {
    *text += "\n# panels\nNamedMaterial \"panel\"\n";
    write_mesh(text, &[MAIN, OVERHEAD, CONSOLE].map(|panel| part(panel, [0.0, 1.0, 0.0, 1.0], 0.0)));
    for (screen, (place, [r, g, b])) in SCREENS.into_iter().enumerate() {
        for (level, quads) in [(1.0, vec![part(MAIN, place, 0.004)]), (8.0, lines(place, screen))] {
            let [r, g, b] = [r, g, b].map(|x| x * level);
            let _ = writeln!(text, "\n# screen\nAttributeBegin\nNamedMaterial \"lamp\"");
            let _ = writeln!(text, "AreaLightSource \"diffuse\" \"rgb L\" [ {r:.3} {g:.3} {b:.3} ]");
            write_mesh(text, &quads);
            *text += "AttributeEnd\n";
        }
    }
    *text += "\n# lamps\n";
    let mut number = 0;
    for (panel, height, [first, last], count, radius, radiance) in ROWS {
        for lamp in 0..count {
            let along = first + (last - first) * lamp as f64 / (count - 1) as f64;
            let colour = COLOURS[(number * 7 + number / 5) % 5];
            ball(text, on(panel, [along, height], radius), radius, Some(scale(colour, radiance)));
            number += 1;
        }
    }
    for (place, radius, radiance) in LAMPS {
        ball(text, place, radius, Some(radiance));
    }
}

/// Adds knobs, levers with balls on them, and tubes.
fn fittings(text: &mut String) {
    for (kind, material) in [("knob", "metal"), ("tube", "polished")] {
        let _ = writeln!(text, "\nObjectBegin \"{kind}\"\nNamedMaterial \"{material}\"");
        *text += &revolved(&ROD);
        *text += "ObjectEnd\n";
    }
    *text += "\n# knobs and levers\n";
    for knob in 0..6 {
        let place = on(MAIN, [0.64 + 0.035 * f64::from(knob), 0.15], 0.0);
        rod(text, "knob", place, [0.016, 0.03, 75.4]);
    }
    for knob in 0..5 {
        let place = on(CONSOLE, [0.15 + 0.175 * f64::from(knob), 0.62], 0.0);
        rod(text, "knob", place, [0.018, 0.03, 0.0]);
    }
    *text += "\nNamedMaterial \"polished\"\n";
    for (x, tilt) in LEVERS {
        // Sine and cosine by their series: the angles are small.
        let a = tilt * (std::f64::consts::PI / 180.0);
        let [sin, cos] = [a - a * a * a / 6.0, 1.0 - a * a / 2.0];
        let round = |x: f64| (x * 1e4).round() / 1e4;
        rod(text, "knob", [x, -0.3, 0.6], [0.009, 0.2, tilt]);
        ball(text, [x, round(-0.3 - 0.22 * sin), round(0.6 + 0.22 * cos)], 0.034, None);
    }
    *text += "\n# tubes under the ceiling\n";
    for x in [-0.8, 0.75] {
        rod(text, "tube", [x, 1.3, 1.9], [0.035, 3.1, 90.0]);
    }
}

/// Returns the text of the cabin scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("cabin.pbrt").to_owned();
    for material in ["hull", "desk", "rubber", "leather"] {
        let of = BOXES.iter().filter(|(of, _)| *of == material);
        let quads: Vec<Quad> = of.flat_map(|(_, corners)| sides(*corners)).collect();
        let _ = writeln!(text, "\nNamedMaterial \"{material}\"");
        write_mesh(&mut text, &quads);
    }
    fittings(&mut text);
    lights(&mut text);
    text
}
