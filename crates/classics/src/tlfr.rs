//! Temporal light field reconstruction: a filter that reuses samples at other points of lens and time.

mod samples;

use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::{Defocus, FilmPoints};
use dapple_core::{Error, Film, Filtered, parallel};
use samples::{At, Axes, Near, Tree, covers, divide, join_small, surrounds};

dapple_core::options! {
    /// The parameters of [`Tlfr`].
    pub struct TlfrOptions {
        /// Reconstruction points per pixel; powers of two are best.
        pub points: u32 = 128, |n| (1..=65_536).contains(&n), "1 to 65536 points";
    }
}

/// The radius in pixels of the largest circle without samples, for 1, 2, 4, … 256 samples per pixel [Lehtinen et al. 2011].
const DISPERSION: [f64; 9] = [2.0, 1.34, 1.1, 0.8, 0.5, 0.37, 0.27, 0.18, 0.14];

/// The number of times that the search radius is doubled if no sample is found.
const DOUBLINGS: u32 = 3;

/// The number of samples per pixel that memory forecasts assume.
const ASSUMED_SPP: usize = 64;

/// Temporal light field reconstruction [Lehtinen et al. 2011]: samples are reused at other points of lens and time.
///
/// Each pixel is the mean over many points, each with a position in the pixel, a position on the lens, and a time. For each
/// point, all samples are moved to its lens position and time, using their depth and motion. The samples near the point are
/// sorted by depth and divided into surfaces. Samples belong to one surface if they do not pass each other for nearby lens
/// points and times. The first surface that covers the point determines its colour: the mean of the surface's samples, weighted
/// by a tent. The tent's radius equals the radius of the largest empty circle between samples, from a table by the mean number
/// of samples per pixel.
///
/// Here, two samples pass each other if their offset in the image reverses. The published test uses bounds of tree leaves. The
/// published option of Gaussians over lens and time is left out.
///
/// *Without lens and motion*, there is one surface everywhere, and the image is the input filtered by the tent. Samples whose
/// depth and motion are unknown count as a background at rest.
///
/// *Bias*: the tent blurs, and moved samples keep their radiance. *Weaknesses*: highlights and reflections do not move with
/// their surface, and objects behind glass move with the glass. Noise that does not come from lens or time is averaged only
/// over the tent. Rotation is treated as linear motion. Surfaces with fewer than four samples are merged with the surface
/// behind.
pub type Tlfr = MethodFilter<TlfrOptions, FilmPoints>;

impl FilterMethod<FilmPoints> for TlfrOptions {
    const NAME: &'static str = "tlfr";
    const BYTES: usize = 12 + ASSUMED_SPP * Tree::BYTES;
    const SAMPLES: Option<Singles> = Some(Singles::Moving);

    /// Returns an error if samples depend on a lens of unknown blur.
    fn check(&self, points: &FilmPoints) -> Result<(), Error> {
        if Axes::of(points.domain()).has_lens() && points.defocus().is_none() {
            let allowed = "a perspective camera with a thin lens or without a lens";
            return Err(Error::OutOfRange { name: "camera", value: "a lens of unknown blur".to_owned(), allowed });
        }
        Ok(())
    }

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        let (frame, axes) = (film.frame(), Axes::of(points.domain()));
        let field = LightField::new(film, points, self.points)?;
        let mut radiance = vec![[0.0; 3]; frame.pixels()];
        parallel::chunks(&mut radiance, 64, |chunk, pixels| {
            let scratch = &mut Scratch::default();
            for (i, pixel) in (64 * chunk..).zip(pixels) {
                let mut sum = ([0.0; 3], 0);
                for number in 0..self.points {
                    let at = axes.output(frame.pixel(i), number);
                    if let Some(colour) = field.colour(&at, scratch) {
                        (0..3).for_each(|c| sum.0[c] += colour[c]);
                        sum.1 += 1;
                    }
                }
                *pixel = if sum.1 > 0 { sum.0.map(|x| x / f64::from(sum.1)) } else { film.mean(i) }.map(|x| x as f32);
            }
        });
        Ok(Filtered::new(frame.size(), radiance))
    }
}

