//! Point sets in which a sampler decides where samples lie.

use crate::{Defocus, Domain};
use dapple_core::{Error, Frame, Limits, Needs, PointSet, SampleId, streams};
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// The largest coordinate below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A point set over another one, with samples whose coordinates in a [`Domain`] a sampler has placed.
///
/// All other coordinates, and those of samples that were not placed, are the inner set's. The sampler owns the set and adds
/// samples in [`Sampler::next_round`](dapple_core::Sampler::next_round). Coordinates never change once they are set, so that
/// traced samples can be replayed. A sampler saves them with [`Placed::save`].
///
/// ```
/// use dapple_classics::{Axis, Domain, Placed, Role};
/// use dapple_core::{Frame, HostNumbers, PointSet, SampleId, streams};
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
    /// For each stream of the image's samples and each pixel: the coordinates of its first samples, sample by sample.
    rows: [Vec<Vec<f32>>; STREAMS],
}

/// The streams of the image's samples have the numbers below this one.
const STREAMS: usize = 3;
const _: () = assert!(streams::WHOLE < 3 && streams::HALVES[0] < 3 && streams::HALVES[1] < 3);

impl Table {
    /// The index, in the window, of the sample's pixel; `None` outside.
    fn pixel(&self, id: SampleId) -> Option<usize> {
        let frame = self.frame.as_ref()?;
        let ([x0, y0], [width, height]) = (frame.origin(), frame.size());
        let (x, y) = (id.pixel[0].checked_sub(x0)?, id.pixel[1].checked_sub(y0)?);
        (x < width && y < height).then(|| y as usize * width as usize + x as usize)
    }

    /// The sample's coordinates, `axes` many; `None` if it was not placed.
    #[inline]
    fn row(&self, id: SampleId, axes: usize) -> Option<&[f32]> {
        let row = self.rows.get(id.stream as usize)?.get(self.pixel(id)?)?;
        let first = usize::try_from(id.index).ok()?.checked_mul(axes)?;
        row.get(first..first.checked_add(axes)?)
    }
}

impl Domain {
    /// The bytes of a [`Placed`] in which a render within these limits places all its samples.
    pub fn placed_bytes(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> u64 {
        let rows = frame.bytes(size_of::<Vec<f32>>() * if needs.halves { 2 } else { 1 });
        // Rows grow by a quarter.
        rows.saturating_add(limits.expected_samples(frame).saturating_mul(5 * self.axes().len() as u64))
    }
}

impl<P: PointSet> Placed<P> {
    /// The points of `inner`, without placed samples.
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

    /// Forgets all placed samples.
    pub fn clear(&mut self) {
        self.handle.set(None);
        self.table = Arc::default();
    }

    /// Places a sample of a render of `frame`: sets its coordinates, in the order of the domain's axes. Coordinates are clamped
    /// to `[0, 1)`; NaN becomes 0. Samples of the pixel that were left out before it keep the inner set's coordinates.
    ///
    /// Call [`Placed::publish`] after the last sample of a round.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] for a sample that is placed already or precedes one, outside the frame, or of another stream than
    /// those of the image; also for a wrong number of coordinates.
    pub fn add(&mut self, frame: &Frame, id: SampleId, coordinates: &[f32]) -> Result<(), Error> {
        self.handle.set(None);
        let (axes, table) = (self.domain.axes().len(), Arc::make_mut(&mut self.table));
        if table.frame != Some(*frame) {
            *table = Table { frame: Some(*frame), rows: Default::default() };
        }
        let refuse = |allowed| Err(Error::OutOfRange { name: "placed sample", value: format!("{id:?}"), allowed });
        let (Some(pixel), stream) = (table.pixel(id), id.stream as usize) else {
            return refuse("a pixel of the frame");
        };
        let Some(rows) = table.rows.get_mut(stream) else { return refuse("a stream of the image's samples") };
        if coordinates.len() != axes {
            return refuse("one coordinate per axis of the domain");
        }
        rows.resize(frame.pixels(), Vec::new());
        let row = &mut rows[pixel];
        let there = (row.len() / axes) as u64;
        if id.index < there {
            return refuse("samples in the order of their indices, each once");
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

    /// Shows the samples placed so far to the holders of a [`Placed::handle`].
    pub fn publish(&mut self) {
        self.handle.set(Some(self.table.clone()));
    }

    /// The placed samples as bytes for [`Placed::restore`].
    pub fn save(&self) -> Vec<u8> {
        let Some(frame) = self.table.frame else { return Vec::new() };
        let mut words = [frame.resolution(), frame.origin(), frame.size()].concat();
        for rows in &self.table.rows {
            words.push(u32::from(!rows.is_empty()));
            for row in rows {
                words.push((row.len() / self.domain.axes().len()) as u32);
                words.extend(row.iter().map(|x| x.to_bits()));
            }
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }

    /// Restores what [`Placed::save`] of such a set returned.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for other bytes.
    pub fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.clear();
        if !saved.is_empty() {
            let table = self.table_of(saved).ok_or(Error::BadSnapshot { what: "they are not placed samples" })?;
            self.table = Arc::new(table);
            self.publish();
        }
        Ok(())
    }

    /// The table that these bytes hold, to the last one.
    fn table_of(&self, saved: &[u8]) -> Option<Table> {
        let (words, []) = saved.as_chunks() else { return None };
        let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
        let [w, h, x, y, cw, ch] = [(); 6].map(|()| words.next());
        let (x, y) = (x?, y?);
        let frame = Frame::new(w?, h?).ok()?.crop(x, y, x.checked_add(cw?)?, y.checked_add(ch?)?).ok()?;
        let mut table = Table { frame: Some(frame), rows: Default::default() };
        for rows in &mut table.rows {
            let pixels = match words.next()? {
                0 => 0,
                1 => frame.pixels(),
                _ => return None,
            };
            for _ in 0..pixels {
                let numbers = (words.next()? as usize).checked_mul(self.domain.axes().len())?;
                if numbers > words.len() {
                    return None;
                }
                rows.push(words.by_ref().take(numbers).map(f32::from_bits).collect());
            }
        }
        let all = table.rows.iter().flatten().flatten();
        (words.next().is_none() && all.copied().all(|x| (0.0..1.0).contains(&x))).then_some(table)
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

/// The samples that a sampler has placed, for filters: those of its last published round.
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

/// The points of a film's samples, for filters that read coordinates: a point set, a domain, and the samples that a sampler
/// has placed.
#[derive(Clone)]
pub struct FilmPoints {
    points: Arc<dyn PointSet>,
    domain: Domain,
    placed: Option<PlacedHandle>,
    defocus: Option<Defocus>,
}

impl FilmPoints {
    /// The points of a film that was rendered with `points`.
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

    /// The blur of the camera's lens; `None` if there is none or it is unknown.
    pub fn defocus(&self) -> Option<Defocus> {
        self.defocus
    }

    /// The dimensions in which samples have a meaning.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The same points in other dimensions.
    pub(crate) fn with_domain(self, domain: Domain) -> Self {
        Self { domain, ..self }
    }

    /// The points of all samples traced so far.
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

#[cfg(test)]
mod tests;
