//! Multidimensional adaptive sampling: a sampler, and its reconstruction from boxes.

use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::tree::{At, Bounds, Cell, Division, Items, Leaf, Refinement, TreeSampler, image_of_boxes, mean, unit};
use crate::{Domain, FilmPoints};
use dapple_core::{Error, Film, Filtered, PilotPolicy, mix};

dapple_core::options! {
    /// The parameters of [`Mdas`].
    pub struct MdasOptions {
        /// Share of the largest error down to which boxes get samples in a round.
        ///
        /// 0.025 is the default of a program by one of the authors [Meister and Hachisuka 2022].
        pub alpha: f64 = 0.025, |alpha| alpha > 0.0 && alpha <= 1.0, "above 0 and at most 1";
        /// Candidates of which the one farthest from the box's samples becomes a sample.
        pub candidates: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 candidates";
        /// Samples in a box before it is cut.
        pub leaf: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 samples";
        /// Side of a pixel, where the ranges of lens, time and light are 1.
        ///
        /// The paper gives the image a scale of its own, which could not be read; the default is ours.
        pub pixel: f64 = 0.5, |pixel| pixel > 0.0 && pixel.is_finite(), "a finite number above 0";
        /// Samples per pixel of the pilot; the default is ours.
        ///
        /// The published grid has four samples in a cell, here 2x2 pixels: pilot=1. What they miss is found late or
        /// never, since boxes without contrast hardly get samples.
        pub pilot: u32 = 4, |n| n >= 1, "at least one sample";
        /// 1 also samples scenes with random numbers outside the domain, whose noise then looks like detail.
        pub force: u8 = 0, |force| force <= 1, "0 or 1";
        /// Use in the image of the samples that decide where others lie: keep (biased, as published), the only one.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "keep; there is no other";
    }
}

dapple_core::options! {
    /// The parameters of [`MdasBoxes`].
    pub struct MdasBoxesOptions {
        /// Samples in a box before it is cut.
        pub leaf: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 samples";
        /// Side of a pixel, where the ranges of lens, time and light are 1; as in the sampler mdas.
        pub pixel: f64 = 0.5, |pixel| pixel > 0.0 && pixel.is_finite(), "a finite number above 0";
    }
}

/// The side of a cell in pixels: with a pilot of one sample per pixel, a cell starts as one box with four samples.
const SIDE: u32 = 2;

/// The least share of a box's error, so that boxes without contrast are refined by their volume.
const LEAST: f64 = 1e-5;

impl MdasOptions {
    /// The extent along an axis, in units of the axes other than the place.
    fn extent(&self, bounds: &Bounds, axis: usize) -> f64 {
        bounds.extent(axis) * if axis < 2 { self.pixel } else { 1.0 }
    }
}

/// The range of the samples along an axis.
fn spread(cell: &Cell, items: &Items, axis: usize) -> f32 {
    let all = items.iter().map(|&item| cell.at[item as usize][axis]);
    let (low, high) = all.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    high - low
}

impl Division for MdasOptions {
    /// Cuts the longest axis at the gap in the middle of the samples. Of equally long axes, it is the one over which the samples
    /// spread most.
    fn cut(&self, cell: &Cell, items: &mut Items, bounds: &Bounds, _: u32) -> Option<(usize, f32)> {
        if items.len() <= self.leaf as usize {
            return None;
        }
        let mut axes: [usize; Domain::MOST] = std::array::from_fn(|axis| axis);
        let axes = &mut axes[..cell.axes];
        axes.sort_by(|&a, &b| {
            let by_extent = self.extent(bounds, b).total_cmp(&self.extent(bounds, a));
            by_extent.then_with(|| spread(cell, items, b).total_cmp(&spread(cell, items, a)))
        });
        let middle = items.len() / 2;
        axes.iter().find_map(|&axis| {
            let of = |item: u32| cell.at[item as usize][axis];
            let (below, &mut above, _) = items.select_nth_unstable_by(middle, |&a, &b| of(a).total_cmp(&of(b)));
            let (low, high) = (below.iter().map(|&item| of(item)).fold(f32::NEG_INFINITY, f32::max), of(above));
            let at = low + 0.5 * (high - low);
            (low < high).then_some((axis, if at > low { at } else { high }))
        })
    }
}

