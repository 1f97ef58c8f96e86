//! Multidimensional adaptive sampling: a sampler, and its reconstruction from boxes.

use crate::method::{FilterMethod, MethodFilter};
use crate::recorders::Singles;
use crate::tree::{At, Bounds, Cell, Division, Items, Leaf, Refinement, TreeSampler, image_of_boxes, mean, unit};
use crate::{Domain, FilmPoints};
use dapple_core::{Error, Film, Filtered, plan::PilotPolicy, point_set::mix};

dapple_core::options! {
    /// The parameters of [`Mdas`].
    pub struct MdasOptions {
        /// Each round refines all boxes whose error exceeds this fraction of the largest error.
        ///
        /// 0.025 is the default in a program by one of the authors [Meister and Hachisuka 2022].
        pub alpha: f64 = 0.025, |alpha| alpha > 0.0 && alpha <= 1.0, "above 0 and at most 1";
        /// Best-candidate trials per sample.
        pub candidates: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 candidates";
        /// Maximum samples in a box; a fuller box is split.
        pub leaf: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 samples";
        /// Length of a pixel's side in the distance metric; lens, time and light axes have length 1.
        ///
        /// The default is not in the paper, whose scale was not available.
        pub pixel: f64 = 0.5, |pixel| pixel > 0.0 && pixel.is_finite(), "a finite number above 0";
        /// Pilot samples per pixel.
        ///
        /// pilot=1 gives each cell of 2x2 pixels four samples, as published. Features that the pilot misses are found late or
        /// never, since boxes without contrast get hardly any samples.
        pub pilot: u32 = 4, |n| n >= 1, "at least one sample";
        /// 1: accept scenes with random dimensions beyond lens, time and light (noise looks like detail); 0: refuse them.
        pub force: u8 = 0, |force| force <= 1, "0 or 1";
        /// keep: samples used to set counts stay in the image (biased, as published); the only value.
        pub policy: PilotPolicy = PilotPolicy::Keep => "keep",
            |policy| policy == PilotPolicy::Keep, "only keep";
    }
}

dapple_core::options! {
    /// The parameters of [`MdasBoxes`].
    pub struct MdasBoxesOptions {
        /// Maximum samples in a box; a fuller box is split.
        pub leaf: u32 = 4, |n| (1..=64).contains(&n), "1 to 64 samples";
        /// Length of a pixel's side in the distance metric; lens, time and light axes have length 1. Use the sampler's value.
        pub pixel: f64 = 0.5, |pixel| pixel > 0.0 && pixel.is_finite(), "a finite number above 0";
    }
}

/// The side of a cell in pixels: with a pilot of one sample per pixel, a cell starts as one box with four samples.
const SIDE: u32 = 2;

/// The least error of a box per unit of volume, so that boxes without contrast are refined by their volume.
const LEAST: f64 = 1e-5;

impl MdasOptions {
    /// The extent along an axis, where a pixel's side is `pixel` and all other axes range over 1.
    fn extent(&self, bounds: &Bounds, axis: usize) -> f64 {
        bounds.extent(axis) * if axis < 2 { self.pixel } else { 1.0 }
    }
}

/// The spread of the samples along an axis.
fn spread(cell: &Cell, items: &Items, axis: usize) -> f32 {
    let all = items.iter().map(|&item| cell.at[item as usize][axis]);
    let (low, high) = all.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    high - low
}

impl Division for MdasOptions {
    /// Cuts the longest axis at the gap in the middle of the samples. Among equally long axes, the one along which the samples
    /// spread most is cut.
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

/// A box's error: its volume times the mean relative deviation of its samples from their mean, summed over channels [Meister
/// and Hachisuka 2022]. Black channels are left out. In a box with fewer than two samples, as in cells cut by the window, the
/// deviation is unknown; each channel then counts as 1.
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

    /// Returns all dimensions, or an error if samples depend on random numbers outside the domain and `force` is 0.
    fn dimensions(&self, domain: &Domain) -> Result<Domain, Error> {
        if let Some(what) = domain.outside().filter(|_| self.force == 0) {
            let allowed = "a scene without this noise, or force=1 (the noise then looks like detail)";
            return Err(Error::OutOfRange { name: "noise outside the domain", value: what.to_owned(), allowed });
        }
        Ok(domain.clone())
    }

