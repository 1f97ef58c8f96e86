//! Processes that plan their own rows of an image.

use crate::common::{Field, Independent, everything, frame, noise};
use crate::exchange::{More, RANKS, adaptive, all, together};
use dapple_adaptive::Adaptive;
use dapple_core::exchange::{Exchange, InMemory};
use dapple_core::{
    Control, Draws, Error, Estimate, Feedback, Film, Frame, Integrator, Limits, Needs, OwnRows, PilotPolicy, Plan,
    PointSet, Progress, Render, Sampler, Schedule, Shard, Status, TrainingData, Worker,
};
use std::panic::{AssertUnwindSafe, catch_unwind};

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

/// The negative control of the tests above: a film lacks the rows that its sampler does not request.
#[test]
fn a_sampler_that_reads_rows_of_others_panics() {
    let (frame, limits) = (frame(19, 101), Limits::samples(19 * 101 * 17));
    let messages = together(3, |mut end| {
        let render = || {
            let mut sampler = Narrow(adaptive(PilotPolicy::Keep));
            let error =
                Render::new(frame, &limits).exchange(&mut end).run(&mut Field(noise), &mut sampler).unwrap_err();
            drop(end);
            error.to_string()
        };
        catch_unwind(AssertUnwindSafe(render)).unwrap_or_else(|panic| *panic.downcast::<String>().unwrap())
    });
    assert!(
        messages.iter().any(|message| message.contains("is with another process; a sampler reads")),
        "{messages:?}"
    );
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

/// The arithmetic of a render whose processes plan their own rows: a round sends the rows around each band. Pixels travel
/// where they are read.
#[test]
fn a_round_of_own_rows_moves_56_bytes_for_each_pixel_of_a_halo() {
    // One band for each of four processes: none moves.
    let (frame, limits) = (frame(640, 64), Limits::samples(640 * 64 * 16));
    let needs = Needs::none().with_variance();
    let sent = together(4, |end| {
        let mut end = Counting(end, Vec::new());
        let render = Render::new(frame, &limits).exchange(&mut end).in_bands();
        let film = render.run(&mut Field(noise), &mut adaptive(PilotPolicy::Neighbours)).unwrap();
        assert_eq!(film.record().rounds.len(), 3);
        let (halos, all) = (std::mem::take(&mut end.1), end.0.sent().iter().sum::<usize>());
        let first = end.share().index() == 0;
        let whole = film.gather(first.then_some(0..64), &needs, &mut end).unwrap();
        assert_eq!(whole.is_some(), first);
        (halos, all, end.1.iter().sum::<usize>())
    });
    for round in [1, 2] {
        let bytes: usize = sent.iter().map(|(halos, ..)| halos[halos.len() - round]).sum();
        // Two rows on both sides of three borders.
        assert_eq!(bytes, 12 * 640 * 56, "round {round}");
    }
    let plans: usize = sent.iter().map(|(halos, ..)| halos[..halos.len() - 2].iter().sum::<usize>()).sum();
    assert!(plans <= 4 * 640 * 64, "{plans} bytes of plans");
    let all: usize = sent.iter().map(|(_, all, _)| all).sum();
    let rest = all - 2 * 12 * 640 * 56 - plans;
    // Searches for thresholds, sums of rows, and heads of messages.
    assert!(rest < 300_000, "{rest} bytes beside halos");
    // Count, mean and deviations, the numbers of the rows, and a list's length and a flag: of three processes, since the first
    // one has its own rows.
    let gathered: usize = sent.iter().map(|(.., gathered)| gathered).sum();
    assert_eq!(gathered, 48 * (640 * 56 + 4) + 3 * 9);
}

/// The most bytes of planes that a process had at once, and its film at the end.
fn most_bytes(of: u32, frame: Frame) -> Vec<(usize, Film)> {
    let limits = Limits::samples(frame.pixels() as u64 * 24).with_schedule(Schedule::default().with_slice_spp(4));
    together(of, |mut end| {
        let mut most = 0;
        let mut watch = |status: &Status<'_>| {
            most = most.max(status.film.bytes());
            Control::Continue
        };
        let render = Render::new(frame, &limits).needs(needs_of_own_rows()).monitor(&mut watch);
        let render = render.exchange(&mut end).in_bands();
        let film = render.run(&mut Striped::default(), &mut adaptive(PilotPolicy::Neighbours)).unwrap();
        (most.max(film.bytes()), film)
    })
}

