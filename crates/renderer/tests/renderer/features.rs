//! The features that filters read: those of the first rough surface behind mirrors, glass and smooth coats.

use crate::support::*;
use dapple_core::samplers::Uniform;
use dapple_core::{Draws, Features, Film, Frame, Limits, Needs, Render, SampleId, Worker, streams};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::shading::{Bsdf, Coat, CoatOptions};
use dapple_renderer::{World, integrator};
use dapple_scene::{Color, MaterialKind, Scene, bundled};
use glam::{DAffine3, DVec3, Vec3};

const WALL: [f32; 3] = [0.5, 0.1, 0.2];
/// The number of samples of features alone in a pixel whose features are equal.
const ALONE: u32 = 4;

fn film(scene: &Scene, spp: u64, needs: Needs) -> Film {
    let world = world(scene);
    let frame = Frame::new(1, 1).expect("the size is at least 1x1");
    let limits = Limits::samples(spp);
    let render = Render::new(frame, &limits).needs(needs);
    render.run(&mut *integrator(&world), &mut Uniform::new(Sobol::new(7))).expect("it renders")
}

/// The features of the single pixel, and the depth and the material of its first hit.
fn seen(scene: &Scene, spp: u64) -> (Features, f32, u32) {
    let film = film(scene, spp, Needs::none().with_features().with_first_hits(1));
    let hit = film.first_hits(0)[0].expect("a surface");
    (film.features(0).expect("features"), hit.depth, hit.material)
}

/// A pixel that looks from y = -4 along y, under a sky.
fn view() -> Scene {
    let mut scene = scene([1, 1], 0.1, DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO);
    add_sky(&mut scene, 1.0);
    scene
}

/// Adds a plane at `y` that faces the camera, or the other way. It covers the view.
fn add_plane(scene: &mut Scene, kind: MaterialKind, y: f64) {
    let material = add_material(scene, kind);
    add(scene, rectangle(DVec3::new(0.0, y, 0.0), DVec3::X, DVec3::Z), DAffine3::IDENTITY, material, None);
}

fn mirror(reflectance: f32) -> MaterialKind {
    MaterialKind::Mirror { reflectance: Color::Constant([reflectance; 3]) }
}

fn wall() -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant(WALL) }
}

fn assert_near(got: [f32; 3], wanted: [f32; 3]) {
    assert!((Vec3::from(got) - Vec3::from(wanted)).length() < 1e-4, "{got:?}, not {wanted:?}");
}

#[test]
fn a_mirror_shows_the_features_of_what_it_reflects() {
    let mut scene = view();
    add_plane(&mut scene, mirror(0.8), 0.0);
    add_plane(&mut scene, wall(), -6.0);
    let (features, first, material) = seen(&scene, 16);
    assert_near(features.albedo, WALL.map(|a| 0.8 * a));
    assert_near(features.normal, [0.0, 1.0, 0.0]);
    assert!((features.depth / first - 10.0 / 4.0).abs() < 1e-4, "4 to the mirror, 6 back: {features:?}");
    assert_eq!((features.samples, features.hits, material), (16 + ALONE, 16 + ALONE, 0), "the first hit is the mirror");
}

#[test]
fn nearly_smooth_metal_shows_what_it_reflects_and_rough_metal_itself() {
    for (alpha, reflects) in [(0.005, true), (0.2, false)] {
        let mut scene = view();
        add_plane(&mut scene, metal(alpha), 0.0);
        let far = rectangle(DVec3::new(0.0, -6.0, 0.0), 9.0 * DVec3::X, 9.0 * DVec3::Z);
        let material = add_material(&mut scene, wall());
        add(&mut scene, far, DAffine3::IDENTITY, material, None);
        let (features, ..) = seen(&scene, 64);
        assert!((features.normal[1] - if reflects { 1.0 } else { -1.0 }).abs() < 1e-2, "{alpha}: {features:?}");
    }
}

/// Glass reflects few samples of a pixel; they are left out.
#[test]
fn glass_shows_the_features_of_what_is_behind_it() {
    let mut scene = view();
    add_plane(&mut scene, MaterialKind::ThinDielectric { eta: 1.5 }, 0.0);
    add_plane(&mut scene, wall(), 3.0);
    let (features, first, material) = seen(&scene, 256);
    assert!(features.samples > 220 && features.samples < 250, "{features:?}");
    assert_near(features.albedo, WALL);
    assert_near(features.normal, [0.0, -1.0, 0.0]);
    assert!((features.depth / first - 7.0 / 4.0).abs() < 1e-4, "{features:?}");
    assert_eq!((features.variance.expect("many samples")[4] < 1e-8, material), (true, 0));
}

/// The coat reflects the sky, whose normal is 0. So the length of the mean normal is the share of the base.
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
        add(&mut scene, rectangle(DVec3::ZERO, DVec3::X, DVec3::Y), DAffine3::IDENTITY, material, None);
        let (features, ..) = seen(&scene, 4096);
        assert!((features.normal[2] - share).abs() < 0.01, "{alpha}: {features:?}, not {share}");
        assert!(features.hits == features.samples && features.hits >= 4096 + ALONE, "{features:?}");
    }
}

#[test]
fn the_sky_in_a_mirror_is_covered_and_has_no_normal() {
    let mut scene = view();
    add_plane(&mut scene, mirror(0.8), 0.0);
    let (features, first, _) = seen(&scene, 16);
    assert_eq!((features.samples, features.hits, features.normal), (16 + ALONE, 16 + ALONE, [0.0; 3]));
    assert_near(features.albedo, [0.8; 3]);
    assert!((features.depth / first - 1.0).abs() < 1e-6, "the mirror's: {features:?}");
}

