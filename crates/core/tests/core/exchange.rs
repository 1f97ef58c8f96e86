//! Renders by several processes: threads with an exchange in memory.

use crate::common::{Field, Independent, everything, frame, noise, rng};
use crate::holdout::{Blur, field};
use crate::resume::Everything;
use dapple_adaptive::{Adaptive, AdaptiveOptions};
use dapple_conformance::bits;
use dapple_core::exchange::{self, Exchange, InMemory, in_memory};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Budget, Control, Draws, Error, Estimate, Film, Frame, Integrator, InvalidSample, Limits, Needs, PilotPolicy,
    Render, Schedule, Shard, Snapshot, Status, TrainingData, Worker,
};
use rand::RngExt;
use std::time::Duration;

/// The numbers of processes that all tests of equal bits try. The frames have fewer bands of 16 rows than the last.
pub(crate) const RANKS: [u32; 4] = [1, 2, 3, 7];

/// Runs one thread per process, each with its end of an exchange in memory. Returns their results, by number.
pub(crate) fn together<T: Send>(of: u32, process: impl Fn(InMemory) -> T + Sync) -> Vec<T> {
    std::thread::scope(|threads| {
        let process = &process;
        let running: Vec<_> = in_memory(of).into_iter().map(|end| threads.spawn(move || process(end))).collect();
        running.into_iter().map(|one| one.join().expect("no process panics")).collect()
    })
}

/// All statistics of a film as bits, seconds left out.
pub(crate) fn all(film: &Film) -> Vec<u64> {
    let mut all = bits(film);
    let halves = if film.needs().halves { 2 } else { 1 };
    for (half, i) in (0..halves).flat_map(|half| (0..film.frame().pixels()).map(move |i| (half, i))) {
        let rest = (film.emission(half, i), film.channels(half, i), film.trajectories(half, i));
        all.extend(format!("{rest:?}").bytes().map(u64::from));
    }
    all
}

/// Everything, and splats, channels and emission.
#[derive(Default)]
pub(crate) struct More(Everything);

impl Integrator for More {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        let [x, y] = draws.pixel();
        let [r, g, b, u] = draws.block(dapple_core::Block::new(9));
        worker.splat([(u * 40.0) as u32, y + (r * 20.0) as u32], [g, b, if u < 0.001 { f32::NAN } else { r }]);
        worker.channels().iter_mut().for_each(|channel| *channel = r * (x + 1) as f32);
        self.0.estimate(draws, worker).with_emission([0.5 * r, g, b]).with_indirect([g, 0.5 * b, r])
    }

    fn wants_training(&self) -> bool {
        self.0.wants_training()
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.0.learn(pass);
    }
}

pub(crate) fn adaptive(policy: PilotPolicy) -> Adaptive<Independent> {
    Adaptive::with_options(Independent::new(5), AdaptiveOptions::default().policy(policy)).unwrap()
}

pub(crate) fn needs() -> Needs {
    everything().with_splats().with_channels(2)
}

#[test]
fn every_process_has_the_film_of_a_render_alone() {
    let frame = frame(17, 70);
    let limits = Limits::samples(17 * 70 * 17 + 5);
    for policy in [PilotPolicy::Keep, PilotPolicy::Neighbours, PilotPolicy::Discard, PilotPolicy::Cross] {
        let alone =
            Render::new(frame, &limits).needs(needs()).run(&mut More::default(), &mut adaptive(policy)).unwrap();
        assert!(alone.record().rejected > 50 && alone.record().rounds.len() > 1);
        let wanted = all(&alone);
        for of in RANKS {
            let films = together(of, |mut end| {
                // Schedules differ from process to process.
                let index = end.share().index();
                let schedule =
                    Schedule::default().with_tile_rows(1 + 7 * index).with_slice_spp(index % 3).with_shuffle(3);
                let limits = limits.clone().with_schedule(schedule);
                let mut integrator = More::default();
                let render = Render::new(frame, &limits).needs(needs()).exchange(&mut end);
                let film = render.run(&mut integrator, &mut adaptive(policy)).unwrap();
                assert_eq!(integrator.0.learned.len(), 4);
                film
            });
            assert!(films.iter().all(|film| all(film) == wanted), "{policy:?}, {of} processes");
        }
    }
}

