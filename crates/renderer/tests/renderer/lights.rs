//! Points, spots, parallel light and environments: closed forms in images, samples against densities, emitted rays, and invalid
//! lights.
#![allow(clippy::print_stderr)]

use crate::densities::Cone;
use crate::support::*;
use dapple_geometry::{PrimitiveId, SurfacePoint};
use dapple_renderer::light::{EmittedLight, Environment, LightSelection, Target};

const TESTS: usize = 128;
const CHOICES: [LightSelection; 2] = [LightSelection::Power, LightSelection::Learned];

/// Returns a diffuse floor of albedo 1/2 with normal +z through `middle`, seen by a camera with a tiny field of view. All
/// lengths are multiplied by `unit`.
fn floor(middle: DVec3, unit: f64) -> Scene {
    let mut scene = scene([1, 1], 1e-5, middle + unit * DVec3::new(0.0, -3.0, 3.0), middle);
    let grey = add_material(&mut scene, diffuse(0.5));
    plate(&mut scene, [middle, unit * 4.0 * DVec3::X, unit * 4.0 * DVec3::Y], grey, None);
    scene.max_depth = Some(1);
    scene
}

/// Returns the irradiance at the floor's middle, from the image.
fn irradiance(scene: &Scene) -> f64 {
    mean(&image(scene, 4, 1))[0] * 2.0 * PI
}

/// Returns a transform that maps +z to `axis` and the origin to `at`.
fn aimed(at: DVec3, axis: DVec3) -> DAffine3 {
    let z = axis.normalize();
    let (x, y) = z.any_orthonormal_pair();
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: at }
}

fn point(intensity: f32) -> LightKind {
    LightKind::Point { intensity: [intensity; 3] }
}

fn distant(irradiance: f32) -> LightKind {
    LightKind::Distant { irradiance: [irradiance; 3] }
}

fn spot(intensity: f32, cone: f32, falloff_start: f32, falloff: SpotFalloff) -> LightKind {
    LightKind::Spot { intensity: [intensity; 3], cone, falloff_start, falloff }
}

/// Returns the falloff of a spot light at an angle from its axis.
fn falls(angle: f64, cone: f32, start: f32, falloff: SpotFalloff) -> f64 {
    let [edge, core] = [cone, start].map(|a| f64::from(a).to_radians().cos());
    let x = match start == cone {
        true => f64::from(angle <= f64::from(cone).to_radians()),
        false => ((angle.cos() - edge) / (core - edge)).clamp(0.0, 1.0),
    };
    if falloff == SpotFalloff::Smoothstep { x * x * (3.0 - 2.0 * x) } else { x.powi(4) }
}

