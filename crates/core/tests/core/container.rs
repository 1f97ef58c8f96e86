//! The bytes of a render's state, and renders resumed from them.

use crate::common::{
    Field, Independent, Keeper, Traced, bits, cut, everything, frame, learner, mix, noise, on_threads, snapshot,
    three_rounds, uniform,
};
use crate::recorder::reds;
use dapple_adaptive::Adaptive;
use dapple_core::container::{Fault, append, begin, sections};
use dapple_core::render::{Control, Status};
use dapple_core::{Draws, Error, Estimate, Film, Frame, Integrator, Limits, Needs, Render, Sampler, Snapshot, Worker};
use proptest::prelude::*;
use std::time::{Duration, Instant};

/// The state within the second round of a render that learns, and at its end.
fn states() -> [Vec<u8>; 2] {
    let (limits, mut keeper) = (limits(), Keeper::default());
    let render = Render::new(frame(7, 5), &limits).needs(everything().with_splats());
    render.monitor(&mut keeper).run(&mut learner(), &mut sampler()).unwrap();
    [keeper.slices[1].clone(), keeper.end]
}

fn limits() -> Limits {
    Limits::samples(200)
}

fn sampler() -> Adaptive<Independent> {
    Adaptive::variance(Independent::new(5))
}

/// Resumes a state if it can be read.
fn resume(bytes: &[u8]) -> Result<Film, Error> {
    let (snapshot, limits) = (Snapshot::from_bytes(bytes)?, limits());
    let render = Render::new(*snapshot.film().frame(), &limits).needs(everything().with_splats());
    render.resume(snapshot, &mut learner(), &mut sampler())
}

fn contained(parts: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = begin(0);
    parts.iter().for_each(|(name, section)| append(&mut bytes, name, section));
    bytes
}

fn parts(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    sections(bytes).unwrap().iter().map(|(name, part)| ((*name).to_owned(), part.to_vec())).collect()
}

/// The reason why bytes are no state.
fn fault(bytes: &[u8]) -> &'static str {
    match Snapshot::from_bytes(bytes) {
        Err(Error::BadSnapshot { what }) => what,
        other => panic!("{:?}", other.map(|_| ())),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn sections_are_found_in_order_whatever_they_hold(
        parts: Vec<(String, Vec<u8>)>,
        cut: prop::sample::Index,
        bit: prop::sample::Index,
    ) {
        let bytes = contained(&parts);
        let found = sections(&bytes).unwrap();
        prop_assert!(found.iter().map(|(name, part)| (*name, *part)).eq(parts.iter().map(|(n, p)| (n.as_str(), &p[..]))));
        // A shorter one has fewer sections, or is refused.
        let cut = cut.index(bytes.len());
        match sections(&bytes[..cut]) {
            Ok(fewer) => prop_assert!(fewer.len() < found.len() && found.starts_with(&fewer)),
            Err(fault) => prop_assert_eq!(fault, Fault::Short),
        }
        let mut damaged = bytes.clone();
        let bit = bit.index(8 * bytes.len());
        damaged[bit / 8] ^= 1 << (bit % 8);
        let expected: &[Fault] = match bit / 8 {
            0..8 => &[Fault::Foreign],
            8..12 => &[Fault::Version],
            _ => &[Fault::Short, Fault::Checksum],
        };
        prop_assert!(sections(&damaged).is_err_and(|fault| expected.contains(&fault)));
    }
}

#[test]
fn unknown_sections_are_kept_beside_a_state() {
    for state in states() {
        let known = parts(&state);
        let added = ("a scene of the host's".to_owned(), vec![7; 99]);
        for at in 0..=known.len() {
            let mut parts = known.clone();
            parts.insert(at, added.clone());
            let bytes = contained(&parts);
            assert_eq!(snapshot(&bytes), snapshot(&state));
            assert_eq!(sections(&bytes).unwrap()[at], (added.0.as_str(), &added.1[..]));
        }
        assert!(bits(&resume(&state).unwrap()) == bits(&resume(&contained(&known)).unwrap()));
    }
}

