//! Look-ups of textures at texture coordinates.

use dapple_scene::image::Image;
use dapple_scene::{Color, Scalar, Texture, TextureId, TextureKind, Wrap};
use glam::Vec3;
use std::sync::Arc;

/// All textures of a scene, prepared for look-ups.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    textures: Vec<TextureKind>,
    /// A compact copy of each texture's image; `None` if the image has more than 256 distinct values.
    coded: Vec<Option<Arc<Coded>>>,
}

/// The properties of a surface point on which textures depend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexturePoint {
    /// The texture coordinates.
    pub uv: [f32; 2],
    /// The interpolated vertex colour, linear RGB; white without vertex colours.
    pub color: Vec3,
}

impl From<[f32; 2]> for TexturePoint {
    fn from(uv: [f32; 2]) -> Self {
        Self { uv, color: Vec3::ONE }
    }
}

/// The largest depth of nested textures. A texture nested deeper is black.
const DEEPEST: u32 = 8;

impl Textures {
    /// Prepares the textures of a scene, for look-ups by the scene's [`TextureId`]s.
    pub fn new(textures: &[Texture]) -> Self {
        let textures: Vec<_> = textures.iter().map(|t| t.kind.clone()).collect();
        let mut coded: Vec<Option<Arc<Coded>>> = Vec::with_capacity(textures.len());
        for (i, texture) in textures.iter().enumerate() {
            let same = |other: &TextureKind| match (texture, other) {
                (TextureKind::Image { image: a, .. }, TextureKind::Image { image: b, .. }) => Arc::ptr_eq(a, b),
                _ => false,
            };
            coded.push(match (textures[..i].iter().position(same), texture) {
                (Some(earlier), _) => coded[earlier].clone(),
                (None, TextureKind::Image { image, .. }) => Coded::new(image).map(Arc::new),
                (None, _) => None,
            });
        }
        Self { textures, coded }
    }

    /// Returns a texture's linear RGB color at a point, with bilinear interpolation. Further filtering is left to the average
    /// over a pixel's samples. An unknown texture is black.
    #[inline]
    pub fn look_up(&self, id: TextureId, point: impl Into<TexturePoint>) -> Vec3 {
        self.look_up_within(id, point.into(), DEEPEST)
    }

    /// Returns a scalar parameter at a point: the constant, or the first channel of its texture.
    #[inline]
    pub(crate) fn look_up_scalar(&self, scalar: Scalar, point: TexturePoint) -> f32 {
        match scalar {
            Scalar::Constant(value) => value,
            Scalar::Texture(id) => self.look_up(id, point).x,
        }
    }

    fn look_up_within(&self, id: TextureId, point: TexturePoint, depth: u32) -> Vec3 {
        let Some(texture) = self.textures.get(id.0 as usize).filter(|_| depth > 0) else { return Vec3::ZERO };
        let uv = point.uv;
        let place = |scale: &[f32; 2], shift: &[f32; 2]| [uv[0] * scale[0] + shift[0], uv[1] * scale[1] + shift[1]];
        let color = |color: &Color| match color {
            Color::Constant(rgb) => Vec3::from_array(*rgb),
            Color::Texture(id) => self.look_up_within(*id, point, depth - 1),
        };
        match texture {
            TextureKind::Checkerboard { scale, shift, colors } => {
                let [u, v] = place(scale, shift);
                color(&colors[((parts(u).0 + parts(v).0) & 1) as usize])
            }
            TextureKind::Image { image, scale, shift, factor, invert, wrap } => {
                let (size, uv) = (image.size, place(scale, shift));
                let value = match &self.coded[id.0 as usize] {
                    Some(coded) => bilinear(size, uv, *wrap, |column, row| coded.pixel(column, row)),
                    None => bilinear(size, uv, *wrap, |column, row| {
                        Vec3::from_array(image.pixels[row * size[0] as usize + column])
                    }),
                } * *factor;
                if *invert { (Vec3::ONE - value).max(Vec3::ZERO) } else { value }
            }
            TextureKind::Product { factors: [a, b] } => color(a) * color(b),
            TextureKind::VertexColor => point.color,
            TextureKind::Mix { colors: [a, b], amount } => {
                let amount = match amount {
                    Scalar::Constant(amount) => *amount,
                    Scalar::Texture(id) => self.look_up_within(*id, point, depth - 1).x,
                };
                // At 0 or 1, only one color is looked up, since the other may not be finite.
                match amount {
                    0.0 => color(a),
                    1.0 => color(b),
                    _ => color(a).lerp(color(b), amount),
                }
            }
        }
    }
}

