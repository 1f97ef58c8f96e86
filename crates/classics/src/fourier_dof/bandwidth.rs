//! The image's bandwidth through a lens, the deviation of samples over the lens, and the surfaces that determine both.

use crate::windows::{beside, window_sums};
use dapple_core::{FirstHit, Frame, parallel};
use std::f64::consts::{PI, TAU};

dapple_core::options! {
    /// The parameters of the image's bandwidth, for [`FourierDof`](super::FourierDof) and [`Splat`](super::Splat).
    ///
    /// Discontinuities are borders between shapes, steps in depth, normal or albedo, and mirrors. A surface's own bandwidth is
    /// 1/2 cycle per pixel where its circle of confusion contains a discontinuity. Elsewhere it is the larger of two estimates:
    /// the frequency of the albedo texture, and `sqrt(k max(g, k))` for curvature `k` in radians per pixel and gloss `g = 1 -
    /// roughness`. For a circle of confusion of radius `r` pixels, the lens limits the bandwidth to `0.61 / r`, the first zero
    /// of the disk's transfer function. A discontinuity in front of the focal plane determines the bandwidth of all pixels that
    /// its circle of confusion covers.
    pub struct LensBandwidthOptions {
        /// Discontinuity: more than this many degrees between two pixels' normals, or between a tangent plane and the line joining both hits.
        pub angle: f64 = 10.0 => "10", |angle| angle > 0.0 && angle < 90.0, "above 0 and below 90 degrees";
        /// Discontinuity: two pixels' albedos differ by more than this.
        pub contrast: f64 = 0.1, |contrast| contrast > 0.0 && contrast <= 1.0, "above 0 and at most 1";
        /// Discontinuity: roughness below this value (a surface with sharp reflections).
        pub mirror: f64 = 0.1, |mirror| (0.0..=1.0).contains(&mirror), "0 to 1";
        /// Radius in pixels of the window over which albedo and normal differences are averaged.
        pub window: u32 = 8, |window| (1..=64).contains(&window), "1 to 64 pixels";
        /// Maximum bandwidth in cycles per pixel at a defocus radius of 1 pixel; 0.61 is the first zero of the disk's spectrum.
        pub zero: f64 = 0.61, |zero| zero > 0.0 && zero <= 4.0, "above 0 and at most 4";
        /// Minimum bandwidth in cycles per pixel.
        pub least: f64 = 0.015625, |least| (0.001..=0.5).contains(&least), "0.001 to 0.5 cycles per pixel";
        /// Maximum increase of (1 / bandwidth) from one pixel to the next, so that kernels do not reach across edges.
        pub growth: f64 = 1.0 => "1", |growth| growth > 0.0 && growth <= 64.0, "above 0 and at most 64";
    }
}

/// The squared difference of albedos that counts as rounding error.
const ROUNDING: f64 = 1e-8;

/// The largest bandwidth, half a cycle per pixel.
pub(super) const NYQUIST: f64 = 0.5;

/// The bandwidth of a frame's pixels, and the deviation of their samples over the lens.
pub(super) struct LensBandwidth {
    /// Cycles per pixel, up to 1/2.
    pub(super) bandwidth: Vec<f64>,
    /// The standard deviation over the lens in units of albedo; empty if it was not requested.
    pub(super) deviation: Vec<f64>,
}

/// A pixel's bandwidth, and the sinusoid that models its texture.
#[derive(Clone, Copy)]
struct Blur {
    bandwidth: f64,
    /// The radius of the largest circle of confusion on the pixel.
    radius: f64,
    /// The bandwidth that the surface would have without the lens.
    sharp: f64,
}

impl LensBandwidth {
    /// The peak memory in bytes per pixel while the bandwidth is computed.
    pub(super) const BYTES: usize = size_of::<Surface>() + 1 + 2 * 32 + 8 + 4 + 8 + size_of::<Blur>();

    /// Computes the bandwidth of the surfaces that `trace` hits. `normals` is the weight of normals in the deviation; `None`
    /// skips the deviation.
    pub(super) fn of(
        frame: &Frame,
        trace: &(dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync),
        options: &LensBandwidthOptions,
        normals: Option<f64>,
    ) -> Self {
        let size = frame.size().map(|n| n as usize);
        let surfaces = surfaces(frame, trace);
        let breaks = Breaks::new(size[0], &surfaces, options);
        let sharp = detail(size, &surfaces, &breaks, options.window as usize);
        let blurs = blurs(size, &surfaces, &breaks, &sharp, options);
        let inverse = blurs.iter().map(|blur| (1.0 / blur.bandwidth) as f32).collect();
        let grown = least_grown(size, inverse, options.growth as f32);
        let bandwidth = grown.iter().map(|&(inverse, _)| (1.0 / f64::from(inverse)).min(NYQUIST)).collect();
        let deviation = normals.map(|normals| deviations(size, &surfaces, &blurs, normals)).unwrap_or_default();
        Self { bandwidth, deviation }
    }
}

