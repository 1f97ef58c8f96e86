//! Environment maps: packed texels, and the sampling of directions by their luminance.

use super::environment::{radiance_error, valid};
use crate::SceneError;
use crate::shading::discrete::{BELOW_ONE, PiecewiseConstant2d};
use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use crate::shading::{Error, warp};
use dapple_scene::Source;
use dapple_scene::image::Image;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// An environment map. Radiance is constant within a texel, as in pbrt-v4, so that the sampling density is exact.
///
/// Light sampling first selects a block of texels by a table small enough for the processor's cache. It then selects a texel
/// of the block by luminance, which reads one more cache line. The density of a direction depends on its texel only.
#[derive(Clone, Debug)]
pub(super) struct Map {
    layout: Layout,
    size: [u32; 2],
    scale: f32,
    texels: Texels,
    /// The image, if the packed texels differ from it. The packed texels then provide only the density, and the image the
    /// radiance.
    image: Option<Arc<Image>>,
    /// The whole map as one part.
    pub(super) whole: Part,
    /// The mean luminance of the map over the sphere of directions.
    pub(super) average: f64,
}

/// The parametrisation of the sphere of directions by the image: latitude and longitude, or equal-area octahedral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    LatLong,
    EqualArea,
}

/// A rectangular region of a map, in whole blocks, which can be sampled separately.
#[derive(Clone, Debug)]
pub(super) struct Part {
    cells: PiecewiseConstant2d,
    /// The column and row of the part's first block.
    first: [usize; 2],
    /// The probability that a sample of the whole map falls into this part.
    pub(super) share: f64,
}

/// The radiance of a map from a direction, and the direction's density and block.
pub(super) struct MapLight {
    pub(super) radiance: Vec3,
    /// The solid-angle density with which the whole map samples the direction.
    pub(super) pdf: f32,
    /// The column and row of the direction's block.
    pub(super) block: [usize; 2],
}

/// The smallest sampling weight of a texel, as a fraction of its luminance.
const LEAST: f32 = 0.125;
/// The number of texels along the side of a block.
const SIDE: usize = 4;

/// 4 x 4 texels, row by row, in one cache line. A texel has one byte per channel and, in the highest byte, the biased exponent
/// of their common factor, as in Radiance HDR files. Blocks at the edge of the image are padded with black.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Block([[u32; SIDE]; SIDE]);

/// The packed texels of a map, and the density with which they are sampled.
///
/// The density is proportional to the luminance minus its mean [Karlik et al. 2019]. BSDF sampling, combined with it by
/// multiple importance sampling, finds the uniform part of the light well. [`LEAST`] keeps the density of texels that emit
/// light positive, for methods that sample only lights.
#[derive(Clone, Debug)]
struct Texels {
    blocks: Vec<Block>,
    /// The numbers of blocks across and down.
    count: [usize; 2],
    /// The density over the unit square of a texel of weight 1, for each row of texels. Rows are grouped by rows of blocks.
    shares: Vec<[f32; SIDE]>,
    /// The mean luminance over the sphere of directions.
    mean: f32,
}

impl Map {
    /// Prepares a map. Returns `None` if it is black.
    pub(super) fn new(layout: Layout, image: &Arc<Image>, scale: f32, at: &Source) -> Result<Option<Self>, SceneError> {
        let [width, height] = [image.width(), image.height()];
        let wrong = |what: String| SceneError::new(at, what);
        if layout == Layout::EqualArea && width != height {
            return Err(wrong(format!(
                "an equal-area environment image must be square, not {width} x {height}; use a square image, or a \
                 latitude-longitude map"
            )));
        }
        if !(scale.is_finite() && scale >= 0.0) {
            return Err(radiance_error(at, [scale; 3]));
        }
        if let Some(i) = image.pixels.iter().position(|p| !(valid(p) && valid(&p.map(|x| x * scale)))) {
            return Err(wrong(format!(
                "texel ({}, {}) of the environment image is {:?}; repair the image: values must be finite and at least 0, \
                 also when scaled",
                i % width,
                i / width,
                image.pixels[i]
            )));
        }
        let Some((texels, average)) = Texels::new(layout, image).filter(|_| scale > 0.0) else { return Ok(None) };
        let Ok(mut whole) = texels.part([0..texels.count[0], 0..texels.count[1]], 1.0) else {
            return Err(wrong(format!("an environment image of {width} x {height} is too large; scale it down")));
        };
        whole.share = 1.0;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
        let exact = places.zip(&image.pixels).all(|(place, rgb)| unpack(texels.at(place)).to_array() == *rgb);
        let image = (!exact).then(|| image.clone());
        let average = average * f64::from(scale);
        Ok(Some(Self { layout, size: [width as u32, height as u32], scale, texels, image, whole, average }))
    }

