//! Large arrays, in huge pages where the system has them.

use bytemuck::Pod;
#[cfg(target_os = "linux")]
use memmap2::{Advice, MmapMut};
use std::fmt;
use std::ops::{Deref, DerefMut};

/// The size in bytes from which an array asks for huge pages: two of them on most machines.
#[cfg(target_os = "linux")]
const LARGE: usize = 1 << 22;

/// An array of a fixed length. Linux gives huge pages only to memory that asks for them, which the allocator of a
/// program does not. With small pages, a walk through a large tree waits for addresses as long as for their contents.
pub(crate) struct Pages<T>(Memory<T>);

enum Memory<T> {
    Allocated(Vec<T>),
    /// Memory of the array's size in bytes.
    #[cfg(target_os = "linux")]
    Mapped(MmapMut),
}

impl<T> Default for Pages<T> {
    fn default() -> Self {
        Self(Memory::Allocated(Vec::new()))
    }
}

impl<T: Pod> Pages<T> {
    /// Returns an array of so many zeros.
    pub(crate) fn zeroed(count: usize) -> Self {
        #[cfg(target_os = "linux")]
        if let Some(map) = count.checked_mul(size_of::<T>()).filter(|&bytes| bytes >= LARGE).and_then(mapped) {
            return Self(Memory::Mapped(map));
        }
        Self(Memory::Allocated(bytemuck::zeroed_vec(count)))
    }
}

/// Returns memory that the system is asked to put into huge pages; `None` if it has none to give.
#[cfg(target_os = "linux")]
fn mapped(bytes: usize) -> Option<MmapMut> {
    let map = MmapMut::map_anon(bytes).ok()?;
    // A system without huge pages refuses. Small ones will do then.
    let _ = map.advise(Advice::HugePage);
    Some(map)
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Allocated(values) => values,
            #[cfg(target_os = "linux")]
            Memory::Mapped(map) => bytemuck::cast_slice(map),
        }
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Allocated(values) => values,
            #[cfg(target_os = "linux")]
            Memory::Mapped(map) => bytemuck::cast_slice_mut(map),
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

impl<T: Pod + fmt::Debug> fmt::Debug for Pages<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_large_arrays_are_zero_and_can_be_written() {
        for count in [0, 1, 1000, 1 << 20, (1 << 20) + 1] {
            let mut pages = Pages::<u32>::zeroed(count);
            assert!(pages.len() == count && pages.iter().all(|&word| word == 0));
            pages.iter_mut().zip(0..).for_each(|(word, number)| *word = number);
            let copy = pages.clone();
            drop(pages);
            assert!(copy.iter().zip(0..).all(|(&word, number)| word == number), "{count}");
        }
    }
}
