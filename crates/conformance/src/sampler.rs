//! Conformance tests of samplers.

use crate::toys::raised;
use dapple_core::plan::{Feedback, Plan, Progress};
use dapple_core::render::{Control, Monitor, Status};
use dapple_core::{
    Block, Draws, Error, Estimate, Film, FirstHit, Frame, Integrator, Limits, Needs, Render, Sampler, Snapshot, Worker,
};

/// The rule by which a sampler spends the budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spending {
    /// The sampler spends every sample of the budget.
    Exact,
    /// The sampler stops at a threshold of its own; the budget is an upper bound.
    AtMost,
}

/// Checks a sampler that spends the budget exactly and works on frames of any size, created by `make`.
///
/// Renders synthetic scenes (black, constant, an edge, noise, fireflies, invalid samples) on frames from 1x1 up. The
/// checks are:
///
/// * the budget is spent exactly, even if it is raised later;
/// * every pixel's count lies between `min_spp` and `max_spp`, and every plan is valid;
/// * images have no NaN or infinity;
/// * images are bit-identical in a second run, and for any number of threads and [`Schedule`](dapple_core::limits::Schedule);
/// * a render resumed from any snapshot ends with a bit-identical film ([`Sampler::save`]);
/// * the sampler's description begins with the sampler's name, and does not change.
///
/// Below 16 samples per pixel a sampler may refuse with [`Error::BudgetTooSmall`](dapple_core::Error::BudgetTooSmall).
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn sampler(make: impl Fn() -> Box<dyn Sampler>) {
    sampler_on_frames(|_| make(), Spending::Exact);
}

/// Checks a sampler that stops at a threshold, created by `make`. The checks are those of [`sampler`], except that it may spend
/// less than the budget.
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn threshold_sampler(make: impl Fn() -> Box<dyn Sampler>) {
    sampler_on_frames(|_| make(), Spending::AtMost);
}

/// Checks samplers as [`sampler`] does, but `make` creates each sampler for one frame. Use it for samplers made for one frame,
/// for example from the cluster that each pixel sees.
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn sampler_on_frames(make: impl Fn(&Frame) -> Box<dyn Sampler>, spending: Spending) {
    check(&make, spending);
}

/// A function that creates samplers, as a trait object, so that the checks are compiled only once.
type Make<'a> = &'a dyn Fn(&Frame) -> Box<dyn Sampler>;

/// The frame of most checks: wider than the edge of [`Scene::Edge`], with two surfaces.
const SMALL: [u32; 2] = [11, 13];

fn check(make: Make<'_>, spending: Spending) {
    names(make);
    for size in [[1, 1], [1, 7], [9, 1], SMALL] {
        for scene in Scene::ALL {
            spends(make, spending, frame(size), scene);
        }
    }
    for scene in [Scene::Black, Scene::Edge, Scene::Firefly] {
        keeps_bounds(make, spending, frame(SMALL), scene);
        same_bits(make, frame([11, 19]), scene);
        budget_raised(make, spending, frame(SMALL), scene);
        resumes(make, frame(SMALL), scene);
    }
    crops(make, spending);
    impossible(make, frame([5, 4]));
}

/// Synthetic scenes without geometry, with values as extreme as in any real scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scene {
    Black,
    Constant,
    /// An edge: dark pixels on the left, bright ones on the right, and a partly covered column between.
    Edge,
    /// Noise whose variance grows from left to right.
    Noise,
    /// A constant image, except that one sample in 64 is 10^30.
    Firefly,
    /// Noise in which one sample in eight is NaN, infinite or negative.
    Invalid,
    /// An image in which every sample is NaN.
    AllInvalid,
}

impl Scene {
    pub(crate) const ALL: [Self; 7] =
        [Self::Black, Self::Constant, Self::Edge, Self::Noise, Self::Firefly, Self::Invalid, Self::AllInvalid];
}