/// Rows of a process are its bands and two rows on either side, where there are any.
#[test]
fn a_process_has_planes_for_its_bands_and_their_halos_only() {
    let row = |frame: &Frame| frame.size()[0] as usize * Film::bytes_per_pixel(&needs_of_own_rows().and(pilots()));
    for of in [1, 2, 7] {
        // One band for each: none moves.
        let frame = frame(23, 16 * of);
        for (me, (bytes, film)) in most_bytes(of, frame).into_iter().enumerate() {
            let neighbours = usize::from(me > 0) + usize::from(me + 1 < of as usize);
            assert_eq!(bytes, (16 + 2 * neighbours) * row(&frame), "{me} of {of}");
            assert_eq!(film.is_whole(), of == 1);
        }
    }
    // Many bands, of which some move: no two processes hold the same one.
    let frame = frame(23, 16 * 20);
    let last: usize = most_bytes(3, frame).iter().map(|(_, film)| film.bytes()).sum();
    assert!((320 * row(&frame)..=(320 + 19 * 4) * row(&frame)).contains(&last), "{} rows", last / row(&frame));
}

/// The statistics that the sampler of these tests reads.
fn pilots() -> Needs {
    adaptive(PilotPolicy::Neighbours).needs()
}

#[test]
fn rows_in_bands_are_gathered_with_the_bits_of_a_render_alone() {
    let frame = frame(19, 101);
    let limits = Limits::samples(19 * 101 * 17 + 5);
    let alone = Render::new(frame, &limits).needs(needs_of_own_rows());
    let alone = alone.run(&mut Striped::default(), &mut adaptive(PilotPolicy::Keep)).unwrap();
    for of in RANKS {
        let gathered = together(of, |mut end| {
            let me = end.share().index();
            let render = Render::new(frame, &limits).needs(needs_of_own_rows()).exchange(&mut end).in_bands();
            let film = render.run(&mut Striped::default(), &mut adaptive(PilotPolicy::Keep)).unwrap();
            // Each wants other rows, the last one none.
            let rows = (me + 1 < of || of == 1).then_some(7 * me..101 - 11 * me);
            if film.is_whole() {
                film.of_rows(rows.unwrap()).ok()
            } else {
                film.gather(rows, film.needs(), &mut end).unwrap()
            }
        });
        for (me, film) in gathered.iter().enumerate() {
            let me = me as u32;
            let wanted = film.as_ref().map(|_| all(&alone.of_rows(7 * me..101 - 11 * me).unwrap()));
            assert!(film.as_ref().map(all) == wanted, "{me} of {of}");
            assert_eq!(film.is_none(), of > 1 && me + 1 == of);
        }
    }
    // Rows beyond the window are refused by the process that wants them; the others go on.
    let errors = together(2, |mut end| {
        let render = Render::new(frame, &limits).exchange(&mut end).in_bands();
        let film = render.run(&mut Field(noise), &mut adaptive(PilotPolicy::Keep)).unwrap();
        let rows = if end.share().index() == 0 { 90..102 } else { 0..101 };
        film.gather(Some(rows), film.needs(), &mut end).map(|film| film.is_some()).map_err(|e| e.to_string())
    });
    assert!(errors[0].as_ref().unwrap_err().contains("crop"), "{errors:?}");
    assert_eq!(errors[1], Ok(true));
}
