//! BSDFs: sampling, density and value agree on both sides; energy is conserved; BSDFs are reciprocal.

use crate::densities::{Below, Case, albedo, check_agreement, chi_square_of, outgoing};
use crate::support::*;
use dapple_renderer::shading::{
    Bsdf, Coat, CoatOptions, ComplexIor, DiffuseTransmission, Layered, Layers, MetalCoat, Plastic, Substrate, Tint,
    TrowbridgeReitz, fresnel,
};
use std::sync::LazyLock;

fn gold() -> ComplexIor {
    ComplexIor { eta: Vec3::new(0.2, 0.92, 1.1), k: Vec3::new(3.9, 2.45, 2.14) }
}

fn opaque(name: String, bsdf: Bsdf<'static>, alpha: [f32; 2]) -> Case<'static> {
    Case { name, bsdf, alpha, below: Below::Nothing }
}

/// Returns a white sheet, and metals from the narrowest rough width to the widest, some anisotropic.
fn conductors() -> Vec<Case<'static>> {
    let diffuse = Bsdf::Diffuse { reflectance: Vec3::new(1.0, 0.5, 0.1) };
    let mut cases = vec![opaque("diffuse".into(), diffuse, [1.0; 2])];
    cases.extend(
        WIDTHS.map(|alpha| opaque(format!("conductor {alpha:?}"), Bsdf::conductor(gold(), alpha).unwrap(), alpha)),
    );
    cases
}

const WIDTHS: [[f32; 2]; 7] = [[1e-3; 2], [0.01; 2], [0.1; 2], [0.5; 2], [1.0; 2], [0.05, 0.5], [1e-4, 0.3]];

/// Coats with the optical thickness and depth of pbrt-v4's defaults.
static COATS: LazyLock<[(f32, Coat); 4]> = LazyLock::new(|| {
    [0.0, 1e-3, 0.1, 0.6].map(|a| (a, Coat::new(CoatOptions { alpha: [a; 2], ..Default::default() }).unwrap()))
});

fn coats() -> Vec<Case<'static>> {
    let case = |(alpha, coat): &'static (f32, Coat), rho: f32| {
        let bsdf = Bsdf::coated_diffuse(coat, Vec3::new(rho, 0.5 * rho, 0.1 * rho));
        opaque(format!("coat {alpha} over {rho}"), bsdf, [if *alpha < 1e-3 { 1.0 } else { *alpha }; 2])
    };
    COATS.iter().flat_map(|coat| [0.9, 0.0].map(|rho| case(coat, rho))).collect()
}

fn glass(eta: f32, alpha: [f32; 2], tint: Tint) -> Case<'static> {
    let bsdf = Bsdf::dielectric(eta, alpha, tint).unwrap();
    Case { name: format!("glass of {eta}, {alpha:?}"), bsdf, alpha, below: Below::Refracted(eta.into()) }
}

fn green() -> Tint {
    Tint { reflectance: Vec3::new(0.2, 0.9, 0.1), transmittance: Vec3::new(0.5, 0.7, 0.0) }
}

/// Returns crown glass, diamond, a bubble, tinted glass, and a transmitting sheet.
fn transmitting() -> Vec<Case<'static>> {
    let mut list: Vec<_> = WIDTHS.map(|alpha| glass(1.5, alpha, Tint::WHITE)).into();
    list.extend([glass(2.4, [0.2; 2], Tint::WHITE), glass(0.75, [0.3; 2], Tint::WHITE), glass(1.5, [0.3; 2], green())]);
    let (reflectance, transmittance) = (Vec3::new(0.3, 0.2, 0.1), Vec3::new(0.6, 0.1, 0.05));
    let bsdf = Bsdf::DiffuseTransmission(DiffuseTransmission { reflectance, transmittance });
    list.push(Case { name: "sheet".into(), bsdf, alpha: [1.0; 2], below: Below::Mirrored });
    list
}

/// Smooth, nearly smooth, rough and anisotropic coats over metals of the same kinds, with the narrowest width of each pair.
static METAL_COATS: LazyLock<Vec<(String, f32, MetalCoat)>> = LazyLock::new(|| {
    let made = |(coat, metal): ([f32; 2], [f32; 2])| {
        let made = MetalCoat::new(CoatOptions { alpha: coat, ..Default::default() }, metal).unwrap();
        let narrowest = coat.into_iter().chain(metal).filter(|a| *a > 0.0).fold(1.0, f32::min);
        // A smooth metal below a rough coat has a lobe of a quarter of the coat's width.
        let narrowest = if metal[0] == 0.0 { 0.25 * narrowest } else { narrowest };
        (format!("coat {coat:?} over metal {metal:?}"), narrowest, made)
    };
    let (smooth, wide) = ([0.0; 2], [1.0; 2]);
    [(smooth, [0.1; 2]), ([0.1; 2], smooth), ([0.3; 2], [0.05; 2]), ([0.05, 0.3], [0.6; 2]), (smooth, wide)]
        .map(made)
        .into()
});

