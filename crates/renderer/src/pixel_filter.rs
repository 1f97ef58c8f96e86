//! Importance sampling of the pixel filter. Each sample contributes to one pixel only, with weight 1.

use dapple_scene::PixelFilter;
use glam::Vec2;

/// A sampler of offsets from a pixel's centre, with a density proportional to the pixel filter.
#[derive(Clone, Debug)]
pub struct FilterSampler {
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Box {
        width: Vec2,
    },
    Triangle {
        radius: Vec2,
    },
    /// The inverse cumulative distribution of each axis, tabulated at equal steps.
    Table {
        axes: [Vec<f32>; 2],
    },
}

/// The number of steps of a tabulated inverse distribution. Linear interpolation has errors of about 1e-3 of the
/// radius.
const STEPS: usize = 1024;

impl FilterSampler {
    /// Makes the sampler of a filter. If a radius or sigma is not finite and positive, a box of one pixel is used instead;
    /// scene readers reject such filters.
    pub fn new(filter: &PixelFilter) -> Self {
        let usable = |r: &[f64; 2]| r.iter().all(|r| r.is_finite() && *r > 0.0);
        let vec = |r: [f64; 2]| Vec2::new(r[0] as f32, r[1] as f32);
        let kind = match *filter {
            PixelFilter::Box { radius } if usable(&radius) => Kind::Box { width: vec(radius) * 2.0 },
            PixelFilter::Triangle { radius } if usable(&radius) => Kind::Triangle { radius: vec(radius) },
            PixelFilter::Gaussian { radius, sigma } if usable(&radius) && sigma > 0.0 && sigma.is_finite() => {
                Kind::Table { axes: radius.map(|r| gaussian_inverse(r, sigma)) }
            }
            _ => Kind::Box { width: Vec2::ONE },
        };
        Self { kind }
    }

    /// Returns true for a box of one pixel, in which the random numbers equal the position in the pixel.
    pub fn is_one_pixel(&self) -> bool {
        matches!(self.kind, Kind::Box { width } if width == Vec2::ONE)
    }

    /// Returns the offset from the pixel's centre selected by the random numbers `u` in `[0, 1)^2`, in pixels.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec2 {
        match &self.kind {
            Kind::Box { width } => Vec2::new(u[0] - 0.5, u[1] - 0.5) * *width,
            Kind::Triangle { radius } => Vec2::new(tent(u[0]), tent(u[1])) * *radius,
            Kind::Table { axes } => Vec2::new(look_up(&axes[0], u[0]), look_up(&axes[1], u[1])),
        }
    }

    /// Returns the largest sampled offset from a pixel's centre, in pixels along each axis.
    pub fn radius(&self) -> Vec2 {
        match &self.kind {
            Kind::Box { width } => *width * 0.5,
            Kind::Triangle { radius } => *radius,
            Kind::Table { axes: [x, y] } => Vec2::new(x[STEPS].max(-x[0]), y[STEPS].max(-y[0])),
        }
    }

    /// Returns the density with which [`sample`](Self::sample) samples an offset, per square pixel.
    ///
    /// Light that reaches the image at this offset from a pixel's centre is added to the pixel with this weight.
    pub fn density(&self, offset: Vec2) -> f32 {
        match &self.kind {
            Kind::Box { width } => {
                let inside = |x: f32, width: f32| -0.5 * width <= x && x < 0.5 * width;
                if inside(offset.x, width.x) && inside(offset.y, width.y) { (width.x * width.y).recip() } else { 0.0 }
            }
            Kind::Triangle { radius } => {
                let relative = (Vec2::ONE - (offset / *radius).abs()).max(Vec2::ZERO) / *radius;
                relative.x * relative.y
            }
            Kind::Table { axes: [x, y] } => density_in(x, offset.x) * density_in(y, offset.y),
        }
    }
}

/// Returns the density at `x` of the distribution whose inverse is the linear interpolation of `table`; 0 outside its range.
fn density_in(table: &[f32], x: f32) -> f32 {
    let above = table.partition_point(|&edge| edge <= x);
    if above == 0 || above == table.len() {
        return 0.0;
    }
    (STEPS as f32 * (table[above] - table[above - 1])).recip()
}

/// Returns the inverse cumulative distribution of the tent (triangle) filter on [-1, 1] at `u`.
fn tent(u: f32) -> f32 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 * (1.0 - u)).sqrt() }
}

/// Tabulates the inverse cumulative distribution of `max(0, g(x) - g(r))` on [-r, r], for a Gaussian `g` and the
/// radius `r`.
fn gaussian_inverse(radius: f64, sigma: f64) -> Vec<f32> {
    let exponent = |x: f64| x * x / (2.0 * sigma * sigma);
    // g(x) - g(r) divided by g(0), without cancellation if sigma is large.
    let density = |x: f64| (-exponent(x)).exp() * -(exponent(x) - exponent(radius)).min(0.0).exp_m1();
    let cells = 16 * STEPS;
    let width = 2.0 * radius / cells as f64;
    let mut cumulative = vec![0.0];
    for k in 0..cells {
        let x = -radius + (k as f64 + 0.5) * width;
        cumulative.push(cumulative[k] + density(x));
    }
    let total = cumulative[cells];
    if total <= 0.0 {
        // The filter is narrower than a cell, so all of it is at the centre.
        return vec![0.0; STEPS + 1];
    }
    let mut cell = 0;
    let inverse = |k: usize| {
        let target = total * k as f64 / STEPS as f64;
        while cell + 1 < cells && cumulative[cell + 1] < target {
            cell += 1;
        }
        let step = cumulative[cell + 1] - cumulative[cell];
        let inside = if step > 0.0 { ((target - cumulative[cell]) / step).clamp(0.0, 1.0) } else { 0.0 };
        (-radius + (cell as f64 + inside) * width) as f32
    };
    (0..=STEPS).map(inverse).collect()
}

