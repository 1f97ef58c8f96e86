//! Light selection by power, uniform, and learned per cell: no light is lost, no mean changes, and learning reduces the error.

use crate::support::*;
use dapple_job::registry::{self, MethodInputs, PointSettings};
use dapple_renderer::light::{LightSelection, Target};
use dapple_renderer::shading::Discrete;

/// Coordinates of the point sets have 24 bits.
const LATTICE: u32 = 1 << 24;

/// Returns a patch of ground among point lights, and their positions.
fn points(intensities: &[f32]) -> (World, Vec<DVec3>) {
    let mut scene = ground([1, 1]);
    let mut random = Pcg32::seed_from_u64(17);
    let mut place = |_: &f32| DVec3::from([0, 1, 2].map(|_| random.random::<f64>() - 0.5)) + 1.5 * DVec3::Z;
    let positions: Vec<DVec3> = intensities.iter().map(&mut place).collect();
    let source = line(200);
    for (p, &intensity) in positions.iter().zip(intensities) {
        let kind = LightKind::Point { intensity: [intensity; 3] };
        scene.lights.push(Light { kind, to_world: DAffine3::from_translation(*p), source: source.clone() });
    }
    (world(&scene), positions)
}

/// Returns mixes in which one light has 1 - 1e-9 of the power, one light has 1e-9 of it, and lights have all magnitudes.
fn mixes(count: usize) -> [Vec<f32>; 3] {
    let one = |special: f32| (0..count).map(|i| if i == count / 3 { special } else { 1.0 }).collect();
    let all = (0..count).map(|i| 10_f32.powi((i % 41) as i32 - 20)).collect();
    [one(count as f32 * 1e9), one(count as f32 * 1e-9), all]
}

/// Every light has a probability, and they sum to 1. Over all values of a coordinate, each light's weighted contributions add
/// up to its light. The thorough test has a million lights. Negative control: with selection by power alone, 24 bits never
/// select most of the lights.
#[test]
fn extreme_mixes_of_lights_keep_the_weakest_l07() {
    let mixes = mixes(thorough(100_000, 1_000_000));
    for intensities in &mixes {
        let (world, positions) = points(intensities);
        let lights = world.lights();
        let pmfs = (0..lights.len() as u32).map(|i| lights.pmf(i));
        assert!(lights.len() == intensities.len() && pmfs.clone().all(|pmf| pmf > 0.0));
        let sum: f64 = pmfs.map(f64::from).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        let middle = world.space().point(DVec3::ZERO).as_vec3();
        // Irradiance by light, in the file's units: the brightest apart from all others.
        let brightest = intensities.iter().copied().fold(0.0, f32::max);
        let [mut due, mut found] = [[0.0; 2]; 2];
        for (p, &intensity) in positions.iter().zip(intensities) {
            due[usize::from(intensity < brightest)] += f64::from(intensity) * p.z / p.length().powi(3);
        }
        let unit = world.space().scale().powi(2);
        // A light's radiance identifies the brightest one.
        let threshold = f64::from(brightest) * 0.5 * unit;
        for k in 0..LATTICE {
            let sample = lights.sample(middle, k as f32 / LATTICE as f32, [0.5; 2]).expect("all shine on it");
            let Target::Point(at) = sample.target else { panic!("a point") };
            let intensity = f64::from(sample.radiance.x) * f64::from((at - middle).length_squared());
            let value = f64::from(sample.radiance.x) * f64::from(sample.wi.z) / f64::from(sample.pdf);
            found[usize::from(intensity < threshold)] += value / f64::from(LATTICE) / unit;
        }
        for (due, found) in due.into_iter().zip(found) {
            assert!((found - due).abs() <= 1e-5 * due, "{found:e} instead of {due:e}");
        }
    }
    let choice = Discrete::new(&mixes[0]).expect("sound");
    let mut seen = vec![false; mixes[0].len()];
    (0..LATTICE).for_each(|k| seen[choice.sample(k as f32 / LATTICE as f32).expect("not empty").index] = true);
    assert!(seen.iter().filter(|s| !**s).count() > 99_000);
}

