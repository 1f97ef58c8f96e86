//! Bands that move from process to process within a round.

use crate::common::{Independent, frame, noise};
use crate::exchange::{RANKS, adaptive, all, together};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Exchange, Film, FirstHit, Integrator, Limits, Needs, PilotPolicy, Prepares, Render,
    Sampler, Worker,
};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// An integrator that counts its samples, and sleeps in the first column.
struct Sleepy {
    microseconds: u64,
    prepares: Prepares,
    samples: AtomicU64,
}

impl Sleepy {
    fn new(microseconds: u64) -> Self {
        Self { microseconds, prepares: Prepares::Never, samples: AtomicU64::new(0) }
    }
}

impl Integrator for Sleepy {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        self.samples.fetch_add(1, Ordering::Relaxed);
        if draws.pixel()[0] == 0 && self.microseconds > 0 {
            std::thread::sleep(Duration::from_micros(self.microseconds));
        }
        let block = draws.block(Block::new(0));
        Estimate::new(noise(draws.pixel(), block)).with_first_hit(FirstHit::new([block[1]; 3], [0.0, 0.0, 1.0], 2.0))
    }

    fn prepares(&self) -> Prepares {
        self.prepares
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        let [a, b, ..] = draws.block(Block::new(0));
        Some(Estimate::new([0.0; 3]).with_first_hit(FirstHit::new([a; 3], [0.0, 0.0, 1.0], 1.0 + b)))
    }
}

/// The films of processes that sleep for these microseconds, and the number of samples that each traced.
fn render<S: Sampler>(
    (sleeps, prepares): (&[u64], Prepares),
    limits: &Limits,
    sampler: impl Fn() -> S + Sync,
) -> Vec<(Film, u64)> {
    together(sleeps.len() as u32, |mut end| {
        let mut integrator = Sleepy { prepares, ..Sleepy::new(sleeps[end.share().index() as usize]) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let film = pool.install(|| {
            let render = Render::new(frame(9, 170), limits).needs(needs()).exchange(&mut end);
            render.run(&mut integrator, &mut sampler()).unwrap()
        });
        (film, integrator.samples.into_inner())
    })
}

fn needs() -> Needs {
    Needs::none().with_variance().with_halves().with_features()
}

/// Eleven bands are dealt in turn: 90 of 170 rows are the first process'. It may take over one band, and has no more than
/// seven.
#[test]
fn a_slow_process_leaves_bands_to_others_and_no_bit_changes() {
    let limits = Limits::samples(9 * 170 * 16);
    let uniform = || Uniform::new(Independent::new(5));
    let alone = Render::new(frame(9, 170), &limits).needs(needs()).run(&mut Sleepy::new(0), &mut uniform()).unwrap();
    let samples = |prepares| {
        let films = render((&[0, 1000], prepares), &limits, uniform);
        assert!(films.iter().all(|(film, _)| all(film) == all(&alone)));
        [films[0].1, films[1].1]
    };
    let [first, second] = samples(Prepares::Never);
    assert_eq!(first + second, 9 * 170 * 16);
    // Half of a band at least: the slow process traces some of it before they meet.
    assert!(first >= (90 + 8) * 9 * 16, "{first} {second}");
    // Negative control: bands stay where they are dealt.
    assert_eq!(samples(Prepares::EveryPass), [90 * 9 * 16, 80 * 9 * 16]);
}

#[test]
fn an_adaptive_sampler_makes_the_same_film_whatever_the_speeds() {
    let limits = Limits::samples(9 * 170 * 24 + 7);
    let sampler = || adaptive(PilotPolicy::Neighbours);
    let alone = Render::new(frame(9, 170), &limits).needs(needs()).run(&mut Sleepy::new(0), &mut sampler()).unwrap();
    assert!(alone.record().rounds.len() > 1);
    for of in RANKS {
        let sleeps: Vec<u64> = (0..of).map(|index| 100 << (2 * (index % 2))).collect();
        let films = render((&sleeps, Prepares::Never), &limits, sampler);
        assert!(films.iter().all(|(film, _)| all(film) == all(&alone)), "{of} processes");
    }
}
