//! The same image on any number of threads, in any order of tiles, in any process, and in any unit of length.

use crate::support::*;
use dapple_conformance::toys::Points;
use dapple_job::registry::{self, MethodInputs, POINTS, PointSettings, SAMPLERS};
use dapple_low_discrepancy::Mitchell1991;
use std::collections::BTreeSet;
use std::sync::Mutex;

const SIZE: [u32; 2] = [29, 22];
const SPP: u64 = 12;

fn points(name: &str) -> registry::AnyPoints {
    registry::points(name, PointSettings { seed: 11, spp: Some(SPP) }).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns the hash of an image with this sampler, point set, schedule and number of threads.
fn rendered(world: &World, sampler: &str, name: &str, schedule: Schedule, threads: usize) -> u64 {
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let limits = Limits::samples(SPP * frame.pixels() as u64).with_schedule(schedule);
    let made = registry::sampler(sampler, points(name), &MethodInputs::of(Arc::new(world.clone())));
    let mut sampler = made.unwrap_or_else(|e| panic!("{e}")).sampler;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let needs = Needs::none().with_variance().with_features();
    let film = pool.install(|| film_in(world, frame, needs, &mut *sampler, &limits));
    assert_eq!(film.record().rejected, 0);
    // Features and variance must not change either.
    let extra: Vec<_> = (0..frame.pixels()).map(|i| (film.moments(i), film.features(i))).collect();
    fnv(hash(&film), format!("{extra:?}").bytes())
}

/// Every sampler is tested with one point set, and every point set with one a-priori and one adaptive sampler. Since samplers
/// use point sets through one trait, other pairs would add time but no case.
#[test]
fn threads_and_tiles_change_no_bit_d01() {
    let worlds = [world(&room(SIZE)), small(&bundle("plates"), SIZE)];
    let schedule = |(rows, slice, shuffle)| {
        Schedule::default().with_tile_rows(rows).with_progress_spp(slice).with_shuffle(shuffle)
    };
    let schedules = [((1, 0, 0), 7), ((64, 5, 9), 2), ((7, 0, 5), 2), ((16, 1, 0), 3), ((1, 3, 77), 3)];
    let samplers = SAMPLERS.iter().map(|sampler| (sampler.name, "sobol"));
    let points = POINTS.iter().flat_map(|points| [("uniform", points.name), ("variance", points.name)]);
    for (sampler, points) in samplers.chain(points).collect::<BTreeSet<_>>() {
        let words = match sampler {
            "mdas" => "mdas:force=1",
            "fourier-dof" => "fourier-dof:force=1",
            name => name,
        };
        for world in &worlds[..thorough(1, 2)] {
            let expected = rendered(world, words, points, schedule((1, 0, 0)), 1);
            for &(words_of, threads) in &schedules[..thorough(2, 5)] {
                let found = rendered(world, words, points, schedule(words_of), threads);
                assert_eq!(
                    found, expected,
                    "{sampler}, {points}, {threads} threads, rows, slice, shuffle {words_of:?}"
                );
            }
        }
    }
}

/// Prints the hash for [`fresh_processes_render_the_same_bits_d03`].
#[test]
#[ignore = "run by fresh_processes_render_the_same_bits_d03"]
#[allow(clippy::print_stdout)]
fn fresh_processes_child_d03() {
    let plates = small(&bundle("plates"), SIZE);
    println!("hash={:016x}", rendered(&plates, "variance", "sobol", Schedule::default(), 3));
}

#[test]
fn fresh_processes_render_the_same_bits_d03() {
    let program = std::env::current_exe().expect("a test knows its program");
    let arguments =
        ["--exact", "determinism::fresh_processes_child_d03", "--ignored", "--nocapture", "--test-threads=1"];
    let in_process = || {
        let output = std::process::Command::new(&program).args(arguments).output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let (_, hash) = text.split_once("hash=").unwrap_or_else(|| panic!("no hash in {text}"));
        hash[..16].to_owned()
    };
    let here = rendered(&small(&bundle("plates"), SIZE), "variance", "sobol", Schedule::default(), 1);
    let hashes: BTreeSet<String> = (0..3).map(|_| in_process()).chain([format!("{here:016x}")]).collect();
    assert_eq!(hashes.len(), 1, "{hashes:?}");
}

/// A film of n + 1 samples equals a film of n samples plus the last sample, computed alone.
#[test]
fn one_sample_replayed_alone_is_the_same_d03() {
    let world = world(&room(SIZE));
    let integrator = integrator(&world);
    for entry in POINTS {
        let points = points(entry.name);
        let [before, after] = [5, 6].map(|spp| film_of(&world, SIZE, spp, self::points(entry.name)));
        for i in [0, 17, 400, after.frame().pixels() - 1] {
            let id = SampleId::new(after.frame().pixel(i), streams::WHOLE, 5);
            let alone = integrator.estimate(&Draws::new(&points, id), &mut Worker::default()).radiance;
            // Welford's step, as in the film.
            let step = |m: f64, x: f32| m + (f64::from(x) - m) * (1.0 / 6.0);
            let expected: [f64; 3] = std::array::from_fn(|c| step(before.mean(i)[c], alone[c]));
            assert_eq!(after.mean(i), expected, "pixel {i}, {}", points.describe());
        }
    }
}

/// Returns a scene, transformed by `map`, whose coordinates are exact in f32, even after a translation by a power of two.
fn dyadic(map: DAffine3) -> Scene {
    let mut scene = scene(SIZE, 50.0, DVec3::new(0.0, -4.0, 0.5), DVec3::new(0.0, 0.0, 0.5));
    let grey = add_material(&mut scene, diffuse(0.7));
    let shiny = add_material(&mut scene, metal(0.25));
    plate(&mut scene, [DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y], grey, None);
    ball(&mut scene, DVec3::new(0.25, 0.5, 0.5), 0.5, shiny, None);
    plate(&mut scene, [DVec3::new(0.0, 0.0, 1.5), DVec3::Y, DVec3::X], grey, Some(3.0));
    let disk = Geometry::Disk { height: 0.25, radius: 0.5, inner_radius: 0.125 };
    add(&mut scene, disk, at(-1.0, 0.0, 0.0), grey, Some(1.0));
    add_sky(&mut scene, 0.25);
    scene.shapes.iter_mut().for_each(|s| s.to_world = map * s.to_world);
    scene.camera.to_world = map * scene.camera.to_world;
    scene
}

#[test]
fn scale_changes_no_bit_g04() {
    let expected = hash(&image(&dyadic(DAffine3::IDENTITY), 4, 1));
    for exponent in [-90, -40, -13, -1, 1, 7, 40, 90] {
        let scale = DAffine3::from_scale(DVec3::splat(f64::from(exponent).exp2()));
        assert_eq!(hash(&image(&dyadic(scale), 4, 1)), expected, "scaled by 2^{exponent}");
    }
}

#[test]
fn a_scene_far_from_the_origin_renders_the_same_g20() {
    let expected = hash(&image(&dyadic(DAffine3::IDENTITY), 4, 1));
    for exponent in [7, 20, 30] {
        let far = f64::from(exponent).exp2();
        assert_eq!(hash(&image(&dyadic(at(far, -far, 3.0 * far)), 4, 1)), expected, "moved by 2^{exponent}");
    }
}

/// A mirrored world looks like the mirrored scene: lamps emit to the same side.
#[test]
fn a_mirrored_lamp_emits_to_its_own_side_l12() {
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let [plain, mirrored] = [DAffine3::IDENTITY, mirror].map(|map| mean(&image(&dyadic(map), 256, 1)));
    assert!((0..3).all(|c| (plain[c] / mirrored[c] - 1.0).abs() < 5e-3), "{plain:?} {mirrored:?}");
}

/// With every point set in base 2, each pair of each block that the integrator requests is a net.
#[test]
fn the_integrators_pairs_are_nets_s02() {
    let (asked, points) = (Mutex::new(BTreeSet::new()), Sobol::new(1));
    let recorded = Points(|id, block| {
        asked.lock().expect("no test panics here").insert(block);
        points.block(id, block)
    });
    film_of(&world(&room(SIZE)), SIZE, 4, recorded);
    let asked = asked.into_inner().expect("no test panics here");
    let named: BTreeSet<u32> = std::iter::once(blocks::CAMERA.number())
        .chain((0..8).flat_map(|v| [blocks::scatter(v).number(), blocks::choose(v).number()]))
        .collect();
    assert!(asked.is_subset(&named), "{asked:?} are not all named");
    assert!(asked.len() >= 10, "{asked:?}");
    let drawn = |name: &str, seed, m: u32, pixel, block| -> Vec<[f32; 4]> {
        let setting = PointSettings { seed, spp: Some(1 << m) };
        let points = registry::points(name, setting).unwrap_or_else(|e| panic!("{e}"));
        (0..1 << m).map(|index| points.block(SampleId::new(pixel, 0, index), block)).collect()
    };
    for name in ["sobol", "lowdiscrepancy", "zsobol"] {
        for (seed, pixel) in (0..4_u64).flat_map(|s| (0..25).map(move |p| (s, [p * 41 % 97, p * 17]))) {
            for (&block, m) in asked.iter().flat_map(|b| [2, 5, 8].map(|m| (b, m))) {
                let drawn = drawn(name, seed, m, pixel, block);
                let nets = is_net(&drawn, 0, m) && is_net(&drawn, 2, m);
                assert!(nets, "{name}, seed {seed}, {pixel:?}, block {block}, 2^{m}");
            }
        }
    }
    assert_eq!(blocks::TIME.number(), Mitchell1991::TIME_BLOCK);
    // Negative control: independent numbers are no net.
    assert!(!is_net(&drawn("random", 1, 8, [3, 4], 1), 0, 8));
}

/// Returns true if dimensions `axis` and `axis + 1` put one of 2^m points in each elementary interval.
fn is_net(drawn: &[[f32; 4]], axis: usize, m: u32) -> bool {
    (0..=m).all(|a| {
        let (wide, high) = ((1_u32 << a) as f32, (1_u32 << (m - a)) as f32);
        let cell = |p: &[f32; 4]| (p[axis] * wide) as u32 * (1 << (m - a)) + (p[axis + 1] * high) as u32;
        let mut seen = vec![false; drawn.len()];
        drawn.iter().map(cell).all(|c| !std::mem::replace(&mut seen[c as usize], true))
    })
}
