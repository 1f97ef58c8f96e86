//! An environment cut up, so that a point may choose the part of the sky that it sees.

use super::{Environment, Kind};
use crate::light::{LightSample, Target};
use crate::shading::discrete::Window;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Tiles across and down an image in latitude and longitude: 45 degrees each, where it has so many texels.
const LONG: [usize; 2] = [8, 4];
/// Tiles of a square.
const SQUARE: [usize; 2] = [6, 6];
/// The number of a tile that is black, or all but.
const BLACK: u32 = u32::MAX;

/// The tiles of an environment that is an image. (Cutting a sky of one colour does not pay: docs/results/adaptive.md.) Each is drawn from as the whole is, by brightness, and the parts' chances come on top: with
/// chances by [`Parts::share`], parts are the whole. One look-up finds what a ray that leaves the scene sees, and in which
/// part.
#[derive(Clone, Debug)]
pub(crate) struct Parts {
    whole: Arc<Environment>,
    grid: [usize; 2],
    parts: Vec<Part>,
    /// Tile by tile, row by row: the number of its part, or [`BLACK`].
    numbers: Vec<u32>,
}

#[derive(Clone, Debug)]
struct Part {
    /// Of the whole's light.
    share: f64,
    window: Window,
}

impl Parts {
    /// The parts of an environment; `None` where there is but one.
    pub(crate) fn new(whole: &Arc<Environment>) -> Option<Self> {
        let Kind::Image(map) = &whole.kind else { return None };
        let [width, height] = map.image.size.map(|n| n as usize);
        let most = if width == height { SQUARE } else { LONG };
        let grid = [most[0].min(width), most[1].min(height)];
        let (mut parts, mut numbers) = (Vec::new(), Vec::new());
        for tile in 0..grid[0] * grid[1] {
            let [column, row] = [tile % grid[0], tile / grid[0]];
            let window = Window::new(&map.cells, range(column, grid[0], width), range(row, grid[1], height));
            // What is too little to be divided by is left to chance.
            let window = window.filter(|window| window.mass() as f32 >= f32::MIN_POSITIVE);
            numbers.push(if window.is_some() { parts.len() as u32 } else { BLACK });
            parts.extend(window.map(|window| Part { share: window.mass(), window }));
        }
        (parts.len() > 1).then(|| Self { whole: whole.clone(), grid, parts, numbers })
    }

    /// How many parts are not black.
    pub(crate) fn len(&self) -> usize {
        self.parts.len()
    }

    /// The environment that was cut.
    pub(crate) fn whole(&self) -> &Arc<Environment> {
        &self.whole
    }

    /// A part's share of the whole's light, above 0.
    pub(crate) fn share(&self, part: u32) -> f64 {
        self.parts[part as usize].share
    }

    /// Draws a direction in a part, with density near the brightness.
    #[inline]
    pub(crate) fn sample(&self, part: u32, u: [f32; 2]) -> Option<LightSample> {
        let Kind::Image(map) = &self.whole.kind else { return None };
        let Part { share, window } = &self.parts[part as usize];
        let (wi, radiance, pdf) = self.whole.drawn(map, window.sample_near(&map.cells, u, |i| map.look(i))?);
        let pdf = pdf / *share as f32;
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
    }

    /// Radiance from unit direction `w`, the part it lies in, and the density in solid angle with which that part's
    /// directions are drawn: 0 where it is black.
    #[inline]
    pub(crate) fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        let Kind::Image(map) = &self.whole.kind else { return (self.whole.radiance(w), 0.0, 0) };
        let (uv, radiance, pdf) = self.whole.looked_up(map, w);
        let texel = map.texel(uv);
        let of = |i: usize| tile_of(texel[i] as usize, self.grid[i], map.image.size[i] as usize);
        match self.numbers[of(1) * self.grid[0] + of(0)] {
            BLACK => (radiance, 0.0, 0),
            part => (radiance, pdf / self.share(part) as f32, part),
        }
    }

    /// The unit direction about which a part's light comes, and its irradiance on a surface that faces there.
    pub(crate) fn expected(&self, part: u32) -> (Vec3, f32) {
        const SIDE: u32 = 16;
        let place = |i: u32| (i as f32 + 0.5) / SIDE as f32;
        let directions = (0..SIDE * SIDE).filter_map(|i| self.sample(part, [place(i % SIDE), place(i / SIDE)]));
        let mean = directions.map(|sample| sample.wi).sum::<Vec3>() / (SIDE * SIDE) as f32;
        let light = 4.0 * PI * (self.whole.average_luminance() * self.share(part)) as f32;
        // Of a tile that goes around, directions cancel: what comes from all sides gives a quarter.
        (mean.normalize_or_zero(), light * mean.length().max(0.25))
    }
}

/// The texels along one side that belong to a tile.
fn range(tile: usize, tiles: usize, texels: usize) -> Range<usize> {
    tile * texels / tiles..(tile + 1) * texels / tiles
}

/// The inverse of [`range`]: the last tile that begins at the texel, or before.
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