/// glTF's layers: without a coat, with half of a narrow coat, and with a whole rough one.
static LAYERS: LazyLock<[(f32, Layers); 3]> = LazyLock::new(|| {
    let coat = |amount, alpha| Some((amount, TrowbridgeReitz::new([alpha; 2]).unwrap()));
    let layers = [(1.0, None), (0.05, coat(0.5, 0.05)), (0.4, coat(1.0, 0.4))];
    layers.map(|(narrowest, coat)| (narrowest, Layers { normal: Vec3::new(0.04, 0.05, 0.06), grazing: 1.0, coat }))
});

/// Returns every roughness with all layers and all fractions of metal. Any three consecutive cases contain each fraction once.
/// Every third case belongs to a Latin square of roughness, layers and fraction.
fn layered() -> Vec<Case<'static>> {
    let base = Vec3::new(0.4, 0.2, 0.1);
    let mut list = Vec::new();
    for (i, alpha) in [[0.05; 2], [0.1; 2], [0.5; 2], [0.1, 0.4]].into_iter().enumerate() {
        let microfacets = TrowbridgeReitz::new(alpha).unwrap();
        for (j, (narrowest, layers)) in LAYERS.iter().enumerate() {
            let alpha = alpha.map(|a| a.min(*narrowest));
            for k in 0..3 {
                let metallic = [0.0, 0.4, 1.0][(i + j + k) % 3];
                let bsdf = Bsdf::Layered(Layered { base, metallic, microfacets, layers });
                list.push(opaque(format!("layered, {metallic} metal, {alpha:?}"), bsdf, alpha));
            }
        }
    }
    list
}

fn glossy() -> Vec<Case<'static>> {
    let coat = |(name, narrowest, coat): &'static (String, f32, MetalCoat)| {
        opaque(name.clone(), Bsdf::coated_conductor(coat, gold()), [*narrowest; 2])
    };
    let mut list: Vec<_> = METAL_COATS.iter().map(coat).collect();
    let (diffuse, specular) = (Vec3::new(0.4, 0.2, 0.1), Vec3::new(0.5, 0.3, 0.05));
    for alpha in [[0.02; 2], [0.1; 2], [0.5; 2], [0.05, 0.4]] {
        let microfacets = TrowbridgeReitz::new(alpha).unwrap();
        let plastic = Bsdf::Plastic(Plastic { diffuse, specular, microfacets });
        let substrate = Bsdf::Substrate(Substrate { diffuse, specular: specular * 0.2, microfacets });
        list.push(opaque(format!("plastic {alpha:?}"), plastic, alpha));
        list.push(opaque(format!("substrate {alpha:?}"), substrate, alpha));
    }
    list.extend(layered().into_iter().step_by(3));
    list
}

fn all() -> Vec<Case<'static>> {
    conductors().into_iter().chain(coats()).chain(glossy()).chain(transmitting()).collect()
}

/// Returns outgoing directions, every second one from inside.
fn both_sides() -> Vec<Vec3> {
    outgoing().iter().enumerate().map(|(i, w)| if i % 2 == 0 { *w } else { -*w }).collect()
}

/// The test uses some surfaces of each kind with a quarter of the directions each; the thorough test uses all.
#[test]
fn samples_agree_with_their_pdf_l10() {
    for (cases, directions, step) in [
        (conductors(), outgoing(), 2),
        (coats(), outgoing(), 3),
        (glossy(), outgoing(), 3),
        (transmitting(), both_sides(), 1),
    ] {
        let cases: Vec<_> = cases.into_iter().step_by(thorough(step, 1)).collect();
        check_agreement(&cases, &directions, 100_000, true, thorough(4, 1));
    }
}

#[test]
#[ignore = "nightly: 10^6 samples a direction, minutes"]
fn samples_agree_with_their_pdf_with_many_samples_l10() {
    for (cases, outgoing) in [(all(), outgoing()), (layered(), outgoing()), (transmitting(), both_sides())] {
        check_agreement(&cases, &outgoing, 1_000_000, true, 1);
    }
}

