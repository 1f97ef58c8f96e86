//! Sessions for hosts with clocks, generators and viewers of their own.

use crate::common::*;
use dapple_core::point_set::mix;
use dapple_core::{
    Block, Clock, Draws, Error, Film, Filter, Filtered, FirstHit, Limits, Methods, Needs, PathRecord, Session,
    Snapshot, Unfiltered, parallel,
};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

const NOISE: Block = Block::new(0);

fn grey(sample: &Draws<'_>) -> [f32; 3] {
    [sample.block(NOISE)[0]; 3]
}

/// Traces a session whose samples take a millisecond each, and calls `see` with the samples before and in each round.
fn trace(mut session: Session<'_>, time: &AtomicU64, mut see: impl FnMut(u64, u64) -> ControlFlow<()>) -> Film {
    while let Some(round) = session.next_round().unwrap() {
        let left = round.left();
        round.trace(|sample| (time.fetch_add(1, Ordering::Relaxed), grey(sample)).1).unwrap();
        drop(round);
        if see(session.film().record().samples - left, left).is_break() {
            break;
        }
    }
    session.into_film()
}

/// A clock that shows so many milliseconds.
fn clock(time: &Arc<AtomicU64>) -> Clock {
    let time = time.clone();
    Clock::new(move || time.load(Ordering::Relaxed) as f64 * 1e-3)
}

/// A session, and the time that its clock shows.
fn session(limits: Limits) -> (Session<'static>, Arc<AtomicU64>) {
    let time = Arc::default();
    (Session::new(frame(8, 4), limits, uniform(1)).unwrap().with_clock(clock(&time)), time)
}

#[test]
fn rounds_double_whatever_the_limits() {
    for limits in [Limits::spp(100.0), Limits::seconds(2.0), Limits::error(1e-9, 3000), Limits::open().with_max_spp(90)]
    {
        let (session, time) = session(limits.clone());
        let (mut rounds, is_timed) = (0, limits == Limits::seconds(2.0));
        let film = trace(session, &time, |before, left| {
            rounds += 1;
            assert!(left <= before.max(32) && (rounds > 1 || left == 32), "{limits:?}: {left} after {before}");
            // Of the time that is left, a quarter at most, unless it is a sample per pixel.
            let rest = 2000 - before.min(2000);
            assert!(!is_timed || left <= (rest / 4).max(32), "{left} of {rest}");
            ControlFlow::Continue(())
        });
        let (samples, seconds) = (film.record().samples, film.record().trace_seconds());
        assert!(samples > 1500 && rounds >= 7, "{limits:?}: {samples} in {rounds}");
        assert!((seconds - 1e-3 * samples as f64).abs() < 1e-6, "{seconds}");
    }
}

/// A filter that takes 3.5 seconds and 70 ms for each row of pixels, and so many times as long from 4 samples per pixel on.
struct Slow(Arc<AtomicU64>, u32);

impl Filter for Slow {
    fn name(&self) -> &str {
        "slow"
    }

    fn runs(&self, _: &Needs, spp: f64) -> u32 {
        if spp < 4.0 { 1 } else { self.1 }
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        self.0.fetch_add(3500 + 70 * u64::from(film.frame().size()[1]), Ordering::Relaxed);
        Ok(Filtered::new(film.frame().size(), film.image()))
    }
}

/// The filter is timed on few rows. They take its 3.5 seconds too, which must not be multiplied.
#[test]
fn a_time_limit_leaves_room_for_the_filter() {
    let limits = Limits::seconds(200.0);
    let traced = |runs: u32| {
        let time = Arc::default();
        let methods = Methods::from((uniform(1), Slow(Arc::clone(&time), runs)));
        let session = Session::new(frame(64, 256), limits.clone(), methods).unwrap().with_clock(clock(&time));
        trace(session, &time, |_, _| ControlFlow::Continue(()));
        time.load(Ordering::Relaxed) as f64 * 1e-3
    };
    let filter = 3.5 + 0.07 * 256.0;
    for runs in [1, 3] {
        let filter = f64::from(runs) * filter;
        let left = 200.0 - traced(runs) - filter;
        assert!(
            (0.15 * filter..0.25 * filter + 6.0).contains(&left),
            "{left} s are left after {runs} runs of the filter"
        );
    }
}

