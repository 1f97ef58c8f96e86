//! Samples kept one by one: the samples of the point set, in order, in either half, and never for nothing.

use crate::common::{Field, Independent, Planned, everything, frame, mix, noise, on_threads, run};
use dapple_conformance::bits;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Error, Estimate, Feedback, Film, Integrator, Limits, Methods, Needs, Plan, PointSet, Progress,
    Render, Retention, SampleId, Schedule, Session, Shard, ShardFilm, Sharded, Snapshot, Trajectory, Worker, merge,
    streams,
};

const ALL: u32 = u32::MAX;

/// The mean of samples, summed as a film sums.
fn mean(samples: &[[f32; 3]]) -> [f64; 3] {
    let mut mean = [0.0; 3];
    for (n, sample) in samples.iter().enumerate() {
        let share = 1.0 / (n + 1) as f64;
        (0..3).for_each(|c| mean[c] += (f64::from(sample[c]) - mean[c]) * share);
    }
    mean
}

/// Noise in which one sample in eight is invalid.
fn faulty(pixel: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    if u[3] < 0.125 { [f32::NAN, 1.0, 1.0] } else { noise(pixel, u) }
}

/// Two rounds with uneven counts.
fn uneven(needs: Needs) -> Planned<impl FnMut(&Feedback<'_>, &mut Plan) -> Progress> {
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        let count = |(i, n): (usize, &mut u32)| *n = (mix(i as u64 ^ u64::from(seen.round) << 20) % 7) as u32;
        plan.counts.iter_mut().enumerate().for_each(count);
        if seen.round < 2 { Progress::Trace } else { Progress::Done }
    };
    Planned { points: Independent::new(3), needs, plan }
}

fn rows(film: &Film) -> Vec<Vec<[u32; 3]>> {
    let of = |i| (0..2).map(move |half| film.samples(half, i).iter().map(|x| x.map(f32::to_bits)).collect());
    (0..film.frame().pixels()).flat_map(of).collect()
}

#[test]
fn the_mean_of_a_pixels_samples_is_the_films_to_the_bit() {
    let limits = Limits::samples(10_000);
    let needs = Needs::none().with_samples(ALL);
    let film = run(&mut Field(faulty), &mut uneven(needs), needs, frame(17, 9), &limits).unwrap();
    assert!(film.record().rejected > 50, "{} rejected samples", film.record().rejected);
    for i in 0..film.frame().pixels() {
        assert_eq!(film.samples(0, i).len() as u64, film.count(i));
        assert_eq!(mean(film.samples(0, i)), film.mean(i), "pixel {i}");
    }
    let halves = needs.with_halves();
    let film = run(&mut Field(faulty), &mut uneven(halves), halves, frame(17, 9), &limits).unwrap();
    for (i, half) in (0..film.frame().pixels()).flat_map(|i| [(i, 0), (i, 1)]) {
        let moments = film.half(half, i).unwrap();
        assert_eq!((film.samples(half, i).len() as u64, mean(film.samples(half, i))), (moments.count, moments.mean));
    }
}

#[test]
fn a_samples_identity_returns_its_coordinates_in_either_half() {
    for halves in [false, true] {
        let needs = Needs::none().with_samples(4);
        let needs = if halves { needs.with_halves() } else { needs };
        let film = run(&mut Field(noise), &mut uneven(needs), needs, frame(8, 5), &Limits::samples(9999)).unwrap();
        let replayed = |film: &Film, i: usize, half: usize| {
            for (number, sample) in film.samples(half, i).iter().enumerate() {
                let id = film.sample_id(half, i, number);
                assert_eq!(noise(id.pixel, Independent::new(3).block(id, 0)), *sample, "{id:?}");
            }
        };
        for (i, half) in (0..film.frame().pixels()).flat_map(|i| [(i, 0), (i, 1)]) {
            let count = film.half(half, i).map_or(film.count(i), |m| m.count);
            assert_eq!(film.samples(half, i).len() as u64, count.min(4));
            replayed(&film, i, half);
            if halves {
                replayed(&film.half_film(half).unwrap(), i, 0);
            }
        }
    }
}

