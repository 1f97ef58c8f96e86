//! Sessions: renders whose loop belongs to the caller.

use crate::common::*;
use dapple_adaptive::Adaptive;
use dapple_core::limits::Schedule;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::render::{Control, Status};
use dapple_core::{
    Block, Draws, Error, Estimate, Film, Filter as _, FirstHit, Integrator, InvalidSample, Limits, Methods, Needs,
    Render, Round, Sampler, Session, Snapshot, Tile, Unfiltered, Worker,
};

/// Radiance, hits, emission, costs and now and then a bad sample, from the random numbers alone.
fn trace(draws: &Draws<'_>) -> Estimate {
    let u = draws.block(Block::new(0));
    let value = if u[3] < 0.01 { f32::NAN } else { u[1] };
    let hit =
        (u[2] > 0.2).then(|| FirstHit::new([u[0], u[1], u[2]], [0.0, 0.0, 1.0], u[0]).with_albedo([0.5, u[1], 0.25]));
    let cost = 2 + draws.pixel()[0] % 3;
    Estimate::new([value, u[2], 0.5]).with_first_hit(hit).with_emission([0.0, 0.1, 0.2]).with_cost(cost)
}

fn traced() -> impl Integrator {
    Traced(|draws: &Draws<'_>, _: &mut Worker| trace(draws))
}

/// Rounds of every kind, alternating between halves and with counts per half: with discarded samples before, or after
/// withdrawals.
fn every_kind(withdraws: bool) -> impl Sampler {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        let pixels = seen.pixels();
        let some = |salt: u64| (0..pixels as u64).map(move |i| (mix(i ^ salt << 32) % 5) as u32);
        plan.counts = some(u64::from(seen.round)).map(|n| n + 1).collect();
        match seen.round {
            0 if !withdraws => plan.retention = Retention::Discard,
            4 if withdraws => plan.retention = Retention::Discard,
            0 | 1 | 4 | 5 => {}
            2 => plan.second_half = Some(some(9).collect()),
            3 => plan.withdraw = withdraws.then(|| some(11).map(|n| n == 0).collect()),
            _ => return Progress::Done,
        }
        Progress::Trace
    };
    ToySampler { points: Independent::new(7), needs: everything(), plan }
}

const LIMIT: u64 = 100_000;

fn rendered(sampler: &mut dyn Sampler) -> Film {
    Render::new(frame(45, 38), &Limits::samples(LIMIT)).run(&mut traced(), sampler).unwrap()
}

