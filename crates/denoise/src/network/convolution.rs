//! Convolutions of 3x3 pixels with one weight for the centre, one for its four direct neighbours and one for the four corners.
//!
//! Mirroring or transposing the image mirrors or transposes the result exactly, because opposite pixels are added in pairs.
//! Every value is computed independently in a fixed order, so results do not depend on threads or vector width.

use crate::graph::{Graph, Plane, Reach, Rows};
use crate::planes::dispatch;
use pulp::{Simd, WithSimd};

/// The largest number of lanes of a vector.
const LANES: usize = 16;
/// The number of outputs that are computed together: enough sums to hide the latency of an addition.
const OUTPUTS: usize = 8;

/// Channels of an image. Each row of the plane holds all channels, one after the other.
#[derive(Clone, Copy)]
pub(super) struct Maps {
    pub(super) size: [usize; 2],
    pub(super) channels: usize,
    plane: Plane,
}

impl Maps {
    /// Creates channels whose rows `of` computes. Buffers from `init` are reused.
    pub(super) fn new<'a, M: Send>(
        graph: &Graph<'a>,
        (size, channels): ([usize; 2], usize),
        reads: Vec<(Plane, Reach)>,
        init: impl Fn() -> M + Sync + 'a,
        of: impl Fn(&mut M, &Rows, usize, &mut [f32]) + Sync + 'a,
    ) -> Self {
        let [width, height] = size;
        let planes = graph.tiles(([1, height], channels * width), reads, init, move |memory, rows, [_, y]| {
            let mut row = vec![0.0; channels * width];
            of(memory, rows, y, &mut row);
            row
        });
        Self { size, channels, plane: planes[0] }
    }

    /// Declares reads of this reach.
    pub(super) fn near(self, reach: Reach) -> (Plane, Reach) {
        (self.plane, reach)
    }

    /// All channels of a row.
    pub(super) fn all(self, rows: &Rows, y: usize) -> &[f32] {
        rows.row(self.plane, y)
    }

    /// The row of a channel.
    pub(super) fn row(self, rows: &Rows, y: usize, channel: usize) -> &[f32] {
        &self.all(rows, y)[channel * self.size[0]..][..self.size[0]]
    }

    /// The distance between the rows of a stack with these channels.
    pub(super) fn stride(self) -> usize {
        stride(self.size[0])
    }
}

/// The distance between rows of a stack: the width, rounded up to whole vectors.
pub(super) fn stride(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

/// The weights and biases of a layer in groups of [`OUTPUTS`] outputs. Outputs beyond the last are zero.
pub(super) struct Layer {
    outputs: usize,
    inputs: usize,
    weights: Vec<[f32; OUTPUTS]>,
    biases: Vec<[f32; OUTPUTS]>,
}

impl Layer {
    /// Creates a layer from one row per output: the weights, then the bias.
    pub(super) fn new<T: AsRef<[f32]>>(rows: &[T]) -> Self {
        let (outputs, inputs) = (rows.len(), rows.first().map_or(0, |row| row.as_ref().len() - 1));
        let value = |o: usize, k: usize| rows.get(o).map_or(0.0, |row| row.as_ref()[k]);
        let group = |g: usize, k: usize| std::array::from_fn(|j| value(OUTPUTS * g + j, k));
        let groups = outputs.div_ceil(OUTPUTS);
        let weights = (0..groups * inputs).map(|n| group(n / inputs, n % inputs)).collect();
        Self { outputs, inputs, weights, biases: (0..groups).map(|g| group(g, inputs)).collect() }
    }

    pub(super) fn outputs(&self) -> usize {
        self.outputs
    }
}

/// The task of computing one row of all outputs of a layer from rows of its inputs.
pub(super) struct RowTask<'a> {
    /// The rows of all inputs, [`Maps::stride`] apart.
    pub(super) stack: &'a [f32],
    pub(super) stride: usize,
    pub(super) layer: &'a Layer,
    pub(super) width: usize,
    /// If `true`, negative outputs are replaced by 0.
    pub(super) is_rectified: bool,
    /// The rows of all outputs.
    pub(super) to: &'a mut [f32],
}

impl WithSimd for RowTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stack, stride, layer, width, is_rectified, to } = self;
        let (stack, step) = (S::as_simd_f32s(stack).0, stride / S::F32_LANES);
        let least = simd.splat_f32s(if is_rectified { 0.0 } else { f32::NEG_INFINITY });
        for (group, biases) in layer.biases.iter().enumerate() {
            let weights = &layer.weights[group * layer.inputs..][..layer.inputs];
            let first = OUTPUTS * group;
            for block in 0..width.div_ceil(S::F32_LANES) {
                let mut sums = biases.map(|bias| simd.splat_f32s(bias));
                for (k, weights) in weights.iter().enumerate() {
                    let values = stack[k * step + block];
                    for j in 0..OUTPUTS {
                        sums[j] = simd.add_f32s(sums[j], simd.mul_f32s(simd.splat_f32s(weights[j]), values));
                    }
                }
                let x = block * S::F32_LANES;
                let count = S::F32_LANES.min(width - x);
                for (j, sum) in sums.into_iter().enumerate().take(layer.outputs - first) {
                    let mut lanes = [0.0; LANES];
                    S::as_mut_simd_f32s(&mut lanes).0[0] = simd.max_f32s(sum, least);
                    to[(first + j) * width + x..][..count].copy_from_slice(&lanes[..count]);
                }
            }
        }
    }
}

