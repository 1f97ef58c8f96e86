//! Sums of functions of each sample: `x ln x`, roots, and moments of roots.

use super::{Bank, Film};
use crate::Sums;

/// Count, mean, and sums of squared and cubed deviations of three channels.
///
/// Values are added and moments merged by the formulas of [Pébay 2008].
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThirdMoments {
    /// The number of values.
    pub count: u64,
    /// The mean per channel; 0 without values.
    pub mean: [f64; 3],
    /// The sum of squared deviations from the mean, per channel.
    pub m2: [f64; 3],
    /// The sum of cubed deviations from the mean, per channel.
    pub m3: [f64; 3],
}

impl ThirdMoments {
    /// Adds all values of `other`.
    pub fn merge(&mut self, other: &Self) {
        let counts = (self.count, other.count);
        for c in 0..3 {
            let own = [self.mean[c], self.m2[c], self.m3[c]];
            let theirs = [other.mean[c], other.m2[c], other.m3[c]];
            [self.mean[c], self.m2[c], self.m3[c]] = merged(own, theirs, counts);
        }
        self.count += other.count;
    }
}

/// Mean, `m2` and `m3` of two sets of values together [Pébay 2008].
fn merged(a: [f64; 3], b: [f64; 3], counts: (u64, u64)) -> [f64; 3] {
    match counts {
        (_, 0) => return a,
        (0, _) => return b,
        _ => {}
    }
    let (na, nb) = (counts.0 as f64, counts.1 as f64);
    let n = na + nb;
    let delta = b[0] - a[0];
    let share = delta * (nb / n);
    let square = delta * share * na;
    let cubed = square * delta * ((na - nb) / n) + 3.0 * delta * ((na * b[1] - nb * a[1]) / n);
    [a[0] + share, a[1] + b[1] + square, a[2] + b[2] + cubed]
}

/// Sums over some samples of a pixel. `None` for kinds that the film does not record ([`Sums`]).
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleSums {
    /// The number of samples.
    pub count: u64,
    /// The sum of `x ln x` per channel; 0 for a sample that is 0 [`Sums::LOG`].
    pub log: Option<[f64; 3]>,
    /// The sum of `sqrt x` per channel [`Sums::ROOT`].
    pub root: Option<[f64; 3]>,
    /// The moments of `2 (sqrt x - 1)` per channel [`Sums::ROOT_MOMENTS`].
    pub root_moments: Option<ThirdMoments>,
}

impl SampleSums {
    /// Adds all samples of `other`, which has the same kinds of sums.
    fn merge(&mut self, other: &Self) {
        for (to, from) in [(&mut self.log, &other.log), (&mut self.root, &other.root)] {
            if let (Some(to), Some(from)) = (to, from) {
                (0..3).for_each(|c| to[c] += from[c]);
            }
        }
        if let (Some(to), Some(from)) = (&mut self.root_moments, &other.root_moments) {
            to.merge(from);
        }
        self.count += other.count;
    }
}

/// The sums of a bank: for each pixel the kinds in the order of [`SampleSums`], [`Sums::values`] in all. Splats are not in
/// them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SumPlane {
    pub(crate) kinds: Sums,
    pub(crate) values: Vec<[f64; 3]>,
}

impl SumPlane {
    pub(super) fn new(pixels: usize, kinds: Sums) -> Self {
        Self { kinds, values: vec![[0.0; 3]; pixels * kinds.values()] }
    }

    /// A plane of other pixels, made by `change` from this plane's values and their number per pixel.
    pub(crate) fn with(&self, change: impl FnOnce(&[[f64; 3]], usize) -> Vec<[f64; 3]>) -> Self {
        Self { kinds: self.kinds, values: change(&self.values, self.kinds.values()) }
    }

    fn of(&self, count: u64, i: usize) -> SampleSums {
        let each = self.kinds.values();
        let mut values = self.values.get(i * each..(i + 1) * each).unwrap_or_default().iter().copied();
        let mut next = |kind: Sums| if self.kinds.contains(kind) { values.next() } else { None };
        let (log, root, mean) = (next(Sums::LOG), next(Sums::ROOT), next(Sums::ROOT_MOMENTS));
        let (m2, m3) = (next(Sums::ROOT_MOMENTS), next(Sums::ROOT_MOMENTS));
        let root_moments = match (mean, m2, m3) {
            (Some(mean), Some(m2), Some(m3)) => Some(ThirdMoments { count, mean, m2, m3 }),
            _ => None,
        };
        SampleSums { count, log, root, root_moments }
    }

