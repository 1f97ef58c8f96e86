//! The inside of a glowing diffuse sphere.

use super::opening;

/// Returns the text of the furnace's scene file.
pub(super) fn scene() -> String {
    let mut text = opening(
        "Furnace: the inside of a sphere that reflects rho = 0.5 of all light and gives off Le = 0.5 itself.\n\
         Every ray meets radiance Le / (1 - rho) = 1; with at most D scattering events (maxdepth D) it is\n\
         Le (1 - rho^(D+1)) / (1 - rho), here 1 - 2^-33. An image of it is flat white, and any deviation is a fault.",
    );
    text += r#"Film "rgb" "integer xresolution" [ 64 ] "integer yresolution" [ 64 ] "string filename" "furnace.exr"
PixelFilter "box"
Sampler "zsobol" "integer pixelsamples" [ 16 ]
Integrator "path" "integer maxdepth" [ 32 ]

# Off the centre, so that the camera sees the wall at slanted angles too.
LookAt 0.5 0.25 0  -1 0 0.25  0 0 1
Camera "perspective" "float fov" [ 60 ]

WorldBegin

MakeNamedMaterial "grey" "string type" "diffuse" "rgb reflectance" [ 0.5 0.5 0.5 ]

AttributeBegin
  NamedMaterial "grey"
  # A sphere shines outwards; turned around, it shines inwards.
  ReverseOrientation
  AreaLightSource "diffuse" "rgb L" [ 0.5 0.5 0.5 ]
  Shape "sphere" "float radius" [ 1 ]
AttributeEnd
"#;
    text
}
