//! The inputs of the network: a film and its filtered image, scaled by an exposure.

use super::GRID;
use crate::features::ln;
use crate::light::Light;
use crate::planes::{per_pixel, quantile, raised, sum_pixels};
use crate::tile::exp_minus;
use dapple_core::film::{Features, luminance};
use dapple_core::{Film, Filtered};

/// The number of input values per pixel.
pub(super) const INPUTS: usize = 24;
/// The largest radiance that the network gets, in units of the exposure.
const BRIGHTEST: f32 = 1e4;
/// The lower limit in pixels that see a light source directly, whose edges the network would smooth.
const LAMP: f32 = 16.0;

/// A film, its filtered image, and the scales of the network's inputs.
pub(super) struct ExposedFilm<'a> {
    film: &'a Film,
    image: &'a Filtered,
    /// The albedo, raised so that colours can be divided by it.
    pub(super) albedo: [Vec<f32>; 3],
    has_features: bool,
    pub(super) size: [usize; 2],
    /// The factor on radiance that brings the geometric mean of the filtered image to 0.18.
    exposure: f32,
    /// The median logarithm of depth.
    middle: f32,
    /// The pixels whose samples saw a light directly.
    is_lamp: Vec<bool>,
}

/// The colours of a pixel that the network averages, in units of the exposure.
pub(super) struct PixelColours {
    /// The film's mean; `albedo` is the divisor for it, and `image` the filtered colour.
    pub(super) film: [f32; 3],
    pub(super) albedo: [f32; 3],
    pub(super) image: [f32; 3],
}

impl<'a> ExposedFilm<'a> {
    /// Creates the inputs; `None` if the image is black, or too dark or bright to be scaled.
    pub(super) fn new(film: &'a Film, image: &'a Filtered, albedo: [Vec<f32>; 3], has_features: bool) -> Option<Self> {
        let size = film.frame().size().map(|n| n as usize);
        let pixels = film.frame().pixels();
        let bright = |i: usize| luminance(image.radiance[i].map(f64::from)).max(0.0);
        let [sum] = sum_pixels(size, |i| [bright(i)]);
        let mean = sum / pixels as f64;
        if !(1e-18..1e18).contains(&mean) {
            return None;
        }
        let [sum] = sum_pixels(size, |i| [f64::from(ln(bright(i).clamp(1e-3 * mean, 50.0 * mean) as f32))]);
        let log = (sum / pixels as f64) as f32;
        let exposure = 0.18 * if log > 0.0 { exp_minus(log) } else { 1.0 / exp_minus(-log) };
        let depths = per_pixel(pixels, |i| surface(film, has_features, i).map_or(0.0, |f| f.depth));
        let depth = quantile(depths.into_iter().filter(|depth| *depth > 0.0).collect(), 2);
        let middle = ln(depth.unwrap_or(1.0).clamp(1e-18, 1e18));
        let is_lamp = per_pixel(pixels, |i| emission(film, i) > 0.0);
        let albedo = albedo.map(|mut plane| {
            plane.iter_mut().for_each(|albedo| *albedo = raised(*albedo));
            plane
        });
        Some(Self { albedo, has_features, exposure, middle, is_lamp, ..Self::unread(film, image, size) })
    }

    /// A film and its image before their pixels are read, for planning memory.
    pub(super) fn unread(film: &'a Film, image: &'a Filtered, size: [usize; 2]) -> Self {
        let (albedo, is_lamp) = (<[Vec<f32>; 3]>::default(), Vec::new());
        Self { film, image, albedo, has_features: false, size, exposure: 1.0, middle: 0.0, is_lamp }
    }

    /// The size of the image, padded to multiples of [`GRID`].
    pub(super) fn padded(&self) -> [usize; 2] {
        self.size.map(|n| n.next_multiple_of(GRID))
    }

    /// The number of padding columns to the left of the image, and of padding rows above it.
    pub(super) fn padding(&self) -> [usize; 2] {
        [0, 1].map(|k| (self.padded()[k] - self.size[k]) / 2)
    }

    /// The weight of the network's result at pixel `i`: the fraction of its light that is not emission seen directly.
    pub(super) fn share(&self, i: usize) -> f32 {
        let rest = || 1.0 - emission(self.film, i) / luminance(self.image.radiance[i].map(f64::from));
        if self.is_lamp[i] { rest().clamp(0.0, 1.0) as f32 } else { 1.0 }
    }

    /// The radiance of pixel `i` that is withheld from the network: all above [`BRIGHTEST`], or above [`LAMP`] where a light is
    /// seen.
    fn withheld(&self, i: usize) -> [f32; 3] {
        let most = if self.is_lamp[i] { LAMP } else { BRIGHTEST } / self.exposure;
        self.image.radiance[i].map(|image| (image - most).max(0.0))
    }

