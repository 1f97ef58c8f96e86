//! Statistics that a method records for itself.

use crate::common::*;
use dapple_core::film::{RecordedSample, Recorder};
use dapple_core::limits::Schedule;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::{
    Draws, Error, Film, Filter, Filtered, Limits, Methods, Needs, PointSet, Render, SampleId, Sampler, Session,
    Unfiltered,
};
use std::sync::Arc;

/// Records the number and the red of each sample, or of the first ones. A render makes room for all of them before.
struct Reds {
    name: String,
    first: u64,
    is_traced: bool,
}

impl Recorder for Reds {
    fn name(&self) -> &str {
        &self.name
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        assert!(sample.estimate.radiance[0].to_bits() == sample.radiance[0].to_bits() || sample.radiance == [0.0; 3]);
        if sample.count <= self.first {
            let fits = words.len() + 2 <= words.capacity();
            assert!(fits || !self.is_traced, "no room is made for sample {}", sample.count);
            words.extend([sample.count as u32, sample.radiance[0].to_bits()]);
        }
    }

    fn reserve(&self, words: &mut Vec<u32>, more: u64) {
        let there = words.len() as u64 / 2;
        words.reserve_exact(2 * (there + more).min(self.first).saturating_sub(there) as usize);
    }

    fn bytes(&self, samples: u64) -> u64 {
        8 * samples.min(self.first)
    }
}

pub(crate) fn reds(first: u64) -> Arc<dyn Recorder> {
    Arc::new(Reds { name: format!("reds:first={first}"), first, is_traced: true })
}

fn recorders() -> Vec<Arc<dyn Recorder>> {
    // The second one of a name is left out.
    vec![reds(u64::MAX), reds(3), reds(3)]
}

/// Noise with invalid samples.
fn faulty(pixel: [u32; 2], u: [f32; 4]) -> [f32; 3] {
    if u[3] < 0.1 { [-1.0, 2.0, 3.0] } else { noise(pixel, u) }
}

/// Two halves or one: discarded samples or withdrawn ones, and counts for each half.
fn rounds(needs: Needs, withdraws: bool) -> impl Sampler {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        let some = |salt: u64| (0..seen.pixels() as u64).map(move |i| (mix(i ^ salt << 32) % 4) as u32);
        plan.counts = some(seen.round.into()).map(|n| n + 1).collect();
        match seen.round {
            0 if !withdraws => plan.retention = Retention::Discard,
            0 | 3 => {}
            1 if needs.halves => plan.second_half = Some(some(9).collect()),
            1 => {}
            2 => plan.withdraw = withdraws.then(|| some(5).map(|n| n == 0).collect()),
            _ => return Progress::Done,
        }
        Progress::Trace
    };
    ToySampler { points: Independent::new(4), needs, plan }
}

fn cases() -> impl Iterator<Item = (Needs, bool)> {
    [Needs::none(), Needs::none().with_halves()].into_iter().flat_map(|needs| [(needs, false), (needs, true)])
}

const SIZE: [u32; 2] = [13, 21];

fn limits() -> Limits {
    Limits::samples(9999).with_schedule(Schedule::default().with_progress_spp(2))
}

fn rendered((needs, withdraws): (Needs, bool), limits: &Limits) -> Film {
    let render = Render::new(frame(SIZE[0], SIZE[1]), limits).recorders(recorders());
    render.run(&mut Field(faulty), &mut rounds(needs, withdraws)).unwrap()
}

/// The words that a recorder of all reds has of these samples of a pixel.
fn words(film: &Film, i: usize, ids: impl Iterator<Item = SampleId>) -> Vec<u32> {
    let red = |id| faulty(film.frame().pixel(i), Independent::new(4).block(id, 0))[0].max(0.0);
    (1..).zip(ids).flat_map(|(count, id)| [count, red(id).to_bits()]).collect()
}

