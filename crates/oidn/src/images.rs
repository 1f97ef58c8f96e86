//! Conversion of a film to OIDN's inputs, and of OIDN's output to an image.

use dapple_core::{Film, Filtered, film::luminance};

/// The least width and height of an image for OIDN. Below 16 pixels OIDN darkens constant images: a single pixel to 0.18.
const LEAST_SIDE: usize = 32;

/// The largest colour that OIDN gets, in units of the image's level. OIDN preserves the light of 4x4 pixels to 1 % at a
/// colour of 10^3 and to 7 % at 10^4, and doubles it at 10^10.
const BRIGHTEST: f64 = 1e4;

/// Radii in pixels of the windows in which a pixel without samples searches for pixels with samples.
const REACH: [usize; 3] = [1, 2, 4];

/// Colour, albedo and normal of a pixel.
type Values = [[f32; 3]; 3];

/// The inputs of OIDN, three floats per pixel.
pub(crate) struct Inputs {
    /// Width and height in pixels, at least [`LEAST_SIDE`] each.
    pub(crate) size: [usize; 2],
    pub(crate) color: Vec<f32>,
    pub(crate) albedo: Vec<f32>,
    pub(crate) normal: Vec<f32>,
    /// The power of two by which radiance was multiplied.
    scale: f64,
}

impl Inputs {
    /// The inputs for a film with features; `None` if the image is black.
    pub(crate) fn new(film: &Film) -> Option<Self> {
        let scale = scale(film)?;
        let inner = film.frame().size().map(|n| n as usize);
        let size = padded(inner);
        let room = || Vec::with_capacity(3 * size[0] * size[1]);
        let mut inputs = Self { size, color: room(), albedo: room(), normal: room(), scale };
        for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))) {
            let [color, albedo, normal] = values(film, inner, [mirrored(x, inner[0]), mirrored(y, inner[1])], scale);
            inputs.color.extend(color);
            inputs.albedo.extend(albedo);
            inputs.normal.extend(normal);
        }
        Some(inputs)
    }

    /// Converts OIDN's output to the film's image: crops it, scales it back, and adds the light that was withheld from OIDN.
    pub(crate) fn image(&self, film: &Film, output: &[f32]) -> Filtered {
        let size = film.frame().size();
        let width = size[0] as usize;
        let pixel = |i: usize| {
            let at = 3 * (i / width * self.size[0] + i % width);
            let mean = film.refined_mean(i);
            std::array::from_fn(|c| {
                let kept = (mean[c] * self.scale - BRIGHTEST).max(0.0);
                ((f64::from(output[at + c]) + kept) / self.scale).min(f64::from(f32::MAX)) as f32
            })
        };
        Filtered::new(size, (0..film.frame().pixels()).map(pixel).collect())
    }
}

/// The size of an image for OIDN: at least [`LEAST_SIDE`] on each side.
pub(crate) fn padded(size: [usize; 2]) -> [usize; 2] {
    size.map(|n| n.max(LEAST_SIDE))
}

/// The power of two that brings the geometric mean of the lit pixels' luminance closest to 1; `None` if none is lit.
fn scale(film: &Film) -> Option<f64> {
    let levels = (0..film.frame().pixels()).map(|i| luminance(film.refined_mean(i)));
    let (sum, lit) = levels.filter(|y| *y > 0.0).fold((0.0, 0.0), |(sum, lit), y| (sum + y.log2(), lit + 1.0));
    // The logarithm of a float is within -149 to 128.
    (lit > 0.0).then(|| 2.0_f64.powi(-(sum / lit).round() as i32))
}

/// The inputs of pixel `(x, y)`: its own, or the mean of the nearest pixels with samples.
fn values(film: &Film, [width, height]: [usize; 2], [x, y]: [usize; 2], scale: f64) -> Values {
    let own = y * width + x;
    if film.count(own) > 0 {
        return of_samples(film, own, scale);
    }
    for radius in REACH {
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
        let (mut sum, mut found) = (Values::default(), 0.0);
        for i in rows.flat_map(|y| columns.clone().map(move |x| y * width + x)).filter(|&i| film.count(i) > 0) {
            let values = of_samples(film, i, scale);
            sum.as_flattened_mut().iter_mut().zip(values.as_flattened()).for_each(|(sum, v)| *sum += v);
            found += 1.0;
        }
        if found > 0.0 {
            return sum.map(|values| values.map(|v| v / found));
        }
    }
    Values::default()
}

