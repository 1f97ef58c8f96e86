//! A small network on top of the filtered image: it learned from random scenes which pixels belong together (docs/results/learned.md).
//!
//! A U-Net of isotropic convolutions ([`convolution`]) gives each pixel 8 features for each of 6 distances. Pixels at that distance are
//! averaged with the weight `exp(-|f_p - f_q|^2)` [after Isik 2021], in the film and in the filtered image ([`passes`]).
//! The result is a blend of all of these averages and of the filtered image itself. Any exposure gets the same treatment. At even sizes
//! a mirrored or transposed film and image give the mirrored or transposed result, up to rounding; at odd ones, borders differ.

mod convolution;
mod exposed_film;
mod light;
mod passes;

use crate::planes::{Colours, dispatch, per_pixel};
use convolution::{Layer, Maps, RowTask, Source, convolve};
use dapple_core::{Film, Filtered, parallel};
use exposed_film::{ExposedFilm, INPUTS};
use passes::{Heads, blend};

/// The weights, 16 bits each: the upper half of an `f32`. `tools/train/export.py` writes them, a layer after the other.
const WEIGHTS: &[u8] = include_bytes!("network/weights.bin");
/// The number of channels at full, half, quarter and eighth size.
const CHANNELS: [usize; 4] = [16, 32, 48, 64];
/// The image is padded to multiples of this size.
const GRID: usize = 8;
/// The mean number of samples per pixel from which on the filtered image replaces the network's. The network has learned from 1 to 16.
const MOST: f64 = 24.0;

/// The memory of [`improve`] per pixel in bytes: the features, two states of all passes, the values that a pass reads, albedo, emission,
/// and the result twice.
pub(crate) const BYTES_PER_PIXEL: usize = 4 * (CHANNELS[0] + 2 * passes::STATE + passes::READ + 11);

/// Replaces the filtered image of a film by the network's. Its error stays: the network's own predictions were further off.
/// `albedo` is the film's without its noise, and 1 where no surface is seen.
pub(crate) fn improve(film: &Film, image: Filtered, albedo: Colours, has_features: bool) -> Filtered {
    let pixels = film.frame().pixels();
    let spp = (0..pixels).map(|i| film.count(i)).sum::<u64>() as f64 / pixels as f64;
    let Some(exposed) = ExposedFilm::new(film, &image, albedo, has_features).filter(|_| spp > 0.0) else {
        return image;
    };
    let mut layers = Layers { rest: WEIGHTS };
    let trunk = trunk(&exposed, &mut layers);
    let heads = Heads::new(&mut layers);
    let mut colours = blend(&exposed, &trunk, &heads, (MOST / spp).powi(2).min(1.0) as f32);
    light::keep(&exposed, &mut colours);
    let radiance = per_pixel(pixels, |i| exposed.radiance(i, colours[i]));
    Filtered::new(image.size, radiance).with_error(image.error)
}

/// Layers in the order of the file.
struct Layers {
    rest: &'static [u8],
}

impl Layers {
    /// The weights of the next layer's outputs, each followed by its bias.
    fn rows(&mut self, outputs: usize, inputs: usize) -> Vec<Vec<f32>> {
        let (bytes, rest) = self.rest.split_at(2 * outputs * (inputs + 1));
        self.rest = rest;
        let value = |b: &[u8]| f32::from_bits(u32::from(u16::from_le_bytes([b[0], b[1]])) << 16);
        bytes.chunks_exact(2 * (inputs + 1)).map(|row| row.chunks_exact(2).map(value).collect()).collect()
    }

    /// The next layer, with so many outputs and inputs.
    fn next(&mut self, outputs: usize, inputs: usize) -> Layer {
        Layer::new(&self.rows(outputs, inputs))
    }

    /// The next layer of a convolution.
    fn convolution(&mut self, outputs: usize, inputs: usize) -> Layer {
        self.next(outputs, 3 * inputs)
    }
}

/// The features of each pixel of the padded image: [`CHANNELS`]`[0]` channels.
fn trunk(exposed: &ExposedFilm<'_>, layers: &mut Layers) -> Maps {
    let [c0, ..] = CHANNELS;
    let size = exposed.padded();
    let first = layers.next(c0, INPUTS);
    let mut maps = Maps::new(size, c0);
    let stride = maps.stride();
    parallel::chunks(&mut maps.values, c0 * size[0], |y, to| {
        let mut stack = vec![0.0; INPUTS * stride];
        exposed.row(y, &mut stack, stride);
        dispatch(RowTask { stack: &stack, stride, layer: &first, width: size[0], is_rectified: true, to });
    });
    let mut coarse = convolve(&[Source::Same(&maps)], &layers.convolution(c0, c0));
    drop(maps);
    let mut finer = Vec::new();
    for sizes in CHANNELS.windows(2) {
        let maps = convolve(&[Source::Half(&coarse)], &layers.convolution(sizes[1], sizes[0]));
        let next = convolve(&[Source::Same(&maps)], &layers.convolution(sizes[1], sizes[1]));
        finer.push(std::mem::replace(&mut coarse, next));
    }
    while let Some(fine) = finer.pop() {
        let [own, below] = [fine.channels, coarse.channels];
        let layer = layers.convolution(own, below + own);
        let maps = convolve(&[Source::Double(&coarse), Source::Same(&fine)], &layer);
        coarse = convolve(&[Source::Same(&maps)], &layers.convolution(own, own));
    }
    coarse
}
