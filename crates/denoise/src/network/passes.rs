//! Averages of pixels at distances 1 to 32, weighted by learned features, and the blend of all averages.

use super::convolution::{Layer, Maps, RowTask};
use super::exposed_film::{ExposedFilm, PixelColours};
use super::{CHANNELS, Layers};
use crate::graph::{Graph, Plane, Reach, Rows};
use crate::planes::dispatch;
use crate::tile::exp_minus;
use pulp::{Simd, WithSimd};

/// The distances between averaged pixels, in the order of the passes [after Isik 2021]. The last pass joins neighbours: if the
/// largest distance came last, walls would show a grid.
const DISTANCES: [usize; 6] = [2, 8, 32, 16, 4, 1];
/// The number of features that a pass compares.
const FEATURES: usize = 8;
/// The values that passes average: the film's colours divided by albedo (3), the film's colours (3), the image divided by
/// albedo (3).
const VALUES: usize = 9;
/// A pixel's state between passes: the values, the blended averages of the film and their weight, the blended averages of the
/// image and their weight.
const STATE: usize = VALUES + 8;
/// The values of a pixel that a pass reads: averaged values times their trust and both trusts, features, the weight of the
/// pixel itself, and three blend weights.
const READ: usize = SUMS + FEATURES + 4;
/// The averaged values times their trust (one for the film, one for the image), and both trusts.
const SUMS: usize = VALUES + 2;

/// The layers that turn a pixel's features into the inputs of the passes.
pub(super) struct Heads {
    /// The blend weights of the unaveraged values and of the image.
    first: Layer,
    passes: [Layer; 6],
    /// The weight of the image's averages in the result.
    last: Layer,
}

impl Heads {
    pub(super) fn new(layers: &mut Layers) -> Self {
        let inputs = CHANNELS[0];
        let (n, own) = (DISTANCES.len(), FEATURES + 3);
        let outputs = n * own + 3 * (n + 1) + 2;
        let rows = layers.rows(outputs, inputs);
        let layer = |numbers: &[usize]| Layer::new(&numbers.iter().map(|k| &rows[*k]).collect::<Vec<_>>());
        // The blend weights: alternately of the film's averages divided by albedo and undivided, then of the image's averages.
        let (film, image) = (n * own, n * own + 2 * (n + 1));
        let passes = std::array::from_fn(|pass| {
            let level = pass + 1;
            let blend = [film + 2 * level, film + 2 * level + 1, image + level];
            layer(&(pass * own..(pass + 1) * own).chain(blend).collect::<Vec<_>>())
        });
        let first = layer(&[film, film + 1, image, image + n + 1]);
        Self { first, passes, last: layer(&[image + n + 2]) }
    }
}

/// `e^x` for `x` in -60 .. 20, by [`exp_minus`].
#[inline(always)]
fn exp(x: f32) -> f32 {
    const E20: f32 = 485_165_200.0;
    exp_minus(20.0 - x) * E20
}

/// The blend weight of a value, given its logarithm.
#[inline(always)]
fn share(x: f32) -> f32 {
    exp(x.clamp(-20.0, 20.0))
}

/// Rows of colours: the network's image with the weight `strength`, plus the filtered image with the remaining weight.
pub(super) fn blend<'a>(
    graph: &Graph<'a>,
    exposed: &'a ExposedFilm<'_>,
    trunk: Maps,
    heads: Heads,
    strength: f32,
) -> Plane {
    let features = Features { exposed, trunk };
    let mut state = features.first(graph, heads.first);
    for (layer, distance) in heads.passes.into_iter().zip(DISTANCES) {
        let read = features.read(graph, layer, state);
        state = pass(graph, read, state, &exposed.albedo, distance);
    }
    let last = heads.last;
    let reads = vec![state.near(Reach::rows(0)), features.near()];
    let all = Maps::new(
        graph,
        (exposed.size, 3),
        reads,
        || (),
        move |(), rows, y, to| {
            let outputs = features.outputs(rows, &last, y);
            let at = |channel: usize, x: usize| state.row(rows, y, VALUES + channel)[x];
            for (x, to) in to.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let i = y * exposed.size[0] + x;
                let PixelColours { image, .. } = exposed.colours(i);
                let strength = strength * exposed.share(i);
                let share = 0.02 + 0.96 / (1.0 + exp((-outputs[x]).clamp(-20.0, 20.0)));
                *to = [0, 1, 2].map(|c| {
                    let network = share * at(4 + c, x) / at(7, x) + (1.0 - share) * at(c, x) / at(3, x);
                    image[c] + strength * (network - image[c])
                });
            }
        },
    );
    let (plane, _) = all.near(Reach::rows(0));
    plane
}

