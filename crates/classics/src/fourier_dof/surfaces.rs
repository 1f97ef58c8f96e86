//! The surfaces behind the centres of pixels and lens, and the breaks between neighbours.

use super::LensBandwidthOptions;
use dapple_core::{FirstHit, Frame};
use rayon::prelude::*;

/// The surface behind a pixel's centre. Without a hit all but the circle of confusion is 0.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Surface {
    pub(super) is_hit: bool,
    pub(super) position: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) albedo: [f32; 3],
    pub(super) roughness: f32,
    pub(super) shape: u32,
    /// The radius of the circle of confusion in pixels, negative in front of the plane in focus; finite.
    pub(super) confusion: f32,
}

impl Surface {
    /// The surface of a probe. Hits with a NaN or an infinity count as none, and radii are at most `largest`.
    fn new((hit, confusion): (Option<FirstHit>, f32), largest: f32) -> Self {
        let confusion = if confusion.is_nan() { 0.0 } else { confusion.clamp(-largest, largest) };
        let Some(hit) = hit else { return Self { confusion, ..Self::default() } };
        let values = [hit.position, hit.shading_normal, hit.albedo, [hit.roughness; 3]];
        if !values.iter().flatten().all(|v| v.is_finite()) {
            return Self { confusion, ..Self::default() };
        }
        Self {
            is_hit: true,
            position: hit.position,
            normal: hit.shading_normal,
            albedo: hit.albedo,
            roughness: hit.roughness,
            shape: hit.shape,
            confusion,
        }
    }

    /// The mean albedo of the three channels.
    pub(super) fn grey(&self) -> f64 {
        self.albedo.iter().map(|&a| f64::from(a)).sum::<f64>() / 3.0
    }
}

/// The surfaces of a frame's pixels, traced in parallel.
pub(super) fn surfaces(
    frame: &Frame,
    trace: &(dyn Fn([u32; 2]) -> (Option<FirstHit>, f32) + Send + Sync),
) -> Vec<Surface> {
    let [width, height] = frame.size().map(|n| n as f32);
    let largest = width + height;
    (0..frame.pixels()).into_par_iter().map(|i| Surface::new(trace(frame.pixel(i)), largest)).collect()
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The breaks between neighbouring pixels: the surface's edges, steps and sharp textures.
pub(super) struct Breaks {
    width: usize,
    /// Bit 0: a break to the pixel on the right. Bit 1: a break to the one below. Bits 2 and 3: there is no such pixel.
    bits: Vec<u8>,
}

impl Breaks {
    pub(super) fn new(width: usize, surfaces: &[Surface], options: &LensBandwidthOptions) -> Self {
        let (sine, cosine) = (libm::sin(options.angle.to_radians()), libm::cos(options.angle.to_radians()));
        let limits = [sine as f32, cosine as f32, options.contrast as f32];
        let bits = |(i, here): (usize, &Surface)| {
            let right =
                if !(i + 1).is_multiple_of(width) { u8::from(is_break(here, &surfaces[i + 1], limits)) } else { 4 };
            right | surfaces.get(i + width).map_or(8, |below| u8::from(is_break(here, below, limits)) << 1)
        };
        Self { width, bits: surfaces.par_iter().enumerate().with_min_len(1024).map(bits).collect() }
    }

    /// The pixels before and after pixel `i` along axis 0 or 1 on a surface without a break; `None` at breaks and borders.
    pub(super) fn unbroken(&self, i: usize, axis: u8) -> Option<[usize; 2]> {
        let step = if axis == 0 { 1 } else { self.width };
        let before = i.checked_sub(step)?;
        let open = |i: usize| self.bits[i] & (0b101 << axis) == 0;
        (open(before) && open(i)).then_some([before, i + step])
    }

    /// The pixels beside pixel `i`, of four, across a break.
    pub(super) fn across(&self, i: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, bits) = (self.width, self.bits[i]);
        let left = !i.is_multiple_of(width) && self.bits[i - 1] & 1 > 0;
        let above = i >= width && self.bits[i - width] & 2 > 0;
        let [left, above] = [left.then(|| i - 1), above.then(|| i - width)];
        let [right, below] = [(bits & 1 > 0).then_some(i + 1), (bits & 2 > 0).then_some(i + width)];
        [left, above, right, below].into_iter().flatten()
    }
}

/// Returns `true` between different shapes, across steps in depth, turns of the normal, and steps of the albedo. `limits` are
/// the sine and cosine of the largest angle, and the largest step of the albedo.
fn is_break(a: &Surface, b: &Surface, [sine, cosine, contrast]: [f32; 3]) -> bool {
    if a.is_hit != b.is_hit || a.shape != b.shape {
        return true;
    }
    if !a.is_hit {
        return false;
    }
    let apart: [f32; 3] = std::array::from_fn(|k| b.position[k] - a.position[k]);
    // A step leaves the tangent plane at an angle.
    let rise = dot(apart, a.normal).abs().max(dot(apart, b.normal).abs());
    let is_step = rise > sine * dot(apart, apart).sqrt();
    let is_texture = a.albedo.iter().zip(b.albedo).any(|(a, b)| (a - b).abs() > contrast);
    is_step || dot(a.normal, b.normal) < cosine || is_texture
}
