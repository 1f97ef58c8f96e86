//! Affine maps that change over time, for moving instances.

use crate::Error;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// An affine map that is constant, or that moves from one map at time 0 to another at time 1.
///
/// A moving map is decomposed into a stretch, a rotation and a translation (polar decomposition). Stretch and translation are
/// interpolated linearly. The rotation turns at constant speed around one axis, in the direction of the smaller angle [after
/// Shoemake and Duff 1992]. Before time 0 and after time 1 the map is constant.
///
/// ```
/// use dapple_geometry::Motion;
/// use glam::{DAffine3, DVec3};
///
/// let motion = Motion::between(DAffine3::IDENTITY, DAffine3::from_translation(DVec3::X))?;
/// assert_eq!(motion.at(0.5).translation, DVec3::X * 0.5);
/// # Ok::<(), dapple_geometry::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The maps at times 0 and 1. Both are applied after `first`.
    ends: [DAffine3; 2],
    /// The decomposition from which maps between times 0 and 1 are interpolated; `None` if the map is constant.
    path: Option<Box<Path>>,
    /// The constant map that is applied to points before the moving map.
    first: DAffine3,
}

/// The decomposition of a moving map at its two ends: `x -> rotation (stretch x) + translation`.
#[derive(Clone, Debug, PartialEq)]
struct Path {
    translation: [DVec3; 2],
    stretch: [DMat3; 2],
    /// The rotation at time 0. Until time 1, a further rotation by `angle` radians, in [0, pi], around `axis` is added.
    rotation: DQuat,
    axis: DVec3,
    angle: f64,
}

/// The number of pieces into which the path of a rotating corner is divided for its bounding box.
const PIECES: u32 = 32;
/// The largest angle of rotation in radians for which one piece suffices.
const HARDLY_TURNED: f64 = 1e-9;

impl Motion {
    /// The size in bytes of a moving map's decomposition, allocated in addition to the map itself.
    pub(crate) const PATH_BYTES: usize = size_of::<Path>();

    /// Makes a constant map.
    pub fn still(map: DAffine3) -> Self {
        Self { ends: [map; 2], path: None, first: DAffine3::IDENTITY }
    }

    /// Makes a map that moves from `start` at time 0 to `end` at time 1, or a constant map if both are equal.
    ///
    /// # Errors
    /// [`Error::BadParameter`] if one of the two maps is not finite or not invertible. [`Error::BadParameter`] also if only
    /// one of them mirrors, since the map would not be invertible at some time in between.
    pub fn between(start: DAffine3, end: DAffine3) -> Result<Self, Error> {
        if start == end {
            return Ok(Self::still(start));
        }
        let [(r0, s0), (r1, s1)] = [polar(&start)?, polar(&end)?];
        let determinants = [start, end].map(|m| m.matrix3.determinant());
        let alike = (determinants[0] < 0.0) == (determinants[1] < 0.0);
        let expected = "either both or neither of a motion's start and end must mirror";
        Error::unless(alike, "a motion's determinant", determinants[1], expected)?;
        let turn = r0.inverse() * r1;
        // A rotation has two quaternions of opposite sign; this is the one with the smaller angle.
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let sine = turn.xyz().length();
        let path = Path {
            translation: [start.translation, end.translation],
            stretch: [s0, s1],
            rotation: r0,
            axis: if sine > 0.0 { turn.xyz() / sine } else { DVec3::X },
            angle: 2.0 * sine.atan2(turn.w),
        };
        Ok(Self { ends: [start, end], path: Some(Box::new(path)), first: DAffine3::IDENTITY })
    }

    /// Returns the motion that first applies the constant map `first`, then the moving map.
    #[must_use]
    pub fn after(mut self, first: DAffine3) -> Self {
        self.first *= first;
        self
    }

    /// Returns true if the map changes over time.
    #[inline]
    pub fn moves(&self) -> bool {
        self.path.is_some()
    }

    /// Returns the map at a time, including the map given to [`after`](Self::after). Times outside `[0, 1]` are
    /// clamped.
    pub fn at(&self, time: f32) -> DAffine3 {
        self.at_exactly(time.into()) * self.first
    }

