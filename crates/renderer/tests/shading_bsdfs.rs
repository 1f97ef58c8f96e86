//! BSDFs: sampling, density and value agree (L10); no energy is made and both directions are alike (L11).

mod statistics;

use dapple_renderer::shading::{Bsdf, BsdfSample, Coat, CoatOptions, ComplexIor};
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use statistics::{FAMILY, Mean, Verdict, chi_square, critical, integrate, sidak};
use std::f64::consts::TAU;

/// Coats of the tests: optical thickness and depth as in pbrt-v4's defaults.
fn coat(alpha: f32) -> Coat {
    Coat::new(CoatOptions { alpha: [alpha; 2], ..Default::default() }).unwrap()
}

fn gold() -> ComplexIor {
    ComplexIor { eta: Vec3::new(0.2, 0.92, 1.1), k: Vec3::new(3.9, 2.45, 2.14) }
}

struct Case<'m> {
    name: String,
    bsdf: Bsdf<'m>,
    /// Widths of the narrowest lobe.
    alpha: [f32; 2],
}

fn conductors() -> Vec<Case<'static>> {
    let mut cases = vec![Case {
        name: "diffuse".into(),
        bsdf: Bsdf::Diffuse { reflectance: Vec3::new(1.0, 0.5, 0.1) },
        alpha: [1.0; 2],
    }];
    for alpha in [[1e-3; 2], [0.01; 2], [0.1; 2], [0.5; 2], [1.0; 2], [0.05, 0.5], [1e-4, 0.3]] {
        cases.push(Case { name: format!("conductor {alpha:?}"), bsdf: Bsdf::conductor(gold(), alpha).unwrap(), alpha });
    }
    cases
}

fn coated(coats: &[(f32, Coat)]) -> Vec<Case<'_>> {
    coats
        .iter()
        .flat_map(|(alpha, coat)| {
            [0.9, 0.0].map(|rho| Case {
                name: format!("coat {alpha} over {rho}"),
                bsdf: Bsdf::coated_diffuse(coat, Vec3::new(rho, 0.5 * rho, 0.1 * rho)),
                alpha: [if *alpha < 1e-3 { 1.0 } else { *alpha }; 2],
            })
        })
        .collect()
}

fn coats() -> Vec<(f32, Coat)> {
    [0.0, 1e-3, 0.1, 0.6].map(|alpha| (alpha, coat(alpha))).into()
}

/// Twenty outgoing directions: along the normal, 89.99 degrees, a cosine of 1e-6, below the surface.
fn outgoing() -> Vec<Vec3> {
    let at = |cos: f64, turn: f64| {
        let sin = (1.0 - cos * cos).sqrt();
        DVec3::new(sin * (TAU * turn).cos(), sin * (TAU * turn).sin(), cos).as_vec3()
    };
    let mut list = vec![Vec3::Z, -Vec3::Z, at(89.99f64.to_radians().cos(), 0.1), at(1e-6, 0.6), at(-1e-6, 0.3)];
    for i in 0..15 {
        let cos = 0.99 - 0.065 * f64::from(i);
        list.push(at(if i % 5 == 4 { -cos } else { cos }, 0.377 * f64::from(i)));
    }
    list
}

/// Polar cells over the half vector's slopes, in units of the lobe's widths: they resolve any lobe, and any
/// hemisphere.
struct Rings {
    wo: DVec3,
    side: f64,
    alpha: [f64; 2],
}

const RINGS: usize = 12;
const SECTORS: usize = 20;
/// Rings end at radius 0, `FIRST`, then in geometric progression up to `LAST / alpha`, and at infinity.
const FIRST: f64 = 0.3;
const LAST: f64 = 10.0;

impl Rings {
    fn new(wo: Vec3, alpha: [f32; 2]) -> Self {
        let side = f64::from(wo.z.signum());
        Self { wo: wo.as_dvec3() * side, side, alpha: alpha.map(f64::from) }
    }

    /// Ring number, continuous, to radius.
    fn radius(&self, ring: f64) -> f64 {
        let n = (RINGS - 2) as f64;
        let last = LAST / self.alpha[0].min(self.alpha[1]);
        if ring <= 1.0 {
            FIRST * ring
        } else if ring <= n + 1.0 {
            FIRST * (last / FIRST).powf((ring - 1.0) / n)
        } else {
            last / (n + 2.0 - ring).max(1e-12)
        }
    }

