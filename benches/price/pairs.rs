//! Ratios of times with a part over times without it, measured alternately.

use serde::Serialize;
use std::time::Instant;

/// The median of ratios, and an interval around it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// The median.
    pub median: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Number of pairs.
    pub pairs: usize,
    /// Confidence that the interval contains the median of all possible pairs, 0 to 1.
    pub confidence: f64,
}

impl Ratio {
    /// The median of at least one ratio, with an interval between order statistics. It holds for any distribution,
    /// since the number of ratios below the median is binomial [after David and Nagaraja 2003, section 7.1]. It is the
    /// narrowest with at least 95 %. Fewer than six ratios give the range from least to most.
    pub(crate) fn of(mut ratios: Vec<f64>) -> Self {
        ratios.sort_by(f64::total_cmp);
        let n = ratios.len();
        let middle = 0.5 * (ratios[(n - 1) / 2] + ratios[n / 2]);
        // P(fewer than k + 1 of n below the median), term by term.
        let mut term = 0.5_f64.powi(n as i32);
        let mut tail = term;
        let mut outside = 0;
        loop {
            let next = term * (n - outside) as f64 / (outside + 1) as f64;
            if 2.0 * (tail + next) > 0.05 || 2 * (outside + 1) >= n {
                break;
            }
            (term, tail, outside) = (next, tail + next, outside + 1);
        }
        let (low, high) = (ratios[outside], ratios[n - 1 - outside]);
        Self { median: middle, low, high, pairs: n, confidence: (1.0 - 2.0 * tail).max(0.0) }
    }
}

/// Ratios of pairs, each from one call. The pair's number decides which of the two goes first.
pub(crate) fn pairs<E>(count: usize, mut pair: impl FnMut(usize) -> Result<f64, E>) -> Result<Ratio, E> {
    Ok(Ratio::of((0..count).map(&mut pair).collect::<Result<_, _>>()?))
}

/// Seconds of both, the first one first if `number` is even. Drift thus affects both alike.
pub(crate) fn in_turn<E>(
    number: usize,
    with: impl FnOnce() -> Result<f64, E>,
    without: impl FnOnce() -> Result<f64, E>,
) -> Result<[f64; 2], E> {
    if number.is_multiple_of(2) {
        let with = with()?;
        return Ok([with, without()?]);
    }
    let without = without()?;
    Ok([with()?, without])
}

/// The seconds of some work.
pub(crate) fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    std::hint::black_box(work());
    start.elapsed().as_secs_f64()
}

/// The ratio of the whole to the whole without a part, which costs `part` more than its replacement.
pub(crate) fn of_whole(whole: f64, part: f64) -> f64 {
    // On a machine that stalls between two clock readings, the part may seem as long as the whole.
    whole / (whole - part).max(0.01 * whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_hold_their_median() {
        // From tables of the binomial: of 21 the sixth from both ends, 97.3 %; of 6 the ends, 96.9 %; of 9 the second.
        for (n, low, high, confidence) in [(21, 5, 15, 0.9734), (6, 0, 5, 0.96875), (9, 1, 7, 0.9609), (3, 0, 2, 0.75)]
        {
            let ratio = Ratio::of((0..n).rev().map(f64::from).collect());
            assert_eq!((ratio.low, ratio.high, ratio.pairs), (f64::from(low), f64::from(high), n as usize), "{n}");
            assert!((ratio.confidence - confidence).abs() < 1e-4, "{n}: {ratio:?}");
            assert_eq!(ratio.median, f64::from(n - 1) / 2.0);
        }
    }

    #[test]
    fn turns_alternate_and_parts_are_shares() {
        for number in 0..4 {
            let order = std::cell::RefCell::new(String::new());
            let note = |word: &str| {
                order.borrow_mut().push_str(word);
                Ok::<f64, ()>(0.0)
            };
            in_turn(number, || note("a"), || note("b")).unwrap();
            assert_eq!(*order.borrow(), if number % 2 == 0 { "ab" } else { "ba" });
        }
        assert_eq!((of_whole(1.0, 0.0), of_whole(1.0, 0.5), of_whole(1.0, -1.0)), (1.0, 2.0, 0.5));
    }
}
