//! The meaning of a sample's dimensions (such as the position in the pixel), and point sets in which a sampler decides where
//! samples lie.

use dapple_core::{Error, Frame, Limits, Needs, PointSet, SampleId, point_set::streams};
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// The meaning of one dimension of a sample.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// A coordinate of the position in the pixel: to the right, or down, from the pixel's top left corner.
    Place,
    /// A coordinate of the point on the lens.
    Lens,
    /// The time within the exposure.
    Time,
    /// A coordinate of the point on a light, seen from the first surface.
    Light,
}

/// One dimension of a sample: a lane of a [`Block`](dapple_core::Block), with its meaning.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The meaning of the coordinate.
    pub role: Role,
    /// The number of the block.
    pub block: u32,
    /// The index of the coordinate in the block, 0 to 3.
    pub lane: u8,
}

impl Axis {
    /// The coordinate with index `lane`, 0 to 3, in block number `block`.
    pub const fn new(role: Role, block: u32, lane: u8) -> Self {
        Self { role, block, lane }
    }
}

/// The blur of a thin lens: how far a point moves in the image, given its depth and the point on the lens.
///
/// The two lens coordinates of a sample are mapped to a point `(u, v)` of the unit disk by the concentric map [Shirley and Chiu
/// 1997]. Compared with its image through the lens' centre, a point at depth `w` moves by `radius(1 / w) * (u, v)` pixels.
/// Depth is measured along the view direction, in any unit.
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
    /// The signed radius in pixels, horizontal and vertical, of the blur of a point at infinite depth.
    pub at_infinity: [f32; 2],
    /// The change of the radius per unit of inverse depth.
    pub by_inverse_depth: [f32; 2],
}

impl Defocus {
    /// Creates the blur with this radius at infinite depth and this change per unit of inverse depth.
    pub const fn new(at_infinity: [f32; 2], by_inverse_depth: [f32; 2]) -> Self {
        Self { at_infinity, by_inverse_depth }
    }

    /// The signed radius in pixels for an inverse depth.
    #[inline]
    pub fn radius(&self, inverse_depth: f32) -> [f32; 2] {
        [0, 1].map(|axis| self.at_infinity[axis] + self.by_inverse_depth[axis] * inverse_depth)
    }
}

/// The sample dimensions whose meaning is known: the position in the pixel (two axes), then lens, time and light if the image
/// depends on them.
///
/// Methods that place samples, or reconstruct over the lens and time, use these dimensions. A sample with position coordinates
/// `(u, v)` lies at `(column + u, row + v)` in the image, so the pixel filter must be a box of one pixel.
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

    /// Creates a domain with these axes.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless there are 2 to 8 distinct axes with lanes up to 3, starting with the two of the position.
    pub fn new(axes: impl IntoIterator<Item = Axis>) -> Result<Self, Error> {
        let axes: Vec<Axis> = axes.into_iter().take(Self::MOST + 1).collect();
        let is_place = |axis: &Axis| axis.role == Role::Place;
        let placed = axes.iter().take_while(|axis| is_place(axis)).count();
        let once = |axis: &Axis| axes.iter().filter(|a| (a.block, a.lane) == (axis.block, axis.lane)).count() == 1;
        let allowed = "2 to 8 distinct axes with lanes up to 3, and two Role::Place first";
        let all = axes.iter().filter(|axis| is_place(axis)).count();
        if placed != 2 || all != 2 || axes.len() > Self::MOST || !axes.iter().all(|a| a.lane < 4 && once(a)) {
            return Err(Error::OutOfRange { name: "domain", value: format!("{axes:?}"), allowed });
        }
        Ok(Self { axes, outside: None })
    }

    /// The domain of the position in the pixel alone. All other random numbers are outside.
    #[must_use]
    pub fn place(&self) -> Self {
        let outside = if self.axes.len() > 2 { Some("axes other than the position".to_owned()) } else { None };
        Self { axes: self.axes[..2].to_vec(), outside: outside.or_else(|| self.outside.clone()) }
    }

    /// Records that samples depend on random numbers outside the domain; `what` names them as a noun phrase.
    #[must_use]
    pub fn with_outside(self, what: impl Into<String>) -> Self {
        Self { outside: Some(what.into()), ..self }
    }

    /// The axes in order, starting with the two of the position.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The random numbers outside the domain on which samples depend, as a noun phrase. If `None`, a sample's coordinates
    /// determine its radiance.
    pub fn outside(&self) -> Option<&str> {
        self.outside.as_deref()
    }

    /// Writes the sample's coordinates, each in `[0, 1)`, to the front of `to` in the order of the axes. A short `to` gets the
    /// first axes.
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
    fn has_block(&self, block: u32) -> bool {
        self.axes.iter().any(|axis| axis.block == block)
    }

    /// The bytes of a [`Placed`] if a render within these limits places all its samples.
    pub fn placed_bytes(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> u64 {
        let rows = frame.bytes(size_of::<Vec<f32>>() * if needs.halves { 2 } else { 1 });
        // Rows grow by a quarter.
        rows.saturating_add(limits.expected_samples(frame).saturating_mul(5 * self.axes().len() as u64))
    }
}