    fn cell(&self, wi: Vec3) -> usize {
        let h = self.wo + wi.as_dvec3() * self.side;
        let (x, y) = (h.x / (self.alpha[0] * h.z), h.y / (self.alpha[1] * h.z));
        let ring = (1..RINGS).find(|&i| x.hypot(y) < self.radius(i as f64)).unwrap_or(RINGS) - 1;
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }

    /// A density over `wi` turned into one over (ring number, sector number).
    fn density(&self, pdf: impl Fn(Vec3) -> f32, ring: f64, sector: f64) -> f64 {
        const STEP: f64 = 1e-4;
        let [ax, ay] = self.alpha;
        let phi = TAU * sector / SECTORS as f64;
        let radius = self.radius(ring);
        let h = DVec3::new(ax * radius * phi.cos(), ay * radius * phi.sin(), 1.0);
        let inverse = h.length_recip();
        let cos = self.wo.dot(h) * inverse;
        let wi = 2.0 * cos * inverse * h - self.wo;
        if cos <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        // Radius per ring, by a difference within the ring's smooth piece.
        let (low, high) = ((ring - STEP).max(ring.floor()), (ring + STEP).min(ring.floor() + 1.0));
        let slope = (self.radius(high) - self.radius(low)) / (high - low);
        let area = ax * ay * radius * slope * TAU / SECTORS as f64;
        f64::from(pdf((self.side * wi).as_vec3())) * 4.0 * cos * inverse.powi(3) * area
    }

    /// Integral of a density over each cell.
    fn integrals(&self, pdf: impl Fn(Vec3) -> f32, samples: u32) -> Vec<f64> {
        // Halvings of a quarter cell at most: the horizon cuts the density off, and more samples see more.
        let depth = if samples > 200_000 { 9 } else { 5 };
        let tolerance = 0.1 / f64::from(samples);
        let f = |ring: f64, sector: f64| self.density(&pdf, ring, sector);
        let mut list = Vec::new();
        for ring in 0..RINGS {
            for sector in 0..SECTORS {
                // Started from 2 x 2 parts, lest a lobe between the nodes be missed; off the rings' seams.
                let half = |start: usize, i: usize| {
                    [i, i + 1].map(|i| start as f64 + (0.5 * i as f64).clamp(1e-9, 1.0 - 1e-9))
                };
                let parts = (0..4).map(|i| integrate(&f, half(ring, i / 2), half(sector, i % 2), tolerance, depth));
                list.push(parts.sum());
            }
        }
        list
    }
}

/// p-value of `samples` samples against `scale * pdf`; checks each sample's pdf and weight on the way.
fn chi_square_of(case: &Case<'_>, wo: Vec3, samples: u32, gain: impl Fn(Vec3) -> f32, seed: u64) -> f64 {
    let Case { name, bsdf, alpha } = case;
    let rings = Rings::new(wo, *alpha);
    let mut random = Pcg32::seed_from_u64(seed);
    let mut observed = vec![0u64; RINGS * SECTORS + 1];
    for _ in 0..samples {
        let u = [random.random(), random.random()];
        let cell = match bsdf.sample(wo, u, random.random()) {
            Some(sample) if !sample.specular => {
                check_sample(name, bsdf, wo, &sample);
                rings.cell(sample.wi)
            }
            // Refused and specular samples share a cell: what the density leaves of 1.
            _ => RINGS * SECTORS,
        };
        observed[cell] += 1;
    }
    let n = f64::from(samples);
    let mut expected = rings.integrals(|wi| gain(wi) * bsdf.pdf(wo, wi), samples);
    let integral: f64 = expected.iter().sum();
    assert!(integral <= 1.0 + 1e-3, "{name} at {wo}: pdf integrates to {integral}");
    // The last cell is a difference, which the quadrature leaves uncertain by some 1e-6.
    expected.push((1.0 - integral).max(5e-6));
    expected.iter_mut().for_each(|e| *e *= n);
    chi_square(&observed, &expected)
}

