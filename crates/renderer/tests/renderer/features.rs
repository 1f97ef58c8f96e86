//! Features for filters: surface features of the first non-specular surface behind mirrors, glass and smooth coats; directly
//! visible emission; and indirect lighting, scattered more than once by non-specular surfaces or media.

use crate::support::*;
use dapple_renderer::light::LightSelection;
use dapple_renderer::shading::{Bsdf, Coat, CoatOptions};

const WALL: [f32; 3] = [0.5, 0.1, 0.2];
/// The number of samples of features alone in a pixel whose features are equal.
const ALONE: u32 = 4;

/// The features of a single pixel, and the material of its first hit.
struct Seen {
    samples: u32,
    hits: u32,
    albedo: Vec3,
    normal: Vec3,
    /// The depth, relative to the depth of the first hit.
    depth: f32,
    variance: Option<f32>,
    material: u32,
}

fn seen(scene: &Scene, spp: u64) -> Seen {
    let needs = Needs::none().with_features().with_first_hits(1);
    let film = film_with(&world(scene), [1, 1], spp, needs, Sobol::new(7));
    let hit = film.first_hits(0)[0].expect("a surface");
    let found = film.features(0).expect("features");
    Seen {
        samples: found.samples,
        hits: found.hits,
        albedo: found.albedo.into(),
        normal: found.normal.into(),
        depth: found.depth / hit.depth,
        variance: found.variance.map(|[_, albedo, ..]| albedo),
        material: hit.material,
    }
}

/// Returns a scene of one pixel, seen from y = -4 along y under an environment. The planes cover the view and face the camera
/// or away from it.
fn view(planes: &[(MaterialKind, f64)]) -> Scene {
    let mut scene = scene([1, 1], 0.1, DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO);
    add_sky(&mut scene, 1.0);
    for (kind, y) in planes {
        let material = add_material(&mut scene, kind.clone());
        plate(&mut scene, [DVec3::new(0.0, *y, 0.0), 9.0 * DVec3::X, 9.0 * DVec3::Z], material, None);
    }
    scene
}

fn mirror(reflectance: f32) -> MaterialKind {
    MaterialKind::Mirror { reflectance: Color::Constant([reflectance; 3]) }
}

fn wall() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant(WALL) }
}

fn pane() -> MaterialKind {
    MaterialKind::ThinDielectric { eta: 1.5 }
}

/// Mirrors and nearly smooth metals show the features of what they reflect, and rough metal its own features. The environment
/// has no normal. Glass shows the features behind it.
#[test]
fn smooth_surfaces_show_the_features_of_what_is_seen_by_them() {
    let (back, front) = (Vec3::Y, Vec3::NEG_Y);
    let wall_color = Vec3::from(WALL);
    for (name, planes, albedo, normal, depth, tolerance) in [
        ("a mirror", vec![(mirror(0.8), 0.0), (wall(), -6.0)], Some(0.8 * wall_color), back, 10.0 / 4.0, 1e-4),
        ("the sky in a mirror", vec![(mirror(0.8), 0.0)], Some(Vec3::splat(0.8)), Vec3::ZERO, 1.0, 1e-4),
        ("glass", vec![(pane(), 0.0), (wall(), 3.0)], Some(wall_color), front, 7.0 / 4.0, 1e-4),
        ("nearly smooth metal", vec![(metal(0.005), 0.0), (wall(), -6.0)], None, back, 2.5, 1e-2),
        ("rough metal", vec![(metal(0.2), 0.0), (wall(), -6.0)], None, front, 1.0, 1e-2),
    ] {
        let found = seen(&view(&planes), 256);
        assert_eq!(found.material, 0, "{name}: the first hit is the plane itself");
        assert!((found.normal - normal).length() < tolerance, "{name}: {}", found.normal);
        assert!((found.depth - depth).abs() < tolerance, "{name}: {}", found.depth);
        assert!(albedo.is_none_or(|albedo| (found.albedo - albedo).length() < tolerance), "{name}: {}", found.albedo);
        if name == "glass" {
            // It reflects few samples of a pixel; they are left out.
            assert!((220..250).contains(&found.samples) && found.variance.expect("many samples") < 1e-8, "{name}");
        } else if albedo.is_some() {
            assert_eq!((found.samples, found.hits), (256 + ALONE, 256 + ALONE), "{name}");
        }
    }
}

