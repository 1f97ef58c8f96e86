//! Loops over pixels, tiles or other tasks on all threads.
//!
//! Rayon's generic loops are compiled once per closure, and would be a third of the code of some crates. These loops are
//! compiled once, and call closures through a pointer for many pixels at a time.
//!
//! Without the feature `threads`, the loops run on the caller's thread, with bit-identical results.

#[cfg(feature = "threads")]
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// The number of pixels per task.
const CHUNK: usize = 1024;

/// Calls `f` with the index and the value of each item of `parts`, in parallel and in any order.
pub fn parts<P: Send>(parts: impl Iterator<Item = P>, f: impl Fn(usize, &mut P) + Sync) {
    let parts: Vec<Mutex<P>> = parts.map(Mutex::new).collect();
    for_each(parts.len(), &|number| f(number, &mut parts[number].lock().unwrap_or_else(PoisonError::into_inner)));
}

/// Calls `f` with each item of `all`, in parallel, and returns the results in the order of the items.
pub fn map_parts<P: Send, R: Send>(all: impl Iterator<Item = P>, f: impl Fn(P) -> R + Sync) -> Vec<R> {
    let mut slots: Vec<(Option<P>, Option<R>)> = all.map(|part| (Some(part), None)).collect();
    parts(slots.iter_mut(), |_, (part, result)| *result = part.take().map(&f));
    slots.into_iter().filter_map(|(_, result)| result).collect()
}

#[cfg(feature = "threads")]
fn for_each(n: usize, f: &(dyn Fn(usize) + Sync)) {
    (0..n).into_par_iter().with_max_len(1).for_each(f);
}

#[cfg(not(feature = "threads"))]
fn for_each(n: usize, f: &(dyn Fn(usize) + Sync)) {
    (0..n).for_each(f);
}

/// The sum of `f` over all numbers below `n`.
#[cfg(feature = "threads")]
pub(crate) fn sum(n: usize, f: &(dyn Fn(usize) -> u128 + Sync)) -> u128 {
    (0..n).into_par_iter().map(f).sum()
}

/// The sum of `f` over all numbers below `n`.
#[cfg(not(feature = "threads"))]
pub(crate) fn sum(n: usize, f: &(dyn Fn(usize) -> u128 + Sync)) -> u128 {
    (0..n).map(f).sum()
}

/// Runs `f` on a thread of the pool, where a loop begins without waiting for a thread to wake up.
pub(crate) fn within<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    #[cfg(feature = "threads")]
    return rayon::scope(|_| f());
    #[cfg(not(feature = "threads"))]
    f()
}

/// The number of threads on which the loops of this module run.
pub fn threads() -> usize {
    #[cfg(feature = "threads")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "threads"))]
    1
}

/// Calls `f`, in parallel, with the number and the values of each chunk of `length` values; the last may be shorter.
///
/// # Panics
///
/// If `length` is 0.
pub fn chunks<T: Send>(values: &mut [T], length: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    parts(values.chunks_mut(length), |number, part| f(number, part));
}

/// Sets each value to `f` of its index, in parallel.
pub fn fill<T: Send>(values: &mut [T], f: impl Fn(usize) -> T + Sync) {
    let each = |number, values: &mut [T]| (number * CHUNK..).zip(values).for_each(|(number, value)| *value = f(number));
    chunks(values, CHUNK, each);
}

/// Computes `f` of each number below `n`, in parallel, and returns the results in order. Takes twice their memory.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_with(n, || (), |(), number| f(number))
}

/// Computes the same as [`map`], with working memory for `f` that `init` makes for each range of consecutive numbers.
pub fn map_with<M, T: Send>(n: usize, init: impl Fn() -> M + Sync, f: impl Fn(&mut M, usize) -> T + Sync) -> Vec<T> {
    let length = (n / 256).clamp(1, CHUNK);
    let mut all: Vec<Vec<T>> = (0..n.div_ceil(length)).map(|_| Vec::new()).collect();
    parts(all.iter_mut(), |number, part| {
        let mut memory = init();
        **part = (number * length..n.min((number + 1) * length)).map(|number| f(&mut memory, number)).collect();
    });
    let mut values = Vec::with_capacity(n);
    all.into_iter().for_each(|mut part| values.append(&mut part));
    values
}
