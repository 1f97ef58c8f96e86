//! Rough metal plates under sphere lights of different size.

use super::directions::{add, cross, normalize, scale, sub};
use std::fmt::Write;

const CAMERA: [f64; 3] = [0.0, -9.0, 3.2];
const TARGET: [f64; 3] = [0.0, 0.6, 1.55];
/// Centre of the row of lights. Each plate is tilted so that it reflects this point to the camera.
const LIGHTS: [f64; 3] = [0.0, 3.4, 4.2];

/// The plates from the nearest to the farthest: y and z of the centre, and roughness (alpha).
const PLATES: [(f64, f64, f64); 4] = [(-2.3, 0.25, 0.15), (-1.1, 0.35, 0.06), (0.2, 0.65, 0.025), (1.5, 1.15, 0.01)];
const HALF_WIDTH: f64 = 2.6;
const HALF_LENGTH: f64 = 0.55;

/// The sphere lights: x, radius and hue (linear RGB). All emit the same power apart from hue, so that smaller lights
/// are brighter.
const SPHERES: [(f64, f64, [f64; 3]); 4] = [
    (-2.4, 0.04, [1.0, 0.75, 0.55]),
    (-0.9, 0.12, [1.0, 0.95, 0.8]),
    (0.7, 0.3, [0.75, 1.0, 0.85]),
    (2.4, 0.6, [0.65, 0.8, 1.0]),
];

/// Returns the corners of the plate centred at `y`, `z`, tilted so that it reflects the centre of the row of lights to
/// the camera.
pub(super) fn plate(y: f64, z: f64) -> [[f64; 3]; 4] {
    let centre = [0.0, y, z];
    let to_camera = normalize(sub(CAMERA, centre));
    let to_lights = normalize(sub(LIGHTS, centre));
    let normal = normalize(add(to_camera, to_lights));
    let right = [HALF_WIDTH, 0.0, 0.0];
    let along = scale(cross(normal, [1.0, 0.0, 0.0]), HALF_LENGTH);
    [
        sub(sub(centre, right), along),
        sub(add(centre, right), along),
        add(add(centre, right), along),
        add(sub(centre, right), along),
    ]
}

/// Returns the text of the plates scene's file.
pub(super) fn scene() -> String {
    let triple = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
    let mut text =
        include_str!("plates.pbrt").replace("{camera}", &triple(CAMERA)).replace("{target}", &triple(TARGET));
    for (number, (y, z, roughness)) in PLATES.into_iter().enumerate() {
        let _ = write!(
            text,
            "\nMakeNamedMaterial \"plate{number}\" \"string type\" \"conductor\"\n  \
             \"rgb eta\" [ 1.1 1.1 1.1 ] \"rgb k\" [ 5 5 5 ]\n  \
             \"float roughness\" [ {roughness} ] \"bool remaproughness\" false\n\
             NamedMaterial \"plate{number}\"\nShape \"trianglemesh\"\n  \"point3 P\" ["
        );
        for corner in plate(y, z) {
            let _ = write!(text, " {} ", triple(corner));
        }
        text += "]\n  \"integer indices\" [ 0 1 2  0 2 3 ]\n";
    }
    for (x, radius, hue) in SPHERES {
        // The power of a diffuse sphere goes with radius squared times radiance.
        let radiance = scale(hue, 1.6 / (radius * radius));
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate {x} {} {}\n  NamedMaterial \"bulb\"\n  \
             AreaLightSource \"diffuse\" \"rgb L\" [ {} ]\n  Shape \"sphere\" \"float radius\" [ {radius} ]\nAttributeEnd\n",
            LIGHTS[1],
            LIGHTS[2],
            triple(radiance)
        );
    }
    text
}