/// The bandwidth of each pixel's surface, estimated from its texture and shading, without breaks.
///
/// For a sinusoid, the ratio of squared second to squared first differences is `4 sin^2` of half its angular frequency.
fn detail(size: [usize; 2], surfaces: &[Surface], breaks: &Breaks, window: usize) -> Vec<f64> {
    let sums = window_sums(size, window, |i| {
        let mut sums = [0.0; 4];
        for [before, after] in [0, 1].into_iter().filter_map(|axis| breaks.unbroken(i, axis)) {
            let [before, here, after] = [before, i, after].map(|i| &surfaces[i]);
            for c in 0..3 {
                let [a, b, d] = [before, here, after].map(|s| f64::from(s.hit.albedo[c]));
                sums[0] += (a - 2.0 * b + d).powi(2);
                sums[1] += (d - b).powi(2);
                sums[2] += f64::from(after.hit.shading_normal[c] - here.hit.shading_normal[c]).powi(2);
            }
            sums[3] += 1.0;
        }
        sums
    });
    let of = |(&[second, first, turn, count], surface): (&[f64; 4], &Surface)| {
        if count == 0.0 {
            return 0.0;
        }
        let texture = libm::asin((second / (first + ROUNDING * count)).sqrt().min(2.0) * 0.5) / PI;
        let (curvature, gloss) = ((turn / count).sqrt(), 1.0 - f64::from(surface.hit.roughness).clamp(0.0, 1.0));
        texture.max((curvature * gloss.max(curvature)).sqrt()).min(NYQUIST)
    };
    parallel::map(surfaces.len(), |i| of((&sums[i], &surfaces[i])))
}

/// The least radius of the circles of confusion of the breaks at a pixel; infinite without breaks. A break has the circle of
/// its nearer side, which hides the other side. A mirror has the circle of its own surface.
fn edge(i: usize, surfaces: &[Surface], breaks: &Breaks, mirror: f64) -> f32 {
    let here = &surfaces[i];
    let reflection = (here.is_hit && f64::from(here.hit.roughness) < mirror).then(|| here.confusion.abs());
    let nearer = |j: usize| here.confusion.min(surfaces[j].confusion).abs();
    breaks.across(i).map(nearer).chain(reflection).fold(f32::INFINITY, f32::min)
}

/// The blur of each pixel, caused by its own surface or by a break in front of the focal plane whose circle covers the pixel.
fn blurs(
    size: [usize; 2],
    surfaces: &[Surface],
    breaks: &Breaks,
    detail: &[f64],
    options: &LensBandwidthOptions,
) -> Vec<Blur> {
    let edges: Vec<f32> = (0..surfaces.len()).map(|i| edge(i, surfaces, breaks, options.mirror)).collect();
    let is_edge = |i: usize| edges[i].is_finite();
    let among = |value: &dyn Fn(usize) -> Option<f32>| -> Vec<(f32, u32)> {
        least_grown(size, (0..surfaces.len()).map(|i| value(i).unwrap_or(f32::INFINITY)).collect(), 1.0)
    };
    let distance = among(&|i| is_edge(i).then_some(0.0));
    // Negative inside the circle of a break in front of the focal plane.
    let before = among(&|i| (surfaces[i].confusion < 0.0 && is_edge(i)).then_some(surfaces[i].confusion));
    let limit = |sharp: f64, radius: f64| if radius > 0.0 { sharp.min(options.zero / radius) } else { sharp };
    let of = |i: usize| {
        let own = f64::from(surfaces[i].confusion.abs());
        let is_crossed = own > 0.0 && f64::from(distance[i].0) <= own;
        let sharp = if is_crossed { NYQUIST } else { detail[i].max(options.least) };
        let at_edge = if is_edge(i) { limit(NYQUIST, f64::from(edges[i])) } else { 0.0 };
        let bandwidth = limit(sharp, own).max(at_edge);
        let (margin, source) = before[i];
        let radius = if margin < 0.0 { f64::from(surfaces[source as usize].confusion.abs()) } else { 0.0 };
        let blur = if radius > own {
            Blur { bandwidth: bandwidth.max(limit(NYQUIST, radius)), radius, sharp: NYQUIST }
        } else {
            Blur { bandwidth, radius: own, sharp }
        };
        Blur { bandwidth: blur.bandwidth.clamp(options.least, NYQUIST), ..blur }
    };
    parallel::map(surfaces.len(), of)
}