#[test]
fn an_open_session_ends_when_nobody_asks_for_more() {
    let (session, time) = session(Limits::open());
    let film = trace(session, &time, |before, _| match before {
        20_000.. => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    assert!(film.record().samples > 40_000 && film.record().interrupted);
}

/// A limit of samples is met without a clock; a limit of time asks for one.
#[test]
fn only_limits_of_time_need_a_clock() {
    let asked = Arc::new(AtomicU64::new(0));
    let counted = asked.clone();
    let count = Clock::new(move || counted.fetch_add(1, Ordering::Relaxed) as f64);
    let film = trace(Session::new(frame(8, 4), Limits::spp(4.0), uniform(1)).unwrap(), &AtomicU64::new(0), |_, _| {
        ControlFlow::Continue(())
    });
    assert_eq!((film.record().samples, film.record().trace_seconds(), film.record().plan_seconds()), (128, 0.0, 0.0));
    let session = Session::new(frame(8, 4), Limits::seconds(1.0), uniform(1)).unwrap();
    assert!(matches!(session.with_clock(Clock::none()).next_round(), Err(Error::NoClock)));
    // The control: a clock that is passed is asked.
    let mut session = Session::new(frame(8, 4), Limits::seconds(5.0), uniform(1)).unwrap().with_clock(count);
    assert!(session.next_round().unwrap().is_some() && asked.load(Ordering::Relaxed) > 0);
}

#[test]
fn looking_changes_no_bit_and_leaves_no_pixel_black() {
    let render = |looks: bool| {
        let mut session = Session::new(frame(40, 30), Limits::spp(9.0), uniform(1)).unwrap().with_tile_side(16);
        while let Some(round) = session.next_round().unwrap() {
            while let Some(mut tile) = round.next_tile() {
                tile.samples().for_each(|sample| tile.add(&sample, grey(&sample).map(|x| x + 0.1)));
                round.submit(tile).unwrap();
                if looks {
                    assert!(round.image().unwrap().radiance.iter().all(|[red, ..]| *red >= 0.1));
                }
            }
        }
        session.finish().unwrap()
    };
    assert!(render(true) == render(false));
}

/// A generator that is seeded by `seed` from pixel, number of the sample, and number of the part.
fn by_host(seed: impl Fn(u64, u64, u64) -> u64, lit: f64) -> Result<Film, Error> {
    let mut session = Session::new(frame(32, 32), Limits::spp(32.0), uniform(1)).unwrap();
    let mut part = 0;
    while let Some(round) = session.next_round()? {
        while let Some(mut tile) = round.next_tile() {
            for (pixel, numbers) in tile.pixels() {
                let begins = numbers.start;
                for number in numbers {
                    let place = u64::from(pixel[0] + 32 * pixel[1]);
                    let chance =
                        mix(mix(seed(place, number, part)).wrapping_add(number - begins)) as f64 / u64::MAX as f64;
                    tile.push(pixel, if chance < lit { [1.0; 3] } else { [0.25; 3] });
                }
            }
            round.submit(tile)?;
        }
        part += 1;
    }
    Ok(session.into_film())
}

/// Pixels of two values are the hardest: samples are equal by chance in half of all cases, or nearly always.
#[test]
fn a_host_that_repeats_its_numbers_is_told() {
    for lit in [0.5, 0.97, 0.03] {
        let repeated = by_host(|pixel, _, _| pixel, lit).unwrap_err().to_string();
        assert!(repeated.contains("seed the generator with the pixel and the sample's number"), "{repeated}");
        by_host(|pixel, number, _| pixel ^ number << 32, lit).unwrap();
        by_host(|pixel, _, part| pixel ^ part << 40, lit).unwrap();
    }
    // Without noise, nothing repeats.
    by_host(|pixel, _, _| pixel, 0.0).unwrap();
    by_host(|pixel, _, _| pixel, 2.0).unwrap();
}

/// A lamp of radiance 4 above two walls of albedo 0.5, seen in a mirror that reflects 0.8.
#[test]
fn a_path_record_tells_emission_direct_and_indirect_light_apart() {
    let hit = |depth| FirstHit::new([depth, 0.0, 0.0], [1.0, 0.0, 0.0], depth).with_albedo([0.5; 3]);
    let mut path = PathRecord::new();
    path.surface(hit(2.0).with_roughness(0.0), [1.0; 3]);
    path.emits([1.0; 3], [0.25; 3]); // seen directly
    path.surface(hit(3.0), [0.8; 3]);
    path.emits([0.8; 3], [1.0; 3]); // seen in the mirror
    path.receives([0.4; 3], [4.0; 3]); // direct
    path.surface(hit(5.0), [0.4; 3]);
    path.emits([0.4; 3], [2.0; 3]); // direct too: it lights the first wall
    path.receives([0.2; 3], [4.0; 3]); // indirect
    path.background([0.2; 3], [1.0; 3]); // indirect: seen by the second wall
    let estimate = path.estimate();
    let near = |found: [f32; 3], expected: f32| found.iter().all(|x| (x - expected).abs() < 1e-6);
    assert!(near(estimate.radiance, 0.25 + 0.8 + 1.6 + 0.8 + 0.8 + 0.2), "{estimate:?}");
    assert!(near(estimate.emission, 1.05) && near(estimate.indirect, 1.0), "{estimate:?}");
    let seen = estimate.features.expect("the wall in the mirror");
    assert!(seen.depth == 5.0 && seen.position[0] == 3.0 && near(seen.albedo, 0.4), "{seen:?}");
    assert_eq!(estimate.first_hit.map(|hit| hit.depth), Some(2.0));

    // A lamp and a wall in a lobe that is too rare, and a lamp sampled below a coat.
    let rare = |probability| {
        let mut path = PathRecord::new();
        path.surface(hit(2.0).with_roughness(0.0), [1.0; 3]);
        path.lobe(probability);
        path.surface(hit(3.0), [1.0; 3]);
        path.emits([1.0; 3], [1.0; 3]);
        (path.estimate().emission[0], path.estimate().features.map(|f| f.rare))
    };
    assert_eq!([1.0, 0.5, 0.05].map(rare), [(1.0, Some(false)), (0.0, Some(false)), (0.0, Some(true))]);
    let mut coat = PathRecord::new();
    coat.surface(hit(2.0).with_roughness(0.0), [1.0; 3]);
    coat.receives([0.5; 3], [2.0; 3]);
    assert_eq!((coat.estimate().emission, coat.estimate().radiance), ([0.0; 3], [1.0; 3]));

    let mut wall = PathRecord::new();
    wall.surface(hit(2.0), [1.0; 3]);
    assert!(wall.estimate().features.is_none(), "the first hit has them");
    let mut sky = PathRecord::new();
    sky.background([1.0; 3], [3.0; 3]);
    assert_eq!((sky.estimate().emission, sky.estimate().first_hit, sky.estimate().says_hit), ([3.0; 3], None, true));
}

/// A filter that tells the threads of its loop.
struct Threads(Arc<Mutex<Vec<String>>>);

impl Filter for Threads {
    fn name(&self) -> &str {
        "threads"
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        parallel::map(1 << 14, |_| note(&self.0));
        Unfiltered.apply(film)
    }
}

fn note(threads: &Mutex<Vec<String>>) {
    threads.lock().unwrap().push(std::thread::current().name().unwrap_or("no name").to_owned());
}

#[test]
fn a_session_stays_in_the_pool_that_calls_it() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).thread_name(|n| format!("host {n}")).build().unwrap();
    let threads = Arc::new(Mutex::new(Vec::new()));
    let trace = || {
        let methods = Methods::from((uniform(1), Threads(threads.clone())));
        let mut session = Session::new(frame(64, 64), Limits::spp(4.0), methods).unwrap();
        while let Some(round) = session.next_round().unwrap() {
            round.trace(|sample| (note(&threads), grey(sample)).1).unwrap();
        }
        session.finish().unwrap()
    };
    let image = pool.install(trace);
    let names = std::mem::take(&mut *threads.lock().unwrap());
    assert!(names.len() == 4 * 64 * 64 + (1 << 14) && names.iter().all(|name| name.starts_with("host ")));
    // Without the pool of the host, other threads do the same.
    assert_eq!(trace(), image);
    assert!(threads.lock().unwrap().iter().all(|name| !name.starts_with("host ")));
}

