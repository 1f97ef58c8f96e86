//! Large arrays, in huge pages if the system supports them.

use bytemuck::Pod;
#[cfg(target_os = "linux")]
use memmap2::{Advice, MmapMut};
#[cfg(target_os = "linux")]
use rayon::prelude::*;
use std::ops::{Deref, DerefMut};

/// The size of a huge page on most machines. Arrays of at least this size request huge pages.
#[cfg(target_os = "linux")]
const HUGE: usize = 1 << 21;

/// An array of a fixed length. Linux uses huge pages only for memory that requests them, which Rust's allocator does not. With
/// small pages, traversing a large tree spends as much time on address translation as on the data itself.
#[derive(Debug)]
pub(crate) struct Pages<T>(Memory<T>);

#[derive(Debug)]
enum Memory<T> {
    Allocated(Vec<T>),
    /// Memory mapped from the system, and the array's size in bytes.
    #[cfg(target_os = "linux")]
    Mapped(MmapMut, usize),
}

impl<T> Default for Pages<T> {
    fn default() -> Self {
        Self(Memory::Allocated(Vec::new()))
    }
}

impl<T: Pod> Pages<T> {
    /// Returns an array of `count` zeros.
    pub(crate) fn zeroed(count: usize) -> Self {
        #[cfg(target_os = "linux")]
        if let Some(bytes) = count.checked_mul(size_of::<T>()).filter(|&bytes| bytes >= HUGE)
            && let Some(map) = mapped(bytes)
        {
            return Self(Memory::Mapped(map, bytes));
        }
        Self(Memory::Allocated(bytemuck::zeroed_vec(count)))
    }

    /// Returns an array of `count` zeros. Reuses this array's memory if it is mapped and large enough, which is faster than
    /// new memory.
    pub(crate) fn reused<U: Pod>(self, count: usize) -> Pages<U> {
        #[cfg(target_os = "linux")]
        if let Memory::Mapped(mut map, _) = self.0
            && let Some(bytes) = count.checked_mul(size_of::<U>()).filter(|&bytes| bytes <= map.len())
        {
            map[..bytes].par_chunks_mut(HUGE).for_each(|part| part.fill(0));
            return Pages(Memory::Mapped(map, bytes));
        }
        Pages::zeroed(count)
    }
}

/// Maps memory from the system, with a request for huge pages. Returns `None` if the system has no memory left.
#[cfg(target_os = "linux")]
fn mapped(bytes: usize) -> Option<MmapMut> {
    // Linux aligns whole numbers of huge pages only. The last one consists of small pages if less than half of it is used.
    let map = MmapMut::map_anon(bytes.checked_next_multiple_of(HUGE)?).ok()?;
    // A system without huge pages rejects the request; small pages are used then.
    let _ = map.advise_range(Advice::HugePage, 0, (bytes + HUGE / 2) / HUGE * HUGE);
    Some(map)
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Allocated(values) => values,
            #[cfg(target_os = "linux")]
            Memory::Mapped(map, bytes) => bytemuck::cast_slice(&map[..*bytes]),
        }
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Allocated(values) => values,
            #[cfg(target_os = "linux")]
            Memory::Mapped(map, bytes) => bytemuck::cast_slice_mut(&mut map[..*bytes]),
        }
    }
}

impl<T: Pod> Clone for Pages<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.len());
        copy.copy_from_slice(self);
        copy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reused_memory_is_zero() {
        for (count, other) in
            [(1000, 1000), (1 << 19, 1 << 18), (1 << 20, 1000), (1 << 20, 1 << 19), (1 << 20, 1 << 21)]
        {
            let mut pages = Pages::<u32>::zeroed(count);
            pages.fill(1);
            let at = pages.as_ptr() as usize;
            let reused = pages.reused::<u64>(other);
            if cfg!(target_os = "linux") && 4 * count >= 1 << 21 && 8 * other <= 4 * count {
                assert_eq!(reused.as_ptr() as usize, at, "new memory: {count}, {other}");
            }
            assert!(reused.len() == other && reused.iter().all(|&word| word == 0), "{count}, {other}");
        }
    }

    #[test]
    fn small_and_large_arrays_are_zero_and_can_be_written() {
        for count in [0, 1, 1000, 1 << 19, 1 << 20, (1 << 20) + 1] {
            let mut pages = Pages::<u32>::zeroed(count);
            assert!(pages.len() == count && pages.iter().all(|&word| word == 0));
            pages.iter_mut().zip(0..).for_each(|(word, number)| *word = number);
            let copy = pages.clone();
            drop(pages);
            assert!(copy.iter().zip(0..).all(|(&word, number)| word == number), "{count}");
        }
    }
}
