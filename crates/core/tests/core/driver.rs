//! The render loop: the same bits however the work is done, exact budgets, honest failures.

use crate::common::*;
use dapple_adaptive::{Adaptive, PilotPolicy, Sequence, VarianceOptions};
use dapple_conformance::toys::raised;
use dapple_core::integrator::TrainingData;
use dapple_core::limits::{Budget, Schedule};
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::point_set::streams;
use dapple_core::render::{Control, Status};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Draws, Error, Estimate, Film, Frame, Integrator, Limits, Needs, PointSet as _, Render, Sampler, Worker,
};
use std::sync::Mutex;
use std::time::Instant;

fn adaptive(policy: PilotPolicy) -> Adaptive<Independent> {
    Adaptive::variance_with_options(Independent::new(7), VarianceOptions::default().policy(policy)).unwrap()
}

fn image(limits: &Limits) -> Vec<u64> {
    let policies = [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Cross];
    policies
        .into_iter()
        .flat_map(|policy| {
            bits(&run(&mut Field(noise), &mut adaptive(policy), everything(), frame(23, 37), limits).unwrap())
        })
        .collect()
}

#[test]
fn the_number_of_threads_changes_no_bit_d01() {
    let limits = Limits::samples(12 * 23 * 37 + 11);
    let one = on_threads(1, || image(&limits));
    for threads in [2, 3, 7, 16, 64] {
        assert!(on_threads(threads, || image(&limits)) == one, "{threads} threads");
    }
    // Negative control: another seed gives other bits.
    let film = |seed| {
        bits(&run(&mut Field(noise), &mut uniform(seed), Needs::none(), frame(3, 3), &Limits::samples(9)).unwrap())
    };
    assert!(film(1) != film(2));
}

#[test]
fn some_tile_sizes_and_orders_change_no_bit_d02() {
    check_tiles(&[1, 7, u32::MAX], &[(13, 9), (0, 77)]);
}

#[test]
#[ignore = "8 s: 24 schedules; six are tested always"]
fn tile_size_and_order_change_no_bit_d02() {
    check_tiles(&[0, 1, 7, 16, 64, u32::MAX], &[(1, 0), (13, 9), (0, 77), (u32::MAX, 1)]);
}

/// Rows of tiles; slices and shuffles.
fn check_tiles(rows: &[u32], orders: &[(u32, u64)]) {
    let mut limits = Limits::samples(12 * 23 * 37 + 11);
    let one = image(&limits);
    for &tile_rows in rows {
        for &(progress_spp, shuffle) in orders {
            limits.schedule =
                Schedule::default().with_tile_rows(tile_rows).with_progress_spp(progress_spp).with_shuffle(shuffle);
            assert!(image(&limits) == one, "{:?}", limits.schedule);
        }
    }
}

#[test]
fn a_panic_in_a_worker_names_its_sample_d06() {
    for threads in [1, 2, 7] {
        let mut bomb = Field(|pixel: [u32; 2], u: [f32; 4]| {
            assert!(pixel != [5, 3] || u[0] < 0.99, "a bomb");
            noise(pixel, u)
        });
        let mut limits = Limits::samples(300 * 64);
        limits.schedule.progress_spp = 100;
        let start = Instant::now();
        let mut sampler = uniform(3);
        let answer = on_threads(threads, || run(&mut bomb, &mut sampler, Needs::none(), frame(8, 8), &limits));
        let Err(Error::Panicked { sample, message, points, film }) = answer else { panic!("no error") };
        assert!(start.elapsed().as_secs_f64() < 1.0);
        assert_eq!((sample.pixel, sample.stream, points.as_str()), ([5, 3], streams::WHOLE, "independent:seed=3"));
        assert!(message.contains("a bomb"));
        assert!(Independent::new(3).block(sample, 0)[0] >= 0.99, "the sample named does not replay");
        // Finished samples: the bad pixel's up to that sample, and all of the other rows.
        assert_eq!(film.count(3 * 8 + 5), sample.index);
        assert!(film.record().samples >= 56 * 100);
        assert_eq!(film.record().samples, film.counts().iter().sum::<u64>());
    }
}