fn halves() -> Methods<'static> {
    Methods::from((uniform(1), Unfiltered)).with_needs(Needs::none().with_halves().with_variance())
}

/// Red of each pixel is its number, but where `bad` replaces a sample.
fn with_faults(bad: impl Fn([u32; 2], u64) -> Option<f32>) -> Session<'static> {
    let mut session = Session::new(frame(40, 30), Limits::spp(8.0), halves()).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        let mut tile = round.whole();
        for ([x, y], numbers) in tile.pixels() {
            numbers.for_each(|number| {
                let right = 1.0 + x as f32 + 40.0 * y as f32;
                tile.push([x, y], [bad([x, y], number).unwrap_or(right); 3]);
            });
        }
        round.submit(tile).unwrap();
    }
    session
}

#[test]
fn pixels_whose_samples_are_all_rejected_are_filled_from_their_neighbours() {
    // A block of 20x20 pixels with more rejected samples than a film lists, and a pixel of valid black samples.
    let bad = |[x, y]: [u32; 2], number: u64| match (x, y) {
        (5, 3) => Some(0.0),
        (10..30, 5..25) => Some([f32::NAN, f32::INFINITY, -1.0][(number % 3) as usize]),
        (33, 3) => [None, Some(f32::NAN)][(number % 2) as usize],
        _ => None,
    };
    let mut session = with_faults(bad);
    let film = session.film().clone();
    let rejected: Vec<usize> = (0..1200).filter(|&i| film.is_rejected(i)).collect();
    assert_eq!((rejected.len(), film.record().rejected), (400, 3204));
    let image = session.image().unwrap();
    for &i in &rejected {
        let red = image.radiance[i][0];
        assert!(red >= 1.0 && !rejected.contains(&(red as usize - 1)), "pixel {i} shows {red}");
    }
    assert_eq!((image.radiance[125], image.radiance[153]), ([0.0; 3], [77.0; 3]));
    assert!(image.error.unwrap().iter().all(|error| error.is_finite()));
    // A snapshot keeps it.
    let snapshot = snapshot(&session.snapshot());
    let again = Session::resume(frame(40, 30), Limits::spp(8.0), halves(), snapshot).unwrap();
    assert_eq!(again.image().unwrap().radiance, image.radiance);
}