#[test]
fn withdrawn_samples_move_behind_the_discarded_ones() {
    let points = Independent::new(5);
    // Discards 2, keeps 4, then withdraws these of pixel 1 and keeps 6.
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.counts.fill([2, 4, 6, 0][seen.round.min(3) as usize]);
        plan.retention = if seen.round == 0 { Retention::Discard } else { Retention::Keep };
        plan.withdraw = (seen.round == 2).then(|| vec![false, true]);
        if seen.round < 3 { Progress::Trace } else { Progress::Done }
    };
    let of = |x: u32, stream, indices: std::ops::Range<u64>| -> Vec<[f32; 3]> {
        indices.map(|index| noise([x, 0], points.block(SampleId::new([x, 0], stream, index), 0))).collect()
    };
    for limit in [ALL, 5, 1] {
        let first = |samples: Vec<[f32; 3]>| -> Vec<_> { samples.into_iter().take(limit as usize).collect() };
        let needs = Needs::none().with_samples(limit);
        let mut sampler = Planned { points, needs, plan };
        let film = run(&mut Field(noise), &mut sampler, needs, frame(2, 1), &Limits::samples(100)).unwrap();
        assert_eq!(film.samples(0, 0), first(of(0, streams::WHOLE, 0..10)));
        assert_eq!(film.discarded_samples(0, 0), first(of(0, streams::DISCARDED, 0..2)));
        assert_eq!(film.samples(0, 1), first(of(1, streams::WHOLE, 4..10)));
        assert_eq!(film.sample_id(0, 1, 1), SampleId::new([1, 0], streams::WHOLE, 5));
        let thrown = [of(1, streams::DISCARDED, 0..2), of(1, streams::WHOLE, 0..4)].concat();
        assert_eq!(film.discarded_samples(0, 1), first(thrown));
    }
}

#[test]
fn samples_change_no_other_bit_and_depend_on_no_threads_tiles_or_cuts() {
    let (frame, mut plain) = (frame(19, 17), everything());
    (plain.samples, plain.trajectories) = (0, false);
    let render = |needs: Needs, threads: usize, schedule: Schedule| {
        let limits = Limits::samples(9 * 19 * 17 + 5).with_schedule(schedule);
        let mut sampler = Uniform::new(Independent::new(4));
        on_threads(threads, || run(&mut Field(noise), &mut sampler, needs, frame, &limits)).unwrap()
    };
    for needs in [plain, Needs::none()] {
        let whole = render(needs.with_samples(3), 1, Schedule::default());
        let without = render(needs, 1, Schedule::default());
        assert!((0..frame.pixels()).all(|i| without.samples(0, i).is_empty()));
        assert!(whole.image() == without.image() && whole.counts() == without.counts());
        for i in 0..frame.pixels() {
            assert_eq!(format!("{:?}", whole.moments(i)), format!("{:?}", without.moments(i)));
            assert_eq!(whole.features(i), without.features(i));
        }
        for (threads, rows, slice, shuffle) in [(2, 1, 0, 0), (3, 7, 1, 5), (7, 16, 2, 9)] {
            let schedule = Schedule::default().with_tile_rows(rows).with_slice_spp(slice).with_shuffle(shuffle);
            let film = render(needs.with_samples(3), threads, schedule);
            assert!(bits(&film) == bits(&whole) && self::rows(&film) == self::rows(&whole));
        }
    }
}

#[test]
fn a_resumed_session_ends_with_the_samples_of_a_render() {
    let (frame, limits) = (frame(13, 11), Limits::spp(6.0));
    let uniform = || Uniform::new(Independent::new(8));
    for needs in [Needs::none().with_samples(ALL), Needs::none().with_halves().with_samples(2)] {
        let whole = run(&mut Field(noise), &mut uniform(), needs, frame, &limits).unwrap();
        let methods = || Methods::from(uniform()).with_needs(needs);
        let mut session = Session::new(frame, limits.clone(), methods()).unwrap().with_tile_side(5);
        let mut tiles = 0;
        while let Some(round) = session.next_round().unwrap() {
            for _ in 0..2 {
                let Some(mut tile) = round.next_tile() else { break };
                let samples: Vec<_> = tile.samples().collect();
                for sample in samples.iter().rev() {
                    tile.add(sample, noise(sample.pixel(), sample.block(dapple_core::Block::new(0))));
                }
                round.submit(tile).unwrap();
                tiles += 1;
            }
            let snapshot = Snapshot::from_bytes(&session.snapshot()).unwrap();
            session = Session::resume(frame, limits.clone(), methods(), snapshot).unwrap().with_tile_side(5);
        }
        assert!(tiles > 8 && self::rows(&session.into_film()) == self::rows(&whole));
    }
}