/// Renders by a session whose tiles are traced by `work`, which gets the round.
fn pulled(sampler: impl Sampler, work: impl Fn(&Round<'_>)) -> Film {
    let mut session = Session::new(frame(45, 38), Limits::samples(LIMIT), sampler).unwrap().with_tile_side(11);
    while let Some(round) = session.next_round().unwrap() {
        work(&round);
    }
    session.into_film()
}

fn in_order(round: &Round<'_>) {
    while let Some(mut tile) = round.next_tile() {
        for sample in tile.samples() {
            tile.add(&sample, trace(&sample));
        }
        round.submit(tile).unwrap();
    }
}

/// A wave over the whole image, in an order that mixes pixels and turns.
fn wave(round: &Round<'_>) {
    let mut tile = round.whole();
    let mut samples: Vec<_> = tile.samples().collect();
    samples.sort_by_key(|s| {
        mix(u64::from(s.pixel()[0] + 50 * s.pixel()[1]) ^ s.id().index << 20 ^ u64::from(s.id().stream) << 50)
    });
    for batch in samples.chunks(777) {
        let results: Vec<Estimate> = batch.iter().map(trace).collect();
        tile.add_all(batch, results);
    }
    round.submit(tile).unwrap();
}

/// Tiles of the host's own, backwards, on three threads.
fn backwards(round: &Round<'_>) {
    let areas: Vec<_> = (0..38).step_by(5).map(|y| [0, y, 45, (y + 5).min(38)]).collect();
    std::thread::scope(|threads| {
        for part in 0..3 {
            let mine = areas.iter().rev().skip(part).step_by(3);
            threads.spawn(move || {
                for &area in mine {
                    round.trace_tile(area, trace).unwrap();
                }
            });
        }
    });
}

#[test]
fn a_session_gives_the_bits_of_a_render_in_any_order() {
    for withdraws in [false, true] {
        let whole = bits(&rendered(&mut every_kind(withdraws)));
        for (name, work) in [("in order", in_order as fn(&Round<'_>)), ("wave", wave), ("backwards", backwards)] {
            assert!(bits(&pulled(every_kind(withdraws), work)) == whole, "{name}");
        }
        let traced = |round: &Round<'_>| round.trace(trace).unwrap();
        assert!(bits(&pulled(every_kind(withdraws), traced)) == whole);
        let batches =
            |round: &Round<'_>| round.trace_batches(777, |batch| batch.iter().map(trace).collect::<Vec<_>>()).unwrap();
        assert!(bits(&pulled(every_kind(withdraws), batches)) == whole);
        // Another cost of each sample is seen.
        let other =
            |round: &Round<'_>| round.trace(|s| trace(&Draws::new(round.points(), s.id())).with_cost(9)).unwrap();
        assert!(bits(&pulled(every_kind(withdraws), other)) != whole);
    }
}

#[test]
fn a_run_gives_the_image_of_its_rounds() {
    let session = || Session::new(frame(9, 7), Limits::spp(4.0), uniform(1)).unwrap();
    let mut whole = session();
    while let Some(round) = whole.next_round().unwrap() {
        round.trace(trace).unwrap();
    }
    assert_eq!(session().run(|round| round.trace(trace)).unwrap(), whole.finish().unwrap());
    assert!(matches!(session().run(|_| Ok(())), Err(Error::NothingSubmitted { .. })));
}

#[test]
fn adaptive_counts_are_those_of_a_render() {
    let sampler = || Adaptive::variance(Independent::new(3));
    let limits = Limits::spp(12.5);
    let film = Render::new(frame(40, 40), &limits).run(&mut traced(), &mut sampler()).unwrap();
    let mut session = Session::new(frame(40, 40), limits, sampler()).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        in_order(&round);
    }
    let pulled = session.into_film();
    assert_eq!((film.record().samples, pulled.record().samples), (20_000, 20_000));
    assert!(bits(&film) == bits(&pulled) && !pulled.record().interrupted);
    assert_eq!((film.record().rays, film.record().blocks), (pulled.record().rays, pulled.record().blocks));
}

/// Kills the session after `tiles` tiles, and continues from the last snapshot.
fn killed_after(tiles: usize, withdraws: bool) -> Film {
    let mut session = Session::new(frame(45, 38), Limits::samples(LIMIT), every_kind(withdraws)).unwrap();
    let mut done = 0;
    let bytes = 'killed: {
        while let Some(round) = session.next_round().unwrap() {
            while let Some(mut tile) = round.next_tile() {
                if done == tiles {
                    break 'killed round.snapshot();
                }
                tile.samples().for_each(|s| tile.add(&s, trace(&s)));
                round.submit(tile).unwrap();
                done += 1;
            }
        }
        session.snapshot()
    };
    let (snapshot, limits) = (snapshot(&bytes), Limits::samples(LIMIT));
    let mut session = Session::resume(frame(45, 38), limits, every_kind(withdraws), snapshot).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        wave(&round);
    }
    session.into_film()
}

#[test]
fn a_killed_session_continues_with_the_same_bits_x05() {
    for withdraws in [false, true] {
        let whole = bits(&rendered(&mut every_kind(withdraws)));
        for tiles in [0, 1, 3, 5, 11, 99] {
            assert!(bits(&killed_after(tiles, withdraws)) == whole, "after {tiles} tiles");
        }
    }
}

#[test]
fn sessions_and_renders_continue_each_other() {
    for withdraws in [false, true] {
        let make = || every_kind(withdraws);
        let whole = bits(&rendered(&mut make()));
        // A render that stops in the middle of a round.
        let mut saved = Vec::new();
        let mut stop = |status: &Status<'_>| {
            saved = status.snapshot();
            if status.round == 3 { Control::Stop } else { Control::Continue }
        };
        let limits = Limits::samples(LIMIT).with_schedule(Schedule::default().with_progress_spp(1));
        Render::new(frame(45, 38), &limits).monitor(&mut stop).run(&mut traced(), &mut make()).unwrap();
        let mut session = Session::resume(frame(45, 38), limits.clone(), make(), snapshot(&saved)).unwrap();
        let round = session.next_round().unwrap().unwrap();
        let mut tile = round.next_tile().unwrap();
        tile.samples().for_each(|s| tile.add(&s, trace(&s)));
        round.submit(tile).unwrap();
        let bytes = round.snapshot();
        drop(round);
        // The render takes over again.
        let film = Render::new(frame(45, 38), &limits).resume(snapshot(&bytes), &mut traced(), &mut make()).unwrap();
        assert!(bits(&film) == whole);
    }
}

