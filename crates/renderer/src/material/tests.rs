//! Tests of materials prepared for shading.

use super::*;
use crate::support::{add_texture, diffuse, metal};
use dapple_scene::image::Image;
use dapple_scene::{Scene, TextureId, TextureKind, Wrap};
use std::sync::Arc;

fn surface(kind: MaterialKind) -> Result<Surface, String> {
    Surface::new(&Material::new("m", kind, Source::default())).map_err(|e| e.to_string())
}

fn sound(kind: MaterialKind) -> Surface {
    surface(kind).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    for bad in [-0.1, f32::NAN, f32::INFINITY] {
        let kind = MaterialKind::Diffuse { reflectance: Color::Constant([0.5, bad, 0.5]) };
        assert!(surface(kind).is_err_and(|e| e.contains("material \"m\"")), "{bad}");
        assert!(surface(metal(bad)).is_err(), "{bad}");
    }
    assert!(surface(metal(11.0)).is_err());
    assert!(surface(metal(0.0)).is_ok_and(|s| !s.several_lobes && !s.anisotropic));
    assert!(surface(diffuse(0.0)).is_ok_and(|s| s.black));
}

#[test]
fn reflectances_lie_between_0_and_1() {
    let pixels = vec![[-0.5, 2.0, f32::NAN]];
    let image = Arc::new(Image::new([1, 1], pixels).expect("one pixel"));
    let kind =
        TextureKind::Image { image, scale: [1.0; 2], shift: [0.0; 2], factor: 1.0, invert: false, wrap: Wrap::Repeat };
    let mut scene = Scene::default();
    let color = Color::Texture(add_texture(&mut scene, "", kind));
    let textures = Textures::new(&scene.textures);
    let coated = MaterialKind::CoatedDiffuse { reflectance: color, coat: Coating::default() };
    let roughness = Roughness::constant(0.3, 0.3, false);
    let tinted = MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(color), roughness };
    for kind in [MaterialKind::Diffuse { reflectance: color }, coated, tinted] {
        let surface = sound(kind.clone());
        assert!(surface.textured);
        let bsdf = surface.bsdf(&textures, [0.5, 0.5]);
        let up = Vec3::new(0.0, 0.6, 0.8);
        let f = bsdf.evaluate(up, up).to_array();
        assert!(f.iter().all(|x| *x >= 0.0 && x.is_finite()), "{kind:?}: {f:?}");
        let albedo = bsdf.albedo().to_array();
        assert!(albedo.iter().all(|a| (0.0..=1.0).contains(a)), "{kind:?}: {albedo:?}");
    }
}

fn mix(parts: [u32; 2], amount: f32) -> MaterialKind {
    MaterialKind::Mix { materials: parts.map(dapple_scene::MaterialId), amount: Scalar::Constant(amount) }
}

#[test]
fn one_coordinate_resolves_nested_mixes() {
    // Material 1 has 0.25, and the interface has 0.4 of the rest.
    let kinds = [mix([2, 1], 0.25), diffuse(0.5), mix([3, 4], 0.4), diffuse(0.1), MaterialKind::Interface];
    let surfaces: Vec<Surface> = kinds.into_iter().map(sound).collect();
    let textures = Textures::default();
    let mut counts = [0u32; 5];
    let n = 100_000;
    for i in 0..n {
        let (found, index) = resolve(&surfaces, 0, &textures, [0.0; 2].into(), (i as f32 + 0.5) / n as f32);
        assert!(!found.mixes);
        counts[index as usize] += 1;
    }
    for (count, share) in counts.into_iter().zip([0.0, 0.25, 0.0, 0.45, 0.3]) {
        assert!((f64::from(count) / f64::from(n) - share).abs() < 1e-4, "{counts:?}");
    }
    assert!((passed_share(&surfaces, 0, &textures, || [0.0; 2].into()) - 0.3).abs() < 1e-6);
    let asked = || panic!("no mix, no coordinates");
    assert_eq!(passed_share(&surfaces, 4, &textures, asked), 1.0);
    // Materials without scattering of their own have an empty BSDF.
    for surface in [&surfaces[0], &surfaces[4]] {
        assert_eq!(surface.bsdf(&textures, [0.0; 2]).albedo(), Vec3::ZERO);
    }
}

#[test]
fn mixes_that_are_none_are_refused_by_name() {
    let named = |name: &str, kind| Material::new(name, kind, Source::default());
    let told = |materials: &[Material]| check_mixes(materials).iter().map(ToString::to_string).collect::<Vec<_>>();
    let circle = [named("a", mix([1, 2], 0.5)), named("b", mix([2, 0], 0.5)), named("c", diffuse(0.5))];
    let problems = told(&circle);
    assert!(problems.len() == 1 && problems[0].contains("\"a\"") && problems[0].contains("\"b\""), "{problems:?}");
    assert_eq!(told(&[named("self", mix([0, 0], 0.5))]).len(), 2, "once for each part");
    assert!(told(&[named("lost", mix([7, 0], 0.5))]).iter().any(|p| p.contains("does not exist")));
    // Deep nesting without a cycle is reported once, and no stack overflows.
    let chain = |n: u32| -> Vec<Material> {
        let link = |i: u32| named("link", if i + 1 < n { mix([i + 1, i + 1], 0.5) } else { diffuse(0.5) });
        (0..n).map(link).collect()
    };
    assert_eq!(told(&chain(17)), [""; 0]);
    assert_eq!(told(&chain(100_000)).len(), 1);
    assert!(surface(mix([0, 0], 1.5)).is_err() && surface(mix([0, 0], f32::NAN)).is_err());
}

#[test]
fn every_kind_can_be_shaded() {
    let textures = Textures::default();
    let (roughness, white) = (Roughness::constant(0.3, 0.3, false), Color::Constant([1.0; 3]));
    let looked_up = Roughness { u: Scalar::Texture(TextureId(0)), ..roughness };
    let glass = |eta, roughness| MaterialKind::Dielectric { eta, roughness, reflectance: white, transmittance: white };
    let sheet = MaterialKind::DiffuseTransmission {
        reflectance: Color::Constant([0.5; 3]),
        transmittance: Color::Constant([0.0; 3]),
    };
    for (kind, through) in [
        (glass(1.5, roughness), true),
        (glass(1.5, looked_up), true),
        (MaterialKind::ThinDielectric { eta: 1.5 }, true),
        (sheet, true),
        (MaterialKind::Mirror { reflectance: white }, false),
        (MaterialKind::Plastic { diffuse: white, specular: white, roughness: looked_up }, false),
        (MaterialKind::Substrate { diffuse: white, specular: white, roughness }, false),
    ] {
        let surface = sound(kind.clone());
        let bsdf = surface.bsdf(&textures, [0.5; 2]);
        assert_eq!((surface.transmits, bsdf.transmits()), (through, through), "{kind:?}");
        assert!(surface.several_lobes || !through);
        assert!(bsdf.sample(Vec3::new(0.0, 0.6, 0.8), [0.5; 2], 0.5).is_some(), "{kind:?}");
    }
    for eta in [f32::NAN, 0.0, 11.0] {
        assert!(surface(glass(eta, roughness)).is_err_and(|e| e.contains("index of refraction")));
    }
}
