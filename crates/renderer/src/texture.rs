//! Texture look-ups.

use crate::image::Picture;
use crate::scene::{Color, Texture, TextureId, TextureKind};
use glam::Vec3;

/// All textures of a scene.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    textures: Vec<TextureKind>,
}

/// Textures may be made of textures; deeper nesting than this is read as black.
const DEEPEST: u32 = 8;

impl Textures {
    /// The textures of a scene, in its order.
    pub fn new(textures: &[Texture]) -> Self {
        Self { textures: textures.iter().map(|t| t.kind.clone()).collect() }
    }

    /// The colour at `uv`: a point look-up, whose footprint is what the samples of a pixel cover.
    #[inline]
    pub fn look_up(&self, id: TextureId, uv: [f32; 2]) -> Vec3 {
        self.look_up_within(id, uv, DEEPEST)
    }

    fn look_up_within(&self, id: TextureId, uv: [f32; 2], depth: u32) -> Vec3 {
        let Some(texture) = self.textures.get(id.0 as usize).filter(|_| depth > 0) else { return Vec3::ZERO };
        let place = |scale: &[f32; 2], shift: &[f32; 2]| [uv[0] * scale[0] + shift[0], uv[1] * scale[1] + shift[1]];
        match texture {
            TextureKind::Checkerboard { scale, shift, colors } => {
                let [u, v] = place(scale, shift);
                let odd = (u.floor() + v.floor()).rem_euclid(2.0) >= 1.0;
                match colors[usize::from(odd)] {
                    Color::Constant(rgb) => Vec3::from_array(rgb),
                    Color::Texture(id) => self.look_up_within(id, uv, depth - 1),
                }
            }
            TextureKind::Image { picture, scale, shift, factor, invert } => {
                let value = bilinear(picture, place(scale, shift)) * *factor;
                if *invert { (Vec3::ONE - value).max(Vec3::ZERO) } else { value }
            }
        }
    }
}

/// Bilinear, repeated; `v` = 0 is the bottom edge.
fn bilinear(picture: &Picture, [u, v]: [f32; 2]) -> Vec3 {
    let [w, h] = picture.size.map(|n| n as i64);
    let (x, y) = (u * w as f32 - 0.5, (1.0 - v) * h as f32 - 0.5);
    if !(x.is_finite() && y.is_finite()) {
        return Vec3::ZERO;
    }
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let texel = |dx: i64, dy: i64| {
        let column = (left as i64).saturating_add(dx).rem_euclid(w);
        let row = (top as i64).saturating_add(dy).rem_euclid(h);
        Vec3::from_array(picture.pixels[(row * w + column) as usize])
    };
    let upper = texel(0, 0).lerp(texel(1, 0), fx);
    let lower = texel(0, 1).lerp(texel(1, 1), fx);
    upper.lerp(lower, fy)
}