/// The coat reflects the environment, whose normal is 0, so the length of the mean normal is the fraction of the base.
#[test]
fn a_coat_shows_its_base_and_what_it_reflects_in_their_shares() {
    let coat = Coat::new(CoatOptions { thickness: 0.0, max_depth: 100, ..CoatOptions::default() }).expect("in range");
    let bsdf = Bsdf::coated_diffuse(&coat, Vec3::splat(0.3));
    let reflected = bsdf.sample(Vec3::new(0.8, 0.0, 0.6), [0.5; 2], 0.0).expect("the coat's reflection");
    assert!(reflected.specular && reflected.pdf > 0.1, "{reflected:?}");
    for (alpha, share) in [(0.0, 1.0 - reflected.pdf), (0.005, 1.0 - reflected.pdf), (0.2, 1.0)] {
        let mut scene = scene([1, 1], 0.1, DVec3::new(-4.0, 0.0, 3.0), DVec3::ZERO);
        add_sky(&mut scene, 1.0);
        let material = add_material(&mut scene, coated(0.3, alpha));
        plate(&mut scene, [DVec3::ZERO, DVec3::X, DVec3::Y], material, None);
        let found = seen(&scene, 4096);
        assert!((found.normal.z - share).abs() < 0.01, "{alpha}: {}, not {share}", found.normal);
        assert!(found.hits == found.samples && found.hits >= 4096 + ALONE, "{alpha}");
    }
}

#[test]
fn facing_mirrors_end_with_the_features_of_a_mirror() {
    let mut scene = view(&[(mirror(0.9), 0.0), (mirror(0.9), -5.0)]);
    scene.max_depth = Some(20);
    let found = seen(&scene, 64);
    assert_eq!((found.samples, found.hits), (64 + ALONE, 64 + ALONE));
    assert!(found.depth > 4.0 && found.depth.is_finite(), "{}", found.depth);
    // Russian roulette ends paths early, but does not change the share of light that mirrors pass on.
    assert!(found.albedo.x > 0.9f32.powi(21) - 1e-4 && found.albedo.x < 0.9f32.powi(5), "{}", found.albedo);
}

/// Features, emission and indirect lighting are recorded on request only, and the request changes no bit of the image.
#[test]
fn features_change_no_bit_l14() {
    let world = world(&room([16, 12]));
    let of = |needs: Needs| film_with(&world, [16, 12], 8, needs, Sobol::new(1));
    let (plain, emission) = (of(Needs::none()), of(Needs::none().with_emission()));
    let full = of(Needs::none().with_features().with_variance().with_cost());
    assert_eq!([hash(&emission), hash(&full)], [hash(&plain); 2]);
    let seen = |i| emission.emission(0, i).expect("recorded");
    let above = |i: &usize| (0..3).any(|c| f64::from(seen(*i)[c]) > emission.mean(*i)[c] * (1.0 + 1e-6));
    assert_eq!((0..16 * 12).find(above), None, "emission is a part of the radiance");
    // Features alone take one ray and one block, and more only behind smooth surfaces.
    let features: u64 = (0..16 * 12).map(|i| u64::from(full.features(i).expect("recorded").samples)).sum();
    let alone = features - 8 * 16 * 12;
    assert!(alone >= 4 * 16 * 12);
    let more = full.record().rays - plain.record().rays;
    assert!(more >= alone && more < alone + alone / 10, "{more} rays for {alone} samples of features");
    let more = full.record().blocks - plain.record().blocks;
    assert!(more >= alone && more < 2 * alone, "{more} blocks for {alone} samples of features");
}

/// The environment is directly visible to cameras and in mirrors; scattered light is not directly visible. The 8 % of samples
/// that a pane reflects are left out.
#[test]
fn emission_is_seen_directly_but_for_scattering() {
    for (planes, expected, tolerance) in [
        (vec![], 1.0, 0.0),
        (vec![(mirror(0.8), 0.0)], 0.8, 1e-4),
        (vec![(pane(), 0.0)], 0.92, 0.01),
        (vec![(wall(), 0.0)], 0.0, 0.0),
        (vec![(metal(0.2), 0.0)], 0.0, 0.0),
        (vec![(metal(0.005), 0.0)], 0.0, 0.0),
        (vec![(coated(0.3, 0.0), 0.0)], 0.0, 0.0),
    ] {
        let film = film_with(&world(&view(&planes)), [1, 1], 256, Needs::none().with_emission(), Sobol::new(7));
        let (emission, radiance) = (film.emission(0, 0).expect("recorded"), film.mean(0));
        assert!(emission.iter().all(|e| (e - expected).abs() <= tolerance), "{planes:?}: {emission:?}");
        assert!(radiance[0] > 0.05 && (expected != 0.92 || (radiance[0] - 1.0).abs() < 1e-5), "{radiance:?}");
    }
}

