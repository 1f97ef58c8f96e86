//! A scene of transmission: clear, rough and thin glass, coloured glass, mist, and leaves cut out by alpha.

use super::images::tga_with_alpha;
use super::{Assets, opening};
use std::fmt::Write;

/// The twig's leaves: height on the stem, angle about the stem in degrees, tilt from upright in degrees, and size.
const LEAVES: [[f64; 4]; 11] = [
    [0.3, 20.0, 62.0, 0.62],
    [0.45, 157.0, 66.0, 0.66],
    [0.6, 295.0, 60.0, 0.68],
    [0.75, 72.0, 58.0, 0.66],
    [0.9, 210.0, 55.0, 0.62],
    [1.05, 347.0, 52.0, 0.6],
    [1.2, 125.0, 48.0, 0.56],
    [1.33, 262.0, 42.0, 0.5],
    [1.45, 40.0, 36.0, 0.44],
    [1.55, 177.0, 28.0, 0.38],
    [1.62, 315.0, 16.0, 0.32],
];

/// Width and height of the square leaf image, in pixels.
const LEAF: u16 = 96;

/// Returns the sRGB colour and the opacity of a pixel of the leaf image. The leaf grows upwards from the middle of the
/// bottom edge.
fn leaf(column: u16, row: u16) -> [u8; 4] {
    let unit = |i: u16| (f64::from(i) + 0.5) / f64::from(LEAF);
    let (across, along) = ((2.0 * unit(column) - 1.0).abs(), 1.0 - unit(row));
    // The leaf is widest at a third of its length and has a toothed edge.
    let teeth = 0.04 * (12.0 * along - (12.0 * along).floor());
    let rest = 1.0 - along;
    let width = 6.5 * along * rest * rest * 0.8 + 0.03 - teeth * rest;
    if across > width || along > 0.97 {
        return [0, 0, 0, 0];
    }
    let rib = {
        let slanted = 9.0 * along - 4.0 * across;
        across < 0.035 || slanted - slanted.floor() < 0.1
    };
    if rib { [150, 170, 80, 255] } else { [70, 130, 45, 255] }
}

/// The bars of the pane's frame. Each is a box, given by its minimum and maximum corners.
const BARS: [[[f64; 3]; 2]; 4] = [
    [[-0.64, -0.03, 0.0], [0.64, 0.03, 0.05]],
    [[-0.64, -0.02, 1.0], [0.64, 0.02, 1.04]],
    [[-0.64, -0.02, 0.05], [-0.6, 0.02, 1.0]],
    [[0.6, -0.02, 0.05], [0.64, 0.02, 1.0]],
];

/// Returns the pbrt parameters of one triangle mesh that holds all bars of the pane's frame, with normals outwards.
fn frame() -> String {
    let (mut points, mut indices) = (String::new(), String::new());
    for (number, bar) in BARS.iter().enumerate() {
        for corner in 0..8 {
            let [x, y, z] = [0, 1, 2].map(|axis| bar[corner >> axis & 1][axis]);
            let _ = write!(points, " {x} {y} {z} ");
        }
        for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            let at = |corner| 8 * number + corner;
            let [a, b, c, d] = [a, b, c, d].map(at);
            let _ = write!(indices, " {a} {b} {c}  {a} {c} {d} ");
        }
    }
    format!("    \"point3 P\" [{points}]\n    \"integer indices\" [{indices}]\n")
}