#[test]
fn wrong_uses_of_tiles_are_refused_and_named() {
    let mut session = Session::new(frame(8, 8), Limits::spp(2.0), uniform(1)).unwrap().with_tile_side(4);
    let round = session.next_round().unwrap().unwrap();
    let message = |spoil: &dyn Fn(&mut Tile<'_>)| {
        let mut tile = round.tile([0, 0, 4, 4]).unwrap();
        tile.samples().for_each(|s| tile.add(&s, [1.0; 3]));
        spoil(&mut tile);
        round.submit(tile).unwrap_err().to_string()
    };
    fn first<'r>(tile: &Tile<'r>) -> Draws<'r> {
        tile.samples().next().unwrap()
    }
    assert!(message(&|tile| tile.add(&first(tile), [1.0; 3])).contains("pixel (0, 0) was added twice"));
    assert!(message(&|tile| tile.push([3, 2], [1.0; 3])).contains("pixel (3, 2) got more than the 1 requested"));
    assert!(message(&|tile| tile.push([4, 0], [1.0; 3])).contains("pixel (4, 0) got more than the 0 requested"));
    let other = round.tile([4, 4, 8, 8]).unwrap();
    assert!(message(&|tile| tile.add(&first(&other), [1.0; 3])).contains("belongs to another tile"));
    let few = |tile: &mut Tile<'_>| tile.add_all(&[first(tile)], Vec::<[f32; 3]>::new());
    assert!(message(&few).contains("1 samples have 0 results"));
    let endless = |tile: &mut Tile<'_>| tile.add_all(&[], std::iter::repeat([1.0; 3]));
    assert!(message(&endless).contains("0 samples have 1 results or more"));

    let unfinished = round.tile([0, 0, 4, 4]).unwrap();
    assert!(round.submit(unfinished).unwrap_err().to_string().contains("results of 16 of its samples are missing"));
    let [mut once, mut again] = [0, 1].map(|_| round.tile([0, 0, 4, 4]).unwrap());
    for tile in [&mut once, &mut again] {
        tile.samples().for_each(|s| tile.add(&s, [1.0; 3]));
    }
    round.submit(once).unwrap();
    assert!(round.submit(again).unwrap_err().to_string().contains("submitted already"));
    for area in [[0, 0, 9, 4], [4, 4, 4, 8], [6, 0, 2, 4]] {
        assert!(matches!(round.tile(area), Err(Error::BadTile { .. })), "{area:?}");
    }
    assert_eq!(round.left(), 48);
}

#[test]
fn a_round_of_which_nothing_comes_back_is_an_error() {
    let mut session = Session::new(frame(8, 8), Limits::spp(2.0), uniform(1)).unwrap();
    drop(session.next_round().unwrap());
    assert!(matches!(session.next_round(), Err(Error::NothingSubmitted { left: 64 })));
    // A part came back: the same round goes on with the rest.
    let mut session = Session::new(frame(8, 8), Limits::spp(2.0), uniform(1)).unwrap().with_tile_side(4);
    let part = |round: &Round<'_>| {
        let mut tile = round.next_tile().unwrap();
        tile.samples().for_each(|s| tile.add(&s, [1.0; 3]));
        round.submit(tile).unwrap();
    };
    for left in [64, 48, 32, 16, 64, 48, 32, 16] {
        let round = session.next_round().unwrap().unwrap();
        assert_eq!(round.left(), left);
        part(&round);
    }
    assert!(session.next_round().unwrap().is_none());
    assert_eq!(session.film().record().rounds.len(), 1);
}

