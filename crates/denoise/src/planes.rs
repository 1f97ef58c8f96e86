//! Planes, which hold one value per pixel, pairs of images of them, and parallel loops that compute planes. Loops that read nothing
//! but numbers of the same pixel use vectors of the machine.
//!
//! Every value is computed by itself, so no bit depends on the parts into which a loop is cut.
//!
//! Vectors have 16 lanes, 8, 4 or 1. Debug builds use 8 lanes or 1 on x86-64.

use dapple_core::parallel;
use pulp::{Simd, WithSimd};

/// One value per pixel, row by row.
pub(crate) type Plane = Vec<f32>;

/// The red, green and blue of each pixel, a plane each.
pub(crate) type Colours = [Plane; 3];

/// Two images, one from each half of the samples: red, green and blue of the first half, then of the second.
#[derive(Clone)]
pub(crate) struct Pair(pub(crate) [Plane; 6]);

/// Red, green and blue of the first half, then of the second.
pub(crate) type Channels<'a> = [&'a [f32]; 6];

impl Pair {
    /// The channels of both images.
    pub(crate) fn channels(&self) -> Channels<'_> {
        self.0.each_ref().map(|plane| &plane[..])
    }

    /// Multiplies both halves by each pixel's `albedo`, [raised].
    pub(crate) fn modulate(&mut self, albedo: &[Plane]) {
        for (k, plane) in self.0.iter_mut().enumerate() {
            update(plane, [&albedo[k % 3]], |value, [albedo]| value * raised(albedo));
        }
    }
}

/// A channel of the mean of both halves `a` and `b`, weighted by their sample counts `na` and `nb`.
#[inline(always)]
pub(crate) fn combined([a, b]: [f32; 2], [na, nb]: [f32; 2]) -> f32 {
    b + first_share([na, nb]) * (a - b)
}

/// The share of the first half in a pixel's samples; 0.5 if the pixel has no samples.
#[inline(always)]
pub(crate) fn first_share([a, b]: [f32; 2]) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.5 }
}

/// The least albedo that colours are divided by.
const LEAST_ALBEDO: f32 = 0.02;

/// An albedo that a colour can be divided by: at least [`LEAST_ALBEDO`].
#[inline(always)]
pub(crate) fn raised(albedo: f32) -> f32 {
    albedo.max(LEAST_ALBEDO)
}

/// The number of lanes that [`dispatch`] uses in tests of release builds; 0 for those of the machine. Other tests that run at the
/// same time get the same bits, or fail as well.
#[cfg(all(test, not(debug_assertions)))]
pub(crate) static LANES: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);