    fn pilot_samples(&self) -> u32 {
        self.pilot
    }

    fn score(&self, cell: &Cell, leaf: &Leaf<'_>) -> f64 {
        error(cell, leaf)
    }

    /// A box's error is proportional to its volume, which its samples divide. So `k` more samples reduce the error to `samples
    /// / (samples + k)`. The sample count at most doubles, since errors from few samples mislead.
    fn wanted(&self, score: f64, samples: u32, level: f64) -> u32 {
        let more = f64::from(samples.max(1)) * (score / level - 1.0);
        more.ceil().clamp(0.0, f64::from(samples.max(1))) as u32
    }

    fn least_share(&self) -> f64 {
        self.alpha
    }

    /// Each new sample is the one of several candidates that is farthest from its nearest sample in the box.
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

/// Multidimensional adaptive sampling [Hachisuka et al. 2008], with the boxes and errors of a later program by one of the
/// authors [Meister and Hachisuka 2022].
///
/// Samples lie in the space of image position, lens, time and light ([`Domain`]), which is divided into boxes of at most four
/// samples each. The box with the largest error gets the next sample: the one of four candidates that is farthest from the
/// box's samples. A box's error is its volume times the mean relative deviation of its samples.
///
/// The pilot samples come from the point set; the published pilot is a grid with four samples in each cell. Boxes never exceed
/// 2x2 pixels. A box is cut across its longest side, in the gap at the median. The published program cuts a full box when a
/// sample arrives; here, all boxes are rebuilt from all samples before each round. A round has half a sample per pixel or a
/// quarter of the samples so far, whichever is more. It adds samples to many boxes at once, as if the error of a box were
/// inversely proportional to its sample count.
///
/// The matching filter is [`MdasBoxes`]. Pixel means give refined regions too much weight, and so does every filter that reads
/// only these means.
///
/// *Guarantees*: spends the budget exactly. *Bias*: the values of samples determine where later ones lie, and all samples are
/// kept [Kirk and Arvo 1991]. *Weaknesses*: random numbers outside the domain, such as those of a second scattering, look like
/// detail and attract samples; such scenes are rejected unless [`MdasOptions::force`] is 1. Boxes in which the pilot found no
/// contrast get too few samples. Boxes become elongated in more than five dimensions. Each round rereads all samples of each
/// 2x2 cell that gained samples in the last round.
pub type Mdas<P> = TreeSampler<P, MdasOptions>;

/// The integral of a function that is constant in each box: the reconstruction of [Meister and Hachisuka 2022] for samples in
/// the space of image position, lens, time and light.
///
/// Each box holds at most four samples and has their mean radiance. A pixel is the sum over the boxes of this mean times the
/// box's volume within the pixel. Samples are thus weighted by the volume around them, and unequal densities cause no bias
/// beyond that of constant boxes. The filter is made for the sampler `mdas` but works with any sampler; [`FilmPoints`] provides
/// the coordinates.
///
/// Boxes are at most 2x2 pixels wide, and narrower where there are more samples. Pixels are black if their cell of 2x2 pixels
/// has no samples. There is no error estimate.
///
/// *Bias*: from constant boxes; it grows with their width. *Weaknesses*: blurs by up to a pixel at few samples; noise from
/// outside the domain remains.
pub type MdasBoxes = MethodFilter<MdasBoxesOptions, FilmPoints>;

impl FilterMethod<FilmPoints> for MdasBoxesOptions {
    const NAME: &'static str = "mdas-boxes";
    const SAMPLES: Option<Singles> = Some(Singles::All);

    fn image(&self, film: &Film, points: &FilmPoints) -> Result<Filtered, Error> {
        let rule = MdasOptions { leaf: self.leaf, pixel: self.pixel, ..MdasOptions::default() };
        image_of_boxes((film, Self::NAME), SIDE, points, points.domain(), &rule)
    }
}