/// The channels that a convolution reads, at their size relative to the result.
#[derive(Clone, Copy)]
pub(super) enum Source {
    /// Channels at the size of the result.
    Same(Maps),
    /// Channels at twice the result's size; 2x2 pixels are averaged.
    Half(Maps),
    /// Channels at half the result's size; each pixel is used four times.
    Double(Maps),
}

impl Source {
    fn maps(self) -> Maps {
        match self {
            Source::Same(maps) | Source::Half(maps) | Source::Double(maps) => maps,
        }
    }

    fn size(self) -> [usize; 2] {
        match self {
            Source::Same(maps) => maps.size,
            Source::Half(maps) => maps.size.map(|n| n / 2),
            Source::Double(maps) => maps.size.map(|n| 2 * n),
        }
    }

    /// The rows that a row of the result and its neighbours need.
    fn reach(self) -> Reach {
        match self {
            Source::Same(_) => Reach::rows(1),
            Source::Half(_) => Reach::from_fine(2, 2),
            Source::Double(_) => Reach::from_coarse(2, 1),
        }
    }

    /// Copies row `y` of a channel, scaled to the width of the result.
    fn copy(self, rows: &Rows, y: usize, channel: usize, to: &mut [f32]) {
        match self {
            Source::Same(maps) => to.copy_from_slice(maps.row(rows, y, channel)),
            Source::Half(maps) => {
                let [above, below] = [maps.row(rows, 2 * y, channel), maps.row(rows, 2 * y + 1, channel)];
                for (to, (a, b)) in to.iter_mut().zip(above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0)) {
                    *to = 0.25 * ((a[0] + b[1]) + (a[1] + b[0]));
                }
            }
            Source::Double(maps) => {
                let own = maps.row(rows, y / 2, channel);
                to.as_chunks_mut::<2>().0.iter_mut().zip(own).for_each(|(to, own)| *to = [*own; 2]);
            }
        }
    }
}

/// Convolves the channels of all sources, and replaces negative results by 0. Beyond the image, channels are 0.
pub(super) fn convolve<const N: usize>(graph: &Graph<'_>, sources: [Source; N], layer: Layer) -> Maps {
    let size = sources[0].size();
    let [width, height] = size;
    let stride = stride(width);
    let reads = sources.iter().map(|source| source.maps().near(source.reach())).collect();
    let inputs = layer.inputs;
    // The rows above, at and below the result, with a 0 at either end, and the inputs of the layer.
    let init = move || ([0; 3].map(|_| vec![0.0; width + 2]), vec![0.0; inputs * stride]);
    Maps::new(graph, (size, layer.outputs), reads, init, move |(near, stack), rows, y, to| {
        let channels = sources.iter().flat_map(|source| (0..source.maps().channels).map(move |c| (source, c)));
        for ((source, channel), stack) in channels.zip(stack.chunks_mut(3 * stride)) {
            for (k, row) in near.iter_mut().enumerate() {
                match (y + k).checked_sub(1).filter(|y| *y < height) {
                    Some(y) => source.copy(rows, y, channel, &mut row[1..=width]),
                    None => row.fill(0.0),
                }
            }
            dispatch(SumTask { near: near.each_ref().map(|row| &row[..]), stack, stride, width });
        }
        dispatch(RowTask { stack, stride, layer: &layer, width, is_rectified: true, to });
    })
}

/// The task of computing, for each pixel of a row, its value, the sum of its direct neighbours and the sum of its corners.
struct SumTask<'a> {
    near: [&'a [f32]; 3],
    stack: &'a mut [f32],
    stride: usize,
    width: usize,
}

impl WithSimd for SumTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { near, stack, stride, width } = self;
        let [above, own, below] = near.map(|row| &row[..width + 2]);
        let (centres, rest) = stack.split_at_mut(stride);
        let (edges, corners) = rest.split_at_mut(stride);
        let (centres, edges, corners) = (&mut centres[..width], &mut edges[..width], &mut corners[..width]);
        for x in 0..width {
            centres[x] = own[x + 1];
            edges[x] = (above[x + 1] + below[x + 1]) + (own[x] + own[x + 2]);
            corners[x] = (above[x] + below[x + 2]) + (above[x + 2] + below[x]);
        }
    }
}
