//! The state of all processes at barriers: saved in pieces, and resumed.

use crate::common::{Field, Independent, everything, frame, noise};
use crate::exchange::{More, adaptive, all, needs, together};
use dapple_core::exchange::{Exchange, InMemory};
use dapple_core::{
    Control, Draws, Error, Estimate, Film, Frame, Integrator, Limits, Monitor, Needs, PilotPolicy, Render, Sampler,
    Shard, Snapshot, Status, Worker,
};
use std::cell::Cell;
use std::io::Read;
use std::time::Duration;

/// Keeps the state of all after each barrier and at the end, the rows of all, and the processes' seconds.
#[derive(Default)]
struct Barriers {
    states: Vec<Vec<u8>>,
    /// The lengths of states, as they were told.
    lengths: Vec<u64>,
    /// The largest piece, and the most bytes of a film at a barrier or of rows.
    most: [usize; 3],
    /// The means of rows, barrier by barrier.
    means: Vec<Vec<u64>>,
    begins: bool,
    seconds: Vec<Vec<f64>>,
}

thread_local! {
    /// True from a barrier to the next slice of this process.
    static AT_BARRIER: Cell<bool> = const { Cell::new(false) };
}

/// An exchange that counts the most bytes that this process gets at once at a barrier.
struct Counted(InMemory, usize);

impl Exchange for Counted {
    fn share(&self) -> Shard {
        self.0.share()
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        self.0.all_gather(mine)
    }

    fn all_to_all(&mut self, to_each: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Error> {
        let got = self.0.all_to_all(to_each)?;
        if AT_BARRIER.get() {
            self.1 = self.1.max(got.iter().map(Vec::len).sum());
        }
        Ok(got)
    }
}

impl Monitor for Barriers {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        AT_BARRIER.set(false);
        Control::Continue
    }

    fn barrier(&mut self, status: &Status<'_>, seconds: &[f64]) {
        AT_BARRIER.set(true);
        self.begins = true;
        self.means.push(Vec::new());
        self.most[1] = self.most[1].max(status.film.bytes());
        self.seconds.push(seconds.to_vec());
    }

    fn saves(&self) -> bool {
        true
    }

    fn saved(&mut self, bytes: &[u8], length: u64) {
        if std::mem::take(&mut self.begins) {
            self.states.push(Vec::new());
            self.lengths.push(length);
        }
        assert_eq!(self.lengths.last(), Some(&length));
        self.most[0] = self.most[0].max(bytes.len());
        self.states.last_mut().unwrap().extend(bytes);
    }

    fn reads_rows(&self) -> bool {
        true
    }

    fn rows(&mut self, rows: &Film) {
        self.most[2] = self.most[2].max(rows.bytes());
        let means = (0..rows.frame().pixels()).flat_map(|i| rows.mean(i)).map(f64::to_bits);
        self.means.last_mut().unwrap().extend(means);
    }

    fn end(&mut self, _: &Status<'_>) {
        self.begins = true;
    }
}

/// The bytes of a state without its readings of clocks.
fn without_times(state: &[u8]) -> Vec<u8> {
    let snapshot = Snapshot::from_bytes(state).unwrap();
    let mut bytes = state.to_vec();
    // Signature and version; two texts; bounds, round, total; the seconds.
    let text = |at: usize| at + 8 + u64::from_le_bytes(state[at..at + 8].try_into().unwrap()) as usize;
    let seconds = text(text(12)) + 8 + 4 + 8;
    bytes[seconds..seconds + 8].fill(0);
    let mut at = seconds + 8;
    for time in snapshot.film().record().rounds.iter().flat_map(|round| [round.plan_seconds, round.trace_seconds]) {
        at += bytes[at..].windows(8).position(|eight| eight == time.to_le_bytes()).unwrap();
        bytes[at..at + 8].fill(0);
        at += 8;
    }
    bytes
}