/// The same random numbers give the same first hit, features and emission with and without light. Paths end before Russian
/// roulette, which is not used for features alone.
#[test]
fn features_without_light_are_those_of_whole_samples() {
    let points = Sobol::new(3);
    for name in ["cornell", "glass", "tea", "room", "grass"] {
        let mut scene = bundle(name);
        scene.max_depth = Some(4);
        let world = small(&scene, [40, 30]);
        let integrator = integrator(&world);
        let (mut behind, mut lit, mut worker) = (0, 0, Worker::default());
        for i in 0..4 * 40 * 30 {
            let id = SampleId::new([i % 40, i / 40 % 30], streams::WHOLE, u64::from(i / 1200));
            let draws = Draws::for_film(&points, id, Needs::none().with_features().with_emission());
            let whole = integrator.estimate(&draws, &mut worker);
            let alone = integrator.features_alone(&draws).expect("paths have features");
            let seen = (alone.first_hit, alone.features, alone.emission);
            assert_eq!(seen, (whole.first_hit, whole.features, whole.emission), "{name}, {id:?}");
            assert!(alone.cost <= whole.cost && alone.radiance == [0.0; 3], "{name}, {id:?}");
            lit += u32::from(alone.emission != [0.0; 3]);
            behind += u32::from(alone.features.is_some());
        }
        let is_smooth = name == "glass" || name == "tea";
        assert!(lit >= 8, "{name}: {lit} samples see a lamp or the sky");
        assert!(!is_smooth || behind > 400, "{name}: {behind} samples see something behind glass or in a mirror");
    }
}

fn with_indirect(scene: &Scene, depth: u32) -> Film {
    let mut world = world(&Scene { max_depth: Some(depth), ..scene.clone() });
    world.set_light_selection(LightSelection::Power);
    film_with(&world, [24, 24], 16, Needs::none().with_halves().with_indirect(), Sobol::new(3))
}

fn sum_of_indirect(film: &Film) -> f64 {
    (0..film.frame().pixels()).map(|i| film.indirect(i).expect("recorded").mean[1]).sum()
}

/// Direct lighting equals the light of the same samples with at most one scattering event.
#[test]
fn direct_light_is_that_of_one_scattering() {
    let clear = bundle("cornell");
    let mut foggy = clear.clone();
    foggy.media.push(fog([2e-4; 3], [1e-3; 3], 0.3));
    let medium = Some(MediumId(0));
    foggy.camera.medium = medium;
    foggy.shapes.iter_mut().for_each(|s| s.media = Some(MediumInterface { inside: medium, outside: medium }));
    for scene in [clear, foggy] {
        let (whole, once) = (with_indirect(&scene, 6), with_indirect(&scene, 1));
        assert_eq!(sum_of_indirect(&once), 0.0);
        assert!(sum_of_indirect(&whole) > 1.0, "{}", sum_of_indirect(&whole));
        for (i, half) in (0..whole.frame().pixels()).flat_map(|i| [(i, 0), (i, 1)]) {
            let [all, wanted] = [&whole, &once].map(|film| film.half(half, i).expect("halves").mean);
            let indirect = whole.half_indirect(half, i).expect("recorded").mean;
            let near = (0..3).all(|c| (all[c] - indirect[c] - wanted[c]).abs() < 1e-5 * (1.0 + wanted[c]));
            assert!(near, "pixel {i}: {all:?} less {indirect:?}, not {wanted:?}");
        }
    }
}

#[test]
fn mirrors_scatter_no_indirect_light() {
    for kind in [mirror(0.9), diffuse(0.9)] {
        let mut scene = view(&[(kind.clone(), 0.0), (diffuse(0.5), -6.0)]);
        scene.film.resolution = [24, 24];
        scene.shapes.iter_mut().for_each(|s| s.to_world = DAffine3::from_scale(DVec3::new(0.2, 1.0, 0.2)));
        let sum = sum_of_indirect(&with_indirect(&scene, 3));
        assert!(if kind == mirror(0.9) { sum == 0.0 } else { sum > 0.1 }, "{kind:?}: {sum}");
    }
}
