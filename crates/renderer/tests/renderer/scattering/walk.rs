//! Walks between the layers of a coated surface, event by event, in f64. They have nothing but the physics in common
//! with the closed forms under test. (Normals from their plain distribution agreed as well, with ten times the noise.)

use dapple_renderer::shading::ComplexIor;
use glam::{DVec3, Vec3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// The coat's index, its thickness in mean free paths, and the most events.
const ETA: f64 = 1.5;
const THICKNESS: f64 = 0.01;
const DEPTH: u32 = 10;

/// The base below a coat.
#[derive(Clone, Copy, Debug)]
pub enum Base {
    /// A Lambertian base of this reflectance.
    Diffuse(f64),
    /// A metal: width of its microfacets, index and absorption.
    Metal { alpha: f64, ior: [f64; 2] },
}

/// A walk between a rough dielectric and a base. Visible normals are sampled by the disk method of Heitz 2018.
pub struct Walk {
    /// Width of the coat's microfacets.
    pub coat: f64,
    pub base: Base,
    pub random: Pcg64Mcg,
}

impl Walk {
    fn uniform(&mut self) -> f64 {
        self.random.random()
    }

    /// A visible normal; `+z` on a mirror.
    fn normal(&mut self, alpha: f64, w: DVec3) -> DVec3 {
        if alpha == 0.0 {
            return DVec3::Z;
        }
        let (u, turn) = (self.uniform(), self.uniform());
        let v = DVec3::new(alpha * w.x, alpha * w.y, w.z).normalize();
        let x = if v.z < 0.9999 { DVec3::new(-v.y, v.x, 0.0).normalize() } else { v.any_orthonormal_vector() };
        let (a, b) = (u.sqrt() * (TAU * turn).cos(), u.sqrt() * (TAU * turn).sin());
        let s = 0.5 * (1.0 + v.z);
        let b = (1.0 - s) * (1.0 - a * a).sqrt() + s * b;
        let n = a * x + b * v.cross(x) + (1.0 - a * a - b * b).max(0.0).sqrt() * v;
        DVec3::new(alpha * n.x, alpha * n.y, n.z.max(0.0)).normalize()
    }

    /// `G / G1`.
    fn unshadowed(alpha: f64, w: DVec3, out: DVec3) -> f64 {
        let lambda = |w: DVec3| {
            let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
            0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
        };
        (1.0 + lambda(w)) / (1.0 + lambda(w) + lambda(out))
    }

    /// Interaction with the coat from the side `w.z > 0`, with index `eta` beyond over before: the new direction and
    /// its weight.
    fn interface(&mut self, w: DVec3, eta: f64) -> (DVec3, f64) {
        let (m, lobe) = (self.normal(self.coat, w), self.uniform());
        let cos = w.dot(m);
        if cos <= 0.0 {
            return (w, 0.0);
        }
        let sin2 = (1.0 - cos * cos) / (eta * eta);
        let cos_t = (1.0 - sin2).max(0.0).sqrt();
        let fresnel = if sin2 >= 1.0 {
            1.0
        } else {
            0.5 * (((cos - eta * cos_t) / (cos + eta * cos_t)).powi(2)
                + ((cos_t - eta * cos) / (cos_t + eta * cos)).powi(2))
        };
        let (out, allowed) = if lobe < fresnel {
            let up = 2.0 * cos * m - w;
            (up, up.z > 0.0)
        } else {
            let down = m * (cos / eta - cos_t) - w / eta;
            (down, down.z < 0.0)
        };
        if allowed { (out, Self::unshadowed(self.coat, w, out)) } else { (out, 0.0) }
    }

    /// Interaction with the base from above.
    fn base(&mut self, w: DVec3) -> (DVec3, f64) {
        let (alpha, ior) = match self.base {
            Base::Diffuse(reflectance) => {
                let (z2, turn) = (self.uniform(), self.uniform());
                let r = (1.0 - z2).sqrt();
                return (DVec3::new(r * (TAU * turn).cos(), r * (TAU * turn).sin(), z2.sqrt()), reflectance);
            }
            Base::Metal { alpha, ior } => (alpha, ior),
        };
        let m = self.normal(alpha, w);
        let cos = w.dot(m);
        let up = 2.0 * cos * m - w;
        if cos <= 0.0 || up.z <= 0.0 {
            return (up, 0.0);
        }
        // The Fresnel term has tests of its own.
        let [eta, k] = ior.map(|x| Vec3::splat((x / ETA) as f32));
        let fresnel = f64::from(ComplexIor { eta, k }.reflectance(cos as f32).x);
        (up, fresnel * Self::unshadowed(alpha, w, up))
    }

    fn crossing(w: DVec3) -> f64 {
        (-THICKNESS / w.z.abs()).exp()
    }

    /// One walk from outside: the direction in which light leaves after the base, and its weight.
    pub fn leave(&mut self, wo: DVec3) -> Option<(DVec3, f64)> {
        let (mut w, mut weight) = self.interface(wo, ETA);
        if w.z > 0.0 {
            return None;
        }
        for event in 0..DEPTH {
            weight *= Self::crossing(w);
            if weight == 0.0 {
                return None;
            }
            let factor;
            if event % 2 == 0 {
                (w, factor) = self.base(-w);
                weight *= factor;
            } else {
                // From below: mirrored upside down, and back.
                let flip = DVec3::new(1.0, 1.0, -1.0);
                let (out, factor) = self.interface(-w * flip, 1.0 / ETA);
                weight *= factor;
                if factor > 0.0 && out.z < 0.0 {
                    return Some((out * flip, weight));
                }
                w = out * flip;
            }
        }
        None
    }
}