/// The variance over the lens of a sinusoid of amplitude 1, averaged over its phase. `x` is its angular frequency times the
/// radius of the circle of confusion.
fn variance_over_lens(x: f64) -> f64 {
    let kept = if x > 0.0 { 2.0 * libm::j1(x) / x } else { 1.0 };
    0.5 * (1.0 - kept * kept).max(0.0)
}

/// The standard deviation over the lens of a sinusoid with the surface's bandwidth. The sinusoid's variance over the image is
/// the variance of albedo, normals and coverage in the square around the circle of confusion.
fn deviations(size: [usize; 2], surfaces: &[Surface], blurs: &[Blur], normals: f64) -> Vec<f64> {
    let table = Prefix::new(size, |i| {
        let (surface, grey) = (&surfaces[i], surfaces[i].grey());
        let [x, y, z] = surface.hit.shading_normal.map(|n| f64::from(n) * normals.sqrt());
        let hit = f64::from(u8::from(surface.is_hit));
        [grey, x, y, z, hit, grey * grey + x * x + y * y + z * z + hit]
    });
    let of = |(i, blur): (usize, &Blur)| {
        if blur.radius == 0.0 {
            return 0.0;
        }
        let (count, sums) = table.around(i, (blur.radius.round() as usize).max(1));
        let squares = sums[..5].iter().map(|sum| sum * sum).sum::<f64>();
        let variance = ((sums[5] - squares / count) / count).max(0.0);
        (2.0 * variance * variance_over_lens(TAU * blur.sharp * blur.radius)).sqrt()
    };
    parallel::map(blurs.len(), |i| of((i, &blurs[i])))
}

/// A summed-area table: sums of values over all pixels above and to the left of each pixel.
struct Prefix {
    size: [usize; 2],
    /// One row and one column more than the image; the first ones are 0.
    sums: Vec<[f64; 6]>,
}

impl Prefix {
    fn new(size: [usize; 2], read: impl Fn(usize) -> [f64; 6]) -> Self {
        let [width, height] = size;
        let mut sums = vec![[0.0; 6]; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut row = [0.0; 6];
            for x in 0..width {
                row.iter_mut().zip(read(y * width + x)).for_each(|(sum, value)| *sum += value);
                let above = sums[y * (width + 1) + x + 1];
                sums[(y + 1) * (width + 1) + x + 1] = std::array::from_fn(|k| above[k] + row[k]);
            }
        }
        Self { size, sums }
    }

    /// The number of pixels at most `radius` columns and rows from pixel `i`, and the sums of their values.
    fn around(&self, i: usize, radius: usize) -> (f64, [f64; 6]) {
        let [width, height] = self.size;
        let range = |at: usize, end: usize| [at.saturating_sub(radius), (at + radius + 1).min(end)];
        let ([x0, x1], [y0, y1]) = (range(i % width, width), range(i / width, height));
        let [a, b, c, d] = [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].map(|[x, y]| &self.sums[y * (width + 1) + x]);
        (((x1 - x0) * (y1 - y0)) as f64, std::array::from_fn(|k| d[k] - b[k] - c[k] + a[k]))
    }
}

/// For each pixel `p`, the least of `values[q] + slope * distance(p, q)` over all pixels `q`, and the index of that `q`.
///
/// Distances are lengths of paths through neighbouring pixels, sides and corners. They are exact along rows, columns and
/// diagonals, and at most 8.3 % above the straight line. Infinite values are ignored.
fn least_grown([width, height]: [usize; 2], values: Vec<f32>, slope: f32) -> Vec<(f32, u32)> {
    let mut field: Vec<(f32, u32)> = values.into_iter().zip(0..).collect();
    let (side, corner) = (slope, slope * std::f32::consts::SQRT_2);
    // The neighbours that a sweep from the top left visits first; mirrored for a sweep from the bottom right.
    let before = [([-1, 0], side), ([0, -1], side), ([-1, -1], corner), ([1, -1], corner)];
    let places = 0..width * height;
    for (sign, i) in places.clone().map(|i| (1, i)).chain(places.rev().map(|i| (-1, i))) {
        for (offset, step) in before {
            let Some(near) = beside([width, height], i, offset.map(|d: isize| sign * d)) else { continue };
            if field[near].0 + step < field[i].0 {
                field[i] = (field[near].0 + step, field[near].1);
            }
        }
    }
    field
}

