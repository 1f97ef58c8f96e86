//! Environments: light from infinity, as a function of direction.

use super::source::{EmissionPdf, Expectation, LightSample, LightSource, SceneSphere, Target, luminance};
use crate::SceneError;
use crate::shading::discrete::{PiecewiseConstant2d, Window};
use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use crate::shading::warp;
use crate::space::even_scale;
use dapple_geometry::SurfacePoint;
use dapple_scene::image::Image;
use dapple_scene::{EnvironmentRadiance, Source};
use glam::{DMat3, Mat3, Vec3};
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Light from infinitely far, as a function of direction: a constant radiance or an environment map.
#[derive(Clone, Debug)]
pub struct Environment {
    to_light: Mat3,
    to_world: Mat3,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Constant(Vec3),
    Image(Map),
}

/// An environment map. Radiance is constant within a texel, as in pbrt-v4, so that the sampling density is exact.
#[derive(Clone, Debug)]
struct Map {
    layout: Layout,
    image: Arc<Image>,
    scale: f32,
    /// The distribution that samples texels in proportion to luminance times solid angle.
    cells: PiecewiseConstant2d,
    /// The mean luminance of the map over the sphere of directions.
    average: f64,
}

/// The parametrisation of the sphere of directions by the image: latitude and longitude, or equal-area octahedral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    LatLong,
    EqualArea,
}

impl Environment {
    /// Prepares an environment of a scene, oriented by the transform `to_world`. Returns `None` if the radiance is 0
    /// everywhere.
    ///
    /// # Errors
    ///
    /// [`SceneError`] if a radiance or the scale is negative or not finite, if an equal-area image is not
    /// square, or if an image is too large. Also if the transform flattens space, or if it stretches an environment
    /// map.
    pub fn new(radiance: &EnvironmentRadiance, to_world: DMat3, at: &Source) -> Result<Option<Self>, SceneError> {
        // Only directions matter, so a uniform scale has no effect.
        let inverse = to_world.inverse();
        let sound = to_world.is_finite() && inverse.is_finite() && to_world.determinant().abs() > 0.0;
        // Under a stretch, equal areas of the image would no longer cover the expected solid angles.
        let constant = matches!(radiance, EnvironmentRadiance::Constant(_));
        if !sound || !(constant || even_scale(&to_world).is_some()) {
            let what = "the environment's transform flattens or stretches space, or is not finite; rotate, mirror and scale \
                        uniformly only";
            return Err(SceneError::new(at, what));
        }
        let kind = match radiance {
            EnvironmentRadiance::Constant(rgb) if !valid(rgb) => {
                return Err(radiance_error(at, *rgb));
            }
            EnvironmentRadiance::Constant(rgb) => (*rgb != [0.0; 3]).then_some(Kind::Constant(Vec3::from_array(*rgb))),
            EnvironmentRadiance::LatLong { image, scale } => {
                Map::new(Layout::LatLong, image, *scale, at)?.map(Kind::Image)
            }
            EnvironmentRadiance::EqualArea { image, scale } => {
                Map::new(Layout::EqualArea, image, *scale, at)?.map(Kind::Image)
            }
        };
        Ok(kind.map(|kind| Self { to_light: normalized(inverse), to_world: normalized(to_world), kind }))
    }

    /// Returns the linear RGB radiance from the unit direction `w`.
    #[inline]
    pub fn radiance(&self, w: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(rgb) => *rgb,
            Kind::Image(map) => map.radiance(map.layout.to_uv(self.to_light * w)),
        }
    }

    /// Returns the direction, radiance and solid-angle density of a point sampled in the image.
    #[inline(always)]
    fn drawn(&self, map: &Map, (uv, density): ([f32; 2], f32)) -> (Vec3, Vec3, f32) {
        let (local, pdf) = map.layout.to_sphere(uv, density);
        // Radiance and density both come from the sampled texel, since the direction may round into the next one.
        ((self.to_world * local).normalize(), map.radiance(uv), pdf)
    }

    /// Returns the solid-angle density with which light sampling chooses the direction `w`, without the probability of
    /// selecting the light.
    #[inline]
    pub fn direction_pdf(&self, w: Vec3) -> f32 {
        self.radiance_and_pdf(w).1
    }

    /// Returns [`Self::radiance`] and [`Self::direction_pdf`] with a single look-up of the map.
    #[inline]
    pub(super) fn radiance_and_pdf(&self, w: Vec3) -> (Vec3, f32) {
        match &self.kind {
            Kind::Constant(rgb) => (*rgb, warp::uniform_sphere_pdf()),
            Kind::Image(map) => {
                let (_, radiance, pdf) = self.looked_up(map, w);
                (radiance, pdf)
            }
        }
    }

    /// Returns the position in the image, the radiance and the solid-angle density for the unit direction `w`.
    #[inline(always)]
    fn looked_up(&self, map: &Map, w: Vec3) -> ([f32; 2], Vec3, f32) {
        let uv = map.layout.to_uv(self.to_light * w);
        (uv, map.radiance(uv), map.layout.pdf(uv, map.cells.pdf(uv)))
    }

    /// Returns the mean luminance over the sphere of directions.
    pub(super) fn average_luminance(&self) -> f64 {
        match &self.kind {
            Kind::Constant(rgb) => luminance(*rgb),
            Kind::Image(map) => map.average,
        }
    }
}