/// Interpolates bilinearly between four pixels. `pixel` returns the value at a column and a row. `v = 0` is the bottom edge.
#[inline(always)]
fn bilinear([w, h]: [u32; 2], [u, v]: [f32; 2], wrap: Wrap, pixel: impl Fn(usize, usize) -> Vec3) -> Vec3 {
    let (x, y) = (u * w as f32 - 0.5, (1.0 - v) * h as f32 - 0.5);
    if !(x.is_finite() && y.is_finite()) {
        return Vec3::ZERO;
    }
    let ((left, fx), (top, fy)) = (parts(x), parts(y));
    let (columns, rows) = (pair(left, w, wrap), pair(top, h, wrap));
    let texel = |column: usize, row: usize| {
        if column == BEYOND || row == BEYOND {
            return Vec3::ZERO;
        }
        pixel(column, row)
    };
    let upper = texel(columns[0], rows[0]).lerp(texel(columns[1], rows[0]), fx);
    let lower = texel(columns[0], rows[1]).lerp(texel(columns[1], rows[1]), fx);
    upper.lerp(lower, fy)
}

/// Returns the floor and the fraction of `x`. It avoids the function call that `floor` needs on old processors. `x` is first
/// clamped to the range from -2^30 to 2^30, beyond which numbers have no fractions.
#[inline]
fn parts(x: f32) -> (i64, f32) {
    const FAR: f32 = (1u32 << 30) as f32;
    let x = x.clamp(-FAR, FAR);
    let whole = x as i32;
    let floor = whole - i32::from(x < whole as f32);
    (i64::from(floor), x - floor as f32)
}

/// The index of a row or column outside the image, which is black.
const BEYOND: usize = usize::MAX;

/// Returns the indices of the rows or columns at the positions `first` and `first + 1`, of `n` in all. `wrap` determines the
/// result outside the image.
#[inline]
fn pair(first: i64, n: u32, wrap: Wrap) -> [usize; 2] {
    let n = i64::from(n);
    // Both are usually in the image. This case needs no slow integer division.
    if first >= 0 && first < n - 1 {
        return [first as usize, first as usize + 1];
    }
    [first, first + 1].map(|i| match wrap {
        Wrap::Repeat => i.rem_euclid(n) as usize,
        Wrap::Clamp => i.clamp(0, n - 1) as usize,
        Wrap::Black if (0..n).contains(&i) => i as usize,
        Wrap::Black => BEYOND,
    })
}

/// The largest number of distinct values, since their indices are bytes.
const MOST: usize = 256;
/// The number of pixels along the side of a tile.
const SIDE: usize = 4;

/// An image with at most 256 distinct channel values, such as one from an 8-bit file, stored exactly in one byte per channel.
/// Scattered look-ups in a large image are limited by memory latency. This form uses a third of the memory of three floats,
/// and four neighbouring pixels mostly share a cache line.
#[derive(Clone, Debug)]
struct Coded {
    tiles: Vec<Tile>,
    /// The number of tiles per row of tiles.
    across: usize,
    values: Box<[f32; MOST]>,
}

/// The value indices of 4 x 4 pixels, row by row, in one cache line. The fourth byte of each pixel is unused.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Tile([[u8; 4]; SIDE * SIDE]);

impl Coded {
    /// Makes the compact copy of an image. Returns `None` if the image has more than 256 distinct values.
    fn new(image: &Image) -> Option<Self> {
        let [width, height] = [image.width(), image.height()];
        let across = width.div_ceil(SIDE);
        let mut coder = Coder::default();
        let mut tiles = vec![Tile([[0; 4]; SIDE * SIDE]); across * height.div_ceil(SIDE)];
        for y in 0..height {
            for (x, [r, g, b]) in image.row(y).iter().enumerate() {
                let (tile, place) = locate(across, x, y);
                tiles[tile].0[place] = [coder.code(*r)?, coder.code(*g)?, coder.code(*b)?, 0];
            }
        }
        Some(Self { tiles, across, values: Box::new(coder.values) })
    }

