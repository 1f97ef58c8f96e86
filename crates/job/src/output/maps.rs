//! Maps of a render (images of one per-pixel quantity) as PNG files.

use super::layers::depth;
use crate::WorldClusters;
use dapple_core::{Film, Filtered, film::Features};
use dapple_scene::image::{ImageError, encode_png_gray, encode_png_rgb, srgb_encode};

/// A map of one quantity in shades of gray, with the value that white represents.
#[derive(Clone, Debug, PartialEq)]
pub struct GrayMap {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The shades of all pixels, row by row from the top, from 0 (black) to 255 (white).
    pub values: Vec<u8>,
    /// The value that white represents, in the map's unit.
    pub white: f64,
}

impl GrayMap {
    /// Encodes the map as a PNG file.
    ///
    /// # Errors
    ///
    /// [`ImageError::Encode`] if the format cannot hold the map.
    pub fn png(&self) -> Result<Vec<u8>, ImageError> {
        encode_png_gray(self.size, &self.values)
    }
}

/// Returns, per pixel, the index of the cluster that the first sample hit, or `u32::MAX` if it hit nothing. `None` if
/// the film lacks [`Needs::surfaces`](dapple_core::Needs::surfaces).
pub fn cluster_ids(film: &Film, clusters: &WorldClusters) -> Option<Vec<u32>> {
    let of =
        |i: usize| film.surface(i).and_then(|[shape, primitive]| clusters.label(shape, primitive)).unwrap_or(u32::MAX);
    film.needs().surfaces.then(|| (0..film.frame().pixels()).map(of).collect())
}

/// Encodes cluster indices as a PNG file that shows each cluster in one colour, and pixels without a hit in black.
/// Several clusters may share a colour.
///
/// # Errors
///
/// [`ImageError::Encode`] if the format cannot hold the map.
pub fn cluster_map(size: [u32; 2], ids: &[u32]) -> Result<Vec<u8>, ImageError> {
    let colour = |&id: &u32| match id {
        u32::MAX => [0; 3],
        // Bytes of a hash, at least 56 each, so that only the background is black.
        _ => {
            let hash = (u64::from(id) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            [24, 36, 48].map(|shift| 56 + ((hash >> shift) % 200) as u8)
        }
    };
    encode_png_rgb(size, &ids.iter().map(colour).collect::<Vec<_>>())
}

/// A map of sample counts per pixel: white is the largest count, black is 0, shades are proportional.
pub fn sample_map(film: &Film) -> GrayMap {
    let counts = film.counts();
    let most = counts.iter().copied().max().unwrap_or(0);
    let shade = |n: &u64| (255.0 * *n as f64 / most.max(1) as f64).round() as u8;
    GrayMap { size: film.frame().size(), values: counts.iter().map(shade).collect(), white: most as f64 }
}

/// The radius in pixels of the square window over which [`error_map`] averages. Averaging is needed because the error
/// estimate of one pixel has only one degree of freedom.
const POOLED: usize = 2;

/// A map of the predicted relative error `sqrt(E / (V + 0.01))`. `E` is the predicted squared error and `V` the squared
/// pixel value, each a mean over 5x5 pixels. White is the 99th percentile, black is 0, shades are proportional. `None`
/// if the filter makes no error estimates.
pub fn error_map(filtered: &Filtered) -> Option<GrayMap> {
    let error = filtered.error.as_ref()?;
    let [w, h] = filtered.size.map(|n| n as usize);
    let square = |p: &[f32; 3]| p.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>() / 3.0;
    let mut relative = Vec::with_capacity(error.len());
    for y in 0..h {
        for x in 0..w {
            let (mut errors, mut squares, mut pixels) = (0.0, 0.0, 0.0);
            for i in window(y, h).flat_map(|y| window(x, w).map(move |x| y * w + x)) {
                errors += f64::from(error[i]);
                squares += square(&filtered.radiance[i]);
                pixels += 1.0;
            }
            relative.push((errors / (squares + 0.01 * pixels)).sqrt());
        }
    }
    let mut sorted: Vec<f64> = relative.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let white = sorted.get(sorted.len().saturating_sub(1) * 99 / 100).copied().unwrap_or(0.0);
    Some(GrayMap { size: filtered.size, values: shades(&relative, white), white })
}

/// A map of the mean length of each pixel's paths to the first non-specular surfaces, in the file's units. Black is 0.
/// White is the largest length, or a pixel without a hit. `unit` is the integrator's unit of length, in the file's units.
/// `None` if the film has no features.
pub fn depth_map(film: &Film, unit: f64) -> Option<GrayMap> {
    let depths = of_features(film, |f| f64::from(depth(f, unit)))?;
    let white = depths.iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max);
    Some(GrayMap { size: film.frame().size(), values: shades(&depths, white), white })
}