#[test]
fn a_session_that_ends_early_keeps_its_samples() {
    let mut session = Session::new(frame(8, 8), Limits::spp(4.0), uniform(1)).unwrap().with_tile_side(4);
    let round = session.next_round().unwrap().unwrap();
    let mut tile = round.next_tile().unwrap();
    tile.samples().for_each(|s| tile.add(&s, [1.0, 2.0, 3.0]));
    round.submit(tile).unwrap();
    drop(round);
    // Pixels that were not reached show the nearest one.
    assert_eq!(session.image().unwrap().radiance, [[1.0, 2.0, 3.0]; 64]);
    let film = session.into_film();
    assert!(film.record().interrupted);
    assert_eq!((film.record().samples, film.count(0), film.count(5)), (16, 1, 0));
}

#[test]
fn renderers_with_numbers_of_their_own_push_as_many_as_asked() {
    let mut session = Session::new(frame(9, 7), Limits::spp(3.0), uniform(1)).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        while let Some(mut tile) = round.next_tile() {
            for (pixel, numbers) in tile.pixels() {
                numbers.for_each(|n| tile.push(pixel, [n as f32; 3]));
            }
            round.submit(tile).unwrap();
        }
    }
    assert!(session.finish().unwrap().radiance.iter().all(|&rgb| rgb == [1.0; 3]));
}

#[test]
fn invalid_samples_are_listed_alike_or_fail() {
    let pairs = [in_order as fn(&Round<'_>), wave, backwards].map(|work| pulled(every_kind(true), work));
    let film = rendered(&mut every_kind(true));
    for pulled in pairs {
        assert_eq!((pulled.rejected(), pulled.record().rejected), (film.rejected(), film.record().rejected));
    }
    assert!(film.record().rejected > 0);
    let limits = Limits::spp(1.0).with_invalid(InvalidSample::Fail);
    let mut session = Session::new(frame(4, 4), limits, uniform(1)).unwrap();
    let round = session.next_round().unwrap().unwrap();
    let failed = round.trace(|s| if s.pixel() == [2, 1] { [0.5, -3.0, 0.0] } else { [0.5; 3] });
    let Err(Error::InvalidSample { sample, value, .. }) = failed else { panic!() };
    assert_eq!((sample.pixel, value), ([2, 1], [0.5, -3.0, 0.0]));
}

#[test]
fn the_film_records_what_the_filter_needs() {
    let needs = Needs::none().with_variance().with_halves();
    let apply = move |film: &Film| {
        film.require("wants", &needs).unwrap();
        Unfiltered.apply(film).unwrap()
    };
    let wants = ToyFilter { name: "wants", needs, apply };
    let mut session = Session::new(frame(4, 4), Limits::spp(4.0), Methods::from((uniform(1), wants))).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        round.trace(|_| [0.5; 3]).unwrap();
    }
    assert!(session.film().half(1, 0).is_some() && session.film().needs().variance);
    assert_eq!(session.finish().unwrap().radiance, [[0.5; 3]; 16]);
}

/// Light from a lamp that paths throw at pixels.
fn thrown(draws: &Draws<'_>) -> ([u32; 2], [f32; 3]) {
    let u = draws.block(Block::new(1));
    // 50 columns and rows: some fall outside the window.
    (([0, 1].map(|k| (u[k] * 50.0) as u32)), [u[2], 2.0 * u[3], if u[0] < 0.01 { f32::NAN } else { 1.0 }])
}

/// Throws light.
fn splatting(draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
    let (pixel, radiance) = thrown(draws);
    worker.splat(pixel, radiance);
    trace(draws)
}

#[test]
fn splats_have_the_same_bits_in_any_order() {
    [false, true].into_iter().for_each(check_splats);
}

fn check_splats(withdraws: bool) {
    let needs = Needs::none().with_splats().with_variance();
    let size = frame(45, 38);
    let film = |threads| {
        let limits = Limits::samples(LIMIT);
        let render = || Render::new(size, &limits).needs(needs).run(&mut Traced(splatting), &mut every_kind(withdraws));
        on_threads(threads, render).unwrap()
    };
    let [one, three] = [1, 3].map(film);
    assert!(bits(&one) == bits(&three));
    let methods = Methods::from(every_kind(withdraws)).with_needs(needs);
    let mut session = Session::new(size, Limits::samples(LIMIT), methods).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        let mut tile = round.whole();
        let samples: Vec<_> = tile.samples().collect();
        for sample in samples.iter().rev() {
            let (pixel, radiance) = thrown(sample);
            let estimate = trace(sample);
            tile.splat(sample, pixel, radiance);
            tile.add(sample, estimate);
        }
        round.submit(tile).unwrap();
    }
    assert!(bits(&session.into_film()) == bits(&one));
}