#[test]
fn facing_mirrors_end_with_the_features_of_a_mirror() {
    let mut scene = view();
    add_plane(&mut scene, mirror(0.9), 0.0);
    add_plane(&mut scene, mirror(0.9), -5.0);
    scene.max_depth = Some(20);
    let (features, first, _) = seen(&scene, 64);
    assert_eq!((features.samples, features.hits), (64 + ALONE, 64 + ALONE));
    assert!(features.depth > 4.0 * first && features.depth.is_finite(), "{features:?}");
    // Russian roulette ends paths early, but does not change the share of light that mirrors pass on.
    assert!(features.albedo[0] > 0.9f32.powi(21) - 1e-4 && features.albedo[0] < 0.9f32.powi(5), "{features:?}");
}

#[test]
fn features_change_no_radiance() {
    let room = room([12, 9]);
    let world = world(&room);
    let of = |needs: Needs| {
        let limits = Limits::samples(8 * 12 * 9);
        let render = Render::new(Frame::new(12, 9).expect("a frame"), &limits).needs(needs);
        hash(&render.run(&mut *integrator(&world), &mut Uniform::new(Sobol::new(3))).expect("it renders"))
    };
    assert_eq!(of(Needs::none()), of(Needs::none().with_features()));
}

/// The mean emission seen directly and the mean radiance of the single pixel.
fn emitted(scene: &Scene) -> ([f32; 3], [f64; 3]) {
    let film = film(scene, 256, Needs::none().with_emission());
    (film.emission(0, 0).expect("recorded"), film.mean(0))
}

#[test]
fn the_sky_is_seen_directly_by_cameras_and_in_mirrors() {
    let mut scene = view();
    assert_eq!(emitted(&scene).0, [1.0; 3]);
    add_plane(&mut scene, mirror(0.8), 0.0);
    assert_near(emitted(&scene).0, [0.8; 3]);
}

#[test]
fn light_that_surfaces_scatter_is_not_seen_directly() {
    for kind in [wall(), metal(0.2), metal(0.005), coated(0.3, 0.0)] {
        let mut scene = view();
        add_plane(&mut scene, kind, 0.0);
        let (emission, radiance) = emitted(&scene);
        assert!(emission == [0.0; 3] && radiance[0] > 0.05, "{emission:?}, {radiance:?}");
    }
}

/// A pane reflects 8 % of the samples; these are left out.
#[test]
fn a_pane_shows_lamps_behind_it_but_not_those_that_it_reflects() {
    let mut scene = view();
    add_plane(&mut scene, MaterialKind::ThinDielectric { eta: 1.5 }, 0.0);
    let (emission, radiance) = emitted(&scene);
    assert!((emission[0] - 0.92).abs() < 0.01 && (radiance[0] - 1.0).abs() < 1e-5, "{emission:?}, {radiance:?}");
}

#[test]
fn emission_changes_no_radiance() {
    let room = room([12, 9]);
    let world = world(&room);
    let of = |needs: Needs| {
        let limits = Limits::samples(8 * 12 * 9);
        let render = Render::new(Frame::new(12, 9).expect("a frame"), &limits).needs(needs);
        render.run(&mut *integrator(&world), &mut Uniform::new(Sobol::new(3))).expect("it renders")
    };
    let (bare, recorded) = (of(Needs::none()), of(Needs::none().with_emission()));
    assert_eq!(hash(&bare), hash(&recorded));
    let seen = |i| recorded.emission(0, i).expect("recorded");
    let above = |i: &usize| (0..3).any(|c| f64::from(seen(*i)[c]) > recorded.mean(*i)[c] * (1.0 + 1e-6));
    assert_eq!((0..12 * 9).find(above), None, "emission is a part of the radiance");
}

/// The same random numbers give the same first hit, features and emission with and without light. Paths end before roulette, which
/// features alone do not play.
#[test]
fn features_without_light_are_those_of_whole_samples() {
    let points = Sobol::new(3);
    for name in ["cornell", "glass", "tea", "room", "grass"] {
        let mut scene = bundled::files(name).expect("it is bundled").read().expect("it reads");
        scene.max_depth = Some(4);
        let world = World::with_resolution(&scene, [40, 30]).expect("it builds");
        let integrator = integrator(&world);
        let (mut behind, mut lit, mut worker) = (0, 0, Worker::default());
        for i in 0..4 * 40 * 30 {
            let id = SampleId::new([i % 40, i / 40 % 30], streams::WHOLE, u64::from(i / 1200));
            let draws = Draws::for_film(&points, id, Needs::none().with_features().with_emission());
            let whole = integrator.estimate(&draws, &mut worker);
            let alone = integrator.features_alone(&draws).expect("paths have features");
            assert_eq!((alone.first_hit, alone.features), (whole.first_hit, whole.features), "{name}, {id:?}");
            assert!(alone.cost <= whole.cost && alone.radiance == [0.0; 3], "{name}, {id:?}");
            assert_eq!(alone.emission, whole.emission, "{name}, {id:?}");
            lit += u32::from(alone.emission != [0.0; 3]);
            behind += u32::from(alone.features.is_some());
        }
        let smooth = name == "glass" || name == "tea";
        assert!(lit >= 8, "{name}: {lit} samples see a lamp or the sky");
        assert!(!smooth || behind > 400, "{name}: {behind} samples see something behind glass or in a mirror");
    }
}