/// The closed forms hold in all units of length and at all origins. The scale and rotation of a point light's transform have no
/// effect, and a light below the floor contributes nothing.
#[test]
fn lights_on_a_plane_match_their_closed_forms_l03() {
    let p = DVec3::new;
    for (middle, unit) in [
        (DVec3::ZERO, 1.0),
        (p(3.0, -2.0, 7.0), 1.0),
        (DVec3::ZERO, 1000.0 / 3.0),
        (DVec3::splat(5e4), 0.02),
        (DVec3::ZERO, 1e12),
    ] {
        // The light, its transform, and its irradiance with the tolerance.
        let mut cases: Vec<(LightKind, DAffine3, f64, f64)> = Vec::new();
        let from = |at: DVec3| at.z.max(0.0) / at.length().powi(3) / (unit * unit);
        for at in [DVec3::Z, p(2.0, 1.0, 0.5), p(-30.0, 0.0, 40.0), p(0.0, 0.0, 1e-2), DVec3::NEG_Z] {
            let to_world = DAffine3::from_translation(middle + unit * at) * DAffine3::from_scale(p(9.0, 2.0, -3.0));
            cases.push((point(3.0), to_world, 3.0 * from(at), 0.0));
        }
        for w in [DVec3::Z, p(1.0, 2.0, 0.5), p(-1.0, 0.0, 1e-3)] {
            let to_world = aimed(DVec3::splat(77.0), w) * DAffine3::from_scale(DVec3::splat(5.0));
            cases.push((distant(3.0), to_world, 3.0 * w.normalize().z, 0.0));
        }
        let position = p(0.4, -0.3, 1.2);
        for (cone, start) in [(30.0_f32, 10.0_f32), (20.0, 20.0), (120.0, 0.0), (2.0, 0.5), (180.0, 0.0)] {
            for falloff in [SpotFalloff::Smoothstep, SpotFalloff::Quartic] {
                for share in [0.0, 0.3, 0.7, 0.9, 0.999, 1.01] {
                    // The axis is rotated so that the floor's middle lies at this fraction of the cone.
                    let angle = f64::from(cone).to_radians() * share;
                    let towards = -position.normalize();
                    let (across, _) = towards.any_orthonormal_pair();
                    let axis = towards * angle.cos() + across * angle.sin();
                    let to_world = aimed(middle + unit * position, axis) * DAffine3::from_scale(p(-2.0, -2.0, 2.0));
                    let full = 3.0 * from(position);
                    // Directions have rounding errors of 6e-8, which matter relative to the width of the cone.
                    let tolerance = full * 3e-7 / f64::from(cone).to_radians();
                    if angle <= PI {
                        let kind = spot(3.0, cone, start, falloff);
                        cases.push((kind, to_world, full * falls(angle, cone, start, falloff), tolerance));
                    }
                }
            }
        }
        for (kind, to_world, expected, tolerance) in cases {
            let mut scene = floor(middle, unit);
            let what = format!("{middle} {unit} {kind:?}");
            add_light(&mut scene, kind, to_world);
            let found = irradiance(&scene);
            assert!((found - expected).abs() <= 2e-5 * expected + tolerance, "{what}: {found}, not {expected}");
        }
    }
}

/// Objects between floor and light cast a shadow; objects behind the light do not.
#[test]
fn lights_without_extent_cast_shadows_l03() {
    for (kind, height, lit) in [(0.5, false), (1.0 - 1e-4, false), (1.0 + 1e-4, true), (3.0, true)]
        .into_iter()
        .flat_map(|(h, lit)| [point(1.0), spot(1.0, 30.0, 30.0, SpotFalloff::Quartic)].map(|kind| (kind, h, lit)))
        .chain([(distant(1.0), 1e3, false)])
    {
        let mut scene = floor(DVec3::ZERO, 1.0);
        let black = add_material(&mut scene, diffuse(0.0));
        plate(&mut scene, [height * DVec3::Z, 0.2 * DVec3::X, 0.2 * DVec3::Y], black, None);
        let axis = if matches!(kind, LightKind::Distant { .. }) { DVec3::Z } else { DVec3::NEG_Z };
        add_light(&mut scene, kind.clone(), aimed(DVec3::Z, axis));
        let (found, expected) = (irradiance(&scene), f64::from(lit));
        assert!((found - expected).abs() <= 2e-5 * expected, "{kind:?} under a plate at {height}: {found}");
    }
}

/// A light without extent is found only by light sampling, and its density for BSDF sampling is 0.
#[test]
fn lights_without_extent_are_found_by_light_sampling_only_l09() {
    let mut scene = floor(DVec3::ZERO, 1.0);
    add_light(&mut scene, distant(1.0), DAffine3::IDENTITY);
    let alone = world(&scene);
    let lights = alone.lights();
    assert!(lights.has_delta() && !lights.has_environment());
    assert_eq!(lights.environment(Vec3::Z), Vec3::ZERO, "no ray meets it");
    let sample = lights.sample(Vec3::ZERO, 0.5, [0.5; 2]).expect("it shines");
    assert!(sample.delta && sample.pdf == 1.0 && sample.wi == Vec3::Z && matches!(sample.target, Target::Far));
    add_light(&mut scene, point(1.0), at(0.0, 0.0, 1.0));
    add_sky(&mut scene, 1.0);
    let world = world(&scene);
    assert!(world.lights().has_delta() && world.lights().has_environment());
    let chosen = [0, 1, 2].map(|i| world.lights().pmf(i));
    let lights = world.lights();
    let samples = |at| (0..100).filter_map(move |i| lights.sample(at, i as f32 / 100.0, [0.3; 2]));
    // At the point itself there is no direction, and no panic.
    let [origin, at_point] = [DVec3::ZERO, DVec3::Z].map(|p| world.space().point(p).as_vec3());
    assert!(samples(at_point).all(|s| s.radiance.is_finite()));
    assert!(samples(origin).all(|s| s.delta == chosen.contains(&s.pdf)), "{chosen:?}");
}