impl LightSource for Environment {
    /// Samples a direction. In a map, the density is nearly proportional to luminance.
    #[inline]
    fn sample(&self, _: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let (wi, radiance, pdf) = match &self.kind {
            Kind::Constant(rgb) => (warp::uniform_sphere(u), *rgb, warp::uniform_sphere_pdf()),
            Kind::Image(map) => self.drawn(map, map.cells.sample_near(u, |i| map.look(i))?),
        };
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
    }

    fn emission_pdf(&self, scene: &SceneSphere, _: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        scene.parallel_pdf(self.direction_pdf(-direction))
    }

    /// Returns the mean luminance times 4 pi, times the cross section `pi r^2` of the scene's bounding sphere, divided
    /// by pi.
    fn power(&self, scene_radius: f64) -> f64 {
        4.0 * std::f64::consts::PI * scene_radius * scene_radius * self.average_luminance()
    }

    fn expectation(&self) -> Expectation {
        let irradiance = (std::f64::consts::PI * self.average_luminance()) as f32;
        Expectation::Far { towards: Vec3::ZERO, irradiance }
    }
}

fn radiance_error(at: &Source, value: [f32; 3]) -> SceneError {
    let remedy = "give finite numbers of at least 0";
    SceneError::new(at, format!("the environment's radiance {value:?} is invalid; {remedy}"))
}