#[test]
fn merged_shards_have_the_samples_of_the_whole_image() {
    let (frame, limits) = (frame(7, 5), Limits::spp(4.0));
    let needs = Needs::none().with_halves().with_samples(ALL);
    let uniform = || Uniform::new(Independent::new(2));
    let part = |index| {
        let (shard, mut inner) = (Shard::new(index, 3).unwrap(), uniform());
        let mut sharded = Sharded::new(&mut inner, shard, &limits).unwrap();
        let film = run(&mut Field(noise), &mut sharded, needs, frame, &limits).unwrap();
        ShardFilm::from_bytes(&ShardFilm::new(shard, &film).unwrap().to_bytes()).unwrap()
    };
    let merged = merge(&[part(2), part(0), part(1)]).unwrap();
    let whole = run(&mut Field(noise), &mut uniform(), needs, frame, &limits).unwrap();
    assert!(self::rows(&merged) == self::rows(&whole) && merged.samples(1, 3).len() == 2);
}

#[test]
fn snapshots_grow_by_the_samples_alone_and_only_if_asked() {
    let (frame, limits) = (frame(6, 4), Limits::spp(5.0));
    let size = |needs: Needs| {
        let mut bytes = 0;
        let mut note = |status: &dapple_core::Status<'_>| {
            bytes = status.snapshot().len();
            dapple_core::Control::Continue
        };
        let mut sampler = Uniform::new(Independent::new(1));
        Render::new(frame, &limits).needs(needs).monitor(&mut note).run(&mut Field(noise), &mut sampler).unwrap();
        bytes
    };
    let plain = size(Needs::none());
    assert_eq!(size(Needs::none().with_samples(0)), plain);
    assert_eq!(size(Needs::none().with_samples(3)), plain + 4 + 3 * 12 * 24);
    assert_eq!(size(Needs::none().with_samples(ALL)), plain + 4 + 5 * 12 * 24);
}

#[test]
fn damaged_snapshots_with_samples_are_refused_without_a_panic() {
    let needs = Needs::none().with_samples(ALL);
    let mut bytes = Vec::new();
    let mut note = |status: &dapple_core::Status<'_>| {
        bytes = status.snapshot();
        dapple_core::Control::Continue
    };
    let mut sampler = Uniform::new(Independent::new(1));
    let limits = Limits::spp(3.0);
    Render::new(frame(4, 3), &limits).needs(needs).monitor(&mut note).run(&mut Field(noise), &mut sampler).unwrap();
    assert!(Snapshot::from_bytes(&bytes).is_ok());
    let mut refused = 0;
    for at in 0..bytes.len() {
        assert!(Snapshot::from_bytes(&bytes[..at]).is_err());
        let mut damaged = bytes.clone();
        damaged[at] = 0xff;
        refused += usize::from(Snapshot::from_bytes(&damaged).is_err());
    }
    assert!(refused > 200, "{refused} of {}", bytes.len());
}

#[test]
fn films_with_fewer_samples_are_refused_by_readers_that_need_more() {
    let film = Film::new(frame(1, 1), Needs::none().with_samples(3));
    assert!(film.require("reader", &Needs::none().with_samples(3)).is_ok());
    let refused = film.require("reader", &Needs::none().with_samples(4));
    assert!(matches!(&refused, Err(Error::NotRecorded { .. })), "{refused:?}");
    assert!(refused.unwrap_err().to_string().starts_with("reader reads samples one by one"));
}