/// Several kinds of lights add up in one image.
#[test]
fn lights_add_up_l03() {
    let mut scene = floor(DVec3::ZERO, 1.0);
    add_light(&mut scene, point(3.0), at(1.0, 0.0, 2.0));
    add_light(&mut scene, distant(0.7), aimed(DVec3::ZERO, DVec3::new(0.0, 1.0, 1.0)));
    add_light(&mut scene, spot(2.0, 30.0, 10.0, SpotFalloff::Smoothstep), aimed(1.5 * DVec3::Z, DVec3::NEG_Z));
    add_sky(&mut scene, 0.2);
    let expected = 3.0 * 2.0 / 5.0_f64.powf(1.5) + 0.7 * 0.5_f64.sqrt() + 2.0 / 2.25 + 0.2 * PI;
    for choice in [LightSelection::Power, LightSelection::Uniform] {
        let mut world = world(&scene);
        world.set_light_selection(choice);
        let found = mean(&film_of(&world, [1, 1], 1 << 16, Sobol::new(3)))[0] * 2.0 * PI;
        assert!((found / expected - 1.0).abs() < 1e-3, "{choice:?}: {found} {expected}");
    }
}

#[test]
fn invalid_lights_are_refused_l06() {
    let identity = DAffine3::IDENTITY;
    let sound_spot = || spot(1.0, 30.0, 10.0, SpotFalloff::Smoothstep);
    let nan = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::NAN));
    let stretch = DAffine3::from_scale(DVec3::new(1.0, 1.0, 2.0));
    let sky = |radiance| LightKind::Infinite { radiance };
    let slope = || sky(lat_long([4, 3], |_, _| 1.0));
    let mut cases = vec![
        (sound_spot(), DAffine3::ZERO, "transform"),
        (sound_spot(), nan, "transform"),
        (sound_spot(), at(f64::NAN, 0.0, 0.0), "made.pbrt:200"),
        (sound_spot(), stretch, "transform"),
        (distant(1.0), DAffine3::ZERO, "transform"),
        (distant(1.0), nan, "transform"),
        (point(1.0), at(f64::NAN, 0.0, 0.0), "made.pbrt:200"),
        (point(1.0), at(1e25, 1e25, 1e25), "too far away"),
        // A point has no shape.
        (point(1.0), stretch, ""),
        (slope(), DAffine3::ZERO, "made.pbrt:200"),
        (slope(), stretch, "made.pbrt:200"),
        (slope(), nan, "made.pbrt:200"),
        (
            sky(EnvironmentRadiance::EqualArea { image: grey_image([4, 2], |_, _| 1.0), scale: 1.0 }),
            identity,
            "must be square, not 4 x 2;",
        ),
    ];
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let value = [1.0, bad, 1.0];
        cases.push((LightKind::Point { intensity: value }, identity, "made.pbrt:200: the light's intensity"));
        cases.push((LightKind::Distant { irradiance: value }, identity, "made.pbrt:200: the light's intensity"));
        cases.push((sky(EnvironmentRadiance::Constant(value)), identity, "made.pbrt:200"));
        let texel = |x, y| if (x, y) == (2, 1) { bad } else { 1.0 };
        cases.push((sky(lat_long([4, 3], texel)), identity, "made.pbrt:200: texel (2, 1)"));
        cases.push((sky(equal_area(4, texel)), identity, "made.pbrt:200: texel (2, 1)"));
        let scaled = EnvironmentRadiance::EqualArea { image: grey_image([2, 2], |_, _| 0.0), scale: bad };
        cases.push((sky(scaled), identity, "made.pbrt:200"));
    }
    for (cone, start) in [(0.0, 0.0), (-5.0, -6.0), (30.0, 31.0), (181.0, 10.0), (f32::NAN, 1.0), (30.0, f32::NAN)] {
        let kind = spot(1.0, cone, start, SpotFalloff::Smoothstep);
        cases.push((kind, identity, "made.pbrt:200: the spot's cone"));
    }
    for (kind, to_world, expected) in cases {
        let mut scene = floor(DVec3::ZERO, 1.0);
        let what = format!("{kind:?} {to_world}");
        add_light(&mut scene, kind, to_world);
        let told = refusal(&scene);
        assert!(told.contains(expected) && told.is_empty() == expected.is_empty(), "{what}: {told}");
    }
    // Too strong for a scene so small that its square is beyond single precision.
    let mut small = floor(DVec3::ZERO, 1e-25);
    add_light(&mut small, point(1.0), at(0.0, 0.0, 1e-25));
    assert!(World::new(&small).is_err());
    // Black lights are left out, and then there is no light.
    let mut scene = floor(DVec3::ZERO, 1.0);
    let black = [sky(EnvironmentRadiance::Constant([0.0; 3])), sky(lat_long([4, 3], |_, _| 0.0))];
    for kind in [point(0.0), distant(0.0), sky(equal_area(3, |_, _| 0.0))].into_iter().chain(black) {
        add_light(&mut scene, kind, identity);
    }
    assert!(world(&scene).lights().is_empty() && irradiance(&scene) == 0.0);
    // Huge values give a finite image, without rejected samples.
    for radiance in [
        lat_long([8, 4], |x, y| if (x, y) == (1, 1) { 2e30 } else { 1.0 }),
        equal_area(4, |x, y| if (x, y) == (0, 0) { 2e30 } else { 1.0 }),
    ] {
        let mut scene = ground([16, 16]);
        add_light(&mut scene, sky(radiance), identity);
        assert_eq!(image(&scene, 16, 1).record().rejected, 0);
    }
}

