//! The probability distribution by which one of several lights is selected for sampling.

use crate::shading::discrete::Discrete;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The probability distribution by which the renderer selects one of several lights to sample.
///
/// # Examples
///
/// ```
/// use dapple_renderer::light::LightSelection;
///
/// assert_eq!("learned".parse(), Ok(LightSelection::Learned));
/// assert_eq!(LightSelection::Power.to_string(), "power");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightSelection {
    /// A probability proportional to each light's power.
    #[default]
    Power,
    /// The same probability for every light.
    Uniform,
    /// Probabilities learned while rendering, per cell of space and orientation, from the lights' measured
    /// contributions ([`LightCells`](dapple_light_selection::LightCells)).
    ///
    /// Inside media, and with a single light, the selection stays proportional to power. Each tile of an environment
    /// map is a light of its own: up to 36 tiles for a square map, up to 32 otherwise.
    #[serde(alias = "cells")]
    Learned,
}

impl LightSelection {
    /// All kinds of light selection, the default first.
    pub const ALL: [Self; 3] = [Self::Power, Self::Uniform, Self::Learned];

    /// Returns the name on the command line, such as "power".
    pub const fn name(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::Uniform => "uniform",
            Self::Learned => "learned",
        }
    }
}

impl fmt::Display for LightSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The error of an unknown [`LightSelection`] name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("light selection \"{name}\" is unknown; use one of {}", LightSelection::ALL.map(LightSelection::name).join(", "))]
pub struct UnknownLightSelection {
    name: String,
}

/// Parses the name of a light selection; `cells` is an old alias of `learned`.
impl FromStr for LightSelection {
    type Err = UnknownLightSelection;

    fn from_str(name: &str) -> Result<Self, UnknownLightSelection> {
        let known = Self::ALL.into_iter().find(|selection| selection.name() == name);
        let known = known.or((name == "cells").then_some(Self::Learned));
        known.ok_or_else(|| UnknownLightSelection { name: name.to_owned() })
    }
}

/// The number of values of a 24-bit random number.
const STEPS: u64 = 1 << 24;

/// Returns the distribution that selects lights in proportion to `powers`, with a positive probability for each.
///
/// Probabilities are multiples of 2^-24: each light gets 2^-24, and the rest is distributed by power. A random number of 24
/// bits therefore selects each light exactly as often as its probability states. Otherwise a light with a probability of
/// 10^-12 would never be selected, and its light would be missing from the image. With more than 2^23 lights, probabilities
/// are not rounded.
pub(super) fn by_power(powers: &[f64]) -> Discrete {
    let total: f64 = powers.iter().sum();
    let sound = total > 0.0 && total.is_finite();
    let power = |p: &f64| if sound { *p } else { 1.0 };
    let total = if sound { total } else { powers.len() as f64 };
    let shares: Vec<f32> = match STEPS.checked_sub(2 * powers.len() as u64) {
        Some(_) => {
            let spare = (STEPS - powers.len() as u64) as f64;
            let (mut sum, mut dealt) = (0.0, 0.0);
            let share = |p: &f64| {
                sum += power(p);
                // Cumulative probabilities are rounded, so that the sum stays exact.
                let end = (spare * (sum / total)).round().min(spare);
                let count = 1.0 + end - dealt;
                dealt = end;
                // The count is at most 2^24 and therefore exact in f32.
                count as f32
            };
            powers.iter().map(share).collect()
        }
        None => powers.iter().map(|p| (power(p) / total).max(1e-30) as f32).collect(),
    };
    // Construction cannot fail: all weights are positive, and there are fewer than 2^32 lights.
    Discrete::new(&shares).unwrap_or_else(|_| unreachable!("shares are weights"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_an_unknown_one_is_refused() {
        for selection in LightSelection::ALL {
            assert_eq!(selection.to_string().parse(), Ok(selection));
        }
        assert_eq!("cells".parse(), Ok(LightSelection::Learned));
        let wrong = "cell".parse::<LightSelection>().map_err(|e| e.to_string());
        assert_eq!(wrong, Err("light selection \"cell\" is unknown; use one of power, uniform, learned".to_owned()));
    }

    #[test]
    fn probabilities_are_whole_multiples_and_add_up() {
        let many: Vec<f64> = (0..1000).map(|i| f64::from(i % 7) * 10_f64.powi(i % 31 - 15)).collect();
        for powers in [vec![1.0, 3.0], vec![0.0; 5], vec![1.0, 1e-30, 1e30], vec![f64::INFINITY, 1.0], many] {
            let choice = by_power(&powers);
            let counts: Vec<f64> = (0..powers.len()).map(|i| f64::from(choice.pmf(i)) * STEPS as f64).collect();
            assert!(counts.iter().all(|c| *c >= 1.0 && c.fract() == 0.0), "{powers:?}: {counts:?}");
            assert_eq!(counts.iter().sum::<f64>(), STEPS as f64);
        }
        let quarter = by_power(&[1.0, 3.0]);
        assert!((quarter.pmf(0) - 0.25).abs() <= 2.0 / STEPS as f32 && quarter.pmf(0) + quarter.pmf(1) == 1.0);
        assert_eq!(by_power(&[0.1]).pmf(0), 1.0);
    }
}
