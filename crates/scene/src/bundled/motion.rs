//! A scene of motion blur: a mill turns, a ball rolls and dice fall while the shutter is open.

use super::opening;
use std::fmt::Write;

/// Rotation of the mill while the shutter is open, in degrees.
const TURN: f64 = 20.0;
/// The x coordinate of the rolling ball when the shutter opens, and when it closes.
const ROLL: [f64; 2] = [0.1, 0.45];
const BALL: f64 = 0.55;

/// The dice: x, height when the shutter closes, distance fallen and degrees turned while the shutter is open.
const DICE: [(f64, f64, f64, f64); 3] = [(1.2, 2.7, 0.0, 0.0), (2.2, 2.0, 0.2, 12.0), (3.2, 1.1, 0.4, 24.0)];

/// Returns the text of the motion scene's file.
pub(super) fn scene() -> String {
    let mut text = opening(
        "Motion: a mill that turns, a ball that rolls, and dice that fall (but for the first one) while the shutter\n\
         is open. Blades and dice are instances of one mesh each.",
    );
    text += r#"Film "rgb" "integer xresolution" [ 600 ] "integer yresolution" [ 400 ] "string filename" "motion.exr"
PixelFilter "box"
Sampler "zsobol" "integer pixelsamples" [ 128 ]
Integrator "path" "integer maxdepth" [ 4 ]

TransformTimes 0 1
# z is up and the world right-handed; pbrt's camera is left-handed, hence the mirror.
Scale -1 1 1
LookAt 0.4 -10 3.2  0.4 0 1.55  0 0 1
Camera "perspective" "float fov" [ 30 ] "float shutteropen" [ 0 ] "float shutterclose" [ 1 ]

WorldBegin

LightSource "infinite" "rgb L" [ 0.35 0.4 0.5 ]

Texture "tiles" "spectrum" "checkerboard" "float uscale" [ 30 ] "float vscale" [ 30 ]
  "rgb tex1" [ 0.42 0.42 0.4 ] "rgb tex2" [ 0.3 0.3 0.3 ]
Texture "patches" "spectrum" "checkerboard" "float uscale" [ 8 ] "float vscale" [ 4 ]
  "rgb tex1" [ 0.8 0.76 0.7 ] "rgb tex2" [ 0.1 0.2 0.55 ]
MakeNamedMaterial "floor" "string type" "diffuse" "texture reflectance" "tiles"
MakeNamedMaterial "ball" "string type" "diffuse" "texture reflectance" "patches"
MakeNamedMaterial "wood" "string type" "diffuse" "rgb reflectance" [ 0.45 0.28 0.14 ]
MakeNamedMaterial "sail" "string type" "diffuse" "rgb reflectance" [ 0.75 0.16 0.1 ]
MakeNamedMaterial "die" "string type" "coateddiffuse" "rgb reflectance" [ 0.7 0.55 0.1 ]
  "float roughness" [ 0.1 ] "bool remaproughness" false
MakeNamedMaterial "bulb" "string type" "diffuse" "rgb reflectance" [ 0 0 0 ]

NamedMaterial "floor"
Shape "trianglemesh"
  "point3 P" [ -15 -15 0  15 -15 0  15 15 0  -15 15 0 ]
  "point2 uv" [ 0 0  1 0  1 1  0 1 ]
  "integer indices" [ 0 1 2  0 2 3 ]

AttributeBegin
  Translate -4 -6 8
  NamedMaterial "bulb"
  AreaLightSource "diffuse" "rgb L" [ 30 28 25 ]
  Shape "sphere" "float radius" [ 1 ]
AttributeEnd

# The mill: its post, its hub, and four blades about the hub.
NamedMaterial "wood"
Shape "trianglemesh"
  "point3 P" [ -2.17 0.1 0  -1.83 0.1 0  -1.93 0.1 2  -2.07 0.1 2
    -2.17 0.4 0  -1.83 0.4 0  -1.93 0.3 2  -2.07 0.3 2 ]
  "integer indices" [ 0 1 2 0 2 3  1 5 6 1 6 2  5 4 7 5 7 6  4 0 3 4 3 7  3 2 6 3 6 7 ]
AttributeBegin
  Translate -2 0 2
  Shape "sphere" "float radius" [ 0.16 ]
AttributeEnd

ObjectBegin "blade"
  NamedMaterial "sail"
  # Along z, and slanted against the plane that it turns in.
  Shape "trianglemesh"
    "point3 P" [ -0.06 -0.02 0.1  0.06 0.02 0.1  0.36 0.1 1.4  -0.1 -0.06 1.4 ]
    "integer indices" [ 0 1 2  0 2 3 ]
ObjectEnd

ObjectBegin "die"
  NamedMaterial "die"
  Shape "trianglemesh"
    "point3 P" [ -1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1 ]
    "integer indices" [ 0 2 3 0 3 1  4 5 7 4 7 6  0 1 5 0 5 4  2 6 7 2 7 3  0 4 6 0 6 2  1 3 7 1 7 5 ]
ObjectEnd
"#;
    for blade in 0..4 {
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate -2 0 2\n  Rotate {} 0 1 0\n  ActiveTransform EndTime\n  \
             Rotate {TURN} 0 1 0\n  ActiveTransform All\n  ObjectInstance \"blade\"\nAttributeEnd\n",
            20 + 90 * blade
        );
    }
    let [from, to] = ROLL;
    // It rolls without slipping, 180 / pi degrees for each radius; its poles lie along the axis that it turns about.
    let turn = (to - from) / BALL * (180.0 / std::f64::consts::PI);
    let _ = write!(
        text,
        "\n# A ball that rolls to the right.\nAttributeBegin\n  Translate {from} -2 {BALL}\n  ActiveTransform EndTime\n  \
         Translate {} 0 0\n  Rotate {turn:.3} 0 1 0\n  ActiveTransform All\n  Rotate 60 1 0 0.3\n  NamedMaterial \"ball\"\n  \
         Shape \"sphere\" \"float radius\" [ {BALL} ]\nAttributeEnd\n",
        to - from
    );
    for (x, z, fallen, turn) in DICE {
        let moves = match fallen > 0.0 {
            true => format!(
                "  ActiveTransform EndTime\n  Translate 0 0 {}\n  Rotate {turn} 1 0.4 0.2\n  ActiveTransform All\n",
                -fallen
            ),
            false => String::new(),
        };
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate {x} 0 {}\n{moves}  Rotate 35 0.3 0.2 1\n  Scale 0.38 0.38 0.38\n  \
             ObjectInstance \"die\"\nAttributeEnd\n",
            z + fallen
        );
    }
    text
}