#[test]
fn a_film_of_channels_has_no_samples_of_the_radiance() {
    let needs = Needs::none().with_channels(3).with_samples(ALL);
    let mut sampler = Uniform::new(Independent::new(1));
    let film = run(&mut Field(noise), &mut sampler, needs, frame(2, 2), &Limits::spp(3.0)).unwrap();
    assert_eq!(film.samples(0, 1).len(), 3);
    let bands = film.with_channels_as_colour([2, 1, 0]).unwrap();
    assert!(bands.needs().samples == 0 && bands.samples(0, 1).is_empty());
}

/// Noise with a trajectory, which is NaN in one sample of eight.
struct Moving;

fn trajectory(u: [f32; 4]) -> Trajectory {
    Trajectory::new(if u[3] < 0.125 { f32::NAN } else { u[0] }, [u[1], -u[2], u[3]])
}

impl Integrator for Moving {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let u = draws.block(Block::new(0));
        assert!(draws.wants_first_hit() || !draws.wants_trajectory());
        Estimate::new(faulty(draws.pixel(), u)).with_trajectory(draws.wants_trajectory().then(|| trajectory(u)))
    }
}

fn paths(film: &Film) -> Vec<Vec<Trajectory>> {
    let of = |i| (0..2).map(move |half| film.trajectories(half, i).to_vec());
    (0..film.frame().pixels()).flat_map(of).collect()
}

#[test]
fn trajectories_are_those_of_the_samples_in_either_half() {
    for (halves, limit) in [(false, ALL), (true, ALL), (true, 3)] {
        let needs = Needs::none().with_samples(limit).with_trajectories();
        let needs = if halves { needs.with_halves() } else { needs };
        let film = run(&mut Moving, &mut uneven(needs), needs, frame(8, 5), &Limits::samples(9999)).unwrap();
        for (i, half) in (0..film.frame().pixels()).flat_map(|i| [(i, 0), (i, 1)]) {
            assert_eq!(film.trajectories(half, i).len(), film.samples(half, i).len());
            for (number, found) in film.trajectories(half, i).iter().enumerate() {
                let id = film.sample_id(half, i, number);
                let expected = trajectory(Independent::new(3).block(id, 0));
                // Those that are not finite are left out.
                let expected = if expected.inverse_depth.is_nan() { Trajectory::default() } else { expected };
                assert_eq!(*found, expected, "{id:?}");
            }
        }
    }
}

#[test]
fn trajectories_change_no_other_bit_and_depend_on_no_threads_tiles_or_cuts() {
    let (frame, mut plain) = (frame(19, 17), everything());
    plain.trajectories = false;
    let render = |needs: Needs, threads: usize, schedule: Schedule| {
        let limits = Limits::samples(9 * 19 * 17 + 5).with_schedule(schedule);
        let mut sampler = Uniform::new(Independent::new(4));
        on_threads(threads, || run(&mut Moving, &mut sampler, needs, frame, &limits)).unwrap()
    };
    for needs in [plain, Needs::none().with_samples(3)] {
        let whole = render(needs.with_trajectories(), 1, Schedule::default());
        let without = render(needs, 1, Schedule::default());
        assert!(paths(&without).iter().all(Vec::is_empty) && paths(&whole).iter().any(|row| row.len() > 2));
        assert!(bits(&whole) == bits(&without) && rows(&whole) == rows(&without));
        for (threads, band, slice, shuffle) in [(2, 1, 0, 0), (3, 7, 1, 5), (7, 16, 2, 9)] {
            let schedule = Schedule::default().with_tile_rows(band).with_slice_spp(slice).with_shuffle(shuffle);
            let film = render(needs.with_trajectories(), threads, schedule);
            assert!(bits(&film) == bits(&whole) && paths(&film) == paths(&whole));
        }
    }
    // Without samples stored one by one there are no trajectories.
    let none = render(Needs::none().with_trajectories(), 1, Schedule::default());
    assert!(paths(&none).iter().all(Vec::is_empty));
}

