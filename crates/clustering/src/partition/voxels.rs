//! Voxel-triangle pairs, sorted by voxel. Only occupied voxels use memory.

use rayon::prelude::*;

/// A pair of a voxel's index and a triangle's index, ordered by voxel, then by triangle.
pub(crate) trait Entry: Copy + Ord + Default + Send + Sync {
    /// Pairs a voxel with a triangle.
    fn new(voxel: u64, triangle: u32) -> Self;
    /// The index of the voxel.
    fn voxel(self) -> u64;
    /// The index of the triangle.
    fn triangle(self) -> u32;
}

macro_rules! entries {
    ($($bits:ty)*) => {$(
        impl Entry for $bits {
            #[inline]
            fn new(voxel: u64, triangle: u32) -> Self {
                Self::from(voxel) << 32 | Self::from(triangle)
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
    )*};
}

// Pairs of 64 bits are for grids of up to 2^32 voxels, pairs of 128 bits for any grid.
entries! { u64 u128 }

/// The intended number of entries per range of voxels. With their source parts they fill a first-level cache of 32 KiB.
const BUCKET: usize = 2048;
/// The largest number of ranges of voxels. Counting into more ranges costs more than sorting longer ones.
const MAX_BUCKETS: usize = 1024;
/// The number of entries in a range below which they are sorted by comparisons.
const SMALL: usize = 64;
/// The largest width of a range, in bits of the voxel index, that is sorted by counting entries per voxel. The counters then
/// fill half of a first-level cache.
const MAX_COUNTED: u32 = 12;
/// The largest number of voxels per entry in a range that is sorted by counting entries per voxel. Clearing and adding up a
/// counter costs a fraction of moving an entry once more.
const SPARSE: usize = 4;

/// A division of voxel indices into ranges of equal width, which is a power of two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ranges {
    shift: u32,
    count: usize,
}

impl Ranges {
    /// Chooses ranges for a grid of `voxels` voxels and a number of entries.
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

/// Entries ordered by range of voxels, in the original order within each range.
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

/// Calls `work` in parallel for each range, with its entries sorted by voxel and triangle. Returns the results in the
/// order of the ranges.
pub(crate) fn for_ranges<E: Entry, S: Default, T: Send>(
    parts: &[Sorted<E>],
    ranges: Ranges,
    work: impl Fn(&mut S, &[E]) -> T + Sync,
) -> Vec<T> {
    (0..ranges.count())
        .into_par_iter()
        .map_init(
            || (Buffers { entries: Vec::new(), next: Vec::new() }, S::default()),
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
    next: Vec<u32>,
}

impl<E: Entry> Buffers<E> {
    /// Fills `entries` with the sorted entries of a range from all parts. The voxels of a range differ only in their
    /// low `bits` bits.
    fn load(&mut self, parts: &[Sorted<E>], range: usize, bits: u32) {
        let parts = || parts.iter().map(|part| part.range(range));
        let count = parts().map(<[E]>::len).sum();
        if count < SMALL || bits > MAX_COUNTED || 1 << bits > SPARSE * count {
            self.entries.clear();
            parts().for_each(|part| self.entries.extend_from_slice(part));
            return self.entries.sort_unstable();
        }
        // A counter per voxel sorts straight from the parts in one pass.
        let last = (1 << bits) - 1;
        let voxel = |entry: E| entry.voxel() as usize & last;
        self.next.clear();
        self.next.resize(last + 1, 0);
        // The compiler sees that no index is past its end.
        let next = &mut self.next[..last + 1];
        for part in parts() {
            for &entry in part {
                next[voxel(entry)] += 1;
            }
        }
        let mut sum = 0;
        for slot in next.iter_mut() {
            sum += std::mem::replace(slot, sum);
        }
        self.entries.resize(count, E::default());
        for part in parts() {
            for &entry in part {
                let slot = &mut next[voxel(entry)];
                self.entries[*slot as usize] = entry;
                *slot += 1;
            }
        }
    }
}
