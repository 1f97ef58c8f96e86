//! Renders resumed from snapshots.

use crate::common::{
    Field, Independent, Keeper, Traced, bits, cut, everything, frame, learner, noise, on_threads, snapshot,
    three_rounds, uniform,
};
use dapple_adaptive::Adaptive;
use dapple_core::{
    Control, Draws, Error, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Sampler, Snapshot, Status, Worker,
};
use std::time::{Duration, Instant};

/// A render's film, and its snapshots.
fn kept(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
) -> (Film, Keeper) {
    let mut keeper = Keeper::default();
    let film = Render::new(frame, limits).needs(needs).monitor(&mut keeper).run(integrator, sampler).unwrap();
    (film, keeper)
}

fn go_on(
    bytes: &[u8],
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
) -> Result<Film, Error> {
    Render::new(frame, limits).needs(needs).resume(Snapshot::from_bytes(bytes)?, integrator, sampler)
}

/// The pixels' statistics, without how they came about.
fn pixels(film: &Film) -> String {
    let one = |i| {
        let halves = (film.half(0, i), film.half(1, i), film.mean(i));
        format!(
            "{:?} {:?} {:?} {:?} {:?}",
            film.moments(i),
            halves,
            film.indirect(1, i),
            film.features(i),
            film.first_hits(i)
        )
    };
    (0..film.frame().pixels()).map(one).collect()
}

#[test]
fn a_render_resumed_on_other_threads_in_other_slices_is_the_same_x05() {
    // Large enough that slices of a training pass have some rows only.
    let frame = frame(90, 70);
    let (mut limits, sampler) = (Limits::samples(70_001), || three_rounds(5, [1, 5]));
    let (film, keeper) = kept(&mut learner(), &mut sampler(), everything(), frame, &limits);
    let whole = bits(&film);
    assert!(film.record().rejected > 100 && film.record().rounds.len() == 3);
    let within = |bytes: &&Vec<u8>| !snapshot(bytes).film().record().samples.is_multiple_of(6300);
    assert!(keeper.slices.iter().filter(within).count() > 2, "slices go by rows");
    for (i, bytes) in keeper.slices.iter().chain([&keeper.end]).enumerate() {
        limits.schedule = cut(i);
        let mut integrator = learner();
        let film = on_threads(1 + i % 4, || {
            go_on(bytes, &mut integrator, &mut sampler(), everything(), frame, &limits).unwrap()
        });
        assert!(bits(&film) == whole, "slice {i}");
        assert_eq!(integrator.learned.len(), 4);
    }
    // Negative control: an integrator without its training gives another image.
    let last = keeper.slices.iter().rev().nth(1).unwrap();
    let forgetful = learner();
    let mut forgetful = Traced(|draws: &Draws<'_>, worker: &mut Worker| forgetful.estimate(draws, worker));
    let film = go_on(last, &mut forgetful, &mut sampler(), everything(), frame, &limits);
    assert!(bits(&film.unwrap()) != whole);
}

#[test]
fn a_snapshot_continues_with_a_larger_budget_x06() {
    let (frame, needs) = (frame(9, 8), everything());
    let draw = |limits: &Limits| kept(&mut Field(noise), &mut uniform(5), needs, frame, limits);
    for (first, all) in [(64 * 72, 128 * 72), (64 * 72 + 5, 128 * 72 + 61), (72, 73), (100, 130)] {
        let (first, mut all) = (Limits::samples(first), Limits::samples(all));
        let (at_once, _) = draw(&all);
        let (_, keeper) = draw(&first);
        all.schedule.slice_spp = 5;
        for bytes in keeper.slices.iter().chain([&keeper.end]) {
            let later = go_on(bytes, &mut Field(noise), &mut uniform(5), needs, frame, &all).unwrap();
            assert!(pixels(&later) == pixels(&at_once));
        }
        // A budget below the samples so far is refused, not ignored.
        let fewer = Limits::samples(71 + 1);
        let answer = go_on(&keeper.end, &mut Field(noise), &mut uniform(5), needs, frame, &fewer);
        match first.budget == fewer.budget {
            true => assert!(pixels(&answer.unwrap()).len() > 1),
            false => assert!(matches!(answer, Err(Error::OtherRender { .. }))),
        }
    }
}

#[test]
fn a_snapshot_of_another_render_is_refused_x04() {
    let limits = Limits::samples(40 * 72);
    let (_, keeper) = kept(&mut Field(noise), &mut uniform(5), Needs::none(), frame(9, 8), &limits);
    let bytes = &keeper.slices[0];
    let refused = |sampler: &mut dyn Sampler, needs, frame, limits: &Limits| match go_on(
        bytes,
        &mut Field(noise),
        sampler,
        needs,
        frame,
        limits,
    ) {
        Err(e @ Error::OtherRender { .. }) => e.to_string(),
        other => panic!("{other:?}"),
    };
    let none = Needs::none();
    let message = refused(&mut uniform(6), none, frame(9, 8), &limits);
    assert!(message.contains("the point set was independent:seed=5, not independent:seed=6"), "{message}");
    let message = refused(&mut Adaptive::variance(Independent::new(5)), none, frame(9, 8), &limits);
    assert!(
        message.contains("the sampler was uniform, not variance:") && message.contains("the sample variance was not"),
        "{message}"
    );
    let message = refused(&mut uniform(5), none, frame(8, 9), &limits);
    assert!(message.contains("9x8 pixels at 0,0 of 9x8, not 8x9 pixels"), "{message}");
    let message = refused(&mut uniform(5), none.with_halves(), frame(9, 8), &limits);
    assert!(message.contains("was one sequence, not two halves"), "{message}");
    let message = refused(&mut uniform(5), none, frame(9, 8), &limits.clone().with_min_spp(3));
    assert!(message.contains("was 1 to 4294967295, not 3 to 4294967295"), "{message}");
    // Positive control.
    assert!(go_on(bytes, &mut Field(noise), &mut uniform(5), none, frame(9, 8), &limits).is_ok());
}

#[test]
fn a_slow_image_is_stopped_within_a_pass_x08() {
    // A millisecond a sample, so that one of every pixel takes seconds.
    let slow = |_: &Draws<'_>, _: &mut Worker| {
        std::thread::sleep(Duration::from_millis(1));
        Estimate::new([1.0; 3])
    };
    let start = Instant::now();
    let (mut last, mut longest) = (start, Duration::ZERO);
    let mut monitor = |_: &Status<'_>| {
        longest = longest.max(last.elapsed());
        last = Instant::now();
        if start.elapsed().as_secs_f64() > 2.0 { Control::Stop } else { Control::Continue }
    };
    // One sample of every pixel takes 10 s on two threads.
    let film = on_threads(2, || {
        Render::new(frame(200, 100), &Limits::samples(20_000))
            .monitor(&mut monitor)
            .run(&mut Traced(slow), &mut uniform(1))
            .unwrap()
    });
    assert!(film.record().interrupted && film.record().samples > 200);
    assert!(longest < Duration::from_secs(2), "{longest:?}");
}