/// Encodes the mean albedo of each pixel's first non-specular surfaces as an sRGB PNG file. `None` if the film has no features.
///
/// # Errors
///
/// [`ImageError::Encode`] if the format cannot hold the map.
pub fn albedo_map(film: &Film) -> Option<Result<Vec<u8>, ImageError>> {
    let byte = |v: f32| (255.0 * srgb_encode(f64::from(v).clamp(0.0, 1.0))).round() as u8;
    let values = of_features(film, |f| f.albedo.map(byte))?;
    Some(encode_png_rgb(film.frame().size(), &values))
}

/// Encodes the mean shading normal of each pixel's first non-specular surfaces as a PNG file. Red, green and blue map x, y
/// and z from -1..=1 to 0..=255. Pixels without a hit are mid-gray. `None` if the film has no features.
///
/// # Errors
///
/// [`ImageError::Encode`] if the format cannot hold the map.
pub fn normal_map(film: &Film) -> Option<Result<Vec<u8>, ImageError>> {
    let byte = |v: f32| (127.5 + 127.5 * v.clamp(-1.0, 1.0)).round() as u8;
    let values = of_features(film, |f| f.normal.map(byte))?;
    Some(encode_png_rgb(film.frame().size(), &values))
}

/// Computes a value of each pixel from its features; `None` if the film has none.
fn of_features<T>(film: &Film, of: impl Fn(&Features) -> T) -> Option<Vec<T>> {
    let features = || (0..film.frame().pixels()).filter_map(|i| film.features(i));
    film.needs().features.then(|| features().map(|features| of(&features)).collect())
}

/// The indices from `0..length` that are at most [`POOLED`] pixels away from `at`.
fn window(at: usize, length: usize) -> std::ops::Range<usize> {
    at.saturating_sub(POOLED)..(at + POOLED + 1).min(length)
}

fn shades(values: &[f64], white: f64) -> Vec<u8> {
    // NaN and values above `white` are white.
    let shade = |v: &f64| match v / white {
        _ if *v == 0.0 => 0,
        share if share < 1.0 => (255.0 * share).round() as u8,
        _ => 255,
    };
    values.iter().map(shade).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Filter, Frame, Needs, Unfiltered};

    #[test]
    fn sample_maps_state_their_white() {
        let mut film = Film::new(Frame::new(3, 1).unwrap(), Needs::none());
        let empty = sample_map(&film);
        assert_eq!((empty.values, empty.white), (vec![0, 0, 0], 0.0));
        film.push(0, 0, [1.0; 3]);
        (0..4).for_each(|_| film.push(2, 0, [1.0; 3]));
        let map = sample_map(&film);
        assert_eq!((map.values, map.white), (vec![64, 0, 255], 4.0));
    }

    #[test]
    fn errors_are_relative_and_pooled() {
        let filtered = Filtered::new([4, 1], vec![[3.0; 3]; 4]).with_error(vec![9.01, 0.0, 0.0, 0.0]);
        let map = error_map(&filtered).unwrap();
        // Three of four windows reach the first pixel: 1/3, 1/4, 1/4 and none.
        assert!((map.white - 0.25_f64.sqrt()).abs() < 1e-6, "{}", map.white);
        assert_eq!(map.values, [255, 255, 255, 0]);
        assert_eq!(error_map(&Filtered::new(filtered.size, filtered.radiance)), None);
    }

    #[test]
    fn features_without_hits_are_gray_black_and_far() {
        let film = Film::new(Frame::new(1, 1).unwrap(), Needs::none());
        assert!(normal_map(&film).is_none() && albedo_map(&film).is_none() && depth_map(&film, 1.0).is_none());
        let film = Film::new(Frame::new(1, 1).unwrap(), Needs::none().with_features());
        assert_eq!(depth_map(&film, 1.0).unwrap().values, [255]);
        assert_eq!(normal_map(&film).unwrap().unwrap(), encode_png_rgb([1, 1], &[[128; 3]]).unwrap());
        assert_eq!(albedo_map(&film).unwrap().unwrap(), encode_png_rgb([1, 1], &[[0; 3]]).unwrap());
        assert!(error_map(&Unfiltered.apply(&film).unwrap()).is_none());
    }
}