fn environments() -> Vec<(&'static str, EnvironmentRadiance)> {
    let bumpy = |x: u32, y: u32| ((7 * x + 3 * y) % 5) as f32;
    let spot = |at: (u32, u32), bright: f32, dark: f32| move |x, y| if (x, y) == at { bright } else { dark };
    let edge = |x: u32, y: u32| if (x, y) == (0, 3) { 6.0 } else { ((x + y) % 3) as f32 * 0.2 };
    vec![
        ("constant", EnvironmentRadiance::Constant([0.5; 3])),
        ("lat-long, one texel", lat_long([1, 1], |_, _| 0.7)),
        ("lat-long, bright at the pole", lat_long([16, 8], spot((3, 0), 300.0, 0.1))),
        ("lat-long, bright at the seam", lat_long([16, 8], spot((15, 4), 9.0, 0.3))),
        ("lat-long, bumpy", lat_long([9, 5], bumpy)),
        ("equal-area, one texel", equal_area(1, |_, _| 0.7)),
        ("equal-area, bright in a corner", equal_area(8, spot((7, 0), 50.0, 0.2))),
        ("equal-area, bright on an edge", equal_area(8, edge)),
        ("equal-area, bumpy", equal_area(7, bumpy)),
    ]
}

fn sky_of(radiance: &EnvironmentRadiance, turn: DMat3) -> Environment {
    Environment::new(radiance, turn, &Source::default()).expect("sound").expect("not black")
}