    /// Returns the map at a time, without `first`.
    fn at_exactly(&self, time: f64) -> DAffine3 {
        match &self.path {
            Some(path) if time > 0.0 && time < 1.0 => path.at(time),
            Some(_) if time >= 1.0 => self.ends[1],
            _ => self.ends[0],
        }
    }

    /// Returns the lower and upper corner of a box that contains the moved box at all times.
    ///
    /// The box bounds the paths of the eight corners. Each path is divided into pieces. The positions at the ends of the pieces
    /// are padded by a bound on the distance of a piece from a straight line.
    pub fn bounds(&self, low: DVec3, high: DVec3) -> [DVec3; 2] {
        let corners = (0..8_u32).map(|k| {
            let side = |bit: u32, axis: usize| if k >> bit & 1 == 0 { low[axis] } else { high[axis] };
            self.first.transform_point3(DVec3::new(side(0, 0), side(1, 1), side(2, 2)))
        });
        let turns = self.path.as_ref().is_some_and(|path| path.angle > HARDLY_TURNED);
        let pieces = if turns { PIECES } else { 1 };
        let maps: Vec<DAffine3> = (0..=pieces).map(|i| self.at_exactly(f64::from(i) / f64::from(pieces))).collect();
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in corners {
            let slack = self.path.as_ref().map_or(0.0, |path| path.sagitta(corner, pieces));
            for map in &maps {
                let p = map.transform_point3(corner);
                (least, most) = (least.min(p - slack), most.max(p + slack));
            }
        }
        [least, most]
    }
}

impl Path {
    fn at(&self, time: f64) -> DAffine3 {
        let rotation = self.rotation * DQuat::from_axis_angle(self.axis, self.angle * time);
        let stretch = self.stretch[0] * (1.0 - time) + self.stretch[1] * time;
        DAffine3 {
            matrix3: DMat3::from_quat(rotation) * stretch,
            translation: self.translation[0] * (1.0 - time) + self.translation[1] * time,
        }
    }

    /// Returns a bound on the distance between a point's path and the straight lines that join the ends of its pieces. For
    /// pieces of duration `h` it is `h^2 / 8` times the largest acceleration. With angular speed `w`, point `p` and stretch `S`
    /// of derivative `S'`, the acceleration is at most `w^2 |S p| + 2 w |S' p|`.
    fn sagitta(&self, point: DVec3, pieces: u32) -> f64 {
        let [start, end] = self.stretch.map(|stretch| stretch * point);
        let acceleration = self.angle * (self.angle * start.length().max(end.length()) + 2.0 * (end - start).length());
        acceleration / (8.0 * f64::from(pieces * pieces))
    }
}

/// The largest number of iteration steps in [`polar`]. It usually needs about ten, and a few more for nearly singular maps.
const STEPS: usize = 100;

/// Returns the rotation and the symmetric stretch whose product is the map's matrix. The stretch is negative if the map
/// mirrors. The rotation is computed by Newton's iteration with scaled steps [after Higham 1986].
fn polar(map: &DAffine3) -> Result<(DQuat, DMat3), Error> {
    let matrix = map.matrix3;
    let determinant = matrix.determinant();
    let check = |met: bool| {
        let expected = "both ends of a motion must be finite and invertible";
        Error::unless(met, "a motion's determinant", determinant, expected)
    };
    let largest = matrix.to_cols_array().into_iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    check(map.is_finite() && determinant != 0.0 && determinant.is_finite())?;
    // The orthogonal matrix nearest to a mirroring matrix is not a rotation, so the negative matrix is used.
    let mut rotation = matrix * (largest.recip() * determinant.signum());
    for _ in 0..STEPS {
        let inverse = rotation.inverse().transpose();
        let scale = (norm(&inverse) / norm(&rotation)).sqrt();
        let next = rotation * (0.5 * scale) + inverse * (0.5 / scale);
        let moved = norm(&(next - rotation));
        rotation = next;
        if moved <= 1e-15 * norm(&rotation) {
            break;
        }
    }
    let unit = DQuat::from_mat3(&rotation).normalize();
    let stretch = DMat3::from_quat(unit).transpose() * matrix;
    let stretch = (stretch + stretch.transpose()) * 0.5;
    check(unit.is_finite() && stretch.is_finite())?;
    Ok((unit, stretch))
}

fn norm(matrix: &DMat3) -> f64 {
    matrix.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt()
}