fn look_up(table: &[f32], u: f32) -> f32 {
    let place = u * STEPS as f32;
    let k = (place as usize).min(STEPS - 1);
    let t = place - k as f32;
    table[k] + (table[k + 1] - table[k]) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fraction of samples in a rectangle is the integral of the density, which has the filter's shape.
    #[test]
    fn samples_have_the_density_of_the_filters_shape() {
        let gaussian = |s: f64, r: f64| move |x: f64| (-x * x / (2.0 * s * s)).exp() - (-r * r / (2.0 * s * s)).exp();
        type Shape = Box<dyn Fn(f64) -> f64>;
        let cases: [(PixelFilter, f64, Shape); 4] = [
            (PixelFilter::Box { radius: [0.5, 0.5] }, 0.5, Box::new(|_| 1.0)),
            (PixelFilter::Triangle { radius: [2.0, 2.0] }, 2.0, Box::new(|x| 2.0 - x.abs())),
            (PixelFilter::Gaussian { radius: [1.5, 1.5], sigma: 0.5 }, 1.5, Box::new(gaussian(0.5, 1.5))),
            (PixelFilter::Gaussian { radius: [2.0, 2.0], sigma: 4.0 }, 2.0, Box::new(gaussian(4.0, 2.0))),
        ];
        let middles = |n: i32| (0..n).map(move |i| (f64::from(i) + 0.5) / f64::from(n));
        for (filter, radius, shape) in cases {
            let sampler = FilterSampler::new(&filter);
            assert!((sampler.radius() - radius as f32).abs().max_element() < 2e-3, "{filter:?}");
            // The distribution function along one axis, by fine summation; the table inverts from one side, mirrored to a
            // thousandth of the radius.
            let sum = |to: f64| middles(20_000).map(|u| shape((to + radius) * u - radius)).sum::<f64>() * (to + radius);
            for u in middles(100) {
                let [x, y] = sampler.sample([u, 1.0 - u].map(|u| u as f32)).to_array();
                let found = sum(f64::from(x)) / sum(radius);
                assert!((found - u).abs() < 1e-3, "{filter:?}, u = {u}: {x} has {found}");
                assert!((x + y).abs() < 1e-3 * radius as f32, "{filter:?}: {x} {y}");
            }
            for u in [0.0, 1.0 - f32::EPSILON / 2.0] {
                assert!(sampler.sample([u, u]).abs().max_element() <= radius as f32, "{filter:?}");
            }
            let mass = sum(radius) / 20_000.0;
            let (low, high, n) = (Vec2::new(-0.37, -0.3), Vec2::new(0.4, 0.21), 400);
            let grid = || middles(n).flat_map(|x| middles(n).map(move |y| Vec2::new(x as f32, y as f32)));
            let is_inside = |p: &Vec2| p.cmpge(low).all() && p.cmplt(high).all();
            let share = grid().map(|u| sampler.sample(u.to_array())).filter(is_inside).count() as f64;
            let mean = |of: &dyn Fn(Vec2) -> f64| grid().map(|u| of(low + (high - low) * u)).sum::<f64>();
            let area = f64::from((high - low).element_product());
            for integral in [
                mean(&|p| f64::from(sampler.density(p))),
                mean(&|p| shape(p.x.into()) * shape(p.y.into()) / (mass * mass)),
            ] {
                assert!((share - integral * area).abs() < 2e-3 * f64::from(n * n), "{filter:?}: {share} {integral}");
            }
            let beyond = radius as f32 + 0.1;
            assert_eq!(sampler.density(Vec2::new(beyond, 0.0)) + sampler.density(Vec2::new(0.0, -beyond)), 0.0);
        }
    }

    /// A very wide Gaussian becomes the parabola 1 - x^2. Invalid filters become a box.
    #[test]
    fn extreme_and_senseless_filters_stay_in_their_pixel() {
        for sigma in [1e-30, 1e-9, 1e9, 1e30] {
            let sampler = FilterSampler::new(&PixelFilter::Gaussian { radius: [1.0, 2.0], sigma });
            let [low, middle, high] = [0.1, 0.5, 0.9].map(|u| sampler.sample([u, u]));
            let spread = if sigma > 1.0 { 0.5..0.7 } else { 0.0..1e-3 };
            let is_spread = spread.contains(&high.x) && spread.contains(&-low.x);
            assert!(is_spread && middle.abs().max_element() < 2e-3, "sigma {sigma}: {low} {middle} {high}");
        }
        for filter in [
            PixelFilter::default(),
            PixelFilter::Box { radius: [0.0, 1.0] },
            PixelFilter::Triangle { radius: [f64::NAN, 1.0] },
            PixelFilter::Gaussian { radius: [1.0, 1.0], sigma: 0.0 },
            PixelFilter::Gaussian { radius: [f64::INFINITY, 1.0], sigma: 1.0 },
        ] {
            let found = FilterSampler::new(&filter).sample([0.25, 0.875]);
            assert_eq!(found, Vec2::new(-0.25, 0.375), "{filter:?}");
        }
    }
}