#[test]
fn words_are_those_of_the_samples_in_order() {
    for case in cases() {
        let film = rendered(case, &limits());
        assert_eq!(film.recorder_names(), ["reds:first=18446744073709551615", "reds:first=3"]);
        let [all, three] = [u64::MAX, 3].map(|first| film.recorded(&format!("reds:first={first}")).unwrap());
        let halves = if case.0.halves { 2 } else { 1 };
        let (mut kept, mut apart) = (0, 0);
        for (i, half) in (0..film.frame().pixels()).flat_map(|i| (0..halves).map(move |half| (i, half))) {
            let words_of = |ids: Vec<_>| words(&film, i, ids.into_iter());
            let count = all.kept(half, i).len() / 2;
            assert_eq!(all.kept(half, i), words_of((0..count).map(|n| film.sample_id(half, i, n)).collect()));
            assert_eq!(three.kept(half, i), &all.kept(half, i)[..2 * count.min(3)]);
            let discarded = all.discarded(half, i);
            assert_eq!(three.discarded(half, i), &discarded[..discarded.len().min(6)]);
            (kept, apart) = (kept + count as u64, apart + discarded.len() as u64 / 2);
        }
        assert_eq!(kept, film.counts().iter().sum::<u64>());
        assert_eq!(apart, (0..film.frame().pixels()).map(|i| film.discarded(i).count).sum::<u64>());
        assert!(apart > 0 && film.record().rejected > 100);
        // The film of one half has its words.
        if case.0.halves {
            let half = film.half_film(1).unwrap();
            let own = half.recorded("reds:first=3").unwrap();
            assert!((0..film.frame().pixels()).all(|i| own.kept(0, i) == three.kept(1, i)));
        }
    }
}

#[test]
fn words_depend_on_no_threads_tiles_or_slices() {
    for case in cases() {
        let whole = bits(&rendered(case, &limits()));
        for i in 0..4 {
            let limits = limits().with_schedule(cut(i));
            assert!(bits(&on_threads(1 + i, || rendered(case, &limits))) == whole, "{case:?}, cut {i}");
        }
        // Recorders change no other bit.
        let without =
            Render::new(frame(SIZE[0], SIZE[1]), &limits()).run(&mut Field(faulty), &mut rounds(case.0, case.1));
        let (without, with) = (without.unwrap(), rendered(case, &limits()));
        assert!(with.image() == without.image() && with.counts() == without.counts());
        assert!(without.recorded("reds:first=3").is_none() && bits(&without) != whole);
    }
}

#[test]
fn sessions_and_resumed_renders_have_the_words_of_a_render() {
    for (needs, withdraws) in cases() {
        let (frame, limits) = (frame(SIZE[0], SIZE[1]), limits());
        let whole = bits(&rendered((needs, withdraws), &limits));
        let methods = || Methods::from(rounds(needs, withdraws)).with_recorders(recorders());
        let mut session = Session::new(frame, limits.clone(), methods()).unwrap().with_tile_side(5);
        let mut tiles = 0;
        while let Some(round) = session.next_round().unwrap() {
            for _ in 0..4 {
                let Some(mut tile) = round.next_tile() else { break };
                let samples: Vec<Draws<'_>> = tile.samples().collect();
                samples.iter().rev().for_each(|draws| tile.add(draws, faulty(draws.pixel(), numbers(draws))));
                round.submit(tile).unwrap();
                tiles += 1;
            }
            drop(round);
            let kept = snapshot(&session.snapshot());
            session = Session::resume(frame, limits.clone(), methods(), kept).unwrap().with_tile_side(5);
        }
        let film = session.into_film();
        assert!(tiles > 40 && recorded(&film) == recorded(&rendered((needs, withdraws), &limits)));
        let mut keeper = Keeper::default();
        let render = Render::new(frame, &limits).recorders(recorders()).monitor(&mut keeper);
        render.run(&mut Field(faulty), &mut rounds(needs, withdraws)).unwrap();
        for kept in keeper.all() {
            // In another order.
            let render = Render::new(frame, &limits).recorders(recorders().into_iter().rev().collect());
            let film = render.resume(kept, &mut Field(faulty), &mut rounds(needs, withdraws)).unwrap();
            assert!(bits(&film) == whole);
        }
    }
}

/// All words of a film.
fn recorded(film: &Film) -> Vec<Vec<u32>> {
    let of = |name: &String| {
        let words = film.recorded(name).unwrap();
        let places = (0..film.frame().pixels()).flat_map(|i| [(0, i), (1, i)]);
        places
            .flat_map(|(half, i)| [words.kept(half, i).to_vec(), words.discarded(half, i).to_vec()])
            .collect::<Vec<_>>()
    };
    film.recorder_names().iter().flat_map(of).collect()
}