impl Integrator for Scene {
    fn estimate(&self, draws: &Draws<'_>, log: &mut Worker) -> Estimate {
        let u = draws.block(Block::new(0));
        let [x, y] = draws.pixel();
        log.note(u64::from(x / 4), u[0]);
        let value = match self {
            Self::Black => 0.0,
            Self::Constant => 0.7,
            Self::Edge => f32::from(u8::from(x as f32 + u[0] > 9.3)),
            Self::Noise => 0.2 + 0.1 * x as f32 * u[1],
            Self::Firefly if u[2] < 1.0 / 64.0 => 1e30,
            Self::Firefly => 0.5,
            Self::Invalid => match (u[2] * 32.0) as u32 {
                0 => f32::NAN,
                1 => f32::INFINITY,
                2 => f32::NEG_INFINITY,
                3 => -1.0,
                _ => u[0],
            },
            Self::AllInvalid => f32::NAN,
        };
        let first_hit = (draws.wants_first_hit() && y != 2).then(|| {
            let place = [x as f32 + u[0], y as f32 + u[1], 0.0].map(|p| p * value.max(1.0));
            FirstHit::new(place, [0.0, 0.0, 1.0], (1.0 + u[0]) * value.max(1.0))
                .with_shading_normal(if x < 9 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] })
                .with_albedo([0.8, 0.5, 0.2])
                .with_footprint(1.0)
                .with_material(x / 9)
                .with_shape(x / 9)
                .with_primitive(y / 5)
        });
        let estimate = Estimate::new([value, 0.5 * value, 0.25 * value]).with_first_hit(first_hit).with_cost(1 + x % 3);
        if *self == Self::Firefly { estimate.with_indirect([0.1 * value; 3]) } else { estimate }
    }
}

pub(crate) fn frame(size: [u32; 2]) -> Frame {
    Frame::new(size[0], size[1]).expect("a frame of the checks")
}

/// All statistics of a film as 64-bit integers. If two films give equal integers, they are bit-identical except for timings.
pub fn bits(film: &Film) -> Vec<u64> {
    let record = film.record();
    let mut bits = vec![record.samples, record.rays, record.blocks, record.rejected];
    bits.extend(&record.budgets);
    bits.extend(record.rounds.iter().flat_map(|r| [r.samples, u64::from(r.kept)]));
    for i in 0..film.frame().pixels() {
        for m in [Some(film.moments(i)), film.half(0, i), film.half(1, i), Some(film.discarded(i))] {
            let m = m.unwrap_or_default();
            bits.push(m.count);
            bits.extend(m.mean.iter().chain(&m.m2).map(|v| v.to_bits()));
        }
        bits.extend(film.mean(i).map(f64::to_bits));
        // Floats print their shortest exact form, so equal text means equal bits.
        let rest = format!("{:?} {:?} {:?} {:?}", film.features(i), film.surface(i), film.first_hits(i), film.cost(i));
        bits.extend(rest.bytes().map(u64::from));
        if film.needs().feature_halves {
            bits.extend(format!("{:?}", [0, 1].map(|half| film.half_features(half, i))).bytes().map(u64::from));
        }
        let needs = film.needs();
        if needs.emission || needs.indirect {
            let of = |half| (film.emission(half, i), film.half_indirect(half, i));
            bits.extend(format!("{:?}", [0, 1].map(of)).bytes().map(u64::from));
        }
        for words in film.recorder_names().iter().filter_map(|name| film.recorded(name)) {
            for half in 0..2 {
                let lists = [words.kept(half, i), words.discarded(half, i)];
                bits.extend(lists.map(|list| list.len() as u64));
                bits.extend(lists.concat().iter().map(|word| u64::from(*word)));
            }
        }
    }
    bits.extend(format!("{:?}", film.rejected()).bytes().map(u64::from));
    bits
}

/// Runs `work` on a thread pool of `threads` threads.
///
/// # Panics
///
/// If the pool cannot be created.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
    pool.install(work)
}

fn run(sampler: &mut dyn Sampler, mut scene: Scene, frame: Frame, limits: &Limits) -> Result<Film, Error> {
    Render::new(frame, limits).run(&mut scene, sampler)
}

fn names(make: Make<'_>) {
    let one = make(&frame([19, 18]));
    let (name, description) = (one.name(), one.describe());
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    assert!(!name.is_empty() && name.chars().all(plain), "the name {name:?} is not lower case with hyphens");
    assert!(description.starts_with(name), "the description {description:?} does not begin with the name {name:?}");
    assert_eq!(description, make(&frame([19, 18])).describe(), "the sampler's description changes");
    assert_eq!(one.needs(), make(&frame([19, 18])).needs(), "the sampler's needs change");
}

/// Renders, and checks that the film is within the limits. `None` if the sampler refuses a small budget.
fn within(make: Make<'_>, spending: Spending, scene: Scene, frame: Frame, limits: &Limits, total: u64) -> Option<Film> {
    let mut sampler = make(&frame);
    let case = format!("{}, {scene:?}, {:?}, {limits:?}", sampler.describe(), frame.size());
    let film = match run(&mut *sampler, scene, frame, limits) {
        Ok(film) => film,
        Err(Error::BudgetTooSmall { .. }) if total < 16 * frame.pixels() as u64 => return None,
        Err(e) => panic!("{case}: {e}"),
    };
    is_within(&film, spending, limits, total, &case);
    Some(film)
}