/// Every barrier of 1, 2, 3 and 7 processes, and the end with [`Status::snapshot`] of a render without an exchange.
#[test]
fn the_state_that_processes_save_has_the_bytes_of_one_process() {
    let (frame, limits) = (frame(17, 70), Limits::samples(17 * 70 * 17 + 5));
    let mut samples = everything().with_channels(2).with_samples(4).with_trajectories();
    for policy in [PilotPolicy::Keep, PilotPolicy::Discard, PilotPolicy::Neighbours] {
        let states = |of: u32| {
            together(of, |mut end| {
                let mut barriers = Barriers::default();
                let render = Render::new(frame, &limits).needs(samples).exchange(&mut end).in_bands();
                render.monitor(&mut barriers).run(&mut More::default(), &mut adaptive(policy)).unwrap();
                let lengths: Vec<u64> = barriers.states.iter().map(|state| state.len() as u64).collect();
                assert_eq!(lengths, barriers.lengths);
                let states: Vec<_> = barriers.states.iter().map(|state| without_times(state)).collect();
                (states, barriers.means)
            })
        };
        struct End(Vec<u8>);
        impl Monitor for End {
            fn slice(&mut self, _: &Status<'_>) -> Control {
                Control::Continue
            }
            fn end(&mut self, status: &Status<'_>) {
                self.0 = status.snapshot();
            }
        }
        let mut end = End(Vec::new());
        let render = Render::new(frame, &limits).needs(samples).monitor(&mut end);
        let alone = render.run(&mut More::default(), &mut adaptive(policy)).unwrap();
        let wanted = states(1).remove(0);
        assert!(wanted.0.len() > 1 && wanted.0.last() == Some(&without_times(&end.0)), "{policy:?}");
        let means: Vec<u64> = (0..frame.pixels()).flat_map(|i| alone.mean(i)).map(f64::to_bits).collect();
        assert_eq!(wanted.1.last(), Some(&means));
        for of in [2, 3, 7] {
            assert!(states(of).iter().all(|one| *one == wanted), "{policy:?}, {of} processes");
        }
        samples = everything();
    }
}

/// With samples in all and per pixel, two processes save once for each round: after the last one, at the end only.
#[test]
fn the_state_after_the_last_round_is_saved_once() {
    for limits in [Limits::samples(17 * 70 * 8), Limits::spp(8.0)] {
        let saved = together(2, |mut end| {
            let mut barriers = Barriers::default();
            let render = Render::new(frame(17, 70), &limits).needs(everything()).exchange(&mut end).in_bands();
            render.monitor(&mut barriers).run(&mut Field(noise), &mut adaptive(PilotPolicy::Keep)).unwrap();
            [barriers.states.len(), barriers.means.len()]
        });
        assert!(saved.iter().all(|[states, rounds]| states == rounds && *rounds > 1), "{saved:?}");
    }
}

/// A digest of bytes.
fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |sum: u64, byte| sum.wrapping_mul(0x0100_0000_01b3) ^ u64::from(*byte))
}

/// A process gets at most 4 MiB at once, and tables of 16 bytes per row and 8 per process. The negative control is the film of all.
#[test]
fn no_process_holds_the_film_of_all_at_a_barrier() {
    let (frame, limits) = (frame(256, 512), Limits::samples(256 * 512 * 2));
    let needs = everything();
    let all = Film::bytes_per_pixel(&needs) * frame.pixels();
    assert!(all > 40 << 20, "{all}");
    let run = |of: u32| {
        let found = together(of, |end| {
            let (mut barriers, mut end) = (Barriers::default(), Counted(end, 0));
            let render = Render::new(frame, &limits).needs(needs).exchange(&mut end).in_bands();
            render.monitor(&mut barriers).run(&mut Field(noise), &mut adaptive(PilotPolicy::Keep)).unwrap();
            let [piece, held, rows] = barriers.most;
            let saved = without_times(&barriers.states.pop().unwrap());
            ([piece, held, rows, end.1], digest(&saved))
        });
        assert!(found.iter().all(|one| one.1 == found[0].1));
        let most = found.iter().map(|one| one.0);
        (most.reduce(|a, b| std::array::from_fn(|k| a[k].max(b[k]))).unwrap(), found[0].1)
    };
    let ([piece, held, rows, got], four) = run(4);
    let at_once = (4 << 20) + 16 * 512 + 8 * 4;
    assert!(piece <= at_once && rows <= at_once && got <= at_once, "{piece} {rows} {got}");
    // Two rows above and below each band of 16, and shares by cost.
    assert!(held < all * 2 / 5, "{held} of {all}");
    let ([piece, held, ..], one) = run(1);
    assert!(piece >= all * 9 / 10 && held == all, "{piece} {held} {all}");
    assert!(four == one);
}

#[test]
fn a_render_with_samples_resumed_at_a_barrier_by_any_number_of_processes_is_the_same() {
    resumed_at_barriers(everything().with_samples(4).with_trajectories());
}

#[test]
#[ignore = "9 s: three kinds of films; the one with all samples is tested always"]
fn a_render_resumed_at_a_barrier_by_any_number_of_processes_is_the_same() {
    resumed_at_barriers(needs());
    resumed_at_barriers(everything().with_channels(2));
    resumed_at_barriers(everything().with_samples(4).with_trajectories());
}