#[test]
fn an_image_without_a_valid_sample_is_black() {
    let image = with_faults(|_, _| Some(f32::NAN)).finish().unwrap();
    assert!(image.radiance.iter().all(|colour| *colour == [0.0; 3]));
}

#[test]
fn a_huge_sample_leaves_image_error_and_snapshot_finite() {
    for value in [1e30, f32::MAX] {
        let mut session = with_faults(|pixel, number| (pixel == [7, 7] && number == 5).then_some(value));
        let image = session.image().unwrap();
        assert!(image.radiance.as_flattened().iter().chain(&image.error.unwrap()).all(|x| x.is_finite()));
        assert!(Snapshot::from_bytes(&session.snapshot()).is_ok());
    }
}

#[test]
fn looking_during_a_round_waits_for_nobody() {
    struct Loop;
    impl Filter for Loop {
        fn name(&self) -> &str {
            "loop"
        }

        fn apply(&self, film: &Film) -> Result<Filtered, Error> {
            parallel::map(1 << 14, |i| i);
            Unfiltered.apply(film)
        }
    }
    let mut session = Session::new(frame(64, 64), Limits::spp(16.0), Methods::from((uniform(1), Loop))).unwrap();
    while let Some(round) = session.next_round().unwrap() {
        std::thread::scope(|threads| {
            threads.spawn(|| (0..20).for_each(|_| drop(round.image().unwrap())));
            round.trace(grey).unwrap();
        });
    }
}

#[test]
fn a_tile_of_another_session_is_refused() {
    let mut sessions = [1, 2].map(|seed| Session::new(frame(8, 8), Limits::spp(1.0), uniform(seed)).unwrap());
    let [a, b] = &mut sessions;
    let (a, b) = (a.next_round().unwrap().unwrap(), b.next_round().unwrap().unwrap());
    let mut tile = a.whole();
    tile.samples().for_each(|sample| tile.add(&sample, grey(&sample)));
    let error = b.submit(tile).unwrap_err().to_string();
    assert!(error.contains("another session"), "{error}");
}