/// A box's error: its volume times its samples' mean relative deviation from their mean, summed over channels
/// [Meister and Hachisuka 2022]. Channels that are black are left out. A box with less than two samples, as in cells cut by the
/// window, has no deviation yet; each channel then counts as 1.
fn error(cell: &Cell, leaf: &Leaf<'_>) -> f64 {
    let volume = leaf.bounds.volume(cell.axes);
    if leaf.items.len() < 2 {
        return 3.0 * volume;
    }
    let mean = mean(cell, leaf.items);
    let mut sum = 0.0;
    for &item in leaf.items {
        let value = cell.values[item as usize];
        for c in (0..3).filter(|&c| mean[c] > 0.0) {
            sum += (f64::from(value[c]) - mean[c]).abs() / mean[c];
        }
    }
    volume * (LEAST + sum / leaf.items.len() as f64)
}

impl Refinement for MdasOptions {
    const NAME: &'static str = "mdas";
    const SIDE: u32 = SIDE;

    /// All, unless there are random numbers outside.
    fn dimensions(&self, domain: &Domain) -> Result<Domain, Error> {
        if let Some(what) = domain.outside().filter(|_| self.force == 0) {
            let allowed = "scenes without it; force=1 samples it, and its noise looks like detail";
            return Err(Error::OutOfRange { name: "dependence of samples", value: what.to_owned(), allowed });
        }
        Ok(domain.clone())
    }

    fn pilot_samples(&self) -> u32 {
        self.pilot
    }

    fn score(&self, cell: &Cell, leaf: &Leaf<'_>) -> f64 {
        error(cell, leaf)
    }

    /// A box's error falls with its volume, which is shared by its samples. So `samples` and `k` more leave
    /// `samples / (samples + k)` of it. At most as many as there are, since errors of few samples mislead.
    fn wanted(&self, score: f64, samples: u32, level: f64) -> u32 {
        let more = f64::from(samples.max(1)) * (score / level - 1.0);
        more.ceil().clamp(0.0, f64::from(samples.max(1))) as u32
    }

    fn least_share(&self) -> f64 {
        self.alpha
    }

    /// Of several candidates each time, the one that is farthest from its nearest sample in the box.
    fn place(&self, cell: &Cell, leaf: &Leaf<'_>, count: u32, seed: u64, to: &mut Vec<At>) {
        let apart = |a: &At, b: &At| {
            let along = |axis: usize| {
                let apart = f64::from(a[axis]) - f64::from(b[axis]);
                apart * if axis < 2 { self.pixel } else { 1.0 }
            };
            (0..cell.axes).map(|axis| along(axis) * along(axis)).sum::<f64>()
        };
        let first = to.len();
        for number in 0..count {
            let candidate = |k: u32| {
                let name = mix(seed ^ u64::from(number) << 40 ^ u64::from(k) << 8);
                leaf.bounds.point(cell.axes, |axis| unit(name ^ (axis as u64 + 1)))
            };
            let mut best = (candidate(0), f64::NEG_INFINITY);
            for at in (0..self.candidates).map(candidate) {
                let there = leaf.items.iter().map(|&item| &cell.at[item as usize]).chain(&to[first..]);
                let distance = there.map(|other| apart(&at, other)).fold(f64::INFINITY, f64::min);
                if distance > best.1 {
                    best = (at, distance);
                }
            }
            to.push(best.0);
        }
    }
}

/// Multidimensional adaptive sampling [Hachisuka et al. 2008], with the boxes and errors of a later program by one of its
/// authors [Meister and Hachisuka 2022].
///
/// Samples lie in the space of place, lens, time and light ([`Domain`]). Its boxes hold at most four samples each. The box
/// with the largest error gets the next sample: the best of four candidates, the one farthest from the box's samples. A box's
/// error is its volume times the mean relative deviation of its samples.
///
/// A pilot comes first, from the point set. The published grid has four samples in each cell. Boxes never exceed 2x2 pixels. The published program
/// cuts a full box when a sample arrives; here, boxes follow anew from all samples before each round, by the same
/// rule: the longest side is cut, in the gap at the median. A round has half a sample per pixel, or a quarter of the
/// samples so far if they are more. It serves many boxes at once, as if each sample took its share of a box's error.
///
/// The image is made by [`MdasBoxes`]. A pixel's plain mean overweights refined parts, as does every filter that reads means.
///
/// *Guarantees*: spends the budget exactly. *Bias*: samples decide where others lie, and stay [Kirk and Arvo 1991].
/// *Weaknesses*: random numbers outside the domain, as of paths that scatter twice, look like detail and attract samples;
/// such scenes are refused unless [`MdasOptions::force`] is 1. Boxes in which the pilot saw no contrast starve. Boxes grow long
/// in more than five dimensions. Each round reads the coordinates of all samples in the cells that got some.
pub type Mdas<P> = TreeSampler<P, MdasOptions>;