/// The largest coordinate below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A point set in which a sampler places samples, that is, sets their coordinates along the axes of a [`Domain`].
///
/// All other coordinates, and all coordinates of samples that are not placed, come from an inner point set. A sampler owns its
/// `Placed`, and places samples in [`Sampler::next_round`](dapple_core::Sampler::next_round). Placed coordinates never change,
/// so that traced samples can be replayed. Samplers save them with [`Placed::save`].
///
/// ```
/// use dapple_classics::{Axis, Domain, Placed, Role};
/// use dapple_core::{Frame, HostNumbers, PointSet, SampleId};
/// use dapple_core::point_set::streams;
///
/// let domain = Domain::new([Axis::new(Role::Place, 0, 0), Axis::new(Role::Place, 0, 1)])?;
/// let mut points = Placed::new(HostNumbers, domain);
/// points.add(&Frame::new(4, 4)?, SampleId::new([2, 1], streams::WHOLE, 0), &[0.25, 0.75])?;
/// let [u, v, ..] = points.block(SampleId::new([2, 1], streams::WHOLE, 0), 0);
/// assert_eq!([u, v], [0.25, 0.75]);
/// let next = SampleId::new([2, 1], streams::WHOLE, 1);
/// assert_eq!(points.block(next, 0), HostNumbers.block(next, 0));
/// # Ok::<(), dapple_core::Error>(())
/// ```
pub struct Placed<P> {
    inner: P,
    domain: Domain,
    table: Arc<Table>,
    handle: PlacedHandle,
}

/// The coordinates of the samples of some pixels.
#[derive(Clone, Debug, Default)]
struct Table {
    frame: Option<Frame>,
    /// For each stream of the image's samples and each pixel, the coordinates of the first samples, one sample after another.
    rows: [Vec<Vec<f32>>; STREAMS],
}

/// The number of streams with samples of the image; their numbers are below this.
const STREAMS: usize = 3;
const _: () = assert!(streams::WHOLE < 3 && streams::HALVES[0] < 3 && streams::HALVES[1] < 3);

impl Table {
    /// The index of the sample's pixel in the window; `None` outside the window.
    fn pixel(&self, id: SampleId) -> Option<usize> {
        let frame = self.frame.as_ref()?;
        let ([x0, y0], [width, height]) = (frame.origin(), frame.size());
        let (x, y) = (id.pixel[0].checked_sub(x0)?, id.pixel[1].checked_sub(y0)?);
        (x < width && y < height).then(|| y as usize * width as usize + x as usize)
    }

    /// The `axes` coordinates of the sample; `None` if it was not placed.
    #[inline]
    fn row(&self, id: SampleId, axes: usize) -> Option<&[f32]> {
        let row = self.rows.get(id.stream as usize)?.get(self.pixel(id)?)?;
        let first = usize::try_from(id.index).ok()?.checked_mul(axes)?;
        row.get(first..first.checked_add(axes)?)
    }
}

