//! Planes (one value per pixel), pairs of images made of planes, and passes that compute planes. Passes that read only the same
//! pixel of other planes use vector instructions.
//!
//! Vectors have 16, 8, 4 or 1 lanes. Debug builds use 8 lanes or 1 on x86-64.

pub(crate) use crate::graph::Plane;
use crate::graph::{Graph, Reach, Rows, all};
use dapple_core::parallel;
use pulp::{Simd, WithSimd};

/// The red, green and blue of each pixel, one plane each.
pub(crate) type Colours = [Plane; 3];

/// Two images, one from each half of the samples: red, green and blue of the first half, then of the second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair(pub(crate) [Plane; 6]);

impl Pair {
    /// Multiplies both halves by the [raised] `albedo` of each pixel.
    pub(crate) fn modulated(self, graph: &Graph<'_>, albedo: Colours) -> Self {
        let channel = |k: usize| map_to_one(graph, [self.0[k], albedo[k % 3]], |[v, albedo]| v * raised(albedo));
        Self(std::array::from_fn(channel))
    }
}

/// One channel of the mean of both halves `a` and `b`, weighted by their sample counts `na` and `nb`.
#[inline(always)]
pub(crate) fn combined([a, b]: [f32; 2], [na, nb]: [f32; 2]) -> f32 {
    b + first_share([na, nb]) * (a - b)
}

/// The fraction of a pixel's samples that lie in the first half; 0.5 if the pixel has no samples.
#[inline(always)]
pub(crate) fn first_share([a, b]: [f32; 2]) -> f32 {
    if a + b > 0.0 { a / (a + b) } else { 0.5 }
}

/// The smallest albedo by which colours are divided.
const LEAST_ALBEDO: f32 = 0.02;

/// An albedo by which a colour can be divided: at least [`LEAST_ALBEDO`].
#[inline(always)]
pub(crate) fn raised(albedo: f32) -> f32 {
    albedo.max(LEAST_ALBEDO)
}

/// The number of lanes that [`dispatch`] uses in tests of release builds; 0 for the machine's own number. Tests that run at the
/// same time are not affected, since results do not depend on the number of lanes.
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

/// Computes `M` values of every pixel from its values in `N` planes.
pub(crate) fn map<'a, const N: usize, const M: usize>(
    graph: &Graph<'a>,
    planes: [Plane; N],
    of: impl Fn([f32; N]) -> [f32; M] + Sync + 'a,
) -> [Plane; M] {
    graph.rows(all(planes, Reach::rows(0)), move |rows, y, mut to: [&mut [f32]; M]| {
        // Equal lengths that the compiler sees, so that no index is checked.
        let end = to[0].len();
        let from = planes.map(|plane| &rows.row(plane, y)[..end]);
        for plane in &mut to {
            *plane = &mut std::mem::take(plane)[..end];
        }
        for k in 0..end {
            let mut values = [0.0; N];
            for n in 0..N {
                values[n] = from[n][k];
            }
            let values = of(values);
            for m in 0..M {
                to[m][k] = values[m];
            }
        }
    })
}

/// Computes a value of every pixel from its values in `N` planes.
pub(crate) fn map_to_one<'a, const N: usize>(
    graph: &Graph<'a>,
    planes: [Plane; N],
    of: impl Fn([f32; N]) -> f32 + Sync + 'a,
) -> Plane {
    let [plane] = map(graph, planes, move |values| [of(values)]);
    plane
}

/// Computes `N` values for every pixel, one plane for each value.
pub(crate) fn planes_of<'a, const N: usize>(
    graph: &Graph<'a>,
    of: impl Fn(usize) -> [f32; N] + Sync + 'a,
) -> [Plane; N] {
    graph.rows(Vec::new(), move |_, y, mut to: [&mut [f32]; N]| {
        let width = to[0].len();
        for x in 0..width {
            to.iter_mut().zip(of(y * width + x)).for_each(|(plane, value)| plane[x] = value);
        }
    })
}

/// Computes a value for every pixel.
pub(crate) fn per_pixel<T: Send + Clone + Default>(pixels: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut all = vec![T::default(); pixels];
    parallel::fill(&mut all, of);
    all
}

/// Lists the values that `of` returns for the pixels, in order, without `None`.
pub(crate) fn found<T: Send>(pixels: usize, of: impl Fn(usize) -> Option<T> + Sync) -> Vec<T> {
    const CHUNK: usize = 4096;
    let list = |part: usize| (part * CHUNK..pixels.min((part + 1) * CHUNK)).filter_map(&of).collect::<Vec<T>>();
    parallel::map(pixels.div_ceil(CHUNK), list).into_iter().flatten().collect()
}

/// The sums of values over all pixels, added row by row.
pub(crate) fn sum_pixels<const N: usize>([width, height]: [usize; 2], of: impl Fn(usize) -> [f64; N]) -> [f64; N] {
    let add = |sum: [f64; N], value: [f64; N]| std::array::from_fn(|k| sum[k] + value[k]);
    (0..height).map(|y| (y * width..(y + 1) * width).map(&of).fold([0.0; N], add)).fold([0.0; N], add)
}

