//! Detection of hosts that draw the same random numbers in every part of a round.

use crate::{Frame, point_set::mix};
use std::collections::BTreeMap;

/// The number of first samples of a pixel that are kept of each part.
pub(super) const KEPT: u32 = 4;
/// So many pixels of an image are watched, or up to half as many. A power of two: no sample waits for a division.
const WATCHED: u64 = 512;
/// The number of pixels that must repeat, and none of them differ. Two samples of a pixel, one lit and one not, are the same again by
/// chance in one of 4 cases.
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

/// The first samples of watched pixels, and how many of them came again.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Repeats {
    firsts: Firsts,
    compared: u32,
    equal: u32,
}

impl Repeats {
    /// Compares the first samples of a part with those of earlier parts. Pixels whose samples are all equal tell nothing.
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

    /// The number of pixels of which all repeat; `None` if samples differ.
    pub(super) fn found(&self) -> Option<u32> {
        Some(self.equal).filter(|equal| *equal >= ENOUGH && *equal == self.compared)
    }
}