#[test]
#[ignore = "not met: alpha 1e-3 at cosines 1.7e-4 and 1e-6, p = 0: f32 directions are a lattice wider than 3 % of the lobe"]
fn narrow_lobes_at_grazing_angles_agree_with_their_pdf_l10() {
    check_agreement(&conductors(), &outgoing(), 100_000, false, 1);
    check_agreement(&coats(), &outgoing(), 100_000, false, 1);
}

/// Negative controls: for each BSDF, a density tilted by 5 % across the lobe is detected (15 % for the roughest metal below a
/// smooth coat, where most light stays inside). A density with 10 % too little transmission is detected as well.
#[test]
fn a_wrong_pdf_is_rejected_l10() {
    for case in all().into_iter().step_by(thorough(2, 1)) {
        let check = |wo: Vec3, gain: &dyn Fn(Vec3) -> f32, seed: u64| {
            let p = chi_square_of(&case, wo, 100_000, gain, seed);
            assert!(p < FAMILY, "{} at {wo}: p = {p:e}", case.name);
        };
        let (above, below) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.6, 0.0, -0.8));
        if case.below == Below::Nothing {
            let by = if case.name.ends_with("metal [1.0, 1.0]") { 0.15 } else { 0.05 };
            let tilted = |wi: Vec3| (1.0 - by) * (1.0 + if wi.x * 0.8 + wi.z * 0.6 > 0.0 { by } else { -by });
            // A smooth coat over black has no density.
            if case.bsdf.pdf(above, Vec3::new(-0.6, 0.0, 0.8)) > 0.0 {
                check(above, &tilted, 1);
            }
            continue;
        }
        for wo in [above, below] {
            check(wo, &|wi| if wi.x > -0.6 { 0.95 } else { 0.9 }, 1);
            // From inside, all light may be reflected.
            let sample = |i: u16| case.bsdf.sample(wo, [(f32::from(i) + 0.5) / 1000.0, 0.3], 0.999);
            if (0..1000).any(|i| sample(i).is_some_and(|s| s.wi.z * wo.z < 0.0)) {
                check(wo, &|wi| if wi.z * wo.z < 0.0 { 0.9 } else { 1.0 }, 2);
            }
        }
    }
}

#[test]
fn specular_lobes_have_no_density_l10() {
    let metal = Bsdf::conductor(gold(), [9.9e-4, 1e-4]).unwrap();
    let smooth = Bsdf::dielectric(1.5, [9e-4, 1e-4], Tint::WHITE).unwrap();
    let empty = Bsdf::dielectric(1.0, [0.5; 2], Tint::WHITE).unwrap();
    let pane = Bsdf::ThinDielectric { eta: 1.5 };
    let mirror = Bsdf::Mirror { reflectance: Vec3::new(0.9, 0.5, 0.0) };
    for (bsdf, through) in [(metal, false), (smooth, true), (empty, true), (pane, true), (mirror, false)] {
        assert!(bsdf.is_specular() && bsdf.roughness() == 0.0 && bsdf.transmits() == through);
        for wo in both_sides() {
            let (mut seen, mut share) = ([false; 2], 0.0);
            for i in 0..256 {
                let sample = bsdf.sample(wo, [0.3, 0.7], (i as f32 + 0.5) / 256.0).unwrap();
                assert!(sample.specular && (sample.wi.length() - 1.0).abs() < 1e-6, "{bsdf:?} {wo} {sample:?}");
                assert!(sample.weight.cmple(Vec3::splat(2.26)).all() && sample.weight.max_element() > 0.1);
                assert_eq!(bsdf.evaluate_and_pdf(wo, sample.wi), (Vec3::ZERO, 0.0));
                let crosses = sample.wi.z * wo.z < 0.0;
                share += if seen[usize::from(crosses)] { 0.0 } else { sample.pdf };
                seen[usize::from(crosses)] = true;
                let tangents = (wo + sample.eta * sample.wi).truncate().length();
                let is_reflected = sample.eta == 1.0 && sample.wi == Vec3::new(-wo.x, -wo.y, wo.z);
                assert!(if crosses { tangents < 1e-6 } else { is_reflected }, "Snell: {bsdf:?} {wo} {sample:?}");
            }
            // The 256 samples may miss a lobe of small probability.
            assert!(share <= 1.0 + 1e-6 && share > 1.0 - 1.0 / 128.0, "{bsdf:?} {wo}: {share}");
        }
    }
    // Light passes straight through an interface of index 1 and through a pane.
    for bsdf in [empty, pane] {
        let wo = Vec3::new(0.6, 0.0, -0.8);
        let sample = bsdf.sample(wo, [0.5; 2], 0.9).unwrap();
        assert!(sample.wi == -wo && sample.eta == 1.0 && (sample.weight - 1.0).abs().max_element() < 1e-6);
    }
    // 4 % of each face along the normal: 2 R / (1 + R).
    let reflected = pane.sample(Vec3::Z, [0.5; 2], 0.0).unwrap();
    assert!((reflected.pdf - 0.08 / 1.04).abs() < 1e-6 && (fresnel::pane(1.0, 1.5) - reflected.pdf).abs() < 1e-7);
}