#[test]
fn odd_thread_pools_change_no_bit_d08() {
    let limits = Limits::samples(5 * 21);
    let film = || {
        bits(&run(&mut Field(noise), &mut adaptive(PilotPolicy::Keep), Needs::none(), frame(7, 3), &limits).unwrap())
    };
    let outside = film();
    for threads in [0, 1, 50] {
        assert!(on_threads(threads, film) == outside, "{threads} threads");
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    // Several renders at once, from inside tasks of one pool.
    let (a, (b, c)) = pool.install(|| rayon::join(film, || rayon::join(film, film)));
    assert!([a, b, c].iter().all(|f| *f == outside));
    let mut inside = None;
    pool.scope(|scope| scope.spawn(|_| inside = Some(film())));
    assert!(inside == Some(outside));
}

#[test]
fn images_of_all_sizes_render_r02() {
    for [w, h] in [[1, 1], [1, 4097], [4097, 1], [7, 13]] {
        let film = run(
            &mut Field(noise),
            &mut adaptive(PilotPolicy::Keep),
            Needs::none(),
            frame(w, h),
            &Limits::samples(u64::from(w * h) * 3 + 1),
        )
        .unwrap();
        assert_eq!(film.counts().iter().sum::<u64>(), u64::from(w * h) * 3 + 1);
        assert!(film.counts().iter().all(|n| *n >= 3));
    }
    for [w, h] in [[0, 5], [5, 0], [0, 0]] {
        assert!(matches!(Frame::new(w, h), Err(Error::EmptyFrame { .. })));
    }
    assert!(matches!(Frame::new(1 << 16, 1 << 16), Err(Error::FrameTooLarge { .. })));
    for [x0, y0, x1, y1] in [[3, 0, 3, 1], [4, 0, 3, 1], [0, 0, 8, 1], [0, 2, 1, 2], [0, 0, 1, 14]] {
        assert!(matches!(frame(7, 13).crop(x0, y0, x1, y1), Err(Error::BadCrop { .. })));
    }
}

/// Images of 2^32 pixels and more are refused. The last window of the largest image is correct.
#[test]
fn images_of_2_32_pixels_are_refused_z01() {
    assert!(matches!(Frame::new(70_000, 70_000), Err(Error::FrameTooLarge { .. })));
    let all = Frame::new(65_537, 65_535).unwrap();
    assert_eq!(all.pixels() as u64, u64::from(u32::MAX));
    assert_eq!(
        [all.pixel(all.pixels() - 1), all.pixel(1 << 31)],
        [[65_536, 65_534], [(1u32 << 31) % 65_537, (1 << 31) / 65_537]]
    );
    let last = all.crop(65_530, 65_530, 65_537, 65_535).unwrap();
    // Each pixel shows its place: seven columns of exact f32.
    let place = |[x, y]: [u32; 2], _: [f32; 4]| [x as f32, y as f32, 0.0];
    let sampler = &mut uniform(1);
    let film = run(&mut Field(place), sampler, Needs::none(), last, &Limits::samples(35 * 3)).unwrap();
    for i in 0..35 {
        assert_eq!(film.mean(i), [(65_530 + i % 7) as f64, (65_530 + i / 7) as f64, 0.0]);
    }
}

#[test]
fn crops_are_the_full_frame_r06() {
    let draw = |size: Frame| {
        run(&mut Field(noise), &mut uniform(5), everything(), size, &Limits::samples(12 * size.pixels() as u64))
            .unwrap()
    };
    let full = draw(frame(20, 18));
    for [x0, y0, x1, y1] in [[3, 5, 17, 18], [0, 0, 1, 18], [19, 17, 20, 18]] {
        let crop = draw(frame(20, 18).crop(x0, y0, x1, y1).unwrap());
        for i in 0..crop.frame().pixels() {
            let [x, y] = crop.frame().pixel(i).map(|n| n as usize);
            assert_eq!(crop.moments(i), full.moments(y * 20 + x));
            assert_eq!((crop.half(0, i), crop.half(1, i)), (full.half(0, y * 20 + x), full.half(1, y * 20 + x)));
        }
    }
}

#[test]
fn a_larger_budget_continues_the_smaller_x06() {
    for needs in [Needs::none().with_variance(), everything()] {
        let draw = |budgets: &[u64]| raised(&mut Field(noise), &mut uniform(5), needs, frame(9, 8), budgets);
        for (first, all) in [(64 * 72, 128 * 72), (64 * 72 + 5, 128 * 72 + 61), (72, 73), (100, 130)] {
            let (at_once, later) = (draw(&[all]), draw(&[first, all]));
            assert_eq!((at_once.record().rounds.len(), later.record().rounds.len()), (1, 2));
            for i in 0..72 {
                assert_eq!((at_once.moments(i), at_once.mean(i)), (later.moments(i), later.mean(i)));
                assert_eq!(at_once.half(1, i), later.half(1, i));
            }
        }
    }
}

#[test]
fn the_largest_number_of_samples_is_known_or_assumed() {
    let expected = |limits: Limits| limits.expected_samples(&frame(4, 3));
    let timed = Limits::seconds(1.0);
    assert_eq!([Limits::samples(7), Limits::spp(2.5), Limits::error(0.1, 99)].map(expected), [7, 30, 99]);
    assert_eq!([timed.clone(), timed.with_max_spp(5)].map(expected), [64 * 12, 5 * 12]);
}

#[test]
fn tiny_budgets_are_spent_or_refused_a06() {
    let pixels = 12;
    let draw = |total, min_spp| {
        let mut limits = Limits::samples(total);
        limits.min_spp = min_spp;
        run(&mut Field(noise), &mut uniform(5), Needs::none(), frame(4, 3), &limits)
    };
    for (total, min_spp) in [(0, 0), (0, 1), (1, 1), (pixels - 1, 1), (pixels * 4 - 1, 4)] {
        assert!(matches!(draw(total, min_spp), Err(Error::BudgetTooSmall { budget, .. }) if budget == total));
    }
    for total in [1, 5, pixels - 1] {
        let film = draw(total, 0).unwrap();
        assert_eq!(film.counts().iter().sum::<u64>(), total);
        assert!(film.counts().iter().all(|n| *n <= 1), "the count map shows the pixels without samples");
        assert_eq!(film.counts(), draw(total, 0).unwrap().counts());
    }
    let mut limits = Limits::samples(pixels * 9 + 1);
    limits.max_spp = 9;
    let too_many = run(&mut Field(noise), &mut uniform(5), Needs::none(), frame(4, 3), &limits);
    assert!(matches!(too_many, Err(Error::BudgetTooLarge { most: 108, .. })));
    (limits.min_spp, limits.max_spp) = (5, 4);
    let crossed = run(&mut Field(noise), &mut uniform(5), Needs::none(), frame(4, 3), &limits);
    assert!(matches!(crossed, Err(Error::OutOfRange { .. })));
    for budget in [Budget::Seconds(0.0), Budget::Seconds(f64::NAN), Budget::Error { relmse: -1.0, at_most: 99 }] {
        let answer = run(&mut Field(noise), &mut uniform(5), Needs::none(), frame(4, 3), &Limits::new(budget));
        assert!(matches!(answer, Err(Error::OutOfRange { .. })));
    }
}

#[test]
fn a_monitor_stops_between_slices_and_leaves_whole_pixels() {
    let mut limits = Limits::samples(64 * 100);
    limits.schedule.progress_spp = 13;
    let stop_after = |calls: u32, limits: &Limits, sampler: &mut dyn Sampler| -> Film {
        let mut called = 0;
        let mut monitor = |status: &Status<'_>| {
            called += 1;
            assert_eq!(status.samples, status.film.counts().iter().sum::<u64>());
            if called == calls { Control::Stop } else { Control::Continue }
        };
        Render::new(frame(10, 10), limits)
            .needs(Needs::none().with_variance())
            .monitor(&mut monitor)
            .run(&mut Field(noise), sampler)
            .unwrap()
    };
    let film = stop_after(3, &limits, &mut uniform(5));
    assert!(film.record().interrupted && film.counts().iter().all(|n| *n == 39));
    // The same as a render with that budget.
    let whole = stop_after(99, &Limits::samples(3900), &mut uniform(5));
    assert!(!whole.record().interrupted && (0..100).all(|i| whole.moments(i) == film.moments(i)));
    // At the end of an earlier round it is an interruption, at the end of the last it is none.
    let (steps, mut two_rounds) = (Limits::samples(900), Sequence::new(uniform(5), 5, uniform(5)).unwrap());
    let film = stop_after(1, &steps, &mut two_rounds);
    assert_eq!((film.record().interrupted, film.record().samples), (true, 500));
    let film = stop_after(2, &steps, &mut two_rounds);
    assert_eq!((film.record().interrupted, film.record().samples), (false, 900));
}