/// Point lights are selected by power or uniformly. The powers of all kinds of lights are compared with values computed by
/// hand, in watts divided by pi.
#[test]
fn lights_are_selected_by_power_or_uniformly_l07() {
    let (mut world, _) = points(&[1.0, 2.0, 5.0]);
    for (selection, expected) in [
        (LightSelection::Power, [0.125, 0.25, 0.625]),
        (LightSelection::Uniform, [1.0 / 3.0; 3]),
        (LightSelection::Power, [0.125, 0.25, 0.625]),
    ] {
        world.set_light_selection(selection);
        let found = [0, 1, 2].map(|i| world.lights().pmf(i));
        assert!((0..3).all(|i| (found[i] - expected[i]).abs() < 1e-6), "{found:?}");
    }
    let mut scene = ground([1, 1]);
    let falloff = SpotFalloff::Quartic;
    for kind in [
        LightKind::Point { intensity: [1.0; 3] },
        LightKind::Distant { irradiance: [1.0; 3] },
        LightKind::Spot { intensity: [1.0; 3], cone: 90.0, falloff_start: 60.0, falloff },
        LightKind::Infinite { radiance: EnvironmentRadiance::Constant([1.0; 3]) },
    ] {
        add_light(&mut scene, kind, at(0.0, 0.0, 1.0));
    }
    let white = add_material(&mut scene, diffuse(1.0));
    // Added last, so that the ground stays the largest shape; lamps come first among the lights.
    plate(&mut scene, [0.5 * DVec3::Z, 0.5 * DVec3::X, 0.5 * DVec3::Y], white, Some(1.0));
    // With the lamp half a unit above the ground, the bounds' half diagonal is sqrt(2 + 1/16).
    let r2 = 2.0 + 1.0 / 16.0;
    let powers = [1.0, 4.0, r2, 2.0 * (0.5 + 0.5 / 5.0), 4.0 * PI * r2];
    let world = crate::support::world(&scene);
    for (i, power) in powers.iter().enumerate() {
        let (found, expected) = (f64::from(world.lights().pmf(i as u32)), power / powers.iter().sum::<f64>());
        // Bounds are enlarged a little.
        assert!((found / expected - 1.0).abs() < 1e-3, "light {i}: {found} {expected}");
    }
}

const SIZE: [u32; 2] = [48, 32];

fn selected(name: &str, choice: LightSelection) -> World {
    let mut world = small(&bundle(name), SIZE);
    world.set_light_selection(choice);
    world
}

fn uniform(world: &World, seed: u64, spp: u64) -> Film {
    film_of(world, SIZE, spp, Sobol::new(seed))
}

/// In images of few samples of a room with eight lamps, Student's t with 15 degrees of freedom stays below 6.5 for 24 blocks
/// (level 1e-5 each). Negative control: an image that lacks a bounce is detected.
#[test]
fn learned_choices_change_no_mean() {
    let spp = thorough(4, 16);
    let squares = |world: &World, seed: u64| -> Vec<Mean> {
        let films = blocks_of(&replicates(world, SIZE, spp, seed));
        (0..24).map(|b| films.iter().map(|blocks| blocks[b].iter().sum()).collect()).collect()
    };
    let deviation = |a: &[Mean], b: &[Mean]| {
        let each = a.iter().zip(b).map(|(a, b)| a.against_estimate(b).t().abs());
        each.fold(0.0, f64::max)
    };
    let by_power = squares(&selected("room", LightSelection::Power), 100);
    let mut learned = selected("room", LightSelection::Learned);
    let found = deviation(&by_power, &squares(&learned, 200));
    learned.set_max_depth(2);
    let short = deviation(&by_power, &squares(&learned, 300));
    assert!(found < 6.5 && short > 6.5, "{found} standard errors, {short} without a bounce");
}

