//! Detection of hosts that repeat the same random numbers in every part of a round.

use crate::{Frame, point_set::mix};
use std::collections::BTreeMap;

/// The number of samples per watched pixel that are kept from the start of each part.
pub(super) const KEPT: u32 = 4;
/// The maximum number of watched pixels in an image; at least half as many are watched. The selection is by a power of two,
/// so that no sample needs a division.
const WATCHED: u64 = 512;
/// The minimum number of compared pixels for an error, if all of them repeat. Two samples of a pixel, one lit and one
/// not, repeat by chance in 1 of 4 cases.
const ENOUGH: u32 = 16;

/// The first samples of some pixels in one part of a round.
pub(super) type Firsts = BTreeMap<[u32; 2], Vec<[f32; 3]>>;

/// Keeps the radiance of one of a pixel's first samples, if the pixel is watched.
pub(super) fn watch(firsts: &mut Firsts, frame: &Frame, pixel: [u32; 2], radiance: [f32; 3]) {
    let [width, height] = frame.resolution().map(u64::from);
    let number = u64::from(pixel[1]) * width + u64::from(pixel[0]);
    if mix(number) & ((width * height / WATCHED).max(1).next_power_of_two() - 1) == 0 {
        firsts.entry(pixel).or_default().push(radiance);
    }
}

/// The first samples of watched pixels, and the number of pixels whose samples repeat.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Repeats {
    firsts: Firsts,
    compared: u32,
    equal: u32,
}

impl Repeats {
    /// Compares the first samples of a part with those of earlier parts. Pixels whose samples are all equal are ignored.
    pub(super) fn add(&mut self, part: Firsts) {
        for (pixel, values) in part {
            let before = self.firsts.entry(pixel).or_default();
            let n = before.len().min(values.len());
            if before[..n].iter().any(|value| *value != before[0]) {
                self.compared += 1;
                self.equal += u32::from(before[..n] == values[..n]);
            }
            if values.len() > before.len() {
                *before = values;
            }
        }
    }

    /// The number of compared pixels if the samples of all repeat; `None` if any differ or too few were compared.
    pub(super) fn found(&self) -> Option<u32> {
        Some(self.equal).filter(|equal| *equal >= ENOUGH && *equal == self.compared)
    }
}