/// Returns cells around the image's pole, where the density of a lat-long image is unbounded, and an environment's masses in
/// them.
fn masses_of(radiance: &EnvironmentRadiance, turn: DMat3) -> (Cone, Vec<f64>) {
    let (cone, sky) = (Cone { axis: (turn * DVec3::Z).normalize(), angle: PI }, sky_of(radiance, turn));
    let masses = cone.masses(|w| sky.direction_pdf(w));
    (cone, masses)
}

/// Returns the p-value of an environment's samples against given masses. Also returns, for every fifth sample, the fraction
/// whose radiance or density differs from the values for the direction.
fn sky_test(
    radiance: &EnvironmentRadiance,
    turn: DMat3,
    (cone, masses): &(Cone, Vec<f64>),
    choice: LightSelection,
) -> [f64; 2] {
    let mut scene = empty([1, 1]);
    let kind = LightKind::Infinite { radiance: radiance.clone() };
    add_light(&mut scene, kind, DAffine3::from_mat3(turn));
    let mut world = world(&scene);
    world.set_light_selection(choice);
    let (lights, own) = (world.lights(), sky_of(radiance, turn));
    let mut random = Pcg32::seed_from_u64(3);
    let (mut differ, mut seen, samples) = (0, 0, 200_000);
    // Probabilities of parts are multiples of 2^-24, at most two off from a probability of 0.01 or more.
    let tolerance = if choice == LightSelection::Learned { 2e-5 } else { 1e-6 };
    let draw = || {
        let u = [random.random(), random.random()];
        let drawn = lights.sample(Vec3::ZERO, random.random(), u)?;
        assert!(drawn.pdf > 0.0 && !drawn.delta && matches!(drawn.target, Target::Far));
        assert!((drawn.wi.length() - 1.0).abs() < 3e-7 && drawn.radiance != Vec3::ZERO);
        seen += 1;
        if seen % 5 != 0 {
            return Some(drawn.wi);
        }
        let (all, pdf) = (own.radiance(drawn.wi), own.direction_pdf(drawn.wi));
        differ += i32::from(drawn.radiance != all || (drawn.pdf / pdf - 1.0).abs() >= 1e-3);
        // With one light, the weight is the power heuristic of the two densities.
        assert_eq!(lights.environment(drawn.wi), all);
        let even = lights.environment_weighted(drawn.wi, pdf, |light| lights.pmf(light));
        assert!((even - 0.5 * all).abs().max_element() <= tolerance * all.max_element(), "{even} {all}");
        Some(drawn.wi)
    };
    let p = cone.test(samples, draw, masses);
    [p, f64::from(5 * differ) / samples as f64]
}

/// Environments are tested whole and in tiles. At texel borders, directions are rounded. Negative controls: an environment that
/// is rotated by a degree, mirrored, or read in the other layout is detected.
#[test]
fn environment_samples_match_radiance_and_density_l08() {
    let level = sidak(FAMILY, TESTS);
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    let mirrored = turn * DMat3::from_diagonal(DVec3::new(2.0, -2.0, 2.0));
    for (name, radiance) in environments() {
        for map in &[mirrored, DMat3::IDENTITY, turn][..thorough(1, 3)] {
            let masses = masses_of(&radiance, *map);
            let integral: f64 = masses.1.iter().sum();
            assert!((integral - 1.0).abs() < 1e-3, "{name}, {map}: {integral}");
            for choice in CHOICES {
                let [p, differ] = sky_test(&radiance, *map, &masses, choice);
                eprintln!("{name}, {choice:?}: p = {p:.2e}, integral {integral:.5}, {differ:e}");
                assert!(p > level && differ < 2e-4, "{name}, {map}, {choice:?}: p = {p:e}, {differ:e}");
            }
            let off = DMat3::from_rotation_x(1.0_f64.to_radians());
            let flip = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
            for (wrong, choice) in [off, flip].into_iter().zip(CHOICES).filter(|_| name.contains("bright")) {
                let [p, _] = sky_test(&radiance, *map * wrong, &masses, choice);
                assert!(p < level, "{name}, wrong by {wrong}: p = {p:e}");
            }
        }
    }
    let image = grey_image([8, 8], |x, y| ((7 * x + 3 * y) % 5) as f32);
    let other = EnvironmentRadiance::LatLong { image: image.clone(), scale: 1.0 };
    let square = EnvironmentRadiance::EqualArea { image, scale: 1.0 };
    assert!(sky_test(&square, turn, &masses_of(&other, turn), LightSelection::Power)[0] < level);
}