/// Reads a state that process `reader` has.
fn read<'a>(state: &[u8], end: &'a mut dyn Exchange, render: Render<'a>, reader: u32) -> Result<Snapshot, Error> {
    let (mut bytes, length) = (state, state.len() as u64);
    let source = (end.share().index() == reader).then_some((&mut bytes as &mut dyn Read, length));
    render.exchange(end).read_snapshot(source, &adaptive(PilotPolicy::Keep))
}

fn resumed_at_barriers(needs: Needs) {
    let (frame, limits) = (frame(17, 70), Limits::samples(17 * 70 * 17 + 5));
    macro_rules! render {
        () => {
            Render::new(frame, &limits).needs(needs)
        };
    }
    let policy = PilotPolicy::Keep;
    let alone = all(&render!().run(&mut More::default(), &mut adaptive(policy)).unwrap());
    let states = together(3, |mut end| {
        let mut barriers = Barriers::default();
        let render = render!().exchange(&mut end).monitor(&mut barriers);
        render.run(&mut More::default(), &mut adaptive(policy)).unwrap();
        assert!(barriers.seconds.iter().all(|seconds| seconds.len() == 3));
        barriers.states
    });
    // Three of four barriers, and the end: nothing lies between it and the last barrier.
    assert_eq!(states[0].len(), 4);
    for (state, of) in states[0].iter().zip([7, 1, 2, 3]) {
        for in_pieces in [false, true] {
            let films = together(of, |mut end| {
                let snapshot = match in_pieces {
                    true => read(state, &mut end, render!(), of - 1).unwrap(),
                    false => Snapshot::from_bytes(state).unwrap(),
                };
                let render = render!().exchange(&mut end);
                render.resume(snapshot, &mut More::default(), &mut adaptive(policy)).unwrap()
            });
            assert!(films.iter().all(|film| all(film) == alone), "{of} processes, in pieces: {in_pieces}");
        }
    }
    // One process goes on without an exchange, too.
    let snapshot = Snapshot::from_bytes(&states[1][1]).unwrap();
    let film = render!().resume(snapshot, &mut More::default(), &mut adaptive(policy)).unwrap();
    assert!(all(&film) == alone);
}

/// A state before the last round, or at the end of a single one.
fn a_state(frame: Frame, limits: &Limits, needs: Needs, policy: PilotPolicy) -> Vec<u8> {
    let mut states = together(2, |mut end| {
        let mut barriers = Barriers::default();
        let render = Render::new(frame, limits).needs(needs).exchange(&mut end).in_bands().monitor(&mut barriers);
        render.run(&mut Field(noise), &mut adaptive(policy)).unwrap();
        barriers.states
    });
    let states = states.remove(0);
    states[states.len().saturating_sub(2)].clone()
}

/// Bytes of which the longest piece is known.
struct Pieces<'s>(&'s [u8], usize);

impl Read for Pieces<'_> {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        let read = self.0.read(to)?;
        self.1 = self.1.max(read);
        Ok(read)
    }
}

/// A process gets at most 4 MiB and small heads at once, and the film of its own rows. The negative control is one process.
#[test]
fn no_process_holds_the_film_of_all_when_it_resumes() {
    let (frame, limits) = (frame(256, 512), Limits::samples(256 * 512 * 2));
    let needs = everything();
    let all = Film::bytes_per_pixel(&needs) * frame.pixels();
    let state = a_state(frame, &limits, needs, PilotPolicy::Keep);
    let whole = Snapshot::from_bytes(&state).unwrap();
    let run = |of: u32| {
        together(of, |end| {
            AT_BARRIER.set(true);
            let (mut end, mut bytes) = (Counted(end, 0), Pieces(&state, 0));
            let source = (end.share().index() == 0).then_some((&mut bytes as &mut dyn Read, state.len() as u64));
            let render = Render::new(frame, &limits).needs(needs).exchange(&mut end);
            let snapshot = render.read_snapshot(source, &adaptive(PilotPolicy::Keep)).unwrap();
            assert_eq!(snapshot == whole, of == 1);
            [snapshot.film().bytes(), end.1, bytes.1]
        })
    };
    for [held, got, piece] in run(4) {
        assert!(held <= all * 26 / 100 && held > all / 5, "{held} of {all}");
        assert!(got <= (4 << 20) + 64 && piece <= 4 << 20, "{got} {piece}");
    }
    assert_eq!(run(1)[0][0], all);
}