/// Invalid directions scatter nothing, and opaque surfaces transmit nothing.
#[test]
fn no_light_comes_from_nowhere_l10() {
    let nowhere = [Vec3::X, Vec3::new(1.0, 0.0, -0.0), Vec3::NAN];
    for case in all() {
        let check =
            |wo, wi| assert_eq!(case.bsdf.evaluate_and_pdf(wo, wi), (Vec3::ZERO, 0.0), "{} {wo} {wi}", case.name);
        for wo in both_sides() {
            nowhere.into_iter().for_each(|wi| (check(wo, wi), check(wi, wo)).0);
            if case.below == Below::Nothing {
                [-wo, Vec3::new(0.0, 0.6, -0.8 * wo.z.signum())].into_iter().for_each(|wi| check(wo, wi));
            }
        }
        assert!(nowhere.iter().all(|wo| case.bsdf.sample(*wo, [0.5; 2], 0.5).is_none()), "{}", case.name);
    }
    let black = Bsdf::dielectric(1.5, [0.0; 2], Tint { reflectance: Vec3::ZERO, transmittance: Vec3::ZERO }).unwrap();
    assert!(black.sample(Vec3::Z, [0.5; 2], 0.5).is_none_or(|s| s.weight == Vec3::ZERO));
}

/// The test uses 32 angles. For transmitting surfaces, half of them are from inside.
#[test]
fn surfaces_conserve_energy_l11() {
    let cases = all();
    // Doubling tests the data up to 11 times.
    let z = critical(sidak(FAMILY, cases.len() * 32 * 11));
    for (i, case) in cases.iter().enumerate() {
        for j in 0..32 {
            let cos = (f64::from(j) + 0.5) / 32.0;
            let wo = slanted(if case.below == Below::Nothing { cos } else { 2.0 * cos - 1.0 });
            let (verdict, mean) = albedo(&case.bsdf, wo, 1.0, 64 * i as u64 + j as u64, |m| m.below(1.0 + 1e-4, z));
            assert_eq!(verdict, Verdict::Pass, "{} at {wo}: {mean:?}", case.name);
        }
    }
}

/// A coat without absorption over a white base returns all light. Rough glass loses the light that a second facet would
/// scatter, and nearly smooth glass none. White layers reflect all light, up to the table's interpolation. Negative control: a
/// gain of 0.5 % is detected.
#[test]
fn white_surfaces_are_furnaces_l11() {
    let lossless = CoatOptions { thickness: 0.0, max_depth: u32::MAX, ..Default::default() };
    let z = critical(sidak(FAMILY, 2 * 3 * 8 * 11));
    let coats = [0.0, 1e-3].map(|alpha| Coat::new(CoatOptions { alpha: [alpha; 2], ..lossless }).unwrap());
    let above = [0.05, 0.2, 0.5, 0.8, 1.0];
    let sides = [1.0, 0.8, 0.5, 0.2, -0.2, -0.5, -0.8, -1.0];
    for (bsdf, cosines) in [
        (Bsdf::coated_diffuse(&coats[0], Vec3::ONE), &above[..]),
        (Bsdf::coated_diffuse(&coats[1], Vec3::ONE), &above),
        (glass(1.5, [2e-3; 2], Tint::WHITE).bsdf, &sides),
    ] {
        for wo in cosines.iter().copied().map(slanted) {
            let (verdict, mean) = albedo(&bsdf, wo, 1.0, 7, |m| m.equals(1.0, 1e-3, z));
            assert_eq!(verdict, Verdict::Pass, "{bsdf:?} at {wo}: {mean:?}");
            for judge in [|m: &Mean, z| m.below(1.0 + 1e-4, z), |m: &Mean, z| m.equals(1.0, 1e-3, z)] {
                let (verdict, mean) = albedo(&bsdf, wo, 1.005, 8, |m| judge(m, z));
                assert_eq!(verdict, Verdict::Fail, "gain not seen, {bsdf:?} at {wo}: {mean:?}");
            }
        }
    }
    for (i, alpha) in [0.01, 0.1, 0.4, 1.0].into_iter().enumerate() {
        let microfacets = TrowbridgeReitz::new([alpha; 2]).unwrap();
        for (k, (metallic, normal)) in [(0.0, 0.04), (0.0, 0.5), (1.0, 0.04), (0.5, 0.04)].into_iter().enumerate() {
            let layers = Layers { normal: Vec3::splat(normal), grazing: 1.0, coat: None };
            let bsdf = Bsdf::Layered(Layered { base: Vec3::ONE, metallic, microfacets, layers: &layers });
            for (j, cos) in [0.1, 0.4, 0.9].into_iter().enumerate() {
                let seed = (100 * i + 10 * k + j) as u64;
                let (verdict, mean) = albedo(&bsdf, slanted(cos), 1.0, seed, |m| m.equals(1.0, 0.012, 4.0));
                assert_eq!(verdict, Verdict::Pass, "{alpha} {metallic} {normal} at {cos}: {mean:?}");
            }
        }
    }
}