/// Runs a task with the vectors of this machine.
pub(crate) fn dispatch<T: WithSimd>(task: T) -> T::Output {
    #[cfg(all(test, not(debug_assertions)))]
    match LANES.load(std::sync::atomic::Ordering::Relaxed) {
        1 => return task.with_simd(pulp::Scalar),
        4 => return task.with_simd(pulp::Scalar128b),
        // Emulated vectors of eight would be compiled for this test alone.
        #[cfg(target_arch = "x86_64")]
        8 => {
            if let Some(v3) = pulp::x86::V3::try_new() {
                return pulp::Simd::vectorize(v3, task);
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        8 => return task.with_simd(pulp::Scalar256b),
        _ => {}
    }
    // Debug builds leave out a copy of all loops for 16 lanes, which takes long to compile.
    #[cfg(all(debug_assertions, target_arch = "x86_64"))]
    return match pulp::x86::V3::try_new() {
        Some(v3) => pulp::Simd::vectorize(v3, task),
        None => task.with_simd(pulp::Scalar),
    };
    #[cfg(not(all(debug_assertions, target_arch = "x86_64")))]
    pulp::Arch::new().dispatch(task)
}

/// The number of pixels of a part: they and their planes stay in the second-level cache.
const CHUNK: usize = 4096;

/// Computes `N` planes in parts of `length` pixels. `of` gets the number of the part and its pixels of each plane, and memory
/// that is made by `init` and used again.
pub(crate) fn parts<T, const N: usize>(
    pixels: usize,
    length: usize,
    init: impl Fn() -> T + Sync,
    of: impl Fn(&mut T, usize, [&mut [f32]; N]) + Sync,
) -> [Plane; N] {
    let mut planes = black(pixels);
    parallel::parts(chunked(&mut planes, length).into_iter(), |number, part| of(&mut init(), number, reborrowed(part)));
    planes
}

// Functions of the number of planes alone, which callers share: closures in `parts` would be compiled for each of them.

fn black<const N: usize>(pixels: usize) -> [Plane; N] {
    std::array::from_fn(|_| vec![0.0; pixels])
}

fn chunked<const N: usize>(planes: &mut [Plane; N], length: usize) -> Vec<[&mut [f32]; N]> {
    let number = planes[0].len().div_ceil(length);
    let mut rest = planes.each_mut().map(|plane| plane.chunks_mut(length));
    (0..number).map(|_| rest.each_mut().map(|chunks| chunks.next().unwrap_or_default())).collect()
}

fn reborrowed<'a, const N: usize>(part: &'a mut [&mut [f32]; N]) -> [&'a mut [f32]; N] {
    part.each_mut().map(|plane| &mut **plane)
}

/// The `length` values of each plane from the value `first` on.
fn cut<const N: usize>(planes: [&[f32]; N], first: usize, length: usize) -> [&[f32]; N] {
    planes.map(|plane| &plane[first..][..length])
}

/// Computes `M` values of every pixel from its values in `N` planes.
pub(crate) fn map<const N: usize, const M: usize>(
    planes: [&[f32]; N],
    of: impl Fn([f32; N]) -> [f32; M] + Sync + Send,
) -> [Plane; M] {
    let part = |(): &mut (), number: usize, mut to: [&mut [f32]; M]| {
        let from = cut(planes, number * CHUNK, to[0].len());
        replace(from, &mut to, |_, values| of(values));
    };
    parts(planes[0].len(), CHUNK, || (), part)
}

/// Computes a value of every pixel from its values in `N` planes.
pub(crate) fn map_to_one<const N: usize>(planes: [&[f32]; N], of: impl Fn([f32; N]) -> f32 + Sync + Send) -> Plane {
    let [plane] = map(planes, |values| [of(values)]);
    plane
}

/// Replaces each value of `plane` by a function of itself and the pixel's values in `N` other planes.
pub(crate) fn update<const N: usize>(plane: &mut [f32], planes: [&[f32]; N], of: impl Fn(f32, [f32; N]) -> f32 + Sync) {
    parallel::chunks(plane, CHUNK, |number, to| {
        let from = cut(planes, number * CHUNK, to.len());
        replace(from, &mut [to], |[own]: [f32; 1], values| [of(own, values)]);
    });
}

/// Replaces the values of a part by a function of them and of the pixel's values in `N` other planes.
fn replace<const N: usize, const M: usize>(
    from: [&[f32]; N],
    to: &mut [&mut [f32]; M],
    of: impl Fn([f32; M], [f32; N]) -> [f32; M],
) {
    let end = to[0].len();
    // Equal lengths that the compiler sees, so that no index is checked.
    let (from, mut to) = (cut(from, 0, end), reborrowed(to));
    for plane in &mut to {
        *plane = &mut std::mem::take(plane)[..end];
    }
    for k in 0..end {
        let (mut own, mut values) = ([0.0; M], [0.0; N]);
        for m in 0..M {
            own[m] = to[m][k];
        }
        for n in 0..N {
            values[n] = from[n][k];
        }
        let values = of(own, values);
        for m in 0..M {
            to[m][k] = values[m];
        }
    }
}

/// Computes `N` values for every pixel, each into a plane of its own.
pub(crate) fn planes_of<const N: usize>(pixels: usize, of: impl Fn(usize) -> [f32; N] + Sync + Send) -> [Plane; N] {
    const CHUNK: usize = 1024;
    let one = |(): &mut (), number: usize, mut part: [&mut [f32]; N]| {
        for k in 0..part[0].len() {
            let values = of(number * CHUNK + k);
            part.iter_mut().zip(values).for_each(|(plane, value)| plane[k] = value);
        }
    };
    parts(pixels, CHUNK, || (), one)
}

/// Computes a value for every pixel.
pub(crate) fn per_pixel<T: Send + Clone + Default>(pixels: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut all = vec![T::default(); pixels];
    parallel::fill(&mut all, of);
    all
}

/// Lists what `of` finds in the pixels, in their order.
pub(crate) fn found<T: Send>(pixels: usize, of: impl Fn(usize) -> Option<T> + Sync) -> Vec<T> {
    let list = |part: usize| (part * CHUNK..pixels.min((part + 1) * CHUNK)).filter_map(&of).collect::<Vec<T>>();
    parallel::map(pixels.div_ceil(CHUNK), list).into_iter().flatten().collect()
}

/// The sums of values over the pixels of each row, added up from row to row.
pub(crate) fn sum_pixels<const N: usize>([width, height]: [usize; 2], of: impl Fn(usize) -> [f64; N]) -> [f64; N] {
    let add = |sum: [f64; N], value: [f64; N]| std::array::from_fn(|k| sum[k] + value[k]);
    (0..height).map(|y| (y * width..(y + 1) * width).map(&of).fold([0.0; N], add)).fold([0.0; N], add)
}

/// Images of weighted means. `add` adds the sums of a row of pixels to eight rows: red, green, blue and weight of the first half,
/// then of the second. The image `beside` counts with the weight `share`. Sums are those of colours over `albedo`, of a channel of a
/// pixel.
pub(crate) fn merged(
    [width, height]: [usize; 2],
    (beside, share): (&Pair, f32),
    albedo: impl Fn(usize, usize) -> f32 + Sync + Send,
    add: impl Fn(&mut [f32], usize) + Sync + Send,
) -> Pair {
    let row = |sums: &mut Vec<f32>, y: usize, image: [&mut [f32]; 6]| {
        // The rows of channel `k` and of its weights.
        let places = |k: usize| [k + k / 3, k / 3 * 4 + 3].map(|row| row * width);
        for (k, own) in beside.0.iter().enumerate() {
            let [values, weights] = places(k);
            let to = sums[values..][..width].iter_mut().zip(&own[y * width..]).enumerate();
            to.for_each(|(x, (to, own))| *to = share * own / albedo(k % 3, y * width + x));
            sums[weights..][..width].fill(share);
        }
        add(sums, y);
        for (k, to) in image.into_iter().enumerate() {
            let [values, weights] = places(k).map(|row| &sums[row..][..width]);
            for (x, (to, (value, weight))) in to.iter_mut().zip(values.iter().zip(weights)).enumerate() {
                // Without a weight no sample is in reach.
                let mean = if *weight > 0.0 { (value / weight).max(0.0) } else { 0.0 };
                *to = mean * albedo(k % 3, y * width + x);
            }
        }
    };
    Pair(parts(width * height, width, || vec![0.0; 8 * width], row))
}

/// Of `n` positive values in order, the one with `n / share` before it; `None` of no values.
pub(crate) fn quantile(mut values: Vec<f32>, share: usize) -> Option<f32> {
    let place = values.len() / share;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(place, f32::total_cmp).1)
}