/// Checks that a film's number of samples matches the budget, and that each pixel's count is within the limits.
fn is_within(film: &Film, spending: Spending, limits: &Limits, total: u64, case: &str) {
    let (frame, spent) = (film.frame(), film.record().samples);
    match spending {
        Spending::Exact => assert_eq!(spent, total, "{case}: the budget is not spent exactly"),
        Spending::AtMost => assert!(spent <= total, "{case}: {spent} samples of {total}"),
    }
    let pixels = 0..frame.pixels();
    let taken: u64 = pixels.clone().map(|i| film.count(i) + film.discarded(i).count).sum();
    assert_eq!(taken, spent, "{case}: the pixels' counts do not add up to the samples spent");
    for i in pixels {
        let count = film.count(i);
        assert!(count >= u64::from(limits.min_spp), "{case}: {count} samples in pixel {i} are below min_spp");
        assert!(count <= u64::from(limits.max_spp), "{case}: {count} samples in pixel {i} are above max_spp");
        assert!(film.mean(i).iter().all(|v| v.is_finite() && *v >= 0.0), "{case}: pixel {i} is {:?}", film.mean(i));
    }
}

fn spends(make: Make<'_>, spending: Spending, frame: Frame, scene: Scene) {
    let pixels = frame.pixels() as u64;
    for total in [pixels, pixels + 1, 2 * pixels, 5 * pixels + pixels / 2, 16 * pixels, 33 * pixels + pixels / 3] {
        let film = within(make, spending, scene, frame, &Limits::samples(total), total);
        let Some(film) = film else { continue };
        if scene == Scene::Constant {
            let off = (0..frame.pixels()).find(|&i| (film.mean(i)[0] - f64::from(0.7f32)).abs() > 1e-6);
            assert_eq!(off, None, "a pixel of a constant image has another value");
        }
    }
}

fn keeps_bounds(make: Make<'_>, spending: Spending, frame: Frame, scene: Scene) {
    let pixels = frame.pixels() as u64;
    for (min_spp, max_spp, total) in [
        (16, 16, 16 * pixels),
        (3, 21, 17 * pixels + 1),
        (13, 40, 16 * pixels),
        (17, 33, 17 * pixels),
        (1, 25, 25 * pixels),
        (0, 1000, 16 * pixels),
    ] {
        let mut limits = Limits::samples(total);
        (limits.min_spp, limits.max_spp) = (min_spp, max_spp);
        // A sampler cannot both discard samples and reach the minimum: it must refuse, or discard less. `within` checks the
        // minimum.
        within(make, spending, scene, frame, &limits, total);
    }
    // Fewer samples than pixels are possible, as the minimum is 0.
    let mut limits = Limits::samples(pixels / 3);
    limits.min_spp = 0;
    within(make, spending, scene, frame, &limits, pixels / 3);
}

fn same_bits(make: Make<'_>, frame: Frame, scene: Scene) {
    let limits = Limits::samples(21 * frame.pixels() as u64 + 5);
    let film = |threads: usize, limits: &Limits| {
        let mut sampler = make(&frame);
        let film = on_threads(threads, || run(&mut *sampler, scene, frame, limits));
        bits(&film.unwrap_or_else(|e| panic!("{}, {scene:?}: {e}", sampler.describe())))
    };
    let reference = film(1, &limits);
    assert!(film(1, &limits) == reference, "{scene:?}: a second run gives a different result");
    // The other scenes differ in their plans, not in the division of work among threads.
    let thorough = scene == Scene::Edge;
    let (threads, schedules): (&[usize], &[(u32, u32, u64)]) = match thorough {
        true => (&[2, 3, 7], &[(7, 1, 0), (16, 13, 1), (64, 0, 2), (1, 13, 0xfeed)]),
        false => (&[3], &[(1, 13, 0xfeed)]),
    };
    for &threads in threads {
        assert!(film(threads, &limits) == reference, "{scene:?}: {threads} threads give a different result than one");
    }
    for &(tile_rows, progress_spp, shuffle) in schedules {
        let mut cut = limits.clone();
        cut.schedule = dapple_core::limits::Schedule::default()
            .with_tile_rows(tile_rows)
            .with_progress_spp(progress_spp)
            .with_shuffle(shuffle);
        assert!(film(3, &cut) == reference, "{scene:?}: {:?} gives a different result", cut.schedule);
    }
}