    /// Returns the light from a unit direction in the light's space.
    #[inline(always)]
    pub(super) fn find(&self, w: Vec3) -> MapLight {
        let ([u, v], factor) = self.layout.to_uv(w);
        let [width, height] = self.size;
        let column = ((u * width as f32) as u32).min(width - 1) as usize;
        let row = ((v * height as f32) as u32).min(height - 1) as usize;
        let (texel, block) = (self.texels.at([column, row]), [column / SIDE, row / SIDE]);
        let density = self.texels.weight(texel) * self.texels.shares[block[1]][row % SIDE];
        MapLight { radiance: self.radiance(texel, [column, row]), pdf: density * factor, block }
    }

    /// Samples a direction in a part of the map. Returns it in the light's space, with its radiance and its solid-angle
    /// density.
    #[inline(always)]
    pub(super) fn sample(&self, part: &Part, u: [f32; 2]) -> Option<(Vec3, Vec3, f32)> {
        let cell = part.cells.sample(u)?;
        let block = [cell.place[0] + part.first[0], cell.place[1] + part.first[1]];
        self.look(block);
        let weights = self.texels.weights(block);
        let (row, v) = select(sums(&weights), cell.u[1]);
        let (column, u) = select(weights[row], cell.u[0]);
        let place = [block[0] * SIDE + column, block[1] * SIDE + row];
        let along = |i: usize, u: f32| ((place[i] as f32 + u) / self.size[i] as f32).min(BELOW_ONE);
        let (w, factor) = self.layout.to_sphere([along(0, u), along(1, v)]);
        // Radiance and density both come from the sampled texel, since the direction may round into the next one.
        let radiance = self.radiance(self.texels.at(place), place);
        Some((w, radiance, weights[row][column] * factor / part.share as f32))
    }

    /// Returns the part of the map with these ranges of columns and rows of blocks.
    pub(super) fn part(&self, ranges: [Range<usize>; 2]) -> Option<Part> {
        self.texels.part(ranges, self.whole.cells.total()).ok()
    }

    /// Returns the numbers of blocks across and down.
    #[inline]
    pub(super) fn blocks(&self) -> [usize; 2] {
        self.texels.count
    }

    /// Returns true if the image is square.
    pub(super) fn is_square(&self) -> bool {
        self.size[0] == self.size[1]
    }

    /// Reads pixels of a block before they are needed, to load their cache lines.
    #[inline(always)]
    fn look(&self, [column, row]: [usize; 2]) {
        let Some(image) = &self.image else { return };
        let first = row * SIDE * self.size[0] as usize + column * SIDE + SIDE / 2;
        for y in 0..SIDE {
            std::hint::black_box(image.pixels.get(first + y * self.size[0] as usize).map_or(0.0, |rgb| rgb[0]));
        }
    }

    #[inline(always)]
    fn radiance(&self, texel: u32, [column, row]: [usize; 2]) -> Vec3 {
        let radiance = match &self.image {
            None => unpack(texel),
            Some(image) => Vec3::from_array(image.pixels[row * self.size[0] as usize + column]),
        };
        radiance * self.scale
    }
}

