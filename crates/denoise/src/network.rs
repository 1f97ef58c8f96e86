//! A small neural network on top of the filtered image, trained on random scenes to find pixels that belong together
//! (docs/results/learned.md).
//!
//! A U-Net of isotropic convolutions ([`convolution`]) computes 8 features per pixel for each of 6 distances. For each
//! distance, pixels that far apart are averaged with the weight `exp(-|f_p - f_q|^2)` [after Isik 2021], in the film and in the
//! filtered image ([`passes`]). The result is a blend of all these averages and of the filtered image. It does not depend on
//! the exposure. At even sizes, mirrored or transposed inputs give the mirrored or transposed result, up to rounding; at odd
//! sizes, borders differ.

mod convolution;
mod exposed_film;
mod light;
mod passes;

use crate::graph::{Graph, Plane, as_high};
use crate::planes::dispatch;
use convolution::{Layer, Maps, RowTask, Source, convolve, stride};
use dapple_core::{Film, Filtered, Frame, Needs, parallel};
use exposed_film::{ExposedFilm, INPUTS};
use passes::{Heads, blend};

/// The weights, 16 bits each (the upper half of an `f32`), one layer after another. `tools/train/export.py` writes them.
const WEIGHTS: &[u8] = include_bytes!("network/weights.bin");
/// The number of channels at full, half, quarter and eighth size.
const CHANNELS: [usize; 4] = [16, 32, 48, 64];
/// Width and height of the image are padded to multiples of this number.
const GRID: usize = 8;
/// The mean number of samples per pixel above which the filtered image gradually replaces the network's. The network is trained
/// on 1 to 16.
const MOST: f64 = 24.0;

/// Replaces the filtered `image` of a film by the network's result. The error estimate stays, as the network's own predictions
/// are less accurate. `albedo` is the film's denoised albedo, and 1 where no surface is seen.
pub(crate) fn improve(film: &Film, image: Filtered, albedo: [Vec<f32>; 3], has_features: bool) -> Filtered {
    let pixels = film.frame().pixels();
    let spp = (0..pixels).map(|i| film.count(i)).sum::<u64>() as f64 / pixels as f64;
    let Some(exposed) = ExposedFilm::new(film, &image, albedo, has_features).filter(|_| spp > 0.0) else {
        return image;
    };
    let graph = Graph::new(exposed.size);
    let row = colours(&graph, &exposed, (MOST / spp).powi(2).min(1.0) as f32);
    let mut colours = Vec::with_capacity(pixels);
    graph.run(&[row], |rows, range| range.for_each(|y| colours.extend_from_slice(rows.row(row, y).as_chunks::<3>().0)));
    light::keep(&exposed, &mut colours);
    parallel::chunks(&mut colours, image.size[0] as usize, |y, row| {
        let first = y * row.len();
        row.iter_mut().enumerate().for_each(|(x, colour)| *colour = exposed.radiance(first + x, *colour));
    });
    Filtered::new(image.size, colours).with_error(image.error)
}

/// The bytes that [`improve`] uses, including the image.
pub(crate) fn bytes(frame: &Frame) -> u64 {
    /// The bytes per pixel of the image with its error, the albedo, the mask of lights, and the result.
    const WHOLE: usize = 16 + 12 + 1 + 12;
    let rows = Frame::new(1, 1).map_or(0, |one| {
        let (film, image) = (Film::new(one, Needs::none()), Filtered::new([1, 1], vec![[0.0; 3]]));
        let exposed = ExposedFilm::unread(&film, &image, as_high(frame));
        let graph = Graph::new(exposed.size);
        let row = colours(&graph, &exposed, 1.0);
        graph.bytes(&[row])
    });
    frame.bytes(WHOLE).saturating_add(rows)
}

/// Rows of colours that blend both images; `strength` is the weight of the network's image.
fn colours<'a>(graph: &Graph<'a>, exposed: &'a ExposedFilm<'a>, strength: f32) -> Plane {
    let mut layers = Layers { rest: WEIGHTS };
    let trunk = trunk(graph, exposed, &mut layers);
    let heads = Heads::new(&mut layers);
    blend(graph, exposed, trunk, heads, strength)
}

/// The layers that remain to be read, in the order of the file.
struct Layers {
    rest: &'static [u8],
}

impl Layers {
    /// The weights of the next layer: one row per output, which ends with its bias.
    fn rows(&mut self, outputs: usize, inputs: usize) -> Vec<Vec<f32>> {
        let (bytes, rest) = self.rest.split_at(2 * outputs * (inputs + 1));
        self.rest = rest;
        let value = |b: &[u8]| f32::from_bits(u32::from(u16::from_le_bytes([b[0], b[1]])) << 16);
        bytes.chunks_exact(2 * (inputs + 1)).map(|row| row.chunks_exact(2).map(value).collect()).collect()
    }

    /// The next layer, with this many outputs and inputs.
    fn next(&mut self, outputs: usize, inputs: usize) -> Layer {
        Layer::new(&self.rows(outputs, inputs))
    }

    /// The next layer, which is a convolution.
    fn convolution(&mut self, outputs: usize, inputs: usize) -> Layer {
        self.next(outputs, 3 * inputs)
    }
}

/// The features of each pixel of the padded image: [`CHANNELS`]`[0]` channels.
fn trunk<'a>(graph: &Graph<'a>, exposed: &'a ExposedFilm<'_>, layers: &mut Layers) -> Maps {
    let [c0, ..] = CHANNELS;
    let size = exposed.padded();
    let first = layers.next(c0, INPUTS);
    let stride = stride(size[0]);
    let init = move || vec![0.0; INPUTS * stride];
    let maps = Maps::new(graph, (size, c0), Vec::new(), init, move |stack, _, y, to| {
        exposed.row(y, stack, stride);
        dispatch(RowTask { stack, stride, layer: &first, width: size[0], is_rectified: true, to });
    });
    let mut coarse = convolve(graph, [Source::Same(maps)], layers.convolution(c0, c0));
    let mut finer = Vec::new();
    for sizes in CHANNELS.windows(2) {
        let maps = convolve(graph, [Source::Half(coarse)], layers.convolution(sizes[1], sizes[0]));
        let next = convolve(graph, [Source::Same(maps)], layers.convolution(sizes[1], sizes[1]));
        finer.push(std::mem::replace(&mut coarse, next));
    }
    while let Some(fine) = finer.pop() {
        let [own, below] = [fine.channels, coarse.channels];
        let layer = layers.convolution(own, below + own);
        let maps = convolve(graph, [Source::Double(coarse), Source::Same(fine)], layer);
        coarse = convolve(graph, [Source::Same(maps)], layers.convolution(own, own));
    }
    coarse
}