/// The integral of a function that is constant in boxes: the reconstruction of [Meister and Hachisuka 2022] for samples in
/// the space of place, lens, time and light.
///
/// Each box of at most four samples has their mean radiance. A pixel is the sum over the boxes of this mean times the box's
/// volume within the pixel. So samples count by the volume around them, and unequal densities leave no bias beyond that of
/// constant boxes. It is made for the sampler `mdas`, and works on the samples of any sampler: coordinates come from
/// [`FilmPoints`].
///
/// Boxes are at most 2x2 pixels wide, and narrower where they have more samples. Pixels of a cell of 2x2 pixels without
/// samples are black. There is no error estimate.
///
/// *Bias*: of constant boxes, of their width. *Weaknesses*: blurs by up to a pixel at few samples; noise from outside the domain
/// stays.
pub type MdasBoxes = MethodFilter<MdasBoxesOptions, FilmPoints>;

impl FilterMethod<FilmPoints> for MdasBoxesOptions {
    const NAME: &'static str = "mdas-boxes";
    const SAMPLES: Option<Singles> = Some(Singles::All);

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        let rule = MdasOptions { leaf: self.leaf, pixel: self.pixel, ..MdasOptions::default() };
        image_of_boxes((film, Self::NAME), SIDE, points, points.domain(), &rule)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Role;
    use crate::support::{Made, domain, film_points, image, mean_of_columns, render_with, squared_error};
    use crate::tree::leaves;
    use dapple_core::Needs;
    use dapple_low_discrepancy::{Random, Sobol};

    const OPTIONS: MdasBoxesOptions = MdasBoxesOptions { leaf: 4, pixel: 0.5 };

    /// The film and the image of mdas and its filter, in samples per pixel.
    fn integrated(made: Made, needs: Needs, spp: f64, size: [u32; 2]) -> (Film, Vec<[f32; 3]>) {
        let mut sampler = Mdas::new(Sobol::new(5), &domain(&[Role::Time]), MdasOptions::default()).unwrap();
        let points = film_points(Sobol::new(5), &[Role::Time], Some(sampler.placed()));
        let film = render_with(needs, made, &mut sampler, size, spp);
        let image = image(&MdasBoxes::new(points, OPTIONS).unwrap(), &film);
        (film, image)
    }

    /// A step over time: 1 before 1/3, in all pixels.
    fn step(_: [f32; 2], rest: [f32; 4]) -> f32 {
        f32::from(u8::from(rest[2] < 1.0 / 3.0))
    }

    #[test]
    fn a_step_over_time_is_integrated_ever_better() {
        // The median, since cells in which the pilot misses the step starve.
        let errors = [4.0, 16.0, 64.0].map(|spp| {
            let (_, image) = integrated(step, Needs::none(), spp, [16, 16]);
            let mut errors: Vec<f64> = image.iter().map(|x| (f64::from(x[0]) - 1.0 / 3.0).abs()).collect();
            errors.sort_by(f64::total_cmp);
            errors[errors.len() / 2]
        });
        // The step is a surface in three dimensions. Four times the samples there halve its boxes, and four times as many
        // boxes share a pixel's error.
        assert!(errors.windows(2).all(|pair| pair[1] < 0.25 * pair[0]), "{errors:?}");
        // 64 random samples have an error of 0.059, and a median of 0.04.
        assert!(errors[2] < 0.005, "{errors:?}");
    }

    #[test]
    fn samples_gather_where_the_function_varies() {
        // Columns 0 to 3 are constant, columns 4 to 7 have the step.
        let half = |place: [f32; 2], rest: [f32; 4]| if place[0] < 4.0 { 0.5 } else { step(place, rest) };
        let (film, image) = integrated(half, Needs::none(), 16.0, [8, 8]);
        let mean = |columns| mean_of_columns(&film, columns, |i| film.count(i) as f64);
        // The constant half hardly gets more than the pilot.
        assert!(mean(0..8) == 16.0 && (4.0..4.4).contains(&mean(0..4)), "{}", mean(0..4));
        assert!(image.iter().step_by(8).all(|x| (x[0] - 0.5).abs() < 1e-6));
    }

