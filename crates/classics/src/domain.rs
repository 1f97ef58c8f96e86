//! The dimensions of a sample that have a meaning, such as the place in the pixel.

use dapple_core::{Error, PointSet, SampleId};

/// The meaning of one dimension of a sample.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// A coordinate of the place in the pixel: to the right, or down, from its top left corner.
    Place,
    /// A coordinate of the point on the lens.
    Lens,
    /// The time within the exposure.
    Time,
    /// A coordinate of the point on a light, seen from the first surface.
    Light,
}

/// One dimension of a sample: a lane of a [`Block`](dapple_core::Block), and its meaning.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The meaning of the coordinate.
    pub role: Role,
    /// The number of the block.
    pub block: u32,
    /// The coordinate's place in the block, 0 to 3.
    pub lane: u8,
}

impl Axis {
    /// The coordinate in place `lane`, 0 to 3, of the block with number `block`.
    pub const fn new(role: Role, block: u32, lane: u8) -> Self {
        Self { role, block, lane }
    }
}

/// The blur of a thin lens: how far a point appears from its place in the image, by its depth and the point on the lens.
///
/// The two lens coordinates of a sample become a point `(u, v)` of the unit disk by the concentric map
/// [Shirley and Chiu 1997]. A point at depth `w` then appears `radius(1 / w)` times `(u, v)` pixels from its place through the
/// lens' centre. Depth is measured along the view direction, in any unit.
///
/// ```
/// use dapple_classics::Defocus;
///
/// // In focus at depth 2.
/// let defocus = Defocus::new([8.0, 8.0], [-16.0, -16.0]);
/// assert_eq!(defocus.radius(0.5), [0.0; 2]);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defocus {
    /// The signed radius at infinite depth, in pixels along columns and rows.
    pub at_infinity: [f32; 2],
    /// The change of the radius with the inverse depth.
    pub by_inverse_depth: [f32; 2],
}

impl Defocus {
    /// The blur with this radius at infinite depth, and this change with the inverse depth.
    pub const fn new(at_infinity: [f32; 2], by_inverse_depth: [f32; 2]) -> Self {
        Self { at_infinity, by_inverse_depth }
    }

    /// The signed radius, in pixels, at an inverse depth.
    #[inline]
    pub fn radius(&self, inverse_depth: f32) -> [f32; 2] {
        [0, 1].map(|axis| self.at_infinity[axis] + self.by_inverse_depth[axis] * inverse_depth)
    }
}

/// The dimensions in which a renderer's samples have a meaning: two of the place in the pixel first, then lens, time and
/// light as far as the image depends on them.
///
/// Methods that place samples, or reconstruct over the lens and time, work in these dimensions. A sample with coordinates
/// `(u, v)` of the place lies at `(column + u, row + v)` in the image, so the pixel filter must be a box of one pixel.
///
/// ```
/// use dapple_classics::{Axis, Domain, Role};
/// use dapple_core::{HostNumbers, PointSet, SampleId};
///
/// let axes = [Axis::new(Role::Place, 0, 0), Axis::new(Role::Place, 0, 1), Axis::new(Role::Time, 7, 0)];
/// let domain = Domain::new(axes)?;
/// let (id, mut at) = (SampleId::new([3, 5], 0, 12), [0.0; 3]);
/// domain.read(&HostNumbers, id, &mut at);
/// assert_eq!(at[2], HostNumbers.block(id, 7)[0]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    axes: Vec<Axis>,
    outside: Option<String>,
}

impl Domain {
    /// The largest number of axes.
    pub const MOST: usize = 8;

    /// A domain of these axes.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless there are 2 to 8 distinct axes, the two of the place first, with lanes up to 3.
    pub fn new(axes: impl IntoIterator<Item = Axis>) -> Result<Self, Error> {
        let axes: Vec<Axis> = axes.into_iter().take(Self::MOST + 1).collect();
        let is_place = |axis: &Axis| axis.role == Role::Place;
        let placed = axes.iter().take_while(|axis| is_place(axis)).count();
        let once = |axis: &Axis| axes.iter().filter(|a| (a.block, a.lane) == (axis.block, axis.lane)).count() == 1;
        let allowed = "2 to 8 distinct axes with lanes up to 3, the two of the place first";
        let all = axes.iter().filter(|axis| is_place(axis)).count();
        if placed != 2 || all != 2 || axes.len() > Self::MOST || !axes.iter().all(|a| a.lane < 4 && once(a)) {
            return Err(Error::OutOfRange { name: "domain", value: format!("{axes:?}"), allowed });
        }
        Ok(Self { axes, outside: None })
    }

    /// The place in the pixel alone. All other random numbers are outside.
    #[must_use]
    pub fn place(&self) -> Self {
        let outside = if self.axes.len() > 2 { Some("coordinates other than the place".to_owned()) } else { None };
        Self { axes: self.axes[..2].to_vec(), outside: outside.or_else(|| self.outside.clone()) }
    }

    /// Notes that samples depend on random numbers outside the domain, with the reason as a noun phrase.
    #[must_use]
    pub fn with_outside(self, what: impl Into<String>) -> Self {
        Self { outside: Some(what.into()), ..self }
    }

    /// The axes in order, the two of the place first.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The random numbers outside the domain on which samples depend, as a noun phrase; `None` if there are none, so that a
    /// sample's coordinates determine its radiance.
    pub fn outside(&self) -> Option<&str> {
        self.outside.as_deref()
    }

    /// Writes the sample's coordinates, in the order of the axes and each in `[0, 1)`, to the front of `to`.
    pub fn read(&self, points: &dyn PointSet, id: SampleId, to: &mut [f32]) {
        let mut last = None;
        for (axis, to) in self.axes.iter().zip(to) {
            let lanes = match last {
                Some((block, lanes)) if block == axis.block => lanes,
                _ => points.block(id, axis.block),
            };
            last = Some((axis.block, lanes));
            *to = lanes[usize::from(axis.lane)];
        }
    }

    /// Returns `true` if an axis is in the block.
    pub(crate) fn has_block(&self, block: u32) -> bool {
        self.axes.iter().any(|axis| axis.block == block)
    }
}
