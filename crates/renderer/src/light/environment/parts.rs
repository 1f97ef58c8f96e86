//! An environment cut up, so that a point may choose the part of the sky that it sees.

use super::{Environment, Kind};
use crate::light::{LightSample, Target};
use crate::shading::discrete::Window;
use crate::shading::trigonometry::{sin_cos_turn, turn_of};
use crate::shading::warp;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

/// Tiles across and down a picture in latitude and longitude, or a sky without a picture: 45 degrees each.
const LONG: [usize; 2] = [8, 4];
/// Tiles of a square.
const SQUARE: [usize; 2] = [6, 6];
/// The number of a tile that is black.
const BLACK: u32 = u32::MAX;

/// The tiles of one environment. Each is drawn from as the whole is, by brightness, and the parts' chances come on top: with
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
    /// Column and row of its tile.
    tile: [usize; 2],
    /// Of the whole's light.
    share: f64,
    /// Of the picture, if there is one.
    window: Option<Window>,
}

impl Parts {
    /// The parts of an environment; `None` where there is but one.
    pub(crate) fn new(whole: &Arc<Environment>) -> Option<Self> {
        let grid = match &whole.kind {
            Kind::Constant(_) => LONG,
            Kind::Picture(map) => {
                let [width, height] = map.picture.size.map(|n| n as usize);
                let most = if width == height { SQUARE } else { LONG };
                [most[0].min(width), most[1].min(height)]
            }
        };
        let (mut parts, mut numbers) = (Vec::new(), Vec::new());
        for tile in (0..grid[0] * grid[1]).map(|i| [i % grid[0], i / grid[0]]) {
            let part = match &whole.kind {
                Kind::Constant(_) => {
                    Some(Part { tile, share: 1.0 / (grid[0] * grid[1]) as f64, window: None })
                }
                Kind::Picture(map) => {
                    let [width, height] = map.picture.size.map(|n| n as usize);
                    let window =
                        Window::new(&map.cells, range(tile[0], grid[0], width), range(tile[1], grid[1], height));
                    window.map(|window| Part { tile, share: window.mass(), window: Some(window) })
                }
            };
            numbers.push(if part.is_some() { parts.len() as u32 } else { BLACK });
            parts.extend(part);
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
        let Part { tile, share, window } = &self.parts[part as usize];
        let (wi, radiance, pdf) = match (&self.whole.kind, window) {
            (Kind::Picture(map), Some(window)) => {
                let drawn = window.sample_near(&map.cells, u, |i| map.look(i))?;
                self.whole.drawn(map, drawn)
            }
            (Kind::Constant(rgb), _) => {
                let [across, down] = [0, 1].map(|i| (tile[i] as f32 + u[i]) / self.grid[i] as f32);
                let z = 1.0 - 2.0 * down;
                let (sin, cos) = sin_cos_turn(across);
                let radius = (1.0 - z * z).max(0.0).sqrt();
                (Vec3::new(radius * cos, radius * sin, z), *rgb, warp::uniform_sphere_pdf())
            }
            // Parts of pictures have windows.
            (Kind::Picture(_), None) => return None,
        };
        let pdf = pdf / *share as f32;
        let shines = pdf.is_finite() && radiance != Vec3::ZERO;
        shines.then_some(LightSample { wi, radiance, pdf, target: Target::Far, delta: false })
    }

    /// Radiance from unit direction `w`, the part it lies in, and the density in solid angle with which that part's
    /// directions are drawn: 0 where it is black.
    #[inline]
    pub(crate) fn find(&self, w: Vec3) -> (Vec3, f32, u32) {
        let (radiance, pdf, tile) = match &self.whole.kind {
            Kind::Constant(rgb) => {
                let place = [turn_of(w.y, w.x), 0.5 * (1.0 - w.z)];
                let of = |i: usize| ((place[i] * self.grid[i] as f32) as usize).min(self.grid[i] - 1);
                (*rgb, warp::uniform_sphere_pdf(), [of(0), of(1)])
            }
            Kind::Picture(map) => {
                let (uv, radiance, pdf) = self.whole.looked_up(map, w);
                let texel = map.texel(uv);
                let of = |i: usize| tile_of(texel[i] as usize, self.grid[i], map.picture.size[i] as usize);
                (radiance, pdf, [of(0), of(1)])
            }
        };
        match self.numbers[tile[1] * self.grid[0] + tile[0]] {
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
        (mean.normalize_or_zero(), light * mean.length())
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
                assert!(range.clone().all(|texel| tile_of(texel, tiles, texels) == tile), "{tile} of {tiles}, {texels}");
                next = range.end;
            }
            assert_eq!(next, texels);
        }
    }
}