#[test]
fn a_render_with_other_recorders_is_not_resumed() {
    let (frame, limits, mut keeper) = (frame(5, 4), limits(), Keeper::default());
    let make = || rounds(Needs::none(), false);
    let render = Render::new(frame, &limits).recorders(recorders()).monitor(&mut keeper);
    render.run(&mut Field(faulty), &mut make()).unwrap();
    let bare = Render::new(frame, &limits).monitor(&mut keeper);
    bare.run(&mut Field(faulty), &mut make()).unwrap();
    let resume = |bytes: &[u8], recorders| {
        let render = Render::new(frame, &limits).recorders(recorders);
        render.resume(snapshot(bytes), &mut Field(faulty), &mut make()).map(|film| bits(&film))
    };
    let [with, without] = [&keeper.slices[0], &keeper.end];
    let mut more = recorders();
    more.push(reds(4));
    for (bytes, recorders) in
        [(with, vec![]), (with, vec![reds(3)]), (with, more), (with, vec![reds(3), reds(4)]), (without, vec![reds(3)])]
    {
        let refused = resume(bytes, recorders).unwrap_err();
        assert!(matches!(refused, Error::OtherRender { .. }), "{refused}");
        assert!(refused.to_string().contains("its recorders are"), "{refused}");
    }
    assert!(resume(with, recorders()).is_ok() && resume(without, vec![]).is_ok());
}

/// A film that samples are pushed to.
#[test]
fn films_filled_by_hand_record_words() {
    let needs = Needs::none().with_halves();
    let reds: Arc<dyn Recorder> = Arc::new(Reds { name: "reds".into(), first: 2, is_traced: false });
    let mut film = Film::with_recorders(frame(2, 1), needs, [reds]);
    for (half, red) in [(0, 1.0), (1, 2.0), (0, f32::NAN), (0, 4.0)] {
        film.push(1, half, [red; 3]);
    }
    let words = film.recorded("reds").unwrap();
    assert_eq!((words.kept(0, 1), words.kept(1, 1)), (&[1, 1_f32.to_bits(), 2, 0][..], &[1, 2_f32.to_bits()][..]));
    assert!(words.kept(0, 0).is_empty() && words.discarded(1, 1).is_empty());
    assert_eq!(film.of_rows(0..1).unwrap().recorded("reds").unwrap().kept(1, 1), words.kept(1, 1));
}

/// A sampler and a filter that record for themselves.
struct Recording<M>(M, u64);

impl<S: Sampler> Sampler for Recording<S> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn points(&self) -> &dyn PointSet {
        self.0.points()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        vec![reds(self.1)]
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        self.0.next_round(seen, plan)
    }
}

impl Filter for Recording<Unfiltered> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn needs(&self) -> Needs {
        Needs::none().with_halves()
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        vec![reds(self.1)]
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        self.0.apply(film)
    }
}

#[test]
fn films_have_the_recorders_of_sampler_and_filter() {
    let (frame, filter) = (frame(7, 5), Recording(Unfiltered, 5));
    let sampler = || Recording(uniform(1), 3);
    let names = |film: &Film| film.recorder_names().to_vec();
    let alone = run(&mut Field(noise), &mut sampler(), Needs::none(), frame, &Limits::spp(4.0)).unwrap();
    assert_eq!(names(&alone), ["reds:first=3"]);
    // A filter's recorders are those of a session, and of a render whose error limit concerns its image.
    let session = Session::new(frame, Limits::spp(4.0), (sampler(), Recording(Unfiltered, 5))).unwrap();
    let mut both = names(session.film());
    both.sort();
    assert_eq!(both, ["reds:first=3", "reds:first=5"]);
    for (limits, count) in [(Limits::spp(4.0), 1), (Limits::error(1e-9, 350), 2)] {
        let film = Render::new(frame, &limits).error_of(&filter).run(&mut Field(noise), &mut sampler()).unwrap();
        assert_eq!(names(&film).len(), count);
    }
}