    /// Returns the linear RGB pixel at a column and a row, which must be inside the image.
    #[inline]
    fn pixel(&self, column: usize, row: usize) -> Vec3 {
        let (tile, place) = locate(self.across, column, row);
        let [r, g, b, _] = self.tiles[tile].0[place];
        Vec3::new(self.values[usize::from(r)], self.values[usize::from(g)], self.values[usize::from(b)])
    }
}

/// Returns the index of a pixel's tile, and the index of the pixel in its tile.
#[inline]
fn locate(across: usize, column: usize, row: usize) -> (usize, usize) {
    (row / SIDE * across + column / SIDE, row % SIDE * SIDE + column % SIDE)
}

/// A table that assigns an index to each distinct value, in order of first use.
struct Coder {
    values: [f32; MOST],
    count: usize,
    /// A hash table from a value's bits to its index plus 1; 0 marks a free slot.
    slots: [u16; Self::SLOTS],
}

impl Default for Coder {
    fn default() -> Self {
        Self { values: [0.0; MOST], count: 0, slots: [0; Self::SLOTS] }
    }
}

impl Coder {
    /// The size of the hash table: four times the largest number of values, which keeps searches short.
    const SLOTS: usize = 4 * MOST;

    /// Returns the index of a value; `None` if there are more than 256 distinct values.
    fn code(&mut self, value: f32) -> Option<u8> {
        // Multiplication by 2^32 divided by the golden ratio scatters the bits [after Knuth 1998, sec. 6.4].
        let mut slot = (value.to_bits().wrapping_mul(0x9E37_79B9) >> 22) as usize;
        loop {
            let number = usize::from(self.slots[slot]);
            if number == 0 {
                break;
            }
            if self.values[number - 1].to_bits() == value.to_bits() {
                return Some((number - 1) as u8);
            }
            slot = (slot + 1) % Self::SLOTS;
        }
        if self.count == MOST {
            return None;
        }
        self.values[self.count] = value;
        self.count += 1;
        self.slots[slot] = self.count as u16;
        Some((self.count - 1) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::{add_texture, checks};
    use dapple_scene::{Scene, Wrap};

    fn image(invert: bool, factor: f32, wrap: Wrap) -> TextureKind {
        // Top row 0.1 0.2, bottom row 0.3 0.4.
        let pixels = [0.1, 0.2, 0.3, 0.4].map(|v| [v, 2.0 * v, 0.0]).to_vec();
        let image = Arc::new(Image::new([2, 2], pixels).expect("four pixels"));
        TextureKind::Image { image, scale: [1.0; 2], shift: [0.0; 2], factor, invert, wrap }
    }

    /// Images are upright and repeat, clamp or end at their edges. Checkerboards alternate on both sides of 0. Nested textures
    /// end at the largest depth.
    #[test]
    fn textures_have_their_values() {
        let (half, tenth) = (Color::Constant([0.5; 3]), Color::Constant([0.1; 3]));
        let of = |id| Color::Texture(TextureId(id));
        let checkerboard = |scale, shift, colors| TextureKind::Checkerboard { scale, shift, colors };
        let mut scene = Scene::default();
        for kind in [
            image(false, 1.0, Wrap::Repeat),
            image(true, 2.0, Wrap::Repeat),
            image(false, 1.0, Wrap::Clamp),
            image(false, 1.0, Wrap::Black),
            TextureKind::Product { factors: [half, of(2)] },
            TextureKind::Mix { colors: [half, of(2)], amount: Scalar::Texture(TextureId(2)) },
            checkerboard([2.0, 1.0], [0.0, 0.5], [Color::Constant([1.0; 3]), Color::Constant([0.0; 3])]),
            checkerboard([1.0; 2], [0.0; 2], [of(0), tenth]),
            checkerboard([1.0; 2], [0.0; 2], [of(8), half]),
            checks(1.0, [0.7, 0.2]),
        ] {
            add_texture(&mut scene, "", kind);
        }
        let textures = Textures::new(&scene.textures);
        let at = |id: u32, u: f32, v: f32| textures.look_up(TextureId(id), [u, v]);
        for (id, u, v, expected) in [
            // Between texels and over the border: bilinear.
            (0, 0.5, 0.5, 0.25),
            (0, 0.0, 0.75, 0.15),
            // The upper left texel is 0.1; half of the texel at the edge.
            (2, -5.0, 7.0, 0.1),
            (3, -5.0, 7.0, 0.0),
            (3, 0.0, 0.75, 0.05),
            (4, 0.25, 0.75, 0.05),
            (5, 0.25, 0.75, 0.46),
            (6, 0.1, 0.1, 1.0),
            (6, 0.6, 0.1, 0.0),
            (6, -0.1, 0.1, 0.0),
            (6, -0.1, -0.6, 1.0),
            (6, 0.1, 0.6, 0.0),
            (7, 0.25, 0.75, 0.1),
            // A texture that contains itself and a missing texture are black.
            (8, 0.25, 0.25, 0.0),
            (77, 0.5, 0.5, 0.0),
            (9, 0.5, 0.5, 0.7),
        ] {
            assert!((at(id, u, v).x - expected).abs() < 1e-6, "{id} at {u} {v}: {}", at(id, u, v));
        }
        for (u, v, value) in [(0.25, 0.75, 0.1), (0.75, 0.75, 0.2), (0.25, 0.25, 0.3), (0.75, 0.25, 0.4)] {
            for (du, dv) in [(0.0, 0.0), (1.0, 0.0), (-1.0, 2.0), (3.0, -5.0)] {
                assert!((at(0, u + du, v + dv).x - value).abs() < 1e-6, "{u} {v}");
            }
        }
        // The factor applies first, then 1 minus the value, never below 0.
        assert!((at(1, 0.75, 0.25) - Vec3::new(0.2, 0.0, 1.0)).length() < 1e-6, "{}", at(1, 0.75, 0.25));
        assert!([f32::NAN, f32::INFINITY, 1e38].into_iter().all(|bad| at(0, bad, 0.5).is_finite()));
        let scalars = [Scalar::Constant(3.0), Scalar::Texture(TextureId(2))];
        let found = scalars.map(|scalar| textures.look_up_scalar(scalar, [0.25, 0.75].into()));
        assert_eq!(found, [3.0, at(2, 0.25, 0.75).x]);
    }

    #[test]
    fn textures_of_one_image_share_its_compact_copy() {
        let (mut scene, one) = (Scene::default(), image(false, 1.0, Wrap::Repeat));
        for kind in [one.clone(), image(false, 1.0, Wrap::Repeat), one] {
            add_texture(&mut scene, "", kind);
        }
        let coded: Vec<_> = Textures::new(&scene.textures).coded.into_iter().map(|c| c.expect("few values")).collect();
        assert!(Arc::ptr_eq(&coded[0], &coded[2]) && !Arc::ptr_eq(&coded[0], &coded[1]));
    }

    /// Images with up to 200 distinct values at varying sizes, and images with 256 and 257 values.
    #[test]
    fn pixels_come_back_to_the_last_bit() {
        let value = |i: u32| 1.0 / (1 + i.wrapping_mul(2_654_435_761) % 100) as f32;
        let made = |[w, h]: [u32; 2]| (0..w * h).map(|i| [value(3 * i), value(3 * i + 1), -value(3 * i + 2)]).collect();
        let odd = vec![[0.0, -0.0, f32::NAN], [f32::INFINITY, f32::MIN_POSITIVE, 1.0]];
        let sizes = [[1, 1], [4, 4], [5, 3], [37, 21]];
        for (size, pixels) in sizes.into_iter().map(|size| (size, made(size))).chain([([2, 1], odd)]) {
            let image = Image::new(size, pixels).expect("an image");
            let coded = Coded::new(&image).expect("at most 256 values");
            for (x, y) in (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| (x, y))) {
                let found = coded.pixel(x, y).to_array().map(f32::to_bits);
                assert_eq!(found, image.pixel(x, y).map(f32::to_bits), "{x} {y} of {size:?}");
            }
        }
        let row = |n: u32| Image::new([n, 1], (0..n).map(|i| [i as f32; 3]).collect()).expect("an image");
        assert!(Coded::new(&row(256)).is_some() && Coded::new(&row(257)).is_none());
    }
}
