//! Processes that plan their own rows of an image.

use crate::common::{Field, Independent, everything, frame, noise};
use crate::exchange::{More, RANKS, adaptive, all, together};
use dapple_adaptive::Adaptive;
use dapple_core::exchange::{Exchange, InMemory};
use dapple_core::{
    Draws, Error, Estimate, Feedback, Integrator, Limits, Needs, OwnRows, PilotPolicy, Plan, PointSet, Progress,
    Render, Sampler, Shard, TrainingData, Worker,
};

/// Without splats, processes plan their own rows.
fn needs_of_own_rows() -> Needs {
    everything().with_channels(2)
}

/// Every other eight rows are black, so that counts differ.
#[derive(Default)]
struct Striped(More);

impl Integrator for Striped {
    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        let mut estimate = self.0.estimate(draws, worker);
        if draws.pixel()[1] & 8 == 0 {
            estimate.radiance = [0.0; 3];
        }
        estimate
    }

    fn wants_training(&self) -> bool {
        self.0.wants_training()
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.0.learn(pass);
    }
}

#[test]
fn processes_that_plan_their_own_rows_have_the_film_of_a_render_alone() {
    let frame = frame(19, 101);
    for (policy, spp) in [
        (PilotPolicy::Keep, 17),
        (PilotPolicy::Neighbours, 17),
        (PilotPolicy::Neighbours, 3),
        (PilotPolicy::Discard, 17),
        (PilotPolicy::Cross, 17),
    ] {
        let limits = Limits::samples(19 * 101 * spp + 5);
        let needs = needs_of_own_rows();
        let alone =
            Render::new(frame, &limits).needs(needs).run(&mut Striped::default(), &mut adaptive(policy)).unwrap();
        let (wanted, counts) = (all(&alone), alone.counts());
        assert!(spp == 3 || counts.iter().max().unwrap() > &(counts.iter().min().unwrap() + 1), "counts are even");
        for of in RANKS {
            let films = together(of, |mut end| {
                let mut integrator = Striped::default();
                let render = Render::new(frame, &limits).needs(needs).exchange(&mut end);
                render.run(&mut integrator, &mut adaptive(policy)).unwrap()
            });
            assert!(films.iter().all(|film| all(film) == wanted), "{policy:?}, {spp} spp, {of} processes");
        }
    }
}

/// A sampler that asks for fewer rows around its own ones than it reads.
struct Narrow(Adaptive<Independent>);

impl Sampler for Narrow {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn needs(&self) -> Needs {
        self.0.needs()
    }

    fn points(&self) -> &dyn PointSet {
        self.0.points()
    }

    fn halo(&self) -> Option<u32> {
        Some(0)
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        self.0.next_round(seen, plan)
    }

    fn next_round_of_rows(
        &mut self,
        seen: &Feedback<'_>,
        plan: &mut Plan,
        part: &mut OwnRows<'_>,
    ) -> Result<Progress, Error> {
        self.0.next_round_of_rows(seen, plan, part)
    }
}

/// The negative control of the tests above: a missing halo changes the image.
#[test]
fn rows_that_were_not_sent_are_missed() {
    /// Every other eight rows are black.
    fn striped(pixel: [u32; 2], numbers: [f32; 4]) -> [f32; 3] {
        noise(pixel, numbers).map(|value| if pixel[1] & 8 == 0 { value } else { 0.0 })
    }
    let (frame, limits) = (frame(19, 101), Limits::samples(19 * 101 * 17));
    let sampler = || adaptive(PilotPolicy::Keep);
    let alone = Render::new(frame, &limits).run(&mut Field(striped), &mut sampler()).unwrap();
    let films = together(3, |mut end| {
        Render::new(frame, &limits).exchange(&mut end).run(&mut Field(striped), &mut Narrow(sampler())).unwrap()
    });
    assert!(films.iter().all(|film| film.record().samples == alone.record().samples && all(film) == all(&films[0])));
    assert!(all(&films[0]) != all(&alone));
}

/// An exchange that notes the bytes sent to single processes.
struct Counting(InMemory, Vec<usize>);

impl Exchange for Counting {
    fn share(&self) -> Shard {
        self.0.share()
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        self.0.all_gather(mine)
    }

    fn all_to_all(&mut self, to_each: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Error> {
        self.1.push(to_each.iter().map(Vec::len).sum());
        self.0.all_to_all(to_each)
    }
}

/// The arithmetic of a render whose processes plan their own rows: a round sends the rows around each band, and all pixels
/// travel once, at the end.
#[test]
fn a_round_of_own_rows_moves_56_bytes_for_each_pixel_of_a_halo() {
    // One band for each of four processes: none moves.
    let (frame, limits) = (frame(640, 64), Limits::samples(640 * 64 * 16));
    let sent = together(4, |end| {
        let mut end = Counting(end, Vec::new());
        let render = Render::new(frame, &limits).exchange(&mut end);
        let film = render.run(&mut Field(noise), &mut adaptive(PilotPolicy::Neighbours)).unwrap();
        assert_eq!(film.record().rounds.len(), 3);
        let (halos, all) = (end.1.clone(), end.0.sent().iter().sum::<usize>());
        (halos, all)
    });
    for round in [1, 2] {
        let bytes: usize = sent.iter().map(|(halos, _)| halos[halos.len() - round]).sum();
        // Two rows on both sides of three borders.
        assert_eq!(bytes, 12 * 640 * 56, "round {round}");
    }
    let plans: usize = sent.iter().map(|(halos, _)| halos[..halos.len() - 2].iter().sum::<usize>()).sum();
    assert!(plans <= 4 * 640 * 64, "{plans} bytes of plans");
    let all: usize = sent.iter().map(|(_, all)| all).sum();
    let rest = all - 56 * 640 * 64 - 2 * 12 * 640 * 56 - plans;
    // Searches for thresholds, sums of rows, and heads of messages.
    assert!(rest < 300_000, "{rest} bytes beside halos and pixels");
}