/// The features of each pixel of the image.
#[derive(Clone, Copy)]
struct Features<'a> {
    exposed: &'a ExposedFilm<'a>,
    trunk: Maps,
}

impl<'a> Features<'a> {
    /// Declares reads of the row of features that belongs to a row of the image.
    fn near(&self) -> (Plane, Reach) {
        self.trunk.near(Reach::rows(self.exposed.padding()[1]))
    }

    /// The outputs of a layer for row `y` of the image, one row per output.
    fn outputs(&self, rows: &Rows, layer: &Layer, y: usize) -> Vec<f32> {
        let ([width, _], [left, top]) = (self.exposed.size, self.exposed.padding());
        let (trunk, stride) = (self.trunk, self.trunk.stride());
        let mut stack = vec![0.0; trunk.channels * stride];
        for channel in 0..trunk.channels {
            stack[channel * stride..][..width].copy_from_slice(&trunk.row(rows, y + top, channel)[left..][..width]);
        }
        let mut to = vec![0.0; layer.outputs() * width];
        dispatch(RowTask { stack: &stack, stride, layer, width, is_rectified: false, to: &mut to });
        to
    }

    /// The state before the first pass.
    fn first(self, graph: &Graph<'a>, layer: Layer) -> Maps {
        let width = self.exposed.size[0];
        let of = move |(): &mut (), rows: &Rows, y: usize, to: &mut [f32]| {
            let outputs = self.outputs(rows, &layer, y);
            for x in 0..width {
                let PixelColours { film, albedo, image } = self.exposed.colours(y * width + x);
                let [divided, plain, averaged, whole] = [0, 1, 2, 3].map(|k| share(outputs[k * width + x]));
                for c in 0..3 {
                    let values = [film[c] / albedo[c], film[c], image[c] / albedo[c]];
                    values.into_iter().enumerate().for_each(|(k, value)| to[(3 * k + c) * width + x] = value);
                    to[(VALUES + c) * width + x] = (divided + plain) * film[c];
                    to[(VALUES + 4 + c) * width + x] = (averaged + whole) * image[c];
                }
                to[(VALUES + 3) * width + x] = divided + plain;
                to[(VALUES + 7) * width + x] = averaged + whole;
            }
        };
        Maps::new(graph, (self.exposed.size, STATE), vec![self.near()], || (), of)
    }

    /// The values that a pass reads, computed from the state before the pass.
    fn read(self, graph: &Graph<'a>, layer: Layer, state: Maps) -> Maps {
        let width = self.exposed.size[0];
        let reads = vec![self.near(), state.near(Reach::rows(0))];
        Maps::new(
            graph,
            (self.exposed.size, READ),
            reads,
            || (),
            move |(), rows, y, to| {
                let outputs = self.outputs(rows, &layer, y);
                dispatch(ReadTask { outputs: &outputs, state: &state.all(rows, y)[..VALUES * width], width, to });
            },
        )
    }
}

struct ReadTask<'a> {
    outputs: &'a [f32],
    state: &'a [f32],
    width: usize,
    to: &'a mut [f32],
}

impl WithSimd for ReadTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { outputs, state, width, to } = self;
        let (sums, rest) = to.split_at_mut(SUMS * width);
        let (features, weights) = rest.split_at_mut(FEATURES * width);
        features.copy_from_slice(&outputs[..FEATURES * width]);
        let output = |k: usize| &outputs[(FEATURES + k) * width..][..width];
        let (values, trusts) = sums.split_at_mut(VALUES * width);
        for (k, trusts) in trusts.chunks_exact_mut(width).enumerate() {
            let log = output(k);
            (0..width).for_each(|x| trusts[x] = exp(log[x].clamp(-8.0, 6.0)));
        }
        for (k, values) in values.chunks_exact_mut(width).enumerate() {
            let (own, trust) = (&state[k * width..][..width], &trusts[k / 6 * width..][..width]);
            (0..width).for_each(|x| values[x] = own[x] * trust[x]);
        }
        for (k, weights) in weights.chunks_exact_mut(width).enumerate() {
            let (log, most) = (output(2 + k), if k == 0 { 6.0 } else { 20.0 });
            (0..width).for_each(|x| weights[x] = exp(log[x].clamp(-most, most)));
        }
    }
}

