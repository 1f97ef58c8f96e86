//! The colour scales of error maps and sample maps.

/// The ends of the error map's colour scale: the exponents of powers of ten of the relative squared error.
const ERROR_DECADES: [f64; 2] = [-4.0, 0.0];

/// A colour scale: the colours at 0, 1/4, 1/2, 3/4 and 1, in 8-bit sRGB. The lightness rises, so that it can be read in
/// black and white and by the colour-blind.
type Colours = [[f64; 3]; 5];

/// The colours of error maps [after van der Walt 2015, matplotlib's `inferno`].
const ERRORS: Colours =
    [[0.0, 0.0, 4.0], [87.0, 16.0, 110.0], [188.0, 55.0, 84.0], [249.0, 142.0, 9.0], [252.0, 255.0, 164.0]];

/// The colours of sample maps [after van der Walt 2015, matplotlib's `viridis`].
const SAMPLES: Colours =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// The colour of a relative squared error.
pub(super) fn error_colour(error: f64) -> [u8; 3] {
    colour(&ERRORS, error_place(error))
}

fn error_place(error: f64) -> f64 {
    let [low, high] = ERROR_DECADES;
    if error > 0.0 { ((libm::log10(error) - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 }
}

/// The colour of a number of samples on a scale from 0 to `most`, by the logarithm of 1 more than the number.
pub(super) fn sample_colour(count: f64, most: f64) -> [u8; 3] {
    colour(&SAMPLES, sample_place(count, most))
}

fn sample_place(count: f64, most: f64) -> f64 {
    (libm::log1p(count.max(0.0)) / libm::log1p(most.max(1.0))).clamp(0.0, 1.0)
}

fn colour(colours: &Colours, share: f64) -> [u8; 3] {
    let last = colours.len() - 1;
    let place = share * last as f64;
    let below = (place as usize).min(last - 1);
    let t = place - below as f64;
    std::array::from_fn(|c| {
        let [a, b] = [colours[below][c], colours[below + 1][c]];
        (a + t * (b - a)).round() as u8
    })
}

/// The ticks of the error scale: text, and place in percent.
pub(super) fn error_ticks() -> Vec<(String, f64)> {
    [("≤ 10⁻⁴", 1e-4), ("0.01", 1e-2), ("≥ 1", 1.0)]
        .map(|(text, error)| (text.to_owned(), 100.0 * error_place(error)))
        .to_vec()
}

/// The ticks of a sample scale from 0 to `most`: text, and place in percent. Besides the ends, powers of 4 that leave
/// room for their text.
pub(super) fn sample_ticks(most: f64) -> Vec<(String, f64)> {
    let tick = |count: f64| (count.round().to_string(), 100.0 * sample_place(count, most));
    let mut ticks = vec![tick(0.0)];
    for count in (1..16).map(|power| libm::pow(4.0, f64::from(power))) {
        let place = 100.0 * sample_place(count, most);
        let last = ticks.last().map_or(0.0, |(_, place)| *place);
        if count < most && place - last >= 20.0 && place <= 80.0 {
            ticks.push(tick(count));
        }
    }
    ticks.push(tick(most));
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_begin_and_end_at_their_colours() {
        assert_eq!((error_colour(0.0), error_colour(7.0)), ([0, 0, 4], [252, 255, 164]));
        assert_eq!((sample_colour(0.0, 64.0), sample_colour(64.0, 64.0)), ([68, 1, 84], [253, 231, 37]));
        let ticks = sample_ticks(100.0);
        assert_eq!((ticks[0].0.as_str(), ticks.last().map(|t| t.0.as_str())), ("0", Some("100")));
        assert!(ticks.windows(2).all(|pair| pair[0].1 + 15.0 < pair[1].1), "{ticks:?}");
    }
}
