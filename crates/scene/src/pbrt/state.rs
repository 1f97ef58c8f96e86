//! The graphics state: transform, material, emission and media that apply to subsequent shapes and lights.

use super::params::Param;
use crate::{MaterialId, Source};
use glam::{DAffine3, DMat3, DVec3};
use std::rc::Rc;

/// The graphics state, which `AttributeBegin` saves and `AttributeEnd` restores.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// The current transformation matrix: from the current space to world space (before `WorldBegin`, to camera space).
    pub(super) ctm: Ctm,
    pub(super) reversed: bool,
    pub(super) material: MaterialRef,
    pub(super) emission: Option<AreaLight>,
    pub(super) media: Option<Rc<MediaRef>>,
    pub(super) attributes: Rc<Attributes>,
}

impl Default for State {
    fn default() -> Self {
        Self {
            ctm: Ctm::default(),
            reversed: false,
            material: MaterialRef::Default,
            emission: None,
            media: None,
            attributes: Rc::default(),
        }
    }
}

/// The current transformation matrix at the start and at the end of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ctm {
    pub(super) start: DAffine3,
    pub(super) end: DAffine3,
    /// Two flags: directives change the transform at the start; directives change the transform at the end.
    pub(super) active: [bool; 2],
}

impl Default for Ctm {
    fn default() -> Self {
        Self { start: DAffine3::IDENTITY, end: DAffine3::IDENTITY, active: [true, true] }
    }
}

impl Ctm {
    /// Returns the transform at the end of the motion; `None` if it equals [`start`](Self::start).
    pub(super) fn moves_to(&self) -> Option<DAffine3> {
        (self.end != self.start).then_some(self.end)
    }
}

/// The arguments of `AreaLightSource`, for the emission of subsequent shapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AreaLight {
    /// Radiance, linear RGB, with the parameter `scale` applied.
    pub(super) radiance: [f32; 3],
    pub(super) two_sided: bool,
    /// Total power of each shape, if given. A shape's radiance is then `radiance * power / (pi * area)`, with the area
    /// of both sides if two-sided.
    pub(super) power: Option<f64>,
}

/// The names of media in a `MediumInterface`. As in pbrt, names are looked up at the end of the file.
#[derive(Clone, Debug)]
pub(super) struct MediaRef {
    pub(super) inside: Option<String>,
    pub(super) outside: Option<String>,
    pub(super) source: Source,
}

/// The current material: the default, an index, or a name. As in pbrt, names are looked up at the end of the file.
#[derive(Clone, Debug)]
pub(super) enum MaterialRef {
    Default,
    Made(MaterialId),
    Named(Rc<str>, Rc<Source>),
}

/// Parameters that `Attribute` adds to directives, for each kind of directive.
#[derive(Clone, Debug, Default)]
pub(super) struct Attributes {
    pub(super) shape: Vec<Param>,
    pub(super) light: Vec<Param>,
    pub(super) material: Vec<Param>,
    pub(super) medium: Vec<Param>,
    pub(super) texture: Vec<Param>,
}

impl Attributes {
    pub(super) fn of_mut(&mut self, target: &str) -> Option<&mut Vec<Param>> {
        Some(match target {
            "shape" => &mut self.shape,
            "light" => &mut self.light,
            "material" => &mut self.material,
            "medium" => &mut self.medium,
            "texture" => &mut self.texture,
            _ => return None,
        })
    }
}

/// Returns the affine transform of a 4 x 4 matrix, given column by column; an error for a projective matrix.
pub(super) fn matrix(m: &[f64]) -> Result<DAffine3, String> {
    if m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || m[15] == 0.0 {
        return Err("this transform is projective; every fourth number must be 0, the last one 1".into());
    }
    let column = |c: usize| DVec3::new(m[c], m[c + 1], m[c + 2]) / m[15];
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12)))
}

/// Returns the rotation by an angle in degrees around an axis; an error for axis 0.
pub(super) fn rotation(degrees: f64, axis: DVec3) -> Result<DAffine3, String> {
    // Divides by the largest coordinate first, since squares of tiny coordinates underflow.
    let axis = axis / axis.abs().max_element();
    match axis.try_normalize() {
        Some(axis) => Ok(DAffine3::from_axis_angle(axis, degrees.to_radians())),
        None => Err("Rotate needs an axis; its last three numbers must not all be 0".into()),
    }
}

/// Returns the transform from world space to the space of a viewer at `eye` (x right, y up, z forward, left-handed); an
/// error if the directions are degenerate.
pub(super) fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Result<DAffine3, String> {
    let degenerate = "LookAt needs three different directions: the point looked at must differ from the eye, and up \
                      must not lie along the line of sight";
    let (Some(forward), Some(up)) = ((target - eye).try_normalize(), up.try_normalize()) else {
        return Err(degenerate.into());
    };
    let Some(right) = up.cross(forward).try_normalize() else { return Err(degenerate.into()) };
    let up = forward.cross(right);
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(right, up, forward), eye).inverse())
}

/// Returns true if a transform can be inverted: the transform and its inverse are finite.
pub(super) fn is_invertible(transform: &DAffine3) -> bool {
    let determinant = transform.matrix3.determinant();
    transform.is_finite() && determinant.is_finite() && determinant != 0.0 && transform.inverse().is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    fn assert_close(a: DVec3, b: DVec3) {
        assert_abs_diff_eq!(a.x, b.x, epsilon = 1e-12);
        assert_abs_diff_eq!(a.y, b.y, epsilon = 1e-12);
        assert_abs_diff_eq!(a.z, b.z, epsilon = 1e-12);
    }

    #[test]
    fn matrices_are_column_major() {
        let m: Vec<f64> = [1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 10, 0, 11, 12, 13, 1].map(f64::from).to_vec();
        assert_eq!(matrix(&m).unwrap().transform_point3(DVec3::X), DVec3::new(12.0, 14.0, 16.0));
        assert!(matrix(&[1.0; 16]).is_err());
    }

    #[test]
    fn rotations_are_right_handed() {
        assert_close(rotation(90.0, DVec3::Z * 1e-200).unwrap().transform_point3(DVec3::X), DVec3::Y);
        assert!(rotation(90.0, DVec3::ZERO).is_err());
    }

    #[test]
    fn viewers_look_along_z() {
        let view = look_at(DVec3::new(0.0, 0.0, -5.0), DVec3::ZERO, DVec3::Y).unwrap();
        assert_close(view.transform_point3(DVec3::ZERO), DVec3::Z * 5.0);
        // Seen from -z with y up, +x lies to the right.
        assert_close(view.transform_vector3(DVec3::X), DVec3::X);
        let view = look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        assert_close(view.transform_point3(DVec3::X), DVec3::Z);
        assert_close(view.transform_point3(DVec3::Z), DVec3::Y);
        // Left-handed: with x forward and z up, -y … +y runs from left to right when up x forward = right.
        assert_close(view.transform_point3(DVec3::Y), DVec3::X);
        assert!(look_at(DVec3::ZERO, DVec3::X, DVec3::X).is_err());
        assert!(look_at(DVec3::ZERO, DVec3::ZERO, DVec3::X).is_err());
    }
}