/// Smooth glass and panes lose no light: each lobe's flux equals its probability. The same holds for a mirror of reflectance 1
/// below a smooth coat without absorption.
#[test]
fn smooth_surfaces_are_exact_furnaces_l11() {
    for eta in [1.0, 1.33, 1.5, 2.4, 0.5] {
        for bsdf in [Bsdf::dielectric(eta, [0.0; 2], Tint::WHITE).unwrap(), Bsdf::ThinDielectric { eta }] {
            for (wo, lobe) in both_sides().into_iter().flat_map(|wo| [0.0, 0.01, 0.2, 0.5, 0.999_999].map(|u| (wo, u)))
            {
                let sample = bsdf.sample(wo, [0.5; 2], lobe).unwrap();
                let flux = sample.weight * (sample.eta * sample.eta);
                assert!((flux - 1.0).abs().max_element() < 1e-6, "{bsdf:?} {wo} {lobe}: {sample:?}");
            }
        }
    }
    let lossless = CoatOptions { thickness: 0.0, max_depth: u32::MAX, ..Default::default() };
    let coat = MetalCoat::new(lossless, [0.0; 2]).unwrap();
    let all = Bsdf::coated_conductor(&coat, ComplexIor { eta: Vec3::ZERO, k: Vec3::splat(3.0) });
    let gold = Bsdf::coated_conductor(&coat, gold());
    assert!(all.is_specular() && gold.is_specular());
    for wo in [0.01, 0.1, 0.3, 0.7, 1.0].map(slanted) {
        let [all, gold] = [all, gold].map(|bsdf| bsdf.sample(wo, [0.5; 2], 0.5).unwrap().weight);
        assert!((all - 1.0).abs().max_element() < 1e-5, "{wo}: {all}");
        assert!(gold.cmplt(Vec3::splat(0.9999)).all(), "each of gold's channels loses some light: {gold}");
    }
}

/// Refraction is symmetric up to the squared index and rounding.
#[test]
fn surfaces_are_reciprocal_l11() {
    let mut random = Pcg32::seed_from_u64(11);
    for case in all() {
        let (is_opaque, narrowest) = (case.below == Below::Nothing, case.alpha[0].min(case.alpha[1]));
        let mut direction = || {
            let z: f32 = if is_opaque { 1.0 - random.random::<f32>() } else { 1.0 - 2.0 * random.random::<f32>() };
            let (r, turn) = ((1.0 - z * z).sqrt(), random.random::<f32>() * std::f32::consts::TAU);
            Vec3::new(r * turn.cos(), r * turn.sin(), z)
        };
        let eta = if let Below::Refracted(eta) = case.below { eta as f32 } else { 1.0 };
        let mut met = 0;
        for i in 0..30_000 {
            let a = direction();
            // Half of the pairs near the mirror direction, or by refraction at a facet near the normal: where f is large.
            let near = direction() * narrowest;
            let b = match case.below {
                _ if i % 2 == 0 => direction(),
                Below::Refracted(_) => {
                    let (m, index) =
                        ((near + Vec3::Z * a.z.signum()).normalize(), if a.z > 0.0 { eta } else { 1.0 / eta });
                    let cos = a.dot(m).max(0.0);
                    let refracted = fresnel::transmitted_cosine(cos, index).map(|c| (cos / index - c) * m - a / index);
                    refracted.map_or(-a, |w| w.normalize())
                }
                _ => (Vec3::new(-a.x, -a.y, a.z) + near).normalize(),
            };
            let scale = match (a.z > 0.0, b.z > 0.0) {
                (true, false) => eta * eta,
                (false, true) => 1.0 / (eta * eta),
                _ => 1.0,
            };
            let (ab, ba) = (case.bsdf.evaluate(a, b) * scale, case.bsdf.evaluate(b, a));
            met += u32::from(ab.max_element() > 0.0 && a.z * b.z < 0.0);
            assert!((ab - ba).abs().cmple(1e-5 * ab).all(), "{}: f({a}, {b}) = {ab}, back {ba}", case.name);
            assert!(!is_opaque || ab == case.bsdf.evaluate(-a, -b), "{}: {a} {b}", case.name);
        }
        assert!(is_opaque || met > 3000, "{}: {met}", case.name);
    }
}

