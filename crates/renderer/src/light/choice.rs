//! Which of several lights is sampled.

use crate::shading::discrete::Discrete;

/// How a light is chosen among several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightChoice {
    /// With probability proportional to its power.
    #[default]
    Power,
    /// Each as often as any other.
    Uniform,
    /// With probabilities that are learned while rendering, per cell of space and orientation, from what lights
    /// contributed there ([`LightCells`](dapple_light_selection::LightCells)); by power where nothing can be learned:
    /// inside media, and with a single light. An environment that is an image counts as its parts, up to 32 or 36 lights.
    Cells,
}

/// Different values of a coordinate of the point sets: they have 24 bits.
const STEPS: u64 = 1 << 24;

/// The distribution that chooses lights proportionally to `powers`, each with a probability above 0.
///
/// All probabilities are whole multiples of 2^-24, of which every light gets one before the rest is dealt out by
/// power. A coordinate of 24 bits then chooses each light exactly as often as its probability says: a light with a
/// share of 10^-12 would otherwise never be chosen, and its light be missing from the image. Beyond 2^23 lights
/// there are not enough values to go round, and shares are what they are.
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
