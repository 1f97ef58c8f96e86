//! Integrators that prepare themselves before samples.

use crate::common::{Field, Independent, Keeper, bits, cut, frame, noise, numbers, on_threads, snapshot, uniform};
use dapple_adaptive::Adaptive;
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::{Block, Draws, Error, Estimate, Film, Integrator, Limits, Needs, Render, Sampler, Snapshot, Worker};

/// Prepares one number per pass, and adds it to noise.
#[derive(Default)]
struct PassNumber {
    when: Prepares,
    /// The number of the pass and what it prepared.
    state: Option<(u32, f32)>,
    numbers: Vec<u32>,
}

impl PassNumber {
    fn new(when: Prepares) -> Self {
        Self { when, ..Self::default() }
    }
}

impl Integrator for PassNumber {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let more = self.state.map_or(0.0, |(_, value)| value);
        Estimate::new(noise(draws.pixel(), numbers(draws)).map(|x| x + more))
    }

    fn prepares(&self) -> Prepares {
        self.when
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let sum: f32 = (0..10).map(|path| pass.draws(path).block(Block::new(0))[0]).sum();
        self.state = Some((pass.number, sum));
        self.numbers.push(pass.number);
        PreparationCost { rays: 10 }
    }
}

/// Says that it prepares, and does nothing.
struct Idle(Prepares);

impl Integrator for Idle {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        Field(noise).estimate(draws, worker)
    }

    fn prepares(&self) -> Prepares {
        self.0
    }
}

fn adaptive() -> Adaptive<Independent> {
    Adaptive::variance(Independent::new(5))
}

fn limits(spp: u64) -> Limits {
    Limits::samples(spp * 90 * 70)
}

fn run(integrator: &mut dyn Integrator, sampler: &mut dyn Sampler, limits: &Limits) -> Film {
    Render::new(frame(90, 70), limits).run(integrator, sampler).expect("a film")
}

#[test]
fn a_preparation_that_does_nothing_changes_no_bit() {
    let whole = run(&mut Field(noise), &mut adaptive(), &limits(9));
    for when in [Prepares::Never, Prepares::Once, Prepares::EveryPass] {
        let film = run(&mut Idle(when), &mut adaptive(), &limits(9));
        assert_eq!(film.record().rays, whole.record().rays);
        assert!(bits(&film) == bits(&whole), "{when:?}");
    }
}

#[test]
fn a_prepared_render_is_the_same_on_any_threads_in_any_slices_and_resumed_within_a_pass() {
    for when in [Prepares::Once, Prepares::EveryPass] {
        let mut keeper = Keeper::default();
        let resumed = |kept: Snapshot, limits: &Limits, integrator: &mut dyn Integrator| {
            Render::new(frame(90, 70), limits).resume(kept, integrator, &mut adaptive()).expect("a film")
        };
        let film = Render::new(frame(90, 70), &limits(9))
            .monitor(&mut keeper)
            .run(&mut PassNumber::new(when), &mut adaptive())
            .expect("a film");
        let whole = bits(&film);
        let partly = keeper.all().filter(|kept| !kept.film().record().samples.is_multiple_of(6300)).count();
        assert!(partly > 2, "slices go by rows");
        for (i, kept) in keeper.all().enumerate() {
            let (limits, mut integrator) = (limits(9).with_schedule(cut(i)), PassNumber::new(when));
            let resumed = on_threads(1 + i % 4, || resumed(kept, &limits, &mut integrator));
            assert!(bits(&resumed) == whole, "{when:?}, slice {i}");
            let [a, b] = [&resumed, &film].map(|film| film.record());
            assert_eq!((a.passes, a.rays, a.prepare_rays), (b.passes, b.rays, b.prepare_rays), "{when:?}, slice {i}");
        }
        // Negative control: without its preparation, a resumed render gives another image.
        let last = snapshot(keeper.slices.iter().rev().nth(1).expect("slices"));
        assert!(bits(&resumed(last, &limits(9), &mut PassNumber::new(Prepares::Never))) != whole);
    }
}

#[test]
fn passes_are_numbered_and_their_rays_recorded() {
    let mut once = PassNumber::new(Prepares::Once);
    let film = run(&mut once, &mut uniform(1), &limits(8));
    assert_eq!((once.numbers, film.record().passes, film.record().prepare_rays), (vec![0], 1, 10));
    assert_eq!(film.record().rays, 8 * 6300 + 10);
    // Two samples per pixel, so that each half of a film may have a preparation of its own.
    for needs in [Needs::none(), Needs::none().with_halves()] {
        let mut every = PassNumber::new(Prepares::EveryPass);
        let mut sampler = uniform(1);
        let film = Render::new(frame(90, 70), &limits(9)).needs(needs).run(&mut every, &mut sampler).expect("a film");
        assert_eq!((every.numbers, film.record().passes), ((0..5).collect(), 5));
        assert_eq!(film.record().rays, 9 * 6300 + 50);
    }
    // Few pixels with many samples have no more passes than many pixels with few.
    let mut every = PassNumber::new(Prepares::EveryPass);
    let film = run(&mut every, &mut adaptive(), &limits(16));
    let (passes, rounds) = (film.record().passes, film.record().rounds.len() as u32);
    assert!((8..=8 + 8 * rounds).contains(&passes), "{passes} passes in {rounds} rounds");
}

#[test]
fn a_panic_while_preparing_is_an_error() {
    struct Fails;
    impl Integrator for Fails {
        fn estimate(&self, _: &Draws<'_>, _: &mut Worker) -> Estimate {
            Estimate::new([0.0; 3])
        }
        fn prepares(&self) -> Prepares {
            Prepares::Once
        }
        fn prepare(&mut self, _: &Pass<'_>) -> PreparationCost {
            panic!("no photons")
        }
    }
    let film = Render::new(frame(4, 4), &Limits::samples(16)).run(&mut Fails, &mut uniform(1));
    assert!(matches!(film, Err(Error::Panicked { message, .. }) if message == "no photons"));
}