/// Positions in the equal-area layout follow pbrt-v4's definition: row 0 is at -y, the middle at +z.
#[test]
fn equal_area_texels_cover_equal_solid_angles_l08() {
    let p = Vec3::new;
    for (place, w) in [
        ((2, 2), Vec3::Z),
        ((4, 2), Vec3::X),
        ((0, 2), Vec3::NEG_X),
        ((2, 4), Vec3::Y),
        ((2, 0), Vec3::NEG_Y),
        ((4, 4), p(0.3, 0.3, -0.9)),
        ((0, 4), p(-0.3, 0.3, -0.9)),
        ((4, 0), p(0.3, -0.3, -0.9)),
        ((0, 0), p(-0.3, -0.3, -0.9)),
    ] {
        let sky = sky_of(&equal_area(5, |x, y| if (x, y) == place { 2.0 } else { 0.0 }), DMat3::IDENTITY);
        assert_eq!(sky.radiance(w.normalize()).x, 1.0, "{place:?}");
        // Each of 25 texels has the solid angle 4 pi / 25.
        let density = f64::from(sky.direction_pdf(w.normalize()));
        assert!((density * 4.0 * PI / 25.0 - 1.0).abs() < 1e-6, "{place:?}: {density}");
    }
}

/// Returns rays that leave a world's lights; `None` for rejected random numbers.
fn emitted(world: &World, seed: u64) -> impl Iterator<Item = Option<EmittedLight>> {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    (0..100_000).map(move |_| {
        let u: [f32; 5] = std::array::from_fn(|_| random.random::<f32>());
        world.lights().sample_emission(u[0], [u[1], u[2]], [u[3], u[4]])
    })
}

/// Returns a ground with one lamp, whose shape is `geometry` scaled by 1.5.
fn with_lamp(geometry: Geometry, two_sided: bool) -> Scene {
    let mut scene = ground([4, 4]);
    let number = add(&mut scene, geometry, DAffine3::from_scale(DVec3::splat(1.5)), MaterialId(0), None);
    scene.shapes[number].emission = Some(Emission::even([2.0; 3], two_sided));
    scene
}

fn with_light(kind: LightKind) -> Scene {
    let mut scene = ground([4, 4]);
    let turn = DAffine3::from_rotation_x(0.7) * DAffine3::from_rotation_y(0.4);
    add_light(&mut scene, kind, at(0.0, 0.0, 1.0) * turn);
    scene
}