#[test]
fn trajectories_survive_sessions_snapshots_and_shards() {
    let (frame, limits) = (frame(7, 5), Limits::spp(6.0));
    let needs = Needs::none().with_halves().with_samples(2).with_trajectories();
    let uniform = || Uniform::new(Independent::new(8));
    let whole = run(&mut Moving, &mut uniform(), needs, frame, &limits).unwrap();
    let methods = || Methods::from(uniform()).with_needs(needs);
    let mut session = Session::new(frame, limits.clone(), methods()).unwrap().with_tile_side(3);
    while let Some(round) = session.next_round().unwrap() {
        let Some(mut tile) = round.next_tile() else { break };
        let samples: Vec<_> = tile.samples().collect();
        samples.iter().rev().for_each(|sample| tile.add(sample, Moving.estimate(sample, &mut Worker::default())));
        round.submit(tile).unwrap();
        let snapshot = Snapshot::from_bytes(&session.snapshot()).unwrap();
        session = Session::resume(frame, limits.clone(), methods(), snapshot).unwrap().with_tile_side(3);
    }
    assert!(paths(&session.into_film()) == paths(&whole));
    let part = |index| {
        let (shard, mut inner) = (Shard::new(index, 3).unwrap(), uniform());
        let mut sharded = Sharded::new(&mut inner, shard, &limits).unwrap();
        let film = run(&mut Moving, &mut sharded, needs, frame, &limits).unwrap();
        ShardFilm::from_bytes(&ShardFilm::new(shard, &film).unwrap().to_bytes()).unwrap()
    };
    assert!(paths(&merge(&[part(2), part(0), part(1)]).unwrap()) == paths(&whole));
}

#[test]
fn withdrawn_samples_take_their_trajectories_along() {
    // Keeps 2, then withdraws these of pixel 1 and keeps 3.
    let plan = |seen: &Feedback<'_>, plan: &mut Plan| {
        plan.counts.fill([2, 3, 0][seen.round.min(2) as usize]);
        plan.withdraw = (seen.round == 1).then(|| vec![false, true]);
        if seen.round < 2 { Progress::Trace } else { Progress::Done }
    };
    let needs = Needs::none().with_samples(ALL).with_trajectories();
    let mut sampler = Planned { points: Independent::new(5), needs, plan };
    let film = run(&mut Moving, &mut sampler, needs, frame(2, 1), &Limits::samples(100)).unwrap();
    assert_eq!([film.trajectories(0, 0).len(), film.trajectories(0, 1).len()], [5, 3]);
    let first = Independent::new(5).block(film.sample_id(0, 1, 0), 0);
    assert_eq!(film.trajectories(0, 1)[0].motion[0], if first[3] < 0.125 { 0.0 } else { first[1] });
}

#[test]
fn snapshots_with_trajectories_grow_by_16_bytes_for_each_sample() {
    let size = |needs: Needs| {
        let mut bytes = 0;
        let mut note = |status: &dapple_core::Status<'_>| {
            bytes = status.snapshot().len();
            dapple_core::Control::Continue
        };
        let (mut sampler, limits) = (Uniform::new(Independent::new(1)), Limits::spp(5.0));
        Render::new(frame(6, 4), &limits).needs(needs).monitor(&mut note).run(&mut Moving, &mut sampler).unwrap();
        bytes
    };
    let needs = Needs::none().with_samples(3);
    assert_eq!(size(needs.with_trajectories()), size(needs) + 3 * 16 * 24);
    assert_eq!(size(Needs::none().with_trajectories()), size(Needs::none()));
}

#[test]
fn readers_of_trajectories_refuse_films_without_them() {
    let reads = Needs::none().with_samples(1).with_trajectories();
    let bare = Film::new(frame(1, 1), Needs::none().with_samples(1));
    assert!(matches!(bare.require("reader", &reads), Err(Error::NotRecorded { .. })));
    let mut film = Film::new(frame(1, 1), reads);
    assert!(film.require("reader", &reads).is_ok());
    film.push(0, 0, [1.0; 3]);
    assert!(matches!(film.require("reader", &reads), Err(Error::NoneReported { .. })));
    film.push_estimate(0, 0, &Estimate::new([1.0; 3]).with_trajectory(Trajectory::default()));
    assert!(film.require("reader", &reads).is_ok());
}
