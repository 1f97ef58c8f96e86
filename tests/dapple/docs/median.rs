//! The median filter.

use dapple_core::{Error, Film, Filter, Filtered};

/// The median of each channel over 3x3 pixels. Removes fireflies, and detail of one pixel.
///
/// Pixels without samples take the median of their neighbours, and are black where these have none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Median;

impl Filter for Median {
    fn name(&self) -> &str {
        "median"
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        let size = film.frame().size();
        let [width, height] = size.map(|n| n as usize);
        let median = |i: usize, channel: usize| {
            let (x, y) = (i % width, i / width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
            let mut values: Vec<f64> = pixels.filter(|&i| film.count(i) > 0).map(|i| film.mean(i)[channel]).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).map_or(0.0, |&v| v as f32)
        };
        let radiance = (0..width * height).map(|i| [0, 1, 2].map(|channel| median(i, channel))).collect();
        Ok(Filtered::new(size, radiance)) // its error is not known
    }
}

#[cfg(test)]
mod tests {
    use super::Median;

    #[test]
    fn median_conforms() {
        dapple_conformance::filter(|| Box::new(Median));
    }
}