    /// With one set of samples and with two halves.
    #[test]
    fn a_product_of_place_and_time_is_integrated_to_its_closed_form() {
        let product = |[x, y]: [f32; 2], rest: [f32; 4]| (1.0 + (x * 0.7).sin() * (y * 0.4).cos()) * (0.2 + rest[2]);
        let integral = |low: usize, scale: f64, of: fn(f64) -> f64| {
            (of((low + 1) as f64 * scale) - of(low as f64 * scale)) / scale
        };
        let exact = |i: usize| 0.7 * (1.0 + integral(i % 9, 0.7, |x| -x.cos()) * integral(i / 9, 0.4, f64::sin));
        for needs in [Needs::none(), Needs::none().with_halves()] {
            let errors =
                [32.0, 256.0].map(|spp| squared_error(&integrated(product, needs, spp, [9, 7]).1, exact).sqrt());
            // Eight times the samples halve the boxes in all three dimensions, and each box has a random error of its own.
            assert!(errors[1] < 0.4 * errors[0] && errors[1] < 0.01, "{errors:?}");
        }
    }

    /// The boxes of a cell of white samples.
    fn divided(at: Vec<At>, axes: usize) -> (Cell, Vec<(Bounds, Vec<u32>)>) {
        let values = vec![[1.0; 3]; at.len()];
        let cell = Cell { at, values, size: [2, 2], corner: [0, 0], axes };
        let mut found = Vec::new();
        leaves(&MdasOptions::default(), &cell, &mut |leaf| found.push((*leaf.bounds, leaf.items.to_vec())));
        (cell, found)
    }

    fn random_samples(count: u64, axes: usize) -> Vec<At> {
        let bounds = divided(Vec::new(), axes).1[0].0;
        (0..count).map(|k| bounds.point(axes, |axis| unit(k * 8 + axis as u64))).collect()
    }

    #[test]
    fn boxes_partition_the_cell_and_hold_their_samples() {
        for (count, axes) in [(0, 3), (4, 2), (5, 2), (300, 5), (300, 6), (77, 3)] {
            let (cell, found) = divided(random_samples(count, axes), axes);
            let volume: f64 = found.iter().map(|(bounds, _)| bounds.volume(axes)).sum();
            assert!((volume - 4.0).abs() < 1e-5, "{count} samples in {axes} axes: {volume}");
            assert_eq!(found.iter().map(|(_, items)| items.len()).sum::<usize>(), count as usize);
            for (bounds, items) in &found {
                let is_inside = |at: &At| (0..axes).all(|k| bounds.low[k] <= at[k] && at[k] < bounds.high[k]);
                assert!(items.len() <= 4 && items.iter().all(|&item| is_inside(&cell.at[item as usize])));
            }
        }
        let (_, equal) = divided(vec![[0.5; Domain::MOST]; 40], 4);
        assert_eq!((equal.len(), equal[0].1.len()), (1, 40), "equal samples stay in one box");
    }

    #[test]
    fn exchanged_axes_of_the_lens_exchange_the_boxes() {
        let samples = random_samples(200, 4);
        let mut exchanged = samples.clone();
        exchanged.iter_mut().for_each(|at| at.swap(2, 3));
        let boxes = |samples| {
            let mut found = divided(samples, 4).1;
            found.sort_by_key(|(_, items)| items[0]);
            found
        };
        let mut expected = boxes(samples);
        for (bounds, _) in &mut expected {
            bounds.low.swap(2, 3);
            bounds.high.swap(2, 3);
        }
        assert!(expected.len() > 50 && boxes(exchanged) == expected);
    }

    #[test]
    fn one_white_sample_of_four_has_an_error_of_one_and_a_half_per_channel() {
        let mut cell = divided(random_samples(4, 2), 2).0;
        cell.values[..3].fill([0.0; 3]);
        let bounds = Bounds { low: At::default(), high: [2.0; Domain::MOST] };
        let found = error(&cell, &Leaf { bounds: &bounds, items: &[0, 1, 2, 3], depth: 0 });
        assert!((found - 4.0 * (1e-5 + 3.0 * 1.5)).abs() < 1e-12, "{found}");
    }

    #[test]
    fn scenes_with_random_numbers_outside_the_domain_are_refused_unless_forced() {
        let noisy = domain(&[Role::Time]).with_outside("light that scatters more than once");
        let made = |options| Mdas::new(Random::new(1), &noisy, options);
        let error = made(MdasOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("light that scatters more than once") && error.contains("force=1"), "{error}");
        assert!(made(MdasOptions::default().force(1)).is_ok());
    }
}