impl Map {
    fn new(layout: Layout, image: &Arc<Image>, scale: f32, at: &Source) -> Result<Option<Self>, SceneError> {
        let [width, height] = image.size.map(|n| n as usize);
        let wrong = |what: String| SceneError::new(at, what);
        if layout == Layout::EqualArea && width != height {
            return Err(wrong(format!(
                "an equal-area environment image must be square, not {width} x {height}; use a square image, or one in \
                 latitude and longitude"
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
        // A texel's weight is its luminance times its solid angle. In latitude and longitude, solid angle is
        // proportional to the sine of the polar angle.
        let share = |row: usize| match layout {
            Layout::LatLong => sin_cos_turn(0.5 * (row as f32 + 0.5) / height as f32).0,
            Layout::EqualArea => 1.0,
        };
        let brightness = |i: usize| luminance(Vec3::from_array(image.pixels[i])) as f32;
        let weights: Vec<f32> = (0..width * height).map(|i| brightness(i) * share(i / width)).collect();
        let Ok(cells) = PiecewiseConstant2d::new(&weights, [width, height]) else {
            return Err(wrong(format!("an environment image of {width} x {height} is too large; scale it down")));
        };
        if cells.is_empty() || scale == 0.0 {
            return Ok(None);
        }
        // The sine averages to 2/pi over the rows.
        let mean_share = if layout == Layout::LatLong { std::f64::consts::FRAC_2_PI } else { 1.0 };
        let average = cells.mean() * f64::from(scale) / mean_share;
        Ok(Some(Self { layout, image: image.clone(), scale, cells, average }))
    }

    #[inline]
    fn radiance(&self, uv: [f32; 2]) -> Vec3 {
        let [column, row] = self.texel(uv);
        Vec3::from_array(self.image.pixels[(row * self.image.size[0] + column) as usize]) * self.scale
    }

    /// Returns the column and row of the texel at a position in the image.
    #[inline]
    fn texel(&self, [u, v]: [f32; 2]) -> [u32; 2] {
        let [width, height] = self.image.size;
        [((u * width as f32) as u32).min(width - 1), ((v * height as f32) as u32).min(height - 1)]
    }

    /// Reads a pixel early, so that its cache line is loaded when it is needed.
    #[inline(always)]
    fn look(&self, pixel: usize) {
        std::hint::black_box(self.image.pixels[pixel][0]);
    }
}

impl Layout {
    /// Returns the image position in `[0, 1]^2` of a direction in the light's space (z up). Row 0 is at `v = 0`.
    #[inline]
    fn to_uv(self, w: Vec3) -> [f32; 2] {
        match self {
            // Computing the polar angle by the arctangent of both coordinates keeps precision near the poles.
            Self::LatLong => [turn_of(w.y, w.x), 2.0 * turn_of((w.x * w.x + w.y * w.y).sqrt(), w.z)],
            Self::EqualArea => to_square(w.normalize()),
        }
    }

    /// Returns the direction at an image position, and the solid-angle density for a density `density` over the unit
    /// square.
    #[inline]
    fn to_sphere(self, uv: [f32; 2], density: f32) -> (Vec3, f32) {
        match self {
            Self::LatLong => {
                let (sin, cos) = sin_cos_turn(0.5 * uv[1]);
                let (y, x) = sin_cos_turn(uv[0]);
                (Vec3::new(sin * x, sin * y, cos), density / (2.0 * PI * PI * sin))
            }
            Self::EqualArea => (to_sphere(uv), density * warp::uniform_sphere_pdf()),
        }
    }

    /// Converts a density over the unit square, at an image position, to a solid-angle density.
    #[inline]
    fn pdf(self, uv: [f32; 2], density: f32) -> f32 {
        match self {
            Self::LatLong => {
                let sin = sin_cos_turn(0.5 * uv[1]).0;
                if sin > 0.0 { density / (2.0 * PI * PI * sin) } else { 0.0 }
            }
            Self::EqualArea => density * warp::uniform_sphere_pdf(),
        }
    }
}

/// Returns true if all channels of a radiance are finite and not negative.
fn valid(rgb: &[f32; 3]) -> bool {
    rgb.iter().all(|x| x.is_finite() && *x >= 0.0)
}

/// Returns a matrix with its uniform scale divided out, which leaves a rotation or reflection.
fn normalized(m: DMat3) -> Mat3 {
    let scale = m.determinant().abs().cbrt();
    (m * (1.0 / scale)).as_mat3()
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

/// The number of tiles across and down an image that is not square: 45 degrees each in latitude and longitude, if
/// there are enough texels.
const LONG: [usize; 2] = [8, 4];
/// The number of tiles across and down a square image.
const SQUARE: [usize; 2] = [6, 6];
/// The index of tiles that emit nothing, or almost nothing.
const BLACK: u32 = u32::MAX;

/// The tiles of an environment map. An environment of constant radiance is not divided, since that does not pay.
///
/// Directions in each tile are sampled by luminance. If tiles are selected in proportion to [`Tiles::share`],
/// directions have the same density as without tiles. One look-up returns the radiance in a direction and its tile.
#[derive(Clone, Debug)]
pub(crate) struct Tiles {
    whole: Arc<Environment>,
    grid: [usize; 2],
    windows: Vec<Window>,
    /// For each tile, row by row, its index in `windows` or [`BLACK`].
    numbers: Vec<u32>,
}

/// One tile of an environment map, as a light.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    tiles: Arc<Tiles>,
    number: u32,
}

impl Tile {
    pub(super) fn new(tiles: &Arc<Tiles>, number: u32) -> Self {
        Self { tiles: tiles.clone(), number }
    }
}

impl LightSource for Tile {
    /// Samples a direction in the tile, with a density nearly proportional to luminance.
    #[inline]
    fn sample(&self, _: Vec3, u: [f32; 2]) -> Option<LightSample> {
        let Tiles { whole, windows, .. } = &*self.tiles;
        let Kind::Image(map) = &whole.kind else { return None };
        let window = &windows[self.number as usize];
        let (wi, radiance, pdf) = whole.drawn(map, window.sample_near(&map.cells, u, |i| map.look(i))?);
        let pdf = pdf / window.mass() as f32;
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
    }

    fn emission_pdf(&self, scene: &SceneSphere, _: &SurfacePoint, direction: Vec3) -> EmissionPdf {
        let (_, pdf, tile) = self.tiles.find(-direction);
        scene.parallel_pdf(if tile == self.number { pdf } else { 0.0 })
    }

    fn power(&self, scene_radius: f64) -> f64 {
        self.tiles.whole.power(scene_radius) * self.tiles.share(self.number)
    }

    /// Returns the mean direction of the tile's light, and the approximate irradiance on a surface that faces it.
    fn expectation(&self) -> Expectation {
        const SIDE: u32 = 16;
        let place = |i: u32| (i as f32 + 0.5) / SIDE as f32;
        let sample = |i: u32| self.sample(Vec3::ZERO, [place(i % SIDE), place(i / SIDE)]);
        let directions = (0..SIDE * SIDE).filter_map(sample);
        let mean = directions.map(|sample| sample.wi).sum::<Vec3>() / (SIDE * SIDE) as f32;
        let light = 4.0 * PI * (self.tiles.whole.average_luminance() * self.tiles.share(self.number)) as f32;
        // The directions of a tile around a pole cancel out; light from all sides has a quarter of the irradiance.
        Expectation::Far { towards: mean.normalize_or_zero(), irradiance: light * mean.length().max(0.25) }
    }
}

impl Tiles {
    /// Divides an environment map into tiles. Returns `None` if fewer than two tiles emit light, or if the radiance is
    /// constant.
    pub(crate) fn new(whole: &Arc<Environment>) -> Option<Self> {
        let Kind::Image(map) = &whole.kind else { return None };
        let [width, height] = map.image.size.map(|n| n as usize);
        let most = if width == height { SQUARE } else { LONG };
        let grid = [most[0].min(width), most[1].min(height)];
        let (mut windows, mut numbers) = (Vec::new(), Vec::new());
        for tile in 0..grid[0] * grid[1] {
            let [column, row] = [tile % grid[0], tile / grid[0]];
            let window = Window::new(&map.cells, range(column, grid[0], width), range(row, grid[1], height));
            // A tile too dark to divide by is found by BSDF sampling only.
            let window = window.filter(|window| window.mass() as f32 >= f32::MIN_POSITIVE);
            numbers.push(if window.is_some() { windows.len() as u32 } else { BLACK });
            windows.extend(window);
        }
        (windows.len() > 1).then(|| Self { whole: whole.clone(), grid, windows, numbers })
    }

    /// Returns the number of tiles that emit light.
    pub(crate) fn len(&self) -> usize {
        self.windows.len()
    }

    /// Returns a tile's fraction of the whole environment's light, above 0.
    fn share(&self, tile: u32) -> f64 {
        self.windows[tile as usize].mass()
    }

    /// Returns the radiance from the unit direction `w`, the solid-angle density with which its tile samples `w`, and
    /// the index of the tile.
    ///
    /// For a direction in a dark tile, the density and the index are 0.
    #[inline]
    pub(crate) fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        let Kind::Image(map) = &self.whole.kind else { return (self.whole.radiance(w), 0.0, 0) };
        let (uv, radiance, pdf) = self.whole.looked_up(map, w);
        let texel = map.texel(uv);
        let of = |i: usize| tile_of(texel[i] as usize, self.grid[i], map.image.size[i] as usize);
        match self.numbers[of(1) * self.grid[0] + of(0)] {
            BLACK => (radiance, 0.0, 0),
            tile => (radiance, pdf / self.share(tile) as f32, tile),
        }
    }
}

/// Returns the range of texels along one axis that belong to a tile.
fn range(tile: usize, tiles: usize, texels: usize) -> Range<usize> {
    tile * texels / tiles..(tile + 1) * texels / tiles
}

/// Returns the index of the tile that contains a texel along one axis: the inverse of [`range`].
#[inline]
fn tile_of(texel: usize, tiles: usize, texels: usize) -> usize {
    ((texel + 1) * tiles - 1) / texels
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// On the border of the square, the middle of each side mirrors a direction into itself: nothing jumps there.
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

    #[test]
    fn each_texel_lies_in_the_tile_it_is_found_in() {
        for (tiles, texels) in [(1, 1), (8, 8), (8, 9), (6, 7), (4, 513), (8, 1024), (3, 100)] {
            let mut next = 0;
            for tile in 0..tiles {
                let range = range(tile, tiles, texels);
                assert!(range.start == next && !range.is_empty());
                assert!(
                    range.clone().all(|texel| tile_of(texel, tiles, texels) == tile),
                    "{tile} of {tiles}, {texels}"
                );
                next = range.end;
            }
            assert_eq!(next, texels);
        }
    }
}