fn check_sample(name: &str, bsdf: &Bsdf<'_>, wo: Vec3, sample: &BsdfSample) {
    let BsdfSample { wi, weight, pdf, .. } = *sample;
    assert!(wi.z * wo.z > 0.0 && (wi.length() - 1.0).abs() < 1e-6, "{name} at {wo}: {wi}");
    let again = bsdf.pdf(wo, wi);
    assert!(pdf > 0.0 && pdf.is_finite() && (pdf - again).abs() <= 1e-4 * pdf, "{name} {wo} {wi}: {pdf} {again}");
    let f = bsdf.evaluate(wo, wi) * (wi.z.abs() / pdf);
    assert!((f - weight).abs().max_element() <= 1e-4 * f.max_element().max(1e-30), "{name} {wo} {wi}: {f} {weight}");
}

/// Whether f32 directions resolve the lobe: reflected within about `alpha` of the surface, half vectors are
/// `alpha` long, their slopes of order `alpha` are known to 6e-8 / alpha^2 of themselves, and directions form
/// a lattice of that spacing. With 10^6 samples an alpha of 0.01 shows it, too, in the tails.
fn resolved(case: &Case<'_>, wo: Vec3, samples: u32) -> bool {
    let narrowest = if samples > 200_000 { 0.02 } else { 2e-3 };
    wo.z.abs() > 1e-3 || case.alpha[0].max(case.alpha[1]) > narrowest
}