/// An exchange that loses the last process' pixels: what it sends is what it sent before.
struct Stale(InMemory, Vec<u8>);

impl Exchange for Stale {
    fn share(&self) -> Shard {
        self.0.share()
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        let before = std::mem::replace(&mut self.1, mine.clone());
        self.0.all_gather(if self.share().index() > 0 && !before.is_empty() { before } else { mine })
    }
}

#[test]
fn messages_of_another_step_are_refused_by_all() {
    let errors = together(2, |end| {
        let limits = Limits::samples(37 * 40 * 16);
        let mut end = Stale(end, Vec::new());
        Render::new(frame(37, 40), &limits).exchange(&mut end).run(&mut Field(noise), &mut uniform()).unwrap_err()
    });
    for error in errors {
        assert!(matches!(error, Error::Exchange { .. } | Error::Gone { .. }), "{error}");
    }
}

fn uniform() -> Uniform<Independent> {
    Uniform::new(Independent::new(5))
}

#[test]
fn a_render_interrupted_in_a_training_pass_is_resumed_by_several_processes() {
    let (frame, limits) = (frame(90, 70), Limits::samples(90 * 70 * 9));
    let mut states = Vec::new();
    let mut keep = |status: &Status<'_>| {
        states.push(status.snapshot());
        Control::Continue
    };
    let render = Render::new(frame, &limits).needs(Needs::none().with_variance()).monitor(&mut keep);
    let alone = all(&render.run(&mut Everything::default(), &mut uniform()).unwrap());
    // Not at the end of a pass: passes end with whole multiples of a sample per pixel.
    let within = |state: &&Vec<u8>| {
        let samples = Snapshot::from_bytes(state).unwrap().film().record().samples;
        !samples.is_multiple_of(90 * 70) && samples < 8 * 90 * 70
    };
    let within: Vec<_> = states.iter().filter(within).collect();
    assert!(!within.is_empty(), "the first slice of a round has some rows only");
    for state in [within[0], within[within.len() - 1]] {
        let films = together(2, |mut end| {
            let snapshot = Snapshot::from_bytes(state).unwrap();
            let render = Render::new(frame, &limits).needs(Needs::none().with_variance()).exchange(&mut end);
            render.resume(snapshot, &mut Everything::default(), &mut uniform()).unwrap()
        });
        assert!(films.iter().all(|film| all(film) == alone));
    }
}

#[test]
fn a_limit_of_error_of_the_filtered_image_ends_all_after_the_same_samples() {
    let limits = Limits::error(0.0004, 1 << 22);
    let filter = Blur { claim: Some(0.7) };
    macro_rules! render {
        () => {
            Render::new(frame(48, 48), &limits).error_of(&filter)
        };
    }
    let alone = render!().run(&mut Field(field), &mut uniform()).unwrap();
    assert!(alone.record().rounds.len() > 2 && alone.record().filtered_relmse.is_some());
    for of in RANKS {
        let films =
            together(of, |mut end| render!().exchange(&mut end).run(&mut Field(field), &mut uniform()).unwrap());
        assert!(films.iter().all(|film| all(film) == all(&alone)));
        assert!(films.iter().all(|film| film.record().filtered_relmse == alone.record().filtered_relmse));
    }
}

