//! The closed forms of coats, over a diffuse base and over a metal, against random walks between the layers in f64. The two
//! share no code except the Fresnel term.
#![allow(clippy::print_stderr)]

use crate::support::*;
use dapple_renderer::shading::{Bsdf, Coat, CoatOptions, ComplexIor, MetalCoat};
use rand_pcg::Pcg64Mcg;

/// The coat's index of refraction, its thickness in mean free paths, and the largest number of events.
const ETA: f64 = 1.5;
const THICKNESS: f64 = 0.01;
const DEPTH: u32 = 10;

/// The base below a coat.
#[derive(Clone, Copy, Debug)]
enum Base {
    /// A Lambertian base of this reflectance.
    Diffuse(f64),
    /// A metal: the width of its microfacets, and its complex index of refraction.
    Metal { alpha: f64, ior: [f64; 2] },
}

/// A random walk between a rough dielectric and a base. Visible normals are sampled by the disk method of Heitz 2018.
struct Walk {
    /// Width of the coat's microfacets.
    coat: f64,
    base: Base,
    random: Pcg64Mcg,
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

    /// Returns the new direction and its weight after an interaction with the coat from the side `w.z > 0`. `eta` is the index
    /// beyond the coat relative to the index before it.
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

    /// Returns the new direction and its weight after an interaction with the base from above.
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