/// Every sample of every round, as the integrator saw it.
fn ids(sampler: &mut dyn dapple_core::Sampler, needs: Needs, spp: u64) -> Vec<(u32, u64)> {
    let seen = Mutex::new(Vec::new());
    let mut spy = Traced(|draws: &Draws<'_>, _: &mut Worker| {
        seen.lock().unwrap().push((draws.id().stream, draws.id().index));
        Estimate::new([numbers(draws)[0]; 3])
    });
    run(&mut spy, sampler, needs, frame(1, 1), &Limits::samples(spp)).unwrap();
    seen.into_inner().unwrap()
}

#[test]
fn samples_of_halves_go_to_their_streams() {
    let [a, b] = streams::HALVES;
    let halves = Needs::none().with_halves();
    let expected: Vec<(u32, u64)> = (0..9).map(|i: u64| (if i & 1 == 0 { a } else { b }, i >> 1)).collect();
    assert_eq!(ids(&mut uniform(1), halves, 9), expected);
    let whole: Vec<(u32, u64)> = (0..9).map(|i| (streams::WHOLE, i)).collect();
    assert_eq!(ids(&mut uniform(1), Needs::none(), 9), whole);
    // Discarded samples have streams of their own; kept ones stay a prefix.
    let traced = ids(&mut adaptive(PilotPolicy::Discard), Needs::none(), 12);
    let kept: Vec<u64> = traced.iter().filter(|s| s.0 == streams::WHOLE).map(|s| s.1).collect();
    let discarded: Vec<u64> = traced.iter().filter(|s| s.0 == streams::DISCARDED).map(|s| s.1).collect();
    assert!(kept.iter().copied().eq(0..kept.len() as u64) && discarded.iter().copied().eq(0..4));
    assert_eq!(kept.len() + discarded.len(), 12);
}

