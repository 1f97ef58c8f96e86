//! Orthonormal frames.

use glam::Vec3;

/// A right-handed orthonormal frame; its z axis is the normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingFrame {
    /// The x axis.
    pub tangent: Vec3,
    /// The y axis.
    pub bitangent: Vec3,
    /// The z axis.
    pub normal: Vec3,
}

impl ShadingFrame {
    /// Makes a frame around a unit normal, without branches [Duff et al. 2017]. It is orthonormal within 3e-7 for any
    /// unit normal, including `(0, 0, -1)` and a z of -0.0.
    #[inline]
    pub fn from_normal(normal: Vec3) -> Self {
        let Vec3 { x, y, z } = normal;
        let sign = 1f32.copysign(z);
        let a = -1.0 / (sign + z);
        let b = x * y * a;
        Self {
            tangent: Vec3::new(1.0 + sign * x * x * a, sign * b, -sign * x),
            bitangent: Vec3::new(b, sign + y * y * a, -y),
            normal,
        }
    }

    /// Makes a frame whose x axis leans towards `direction` (the derivative along u, say), for anisotropic materials.
    /// Returns [`ShadingFrame::from_normal`] if `direction` is zero, along the normal, or not finite.
    #[inline]
    pub fn from_normal_and_tangent(normal: Vec3, direction: Vec3) -> Self {
        // Scaled first, since derivatives along u may be as small or as large as the scene.
        let direction = direction / direction.abs().max_element();
        let across = direction - normal * normal.dot(direction);
        let length = across.length();
        // Below this, rounding decides the direction: 1e-4 leaves three digits of it.
        if !(length > 1e-4) {
            return Self::from_normal(normal);
        }
        let tangent = across / length;
        // Once more, since the first subtraction may have lost digits.
        let tangent = unit(tangent - normal * normal.dot(tangent));
        Self { tangent, bitangent: unit(normal.cross(tangent)), normal }
    }

    /// Makes the shading frame of a hit around the interpolated normal `shading` (of any length), turned to the side of
    /// the unit geometric normal. The geometric normal itself is used if `shading` is zero or not finite, as when
    /// vertex normals cancel. `tangent` is that of [`ShadingFrame::from_normal_and_tangent`].
    #[inline]
    pub fn from_shading_normal(shading: Vec3, geometric: Vec3, tangent: Option<Vec3>) -> Self {
        let longest = shading.abs().max_element();
        // 1e-6: interpolated unit normals that cancel to less are rounding error.
        let normal = if longest > 1e-6 && shading.is_finite() {
            let unit = unit(shading / longest);
            if unit.dot(geometric) < 0.0 { -unit } else { unit }
        } else {
            geometric
        };
        match tangent {
            Some(direction) => Self::from_normal_and_tangent(normal, direction),
            None => Self::from_normal(normal),
        }
    }

    /// Returns the world-space vector `v` in this frame.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Returns the vector `v` of this frame in world space.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// Returns `v` over its length, by divisions: multiplying by the reciprocal loses another bit.
#[inline]
fn unit(v: Vec3) -> Vec3 {
    v / v.length()
}
