//! A choice among lights that is learned per cell: what it leaves as it is, and what it is worth.

use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Needs, NoWatch, Sampler, Schedule, render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::light::LightChoice;
use dapple_renderer::registry::{self, Setting};
use dapple_renderer::{Stage, World, bundled, integrator};

const SIZE: [u32; 2] = [48, 32];

fn room(choice: LightChoice) -> World {
    let scene = bundled::files("room").expect("bundled").read().unwrap_or_else(|e| panic!("{e}"));
    let mut world = World::with_resolution(&scene, SIZE).unwrap_or_else(|e| panic!("{e}"));
    world.set_light_choice(choice);
    world
}

fn film(world: &World, sampler: &mut dyn Sampler, spp: u64, schedule: Schedule) -> Film {
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let mut limits = Limits::samples(spp * frame.pixels() as u64);
    limits.schedule = schedule;
    render(&mut *integrator(world), sampler, Needs::none(), frame, &limits, &mut NoWatch)
        .unwrap_or_else(|e| panic!("{e}"))
}

fn uniform(world: &World, seed: u64, spp: u64) -> Film {
    film(world, &mut Uniform::new(Sobol::new(seed)), spp, Schedule::default())
}

/// Mean and its squared standard error of each of 6 by 4 squares of the picture, over 16 seeds.
fn squares(world: &World, first_seed: u64) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; 24];
    for seed in 0..16 {
        let film = uniform(world, first_seed + seed, 16);
        let mut means = vec![0.0; 24];
        for i in 0..film.frame().pixels() {
            let [x, y] = [i as u32 % SIZE[0] / 8, i as u32 / SIZE[0] / 8];
            means[(y * 6 + x) as usize] += film.mean(i).iter().sum::<f64>() / 192.0;
        }
        for (sum, mean) in sums.iter_mut().zip(means) {
            *sum = [sum[0] + mean, sum[1] + mean * mean];
        }
    }
    let of = |[sum, squares]: [f64; 2]| {
        let mean = sum / 16.0;
        [mean, (squares / 16.0 - mean * mean) / 15.0]
    };
    sums.into_iter().map(of).collect()
}

/// 24 squares: Student's t of 15 degrees of freedom stays below 6.5 with 1e-5 each.
#[test]
fn learned_choices_change_no_mean() {
    const CRITICAL: f64 = 6.5;
    let deviation = |a: &[[f64; 2]], b: &[[f64; 2]]| {
        let each = a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).abs() / (a[1] + b[1]).sqrt());
        each.fold(0.0, f64::max)
    };
    let by_power = squares(&room(LightChoice::Power), 100);
    let learned = squares(&room(LightChoice::Cells), 200);
    let found = deviation(&by_power, &learned);
    assert!(found < CRITICAL, "{found} standard errors");
    // Negative control: a picture that lacks a bounce is told apart.
    let mut short = room(LightChoice::Cells);
    short.set_max_depth(2);
    let found = deviation(&by_power, &squares(&short, 300));
    assert!(found > CRITICAL, "{found} standard errors");
}

#[test]
fn learned_choices_do_not_depend_on_threads_or_tiles() {
    let world = room(LightChoice::Cells);
    let draw = |words: &str, threads, schedule| {
        let points = registry::points("sobol", Setting { seed: 3, spp: Some(8) }).unwrap_or_else(|e| panic!("{e}"));
        let mut sampler = registry::sampler(words, points, &Stage::empty()).unwrap_or_else(|e| panic!("{e}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let film = pool.install(|| film(&world, &mut *sampler, 8, schedule));
        film.picture().iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>()
    };
    for words in ["uniform", "cluster"] {
        let one = draw(words, 1, Schedule::default());
        for (threads, tile_rows, slice_spp, shuffle) in [(2, 1, 0, 0), (3, 16, 1, 5), (7, 33, 3, 9)] {
            assert!(
                draw(words, threads, Schedule { tile_rows, slice_spp, shuffle }) == one,
                "{words}, {threads} threads"
            );
        }
    }
    assert!(
        draw("uniform", 1, Schedule::default()) != {
            let power = room(LightChoice::Power);
            uniform(&power, 3, 8).picture().iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>()
        }
    );
}

/// One light, or none: nothing is learned, and nothing changes.
#[test]
fn one_light_leaves_nothing_to_learn() {
    for name in ["cornell", "furnace"] {
        let scene = bundled::files(name).expect("bundled").read().unwrap_or_else(|e| panic!("{e}"));
        let pictures = [LightChoice::Power, LightChoice::Cells].map(|choice| {
            let mut world = World::with_resolution(&scene, SIZE).unwrap_or_else(|e| panic!("{e}"));
            world.set_light_choice(choice);
            assert!(!integrator(&world).observes());
            uniform(&world, 1, 2).picture()
        });
        assert!(pictures[0] == pictures[1], "{name}");
    }
}

/// What it is for: at 8 samples a pixel in a room of eight lamps. Larger pictures with more seeds have .26 of the error of
/// choices by turns, and .23 of that by power (docs/results/cluster.md).
#[test]
fn learned_choices_pay_in_a_room_of_many_lamps() {
    let worlds = [LightChoice::Power, LightChoice::Uniform, LightChoice::Cells].map(room);
    let truth = uniform(&worlds[2], 999, 1024).picture();
    let error = |world: &World| -> f64 {
        (1..=4)
            .map(|seed| {
                let picture = uniform(world, seed, 8).picture();
                let pairs = picture.iter().flatten().zip(truth.iter().flatten());
                pairs.map(|(x, t)| f64::from((x - t).powi(2) / (t * t + 0.01))).sum::<f64>()
            })
            .sum()
    };
    let [power, by_turns, learned] = [0, 1, 2].map(|i| error(&worlds[i]));
    assert!(learned < 0.7 * by_turns.min(power), "{learned} of {by_turns} by turns, {power} by power");
}