/// Every process reports an error, and none waits for another: the one that reads with its own words, the others name it.
#[test]
fn a_state_that_is_cut_short_or_damaged_is_refused_by_all_processes() {
    let (frame, limits) = (frame(17, 70), Limits::samples(17 * 70 * 17 + 5));
    let needs = everything().with_samples(4);
    let state = a_state(frame, &limits, needs, PilotPolicy::Keep);
    let errors = |state: &[u8], of: u32| {
        together(of, |mut end| {
            let render = Render::new(frame, &limits).needs(needs);
            read(state, &mut end, render, 0).map(|_| ()).map_err(|e| e.to_string())
        })
    };
    let refused = |state: &[u8], what: &str| {
        for of in [1, 3] {
            for (rank, error) in errors(state, of).into_iter().enumerate() {
                let error = error.expect_err("it is damaged");
                assert!(error.contains(what), "rank {rank} of {of}: {error}");
            }
        }
    };
    for cut in (0..state.len()).step_by(state.len() / 40).chain([state.len() - 1]) {
        refused(&state[..cut], "they end too early");
    }
    refused(&[&state[..], b"more"].concat(), "there are bytes after the end");
    refused(&[&[7; 4096], &state[4096..]].concat(), "they start with another signature");
    // The mean of a pixel in the middle, which the second process gets.
    let film = Snapshot::from_bytes(&state).unwrap();
    let mean = film.film().half_film(0).unwrap().mean(17 * 20)[0].to_le_bytes();
    let at = state.windows(8).position(|eight| eight == mean).unwrap();
    let damaged = [&state[..at], &f64::NAN.to_le_bytes(), &state[at + 8..]].concat();
    refused(&damaged, "a mean is NaN or infinite");
    // The negative control.
    assert!(errors(&state, 3).iter().all(Result::is_ok));
}

/// Rows that another process got must not be taken for pixels without samples.
#[test]
fn a_snapshot_with_the_rows_of_another_process_is_refused() {
    let (frame, limits) = (frame(17, 70), Limits::samples(17 * 70 * 17 + 5));
    let state = a_state(frame, &limits, everything(), PilotPolicy::Keep);
    let parts = together(2, |mut end| read(&state, &mut end, Render::new(frame, &limits), 0).unwrap());
    let refused = together(2, |mut end| {
        let other = parts[1 - end.share().index() as usize].clone();
        let render = Render::new(frame, &limits).needs(everything()).exchange(&mut end);
        render.resume(other, &mut Field(noise), &mut adaptive(PilotPolicy::Keep)).unwrap_err().to_string()
    });
    let render = Render::new(frame, &limits).needs(everything());
    let alone = render.resume(parts[0].clone(), &mut Field(noise), &mut adaptive(PilotPolicy::Keep));
    for error in refused.into_iter().chain([alone.unwrap_err().to_string()]) {
        assert!(error.contains("it has the rows of another process; read it by Render::read_snapshot"), "{error}");
    }
}

#[test]
fn bands_are_dealt_anew_by_cost_without_a_change_of_bits() {
    /// The upper half of the image takes almost all of the time.
    struct Uneven;
    impl Integrator for Uneven {
        fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
            let [x, y] = draws.pixel();
            if y < 64 && x % 8 == 0 {
                std::thread::sleep(Duration::from_micros(20));
            }
            Estimate::new(noise([x, y], draws.block(dapple_core::Block::new(0))))
        }
    }
    /// Four rounds of two samples per pixel.
    fn rounds() -> impl Sampler {
        let plan = |seen: &dapple_core::Feedback<'_>, plan: &mut dapple_core::Plan| {
            plan.counts.fill(2);
            if seen.round < 4 { dapple_core::Progress::Trace } else { dapple_core::Progress::Done }
        };
        crate::common::Planned { points: Independent::new(3), needs: Needs::none(), plan }
    }
    let limits = Limits::samples(16 * 256 * 8);
    macro_rules! render {
        () => {
            Render::new(frame(16, 256), &limits)
        };
    }
    let alone = all(&render!().run(&mut Uneven, &mut rounds()).unwrap());
    let barriers = together(3, |mut end| {
        let mut barriers = Barriers::default();
        let film = render!().exchange(&mut end).monitor(&mut barriers).run(&mut Uneven, &mut rounds()).unwrap();
        assert!(all(&film) == alone);
        barriers.seconds
    });
    // Everyone hears the same seconds.
    assert!(barriers.iter().all(|seconds| seconds == &barriers[0] && seconds.len() == 4));
}
