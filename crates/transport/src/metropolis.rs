//! Metropolis light transport on the random numbers of bidirectional paths [Veach and Guibas 1997; Kelemen et al. 2002].

mod chain;

use crate::bdpt::{Bdpt, BdptOptions};
use chain::{Chains, Deposit, Target};
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::options::Options as _;
use dapple_core::{Block, Draws, Estimate, Frame, Integrator, Worker, parallel, point_set::mix};
use dapple_renderer::{MakeError, World};
use glam::Vec3;

dapple_core::options! {
    /// The parameters of [`Metropolis`].
    pub struct MetropolisOptions {
        /// Maximum number of scattering events on a path; 0: the scene's limit.
        pub depth: u32 = 0;
        /// Mutations per chain.
        pub length: u32 = 256, |length| length >= 1, "at least 1";
        /// Bootstrap samples, as a fraction of the mutations.
        pub seeds: f64 = 0.25, |seeds| seeds > 0.0 && seeds <= 16.0, "above 0, at most 16";
        /// Probability of a large step, which replaces all random numbers.
        pub large: f64 = 0.3, |large| large > 0.0 && large <= 1.0, "above 0, at most 1";
    }
}

/// The number of images per pass: one for each half of the film.
const IMAGES: usize = 2;
/// The number of chains whose contributions are buffered before they are added to the image.
const TOGETHER: u64 = 256;

/// An integrator that samples indirect lighting (two or more scattering events) by Markov chains, and traces direct lighting
/// separately.
///
/// Each pass renders an image for each half of the samples, with separate chains and bootstrap samples. An image takes as many
/// mutations as it has pixels. Passes are independent and unbiased: a chain starts at a bootstrap sample, chosen in proportion
/// to its brightness, and is weighted by the mean brightness of all bootstrap samples [after Veach 1997, ch. 11]. A sample is
/// direct lighting plus the pixel's value in its half's image. Noise is correlated between pixels; filters assume it is not.
///
/// Adaptive sampling affects only direct lighting. Worlds with media or transparency are rejected.
#[derive(Debug)]
pub struct Metropolis<'w> {
    world: &'w World,
    options: MetropolisOptions,
    /// The largest number of scattering events.
    depth: u32,
    direct: Bdpt<'w>,
    indirect: Bdpt<'w>,
    frame: Option<Frame>,
    /// The indirect lighting of each pixel of the frame's window, linear RGB.
    images: [Vec<[f32; 3]>; IMAGES],
}

/// An image of indirect lighting.
pub(crate) struct ChainImage {
    /// The radiance of each pixel of the window.
    pub(crate) light: Vec<[f64; 3]>,
    pub(crate) rays: u64,
}

impl<'w> Metropolis<'w> {
    /// Makes the integrator for a world.
    ///
    /// # Errors
    ///
    /// [`MakeError::Scene`], which names the effect, if the world has media or partly transparent surfaces.
    pub fn new(world: &'w World, options: &MetropolisOptions) -> Result<Self, MakeError> {
        let depth = if options.depth == 0 { world.max_depth() } else { options.depth };
        let direct = Bdpt::new(world, &BdptOptions::default().depth(depth.min(1)).splat(0))?;
        let mut indirect = Bdpt::new(world, &BdptOptions::default().depth(depth))?;
        indirect.least = 2;
        Ok(Self { world, options: *options, depth, direct, indirect, frame: None, images: Default::default() })
    }

    /// Makes the integrator from the text of its parameters, for the table of integrators.
    pub(crate) fn parse<'a>(parameters: &str, world: &'a World) -> Result<Box<dyn Integrator + 'a>, MakeError> {
        Ok(Box::new(Metropolis::new(world, &MetropolisOptions::parse(parameters)?)?))
    }
}

/// Runs all chains of one image, with as many mutations as the window has pixels.
fn image_of(target: &dyn Target, frame: &Frame, key: u64, options: &MetropolisOptions) -> ChainImage {
    let (pixels, length) = (frame.pixels() as u64, u64::from(options.length));
    let chains = Chains { target, frame, key, large: options.large as f32 };
    let count = pixels.div_ceil(length);
    let seeds = ((pixels as f64 * options.seeds).ceil() as u64).max(64);
    let found: Vec<(f64, u64)> = parallel::map(seeds as usize, |i| chains.brightness_of_seed(i as u64));
    let mut rays = found.iter().map(|(_, rays)| rays).sum();
    let total: f64 = found.iter().map(|(brightness, _)| brightness).sum();
    let mut light = vec![[0.0; 3]; frame.pixels()];
    if total == 0.0 {
        return ChainImage { light, rays };
    }
    let starts = starts(found.iter().map(|(brightness, _)| *brightness), total, count, key);
    // A mutation is a sample of the whole image, so the mean over mutations is multiplied by the number of pixels.
    let scale = total / seeds as f64 / (count * length) as f64;
    let starts: Vec<(u64, u64)> = (0..).zip(starts).collect();
    for some in starts.chunks(TOGETHER as usize) {
        let found: Vec<(Vec<Deposit>, u64)> = parallel::map(some.len(), |k| chains.run(some[k].0, some[k].1, length));
        for (found, more) in found {
            rays += more;
            for (pixel, deposit) in found {
                let sum = &mut light[pixel as usize];
                (0..3).for_each(|c| sum[c] += f64::from(deposit[c]) * scale);
            }
        }
    }
    ChainImage { light, rays }
}