    /// Performs one walk from outside. Returns the direction in which light leaves after reaching the base, and its weight.
    fn leave(&mut self, wo: DVec3) -> Option<(DVec3, f64)> {
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

fn walk(coat: f32, base: Base, seed: u64) -> Walk {
    Walk { coat: coat.into(), base, random: Pcg64Mcg::seed_from_u64(seed) }
}

/// The number of bins of the cosine at which light leaves a coat over a diffuse base.
const BINS: usize = 4;

/// The integral of the base's part of `f |cos|` over a bin of cosines. The coat's own lobe is removed by subtracting
/// the same coat over black.
fn closed_form(coat: &Coat, reflectance: f32, wo: Vec3, bin: usize) -> f64 {
    let [coated, black] = [reflectance, 0.0].map(|rho| Bsdf::coated_diffuse(coat, Vec3::splat(rho)));
    let n = 400;
    let part = |i: i32| {
        let cos = (bin as f64 + (f64::from(i) + 0.5) / f64::from(n)) / BINS as f64;
        // Away from the mirror direction, where the difference would drown in the coat's lobe.
        let wi = DVec3::new(0.0, (1.0 - cos * cos).sqrt(), cos).as_vec3();
        f64::from(coated.evaluate(wo, wi).x - black.evaluate(wo, wi).x) * TAU * cos / (f64::from(n) * BINS as f64)
    };
    (0..n).map(part).sum()
}

/// For several roughnesses and outgoing cosines, the light from a base of 0.9 agrees with walks within 2 %, by a sequential
/// equivalence test. No bin is more than 5 standard errors off (200 comparisons, false alarms 1e-4). The thorough test has 10^7
/// walks and a tolerance of 1.5 %. Negative control: a base 5 % darker is detected.
#[test]
fn diffuse_coats_meet_the_walk() {
    let all = [1.0, 0.8, 0.5, 0.2, 0.05];
    let [few, many] = [thorough(&[1.0, 0.7, 0.2][..], &all), &all];
    for (alpha, walks, cosines) in
        [(1e-3, 500_000, many), (0.1, 300_000, few), (0.3, 300_000, few), (0.6, 300_000, few), (1.0, 300_000, few)]
    {
        let coat = Coat::new(CoatOptions { alpha: [alpha; 2], ..Default::default() }).unwrap();
        for (seed, &cos) in cosines.iter().enumerate() {
            // Along x, so that directions along y are never the mirror direction.
            let wo = slanted(cos);
            let mut walk = walk(alpha, Base::Diffuse(0.9), seed as u64);
            let (mut bins, mut total) = ([Mean::default(); BINS], Mean::default());
            let exact = |rho: f32| [0, 1, 2, 3].map(|bin| closed_form(&coat, rho, wo, bin));
            let [sum, wrong] = [0.9, 0.855].map(|rho| exact(rho).iter().sum::<f64>());
            let agrees = |total: &Mean| {
                (total.mean / sum - 1.0).abs() + 5.0 * total.standard_error() / sum < thorough(0.02, 0.015)
            };
            let most = thorough(walks, 10_000_000);
            while total.n < most && !(total.n % 50_000 == 49_999 && agrees(&total)) {
                let left = walk.leave(wo.as_dvec3().normalize());
                let bin = left.map_or(BINS, |(wi, _)| ((wi.z * BINS as f64) as usize).min(BINS - 1));
                let weight = left.map_or(0.0, |(_, weight)| weight);
                total.add(weight);
                bins.iter_mut().enumerate().for_each(|(i, mean)| mean.add(if i == bin { weight } else { 0.0 }));
            }
            for (mean, exact) in bins.iter().zip(exact(0.9)) {
                assert!(mean.deviation(exact).abs() < 5.0, "alpha {alpha} cosine {cos}: {mean:?}, not {exact}");
            }
            let (relative, error) = (total.mean / sum - 1.0, total.standard_error() / sum);
            eprintln!("alpha {alpha} cosine {cos}: closed {sum:.4}, walk {relative:+.4} +- {error:.4}");
            assert!(agrees(&total), "alpha {alpha} cosine {cos}: {relative}");
            assert!(total.deviation(wrong).abs() > 5.0, "alpha {alpha} cosine {cos}: the test sees nothing");
        }
    }
}

/// The number of bins of the distance from the mirror direction over a metal, in half-vector slopes.
const SLOPES: usize = 6;

fn slope(wo: DVec3, wi: DVec3) -> usize {
    let h = wo + wi;
    let slope = h.x.hypot(h.y) / h.z;
    [0.02, 0.06, 0.2, 0.5, 1.0].iter().position(|&edge| slope < edge).unwrap_or(SLOPES - 1)
}

fn metal_coat([coat, metal]: [f32; 2]) -> MetalCoat {
    MetalCoat::new(CoatOptions { alpha: [coat; 2], ..Default::default() }, [metal; 2]).unwrap()
}

/// Returns the light per bin and in total over a metal, by the walk and by the closed form.
fn over_metal(made: &MetalCoat, [coat, metal]: [f32; 2], cos: f64, walks: u64) -> [[Mean; SLOPES + 1]; 2] {
    let ior = [0.92, 2.45];
    let [eta, k] = ior.map(|x| Vec3::splat(x as f32));
    let bsdf = Bsdf::coated_conductor(made, ComplexIor { eta, k });
    // The coat's own reflection: the same coat over a metal that reflects nothing.
    let dark = Bsdf::coated_conductor(made, ComplexIor { eta: Vec3::splat(1.5), k: Vec3::ZERO });
    let exact = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let wo = exact.as_vec3();
    let mut walk = walk(coat, Base::Metal { alpha: metal.into(), ior }, 5);
    let mut found = [[Mean::default(); SLOPES + 1]; 2];
    let mut random = Pcg64Mcg::seed_from_u64(6);
    for _ in 0..walks {
        let left = walk.leave(exact).map(|(wi, weight)| (slope(exact, wi), weight));
        let u = [random.random(), random.random()];
        let sample = bsdf.sample(wo, u, random.random()).filter(|sample| !sample.specular);
        let closed = sample.map(|sample| {
            let own = bsdf.evaluate(wo, sample.wi).x - dark.evaluate(wo, sample.wi).x;
            (slope(exact, sample.wi.as_dvec3()), f64::from(own * sample.wi.z / sample.pdf))
        });
        for (means, light) in found.iter_mut().zip([left, closed]) {
            let (to, weight) = light.unwrap_or((SLOPES, 0.0));
            means.iter_mut().enumerate().for_each(|(i, m)| m.add(if i == to || i == SLOPES { weight } else { 0.0 }));
        }
    }
    found
}

/// Smooth and rough coats over metals are seen from above and at grazing angles. The total and each bin agree, with differences
/// as fractions of the total, after subtracting 5 standard errors. Negative control: a coat of another width is detected.
#[test]
fn metal_coats_meet_the_walk() {
    let pairs = [[0.0, 0.1], [0.0, 0.3], [0.0, 1.0], [0.1, 0.0], [0.1, 0.1], [0.3, 0.1], [0.3, 0.5], [0.6, 0.6]];
    let coats = pairs.map(metal_coat);
    let cases = coats.iter().zip(pairs).flat_map(|case| [1.0, 0.6, 0.15].map(|cos| (case, cos)));
    for ((made, [coat, metal]), cos) in cases {
        let [walk, closed] = over_metal(made, [coat, metal], cos, thorough(20_000, 1_000_000));
        let beyond = |i: usize| {
            let test = closed[i].against_estimate(&walk[i]);
            ((test.difference.abs() - 5.0 * test.standard_error) / walk[SLOPES].mean).max(0.0)
        };
        let (all, bin) = (beyond(SLOPES), (0..SLOPES).map(beyond).fold(0.0, f64::max));
        eprintln!("coat {coat} metal {metal} cosine {cos}: {all:.4} of all, {bin:.4} in a bin");
        let most = match coat {
            0.0 => 0.03,
            _ if cos > 0.5 => 0.05,
            _ => 0.12,
        };
        assert!(all < most && bin < 0.06, "coat {coat} metal {metal} cosine {cos}: {all} {bin}");
    }
    // The pairs of numbers 5 and 4.
    let [[walk, _], [_, closed]] = [5, 4].map(|i| over_metal(&coats[i], pairs[i], 1.0, 20_000));
    assert!((0..SLOPES).any(|i| (walk[i].mean - closed[i].mean).abs() > 0.1 * walk[SLOPES].mean));
}