#[test]
fn a_limit_of_time_is_that_of_the_first_process() {
    /// Each process reads another clock: later ones trace more slowly.
    struct Slow(u64);
    impl Integrator for Slow {
        fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
            if draws.pixel()[0] == 0 {
                std::thread::sleep(Duration::from_micros(self.0));
            }
            Estimate::new(noise(draws.pixel(), draws.block(dapple_core::Block::new(0))))
        }
    }
    // With splats, every process plans the whole image.
    for needs in [Needs::none(), Needs::none().with_splats()] {
        let films = together(3, |mut end| {
            let index = end.share().index();
            // Only the first one's limit counts.
            let limits = Limits::seconds(if index == 0 { 0.3 } else { 77.0 });
            let render = Render::new(frame(20, 70), &limits).needs(needs).exchange(&mut end);
            render.run(&mut Slow(50 + 100 * u64::from(index)), &mut adaptive(PilotPolicy::Keep)).unwrap()
        });
        assert!(films[1..].iter().all(|film| all(film) == all(&films[0])));
        let limits = Limits::new(Budget::Recorded(films[0].record().budgets.clone()));
        let again = Render::new(frame(20, 70), &limits)
            .needs(needs)
            .run(&mut Slow(0), &mut adaptive(PilotPolicy::Keep))
            .unwrap();
        assert!(all(&again) == all(&films[0]));
    }
}

#[test]
fn one_process_that_stops_early_ends_all_with_a_whole_film() {
    check_stops(&[(1, true), (2, true), (1, false)]);
}

#[test]
#[ignore = "6 s: six moments; three are tested always"]
fn one_process_that_stops_ends_all_with_a_whole_film() {
    check_stops(&[(1, true), (2, true), (3, true), (5, true), (1, false), (3, false)]);
}

/// In a training pass, between passes, and in a round without them: slices, and true with training.
fn check_stops(moments: &[(u32, bool)]) {
    for &(after, learns) in moments {
        let films = together(3, |mut end| {
            let (index, mut slices) = (end.share().index(), 0);
            let mut monitor = |_: &Status<'_>| {
                slices += 1;
                if index == 1 && slices == after { Control::Stop } else { Control::Continue }
            };
            let limits = Limits::samples(20 * 70 * 64).with_schedule(Schedule::default().with_slice_spp(4));
            let render = Render::new(frame(20, 70), &limits).needs(needs()).exchange(&mut end).monitor(&mut monitor);
            let mut learning = More::default();
            let mut fixed = Field(noise);
            render.run(if learns { &mut learning } else { &mut fixed }, &mut uniform()).unwrap()
        });
        assert!(films.iter().all(|film| film.record().interrupted), "{after} {learns}");
        assert!(films.iter().all(|film| all(film) == all(&films[0])));
        let counts: u64 = films[0].counts().iter().sum();
        assert_eq!(counts, films[0].record().samples);
    }
}

#[test]
fn a_panic_or_an_invalid_sample_of_one_process_ends_all_with_the_same_error() {
    struct Breaks {
        panics: bool,
        learns: bool,
        learned: u32,
    }
    impl Integrator for Breaks {
        fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
            let broken = draws.pixel() == [3, 20] && draws.id().index == 5;
            assert!(!(broken && self.panics), "a broken triangle");
            Estimate::new(if broken { [f32::NAN; 3] } else { [1.0; 3] })
        }
        fn wants_training(&self) -> bool {
            self.learns && self.learned < 4
        }
        fn learn(&mut self, _: &TrainingData) {
            self.learned += 1;
        }
    }
    for (panics, learns) in [(true, true), (true, false), (false, true), (false, false)] {
        let errors = together(3, |mut end| {
            let limits = Limits::samples(9 * 50 * 16).with_invalid(InvalidSample::Fail);
            let render = Render::new(frame(9, 50), &limits).exchange(&mut end);
            render.run(&mut Breaks { panics, learns, learned: 0 }, &mut uniform()).unwrap_err()
        });
        for error in errors {
            match error {
                Error::Panicked { sample, message, film, .. } => {
                    assert!(panics && message.contains("a broken triangle") && sample.pixel == [3, 20]);
                    assert_eq!(film.counts().iter().sum::<u64>(), film.record().samples);
                    assert!(film.record().samples > 9 * 50 * 4);
                }
                Error::InvalidSample { sample, .. } => assert!(!panics && (sample.pixel, sample.index) == ([3, 20], 5)),
                other => panic!("{other}"),
            }
        }
    }
}

