//! Environments: light from infinity, as a function of direction.

use super::environment_map::{Layout, Map, Part};
use super::source::{EmissionPdf, Expectation, LightSample, LightSource, SceneSphere, Target, luminance};
use crate::SceneError;
use crate::shading::warp;
use crate::space::even_scale;
use dapple_geometry::SurfacePoint;
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
    Image(Box<Map>),
}

impl Environment {
    /// Prepares an environment of a scene, oriented by the transform `to_world`. Returns `None` if the radiance is 0
    /// everywhere.
    ///
    /// # Errors
    ///
    /// [`SceneError`] if a radiance or the scale is negative or not finite, if an equal-area image is not square, if an image
    /// is too large, or if the transform is not finite, is not invertible or stretches an environment map.
    pub fn new(radiance: &EnvironmentRadiance, to_world: DMat3, at: &Source) -> Result<Option<Self>, SceneError> {
        // Only directions matter, so a uniform scale has no effect.
        let inverse = to_world.inverse();
        let sound = to_world.is_finite() && inverse.is_finite() && to_world.determinant().abs() > 0.0;
        // Under a stretch, equal areas of the image would no longer cover the expected solid angles.
        let constant = matches!(radiance, EnvironmentRadiance::Constant(_));
        if !sound || !(constant || even_scale(&to_world).is_some()) {
            let what = "the environment's transform is not finite, not invertible or not uniform; only rotate, mirror \
                        or scale it uniformly";
            return Err(SceneError::new(at, what));
        }
        let kind = match radiance {
            EnvironmentRadiance::Constant(rgb) if !valid(rgb) => {
                return Err(radiance_error(at, *rgb));
            }
            EnvironmentRadiance::Constant(rgb) => (*rgb != [0.0; 3]).then_some(Kind::Constant(Vec3::from_array(*rgb))),
            EnvironmentRadiance::LatLong { image, scale } => {
                Map::new(Layout::LatLong, image, *scale, at)?.map(|map| Kind::Image(Box::new(map)))
            }
            EnvironmentRadiance::EqualArea { image, scale } => {
                Map::new(Layout::EqualArea, image, *scale, at)?.map(|map| Kind::Image(Box::new(map)))
            }
        };
        Ok(kind.map(|kind| Self { to_light: normalized(inverse), to_world: normalized(to_world), kind }))
    }