impl Texels {
    /// Packs an image. Returns the texels, and the image's mean luminance over the sphere of directions. Returns `None` if the
    /// image is black.
    fn new(layout: Layout, image: &Image) -> Option<(Self, f64)> {
        let count = [image.width().div_ceil(SIDE), image.height().div_ceil(SIDE)];
        let mut blocks = vec![Block([[0; SIDE]; SIDE]); count[0] * count[1]];
        for (row, column) in (0..image.height()).flat_map(|row| (0..image.width()).map(move |column| (row, column))) {
            let texel = pack(image.pixel(column, row));
            blocks[row / SIDE * count[0] + column / SIDE].0[row % SIDE][column % SIDE] = texel;
        }
        let mut texels = Self { blocks, count, shares: Vec::new(), mean: 0.0 };
        // In latitude and longitude, solid angle is proportional to the sine of the polar angle.
        let solid = |row: usize| match layout {
            Layout::LatLong if row < image.height() => {
                f64::from(sin_cos_turn(0.5 * (row as f32 + 0.5) / image.height() as f32).0)
            }
            _ => 1.0,
        };
        let mean = |texels: &Self| {
            let of_row =
                |row| (0..image.width()).map(|column| f64::from(texels.weight(texels.at([column, row])))).sum::<f64>();
            (0..image.height()).map(|row| of_row(row) * solid(row)).sum::<f64>() / image.pixels.len() as f64
        };
        // The sine averages to 2/pi over the rows.
        let whole = if layout == Layout::LatLong { std::f64::consts::FRAC_2_PI } else { 1.0 };
        let average = mean(&texels) / whole;
        texels.mean = average as f32;
        let scale = 1.0 / mean(&texels);
        let share = |row: usize| (solid(row) * scale) as f32;
        texels.shares = (0..count[1]).map(|row| std::array::from_fn(|i| share(row * SIDE + i))).collect();
        (average > 0.0 && share(0).is_finite()).then_some((texels, average))
    }

    /// Returns the density of a texel, up to a constant factor.
    #[inline(always)]
    fn weight(&self, texel: u32) -> f32 {
        let light = luminance(texel);
        (light - self.mean).max(LEAST * light)
    }

    #[inline(always)]
    fn at(&self, [column, row]: [usize; 2]) -> u32 {
        self.blocks[row / SIDE * self.count[0] + column / SIDE].0[row % SIDE][column % SIDE]
    }

    /// Returns the densities over the unit square of the texels in a block.
    #[inline(always)]
    fn weights(&self, [column, row]: [usize; 2]) -> [[f32; SIDE]; SIDE] {
        let (block, shares) = (&self.blocks[row * self.count[0] + column].0, &self.shares[row]);
        // The compiler makes vectors of this, but not of `from_fn`.
        let row = |y: usize| {
            let [a, b, c, d] = block[y];
            [
                self.weight(a) * shares[y],
                self.weight(b) * shares[y],
                self.weight(c) * shares[y],
                self.weight(d) * shares[y],
            ]
        };
        [row(0), row(1), row(2), row(3)]
    }

    /// Returns the part with these ranges of columns and rows of blocks. `whole` is the total weight of the map.
    fn part(&self, [columns, rows]: [Range<usize>; 2], whole: f64) -> Result<Part, Error> {
        let places = rows.clone().flat_map(|row| columns.clone().map(move |column| [column, row]));
        let weights: Vec<f32> = places.map(|place| sum(sums(&self.weights(place)))).collect();
        let cells = PiecewiseConstant2d::new(&weights, [columns.len(), rows.len()])?;
        let share = cells.total() / whole;
        Ok(Part { cells, first: [columns.start, rows.start], share })
    }
}

#[inline(always)]
fn sum([a, b, c, d]: [f32; SIDE]) -> f32 {
    a + b + c + d
}

#[inline(always)]
fn sums([a, b, c, d]: &[[f32; SIDE]; SIDE]) -> [f32; SIDE] {
    [sum(*a), sum(*b), sum(*c), sum(*d)]
}

/// Selects one of four weights by a number in `[0, 1)`. Returns the index, and the number rescaled to the weight's interval. A
/// weight of 0 is not selected if another is positive.
#[inline(always)]
fn select(weights: [f32; SIDE], u: f32) -> (usize, f32) {
    let [a, b, c, d] = weights;
    let ends = [0.0, a, a + b, a + b + c];
    let total = ends[3] + d;
    let at = (u * total).min(total.next_down());
    let index = usize::from(at >= ends[1]) + usize::from(at >= ends[2]) + usize::from(at >= ends[3]);
    (index, ((at - ends[index]) / weights[index]).min(BELOW_ONE))
}

/// Packs a texel. All channels share the exponent of the largest one, which keeps 8 significant bits.
fn pack(rgb: [f32; 3]) -> u32 {
    let largest = rgb.into_iter().fold(0.0, f32::max);
    // A normal number's exponent, less 7 for the bits of a byte.
    let exponent = (largest.to_bits() >> 23).saturating_sub(7);
    if exponent == 0 {
        return 0;
    }
    let inverse = f32::from_bits((254 - exponent) << 23);
    let [r, g, b] = rgb.map(|x| (x * inverse + 0.5).min(255.0) as u32);
    exponent << 24 | b << 16 | g << 8 | r
}