#[test]
fn learned_choices_do_not_depend_on_threads_or_tiles() {
    let world = selected("room", LightSelection::Learned);
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let draw = |words: &str, threads, (rows, slice, shuffle)| {
        let points =
            registry::points("sobol", PointSettings { seed: 3, spp: Some(8) }).unwrap_or_else(|e| panic!("{e}"));
        let made = registry::sampler(words, points, &MethodInputs::default());
        let mut sampler = made.unwrap_or_else(|e| panic!("{e}")).sampler;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let schedule = Schedule::default().with_tile_rows(rows).with_progress_spp(slice).with_shuffle(shuffle);
        let limits = Limits::samples(8 * frame.pixels() as u64).with_schedule(schedule);
        hash(&pool.install(|| film_in(&world, frame, Needs::none(), &mut *sampler, &limits)))
    };
    for words in ["uniform", "cluster"] {
        let one = draw(words, 1, (16, 0, 0));
        for (threads, schedule) in [(2, (1, 0, 0)), (3, (16, 1, 5)), (7, (33, 3, 9))] {
            assert_eq!(draw(words, threads, schedule), one, "{words}, {threads} threads");
        }
        assert!(one != hash(&uniform(&selected("room", LightSelection::Power), 3, 8)));
    }
}

/// With one light or none, nothing is learned and the image is unchanged.
#[test]
fn one_light_leaves_nothing_to_learn() {
    for name in ["cornell", "furnace"] {
        let [power, learned] = [LightSelection::Power, LightSelection::Learned].map(|choice| {
            let world = selected(name, choice);
            assert!(!integrator(&world).wants_training());
            hash(&uniform(&world, 1, 2))
        });
        assert_eq!(power, learned, "{name}");
    }
}

/// Returns a courtyard under an environment. Its walls hide a part of the environment from the floor, and most of the light is
/// behind one wall.
fn courtyard(choice: LightSelection) -> World {
    let mut scene = scene(SIZE, 60.0, DVec3::new(0.0, -2.5, 2.0), DVec3::new(0.0, 0.0, 0.2));
    let white = add_material(&mut scene, diffuse(0.6));
    plate(&mut scene, [DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0], white, None);
    for (at, along) in [(DVec3::X * 1.5, DVec3::Y * 3.0), (DVec3::Y * 1.5, DVec3::X * 3.0)] {
        plate(&mut scene, [at + DVec3::Z * 0.7, along, DVec3::Z * 0.7], white, None);
    }
    // A low sun of a few texels behind the wall at +x, and another half as bright on the other side.
    let radiance = lat_long([64, 32], |x, y| match (x, y) {
        (0..4, 12..14) => 120.0,
        (32..36, 12..14) => 60.0,
        (_, 0..16) => 0.8,
        _ => 0.2,
    });
    add_light(&mut scene, LightKind::Infinite { radiance }, DAffine3::IDENTITY);
    let mut world = world(&scene);
    world.set_light_selection(choice);
    world
}

/// Images at 8 samples per pixel are compared with a reference of 192 samples per pixel (thorough test: 1024). The scenes are a
/// room with eight lamps, and a courtyard under an environment whose tiles are selected. Larger images of the room have 0.26 of
/// the error of uniform selection and 0.23 of selection by power (docs/results/adaptive.md).
#[test]
fn learned_choices_pay() {
    let errors = |worlds: [World; 3]| {
        let truth = uniform(&worlds[2], 999, thorough(192, 1024)).image();
        worlds.map(|world| {
            let error = |image: Vec<[f32; 3]>| {
                let pairs = image.iter().flatten().zip(truth.iter().flatten());
                pairs.map(|(x, t)| f64::from((x - t).powi(2) / (t * t + 0.01))).sum::<f64>()
            };
            (1..=4).map(|seed| error(uniform(&world, seed, 8).image())).sum::<f64>()
        })
    };
    let choices = [LightSelection::Power, LightSelection::Uniform, LightSelection::Learned];
    let [power, by_turns, learned] = errors(choices.map(|choice| selected("room", choice)));
    assert!(learned < 0.7 * by_turns.min(power), "{learned} of {by_turns} by turns, {power} by power");
    let [power, _, learned] = errors(choices.map(courtyard));
    assert!(learned < 0.7 * power, "{learned} of {power}");
}

/// An environment whose tiles are joined again gives the same light as before.
#[test]
fn a_sky_cut_up_is_made_whole() {
    let mut world = courtyard(LightSelection::Power);
    let before = hash(&uniform(&world, 1, 2));
    assert_eq!(world.lights().len(), 1);
    for choice in [LightSelection::Learned, LightSelection::Learned, LightSelection::Power] {
        world.set_light_selection(choice);
    }
    assert!(world.lights().len() == 1 && hash(&uniform(&world, 1, 2)) == before);
}
