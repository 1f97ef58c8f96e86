//! A scene of depth of field: a row of balls, one of them in focus, and small lamps far behind.

use super::directions::{dot, normalize, scale, sub};
use std::fmt::Write;

const EYE: [f64; 3] = [0.0, -9.0, 2.3];
const TARGET: [f64; 3] = [0.0, 0.0, 0.75];
/// Index in [`BALLS`] of the ball in focus.
const SHARP: usize = 2;
const RADIUS: f64 = 0.55;

/// The balls from the nearest to the farthest: x, y and reflectance (linear RGB).
const BALLS: [(f64, f64, [f64; 3]); 6] = [
    (-1.6, -4.6, [0.75, 0.12, 0.08]),
    (-1.25, -2.9, [0.8, 0.4, 0.05]),
    (-0.5, -0.9, [0.8, 0.7, 0.1]),
    (0.6, 1.4, [0.15, 0.55, 0.15]),
    (2.3, 3.1, [0.08, 0.3, 0.7]),
    (4.6, 6.3, [0.4, 0.15, 0.6]),
];

/// The lamps in the background: x, z and hue (linear RGB).
const LAMPS: [(f64, f64, [f64; 3]); 12] = [
    (-6.2, 2.5, [1.0, 0.7, 0.4]),
    (-5.3, 1.0, [1.0, 0.85, 0.6]),
    (-4.4, 3.2, [0.6, 0.8, 1.0]),
    (-3.6, 1.7, [1.0, 0.5, 0.3]),
    (-2.5, 2.8, [1.0, 0.8, 0.5]),
    (-1.5, 1.4, [0.7, 1.0, 0.7]),
    (-0.3, 3.0, [1.0, 0.75, 0.45]),
    (0.8, 1.8, [1.0, 0.6, 0.6]),
    (2.0, 3.3, [1.0, 0.85, 0.6]),
    (3.1, 2.2, [0.6, 0.75, 1.0]),
    (4.7, 3.0, [1.0, 0.7, 0.4]),
    (6.0, 1.9, [1.0, 0.9, 0.7]),
];
const LAMPS_Y: f64 = 12.0;
const LAMP_RADIUS: f64 = 0.06;

/// Returns the distance, along the viewing direction, from the camera to the centre of the ball in focus.
pub(super) fn focal_distance() -> f64 {
    let (x, y, _) = BALLS[SHARP];
    dot(sub([x, y, RADIUS], EYE), normalize(sub(TARGET, EYE)))
}

/// Returns the text of the lens scene's file.
pub(super) fn scene() -> String {
    let triple = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
    let mut text = include_str!("lens.pbrt")
        .replace("{eye}", &triple(EYE))
        .replace("{target}", &triple(TARGET))
        .replace("{distance}", &format!("{:.4}", focal_distance()));
    for (number, (x, y, rgb)) in BALLS.into_iter().enumerate() {
        let _ = write!(
            text,
            "\nMakeNamedMaterial \"ball{number}\" \"string type\" \"coateddiffuse\" \"rgb reflectance\" [ {} ]\n  \
             \"float roughness\" [ 0.02 ] \"bool remaproughness\" false\n\
             AttributeBegin\n  Translate {x} {y} {RADIUS}\n  NamedMaterial \"ball{number}\"\n  \
             Shape \"sphere\" \"float radius\" [ {RADIUS} ]\nAttributeEnd\n",
            triple(rgb)
        );
    }
    for (x, z, hue) in LAMPS {
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate {x} {LAMPS_Y} {z}\n  NamedMaterial \"bulb\"\n  \
             AreaLightSource \"diffuse\" \"rgb L\" [ {} ]\n  Shape \"sphere\" \"float radius\" [ {LAMP_RADIUS} ]\nAttributeEnd\n",
            triple(scale(hue, 30.0))
        );
    }
    text
}