/// The inputs of a pixel with samples.
fn of_samples(film: &Film, i: usize, scale: f64) -> Values {
    let color = film.refined_mean(i).map(|v| (v * scale).min(BRIGHTEST) as f32);
    let Some(f) = film.features(i) else { return [color, [0.0; 3], [0.0; 3]] };
    let share = f.hits as f32 / f.samples.max(1) as f32;
    let albedo = f.albedo.map(|v| (v * share).clamp(0.0, 1.0));
    [color, albedo, f.normal.map(|v| (v * share).clamp(-1.0, 1.0))]
}

/// The index in `0..length` of the value at `at`, if the image is repeated with mirroring.
fn mirrored(at: usize, length: usize) -> usize {
    let at = at % (2 * length);
    if at < length { at } else { 2 * length - 1 - at }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Estimate, Frame, Needs};

    fn film(values: &[f32], width: u32) -> Film {
        let frame = Frame::new(width, values.len() as u32 / width).unwrap();
        let mut film = Film::new(frame, Needs::none().with_features());
        for (i, &v) in values.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            film.push_estimate(i, 0, &Estimate::new([v, 0.5 * v, 0.25 * v]));
        }
        film
    }

    #[test]
    fn places_beyond_the_image_are_mirrored() {
        assert_eq!((0..8).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [0, 1, 2, 2, 1, 0, 0, 1]);
        assert!((0..40).all(|i| mirrored(i, 1) == 0));
        let inputs = Inputs::new(&film(&[1.0, 2.0, 4.0, 8.0, 16.0, 32.0], 3)).unwrap();
        assert_eq!((inputs.size, inputs.color.len()), ([32, 32], 3 * 32 * 32));
        let red = |x: usize, y: usize| inputs.color[3 * (32 * y + x)] / inputs.color[0];
        assert_eq!(
            [red(1, 0), red(2, 0), red(3, 0), red(5, 0), red(0, 1), red(0, 2), red(1, 3)],
            [2.0, 4.0, 4.0, 1.0, 8.0, 8.0, 2.0]
        );
        let large = Inputs::new(&film(&[1.0; 40 * 3], 40)).unwrap();
        assert_eq!(large.size, [40, 32]);
    }

    /// Scaling is exact: an image of any unit gives the same inputs.
    #[test]
    fn radiance_is_scaled_to_a_level_of_one() {
        let values = [0.25_f32, 3.0, 0.0, 8.0];
        let inputs = Inputs::new(&film(&values, 2)).unwrap();
        for exponent in [-100, -30, 1, 90] {
            let factor = 2.0_f32.powi(exponent);
            let other = Inputs::new(&film(&values.map(|v| v * factor), 2)).unwrap();
            assert!(other.color == inputs.color && other.scale * f64::from(factor) == inputs.scale, "2^{exponent}");
        }
        let level = inputs.color.iter().fold(0.0_f32, |a, &b| a.max(b));
        assert!((4.0..16.0).contains(&level), "{level}");
        assert!(Inputs::new(&film(&[0.0; 4], 2)).is_none(), "black has no level");
    }

    /// Light that OIDN does not see stays in its pixel: with an output equal to the input, the image is the film's.
    #[test]
    fn light_above_the_bound_stays_in_its_pixel() {
        let mut values = [0.5_f32; 64];
        for (at, value) in [(9, 1e3), (20, 1e10), (33, 1e30), (63, f32::MAX)] {
            values[at] = value;
        }
        let film = film(&values, 8);
        let inputs = Inputs::new(&film).unwrap();
        let most = inputs.color.iter().fold(0.0_f32, |a, &b| a.max(b));
        assert_eq!(most, 1e4);
        let image = inputs.image(&film, &inputs.color);
        assert_eq!(image.size, [8, 8]);
        for (i, (found, expected)) in image.radiance.iter().zip(film.image()).enumerate() {
            let near = |c: usize| (found[c] - expected[c]).abs() <= 2e-7 * expected[c];
            assert!((0..3).all(near), "pixel {i}: {found:?} is not {expected:?}");
        }
        assert!(
            inputs.image(&film, &vec![f32::MAX; inputs.color.len()]).radiance.iter().flatten().all(|v| v.is_finite())
        );
        assert_eq!(image.error, None);
    }

    #[test]
    fn pixels_without_samples_take_the_nearest_samples() {
        let mut values = [f32::NAN; 256];
        (values[0], values[2]) = (1.0, 3.0);
        let inputs = Inputs::new(&film(&values, 16)).unwrap();
        let red = |x: usize, y: usize| inputs.color[3 * (32 * y + x)] / inputs.color[0];
        assert_eq!(
            [red(0, 0), red(1, 0), red(2, 0), red(3, 1), red(2, 2), red(0, 4), red(0, 5)],
            [1.0, 2.0, 3.0, 3.0, 2.0, 2.0, 0.0]
        );
    }
}