    /// Moves the sums over the `counts.0` samples of pixel `i` to `other`, which has sums over `counts.1`.
    pub(super) fn give(&mut self, other: &mut Self, i: usize, counts: (u64, u64)) {
        let each = self.kinds.values();
        if self.values.is_empty() || other.values.is_empty() {
            return;
        }
        let (given, taken) = (self.of(counts.0, i), other.of(counts.1, i));
        let mut all = taken;
        all.merge(&given);
        let moments = all.root_moments.map(|m| [m.mean, m.m2, m.m3]);
        let values = [all.log, all.root].into_iter().flatten().chain(moments.into_iter().flatten());
        let places = &mut other.values[i * each..(i + 1) * each];
        places.iter_mut().zip(values).for_each(|(place, value)| *place = value);
        self.values[i * each..(i + 1) * each].fill([0.0; 3]);
    }

    pub(crate) fn rows(&mut self) -> SumRows<'_> {
        SumRows { kinds: self.kinds, values: &mut self.values }
    }
}

/// The sums over some pixels, which one task writes.
#[derive(Default)]
pub(crate) struct SumRows<'a> {
    pub(crate) kinds: Sums,
    pub(crate) values: &'a mut [[f64; 3]],
}

impl SumRows<'_> {
    /// Adds a sample; `count` includes it. Outlined because most films record no sums.
    #[inline(never)]
    pub(super) fn push(&mut self, local: usize, count: u64, radiance: [f32; 3]) {
        let each = self.kinds.values();
        let x = radiance.map(f64::from);
        let values = &mut self.values[local * each..(local + 1) * each];
        let mut next = 0;
        for (kind, of) in [(Sums::LOG, x_ln_x as fn(f64) -> f64), (Sums::ROOT, f64::sqrt)] {
            if self.kinds.contains(kind) {
                (0..3).for_each(|c| values[next][c] += of(x[c]));
                next += 1;
            }
        }
        let [mean, m2, m3] = &mut values[next..] else { return };
        let n = count as f64;
        for c in 0..3 {
            let delta = 2.0 * (x[c].sqrt() - 1.0) - mean[c];
            let share = delta / n;
            let square = delta * share * (n - 1.0);
            mean[c] += share;
            m3[c] += square * share * (n - 2.0) - 3.0 * share * m2[c];
            m2[c] += square;
        }
    }
}

/// `x ln x`, continued to 0 at 0. The same bits on every machine.
fn x_ln_x(x: f64) -> f64 {
    if x > 0.0 { x * libm::log(x) } else { 0.0 }
}

impl Film {
    /// The sums over all kept samples of pixel `i`, both halves together. Splats are not in them.
    pub fn sums(&self, i: usize) -> SampleSums {
        sums_of(&self.kept, self.held.at(i))
    }

    /// The sums over pixel `i`'s kept samples in half 0 or 1; `None` in a film without halves.
    pub fn half_sums(&self, half: usize, i: usize) -> Option<SampleSums> {
        (self.kept.len() == 2).then(|| sums_of(&self.kept[half & 1..=(half & 1)], self.held.at(i)))
    }

    /// The sums over pixel `i`'s discarded samples, withdrawn ones included; zero if there are none.
    pub fn discarded_sums(&self, i: usize) -> SampleSums {
        if self.discarded.is_empty() {
            let pixel = SumPlane::new(1, self.needs.sums);
            return pixel.of(0, 0);
        }
        sums_of(&self.discarded, self.held.at(i))
    }
}

/// The sums over pixel `i`'s samples in all `banks`, in the order of the banks.
fn sums_of(banks: &[Bank], i: usize) -> SampleSums {
    let mut all = banks[0].sums.of(banks[0].counts[i], i);
    banks[1..].iter().for_each(|bank| all.merge(&bank.sums.of(bank.counts[i], i)));
    all
}