/// Computes the state after a pass over pixels at this distance.
fn pass<'a>(graph: &Graph<'a>, read: Maps, before: Maps, albedo: &'a [Vec<f32>; 3], distance: usize) -> Maps {
    let [width, height] = read.size;
    let reads = vec![read.near(Reach::rows(distance)), before.near(Reach::rows(0))];
    Maps::new(
        graph,
        (read.size, STATE),
        reads,
        || (),
        move |(), made, y, to| {
            let mut sums = vec![0.0; SUMS * width];
            let mut pair = vec![0.0; SUMS * width];
            let mut likeness = vec![0.0; width];
            let row = |y: usize| read.all(made, y);
            let own = row(y);
            let weight = &own[(SUMS + FEATURES) * width..];
            for (k, sums) in sums.chunks_exact_mut(width).enumerate() {
                (0..width).for_each(|x| sums[x] = weight[x] * own[k * width + x]);
            }
            let rows =
                [y.checked_sub(distance), Some(y), Some(y + distance).filter(|y| *y < height)].map(|y| y.map(row));
            // Opposite pixels are added first, so that mirrored or transposed images give identical bits.
            for pairs in [[[(0, 0), (2, 0)], [(1, -1), (1, 1)]], [[(0, -1), (2, 1)], [(0, 1), (2, -1)]]] {
                let mut both = vec![0.0; SUMS * width];
                for two in pairs {
                    pair.fill(0.0);
                    for (row, side) in two {
                        if let Some(there) = rows[row] {
                            let task = GatherTask {
                                own,
                                there,
                                side,
                                distance,
                                width,
                                likeness: &mut likeness,
                                sums: &mut pair,
                            };
                            dispatch(task);
                        }
                    }
                    both.iter_mut().zip(&pair).for_each(|(sum, value)| *sum += value);
                }
                sums.iter_mut().zip(&both).for_each(|(sum, value)| *sum += value);
            }
            let before = before.all(made, y);
            let albedo = albedo.each_ref().map(|plane| &plane[y * width..][..width]);
            dispatch(FinishTask { sums: &sums, weights: &weight[width..], before, albedo, width, to });
        },
    )
}

/// The task of adding the pixels at one offset to the sums of a row.
struct GatherTask<'a> {
    own: &'a [f32],
    there: &'a [f32],
    side: isize,
    distance: usize,
    width: usize,
    likeness: &'a mut [f32],
    sums: &'a mut [f32],
}

impl WithSimd for GatherTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { own, there, side, distance, width, likeness, sums } = self;
        let shift = if side == 0 { 0 } else { distance.min(width) };
        let count = width - shift;
        // The first column in this row, and in the other row.
        let (from, other) = if side < 0 { (shift, 0) } else { (0, shift) };
        let likeness = &mut likeness[..count];
        likeness.fill(0.0);
        for k in SUMS..SUMS + FEATURES {
            let (a, b) = (&own[k * width + from..][..count], &there[k * width + other..][..count]);
            for x in 0..count {
                let apart = a[x] - b[x];
                likeness[x] += apart * apart;
            }
        }
        likeness.iter_mut().for_each(|value| *value = exp_minus(*value));
        for k in 0..SUMS {
            let (sum, value) = (&mut sums[k * width + from..][..count], &there[k * width + other..][..count]);
            for x in 0..count {
                sum[x] += likeness[x] * value[x];
            }
        }
    }
}

/// The task of computing the state after a pass from the sums of a row. `weights` are the blend weights.
struct FinishTask<'a> {
    sums: &'a [f32],
    weights: &'a [f32],
    before: &'a [f32],
    albedo: [&'a [f32]; 3],
    width: usize,
    to: &'a mut [f32],
}

impl WithSimd for FinishTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { sums, weights, before, albedo, width, to } = self;
        let (values, blends) = to.split_at_mut(VALUES * width);
        for (k, values) in values.chunks_exact_mut(width).enumerate() {
            let (sum, total) = (&sums[k * width..][..width], &sums[(VALUES + k / 6) * width..][..width]);
            (0..width).for_each(|x| values[x] = sum[x] / total[x]);
        }
        let value = |k: usize| &values[k * width..][..width];
        let [divided, plain, averaged] = [0, 1, 2].map(|k| &weights[k * width..][..width]);
        for (k, blend) in blends.chunks_exact_mut(width).enumerate() {
            let before = &before[(VALUES + k) * width..][..width];
            let albedo = albedo[(k % 4).min(2)];
            let (of_film, film, image) = (value(k % 4 % 3), value(3 + k % 4 % 3), value(6 + k % 4 % 3));
            for x in 0..width {
                let more = match k {
                    0..3 => divided[x] * of_film[x] * albedo[x] + plain[x] * film[x],
                    3 => divided[x] + plain[x],
                    4..7 => averaged[x] * image[x] * albedo[x],
                    _ => averaged[x],
                };
                blend[x] = before[x] + more;
            }
        }
    }
}