#[test]
fn processes_with_different_settings_list_the_differences() {
    let errors = together(3, |mut end| {
        let index = end.share().index();
        let limits = Limits::samples(if index == 2 { 4000 } else { 3600 });
        let mut sampler = Uniform::new(Independent::new(if index == 1 { 6 } else { 5 }));
        Render::new(frame(9, 40), &limits).exchange(&mut end).run(&mut Field(noise), &mut sampler).unwrap_err()
    });
    for error in errors {
        let message = error.to_string();
        let wanted =
            ["point set: independent:seed=6 at rank 1, not independent:seed=5", "budget: Samples(4000) at rank 2"];
        assert!(wanted.iter().all(|wanted| message.contains(wanted)), "{message}");
    }
}

#[test]
fn nobody_waits_for_a_process_that_failed_or_is_gone() {
    let errors = together(3, |mut end| match end.share().index() {
        0 => exchange::agree(&mut end, Ok(vec![1])).unwrap_err(),
        index => exchange::agree(&mut end, Err(format!("scene {index} is missing"))).unwrap_err(),
    });
    for error in errors {
        assert!(error.to_string().contains("rank 1: scene 1 is missing\nrank 2: scene 2 is missing"), "{error}");
    }
    // One leaves in the middle of a round.
    let ends = together(3, |mut end| {
        let index = end.share().index();
        let limits = Limits::samples(90 * 70 * 64);
        let leave = |_: &Status<'_>| if index == 2 { panic!("killed") } else { Control::Continue };
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
            let mut leave = leave;
            let render = Render::new(frame(90, 70), &limits).exchange(&mut end).monitor(&mut leave);
            render.run(&mut Field(noise), &mut uniform()).map(|_| ())
        }))
    });
    assert!(ends[2].is_err());
    for end in &ends[..2] {
        let Ok(Err(error)) = end else { panic!("it must report the other's end") };
        assert!(error.to_string().contains("rank 2 has ended"), "{error}");
    }
}

/// The arithmetic of a round's message: counts, means and squared deviations of each pixel that the plan gives samples.
#[test]
fn a_round_moves_56_bytes_for_each_pixel_that_gets_samples() {
    let mut random = rng(3);
    let (frame, gets): (Frame, Vec<bool>) = (frame(64, 160), (0..64 * 160).map(|_| random.random()).collect());
    let limits = Limits::samples(3 * 64 * 160);
    let needs = Needs::none().with_variance();
    let rounds = || {
        let gets = gets.clone();
        let plan = move |seen: &dapple_core::Feedback<'_>, plan: &mut dapple_core::Plan| {
            match seen.round {
                0 => plan.counts.fill(1),
                1 => plan.counts.iter_mut().zip(&gets).for_each(|(n, gets)| *n = u32::from(*gets)),
                _ => return dapple_core::Progress::Done,
            }
            dapple_core::Progress::Trace
        };
        crate::common::Planned { points: Independent::new(3), needs, plan }
    };
    let sent = together(4, |mut end| {
        Render::new(frame, &limits).needs(needs).exchange(&mut end).run(&mut Field(noise), &mut rounds()).unwrap();
        // The messages of rounds: others have no pixels.
        end.sent().iter().copied().filter(|bytes| *bytes > 10_000).collect::<Vec<usize>>()
    });
    let chosen = gets.iter().filter(|gets| **gets).count();
    for (round, pixels) in [64 * 160, chosen].into_iter().enumerate() {
        // Each message has a head, and 16 bytes for each of the ten bands.
        let bytes: usize = sent.iter().map(|sent| sent[round]).sum();
        let head = (bytes - 56 * pixels - 16 * 10) / 4;
        assert!(head < 256, "round {round} moved {bytes} bytes for {pixels} pixels");
    }
    assert_eq!(Film::bytes_per_pixel(&needs), 56);
}
