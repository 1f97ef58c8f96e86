//! A sampler with a statistic that nobody else has: it reaches every way of rendering through its recorder alone.

use crate::test_scenes::{Field, frame};
use dapple_core::{
    Block, Error, Feedback, Film, Frame, Integrator, Limits, Methods, Plan, PointSet, Progress, Readiness,
    RecordedSample, Recorder, Render, Sampler, Session, Snapshot, TracedRows, luminance,
};
use dapple_low_discrepancy::Random;
use std::sync::Arc;

/// The recorder of a histogram: the number of a pixel's samples in each of some ranges of luminance.
struct Histogram;

const BINS: usize = 16;

impl Recorder for Histogram {
    fn name(&self) -> &str {
        "histogram of luminance"
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        words.resize(BINS, 0);
        let level = luminance(sample.radiance.map(f64::from));
        words[((level * BINS as f64) as usize).min(BINS - 1)] += 1;
    }

    fn bytes(&self, _: u64) -> u64 {
        4 * BINS as u64
    }
}

/// Four samples per pixel, and then in each of three rounds one for each range that a pixel's samples lie in.
struct Ranges(Random);

impl Sampler for Ranges {
    fn name(&self) -> &str {
        "ranges"
    }

    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        vec![Arc::new(Histogram)]
    }

    fn points(&self) -> &dyn PointSet {
        &self.0
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        let missing = || Error::NotRecorded { who: self.name().into(), what: "a histogram" };
        let recorded = seen.film.recorded(Histogram.name()).ok_or_else(missing)?;
        let ranges = |i: usize| recorded.kept(0, i).iter().filter(|&&count| count > 0).count() as u32;
        plan.counts.iter_mut().enumerate().for_each(|(i, count)| *count = if seen.round == 0 { 4 } else { ranges(i) });
        Ok(if seen.round < 4 { Progress::Trace } else { Progress::Done })
    }
}

/// Noise that grows from left to right.
fn scene() -> Field<impl Fn([u32; 2], [f32; 4]) -> [f32; 3] + Sync> {
    Field(|[x, _]: [u32; 2], u: [f32; 4]| [0.1 + 0.9 * u[0] * x as f32 / 13.0; 3])
}

fn words(film: &Film) -> Vec<Vec<u32>> {
    let recorded = film.recorded(Histogram.name()).expect("the sampler's recorder");
    (0..film.frame().pixels()).map(|i| recorded.kept(0, i).to_vec()).collect()
}

fn methods() -> Methods<'static> {
    Methods::from(Ranges(Random::new(3)))
}

/// The film of a render without interruption.
fn whole(frame: Frame, limits: &Limits) -> Film {
    Render::new(frame, limits).run(&mut scene(), &mut Ranges(Random::new(3))).expect("a render")
}

const SIZE: [u32; 2] = [13, 40];

#[test]
fn the_statistic_of_a_sampler_decides_its_counts() {
    let (frame, limits) = (frame(SIZE[0], SIZE[1]), Limits::spp(99.0));
    let film = whole(frame, &limits);
    for (i, words) in words(&film).iter().enumerate() {
        assert_eq!(words.iter().copied().map(u64::from).sum::<u64>(), film.count(i));
    }
    let column = |x: usize| (0..40).map(|y| film.count(13 * y + x)).sum::<u64>();
    assert!(column(12) > 2 * column(0), "{} and {}", column(0), column(12));
}

#[test]
fn it_has_the_same_words_in_tiles_and_after_snapshots() {
    let (frame, limits) = (frame(SIZE[0], SIZE[1]), Limits::spp(99.0));
    let film = whole(frame, &limits);
    let mut session = Session::new(frame, limits.clone(), methods()).expect("a session").with_tile_side(7);
    let mut resumed = 0;
    while let Some(round) = session.next_round().expect("a plan") {
        for _ in 0..2 {
            let Some(mut tile) = round.next_tile() else { break };
            let samples: Vec<_> = tile.samples().collect();
            for sample in samples.iter().rev() {
                tile.add(sample, scene().0(sample.pixel(), sample.block(Block::new(0))));
            }
            round.submit(tile).expect("a tile of this round");
        }
        let snapshot = Snapshot::from_bytes(&session.snapshot()).expect("its own bytes");
        session = Session::resume(frame, limits.clone(), methods(), snapshot).expect("its own state").with_tile_side(7);
        resumed += 1;
    }
    let found = session.into_film();
    assert!(resumed > 10 && found.counts() == film.counts() && words(&found) == words(&film));
}

#[test]
fn it_has_the_same_words_if_rows_are_traced_apart() {
    let (frame, limits) = (frame(SIZE[0], SIZE[1]), Limits::spp(99.0));
    let film = whole(frame, &limits);
    let mut integrator: Box<dyn Integrator> = Box::new(scene());
    let mut session = Session::new(frame, limits.clone(), methods()).expect("a session");
    let mut apart = 0;
    while let Some(stage) = session.next_stage(&*integrator).expect("a plan") {
        // Rows come back in the order of the last machine first.
        for rows in session.deal(&stage, 3).into_iter().rev() {
            let bytes = session.rows_of(&stage, rows).expect("rows of the stage");
            let render = Render::new(frame, &limits);
            let traced =
                render.trace_rows(&bytes, &mut Readiness::default(), &mut scene(), &mut Ranges(Random::new(3)));
            let bytes = traced.expect("its rows").expect("nothing stops it");
            session.join(&stage, TracedRows::from_bytes(&bytes).expect("its own bytes")).expect("rows of the stage");
            apart += 1;
        }
        session.end_stage(&stage, &mut *integrator).expect("a plan");
    }
    let found = session.into_film();
    assert!(apart > 8 && found.counts() == film.counts() && words(&found) == words(&film));
}