fn check_agreement(cases: &[Case<'_>], samples: u32, resolvable: bool) {
    let outgoing = outgoing();
    let level = sidak(FAMILY, cases.len() * outgoing.len());
    let mut failures = Vec::new();
    for (i, case) in cases.iter().enumerate() {
        for (j, &wo) in outgoing.iter().enumerate() {
            if resolved(case, wo, samples) != resolvable {
                continue;
            }
            let p = chi_square_of(case, wo, samples, |_| 1.0, (1000 * i + j) as u64);
            if p < level {
                failures.push(format!("{} at {wo}: p = {p:e}", case.name));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn l10_diffuse_and_conductors_agree_with_their_pdf() {
    check_agreement(&conductors(), 100_000, true);
}

#[test]
fn l10_coats_agree_with_their_pdf() {
    check_agreement(&coated(&coats()), 100_000, true);
}

#[test]
#[ignore = "nightly: 10^6 samples a direction, some four minutes"]
fn l10_all_agree_with_their_pdf_with_many_samples() {
    check_agreement(&conductors(), 1_000_000, true);
    check_agreement(&coated(&coats()), 1_000_000, true);
}

#[test]
#[ignore = "not met: alpha 1e-3 at cosines 1.7e-4 and 1e-6, p = 0: f32 directions are a lattice wider than 3 % of the lobe"]
fn l10_narrow_lobes_at_grazing_angles_agree_with_their_pdf() {
    check_agreement(&conductors(), 100_000, false);
    check_agreement(&coated(&coats()), 100_000, false);
}

/// Negative control: a density tilted by 5 % across the lobe must be seen, for each BSDF.
#[test]
fn l10_a_wrong_pdf_is_rejected() {
    let coats = coats();
    let wo = Vec3::new(0.6, 0.0, 0.8);
    for case in conductors().iter().chain(&coated(&coats)) {
        // A coat over black, smooth, has no density to be wrong.
        if case.bsdf.pdf(wo, Vec3::new(-0.6, 0.0, 0.8)) == 0.0 {
            continue;
        }
        let p =
            chi_square_of(case, wo, 100_000, |wi| if wi.x * 0.8 + wi.z * 0.6 > 0.0 { 1.05 } else { 0.95 } * 0.95, 1);
        assert!(p < FAMILY, "{}: p = {p:e}", case.name);
    }
}

#[test]
fn l10_specular_lobes() {
    let mirror = Bsdf::conductor(gold(), [9.9e-4, 1e-4]).unwrap();
    assert!(mirror.is_specular() && mirror.roughness() == 0.0);
    for wo in outgoing() {
        let sample = mirror.sample(wo, [0.3, 0.7], 0.5).unwrap();
        assert!(sample.specular && sample.pdf == 1.0);
        assert_eq!(sample.wi, Vec3::new(-wo.x, -wo.y, wo.z));
        assert_eq!((mirror.evaluate(wo, sample.wi), mirror.pdf(wo, sample.wi)), (Vec3::ZERO, 0.0));
        assert!(sample.weight.cmple(Vec3::ONE).all() && sample.weight.cmpgt(Vec3::splat(0.1)).all());
    }
}

#[test]
fn l10_no_light_through_the_surface() {
    let coats = coats();
    let nowhere = [Vec3::X, Vec3::new(1.0, 0.0, -0.0), Vec3::NAN];
    for case in conductors().iter().chain(&coated(&coats)) {
        for wo in outgoing() {
            for wi in nowhere.into_iter().chain([-wo, Vec3::new(0.0, 0.6, -0.8 * wo.z.signum())]) {
                assert_eq!(case.bsdf.evaluate_and_pdf(wo, wi), (Vec3::ZERO, 0.0), "{} {wo} {wi}", case.name);
            }
        }
        for wo in nowhere {
            assert_eq!(case.bsdf.sample(wo, [0.5; 2], 0.5), None, "{} {wo}", case.name);
        }
    }
}

/// The mean weight's verdict by `judge`, with samples doubled while undecided.
fn albedo(bsdf: &Bsdf<'_>, wo: Vec3, gain: f64, seed: u64, judge: impl Fn(&Mean) -> Verdict) -> (Verdict, Mean) {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut mean = Mean::default();
    for doubling in 12..=22 {
        while mean.n < 1 << doubling {
            let u = [random.random(), random.random()];
            let weight = bsdf.sample(wo, u, random.random()).map_or(0.0, |s| f64::from(s.weight.max_element()));
            mean.add(gain * weight);
        }
        match judge(&mean) {
            Verdict::Undecided => (),
            verdict => return (verdict, mean),
        }
    }
    (Verdict::Undecided, mean)
}

#[test]
fn l11_energy() {
    let coats = coats();
    let cases: Vec<_> = conductors().into_iter().chain(coated(&coats)).collect();
    // Doubling looks at the data up to 11 times; each look is a test.
    let z = critical(sidak(FAMILY, cases.len() * 64 * 11));
    for (i, case) in cases.iter().enumerate() {
        for j in 0..64 {
            let cos = (f64::from(j) + 0.5) / 64.0;
            let wo = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos).as_vec3();
            let (verdict, mean) = albedo(&case.bsdf, wo, 1.0, 64 * i as u64 + j as u64, |m| m.below(1.0 + 1e-4, z));
            assert_eq!(verdict, Verdict::Pass, "{} at {cos}: {mean:?}", case.name);
        }
    }
}

/// A coat that absorbs nothing over a white base is a furnace: all light comes back. With 0.5 % of gain, the
/// negative control, it must be refused.
#[test]
fn l11_furnace_and_its_negative_control() {
    let lossless = CoatOptions { thickness: 0.0, max_depth: u32::MAX, ..Default::default() };
    let z = critical(sidak(FAMILY, 2 * 3 * 5 * 11));
    for (alpha, tolerance) in [(0.0, 1e-3), (1e-3, 1e-3)] {
        let coat = Coat::new(CoatOptions { alpha: [alpha; 2], ..lossless }).unwrap();
        let white = Bsdf::coated_diffuse(&coat, Vec3::ONE);
        for cos in [0.05, 0.2, 0.5, 0.8, 1.0f32] {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let (verdict, mean) = albedo(&white, wo, 1.0, 7, |m| m.equals(1.0, tolerance, z));
            assert_eq!(verdict, Verdict::Pass, "alpha {alpha} at {cos}: {mean:?}");
            for judge in [|m: &Mean, z| m.below(1.0 + 1e-4, z), |m: &Mean, z| m.equals(1.0, 1e-3, z)] {
                let (verdict, mean) = albedo(&white, wo, 1.005, 8, |m| judge(m, z));
                assert_eq!(verdict, Verdict::Fail, "gain not seen, alpha {alpha} at {cos}: {mean:?}");
            }
        }
    }
}

#[test]
fn l11_reciprocity() {
    let coats = coats();
    let mut random = Pcg32::seed_from_u64(11);
    let mut direction = || {
        let z: f32 = 1.0 - random.random::<f32>();
        let (r, turn) = ((1.0 - z * z).sqrt(), random.random::<f32>() * std::f32::consts::TAU);
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    for case in conductors().iter().chain(&coated(&coats)) {
        for i in 0..100_000 {
            let a = direction();
            // Half of the pairs near the mirror direction, where f is large.
            let near = (Vec3::new(-a.x, -a.y, a.z) + case.alpha[0].min(case.alpha[1]) * direction()).normalize();
            let b = if i % 2 == 0 { direction() } else { near };
            let (ab, ba) = (case.bsdf.evaluate(a, b), case.bsdf.evaluate(b, a));
            assert!((ab - ba).abs().cmple(1e-5 * ab).all(), "{}: f({a}, {b}) = {ab}, back {ba}", case.name);
            assert_eq!(ab, case.bsdf.evaluate(-a, -b));
        }
    }
}

#[test]
fn dielectric_and_conductor_reflectances() {
    use dapple_renderer::shading::fresnel::{dielectric, transmitted_cosine};
    assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-7);
    assert!((dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-7);
    assert_eq!(dielectric(0.0, 1.5), 1.0);
    assert_eq!(dielectric(0.7, 1.0 / 1.5), 1.0);
    assert_eq!(transmitted_cosine(0.7, 1.0 / 1.5), None);
    // Brewster's angle: only the perpendicular part, ((1 - eta^2) / (1 + eta^2))^2 / 2.
    assert!((dielectric((1.0f32 / 3.25).sqrt(), 1.5) - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-6);
    // Normal incidence on a metal: ((eta - 1)^2 + k^2) / ((eta + 1)^2 + k^2).
    let metal = gold();
    let normal = ((metal.eta - 1.0).powf(2.0) + metal.k * metal.k) / ((metal.eta + 1.0).powf(2.0) + metal.k * metal.k);
    assert!((metal.reflectance(1.0) - normal).abs().max_element() < 1e-6);
    assert_eq!(metal.reflectance(0.0), Vec3::ONE);
    for r in [0.0, 0.2, 0.9, 0.9999] {
        let back = ComplexIor::from_reflectance(Vec3::splat(r)).reflectance(1.0);
        assert!((back - r).abs().max_element() < 1e-5, "{r} {back}");
    }
    // Without absorption a conductor is a dielectric; complex arithmetic in f64 agrees elsewhere.
    for i in 0..=1000 {
        let cos = i as f32 / 1000.0;
        let glass = ComplexIor { eta: Vec3::new(1.5, 1.0, 1.0 / 1.5), k: Vec3::ZERO }.reflectance(cos);
        assert!((glass.x - dielectric(cos, 1.5)).abs() < 2e-6, "{cos}");
        assert!(glass.y.abs() < 1e-6, "{cos}: {}", glass.y);
        assert!((glass.z - dielectric(cos, 1.0 / 1.5)).abs() < 2e-4, "{cos}: {}", glass.z);
        for (eta, k) in [(0.2, 3.9), (4.37, 9.22), (1e-3, 1e-3), (50.0, 0.1)] {
            let r = ComplexIor { eta: Vec3::splat(eta), k: Vec3::splat(k) }.reflectance(cos).x;
            let exact = conductor_reference(f64::from(cos), f64::from(eta), f64::from(k));
            assert!((f64::from(r) - exact).abs() < 1e-5, "{cos} {eta} {k}: {r} {exact}");
        }
    }
}

/// Fresnel's amplitudes in complex arithmetic.
fn conductor_reference(cos: f64, eta: f64, k: f64) -> f64 {
    type C = (f64, f64);
    let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let square = |a: C| a.0 * a.0 + a.1 * a.1;
    let n2 = mul((eta, k), (eta, k));
    let (re, im) = (n2.0 - (1.0 - cos * cos), n2.1);
    let (modulus, angle) = (re.hypot(im).sqrt(), 0.5 * im.atan2(re));
    let root = (modulus * angle.cos(), modulus * angle.sin());
    let ratio = |p: C, q: C| square((p.0 - q.0, p.1 - q.1)) / square((p.0 + q.0, p.1 + q.1)).max(1e-300);
    0.5 * (ratio((cos, 0.0), root) + ratio((n2.0 * cos, n2.1 * cos), root))
}