/// Values along the normal are compared with values computed by hand.
#[test]
fn values_along_the_normal() {
    use std::f32::consts::PI;
    let microfacets = TrowbridgeReitz::new([0.3; 2]).unwrap();
    let d = 1.0 / (PI * 0.09);
    let (diffuse, specular) = (Vec3::new(0.4, 0.2, 0.1), Vec3::new(0.5, 0.3, 0.05));
    let glass = glass(1.5, [0.3; 2], green()).bsdf;
    let plastic = Bsdf::Plastic(Plastic { diffuse, specular, microfacets });
    let substrate = Bsdf::Substrate(Substrate { diffuse, specular, microfacets });
    let powers = (1.0f32 - 0.5f32.powi(5)).powi(2) * 28.0 / (23.0 * PI);
    // Transmitted radiance: (1 - F) D / (1 - eta)^2.
    let transmitted = green().transmittance * 0.96 * d / 0.25;
    for (bsdf, wo, wi, expected) in [
        (&plastic, Vec3::Z, Vec3::Z, diffuse / PI + specular * (0.04 * d / 4.0)),
        (&substrate, Vec3::Z, Vec3::Z, diffuse * (Vec3::ONE - specular) * powers + specular * (d / 4.0)),
        (&glass, Vec3::Z, Vec3::Z, green().reflectance * 0.04 * d / 4.0),
        (&glass, Vec3::Z, -Vec3::Z, transmitted),
        (&glass, -Vec3::Z, Vec3::Z, transmitted * 2.25),
    ] {
        let found = bsdf.evaluate(wo, wi);
        assert!((found - expected).abs().cmple(1e-5 * expected.max(Vec3::splat(0.1))).all(), "{found} {expected}");
    }
}

#[test]
fn dielectric_and_conductor_reflectances() {
    use fresnel::{dielectric, transmitted_cosine};
    // At normal incidence, at grazing and in total reflection, and at Brewster's angle: only the perpendicular part,
    // ((1 - eta^2) / (1 + eta^2))^2 / 2.
    let brewster = 0.5 * (1.25f32 / 3.25).powi(2);
    for (cos, eta, expected) in [
        (1.0, 1.5, 0.04),
        (1.0, 1.0 / 1.5, 0.04),
        (0.0, 1.5, 1.0),
        (0.7, 1.0 / 1.5, 1.0),
        ((1.0f32 / 3.25).sqrt(), 1.5, brewster),
    ] {
        assert!((dielectric(cos, eta) - expected).abs() < if expected == 1.0 { 1e-30 } else { 1e-6 }, "{cos} {eta}");
    }
    assert_eq!(transmitted_cosine(0.7, 1.0 / 1.5), None);
    assert_eq!(gold().reflectance(0.0), Vec3::ONE);
    for r in [0.0, 0.2, 0.9, 0.9999] {
        let back = ComplexIor::from_reflectance(Vec3::splat(r)).reflectance(1.0);
        assert!((back - r).abs().max_element() < 1e-5, "{r} {back}");
    }
    // Without absorption a conductor is a dielectric; elsewhere complex arithmetic in f64 agrees.
    for i in 0..=1000 {
        let cos = i as f32 / 1000.0;
        let glass = ComplexIor { eta: Vec3::new(1.5, 1.0, 1.0 / 1.5), k: Vec3::ZERO }.reflectance(cos);
        assert!((glass.x - dielectric(cos, 1.5)).abs() < 2e-6 && glass.y.abs() < 1e-6, "{cos}: {glass}");
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
