//! Passes over an image in rows. Each pass declares which rows of which planes it reads. The [`Graph`] computes rows on demand
//! and drops them after their last reader, so that only some rows of a plane are in memory.
//!
//! Every row is computed independently, so results do not depend on the number of rows that are computed together.

use dapple_core::{Film, Frame, Needs, parallel};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The number of rows of the result that are computed together: a row of tiles, or enough for all threads.
fn step() -> usize {
    (4 * parallel::threads()).next_multiple_of(16)
}

/// Requests for rows begin this many rows above the image, so that passes far ahead of the result also begin with few rows.
const BEFORE: isize = 1024;

/// One value per pixel, computed by a pass of a [`Graph`]. Some passes compute blocks of other lengths in place of rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane(usize);

/// The rows of a plane that a pass reads for each of its rows.
#[derive(Clone, Copy)]
pub(crate) struct Reach {
    /// The number of rows of the plane per row of the pass, and of rows of the pass per row of the plane; one of them is 1.
    factors: [usize; 2],
    /// The additional rows above and below, counted in the finer of the two kinds of rows.
    more: usize,
}

impl Reach {
    /// The row itself, and this many rows above and below.
    pub(crate) const fn rows(more: usize) -> Self {
        Self { factors: [1, 1], more }
    }

    /// The reach of a pass whose rows are as high as `factor` rows of the plane.
    pub(crate) const fn from_fine(factor: usize, more: usize) -> Self {
        Self { factors: [factor, 1], more }
    }

    /// The reach into a plane whose rows are as high as `factor` rows of the pass.
    pub(crate) const fn from_coarse(factor: usize, more: usize) -> Self {
        Self { factors: [1, factor], more }
    }

    /// The first row of the plane that is read for row `y` of the pass.
    const fn first(self, y: usize) -> usize {
        (y * self.factors[0]).saturating_sub(self.more) / self.factors[1]
    }

    /// The end of the rows of the plane that are read for the rows of the pass before `end`; it may lie beyond the last row.
    const fn end(self, end: isize) -> isize {
        let [fine, coarse] = [self.factors[0] as isize, self.factors[1] as isize];
        (end * fine + self.more as isize + coarse - 1).div_euclid(coarse)
    }
}

/// The rows of all planes that are in memory.
pub(crate) struct Rows {
    windows: Vec<Window>,
    /// Buffers of the image's width for new rows.
    spare: Mutex<Vec<Vec<f32>>>,
}

#[derive(Default)]
struct Window {
    first: usize,
    rows: VecDeque<Vec<f32>>,
}

impl Rows {
    /// Row `y` of a plane that the pass reads.
    #[inline]
    pub(crate) fn row(&self, plane: Plane, y: usize) -> &[f32] {
        let window = &self.windows[plane.0];
        &window.rows[y - window.first]
    }

    /// Row buffers of this width with arbitrary contents.
    fn rows<const N: usize>(&self, width: usize) -> [Vec<f32>; N] {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        std::array::from_fn(|_| spare.pop().unwrap_or_else(|| vec![0.0; width]))
    }
}

#[cfg(test)]
impl Rows {
    /// The number of rows of a plane in memory.
    pub(crate) fn kept(&self, plane: Plane) -> usize {
        self.windows[plane.0].rows.len()
    }
}

/// For each computed row, the values of that row in all planes of a pass.
type Made = Vec<Vec<Vec<f32>>>;
type Make<'a> = dyn Fn(&Rows, Range<usize>) -> Made + Sync + 'a;

struct Pass<'a> {
    height: usize,
    /// The first plane of the pass; `length` is the number of values in a row of each plane.
    first_plane: usize,
    length: usize,
    reads: Vec<(Plane, Reach)>,
    make: Box<Make<'a>>,
}

/// The passes over an image. Each reads only planes of earlier passes.
pub(crate) struct Graph<'a> {
    /// Width and height of the image.
    pub(crate) size: [usize; 2],
    passes: RefCell<Vec<Pass<'a>>>,
    /// The pass that computes each plane.
    owners: RefCell<Vec<usize>>,
}

impl<'a> Graph<'a> {
    pub(crate) fn new(size: [usize; 2]) -> Self {
        Self { size, passes: RefCell::default(), owners: RefCell::default() }
    }

    /// Adds a pass that computes this many planes of this height, with `length` values per row.
    fn add(
        &self,
        [height, planes, length]: [usize; 3],
        reads: Vec<(Plane, Reach)>,
        make: Box<Make<'a>>,
    ) -> Range<usize> {
        let (mut passes, mut owners) = (self.passes.borrow_mut(), self.owners.borrow_mut());
        let first_plane = owners.len();
        owners.resize(first_plane + planes, passes.len());
        passes.push(Pass { height, first_plane, length, reads, make });
        first_plane..first_plane + planes
    }

