//! Look-ups of textures at texture coordinates.

mod coded;

use coded::Coded;
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

/// The largest depth of nested textures. A texture nested deeper is black.
const DEEPEST: u32 = 8;

impl Textures {
    /// Prepares the textures of a scene. Indices stay the same.
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

    /// Returns a texture's linear RGB color at the texture coordinates `uv`. Nothing is filtered beyond bilinear
    /// interpolation; averaging a pixel's samples does the rest. An unknown texture is black.
    #[inline]
    pub fn look_up(&self, id: TextureId, uv: [f32; 2]) -> Vec3 {
        self.look_up_within(id, uv, DEEPEST)
    }

    /// Returns a scalar parameter at `uv`: the constant, or the first channel of its texture.
    #[inline]
    pub(crate) fn look_up_scalar(&self, scalar: Scalar, uv: [f32; 2]) -> f32 {
        match scalar {
            Scalar::Constant(value) => value,
            Scalar::Texture(id) => self.look_up(id, uv).x,
        }
    }

    fn look_up_within(&self, id: TextureId, uv: [f32; 2], depth: u32) -> Vec3 {
        let Some(texture) = self.textures.get(id.0 as usize).filter(|_| depth > 0) else { return Vec3::ZERO };
        let place = |scale: &[f32; 2], shift: &[f32; 2]| [uv[0] * scale[0] + shift[0], uv[1] * scale[1] + shift[1]];
        let color = |color: &Color| match color {
            Color::Constant(rgb) => Vec3::from_array(*rgb),
            Color::Texture(id) => self.look_up_within(*id, uv, depth - 1),
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
            TextureKind::Mix { colors: [a, b], amount } => {
                let amount = match amount {
                    Scalar::Constant(amount) => *amount,
                    Scalar::Texture(id) => self.look_up_within(*id, uv, depth - 1).x,
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

/// Interpolates bilinearly among four pixels, each of which `pixel` returns for a column and a row. `v = 0` is the
/// bottom edge.
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

/// Returns the floor and the fraction of `x`, without the function call that `floor` needs on old processors. `x` is
/// first clamped to the range from -2^30 to 2^30, beyond which numbers have no fractions.
#[inline]
fn parts(x: f32) -> (i64, f32) {
    const FAR: f32 = (1u32 << 30) as f32;
    let x = x.clamp(-FAR, FAR);
    let whole = x as i32;
    let floor = whole - i32::from(x < whole as f32);
    (i64::from(floor), x - floor as f32)
}

/// The mark of a row or column outside the image, which is black.
const BEYOND: usize = usize::MAX;

/// Returns the indices, of `n` rows or columns, for the positions `first` and `first + 1`. `wrap` determines the
/// result outside the image.
#[inline]
fn pair(first: i64, n: u32, wrap: Wrap) -> [usize; 2] {
    let n = i64::from(n);
    // Mostly both are in the image, which avoids the slow integer division.
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

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_scene::image::Image;
    use dapple_scene::{Source, Wrap};

    fn textures(kinds: Vec<TextureKind>) -> Textures {
        let texture = |kind| Texture { name: String::new(), kind, source: Source::default() };
        Textures::new(&kinds.into_iter().map(texture).collect::<Vec<_>>())
    }

    fn image(invert: bool, factor: f32) -> TextureKind {
        // Top row 0.1 0.2, bottom row 0.3 0.4.
        let pixels = [0.1, 0.2, 0.3, 0.4].map(|v| [v, 2.0 * v, 0.0]).to_vec();
        let image = Arc::new(Image::new([2, 2], pixels).expect("four pixels"));
        TextureKind::Image { image, scale: [1.0; 2], shift: [0.0; 2], factor, invert, wrap: Wrap::Repeat }
    }

    #[test]
    fn images_stand_upright_and_repeat() {
        let found = textures(vec![image(false, 1.0), image(true, 2.0)]);
        let at = |u: f32, v: f32| found.look_up(TextureId(0), [u, v]).x;
        let texels = [(0.25, 0.75, 0.1), (0.75, 0.75, 0.2), (0.25, 0.25, 0.3), (0.75, 0.25, 0.4)];
        for (u, v, value) in texels {
            for (du, dv) in [(0.0, 0.0), (1.0, 0.0), (-1.0, 2.0), (3.0, -5.0)] {
                assert!((at(u + du, v + dv) - value).abs() < 1e-6, "{u} {v}");
            }
        }
        // Between texels and over the border: bilinear.
        assert!((at(0.5, 0.5) - 0.25).abs() < 1e-6 && (at(0.0, 0.75) - 0.15).abs() < 1e-6);
        // The factor first, then 1 minus that, never below 0.
        let inverted = found.look_up(TextureId(1), [0.75, 0.25]);
        assert!((inverted - Vec3::new(0.2, 0.0, 1.0)).length() < 1e-6, "{inverted}");
        for bad in [f32::NAN, f32::INFINITY, 1e38] {
            assert!(found.look_up(TextureId(0), [bad, 0.5]).is_finite());
        }
        assert_eq!(found.look_up(TextureId(7), [0.5, 0.5]), Vec3::ZERO, "none such");
    }

    #[test]
    fn checks_alternate_on_both_sides_of_0() {
        let colors = [Color::Constant([1.0; 3]), Color::Constant([0.0; 3])];
        let found = textures(vec![TextureKind::Checkerboard { scale: [2.0, 1.0], shift: [0.0, 0.5], colors }]);
        for (u, v, even) in
            [(0.1, 0.1, true), (0.6, 0.1, false), (-0.1, 0.1, false), (-0.1, -0.6, true), (0.1, 0.6, false)]
        {
            assert_eq!(found.look_up(TextureId(0), [u, v]).x == 1.0, even, "{u} {v}");
        }
    }

    #[test]
    fn textures_of_textures_end() {
        let inner = |id| TextureKind::Checkerboard {
            scale: [1.0; 2],
            shift: [0.0; 2],
            colors: [Color::Texture(TextureId(id)), Color::Constant([0.5; 3])],
        };
        let found = textures(vec![inner(1), image(false, 1.0), inner(2)]);
        assert!((found.look_up(TextureId(0), [0.25, 0.75]).x - 0.1).abs() < 1e-6);
        assert_eq!(found.look_up(TextureId(2), [0.25, 0.25]), Vec3::ZERO, "one made of itself is black");
    }

    #[test]
    fn products_mixes_and_edges() {
        let edge = |wrap| match image(false, 1.0) {
            TextureKind::Image { image, scale, shift, factor, invert, .. } => {
                TextureKind::Image { image, scale, shift, factor, invert, wrap }
            }
            other => other,
        };
        let (half, dot) = (Color::Constant([0.5; 3]), Color::Texture(TextureId(0)));
        let checks =
            TextureKind::Checkerboard { scale: [1.0; 2], shift: [0.0; 2], colors: [half, Color::Constant([0.1; 3])] };
        let amount = Scalar::Texture(TextureId(0));
        let found = textures(vec![
            edge(Wrap::Clamp),
            edge(Wrap::Black),
            TextureKind::Product { factors: [half, dot] },
            TextureKind::Mix { colors: [half, dot], amount },
            checks,
        ]);
        let at = |id: u32, u: f32, v: f32| found.look_up(TextureId(id), [u, v]).x;
        // The upper left texel is 0.1, and goes on for ever, or ends.
        assert!((at(0, -5.0, 7.0) - 0.1).abs() < 1e-6 && at(1, -5.0, 7.0) == 0.0);
        assert!((at(1, 0.0, 0.75) - 0.05).abs() < 1e-6, "half of the texel at the edge");
        assert!((at(2, 0.25, 0.75) - 0.05).abs() < 1e-6 && (at(3, 0.25, 0.75) - 0.46).abs() < 1e-6);
        assert_eq!(
            (found.look_up_scalar(Scalar::Constant(3.0), [0.0; 2]), found.look_up_scalar(amount, [0.25, 0.75])),
            (3.0, at(0, 0.25, 0.75))
        );
    }
}
