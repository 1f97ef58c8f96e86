//! Colour spaces of image files, and their conversion to linear Rec.709.

use crate::colorimetry::rgb_of_xyz;
use glam::{DMat3, DVec3, dvec3};

/// The primaries and the white of a linear RGB space, as CIE 1931 chromaticities x, y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chromaticities {
    /// The red primary.
    pub red: [f32; 2],
    /// The green primary.
    pub green: [f32; 2],
    /// The blue primary.
    pub blue: [f32; 2],
    /// The colour of equal red, green and blue.
    pub white: [f32; 2],
}

impl Chromaticities {
    /// Rec. 709: the primaries and the white of sRGB, and the default of OpenEXR files.
    pub const REC709: Self = Self { red: [0.64, 0.33], green: [0.3, 0.6], blue: [0.15, 0.06], white: [0.3127, 0.329] };

    fn points(self) -> [[f32; 2]; 4] {
        [self.red, self.green, self.blue, self.white]
    }

    /// Returns true if all chromaticities of the two colour spaces differ by less than 0.001.
    pub fn is_same(self, other: Self) -> bool {
        let pairs = self.points().into_iter().zip(other.points());
        pairs.into_iter().all(|(a, b)| (a[0] - b[0]).abs() < 1e-3 && (a[1] - b[1]).abs() < 1e-3)
    }

    /// Returns the matrix that converts colours of this space to linear Rec.709, with the white adapted by Bradford's matrix.
    /// Grey stays grey. `None` if the chromaticities do not form a colour space.
    fn to_rec709(self) -> Option<DMat3> {
        let to_d65 = adaptation(xyz(self.white)?, xyz(Self::REC709.white)?);
        let to_xyz = self.to_xyz()?;
        let columns = [to_xyz.x_axis, to_xyz.y_axis, to_xyz.z_axis].map(|c| rgb_of_xyz(to_d65 * c));
        let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
        matrix.is_finite().then_some(matrix)
    }

    fn to_xyz(self) -> Option<DMat3> {
        let [r, g, b, _] = self.points().map(|[x, y]| dvec3(x.into(), y.into(), 1.0 - f64::from(x) - f64::from(y)));
        let primaries = DMat3::from_cols(r, g, b);
        if primaries.determinant().abs() < 1e-6 {
            return None;
        }
        Some(primaries * DMat3::from_diagonal(primaries.inverse() * xyz(self.white)?))
    }

    /// The notice of chromaticities that do not form a colour space.
    pub(super) fn unfit(self) -> String {
        format!("its chromaticities ({self}) do not form a colour space; Rec. 709 is assumed")
    }

    /// Converts colours of this space to linear Rec. 709 in place. Equal R, G and B stay unchanged. Colours outside Rec. 709
    /// get a negative channel. Returns false, and changes nothing, if the chromaticities do not form a colour space.
    pub fn convert_to_rec709(self, pixels: &mut [[f32; 3]]) -> bool {
        let Some(matrix) = self.to_rec709() else { return false };
        for pixel in pixels.iter_mut().filter(|p| p[0] != p[1] || p[1] != p[2]) {
            *pixel = (matrix * DVec3::from_array(pixel.map(f64::from))).as_vec3().to_array();
        }
        true
    }
}

impl std::fmt::Display for Chromaticities {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [r, g, b, w] = self.points().map(|[x, y]| format!("({x}, {y})"));
        write!(f, "red {r}, green {g}, blue {b}, white {w}")
    }
}

/// Returns the XYZ of a chromaticity at luminance 1.
fn xyz([x, y]: [f32; 2]) -> Option<DVec3> {
    let [x, y] = [x, y].map(f64::from);
    (y > 1e-6 && x.is_finite()).then(|| dvec3(x / y, 1.0, (1.0 - x - y) / y))
}

/// Returns Bradford's matrix from XYZ under one white to XYZ under another.
fn adaptation(from: DVec3, to: DVec3) -> DMat3 {
    let cones =
        DMat3::from_cols_array_2d(&[[0.8951, -0.7502, 0.0389], [0.2664, 1.7135, -0.0685], [-0.1614, 0.0367, 1.0296]]);
    cones.inverse() * DMat3::from_diagonal((cones * to) / (cones * from)) * cones
}