impl<P: PointSet> Placed<P> {
    /// Creates a set with the points of `inner` and no placed samples.
    pub fn new(inner: P, domain: Domain) -> Self {
        let handle = PlacedHandle { domain: domain.clone(), table: Arc::default() };
        Self { inner, domain, table: Arc::default(), handle }
    }

    /// The dimensions in which samples are placed.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// A handle through which filters read the coordinates of samples that are placed later.
    pub fn handle(&self) -> PlacedHandle {
        self.handle.clone()
    }

    /// Removes all placed samples.
    pub fn clear(&mut self) {
        self.handle.set(None);
        self.table = Arc::default();
    }

    /// Places a sample of a render of `frame`: sets its coordinates, in the order of the domain's axes. Coordinates are clamped
    /// to `[0, 1)`; NaN becomes 0. Earlier samples of the pixel that were not placed keep the inner set's coordinates.
    ///
    /// Call [`Placed::publish`] after the last sample of a round.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a sample that is already placed or precedes a placed one, lies outside the frame, or belongs
    /// to a stream other than the image's; also for a wrong number of coordinates.
    pub fn add(&mut self, frame: &Frame, id: SampleId, coordinates: &[f32]) -> Result<(), Error> {
        self.handle.set(None);
        let (axes, table) = (self.domain.axes().len(), Arc::make_mut(&mut self.table));
        if table.frame != Some(*frame) {
            *table = Table { frame: Some(*frame), rows: Default::default() };
        }
        let allowed = "new samples of the frame in the order of their indices, with a coordinate for each axis";
        let refused = Error::OutOfRange { name: "placed sample", value: format!("{id:?}"), allowed };
        let (pixel, rows) = (table.pixel(id), table.rows.get_mut(id.stream as usize));
        let (Some(pixel), Some(rows), true) = (pixel, rows, coordinates.len() == axes) else { return Err(refused) };
        rows.resize(frame.pixels(), Vec::new());
        let row = &mut rows[pixel];
        let there = (row.len() / axes) as u64;
        if id.index < there {
            return Err(refused);
        }
        let more = usize::try_from(id.index - there).unwrap_or(usize::MAX).saturating_add(1).saturating_mul(axes);
        if row.capacity() - row.len() < more {
            row.reserve_exact(more.max(row.len() / 4));
        }
        for index in there..id.index {
            let start = row.len();
            row.resize(start + axes, 0.0);
            self.domain.read(&self.inner, SampleId::new(id.pixel, id.stream, index), &mut row[start..]);
        }
        row.extend(coordinates.iter().map(|&x| if x > 0.0 { x.min(BELOW_ONE) } else { 0.0 }));
        Ok(())
    }

    /// Makes the samples placed so far visible through [`Placed::handle`].
    pub fn publish(&mut self) {
        self.handle.set(Some(self.table.clone()));
    }

    /// The placed samples as bytes for [`Placed::restore`].
    pub fn save(&self) -> Vec<u8> {
        let Some(frame) = self.table.frame else { return Vec::new() };
        let mut words = [frame.resolution(), frame.origin(), frame.size()].concat();
        for rows in &self.table.rows {
            words.push(rows.len() as u32);
            for row in rows {
                words.push(row.len() as u32);
                words.extend(row.iter().map(|x| x.to_bits()));
            }
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }

    /// Replaces the placed samples by those in `saved`, the bytes from [`Placed::save`] of a set with the same domain.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] if `saved` is malformed.
    pub fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.clear();
        if !saved.is_empty() {
            let table = self.table_of(saved).ok_or(Error::BadSnapshot { what: "the data hold no placed samples" })?;
            self.table = Arc::new(table);
            self.publish();
        }
        Ok(())
    }