/// Returns the channels of a packed texel without their common factor, and the factor.
#[inline(always)]
fn parts(texel: u32) -> ([f32; 3], f32) {
    let byte = |shift: u32| (texel >> shift & 0xFF) as f32;
    ([byte(0), byte(8), byte(16)], f32::from_bits(texel >> 1 & 0x7F80_0000))
}

/// Returns the linear RGB colour of a packed texel.
#[inline(always)]
fn unpack(texel: u32) -> Vec3 {
    let (channels, factor) = parts(texel);
    Vec3::from_array(channels) * factor
}

/// Returns the luminance of a packed texel.
#[inline(always)]
fn luminance(texel: u32) -> f32 {
    let ([r, g, b], factor) = parts(texel);
    (0.2126 * r + 0.7152 * g + 0.0722 * b) * factor
}

impl Layout {
    /// Returns the image position in `[0, 1]^2` of a unit direction in the light's space (z up), and the factor from a
    /// density over the unit square to the solid-angle density. Row 0 is at `v = 0`.
    #[inline(always)]
    fn to_uv(self, w: Vec3) -> ([f32; 2], f32) {
        match self {
            // Computing the polar angle by the arctangent of both coordinates keeps precision near the poles.
            Self::LatLong => {
                let sin = (w.x * w.x + w.y * w.y).sqrt();
                let factor = if sin > 0.0 { 1.0 / (2.0 * PI * PI * sin) } else { 0.0 };
                ([turn_of(w.y, w.x), 2.0 * turn_of(sin, w.z)], factor)
            }
            Self::EqualArea => (to_square(w.normalize()), warp::uniform_sphere_pdf()),
        }
    }

    /// Returns the direction at an image position, and the factor as [`Self::to_uv`] does.
    #[inline(always)]
    fn to_sphere(self, uv: [f32; 2]) -> (Vec3, f32) {
        match self {
            Self::LatLong => {
                let (sin, cos) = sin_cos_turn(0.5 * uv[1]);
                let (y, x) = sin_cos_turn(uv[0]);
                (Vec3::new(sin * x, sin * y, cos), 1.0 / (2.0 * PI * PI * sin))
            }
            Self::EqualArea => (to_sphere(uv), warp::uniform_sphere_pdf()),
        }
    }
}

// An area-preserving map between the sphere and a square [Clarberg 2008]: the upper hemisphere fills the diamond in the
// middle of the square, and the lower hemisphere its four corners, an octahedron cut open along its lower edges. A direction
// on such an edge has two points on the border of the square, mirror images about the midpoint of a side.

/// Returns the unit direction at a point `[u, v]` of `[0, 1]^2`. `u` increases with x and `v` with y; the centre is
/// +z.
#[inline]
fn to_sphere(uv: [f32; 2]) -> Vec3 {
    let [a, b] = uv.map(|x| 2.0 * x - 1.0);
    // Positive in the upper hemisphere.
    let inside = 1.0 - (a.abs() + b.abs());
    let radius = 1.0 - inside.abs();
    // The angle in turns within a quarter circle, from the x axis.
    let turn = if radius > 0.0 { ((b.abs() - a.abs()) / radius + 1.0) * 0.125 } else { 0.125 };
    let (sin, cos) = sin_cos_turn(turn);
    let z = (1.0 - radius * radius).copysign(inside);
    let across = radius * (2.0 - radius * radius).max(0.0).sqrt();
    Vec3::new((across * cos).copysign(a), (across * sin).copysign(b), z)
}