/// The mean flux of emitted rays is the lights' power, in the scene's units of length. An area A of radiance L has the power pi
/// A L on each side. False alarms: `FAMILY` for all lights together; negative control: a power off by 3 %.
#[test]
fn emitted_rays_carry_the_power_of_each_light() {
    let rectangle = || rectangle(DVec3::Z, 0.3 * DVec3::X, 0.2 * DVec3::Y);
    let power = 2.0 * PI * 2.25;
    let disk = Geometry::Disk { height: 0.3, radius: 0.5, inner_radius: 0.2 };
    let cap = |degrees: f64| 2.0 * PI * (1.0 - degrees.to_radians().cos());
    // The mean of the two falloff functions over the cosine between the two cones is 1/2 and 1/5.
    let of_spot = |mean: f64, start: f64| 3.0 * (cap(start) + mean * (cap(40.0) - cap(start)));
    // The disk has the radius of the scene's sphere, sqrt(2) and the padding of its box.
    let cross = PI * f64::from(world(&ground([4, 4])).lights().scene_sphere().1).powi(2);
    assert!((cross / (2.0 * PI) - 1.0).abs() < 1e-3, "{cross}");
    // Equal areas have the mean of 16 texels; in latitude and longitude, rows count by the sines' integral.
    let value = |i: u32| f64::from((i * 7) % 5) * 0.5;
    let mean_equal = (0..16).map(value).sum::<f64>() / 16.0;
    let weight = |r: u32| ((f64::from(r) * PI / 4.0).cos() - (f64::from(r + 1) * PI / 4.0).cos()) / 2.0;
    let mean_long: f64 = (0..32).map(|i| value(i) / 8.0 * weight(i / 8)).sum();
    let sky = |radiance| with_light(LightKind::Infinite { radiance });
    let all_around = 4.0 * PI * cross;
    for (seed, (scene, expected)) in [
        (with_lamp(rectangle(), false), power * 0.24),
        (with_lamp(rectangle(), true), 2.0 * power * 0.24),
        (with_lamp(Geometry::Sphere { radius: 0.5 }, false), power * PI),
        (with_lamp(disk, false), power * PI * 0.21),
        (with_light(point(3.0)), 4.0 * PI * 3.0),
        (with_light(spot(3.0, 40.0, 20.0, SpotFalloff::Smoothstep)), of_spot(0.5, 20.0)),
        (with_light(spot(3.0, 40.0, 0.0, SpotFalloff::Quartic)), of_spot(0.2, 0.0)),
        (with_light(distant(3.0)), 3.0 * cross),
        (sky(EnvironmentRadiance::Constant([0.7; 3])), 0.7 * all_around),
        (sky(equal_area(4, |x, y| ((4 * y + x) * 7 % 5) as f32)), mean_equal * all_around),
        (sky(lat_long([8, 4], |x, y| ((8 * y + x) * 7 % 5) as f32)), mean_long * all_around),
    ]
    .into_iter()
    .enumerate()
    {
        let world = world(&scene);
        let unit = world.space().scale().powi(2);
        let found: Mean =
            emitted(&world, seed as u64).map(|r| r.map_or(0.0, |r| f64::from(r.flux().y) / unit)).collect();
        // A light without variance has rounding errors only.
        let off = |expected: f64| ((found.mean - expected) / found.standard_error().max(2e-6 * expected)).abs();
        let limit = critical(sidak(FAMILY, 16));
        assert!(off(expected) < limit && off(1.03 * expected) > limit, "light {seed}: {found:?}, not {expected}");
    }
}

#[test]
fn several_lights_report_the_densities_of_what_they_emit() {
    for selection in CHOICES {
        let mut scene = with_lamp(Geometry::Sphere { radius: 0.5 }, true);
        scene.lights = room([4, 4]).lights;
        let radiance = equal_area(8, |x, y| ((8 * y + x) * 7 % 5) as f32);
        add_light(&mut scene, LightKind::Infinite { radiance }, DAffine3::IDENTITY);
        let mut world = world(&scene);
        world.set_light_selection(selection);
        for ray in emitted(&world, 9).flatten().take(2000) {
            let point = match &ray.source {
                Target::Surface(point) => *point,
                _ => SurfacePoint {
                    position: ray.position,
                    error: Vec3::ZERO,
                    normal: Vec3::ZERO,
                    primitive: PrimitiveId::NONE,
                },
            };
            let found = world.lights().emission_pdf(ray.light, &point, ray.direction);
            let close = |a: f32, b: f32| (a / b - 1.0).abs() < 1e-3;
            assert!(close(found.position, ray.pdf.position), "{found:?} {ray:?}");
            assert!(close(found.direction, ray.pdf.direction), "{found:?} {ray:?}");
            let pmf = world.lights().pmf(ray.light);
            assert_eq!(pmf, ray.pmf, "the light was selected with another probability");
            if let Target::Far = ray.source {
                let sum = world.lights().environment_emission_pdf(-ray.direction);
                assert!(sum >= 0.99 * found.direction * pmf, "the sum over environments contains each");
            }
        }
    }
}