    /// Adds planes of the image. `of` gets the number of a row and computes that row of each plane.
    pub(crate) fn rows<const N: usize>(
        &self,
        reads: Vec<(Plane, Reach)>,
        of: impl Fn(&Rows, usize, [&mut [f32]; N]) + Sync + 'a,
    ) -> [Plane; N] {
        let [width, height] = self.size;
        let make = move |rows: &Rows, range: Range<usize>| {
            let row = |y: usize| {
                let mut row: [Vec<f32>; N] = rows.rows(width);
                of(rows, y, row.each_mut().map(|plane| &mut plane[..]));
                Vec::from(row)
            };
            let together = range.len().div_ceil(4 * parallel::threads());
            let part = |k: usize| range.clone().skip(k * together).take(together).map(row).collect::<Made>();
            parallel::map(range.len().div_ceil(together), part).into_iter().flatten().collect()
        };
        let planes = self.add([height, N, width], reads, Box::new(make));
        std::array::from_fn(|k| Plane(planes.start + k))
    }

    /// Adds a plane for each column of tiles. A row of a plane is the result of `of` for a column and a row of tiles: at most
    /// `length` values. Buffers from `init` are reused.
    pub(crate) fn tiles<M: Send>(
        &self,
        ([columns, height], length): ([usize; 2], usize),
        reads: Vec<(Plane, Reach)>,
        init: impl Fn() -> M + Sync + 'a,
        of: impl Fn(&mut M, &Rows, [usize; 2]) -> Vec<f32> + Sync + 'a,
    ) -> Vec<Plane> {
        let make = move |rows: &Rows, range: Range<usize>| {
            let tile = |memory: &mut M, k: usize| of(memory, rows, [k % columns, range.start + k / columns]);
            let mut all = parallel::map_with(range.len() * columns, &init, tile).into_iter();
            range.clone().map(|_| all.by_ref().take(columns).collect()).collect()
        };
        self.add([height, columns, length], reads, Box::new(make)).map(Plane).collect()
    }

    /// Computes all rows of these planes, and passes them to `take`, a few at a time.
    pub(crate) fn run(self, planes: &[Plane], take: impl FnMut(&Rows, Range<usize>) + Send) {
        let ([width, _], plan) = (self.size, self.plan(planes));
        let windows = plan.readers.iter().map(|_| Window::default()).collect();
        let rows = Rows { windows, spare: Mutex::default() };
        // Runs on a thread of the pool, where loops begin without waiting for one to wake up.
        parallel::parts(std::iter::once((rows, take)), |_, (rows, take)| {
            plan.walk(|pass, range, kept| {
                if pass.length == 0 {
                    take(rows, range.clone());
                }
                for row in (pass.make)(rows, range) {
                    for (p, values) in (pass.first_plane..).zip(row).filter(|(p, _)| !plan.readers[*p].is_empty()) {
                        rows.windows[p].rows.push_back(values);
                    }
                }
                let Rows { windows, spare } = &mut *rows;
                let spare = spare.get_mut().unwrap_or_else(PoisonError::into_inner);
                for (plane, first) in kept {
                    spare.extend(windows[plane.0].above(first).filter(|row| row.len() == width));
                }
            });
        });
    }

    /// The largest number of bytes that [`Self::run`] uses: for rows, for the gaps that rows of different lengths leave between
    /// them, and for the copies of the threads.
    pub(crate) fn bytes(self, planes: &[Plane]) -> u64 {
        /// Gaps are a tenth to a fourth of the rows, by measurement.
        const GAPS: u64 = 5;
        /// The copies of planes that the wide pass makes for a tile, and the sums.
        const THREAD: u64 = 5 << 19;
        let plan = self.plan(planes);
        let mut windows: Vec<Range<usize>> = vec![0..0; plan.readers.len()];
        let (mut now, mut most) = (0u64, 0);
        plan.walk(|pass, range, kept| {
            let planes = pass.first_plane..plan.readers.len();
            for p in planes.take_while(|p| plan.owners[*p] == plan.owners[pass.first_plane]) {
                if !plan.readers[p].is_empty() {
                    windows[p].end = range.end;
                    now += (range.len() * pass.length) as u64;
                }
            }
            most = most.max(now);
            for (Plane(p), first) in kept {
                let first = first.min(windows[p].end).max(windows[p].start);
                now -= ((first - windows[p].start) * plan.passes[plan.owners[p]].length) as u64;
                windows[p].start = first;
            }
        });
        4 * (most + most / GAPS) + THREAD * parallel::threads() as u64
    }