    /// The colours of pixel `i`. If it has no samples, the image replaces the film's mean.
    pub(super) fn colours(&self, i: usize) -> PixelColours {
        let (mean, withheld) = (Light::all(self.film).mean(i), self.withheld(i));
        let image = [0, 1, 2].map(|c| ((self.image.radiance[i][c] - withheld[c]) * self.exposure).max(0.0));
        let film = [0, 1, 2].map(|c| ((mean[c] as f32 - withheld[c]) * self.exposure).clamp(0.0, BRIGHTEST));
        let albedo = self.albedo.each_ref().map(|plane| plane[i]);
        PixelColours { film: if self.film.count(i) > 0 { film } else { image }, albedo, image }
    }

    /// The features of pixel `i`, if it hit a surface.
    fn surface(&self, i: usize) -> Option<Features> {
        surface(self.film, self.has_features, i)
    }

    /// The luminance of the samples of pixel `i` without the withheld light, in units of the exposure; `None` without samples.
    pub(super) fn light(&self, i: usize) -> Option<f64> {
        let (mean, withheld) = (Light::all(self.film).mean(i), self.withheld(i));
        let own = [0, 1, 2].map(|c| (mean[c] - f64::from(withheld[c])) * f64::from(self.exposure));
        (self.film.count(i) > 0).then(|| luminance(own))
    }

    /// The radiance of pixel `i` for a `colour` that the network returns.
    pub(super) fn radiance(&self, i: usize, colour: [f32; 3]) -> [f32; 3] {
        let withheld = self.withheld(i);
        [0, 1, 2].map(|c| (colour[c] / self.exposure + withheld[c]).clamp(0.0, f32::MAX))
    }

    /// Writes the inputs for row `y` of the padded image. The rows of successive inputs start `stride` values apart.
    pub(super) fn row(&self, y: usize, to: &mut [f32], stride: usize) {
        let ([width, height], [left, top]) = (self.size, self.padding());
        let y = y.saturating_sub(top).min(height - 1);
        for x in 0..self.padded()[0] {
            let values = self.values(y * width + x.saturating_sub(left).min(width - 1));
            values.into_iter().enumerate().for_each(|(k, value)| to[k * stride + x] = value);
        }
    }

    /// The inputs of the first layer for pixel `i`.
    fn values(&self, i: usize) -> [f32; INPUTS] {
        let PixelColours { film, albedo, image } = self.colours(i);
        let surface = self.surface(i);
        let count = self.film.count(i).max(1) as f32;
        let grey = |colour: [f32; 3]| luminance(colour.map(f64::from)) as f32;
        let log = |x: f32| 0.5 * ln(1.0 + 8.0 * x);
        let [film_grey, image_grey] = [grey(film), grey(image)];
        let variance = self.film.moments(i).variance();
        let noise = variance.map(|v| (luminance(v) as f32 / count).max(0.0).sqrt() * self.exposure);
        let noise = noise.map(|noise| noise.min(BRIGHTEST));
        let error = self.image.error.as_ref().map_or(0.0, |error| error[i].max(0.0).sqrt() * self.exposure);
        let share = |x: f32| 0.4 * ln(x.min(1e9) / (image_grey + 0.02) + 1e-2);
        let apart = (film_grey - image_grey) / (image_grey + 0.02);
        let [lr, lg, lb] = [0, 1, 2].map(|c| log((film[c] / albedo[c]).min(BRIGHTEST)));
        let [dr, dg, db] = [0, 1, 2].map(|c| log(image[c] / albedo[c]));
        let [ir, ig, ib] = image.map(log);
        let [ar, ag, ab] = surface.map_or([0.0; 3], |f| f.albedo.map(bounded));
        let [nx, ny, nz] = surface.map_or([0.0; 3], |f| f.normal.map(bounded));
        let depth = surface.filter(|f| f.depth > 0.0);
        let depth = depth.map_or(3.0, |f| (ln(f.depth.clamp(1e-18, 1e18)) - self.middle).clamp(-3.0, 3.0));
        let coverage = surface.map_or(0.0, |f| f.hits as f32 / f.samples.max(1) as f32);
        [
            lr,
            lg,
            lb,
            dr,
            dg,
            db,
            ir,
            ig,
            ib,
            ar,
            ag,
            ab,
            nx,
            ny,
            nz,
            log(film_grey),
            apart / (1.0 + apart.abs()),
            noise.map_or(0.0, share),
            f32::from(u8::from(noise.is_some())),
            0.25 * std::f32::consts::LOG2_E * ln(count),
            0.5 * depth,
            coverage,
            share(error),
            log(noise.unwrap_or(0.0)),
        ]
    }
}

/// The luminance of the emission that the samples of pixel `i` saw directly.
fn emission(film: &Film, i: usize) -> f64 {
    luminance(Light::all(film).mean_emission(i).map(f64::from))
}

/// The features of pixel `i`, if features are used and the pixel hit a surface.
fn surface(film: &Film, has_features: bool, i: usize) -> Option<Features> {
    film.features(i).filter(|f| has_features && f.hits > 0)
}

/// Clamps a number to bounds that valid normals and albedos never reach. NaN becomes 0.
fn bounded(x: f32) -> f32 {
    if x.is_nan() { 0.0 } else { x.clamp(-16.0, 16.0) }
}