/// The pixels to the left of pixel `i`, to its right, above and below it, as far as they exist.
pub(crate) fn beside(i: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (i % width, i / width);
    let [left, right] = [(x > 0).then(|| i - 1), (x + 1 < width).then_some(i + 1)];
    let [above, below] = [(y > 0).then(|| i - width), (y + 1 < height).then_some(i + width)];
    [left, right, above, below].into_iter().flatten()
}

/// The mean of a plane over the `(2 radius + 1)^2` pixels around each pixel. Beyond the frame, the border repeats.
pub(crate) fn box_mean(plane: &[f32], [width, height]: [usize; 2], radius: usize) -> Plane {
    // Rows around a part are summed twice, in place of a plane of sums.
    let rows = 32.max(4 * radius);
    let task = |memory: &mut (Vec<f32>, Vec<usize>), number: usize, [mean]: [&mut [f32]; 1]| {
        dispatch(BoxTask { plane, size: [width, height], radius, first: number * rows, memory, mean });
    };
    let [mean] = parts(plane.len(), rows * width, Default::default, task);
    mean
}

/// Means over windows of the rows from `first` on.
struct BoxTask<'a> {
    plane: &'a [f32],
    size: [usize; 2],
    radius: usize,
    first: usize,
    /// Sums across the rows, and the offsets of what is summed.
    memory: &'a mut (Vec<f32>, Vec<usize>),
    mean: &'a mut [f32],
}

impl WithSimd for BoxTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { plane, size: [width, height], radius, first, memory: (across, offsets), mean } = self;
        let (share, count) = (1.0 / (2 * radius + 1) as f32, 2 * radius + 1);
        let top = first.saturating_sub(radius);
        let end = (first + mean.len() / width + radius).min(height);
        // The row that is summed, with the border repeated, follows the rows of sums.
        across.resize((end - top + 1) * width + 2 * radius, 0.0);
        let (across, padded) = across.split_at_mut((end - top) * width);
        offsets.clear();
        offsets.extend(0..count);
        for (y, sums) in across.chunks_exact_mut(width).enumerate() {
            let row = &plane[(top + y) * width..][..width];
            padded[..radius].fill(row[0]);
            padded[radius..][..width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            sum_shifted(sums, share, padded, offsets);
        }
        for (y, sums) in mean.chunks_exact_mut(width).enumerate() {
            for (k, offset) in offsets.iter_mut().enumerate() {
                *offset = ((first + y + k).saturating_sub(radius).min(height - 1) - top) * width;
            }
            sum_shifted(sums, share, across, offsets);
        }
    }
}

/// Sums rows times `share`, in order. They begin at these offsets of `all`.
#[inline(always)]
fn sum_shifted(sums: &mut [f32], share: f32, all: &[f32], offsets: &[usize]) {
    // Few enough that the sums stay in registers.
    const TOGETHER: usize = 32;
    let (blocks, rest) = sums.as_chunks_mut::<TOGETHER>();
    let from = blocks.len() * TOGETHER;
    for (block, sums) in blocks.iter_mut().enumerate() {
        let mut sum = [0.0; TOGETHER];
        for offset in offsets {
            let values = &all[offset + block * TOGETHER..][..TOGETHER];
            for i in 0..TOGETHER {
                sum[i] += values[i] * share;
            }
        }
        *sums = sum;
    }
    for (i, sum) in rest.iter_mut().enumerate() {
        *sum = 0.0;
        for offset in offsets {
            *sum += all[offset + from + i] * share;
        }
    }
}