/// Learns the mean of what it noted, and shifts its next estimates by it.
fn shifted(learned: &[TrainingData], draws: &Draws<'_>, observed: &mut Worker) -> Estimate {
    let u = numbers(draws);
    observed.note(u64::from(draws.pixel()[0] / 5), u[0]);
    observed.note(1000 + (u[1] * 10.0) as u64, u[2] * 0.1);
    observed.note(7, f32::NAN);
    let entries = learned.last().map_or(&[][..], |pass| pass.entries());
    let shift: f64 = entries.iter().map(|e| e.sum / e.count as f64).sum();
    Estimate::new([u[0] + shift as f32; 3])
}

#[test]
fn learning_does_not_depend_on_threads_or_tiles() {
    let draw = |threads, schedule| {
        let mut learner = Learner::new(usize::MAX, shifted);
        let limits = Limits::samples(20_000).with_schedule(schedule);
        let mut sampler = three_rounds(1, [2, 5]);
        let film =
            on_threads(threads, || run(&mut learner, &mut sampler, Needs::none(), frame(37, 50), &limits)).unwrap();
        (learner.learned, bits(&film))
    };
    let one = draw(1, Schedule::default());
    // 1850 pixels: training passes of 1, 1 and the remainder, then as many samples as before.
    let noted: Vec<u64> = one.0.iter().map(|o| o.entries().iter().map(|e| e.count).sum()).collect();
    // Two notes per sample; NaN is dropped.
    assert_eq!(noted[..2], [2 * 1850; 2]);
    assert_eq!(noted.iter().sum::<u64>(), 2 * 20_000);
    assert!((5..8).contains(&noted.len()), "{noted:?}");
    assert!(one.0[0].entries().windows(2).all(|w| w[0].key < w[1].key));
    for threads in [2, 3, 7] {
        for (tile_rows, progress_spp, shuffle) in [(1, 0, 0), (16, 1, 5), (33, 7, 0), (64, 0, 9)] {
            assert!(
                draw(
                    threads,
                    Schedule::default().with_tile_rows(tile_rows).with_progress_spp(progress_spp).with_shuffle(shuffle)
                ) == one
            );
        }
    }
}