/// Images of weighted means. `add` adds the sums of row `y` to eight rows: red, green, blue and weight of the first half, then
/// of the second; `reads` lists the planes it reads. The image `beside` is included with the weight `share`. With `albedo`, the
/// summed colours are colours divided by the [raised] albedo.
pub(crate) fn merged<'a>(
    graph: &Graph<'a>,
    (beside, share): (Pair, f32),
    albedo: Option<Colours>,
    mut reads: Vec<(Plane, Reach)>,
    add: impl Fn(&Rows, &mut [f32], usize) + Sync + 'a,
) -> Pair {
    reads.extend(all(beside.0.into_iter().chain(albedo.into_iter().flatten()), Reach::rows(0)));
    Pair(graph.rows(reads, move |rows, y, image: [&mut [f32]; 6]| {
        let width = image[0].len();
        let albedo = albedo.map(|planes| planes.map(|plane| rows.row(plane, y)));
        let divisor = |c: usize, x: usize| albedo.map_or(1.0, |rows| raised(rows[c][x]));
        let mut sums = vec![0.0; 8 * width];
        // The rows of channel `k` and of its weights.
        let places = |k: usize| [k + k / 3, k / 3 * 4 + 3].map(|row| row * width);
        for (k, own) in beside.0.into_iter().enumerate() {
            let [values, weights] = places(k);
            let to = sums[values..][..width].iter_mut().zip(rows.row(own, y)).enumerate();
            to.for_each(|(x, (to, own))| *to = share * own / divisor(k % 3, x));
            sums[weights..][..width].fill(share);
        }
        add(rows, &mut sums, y);
        for (k, to) in image.into_iter().enumerate() {
            let [values, weights] = places(k).map(|row| &sums[row..][..width]);
            for (x, (to, (value, weight))) in to.iter_mut().zip(values.iter().zip(weights)).enumerate() {
                // Without a weight no sample is in reach.
                let mean = if *weight > 0.0 { (value / weight).max(0.0) } else { 0.0 };
                *to = mean * divisor(k % 3, x);
            }
        }
    }))
}

/// The quantile of `n` positive values that exceeds `n / share` of them; `None` without values.
pub(crate) fn quantile(mut values: Vec<f32>, share: usize) -> Option<f32> {
    let place = values.len() / share;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(place, f32::total_cmp).1)
}

/// The existing neighbours of pixel `i`: left, right, above and below.
pub(crate) fn beside(i: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (i % width, i / width);
    let [left, right] = [(x > 0).then(|| i - 1), (x + 1 < width).then_some(i + 1)];
    let [above, below] = [(y > 0).then(|| i - width), (y + 1 < height).then_some(i + width)];
    [left, right, above, below].into_iter().flatten()
}

/// The mean of a plane over the `(2 radius + 1)^2` pixels around each pixel. Beyond the frame, the border repeats.
pub(crate) fn box_mean(graph: &Graph<'_>, plane: Plane, radius: usize) -> Plane {
    let [_, height] = graph.size;
    let [across] = graph.rows(all([plane], Reach::rows(0)), move |rows, y, [sums]: [&mut [f32]; 1]| {
        let row = rows.row(plane, y);
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.resize(row.len() + 2 * radius, row[row.len() - 1]);
        dispatch(SumTask { rows: (0..=2 * radius).map(|k| &padded[k..]).collect(), sums });
    });
    let [mean] = graph.rows(all([across], Reach::rows(radius)), move |rows, y, [sums]: [&mut [f32]; 1]| {
        let near = (y..=y + 2 * radius).map(|y| rows.row(across, y.saturating_sub(radius).min(height - 1)));
        dispatch(SumTask { rows: near.collect(), sums });
    });
    mean
}

/// [`box_mean`] of a plane in memory.
pub(crate) fn box_mean_of(plane: &[f32], size: [usize; 2], radius: usize) -> Vec<f32> {
    let graph = Graph::new(size);
    let [own] = planes_of(&graph, |i| [plane[i]]);
    let mean = box_mean(&graph, own, radius);
    let [mean] = graph.collect([mean]);
    mean
}

/// The task of averaging rows, added in their order.
struct SumTask<'a> {
    rows: Vec<&'a [f32]>,
    sums: &'a mut [f32],
}

impl WithSimd for SumTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // Few enough that the sums stay in registers.
        const TOGETHER: usize = 32;
        let Self { rows, sums } = self;
        let share = 1.0 / rows.len() as f32;
        let (blocks, rest) = sums.as_chunks_mut::<TOGETHER>();
        let from = blocks.len() * TOGETHER;
        for (block, sums) in blocks.iter_mut().enumerate() {
            let mut sum = [0.0; TOGETHER];
            for row in &rows {
                let values = &row[block * TOGETHER..][..TOGETHER];
                for i in 0..TOGETHER {
                    sum[i] += values[i] * share;
                }
            }
            *sums = sum;
        }
        for (i, sum) in rest.iter_mut().enumerate() {
            *sum = 0.0;
            for row in &rows {
                *sum += row[from + i] * share;
            }
        }
    }
}
