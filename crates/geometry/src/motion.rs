//! Affine maps that change over time.

use crate::Error;
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// An affine map that is constant, or moves from one map at time 0 to another at time 1.
///
/// A moving map is decomposed into a stretch, a rotation and a translation (polar decomposition), which are
/// interpolated. Stretch and translation change linearly. The rotation has constant speed around one axis, the shorter
/// way round [after Shoemake and Duff 1992]. Before 0 and after 1 the map stands still.
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
    /// The maps at times 0 and 1, to be applied after `first`.
    ends: [DAffine3; 2],
    /// The interpolation between the two maps; `None` if the map stands still.
    path: Option<Box<Path>>,
    /// The constant map that is applied first.
    first: DAffine3,
}

/// A decomposed map: `x -> rotation (stretch x) + translation`.
#[derive(Clone, Debug, PartialEq)]
struct Path {
    translation: [DVec3; 2],
    stretch: [DMat3; 2],
    /// The rotation at time 0. Until time 1 it turns by another `angle`, in [0, pi], around `axis`.
    rotation: DQuat,
    axis: DVec3,
    angle: f64,
}

/// The number of pieces of a rotating path, each with its own box.
const PIECES: u32 = 32;
/// Angle of rotation in radians below which one piece suffices.
const HARDLY_TURNED: f64 = 1e-9;

impl Motion {
    /// The additional memory of a moving map in bytes.
    pub(crate) const PATH_BYTES: usize = size_of::<Path>();

    /// Makes a map that does not move.
    #[must_use]
    pub fn still(map: DAffine3) -> Self {
        Self { ends: [map; 2], path: None, first: DAffine3::IDENTITY }
    }

    /// Makes a map that moves from `start` at time 0 to `end` at time 1; still if they are equal.
    ///
    /// # Errors
    /// [`Error::BadParameter`] if a map is not finite or not invertible, or if only one of them mirrors: everything
    /// would be flat at some time in between.
    pub fn between(start: DAffine3, end: DAffine3) -> Result<Self, Error> {
        if start == end {
            return Ok(Self::still(start));
        }
        let [(r0, s0), (r1, s1)] = [polar(&start)?, polar(&end)?];
        let determinants = [start, end].map(|m| m.matrix3.determinant());
        if (determinants[0] < 0.0) != (determinants[1] < 0.0) {
            let expected = "start and end of a motion must both mirror, or neither";
            return Err(Error::BadParameter { what: "a motion's determinant", value: determinants[1], expected });
        }
        let turn = r0.inverse() * r1;
        // Of the two quaternions of a rotation, the one that turns by less.
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

    /// Returns the motion with the constant map `first` applied before it.
    #[must_use]
    pub fn after(mut self, first: DAffine3) -> Self {
        self.first *= first;
        self
    }

    /// Returns true if the map moves.
    #[inline]
    #[must_use]
    pub fn moves(&self) -> bool {
        self.path.is_some()
    }

    /// The map at a time, including the map given to [`after`](Self::after). Times outside `[0, 1]` are clamped.
    #[must_use]
    pub fn at(&self, time: f32) -> DAffine3 {
        self.at_exactly(time.into()) * self.first
    }

    /// The map at a time, without `first`.
    fn at_exactly(&self, time: f64) -> DAffine3 {
        match &self.path {
            Some(path) if time > 0.0 && time < 1.0 => path.at(time),
            Some(_) if time >= 1.0 => self.ends[1],
            _ => self.ends[0],
        }
    }

    /// A box that contains the image of a box at all times.
    ///
    /// The path of a point of the box is a mean of the paths of the box's corners, and a corner's path is cut into
    /// pieces. A piece of duration `h` stays within `h^2 / 8` times its largest acceleration of the straight line
    /// between its ends. With the angular speed `w`, that acceleration is at most `w^2 |S p| + 2 w |S' p|`.
    #[must_use]
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

    /// The largest distance of a point's path from the straight lines between the ends of its pieces.
    fn sagitta(&self, point: DVec3, pieces: u32) -> f64 {
        let [start, end] = self.stretch.map(|stretch| stretch * point);
        let acceleration = self.angle * (self.angle * start.length().max(end.length()) + 2.0 * (end - start).length());
        acceleration / (8.0 * f64::from(pieces * pieces))
    }
}

/// The largest number of steps of the polar decomposition. It takes about ten, and a few more for nearly flat maps.
const STEPS: usize = 100;

/// The rotation and the symmetric stretch (negative if the map mirrors) whose product is the matrix of a map. Newton's
/// iteration towards the nearest rotation with scaled steps [after Higham 1986].
fn polar(map: &DAffine3) -> Result<(DQuat, DMat3), Error> {
    let matrix = map.matrix3;
    let determinant = matrix.determinant();
    let expected = "both ends of a motion must be finite and invertible";
    let wrong = Error::BadParameter { what: "a motion's determinant", value: determinant, expected };
    let largest = matrix.to_cols_array().into_iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !map.is_finite() || determinant == 0.0 || !determinant.is_finite() {
        return Err(wrong);
    }
    // The nearest orthogonal matrix of a mirroring one is not a rotation; that of its negative is.
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
    if unit.is_finite() && stretch.is_finite() { Ok((unit, stretch)) } else { Err(wrong) }
}

fn norm(matrix: &DMat3) -> f64 {
    matrix.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt()
}