    /// Returns the linear RGB radiance from the unit direction `w`.
    #[inline]
    pub fn radiance(&self, w: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(rgb) => *rgb,
            Kind::Image(map) => map.find(self.to_light * w).radiance,
        }
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
                let found = map.find(self.to_light * w);
                (found.radiance, found.pdf)
            }
        }
    }

    /// Samples a direction in a part of the map.
    #[inline(always)]
    fn sample_part(&self, map: &Map, part: &Part, u: [f32; 2]) -> Option<LightSample> {
        let (local, radiance, pdf) = map.sample(part, u)?;
        lit((self.to_world * local).normalize(), radiance, pdf)
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
        match &self.kind {
            Kind::Constant(rgb) => lit(warp::uniform_sphere(u), *rgb, warp::uniform_sphere_pdf()),
            Kind::Image(map) => self.sample_part(map, &map.whole, u),
        }
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

/// Returns a sample of light from a unit direction. Returns `None` if the light is black or the density is not finite.
#[inline(always)]
fn lit(wi: Vec3, radiance: Vec3, pdf: f32) -> Option<LightSample> {
    let shines = pdf.is_finite() && radiance != Vec3::ZERO;
    shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
}

/// Returns the error of an environment's radiance that is negative or not finite.
pub(super) fn radiance_error(at: &Source, value: [f32; 3]) -> SceneError {
    let remedy = "use finite numbers of at least 0";
    SceneError::new(at, format!("the environment's radiance {value:?} is invalid; {remedy}"))
}

/// Returns true if all channels of a radiance are finite and not negative.
pub(super) fn valid(rgb: &[f32; 3]) -> bool {
    rgb.iter().all(|x| x.is_finite() && *x >= 0.0)
}

/// Returns a matrix with its uniform scale divided out, which leaves a rotation or reflection.
fn normalized(m: DMat3) -> Mat3 {
    let scale = m.determinant().abs().cbrt();
    (m * (1.0 / scale)).as_mat3()
}

/// The number of tiles across and down an image that is not square: 45 degrees each in latitude and longitude, if
/// there are enough blocks of texels.
const LONG: [usize; 2] = [8, 4];
/// The number of tiles across and down a square image.
const SQUARE: [usize; 2] = [6, 6];
/// The index of tiles that emit nothing, or almost nothing.
const BLACK: u32 = u32::MAX;

/// The tiles of an environment map. An environment of constant radiance is not divided, since learning would not pay.
///
/// Directions in each tile are sampled by luminance. If tiles are selected in proportion to [`Tiles::share`],
/// directions have the same density as without tiles. One look-up returns the radiance in a direction and its tile.
#[derive(Clone, Debug)]
pub(crate) struct Tiles {
    whole: Arc<Environment>,
    grid: [usize; 2],
    parts: Vec<Part>,
    /// The index in `parts` of each tile, in row-major order; [`BLACK`] for tiles without light.
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
        let Tiles { whole, parts, .. } = &*self.tiles;
        let Kind::Image(map) = &whole.kind else { return None };
        whole.sample_part(map, &parts[self.number as usize], u)
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
        let blocks = map.blocks();
        let most = if map.is_square() { SQUARE } else { LONG };
        let grid = [most[0].min(blocks[0]), most[1].min(blocks[1])];
        let (mut parts, mut numbers) = (Vec::new(), Vec::new());
        for tile in 0..grid[0] * grid[1] {
            let part = map.part([range(tile % grid[0], grid[0], blocks[0]), range(tile / grid[0], grid[1], blocks[1])]);
            // A tile too dark to divide by is found by BSDF sampling only.
            let part = part.filter(|part| part.share as f32 >= f32::MIN_POSITIVE);
            numbers.push(if part.is_some() { parts.len() as u32 } else { BLACK });
            parts.extend(part);
        }
        (parts.len() > 1).then(|| Self { whole: whole.clone(), grid, parts, numbers })
    }

    /// Returns the number of tiles that emit light.
    pub(crate) fn len(&self) -> usize {
        self.parts.len()
    }

    /// Returns a tile's fraction of the whole environment's light, above 0.
    fn share(&self, tile: u32) -> f64 {
        self.parts[tile as usize].share
    }

    /// Returns the radiance from the unit direction `w`, the solid-angle density with which its tile samples `w`, and
    /// the index of the tile.
    ///
    /// For a direction in a dark tile, the density and the index are 0.
    #[inline]
    pub(crate) fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        let Kind::Image(map) = &self.whole.kind else { return (self.whole.radiance(w), 0.0, 0) };
        let found = map.find(self.whole.to_light * w);
        let (radiance, blocks) = (found.radiance, map.blocks());
        let of = |i: usize| tile_of(found.block[i], self.grid[i], blocks[i]);
        match self.numbers[of(1) * self.grid[0] + of(0)] {
            BLACK => (radiance, 0.0, 0),
            tile => (radiance, found.pdf / self.share(tile) as f32, tile),
        }
    }
}

/// Returns the range of blocks along one axis that belong to a tile.
fn range(tile: usize, tiles: usize, blocks: usize) -> Range<usize> {
    tile * blocks / tiles..(tile + 1) * blocks / tiles
}

/// Returns the index of the tile that contains a block along one axis: the inverse of [`range`].
#[inline]
fn tile_of(block: usize, tiles: usize, blocks: usize) -> usize {
    ((block + 1) * tiles - 1) / blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_block_lies_in_the_tile_it_is_found_in() {
        for (tiles, blocks) in [(1, 1), (8, 8), (8, 9), (6, 7), (4, 513), (8, 1024), (3, 100)] {
            let mut next = 0;
            for tile in 0..tiles {
                let range = range(tile, tiles, blocks);
                assert!(range.start == next && !range.is_empty());
                assert!(
                    range.clone().all(|block| tile_of(block, tiles, blocks) == tile),
                    "{tile} of {tiles}, {blocks}"
                );
                next = range.end;
            }
            assert_eq!(next, blocks);
        }
    }
}
