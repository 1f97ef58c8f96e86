//! The distribution by which one of several lights is selected.

use crate::shading::discrete::Discrete;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The distribution by which one of several lights is selected.
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
    /// Selection proportional to the lights' power.
    #[default]
    Power,
    /// Selection of every light with the same probability.
    Uniform,
    /// Learned while rendering, per cell of space and orientation, from the contributions of lights there
    /// ([`LightCells`](dapple_light_selection::LightCells)).
    ///
    /// Selection is proportional to power inside media, and with a single light. An environment map counts as its
    /// tiles, up to 32 or 36 lights.
    #[serde(alias = "cells")]
    Learned,
}

impl LightSelection {
    /// All variants, in the order of their documentation.
    pub const ALL: [Self; 3] = [Self::Power, Self::Uniform, Self::Learned];

    /// Returns the name on the command line.
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

/// The error of an unknown name of a [`LightSelection`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("light selection \"{name}\" is unknown; give {}", LightSelection::ALL.map(LightSelection::name).join(", "))]
pub struct UnknownLightSelection {
    name: String,
}

/// Parses a name; `cells` is an old alias of `learned`.
impl FromStr for LightSelection {
    type Err = UnknownLightSelection;

    fn from_str(name: &str) -> Result<Self, UnknownLightSelection> {
        match name {
            "cells" => Ok(Self::Learned),
            _ => Self::ALL
                .into_iter()
                .find(|selection| selection.name() == name)
                .ok_or_else(|| UnknownLightSelection { name: name.to_owned() }),
        }
    }
}

/// The number of values of a 24-bit random number.
const STEPS: u64 = 1 << 24;

/// Returns the distribution that selects lights proportionally to `powers`, each with a probability above 0.
///
/// Probabilities are whole multiples of 2^-24. Each light gets 2^-24, and the rest is distributed by power. A random
/// number of 24 bits thus selects each light exactly as often as its probability requires. Otherwise a light of share
/// 10^-12 would never be selected, and be missing from the image. Beyond 2^23 lights, shares are not rounded.
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
                // Rounded ends, not shares, add up to the whole.
                let end = (spare * (sum / total)).round().min(spare);
                let count = 1.0 + end - dealt;
                dealt = end;
                // At most 2^24: exact.
                count as f32
            };
            powers.iter().map(share).collect()
        }
        None => powers.iter().map(|p| (power(p) / total).max(1e-30) as f32).collect(),
    };
    // Neither fails: shares are positive numbers, and lights fewer than 2^32.
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
        assert_eq!(wrong, Err("light selection \"cell\" is unknown; give power, uniform, learned".to_owned()));
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