/// A monitor that takes a snapshot after every slice and at the end.
#[derive(Default)]
struct Keeper {
    slices: Vec<Vec<u8>>,
    end: Vec<u8>,
}

impl Monitor for Keeper {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        self.slices.push(status.snapshot());
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.end = status.snapshot();
    }
}

/// Checks that a new sampler, resumed from any snapshot, ends with a bit-identical film. Also resumes the last snapshot with a
/// larger budget. The film must then be bit-identical to that of one sampler whose budget is raised.
fn resumes(make: Make<'_>, frame: Frame, scene: Scene) {
    let pixels = frame.pixels() as u64;
    let mut limits = Limits::samples(21 * pixels + 5);
    limits.schedule.progress_spp = 3;
    let (mut keeper, mut sampler) = (Keeper::default(), make(&frame));
    let case = format!("{}, {scene:?}", sampler.describe());
    let whole = Render::new(frame, &limits).monitor(&mut keeper).run(&mut { scene }, &mut *sampler);
    let whole = bits(&whole.unwrap_or_else(|e| panic!("{case}: {e}")));
    let resumed = |bytes: &[u8], limits: &Limits, threads: usize| {
        let snapshot = Snapshot::from_bytes(bytes).unwrap_or_else(|e| panic!("{case}: {e}"));
        let mut sampler = make(&frame);
        let film = on_threads(threads, || Render::new(frame, limits).resume(snapshot, &mut { scene }, &mut *sampler));
        film.unwrap_or_else(|e| panic!("{case}: it cannot be resumed: {e}"))
    };
    let unsliced = Limits::samples(21 * pixels + 5);
    // Tests every slice of one scene; in the others, every fourth slice and the end.
    let step = if scene == Scene::Edge { 1 } else { 4 };
    for (i, bytes) in keeper.slices.iter().enumerate().step_by(step).chain([(keeper.slices.len(), &keeper.end)]) {
        let film = resumed(bytes, &unsliced, 1 + i % 3);
        assert!(
            bits(&film) == whole,
            "{case}: resumed after call {i} of the monitor, it gives a different result; save() must return all state"
        );
    }
    let later = resumed(&keeper.end, &Limits::samples(43 * pixels), 2);
    let budgets = [21 * pixels + 5, 43 * pixels];
    let same = raised(&mut { scene }, &mut *make(&frame), Needs::none(), frame, &budgets);
    assert!(
        bits(&later) == bits(&same),
        "{case}: a new sampler continues differently than the one with the first budget"
    );
}

fn budget_raised(make: Make<'_>, spending: Spending, frame: Frame, scene: Scene) {
    let pixels = frame.pixels() as u64;
    let steps = [16 * pixels, 16 * pixels, 24 * pixels + 7, 24 * pixels + 7, 41 * pixels];
    let mut sampler = make(&frame);
    let film = raised(&mut { scene }, &mut *sampler, Needs::none(), frame, &steps);
    let case = format!("{}, {scene:?}, raised to {}", sampler.describe(), steps[4]);
    is_within(&film, spending, &Limits::samples(steps[4]), steps[4], &case);
}

/// Checks that counts refer to the pixels of the window, not of the full frame.
fn crops(make: Make<'_>, spending: Spending) {
    let window = frame([40, 30]).crop(7, 3, 20, 8).expect("a window of the checks");
    let total = 19 * window.pixels() as u64;
    within(make, spending, Scene::Noise, window, &Limits::samples(total), total);
}

/// Checks that a budget that is too small gives an error, or a plan with at most as many samples as are left.
fn impossible(make: Make<'_>, frame: Frame) {
    for (total, min_spp) in [(0, 1), (1, 1), (19, 1), (79, 4)] {
        let mut sampler = make(&frame);
        let film = Film::with_recorders(frame, sampler.needs(), sampler.recorders());
        let budget = dapple_core::plan::BudgetLeft::new(total).with_min_spp(min_spp);
        let mut plan = Plan::empty(frame.pixels());
        let answer = sampler.next_round(&Feedback::new(0, &film, budget), &mut plan);
        if matches!(answer, Ok(Progress::Trace)) {
            let planned = plan.total();
            assert!(planned <= total, "{}: a plan of {planned} samples with {total} left", sampler.describe());
        }
        let mut limits = Limits::samples(total);
        limits.min_spp = min_spp;
        let refused = run(&mut *make(&frame), Scene::Noise, frame, &limits);
        assert!(matches!(refused, Err(Error::BudgetTooSmall { .. })), "a budget of {total} samples is not refused");
    }
}
