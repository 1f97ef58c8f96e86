//! Directives that change the transform.

use super::directive::Directive;
use super::reader::{Ctm, Reader};
use super::tokens::{shown, unknown_name};
use crate::Source;
use glam::{DAffine3, DMat3, DVec3};

/// Returns the affine transform of a 4 x 4 matrix, given column by column; an error for a projective matrix.
fn matrix(m: &[f64]) -> Result<DAffine3, String> {
    if m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || m[15] == 0.0 {
        return Err("this transform is projective; every fourth number must be 0, the last one 1".into());
    }
    let column = |c: usize| DVec3::new(m[c], m[c + 1], m[c + 2]) / m[15];
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(4), column(8)), column(12)))
}

/// Returns the rotation by an angle in degrees around an axis; an error for axis 0.
fn rotation(degrees: f64, axis: DVec3) -> Result<DAffine3, String> {
    // Divides by the largest coordinate first, since squares of tiny coordinates underflow.
    let axis = axis / axis.abs().max_element();
    match axis.try_normalize() {
        Some(axis) => Ok(DAffine3::from_axis_angle(axis, degrees.to_radians())),
        None => Err("Rotate needs an axis; its last three numbers must not all be 0".into()),
    }
}

/// Returns the transform from world space to the space of a viewer at `eye` (x right, y up, z forward, left-handed); an
/// error if the directions are degenerate.
fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> Result<DAffine3, String> {
    let axes = || {
        let forward = (target - eye).try_normalize()?;
        let right = up.try_normalize()?.cross(forward).try_normalize()?;
        Some(DMat3::from_cols(right, forward.cross(right), forward))
    };
    let degenerate = "LookAt needs three different directions: the point looked at must differ from the eye, and up \
                      must not lie along the line of sight";
    Ok(DAffine3::from_mat3_translation(axes().ok_or(degenerate)?, eye).inverse())
}

/// Returns true if a transform can be inverted: the transform and its inverse are finite.
fn is_invertible(transform: &DAffine3) -> bool {
    let determinant = transform.matrix3.determinant();
    transform.is_finite() && determinant.is_finite() && determinant != 0.0 && transform.inverse().is_finite()
}

impl Reader<'_> {
    /// Executes a directive that changes the current transformation matrix. Returns false, without effect, for other
    /// directives.
    pub(super) fn transform(&mut self, d: &Directive<'_>) -> bool {
        let numbers = &d.numbers;
        let from_here = |change: DAffine3| Ok((change, false));
        let change = match d.word {
            "Identity" => Ok((DAffine3::IDENTITY, true)),
            "Translate" => from_here(DAffine3::from_translation(DVec3::from_slice(numbers))),
            "Scale" => from_here(DAffine3::from_scale(DVec3::from_slice(numbers))),
            "Rotate" => rotation(numbers[0], DVec3::from_slice(&numbers[1..])).and_then(from_here),
            "LookAt" => {
                let point = |i| DVec3::from_slice(&numbers[i..]);
                look_at(point(0), point(3), point(6)).and_then(from_here)
            }
            "Transform" => matrix(numbers).map(|matrix| (matrix, true)),
            "ConcatTransform" => matrix(numbers).and_then(from_here),
            "CoordinateSystem" => {
                self.spaces.insert(d.texts[0].clone(), [self.state.ctm.start, self.state.ctm.end]);
                return true;
            }
            "CoordSysTransform" => {
                self.enter_space(&d.texts[0], &d.source);
                return true;
            }
            "ActiveTransform" => {
                self.state.ctm.active = match d.texts[0].as_str() {
                    "All" => [true, true],
                    "StartTime" => [true, false],
                    "EndTime" => [false, true],
                    word => {
                        let what = format!("ActiveTransform takes All, StartTime or EndTime, not {}", shown(word));
                        self.log.problem(&d.source, what);
                        return true;
                    }
                };
                return true;
            }
            _ => return false,
        };
        if let Err(what) = change.and_then(|(change, anew)| self.change_ctm(change, anew)) {
            self.log.problem(&d.source, what);
        }
        true
    }

    /// Multiplies the active transforms by `change`; if `anew` is true, replaces them by `change`.
    fn change_ctm(&mut self, change: DAffine3, anew: bool) -> Result<(), String> {
        let Ctm { start, end, active } = self.state.ctm;
        let [start, end] = [(start, active[0]), (end, active[1])].map(|(old, active)| match active {
            true if anew => change,
            true => old * change,
            false => old,
        });
        if !(is_invertible(&start) && is_invertible(&end)) {
            return Err("this transform flattens space or overflows; it must have an inverse".into());
        }
        self.state.ctm = Ctm { start, end, active };
        Ok(())
    }

    /// Executes `TransformTimes`: sets the start and end times of the motion.
    pub(super) fn set_times(&mut self, d: &Directive<'_>) {
        self.meet("TransformTimes", &d.source);
        let times = [d.numbers[0], d.numbers[1]];
        if times[0] < times[1] {
            self.scene.motion_times = times;
        } else {
            let what = format!("TransformTimes takes a start before an end, not {} and {}", times[0], times[1]);
            self.log.problem(&d.source, what);
        }
    }

    fn enter_space(&mut self, name: &str, source: &Source) {
        if let Some(&[start, end]) = self.spaces.get(name) {
            self.state.ctm = Ctm { start, end, ..self.state.ctm };
            return;
        }
        let what = unknown_name("coordinate system", name, self.spaces.keys(), "define it with CoordinateSystem first");
        self.log.problem(source, what);
    }
}
