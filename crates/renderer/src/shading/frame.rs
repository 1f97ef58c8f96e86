//! Orthonormal frames around normals.

use glam::Vec3;

/// A right-handed orthonormal frame in world space whose z axis is a surface normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingFrame {
    /// The x axis, a unit vector along the surface.
    pub tangent: Vec3,
    /// The y axis, a unit vector along the surface.
    pub bitangent: Vec3,
    /// The z axis, the unit normal.
    pub normal: Vec3,
}

impl ShadingFrame {
    /// Makes a frame around a unit normal, without branches [Duff et al. 2017]. The frame is orthonormal within 3e-7
    /// for every unit normal, including `(0, 0, -1)` and a z of -0.0.
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

    /// Makes a frame whose x axis is the part of `direction` perpendicular to the normal. For anisotropic materials,
    /// `direction` is the derivative of position with respect to u. Returns [`ShadingFrame::from_normal`] if
    /// `direction` is zero, along the normal or not finite.
    #[inline]
    pub fn from_normal_and_tangent(normal: Vec3, direction: Vec3) -> Self {
        // Scaled first, since derivatives with respect to u may be very small or very large.
        let direction = direction / direction.abs().max_element();
        let across = direction - normal * normal.dot(direction);
        let length = across.length();
        // At smaller lengths, rounding determines the direction; 1e-4 leaves three digits of it.
        if !(length > 1e-4) {
            return Self::from_normal(normal);
        }
        let tangent = across / length;
        // Made orthogonal again, since the first subtraction may have cancelled.
        let tangent = unit(tangent - normal * normal.dot(tangent));
        Self { tangent, bitangent: unit(normal.cross(tangent)), normal }
    }

    /// Makes the shading frame of a hit around the interpolated normal `shading` (of any length), turned to the side
    /// of the unit geometric normal. If `shading` is zero or not finite, for example because vertex normals cancel,
    /// the geometric normal is used. `tangent` is the `direction` of [`ShadingFrame::from_normal_and_tangent`], if
    /// any.
    #[inline]
    pub fn from_shading_normal(shading: Vec3, geometric: Vec3, tangent: Option<Vec3>) -> Self {
        let longest = shading.abs().max_element();
        // Interpolated unit normals that cancel to less than 1e-6 consist of rounding error.
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

    /// Transforms the world-space vector `v` to this frame.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.tangent), v.dot(self.bitangent), v.dot(self.normal))
    }

    /// Transforms the vector `v` from this frame to world space.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }
}

/// Returns `v` divided by its length. Multiplying by the reciprocal would lose another bit.
#[inline]
fn unit(v: Vec3) -> Vec3 {
    v / v.length()
}