#[test]
fn a_state_cut_short_or_with_any_bit_changed_is_refused_x03() {
    for state in states() {
        for length in 0..state.len() {
            let fault = fault(&state[..length]);
            assert!(fault == Fault::Short.text() || fault == "the state of a render is missing", "{length}: {fault}");
        }
        assert_eq!(fault(&[&state[..], &[0]].concat()), Fault::Short.text());
        assert!(fault(&[&state[..8], &[0; 4], &state[12..]].concat()).contains("another version"));
        for k in 0..state.len() {
            let mut bytes = state.clone();
            bytes[k] ^= 1 << (k % 8);
            let expected: &[Fault] = match k {
                0..8 => &[Fault::Foreign],
                8..12 => &[Fault::Version],
                _ => &[Fault::Short, Fault::Checksum],
            };
            let fault = fault(&bytes);
            assert!(expected.iter().any(|one| one.text() == fault), "byte {k}: {fault}");
        }
    }
}

/// An error, or a render that ends.
#[test]
fn damage_with_right_checksums_does_no_harm_x03() {
    for state in states() {
        let (parts, mut refused) = (parts(&state), 0);
        for k in 0..3000_u64 {
            let mut parts = parts.clone();
            let part = &mut parts[mix(k) as usize % 2].1;
            let bit = mix(k + 7777) as usize % (8 * part.len());
            match k % 4 {
                0 => part.truncate(bit / 8),
                _ => part[bit / 8] ^= 1 << (bit % 8),
            }
            refused += usize::from(resume(&contained(&parts)).is_err());
        }
        assert!((1000..3000).contains(&refused), "{refused}");
    }
}

/// Bytes that promise more first hits, recorders or pixels than they hold. Without a check, memory of up to 17 GB is made.
#[test]
fn no_memory_is_made_for_statistics_that_are_not_there() {
    let film = |needs, recorders| {
        let mut keeper = Keeper::default();
        let limits = Limits::spp(1.0);
        let render = Render::new(frame(256, 256), &limits).needs(needs).recorders(recorders).monitor(&mut keeper);
        render.run(&mut Field(|_, _| [0.0; 3]), &mut uniform(1)).unwrap();
        parts(&keeper.end)
    };
    let (none, plain) = (Needs::none(), film(Needs::none(), vec![]));
    assert!(Snapshot::from_bytes(&contained(&plain)).is_ok());
    // The first byte in which films differ is the number.
    let place = |needs, recorders| {
        let with = film(needs, recorders);
        (0..).find(|&at| plain[1].1[at] != with[1].1[at]).unwrap()
    };
    // The number of pixels, and a sample in each.
    let counts = plain[1].1.windows(7).position(|bytes| bytes == [0x80, 0x80, 4, 1, 1, 1, 1]).unwrap();
    let (names, pixels) = ([&[0x80, 0x20][..], &[0; 4096]].concat(), [&[0xff; 9][..], &[1]].concat());
    for (at, length, lie, reason) in [
        (place(none.with_first_hits(1), vec![]), 1, vec![0xff], "has the wrong number of pixels"),
        (place(none, vec![reds(3)]), 1, names, "has the wrong number of pixels"),
        (counts, 3, pixels, "the data are truncated"),
    ] {
        let mut parts = plain.clone();
        parts[1].1.splice(at..at + length, lie);
        let fault = fault(&contained(&parts));
        assert!(fault.contains(reason), "{fault}");
    }
}

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
            film.half_indirect(1, i),
            film.features(i),
            (film.surface(i), film.first_hits(i))
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
        all.schedule.progress_spp = 5;
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
        message.contains("the sampler was uniform, not variance:") && message.contains("lacks the sample variance"),
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
        if start.elapsed().as_secs_f64() > 0.5 { Control::Stop } else { Control::Continue }
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