/// Returns the point of `[0, 1]^2` for a unit direction: the inverse of [`to_sphere`].
#[inline]
fn to_square(w: Vec3) -> [f32; 2] {
    // This equals sqrt(1 - |z|), without cancellation near the poles.
    let radius = ((w.x * w.x + w.y * w.y) / (1.0 + w.z.abs())).sqrt();
    let share = 4.0 * turn_of(w.y.abs(), w.x.abs());
    let (b, a) = (share * radius, radius - share * radius);
    let (a, b) = if w.z < 0.0 { (1.0 - b, 1.0 - a) } else { (a, b) };
    [a.copysign(w.x), b.copysign(w.y)].map(|x| (0.5 * x + 0.5).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(layout: Layout, size: [u32; 2], pixels: Vec<[f32; 3]>) -> Map {
        let image = Arc::new(Image::new(size, pixels).expect("an image"));
        Map::new(layout, &image, 1.0, &Source::default()).expect("sound").expect("not black")
    }

    /// Radiance HDR texels, except the faintest, are packed exactly. Maps keep the images of other texels.
    #[test]
    fn texels_of_eight_bits_and_an_exponent_come_back_to_the_last_bit() {
        let texel = |i: u32| [i * 7, i * 31, i * 57].map(|m| (m % 256) as f32 * 2.0_f32.powi((i % 200) as i32 - 110));
        let pixels: Vec<_> = (0..16 * 200).map(texel).collect();
        for rgb in &pixels {
            assert_eq!(unpack(pack(*rgb)).to_array(), *rgb);
        }
        assert!(map(Layout::LatLong, [80, 40], pixels.clone()).image.is_none());
        let mut finer = pixels;
        finer[5] = [1.0, 1.0 + f32::EPSILON, 0.0];
        assert_eq!(unpack(pack(finer[5])), Vec3::new(1.0, 1.0, 0.0));
        assert_eq!(unpack(pack([f32::MAX; 3])), Vec3::splat(255.0 * 2.0_f32.powi(120)));
        let exact = map(Layout::LatLong, [80, 40], finer.clone());
        let center = Layout::LatLong.to_sphere([5.5 / 80.0, 0.5 / 40.0]).0;
        assert!(exact.find(center).radiance.to_array() == finer[5]);
    }

    /// One bright texel among two million. No sample has more than 8 times the mean weight.
    #[test]
    fn a_sun_of_one_texel_is_sampled_by_itself() {
        let mut pixels = vec![[0.5; 3]; 2048 * 1024];
        pixels[300 * 2048 + 777] = [1e6; 3];
        let map = map(Layout::LatLong, [2048, 1024], pixels);
        let (mut suns, count) = (0, 1 << 16);
        for i in 0..count {
            let u = [(i % 256) as f32 / 256.0, (i / 256) as f32 / 256.0];
            let (_, radiance, pdf) = map.sample(&map.whole, u).expect("not black");
            suns += i32::from(radiance.x == 1e6);
            assert!(f64::from(radiance.x / pdf) < 8.01 * 4.0 * std::f64::consts::PI * map.average);
        }
        // After subtracting the mean, only the sun is left, and an eighth of the rest.
        let sun = 1e6 * (std::f64::consts::PI * 300.5 / 1024.0).sin() / (2048.0 * 1024.0) * std::f64::consts::FRAC_PI_2;
        let found = f64::from(suns) / f64::from(count);
        assert!((found / (sun / (sun + 0.5 / 8.0)) - 1.0).abs() < 0.01, "{found} {sun}");
    }

    fn square() -> impl Iterator<Item = [f32; 2]> {
        (0..=256).flat_map(|i| (0..=256).map(move |j| [i as f32 / 256.0, j as f32 / 256.0]))
    }

    #[test]
    fn there_and_back() {
        for uv in square() {
            let w = to_sphere(uv);
            assert!((w.length() - 1.0).abs() < 3e-7, "{uv:?}: {w}");
            let back = to_square(w);
            let off = (back[0] - uv[0]).abs().max((back[1] - uv[1]).abs());
            let border = uv.iter().any(|x| *x == 0.0 || *x == 1.0);
            let again = (to_sphere(back) - w).length();
            assert!(again < 1e-6 && (border || off < 1e-6), "{uv:?}: {w} {back:?}");
        }
    }

    /// Each border point of the square maps to the same direction as its mirror image about the middle of the side, so the map
    /// is continuous.
    #[test]
    fn the_border_closes() {
        for i in 0..=64 {
            let t = i as f32 / 64.0;
            for (here, there) in [([0.0, t], [0.0, 1.0 - t]), ([1.0, t], [1.0, 1.0 - t])] {
                assert!((to_sphere(here) - to_sphere(there)).length() < 1e-6, "{here:?}");
                let turned = [here, there].map(|[u, v]| to_sphere([v, u]));
                assert!((turned[0] - turned[1]).length() < 1e-6, "{here:?}, turned");
            }
        }
    }
}
