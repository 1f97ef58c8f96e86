//! A scene of depth of field: a row of balls, one of them in focus, and small lamps far behind.

use super::directions::{dot, normalize, scale, sub};
use super::opening;
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
    let mut text = opening(
        "Lens: a row of balls seen through a thin lens that is focused on the third of them;\n\
         small lamps far behind become disks.",
    );
    text += r#"Film "rgb" "integer xresolution" [ 600 ] "integer yresolution" [ 400 ] "string filename" "lens.exr"
PixelFilter "box"
Sampler "zsobol" "integer pixelsamples" [ 128 ]
Integrator "path" "integer maxdepth" [ 5 ]

# z is up and the world right-handed; pbrt's camera is left-handed, hence the mirror.
Scale -1 1 1
"#;
    let triple = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}");
    let _ = writeln!(text, "LookAt {}  {}  0 0 1", triple(EYE), triple(TARGET));
    let _ = write!(
        text,
        "# To the middle of the third ball, along the view.\n\
         Camera \"perspective\" \"float fov\" [ 30 ]\n  \"float lensradius\" [ 0.2 ] \"float focaldistance\" [ {:.4} ]\n",
        focal_distance()
    );
    text += r#"
WorldBegin

LightSource "infinite" "rgb L" [ 0.09 0.1 0.13 ]

Texture "checks" "spectrum" "checkerboard" "float uscale" [ 32 ] "float vscale" [ 32 ]
  "rgb tex1" [ 0.5 0.47 0.42 ] "rgb tex2" [ 0.14 0.13 0.13 ]
MakeNamedMaterial "floor" "string type" "diffuse" "texture reflectance" "checks"
MakeNamedMaterial "bulb" "string type" "diffuse" "rgb reflectance" [ 0 0 0 ]

NamedMaterial "floor"
Shape "trianglemesh"
  "point3 P" [ -16 -16 0  16 -16 0  16 16 0  -16 16 0 ]
  "point2 uv" [ 0 0  1 0  1 1  0 1 ]
  "integer indices" [ 0 1 2  0 2 3 ]

# The lamp that lights the balls, up on the left behind the camera.
AttributeBegin
  Translate -5 -7 7
  NamedMaterial "bulb"
  AreaLightSource "diffuse" "rgb L" [ 22 20 17 ]
  Shape "sphere" "float radius" [ 1 ]
AttributeEnd
"#;
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