/// Returns the start samples of `count` chains, chosen in proportion to brightness by systematic resampling.
fn starts(brightness: impl Iterator<Item = f64>, total: f64, count: u64, key: u64) -> Vec<u64> {
    let offset = (mix(key ^ 0x57a2_7f00_d5e1_ec75) >> 11) as f64 / (1_u64 << 53) as f64;
    let (mut starts, mut sum, mut last) = (Vec::with_capacity(count as usize), 0.0, 0);
    for (i, brightness) in (0..).zip(brightness) {
        sum += brightness;
        if brightness > 0.0 {
            last = i;
        }
        while (starts.len() as u64) < count && (starts.len() as f64 + offset) * total < sum * count as f64 {
            starts.push(i);
        }
    }
    // Rounding may leave the last start unset.
    starts.resize(count as usize, last);
    starts
}

/// The indirect lighting of a world, as a target function of chains.
struct Indirect<'a, 'w> {
    world: &'w World,
    paths: &'a Bdpt<'w>,
    frame: Frame,
}

/// Returns the index of a pixel in the window; `None` outside.
fn index_of(frame: &Frame, [column, row]: [u32; 2]) -> Option<u32> {
    let ([x, y], [width, height]) = (frame.origin(), frame.size());
    let (x, y) = (column.checked_sub(x)?, row.checked_sub(y)?);
    (x < width && y < height).then(|| y * width + x)
}

impl Target for Indirect<'_, '_> {
    fn evaluate(&self, draws: &Draws<'_>, found: &mut Vec<Deposit>) -> u32 {
        let [width, height] = self.frame.resolution().map(|n| n as f32);
        let estimate = self.paths.trace(draws, |place, radiance| {
            self.world.splat_at(place, |pixel, weight| {
                let pixel = index_of(&self.frame, pixel);
                found.extend(pixel.map(|pixel| (pixel, radiance * (weight * width * height))));
            });
        });
        let radiance = Vec3::from(estimate.radiance);
        if let Some(pixel) = index_of(&self.frame, draws.pixel())
            && radiance != Vec3::ZERO
        {
            found.push((pixel, radiance * self.frame.pixels() as f32));
        }
        if found.iter().any(|(_, light)| !light.is_finite()) {
            found.clear();
        }
        estimate.cost
    }
}

impl Integrator for Metropolis<'_> {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        let mut estimate = self.direct.estimate(draws, worker);
        let image = &self.images[(draws.sample_number() & 1) as usize];
        let pixel = self.frame.as_ref().and_then(|frame| index_of(frame, draws.pixel()));
        if let Some(light) = pixel.and_then(|pixel| image.get(pixel as usize)) {
            estimate.radiance = (Vec3::from(estimate.radiance) + Vec3::from(*light)).to_array();
        }
        estimate
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        self.direct.features_alone(draws)
    }

    fn prepares(&self) -> Prepares {
        if self.depth < 2 { Prepares::Never } else { Prepares::EveryPass }
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let numbers = pass.draws(0).block(Block::new(0));
        let key = numbers.iter().fold(u64::from(pass.number), |key, x| mix(key ^ u64::from(x.to_bits())));
        let target = Indirect { world: self.world, paths: &self.indirect, frame: pass.frame };
        let mut prepared = PreparationCost::default();
        self.images = [0, 1].map(|number| {
            let found = image_of(&target, &pass.frame, mix(key ^ (number + 1)), &self.options);
            prepared.rays += found.rays;
            found.light.iter().map(|light| light.map(|x| x as f32)).collect()
        });
        self.frame = Some(pass.frame);
        prepared
    }

    fn memory(&self, frame: &Frame) -> u64 {
        /// The number of pixel contributions per mutation: the sample's own and a few splats, for two states.
        const DEPOSITS: u64 = 8;
        let pixels = frame.pixels() as u64;
        let images = (IMAGES * size_of::<[f32; 3]>() + size_of::<[f64; 3]>()) as u64 * pixels;
        let seeds = (pixels as f64 * self.options.seeds) as u64 * size_of::<(f64, u64)>() as u64;
        let mutations = pixels.min(TOGETHER * u64::from(self.options.length));
        images + seeds + mutations * DEPOSITS * size_of::<Deposit>() as u64
    }
}