#[test]
fn exhausted_points_are_refused_before_tracing() {
    let points = Independent { seed: 1, capacity: 64 };
    let mut never = Field(|_, _| -> [f32; 3] { panic!("traced") });
    let draw = |integrator: &mut dyn Integrator, needs, spp: u64| {
        run(integrator, &mut Uniform::new(points), needs, frame(2, 2), &Limits::samples(4 * spp))
    };
    let refused = draw(&mut never, Needs::none(), 65);
    assert!(matches!(refused, Err(Error::SequenceExhausted { capacity: 64, requested: 65, .. })));
    assert!(draw(&mut Field(noise), Needs::none(), 64).is_ok());
    // Two halves have a stream each.
    let halves = Needs::none().with_halves();
    assert!(draw(&mut Field(noise), halves, 128).is_ok());
    assert!(matches!(draw(&mut never, halves, 129), Err(Error::SequenceExhausted { requested: 65, .. })));
    for (spp, fits) in [(128, true), (129, false)] {
        let mut sampler = one_round(points, Retention::Discard, vec![spp; 4]);
        let discarded = run(&mut Field(noise), &mut sampler, halves, frame(2, 2), &Limits::samples(1000));
        assert_eq!(discarded.is_ok(), fits, "{spp} discarded samples in two halves");
    }
    // The same over several rounds.
    let mut two_rounds = Sequence::new(Uniform::new(points), 40, Uniform::new(points)).unwrap();
    let later = run(&mut Field(noise), &mut two_rounds, Needs::none(), frame(2, 2), &Limits::samples(4 * 65));
    assert!(matches!(later, Err(Error::SequenceExhausted { requested: 65, .. })));
}

#[test]
fn a_plan_for_halves_needs_halves() {
    let plan = |_: &Feedback<'_>, plan: &mut Plan| {
        plan.second_half = Some(vec![1; 4]);
        Progress::Trace
    };
    let mut sampler = ToySampler { points: Independent::new(1), needs: Needs::none(), plan };
    let answer = run(&mut Field(noise), &mut sampler, Needs::none(), frame(2, 2), &Limits::samples(40));
    assert!(matches!(answer, Err(Error::BadPlan { .. })));
    let mut sampler = one_round(Independent::new(1), Retention::Keep, vec![0; 4]);
    let answer = run(&mut Field(noise), &mut sampler, Needs::none(), frame(2, 2), &Limits::samples(40));
    assert!(matches!(answer, Err(Error::BadPlan { .. })));
}

/// Bright samples cost a hundred times as much as dark ones.
fn slow_where_bright(_: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    let bright = u[0] < 0.1;
    let turns = if bright { 20_000 } else { 200 };
    let waste = (0..turns).fold(1u64, |h, k| std::hint::black_box(mix(h ^ k)));
    [if bright { 1.0 } else { 0.1 + (waste & 1) as f32 * 1e-30 }; 3]
}

#[test]
fn a_time_limit_stops_near_its_time_a11() {
    for policy in [PilotPolicy::Keep, PilotPolicy::Cross] {
        let start = Instant::now();
        let size = frame(24, 20);
        let film =
            run(&mut Field(slow_where_bright), &mut adaptive(policy), Needs::none(), size, &Limits::seconds(0.6))
                .unwrap();
        let took = start.elapsed().as_secs_f64();
        // A machine shared with others may be late, but not by this much.
        assert!((0.2..3.0).contains(&took), "{took} s of 0.6");
        assert!(film.record().rounds.len() >= 2 && !film.record().interrupted);
    }
}