#[test]
fn splats_add_their_mean_to_the_image() {
    // Each sample throws a light of 3 at pixel (1, 0), and sees 0.5 itself.
    let mut lamp = Traced(|_: &Draws<'_>, worker: &mut Worker| {
        worker.splat([1, 0], [3.0, 0.0, 0.25]);
        Estimate::new([0.5; 3])
    });
    // Other counts per pixel change nothing: 12 pixels get as many samples as 12 throw.
    for needs in [Needs::none().with_splats(), Needs::none().with_splats().with_halves()] {
        let mut sampler = one_round(Independent::new(1), Retention::Keep, (1..=12).collect());
        let film = Render::new(frame(4, 3), &Limits::samples(1000)).needs(needs).run(&mut lamp, &mut sampler).unwrap();
        let image = film.image();
        assert!((image[1][0] - (0.5 + 3.0 * 12.0)).abs() < 1e-4 && (image[1][2] - (0.5 + 0.25 * 12.0)).abs() < 1e-5);
        assert!(image.iter().enumerate().all(|(i, rgb)| i == 1 || *rgb == [0.5; 3]));
    }
    // In a window, the pixel shows the same.
    let window = frame(4, 3).crop(1, 0, 3, 2).unwrap();
    let limits = Limits::samples(40);
    let render = Render::new(window, &limits).needs(Needs::none().with_splats());
    let film = render.run(&mut lamp, &mut uniform(1)).unwrap();
    assert!((film.image()[0][0] - (0.5 + 3.0 * 12.0)).abs() < 1e-4);
}

#[test]
fn samples_that_say_nothing_of_hits_are_refused_by_name() {
    let needs = Needs::none().with_features();
    let guided = || ToyFilter { name: "guided", needs, apply: |film: &Film| Unfiltered.apply(film).unwrap() };
    let ends = |trace: &(dyn Fn(&Draws<'_>) -> Estimate + Sync)| -> Result<(), Error> {
        let mut session = Session::new(frame(4, 4), Limits::spp(4.0), (uniform(1), guided())).unwrap();
        while let Some(round) = session.next_round()? {
            round.trace(trace).unwrap();
        }
        Ok(())
    };
    let message = ends(&|_| [0.5; 3].into()).unwrap_err().to_string();
    assert!(message.starts_with("guided reads first-hit features, but all samples report radiance only"), "{message}");
    // All misses, said once.
    let sky = |s: &Draws<'_>| match s.pixel() {
        [1, 2] => Estimate::new([0.5; 3]).with_first_hit(None),
        _ => [0.5; 3].into(),
    };
    ends(&sky).unwrap();
}

fn methods() -> Methods<'static> {
    Methods::from(uniform(2)).with_needs(Needs::none().with_features())
}

/// Adds radiance alone to the next tile of a session, or to all.
fn push(session: &mut Session<'_>, all: bool) {
    while let Some(round) = session.next_round().unwrap() {
        while let Some(mut tile) = round.next_tile() {
            for (pixel, numbers) in tile.pixels() {
                numbers.for_each(|_| tile.push(pixel, [0.5; 3]));
            }
            round.submit(tile).unwrap();
            if !all {
                return;
            }
        }
    }
}

fn is_refused(film: &Film) -> bool {
    matches!(film.require("reader", &Needs::none().with_features()), Err(Error::NoneReported { .. }))
}

#[test]
fn a_resumed_session_of_radiance_alone_is_refused_by_readers_of_features() {
    let (frame, limits) = (frame(7, 5), Limits::spp(4.0));
    let mut session = Session::new(frame, limits.clone(), methods()).unwrap().with_tile_side(3);
    push(&mut session, false);
    let snapshot = Snapshot::from_bytes(&session.snapshot()).unwrap();
    assert!(is_refused(snapshot.film()), "the snapshot has lost the number");
    let mut session = Session::resume(frame, limits, methods(), snapshot).unwrap();
    push(&mut session, true);
    let film = session.into_film();
    assert_eq!(film.record().samples, 4 * 35);
    assert!(is_refused(&film));
}