/// The surface seen through a pixel's centre.
#[derive(Clone, Copy)]
struct Surface {
    is_hit: bool,
    /// The hit; without one, all values that are read are 0.
    hit: FirstHit,
    /// The radius of the circle of confusion in pixels, negative in front of the focal plane; finite.
    confusion: f32,
}

impl Surface {
    /// The surface that a first-hit ray found. A hit with NaN or infinite values counts as a miss, and radii are at most
    /// `largest`.
    fn new((hit, confusion): (Option<FirstHit>, f32), largest: f32) -> Self {
        let none = FirstHit::new([0.0; 3], [0.0; 3], 0.0).with_albedo([0.0; 3]).with_roughness(0.0);
        let hit = hit.filter(|hit| {
            let values = [hit.position, hit.shading_normal, hit.albedo, [hit.roughness; 3]];
            values.iter().flatten().all(|v| v.is_finite())
        });
        let confusion = if confusion.is_nan() { 0.0 } else { confusion.clamp(-largest, largest) };
        Self { is_hit: hit.is_some(), hit: hit.unwrap_or(none), confusion }
    }

    /// The mean albedo of the three channels.
    fn grey(&self) -> f64 {
        self.hit.albedo.iter().map(|&a| f64::from(a)).sum::<f64>() / 3.0
    }
}

/// The surfaces of a frame's pixels, traced in parallel.
fn surfaces(frame: &Frame, trace: &(dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync)) -> Vec<Surface> {
    let [width, height] = frame.size().map(|n| n as f32);
    let largest = width + height;
    parallel::map(frame.pixels(), |i| Surface::new(trace(frame.pixel(i)), largest))
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The breaks between neighbouring pixels: edges and steps of surfaces, and sharp textures.
struct Breaks {
    width: usize,
    /// Bit 0: a break towards the pixel on the right. Bit 1: towards the pixel below. Bits 2 and 3: that pixel does not exist.
    bits: Vec<u8>,
}

impl Breaks {
    fn new(width: usize, surfaces: &[Surface], options: &LensBandwidthOptions) -> Self {
        let (sine, cosine) = (libm::sin(options.angle.to_radians()), libm::cos(options.angle.to_radians()));
        let limits = [sine as f32, cosine as f32, options.contrast as f32];
        let bits = |(i, here): (usize, &Surface)| {
            let right =
                if !(i + 1).is_multiple_of(width) { u8::from(is_break(here, &surfaces[i + 1], limits)) } else { 4 };
            right | surfaces.get(i + width).map_or(8, |below| u8::from(is_break(here, below, limits)) << 1)
        };
        Self { width, bits: parallel::map(surfaces.len(), |i| bits((i, &surfaces[i]))) }
    }

    /// The pixels before and after pixel `i` along axis 0 or 1, if no break separates them; `None` at breaks and borders.
    fn unbroken(&self, i: usize, axis: u8) -> Option<[usize; 2]> {
        let step = if axis == 0 { 1 } else { self.width };
        let before = i.checked_sub(step)?;
        let open = |i: usize| self.bits[i] & (0b101 << axis) == 0;
        (open(before) && open(i)).then_some([before, i + step])
    }

    /// The direct neighbours of pixel `i` beyond a break.
    fn across(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, bits) = (self.width, self.bits[i]);
        let left = !i.is_multiple_of(width) && self.bits[i - 1] & 1 > 0;
        let above = i >= width && self.bits[i - width] & 2 > 0;
        let [left, above] = [left.then(|| i - 1), above.then(|| i - width)];
        let [right, below] = [(bits & 1 > 0).then_some(i + 1), (bits & 2 > 0).then_some(i + width)];
        [left, above, right, below].into_iter().flatten()
    }
}

/// Returns `true` between different shapes and at steps in depth, normal or albedo. `limits` are the sine and cosine of the
/// largest angle, and the largest difference of albedo.
fn is_break(a: &Surface, b: &Surface, [sine, cosine, contrast]: [f32; 3]) -> bool {
    if a.is_hit != b.is_hit || a.hit.shape != b.hit.shape {
        return true;
    }
    if !a.is_hit {
        return false;
    }
    let (a, b) = (&a.hit, &b.hit);
    let apart: [f32; 3] = std::array::from_fn(|k| b.position[k] - a.position[k]);
    // A step: the offset leaves the tangent plane at a large angle.
    let rise = dot(apart, a.shading_normal).abs().max(dot(apart, b.shading_normal).abs());
    let is_step = rise > sine * dot(apart, apart).sqrt();
    let is_texture = a.albedo.iter().zip(b.albedo).any(|(a, b)| (a - b).abs() > contrast);
    is_step || dot(a.shading_normal, b.shading_normal) < cosine || is_texture
}