    /// Decodes a table; `None` unless all bytes are valid and used.
    fn table_of(&self, saved: &[u8]) -> Option<Table> {
        let (words, []) = saved.as_chunks() else { return None };
        let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
        let [w, h, x, y, cw, ch] = [(); 6].map(|()| words.next());
        let (x, y) = (x?, y?);
        let frame = Frame::new(w?, h?).ok()?.crop(x, y, x.checked_add(cw?)?, y.checked_add(ch?)?).ok()?;
        let mut table = Table { frame: Some(frame), rows: Default::default() };
        for rows in &mut table.rows {
            let pixels = words.next().map(|n| n as usize).filter(|n| [0, frame.pixels()].contains(n))?;
            for _ in 0..pixels {
                let numbers = words.next()? as usize;
                let row: Vec<f32> = words.by_ref().take(numbers).map(f32::from_bits).collect();
                let is_whole = row.len() == numbers && numbers.is_multiple_of(self.domain.axes().len());
                rows.push(Some(row).filter(|row| is_whole && row.iter().all(|x| (0.0..1.0).contains(x)))?);
            }
        }
        words.next().is_none().then_some(table)
    }
}

impl<P: PointSet> PointSet for Placed<P> {
    fn describe(&self) -> String {
        format!("placed({})", self.inner.describe())
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let mut lanes = self.inner.block(id, block);
        if self.domain.has_block(block)
            && let Some(row) = self.table.row(id, self.domain.axes().len())
        {
            for (axis, &x) in self.domain.axes().iter().zip(row).filter(|(axis, _)| axis.block == block) {
                lanes[usize::from(axis.lane)] = x;
            }
        }
        lanes
    }

    fn capacity(&self) -> u64 {
        self.inner.capacity()
    }

    fn preferred_count(&self, n: u64) -> u64 {
        self.inner.preferred_count(n)
    }
}

/// A filter's view of the samples that a sampler has placed, up to the last published round.
#[derive(Clone, Debug)]
pub struct PlacedHandle {
    domain: Domain,
    table: Arc<Mutex<Option<Arc<Table>>>>,
}

impl PlacedHandle {
    fn set(&self, table: Option<Arc<Table>>) {
        *self.table.lock().unwrap_or_else(PoisonError::into_inner) = table;
    }

    fn table(&self) -> Arc<Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner).clone().unwrap_or_default()
    }
}

/// The points of a film's samples, for filters that read coordinates: a point set, a domain, and the samples that a sampler has
/// placed.
#[derive(Clone)]
pub struct FilmPoints {
    points: Arc<dyn PointSet>,
    domain: Domain,
    placed: Option<PlacedHandle>,
    defocus: Option<Defocus>,
}

impl FilmPoints {
    /// Creates the points of a film that was rendered with `points`.
    pub fn new(points: Arc<dyn PointSet>, domain: Domain) -> Self {
        Self { points, domain, placed: None, defocus: None }
    }

    /// Adds the samples that a sampler has placed ([`Placed::handle`]).
    #[must_use]
    pub fn with_placed(self, placed: Option<PlacedHandle>) -> Self {
        Self { placed, ..self }
    }

    /// Adds the blur of the camera's lens, for filters that move samples over the lens.
    #[must_use]
    pub fn with_defocus(self, defocus: Option<Defocus>) -> Self {
        Self { defocus, ..self }
    }

    /// The blur of the camera's lens; `None` without a lens or if it is unknown.
    pub fn defocus(&self) -> Option<Defocus> {
        self.defocus
    }

    /// The sample dimensions whose meaning is known.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Returns the point set with all samples placed up to the last published round.
    pub fn now(&self) -> Placed<Arc<dyn PointSet>> {
        let domain = self.placed.as_ref().map_or(&self.domain, |placed| &placed.domain);
        let mut points = Placed::new(self.points.clone(), domain.clone());
        points.table = self.placed.as_ref().map_or_else(Arc::default, PlacedHandle::table);
        points
    }
}

impl fmt::Debug for FilmPoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FilmPoints").field("points", &self.points.describe()).field("domain", &self.domain).finish()
    }
}