/// The prediction's relative deviation over 60x60x3 chi-squared values of one degree of freedom is
/// about sqrt(2 / 10800) = 1.4 %, that of the truth alike; stopping at the first crossing lowers the
/// prediction a little. A factor of 1.2 is 8 deviations: false alarms below 1e-12.
#[test]
fn an_error_limit_ends_near_its_error() {
    let field = |_: [u32; 2], u: [f32; 4]| [0.5 + u[0], 2.0 * u[1], 0.1 + u[2] * u[2]];
    let truth = [1.0, 1.0, 0.1 + 1.0 / 3.0];
    for (relmse, seed) in [(0.01, 1), (0.003, 2)] {
        let draw = |limits| run(&mut Field(field), &mut uniform(seed), Needs::none(), frame(60, 60), &limits).unwrap();
        let film = draw(Limits::error(relmse, 1 << 22));
        let predicted = film.predicted_relmse().unwrap();
        let error = |x: &[f32; 3]| {
            (0..3).map(|c| (f64::from(x[c]) - truth[c]).powi(2) / (truth[c].powi(2) + 0.01)).sum::<f64>()
        };
        let actual = film.image().iter().map(error).sum::<f64>() / 10800.0;
        assert!(predicted <= relmse && predicted > 0.4 * relmse, "{predicted} for {relmse}");
        // 1 / (mean^2 + 0.01) is not linear in a noisy mean: allow for its spread at few samples.
        assert!((1.0 / 1.2..1.2).contains(&(predicted / actual)), "{predicted} predicted, {actual} measured");
        let capped = draw(Limits::error(1e-9, 50_001));
        assert_eq!(capped.record().samples, 50_001);
    }
}

/// A far goal is approached in steps of at most twice the samples, a near one in steps of at least an eighth more.
#[test]
fn an_error_limit_raises_the_budget_by_an_eighth_to_twice() {
    let field = |_: [u32; 2], u: [f32; 4]| [0.5 + u[0], 2.0 * u[1], 0.1 + u[2] * u[2]];
    let mut steps = Vec::new();
    for goal in 0..24 {
        let relmse = 0.1 * 0.9_f64.powi(goal);
        let limits = Limits::new(Budget::Error { relmse, at_most: 1 << 22 });
        let mut uniform = uniform(goal as u64);
        let film = run(&mut Field(field), &mut uniform, Needs::none(), frame(16, 16), &limits).unwrap();
        // A budget is shown once more when it is spent.
        let ratios = film.record().budgets.windows(2).map(|two| two[1] as f64 / two[0] as f64);
        steps.extend(ratios.filter(|ratio| *ratio != 1.0));
    }
    assert!(steps.iter().all(|step| (1.12..=2.0).contains(step)), "{steps:?}");
    let [least, most] = [steps.iter().copied().fold(9.0, f64::min), steps.iter().copied().fold(0.0, f64::max)];
    assert!(most == 2.0 && least < 1.13, "the limits are reached: {least} to {most}");
}

#[test]
fn scratch_memory_outlives_bands_and_changes_no_bits() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    static MADE: AtomicUsize = AtomicUsize::new(0);
    struct Stack(Vec<u32>);
    impl Default for Stack {
        fn default() -> Self {
            MADE.fetch_add(1, Ordering::Relaxed);
            Self(Vec::new())
        }
    }
    let scratched = |draws: &Draws<'_>, worker: &mut Worker| {
        let stack: &mut Stack = worker.scratch();
        stack.0.clear();
        stack.0.push(draws.pixel()[0]);
        Estimate::new([stack.0.len() as f32, numbers(draws)[0], 0.0])
    };
    let film = |threads| {
        let limits = Limits::spp(4.0).with_schedule(Schedule::default().with_progress_spp(4));
        on_threads(threads, || Render::new(frame(64, 64), &limits).run(&mut Traced(scratched), &mut uniform(2)))
    };
    let one = film(1).unwrap();
    assert_eq!(MADE.load(Ordering::Relaxed), 1, "one for the 64 rows");
    assert!(bits(&one) == bits(&film(3).unwrap()));
    assert!(MADE.load(Ordering::Relaxed) <= 4);
}