/// Returns the text of the scene file, and the name and bytes of the scene's other files.
pub(super) fn scene() -> (String, Assets) {
    let mut text = opening(
        "Glass: a clear ball, a rough one, one filled with red dye, a ball of mist, a thin pane that leans, and a\n\
         twig whose leaves are squares cut out by the opacity of leaf.tga.",
    );
    text += r#"Film "rgb" "integer xresolution" [ 600 ] "integer yresolution" [ 400 ] "string filename" "glass.exr"
PixelFilter "box"
Sampler "zsobol" "integer pixelsamples" [ 256 ]
Integrator "path" "integer maxdepth" [ 16 ]

# z is up and the world right-handed; pbrt's camera is left-handed, hence the mirror.
Scale -1 1 1
LookAt 0.2 -9 3.4  0.2 0 0.85  0 0 1
Camera "perspective" "float fov" [ 32 ]

MakeNamedMedium "dye" "string type" "homogeneous" "rgb sigma_a" [ 0.12 1.6 2.2 ] "rgb sigma_s" [ 0 0 0 ]
MakeNamedMedium "mist" "string type" "homogeneous"
  "rgb sigma_a" [ 0.02 0.02 0.02 ] "rgb sigma_s" [ 2 2.1 2.3 ] "float g" [ 0.3 ]

WorldBegin

LightSource "infinite" "rgb L" [ 0.55 0.6 0.7 ]

Texture "checks" "spectrum" "checkerboard" "float uscale" [ 48 ] "float vscale" [ 48 ]
  "rgb tex1" [ 0.62 0.55 0.45 ] "rgb tex2" [ 0.22 0.19 0.17 ]
Texture "leaf colour" "spectrum" "imagemap" "string filename" "leaf.tga"
Texture "leaf holes" "float" "imagemap" "string filename" "leaf.tga"
MakeNamedMaterial "floor" "string type" "diffuse" "texture reflectance" "checks"
MakeNamedMaterial "bulb" "string type" "diffuse" "rgb reflectance" [ 0 0 0 ]
MakeNamedMaterial "stem" "string type" "diffuse" "rgb reflectance" [ 0.2 0.16 0.06 ]
MakeNamedMaterial "leaf" "string type" "diffusetransmission"
  "texture reflectance" "leaf colour" "texture transmittance" "leaf colour"
MakeNamedMaterial "clear" "string type" "dielectric" "float eta" [ 1.5 ]
MakeNamedMaterial "rough" "string type" "dielectric" "float eta" [ 1.5 ]
  "float roughness" [ 0.15 ] "bool remaproughness" false
MakeNamedMaterial "pane" "string type" "thindielectric" "float eta" [ 1.5 ]
MakeNamedMaterial "frame" "string type" "conductor" "rgb eta" [ 1.4 1 0.6 ] "rgb k" [ 7.5 6.5 5.3 ]
  "float roughness" [ 0.2 ] "bool remaproughness" false
MakeNamedMaterial "nothing" "string type" "interface"

NamedMaterial "floor"
Shape "trianglemesh"
  "point3 P" [ -20 -20 0  20 -20 0  20 20 0  -20 20 0 ]
  "point2 uv" [ 0 0  1 0  1 1  0 1 ]
  "integer indices" [ 0 1 2  0 2 3 ]

AttributeBegin
  Translate -3 -3 6
  NamedMaterial "bulb"
  AreaLightSource "diffuse" "rgb L" [ 16 15 13 ]
  Shape "sphere" "float radius" [ 1.5 ]
AttributeEnd

AttributeBegin
  Translate -2.1 -0.6 0.75
  NamedMaterial "clear"
  Shape "sphere" "float radius" [ 0.75 ]
AttributeEnd

AttributeBegin
  Translate -0.75 1.1 0.75
  NamedMaterial "rough"
  Shape "sphere" "float radius" [ 0.75 ]
AttributeEnd

AttributeBegin
  Translate 0.7 -0.9 0.7
  NamedMaterial "clear"
  MediumInterface "dye" ""
  Shape "sphere" "float radius" [ 0.7 ]
AttributeEnd

AttributeBegin
  Translate 2.45 -1 0.75
  NamedMaterial "nothing"
  MediumInterface "mist" ""
  Shape "sphere" "float radius" [ 0.75 ]
AttributeEnd

# The pane leans back in a frame of metal.
AttributeBegin
  Translate -0.7 -2.3 0
  Rotate 25 0 0 1
  Rotate -12 1 0 0
  NamedMaterial "pane"
  Shape "trianglemesh"
    "point3 P" [ -0.6 0 0.05  0.6 0 0.05  0.6 0 1  -0.6 0 1 ]
    "integer indices" [ 0 1 2  0 2 3 ]
  NamedMaterial "frame"
  Shape "trianglemesh"
"#;
    text += &frame();
    text += r#"AttributeEnd

# The twig.
ObjectBegin "leaf"
  NamedMaterial "leaf"
  Shape "trianglemesh" "texture alpha" "leaf holes"
    "point3 P" [ -0.5 0 0  0.5 0 0  0.5 0 1  -0.5 0 1 ]
    "point2 uv" [ 0 0  1 0  1 1  0 1 ]
    "integer indices" [ 0 1 2  0 2 3 ]
ObjectEnd
AttributeBegin
  Translate 1.75 1 0
  NamedMaterial "stem"
  Shape "trianglemesh"
    "point3 P" [ -0.04 -0.023 0  0.04 -0.023 0  0 0.046 0  0 0 1.7 ]
    "integer indices" [ 0 1 3  1 2 3  2 0 3 ]
AttributeEnd
"#;
    for [height, turn, down, size] in LEAVES {
        let _ = write!(
            text,
            "AttributeBegin\n  Translate 1.75 1 {height}\n  Rotate {turn} 0 0 1\n  Rotate {down} 1 0 0\n  \
             Scale {size} {size} {size}\n  ObjectInstance \"leaf\"\nAttributeEnd\n"
        );
    }
    (text, vec![("leaf.tga".to_owned(), tga_with_alpha(LEAF, LEAF, leaf))])
}