/// The radius in pixels in which samples are gathered, for a mean number of samples per pixel.
fn dispersion(spp: f64) -> f64 {
    let last = DISPERSION.len() - 1;
    let place = libm::log2(spp.max(1e-3));
    if place <= 0.0 {
        return DISPERSION[0] * libm::exp2(-0.5 * place);
    }
    if place >= last as f64 {
        return DISPERSION[last] * libm::exp2(-0.5 * (place - last as f64));
    }
    let k = place as usize;
    DISPERSION[k] + (place - k as f64) * (DISPERSION[k + 1] - DISPERSION[k])
}

/// The buffers of one thread.
#[derive(Default)]
struct Scratch {
    near: Vec<Near>,
    ends: Vec<usize>,
}

/// The samples of an image, from which the colour at any point of image, lens and time is reconstructed.
struct LightField {
    tree: Tree,
    radius: f64,
    /// The half widths, on the lens and in time, of the box in which the samples of one surface do not pass each other.
    widths: [f64; 2],
}

impl LightField {
    /// Creates the light field of a film, for `output` reconstructed points per pixel.
    fn new(film: &Film, points: &FilmPoints, output: u32) -> Result<Self, Error> {
        let axes = Axes::of(points.domain());
        let defocus = points.defocus().filter(|_| axes.has_lens()).unwrap_or(Defocus::new([0.0; 2], [0.0; 2]));
        let samples = axes.samples(&Singles::Moving.of(film, TlfrOptions::NAME)?, points, &defocus);
        let spp = samples.len() as f64 / film.frame().pixels() as f64;
        let width = f64::from(output).sqrt().recip();
        Ok(Self { tree: Tree::new(samples, defocus), radius: dispersion(spp), widths: [width, 0.5 * width] })
    }

    /// The colour at a point; `None` if there are no samples around it.
    fn colour(&self, at: &At, scratch: &mut Scratch) -> Option<[f64; 3]> {
        let mut radius = self.radius;
        self.fetch(at, radius, scratch);
        for _ in 0..DOUBLINGS {
            if scratch.near.is_empty() {
                radius *= 2.0;
                self.fetch(at, radius, scratch);
            }
        }
        let first = &scratch.near[..*scratch.ends.first()?];
        if scratch.ends.len() == 1 || surrounds(first) {
            return Some(self.mean(first, radius));
        }
        self.fetch(at, 2.0 * radius, scratch);
        join_small(&mut scratch.ends);
        let Scratch { near, ends } = scratch;
        let starts = std::iter::once(0).chain(ends.iter().copied());
        let mut surfaces = starts.zip(ends.iter()).map(|(first, &end)| &near[first..end]);
        let last = surfaces.clone().last()?;
        Some(self.mean(surfaces.find(|surface| covers(surface, radius)).unwrap_or(last), radius))
    }

    /// Gathers the samples within `reach` of a point, and divides them into surfaces.
    fn fetch(&self, at: &At, reach: f64, Scratch { near, ends }: &mut Scratch) {
        near.clear();
        self.tree.gather(at, reach, |index, seen| near.push((index, seen)));
        divide(near, self.widths, ends);
    }

    /// The mean radiance of a surface's samples, weighted by a tent. If no sample is within the radius, the nearest is used.
    fn mean(&self, surface: &[Near], radius: f64) -> [f64; 3] {
        let (mut sum, mut weights, mut nearest) = ([0.0; 3], 0.0, (f64::INFINITY, [0.0; 3]));
        for &(index, seen) in surface {
            let distance = libm::sqrt(seen.place[0] * seen.place[0] + seen.place[1] * seen.place[1]);
            let radiance = self.tree.sample(index).radiance.map(f64::from);
            let weight = (1.0 - distance / radius).max(0.0);
            weights += weight;
            (0..3).for_each(|c| sum[c] += weight * radiance[c]);
            if distance < nearest.0 {
                nearest = (distance, radiance);
            }
        }
        if weights > 0.0 { sum.map(|x| x / weights) } else { nearest.1 }
    }
}