    /// The passes, followed by one that reads these planes, and the readers of each plane.
    fn plan(self, planes: &[Plane]) -> Plan<'a> {
        let (mut passes, owners) = (self.passes.into_inner(), self.owners.into_inner());
        let reads = planes.iter().map(|plane| (*plane, Reach::rows(0))).collect();
        let make = Box::new(|_: &Rows, _| Vec::new());
        passes.push(Pass { height: self.size[1], first_plane: owners.len(), length: 0, reads, make });
        let mut readers: Vec<Vec<(usize, Reach)>> = vec![Vec::new(); owners.len()];
        for (k, pass) in passes.iter().enumerate().rev() {
            // Passes whose planes are not read compute nothing.
            let own = (pass.first_plane..owners.len()).take_while(|p| owners[*p] == k);
            if k + 1 == passes.len() || own.into_iter().any(|p| !readers[p].is_empty()) {
                pass.reads.iter().for_each(|(plane, reach)| readers[plane.0].push((k, *reach)));
            }
        }
        Plan { passes, owners, readers }
    }

    /// Computes all rows of these planes.
    pub(crate) fn collect<const N: usize>(self, planes: [Plane; N]) -> [Vec<f32>; N] {
        let mut all = std::array::from_fn(|_| Vec::with_capacity(self.size[0] * self.size[1]));
        self.run(&planes, |rows, range| {
            for (all, plane) in all.iter_mut().zip(planes) {
                range.clone().for_each(|y| all.extend_from_slice(rows.row(plane, y)));
            }
        });
        all
    }
}

/// The passes in order; the last one reads the requested planes.
struct Plan<'a> {
    passes: Vec<Pass<'a>>,
    /// The pass of each plane.
    owners: Vec<usize>,
    /// The passes that read each plane.
    readers: Vec<Vec<(usize, Reach)>>,
}

impl Plan<'_> {
    /// Calls `visit` with a pass, the rows to compute, and the planes that it reads with the first row of each that is still
    /// needed.
    fn walk(&self, mut visit: impl FnMut(&Pass<'_>, Range<usize>, &mut dyn Iterator<Item = (Plane, usize)>)) {
        let (last, mut ends) = (self.passes.len() - 1, vec![0; self.passes.len()]);
        let step = step() as isize;
        // The end of the rows that each pass must compute. A negative end computes none yet, but may request rows of other
        // passes.
        let mut wanted = vec![isize::MIN; self.passes.len()];
        wanted[last] = -BEFORE;
        while ends[last] < self.passes[last].height {
            wanted[last] += step;
            for (k, pass) in self.passes.iter().enumerate().rev() {
                if wanted[k] == isize::MIN {
                    continue;
                }
                for (plane, reach) in &pass.reads {
                    let from = self.owners[plane.0];
                    wanted[from] = wanted[from].max(reach.end(wanted[k]));
                }
            }
            for (k, pass) in self.passes.iter().enumerate() {
                let end = wanted[k].clamp(0, pass.height as isize) as usize;
                let range = std::mem::replace(&mut ends[k], end)..end;
                if range.is_empty() {
                    continue;
                }
                let first = |plane: Plane| {
                    let first = |(reader, reach): &(usize, Reach)| match ends[*reader] {
                        end if end == self.passes[*reader].height => usize::MAX,
                        end => reach.first(end),
                    };
                    self.readers[plane.0].iter().map(first).min().unwrap_or(usize::MAX)
                };
                visit(pass, range, &mut pass.reads.iter().map(|(plane, _)| (*plane, first(*plane))));
            }
        }
    }
}

impl Window {
    /// Removes and returns the rows above row `y`.
    fn above(&mut self, y: usize) -> impl Iterator<Item = Vec<f32>> {
        let count = y.saturating_sub(self.first).min(self.rows.len());
        self.first += count;
        self.rows.drain(..count)
    }
}

/// The bytes of rows in memory while the planes that `passes` returns are computed for a frame. `passes` gets an empty film.
pub(crate) fn bytes_of_rows(
    frame: &Frame,
    needs: &Needs,
    passes: impl for<'a> FnOnce(&Graph<'a>, &'a Film) -> Vec<Plane>,
) -> u64 {
    Frame::new(1, 1).map_or(0, |one| {
        let film = Film::new(one, *needs);
        let graph = Graph::new(as_high(frame));
        let planes = passes(&graph, &film);
        graph.bytes(&planes)
    })
}

/// The size of an image whose rows need as much memory as the frame's: at most 1024 rows high, as higher images need no more.
pub(crate) fn as_high(frame: &Frame) -> [usize; 2] {
    const HIGH: usize = 1024;
    let [width, height] = frame.size().map(|n| n as usize);
    [width, height.min(HIGH)]
}

/// Pairs each plane with the same reach.
pub(crate) fn all(planes: impl IntoIterator<Item = Plane>, reach: Reach) -> Vec<(Plane, Reach)> {
    planes.into_iter().map(|plane| (plane, reach)).collect()
}
