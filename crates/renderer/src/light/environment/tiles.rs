//! Tiles of an environment map. Each tile is a light of its own, so that learned selection finds the visible parts of
//! the sky.

use super::{Environment, Kind};
use crate::light::source::{EmissionPdf, EmittedLight, Expectation, LightSample, LightSource, SceneSphere, Target};
use crate::shading::discrete::Window;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

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
    windows: Vec<TileWindow>,
    /// For each tile, row by row, its index in `windows` or [`BLACK`].
    numbers: Vec<u32>,
}

#[derive(Clone, Debug)]
struct TileWindow {
    /// The tile's fraction of the whole environment's light, 0 to 1.
    share: f64,
    window: Window,
}

/// One tile of an environment map, as a light.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    tiles: Arc<Tiles>,
    number: u32,
}

impl Tile {
    pub(crate) fn new(tiles: &Arc<Tiles>, number: u32) -> Self {
        Self { tiles: tiles.clone(), number }
    }
}

impl LightSource for Tile {
    #[inline]
    fn sample(&self, _: Vec3, u: [f32; 2]) -> Option<LightSample> {
        self.tiles.sample(self.number, u)
    }

    fn emit(&self, scene: &SceneSphere, place: [f32; 2], towards: [f32; 2]) -> Option<EmittedLight> {
        let sample = self.tiles.sample(self.number, towards)?;
        Some(scene.parallel(-sample.wi, sample.radiance, sample.pdf, place))
    }

    fn emission_pdf(&self, scene: &SceneSphere, _: Vec3, direction: Vec3) -> EmissionPdf {
        let (_, pdf, tile) = self.tiles.find(-direction);
        scene.parallel_pdf(if tile == self.number { pdf } else { 0.0 })
    }

    fn power(&self, scene_radius: f64) -> f64 {
        self.tiles.whole.power(scene_radius) * self.tiles.share(self.number)
    }

    fn expectation(&self) -> Expectation {
        self.tiles.expectation(self.number)
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
            windows.extend(window.map(|window| TileWindow { share: window.mass(), window }));
        }
        (windows.len() > 1).then(|| Self { whole: whole.clone(), grid, windows, numbers })
    }

    /// Returns the number of tiles that emit light.
    pub(crate) fn len(&self) -> usize {
        self.windows.len()
    }

    /// Returns a tile's fraction of the whole environment's light, above 0.
    fn share(&self, tile: u32) -> f64 {
        self.windows[tile as usize].share
    }

    /// Samples a direction in a tile by `u` in `[0, 1)^2`, with a density nearly proportional to luminance.
    #[inline]
    fn sample(&self, tile: u32, u: [f32; 2]) -> Option<LightSample> {
        let Kind::Image(map) = &self.whole.kind else { return None };
        let TileWindow { share, window } = &self.windows[tile as usize];
        let (wi, radiance, pdf) = self.whole.drawn(map, window.sample_near(&map.cells, u, |i| map.look(i))?);
        let pdf = pdf / *share as f32;
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
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

    /// Returns the mean direction of a tile's light, and the approximate irradiance on a surface that faces it.
    fn expectation(&self, tile: u32) -> Expectation {
        const SIDE: u32 = 16;
        let place = |i: u32| (i as f32 + 0.5) / SIDE as f32;
        let directions = (0..SIDE * SIDE).filter_map(|i| self.sample(tile, [place(i % SIDE), place(i / SIDE)]));
        let mean = directions.map(|sample| sample.wi).sum::<Vec3>() / (SIDE * SIDE) as f32;
        let light = 4.0 * PI * (self.whole.average_luminance() * self.share(tile)) as f32;
        // The directions of a tile around a pole cancel out; light from all sides has a quarter of the irradiance.
        Expectation::Far { towards: mean.normalize_or_zero(), irradiance: light * mean.length().max(0.25) }
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
