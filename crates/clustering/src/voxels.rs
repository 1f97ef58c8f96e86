//! Pairs of a voxel and a triangle, sorted by voxel. Only occupied voxels take memory.

use rayon::prelude::*;

/// The numbers of a voxel and a triangle, ordered by the first, then by the second.
pub(crate) trait Entry: Copy + Ord + Default + Send + Sync {
    /// Pairs a voxel with a triangle.
    fn new(voxel: u64, triangle: u32) -> Self;
    /// The voxel.
    fn voxel(self) -> u64;
    /// The triangle.
    fn triangle(self) -> u32;
}

/// Entries for grids of up to 2^32 voxels.
impl Entry for u64 {
    #[inline]
    fn new(voxel: u64, triangle: u32) -> Self {
        voxel << 32 | u64::from(triangle)
    }
    #[inline]
    fn voxel(self) -> u64 {
        self >> 32
    }
    #[inline]
    fn triangle(self) -> u32 {
        self as u32
    }
}

/// Entries for any grid.
impl Entry for u128 {
    #[inline]
    fn new(voxel: u64, triangle: u32) -> Self {
        u128::from(voxel) << 32 | u128::from(triangle)
    }
    #[inline]
    fn voxel(self) -> u64 {
        (self >> 32) as u64
    }
    #[inline]
    fn triangle(self) -> u32 {
        self as u32
    }
}

/// The average number of entries per bucket: 32 KiB with their copy, a first-level cache.
const BUCKET: usize = 2048;
/// The most buckets. Counting into more of them costs more than sorting longer ones.
const MAX_BUCKETS: usize = 1024;
/// Buckets with fewer entries are sorted by comparisons.
const SMALL: usize = 64;
/// The most bits of a voxel's number for which voxels are counted: half a first-level cache of counters.
const MAX_COUNTED: u32 = 12;
/// The most voxels per entry for which voxels are counted. Clearing and adding up a counter takes a fraction of moving
/// an entry once more.
const SPARSE: usize = 4;

/// Ranges of voxels of equal width, a power of two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ranges {
    shift: u32,
    count: usize,
}

impl Ranges {
    /// The ranges for a number of voxels and of entries.
    pub(crate) fn new(voxels: u64, entries: usize) -> Self {
        let wanted = (entries / BUCKET).clamp(1, MAX_BUCKETS).next_power_of_two().trailing_zeros();
        let bits = u64::BITS - (voxels - 1).leading_zeros();
        let shift = bits.saturating_sub(wanted);
        Self { shift, count: ((voxels - 1) >> shift) as usize + 1 }
    }

    /// The number of ranges.
    pub(crate) fn count(&self) -> usize {
        self.count
    }
}

/// Entries ordered by range, otherwise in their old order.
pub(crate) struct Sorted<E> {
    entries: Vec<E>,
    starts: Vec<u32>,
}

impl<E: Entry> Sorted<E> {
    /// Orders entries by range.
    pub(crate) fn new(unsorted: &[E], ranges: Ranges) -> Self {
        let mut starts = vec![0_u32; ranges.count + 1];
        for entry in unsorted {
            starts[(entry.voxel() >> ranges.shift) as usize + 1] += 1;
        }
        for i in 0..ranges.count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut entries = vec![E::default(); unsorted.len()];
        for &entry in unsorted {
            let slot = &mut next[(entry.voxel() >> ranges.shift) as usize];
            entries[*slot as usize] = entry;
            *slot += 1;
        }
        Self { entries, starts }
    }

    fn range(&self, number: usize) -> &[E] {
        &self.entries[self.starts[number] as usize..self.starts[number + 1] as usize]
    }
}

/// Calls `work` for each range with its entries in order. The results have the order of the ranges.
pub(crate) fn for_ranges<E: Entry, S: Default, T: Send>(
    parts: &[Sorted<E>],
    ranges: Ranges,
    work: impl Fn(&mut S, &[E]) -> T + Sync,
) -> Vec<T> {
    (0..ranges.count())
        .into_par_iter()
        .map_init(
            || (Buffers { entries: Vec::new(), spare: Vec::new(), next: Vec::new() }, S::default()),
            |(buffers, scratch), number| {
                buffers.load(parts, number, ranges.shift);
                work(scratch, &buffers.entries)
            },
        )
        .collect()
}

/// The sorting buffers of one thread.
struct Buffers<E> {
    entries: Vec<E>,
    spare: Vec<E>,
    next: Vec<u32>,
}

impl<E: Entry> Buffers<E> {
    /// Fills `entries` with those of a range, sorted. Their voxels agree in all but the low `bits`.
    fn load(&mut self, parts: &[Sorted<E>], range: usize, bits: u32) {
        let parts = || parts.iter().map(|part| part.range(range));
        let count = parts().map(<[E]>::len).sum();
        if count < SMALL || bits > MAX_COUNTED || 1 << bits > SPARSE * count {
            self.entries.clear();
            parts().for_each(|part| self.entries.extend_from_slice(part));
            return sort(&mut self.entries, &mut self.spare, bits);
        }
        // A counter per voxel sorts straight from the parts in one pass.
        let voxel = |entry: E| entry.voxel() as usize & ((1 << bits) - 1);
        self.next.clear();
        self.next.resize(1 << bits, 0);
        for part in parts() {
            for &entry in part {
                self.next[voxel(entry)] += 1;
            }
        }
        let mut sum = 0;
        for slot in &mut self.next {
            sum += std::mem::replace(slot, sum);
        }
        self.entries.resize(count, E::default());
        for part in parts() {
            for &entry in part {
                let slot = &mut self.next[voxel(entry)];
                self.entries[*slot as usize] = entry;
                *slot += 1;
            }
        }
    }
}

/// Sorts entries whose voxels agree in all but the low `bits`, and whose triangles ascend.
fn sort<E: Entry>(entries: &mut Vec<E>, spare: &mut Vec<E>, bits: u32) {
    const DIGIT: u32 = 8;
    if entries.len() < SMALL || bits > 3 * DIGIT {
        entries.sort_unstable();
        return;
    }
    for pass in 0..bits.div_ceil(DIGIT) {
        let digit = |entry: E| (entry.voxel() >> (pass * DIGIT)) as usize & 255;
        let mut next = [0_u32; 257];
        for &entry in entries.iter() {
            next[digit(entry) + 1] += 1;
        }
        for i in 0..256 {
            next[i + 1] += next[i];
        }
        spare.clear();
        spare.resize(entries.len(), E::default());
        for &entry in entries.iter() {
            let slot = &mut next[digit(entry)];
            spare[*slot as usize] = entry;
            *slot += 1;
        }
        std::mem::swap(entries, spare);
    }
}
