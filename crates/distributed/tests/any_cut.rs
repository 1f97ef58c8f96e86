//! Any cut of the rows at any stage, by any number of processes, gives the film of one machine.

use dapple_adaptive::{Adaptive, PilotPolicy, VarianceOptions};
use dapple_conformance::toys::{Independent, ToyFilter, ToySampler};
use dapple_conformance::{bits, on_threads};
use dapple_core::film::{RecordedSample, Recorder};
use dapple_core::integrator::{Pass, PreparationCost, Prepares, TrainingData};
use dapple_core::limits::Schedule;
use dapple_core::plan::{Feedback, Plan, Progress, Retention};
use dapple_core::point_set::mix;
use dapple_core::render::{Control, Monitor, NoMonitor, Readiness, Status, TracedRows};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Clock, Draws, Error, Estimate, Film, Filter, Filtered, FirstHit, Frame, Integrator, InvalidSample, Limits,
    Methods, Needs, Render, Sampler, Session, Snapshot, Worker,
};
use dapple_distributed::{Processes, coordinate, local, serve};
use std::sync::Arc;
use std::time::Duration;

/// The film of a render that process 0 runs.
fn film_of(
    mut session: Session<'_>,
    integrator: &mut dyn Integrator,
    first: &mut dyn Processes,
    monitor: &mut dyn Monitor,
    stop: &mut dyn FnMut() -> bool,
) -> Result<Film, Error> {
    coordinate(&mut session, integrator, first, monitor, stop)?;
    Ok(session.into_film())
}

/// An edge under noise and invalid samples, with a light whose strength is learned in training passes or prepared, and splats.
#[derive(Clone, Default)]
struct Toy {
    passes: usize,
    learned: Vec<f64>,
    prepares: Prepares,
    prepared: f32,
    preparations: u32,
    splats: bool,
    /// The sample of pixel (3, 20) that panics.
    panics: Option<u64>,
    /// Microseconds of a sample in the first column.
    sleeps: u64,
}

impl Integrator for Toy {
    fn needs(&self) -> Needs {
        if self.splats { Needs::none().with_splats() } else { Needs::none() }
    }

    fn wants_training(&self) -> bool {
        self.learned.len() < self.passes
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.learned.push(pass.entries().iter().map(|entry| entry.sum).sum());
    }

    fn prepares(&self) -> Prepares {
        self.prepares
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let light = (0..10).map(|path| pass.draws(path).block(Block::new(0))[0]).sum::<f32>();
        self.prepared = 0.1 * light + pass.frame.size()[1] as f32;
        self.preparations += 1;
        PreparationCost { rays: 10 }
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.trace(draws, &mut Worker::default()))
    }

    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        assert!(draws.pixel() != [3, 20] || self.panics != Some(draws.id().index), "a broken triangle");
        if draws.pixel()[0] == 0 && self.sleeps > 0 {
            std::thread::sleep(Duration::from_micros(self.sleeps));
        }
        self.trace(draws, worker)
    }
}

impl Toy {
    fn trace(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        let ([u, v, w, t], [x, y]) = (draws.block(Block::new(0)), draws.pixel());
        let lit = f32::from(u8::from(x as f32 + u > 0.3 * y as f32));
        worker.note(u64::from(x / 3), u * lit);
        let learned = 1.0 + self.learned.iter().sum::<f64>() as f32 * 1e-3;
        if self.splats && w < 0.2 {
            worker.splat([(x * 7 + y) % 20, (y * 5 + x) % 50], [0.1 * v, 0.1, if t < 0.01 { f32::NAN } else { 0.1 }]);
        }
        let hit =
            (lit > 0.0).then(|| FirstHit::new([x as f32, y as f32, u], [0.0, 0.0, 1.0], 1.0 + v).with_albedo([v; 3]));
        let red = if t < 0.02 { -1.0 } else { lit * (0.5 + v) * learned + self.prepared };
        Estimate::new([red, u * v, 0.1]).with_first_hit(hit).with_emission([0.1 * v; 3]).with_cost(1 + x % 2)
    }
}

/// Rounds of every kind, with counts for each half: with discarded samples before, or after withdrawals.
fn every_kind(withdraws: bool) -> Box<dyn Sampler> {
    let plan = move |seen: &Feedback<'_>, plan: &mut Plan| {
        let some = |salt: u64| (0..seen.pixels() as u64).map(move |i| (mix(i ^ salt << 32) % 5) as u32);
        plan.counts = some(seen.round.into()).map(|n| n + 1).collect();
        match seen.round {
            0 if !withdraws => plan.retention = Retention::Discard,
            4 if withdraws => plan.retention = Retention::Discard,
            0 | 1 | 4 | 5 => {}
            2 => plan.second_half = Some(some(9).collect()),
            3 => plan.withdraw = withdraws.then(|| some(11).map(|n| n == 0).collect()),
            _ => return Progress::Done,
        }
        Progress::Trace
    };
    Box::new(ToySampler { points: Independent::new(7), needs: needs(), plan })
}

fn points() -> Independent {
    Independent::new(3)
}

fn by_variance(policy: PilotPolicy) -> Box<dyn Sampler> {
    Box::new(Adaptive::variance_with_options(points(), VarianceOptions::default().policy(policy)).unwrap())
}

type Make = fn() -> Box<dyn Sampler>;

const UNIFORM: Make = || Box::new(Uniform::new(points()));
const ADAPTIVE: Make = || Box::new(Adaptive::new(points()));
const SAMPLERS: [Make; 6] = [
    UNIFORM,
    ADAPTIVE,
    || by_variance(PilotPolicy::Keep),
    || by_variance(PilotPolicy::Cross),
    || every_kind(false),
    || every_kind(true),
];

fn needs() -> Needs {
    Needs::none().with_feature_halves().with_variance().with_first_hits(2).with_cost().with_emission()
}

/// All green samples.
struct Greens;

impl Recorder for Greens {
    fn name(&self) -> &str {
        "greens"
    }

    fn record(&self, words: &mut Vec<u32>, sample: &RecordedSample<'_>) {
        words.extend([sample.count as u32, sample.radiance[1].to_bits()]);
    }

    fn bytes(&self, samples: u64) -> u64 {
        8 * samples
    }
}

fn recorders() -> Vec<Arc<dyn Recorder>> {
    vec![Arc::new(Greens)]
}

/// Means over three rows and three columns, with an estimate of their error.
fn blur() -> impl Filter {
    let apply = |film: &Film| {
        let [width, height] = film.frame().size().map(|n| n as usize);
        let (image, errors) = (film.image(), film.squared_errors().unwrap());
        let near = |i: usize| {
            let (x, y) = (i % width, i / width);
            (0..9).map(move |k| (y + k / 3 + height - 1) % height * width + (x + k % 3 + width - 1) % width)
        };
        let mean = |i: usize| std::array::from_fn(|c| near(i).map(|j| image[j][c]).sum::<f32>() / 9.0);
        let error = (0..image.len()).map(|i| near(i).map(|j| errors[j]).sum::<f32>() / 81.0).collect::<Vec<_>>();
        Filtered::new(film.frame().size(), (0..image.len()).map(mean).collect()).with_error(Some(error))
    };
    ToyFilter { name: "blur", needs: Needs::none().with_halves(), apply }
}

/// A render and its methods, made anew for each process.
struct Project {
    frame: Frame,
    limits: Limits,
    toy: Toy,
    sampler: Make,
    /// True if an error limit concerns the image of [`blur`].
    is_filtered: bool,
}

impl Project {
    fn new(toy: Toy, sampler: Make, limits: Limits) -> Self {
        let frame = Frame::new(20, 60).unwrap().crop(0, 3, 20, 53).unwrap();
        Self { frame, limits, toy, sampler, is_filtered: false }
    }

    fn render(&self) -> Render<'_> {
        let filtered = if self.is_filtered { blur().needs() } else { Needs::none() };
        let needs = needs().and(self.toy.needs()).and(filtered);
        Render::new(self.frame, &self.limits).needs(needs).recorders(recorders())
    }

    /// The film of one machine, which begins anew or goes on.
    fn alone(&self, from: Option<&[u8]>, monitor: &mut dyn Monitor) -> Film {
        let (filter, mut toy, mut sampler) = (blur(), self.toy.clone(), (self.sampler)());
        let render = self.render().monitor(monitor);
        let render = if self.is_filtered { render.error_of(&filter) } else { render };
        match from {
            None => render.run(&mut toy, &mut sampler),
            Some(bytes) => render.resume(Snapshot::from_bytes(bytes).unwrap(), &mut toy, &mut sampler),
        }
        .unwrap()
    }

    fn session(&self, from: Option<&[u8]>) -> Session<'static> {
        let methods = Methods::from((self.sampler)()).with_needs(needs().and(self.toy.needs()));
        let methods = methods.with_recorders(recorders());
        let methods = if self.is_filtered { methods.with_filter(blur()) } else { methods };
        let session = match from {
            None => Session::new(self.frame, self.limits.clone(), methods).unwrap(),
            Some(bytes) => {
                let snapshot = Snapshot::from_bytes(bytes).unwrap();
                Session::resume(self.frame, self.limits.clone(), methods, snapshot).unwrap()
            }
        };
        session.with_clock(Clock::of_machine())
    }

    /// Serves with a project of its own.
    fn serve(&self, end: &mut dyn dapple_distributed::Processes) {
        let (mut toy, mut sampler, mut ready) = (self.toy.clone(), (self.sampler)(), Readiness::default());
        serve(|rows| self.render().trace_rows(rows, &mut ready, &mut toy, &mut sampler), end).unwrap();
    }

    /// The film of some processes, whose others trace `theirs`.
    fn with(&self, theirs: &[Project], from: Option<&[u8]>, monitor: &mut dyn Monitor) -> Result<Film, Error> {
        let mut ends = local(1 + theirs.len() as u32).into_iter();
        let mut first = ends.next().unwrap();
        std::thread::scope(|threads| {
            for (mut end, project) in ends.zip(theirs) {
                threads.spawn(move || project.serve(&mut end));
            }
            film_of(self.session(from), &mut self.toy.clone(), &mut first, monitor, &mut || false)
        })
    }

    /// The film of so many processes.
    fn together(&self, size: u32, from: Option<&[u8]>, monitor: &mut dyn Monitor) -> Film {
        let same = || Project { limits: self.limits.clone(), toy: self.toy.clone(), ..*self };
        self.with(&(1..size).map(|_| same()).collect::<Vec<_>>(), from, monitor).unwrap()
    }
}

/// Keeps a snapshot of every stage or slice, and of the end.
#[derive(Default)]
struct Keeper(Vec<Vec<u8>>);

impl Monitor for Keeper {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        self.0.push(status.snapshot());
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.0.push(status.snapshot());
    }
}

/// Toys that learn in some passes, or prepare, and splat or not.
fn toys() -> Vec<Toy> {
    let learning = |passes, splats| Toy { passes, splats, ..Toy::default() };
    let preparing = |prepares| Toy { prepares, ..Toy::default() };
    let both = Toy { prepares: Prepares::EveryPass, ..learning(2, true) };
    vec![learning(0, false), learning(9, false), preparing(Prepares::Once), preparing(Prepares::EveryPass), both]
}

#[test]
fn processes_have_the_film_of_one_machine() {
    for (case, sampler) in SAMPLERS.into_iter().enumerate() {
        for (number, toy) in toys().into_iter().enumerate() {
            let project = Project::new(toy, sampler, Limits::spp(24.0));
            let whole = project.alone(None, &mut NoMonitor);
            assert!(whole.record().rejected > 100);
            // Each sampler and each toy meets each number.
            for size in [[1, 3], [2, 7]][(case + number) % 2] {
                let film = project.together(size, None, &mut NoMonitor);
                assert!(bits(&film) == bits(&whole), "sampler {case}, toy {number}, {size} processes");
                assert_eq!(film.image(), whole.image(), "splats");
                let of = |film: &Film| (film.record().passes, film.record().prepare_rays);
                assert_eq!(of(&film), of(&whole), "sampler {case}, toy {number}, {size} processes");
            }
        }
    }
}

/// Parts as files: each stage is planned, dealt, traced and joined by programs that know nothing but bytes.
#[test]
fn stages_from_bytes_have_the_film_of_one_machine_whatever_the_number_of_parts() {
    for (case, sampler) in SAMPLERS.into_iter().enumerate() {
        let project = Project::new(Toy { passes: 2, ..Toy::default() }, sampler, Limits::spp(24.0));
        let whole = project.alone(None, &mut NoMonitor);
        let mut plan = project.session(None).snapshot();
        for parts in [3, 1, 4, 2, 5, 2, 2, 3, 1, 1, 2, 2].into_iter().cycle() {
            let (mut planner, mut planning) = (project.toy.clone(), project.session(Some(&plan)));
            planning.teach(&mut planner);
            let Some(stage) = planning.next_stage(&planner).unwrap() else {
                assert!(bits(&planning.into_film()) == bits(&whole), "sampler {case}");
                break;
            };
            let runs = planning.deal(&stage, parts);
            assert_eq!(runs.first().map(|run| run.start), Some(stage.rows().start));
            assert!(runs.len() <= parts as usize && runs.windows(2).all(|two| two[0].end == two[1].start));
            assert_eq!(runs.last().map(|run| run.end), Some(stage.rows().end));
            for rows in runs.iter().rev() {
                let task = planning.rows_of(&stage, rows.clone()).unwrap();
                let (mut toy, mut sampler) = (project.toy.clone(), sampler());
                let traced = project
                    .render()
                    .trace_rows(&task, &mut Readiness::default(), &mut toy, &mut sampler)
                    .unwrap()
                    .unwrap();
                assert_eq!(planning.join(&stage, TracedRows::from_bytes(&traced).unwrap()).unwrap(), *rows);
            }
            planning.end_stage(&stage, &mut planner).unwrap();
            plan = planning.snapshot();
        }
    }
}

#[test]
fn a_state_at_a_stage_s_end_is_resumed_by_any_number_of_processes() {
    for (case, sampler) in SAMPLERS.into_iter().enumerate() {
        for (number, toy) in toys().into_iter().enumerate().skip(case % 2).step_by(2) {
            let project = Project::new(toy, sampler, Limits::spp(24.0));
            let mut keeper = Keeper::default();
            let whole = bits(&project.together(3, None, &mut keeper));
            for (k, state) in keeper.0.iter().enumerate() {
                let resumed = match k % 2 {
                    0 => project.alone(Some(state), &mut NoMonitor),
                    _ => project.together(2, Some(state), &mut NoMonitor),
                };
                assert!(bits(&resumed) == whole, "sampler {case}, toy {number}, state {k}");
            }
        }
    }
}

/// Slices go by rows where a sample of each pixel takes long.
#[test]
fn a_render_interrupted_within_a_pass_is_resumed_by_several_processes() {
    for (number, toy) in toys().into_iter().enumerate() {
        let frame = Frame::new(90, 50).unwrap();
        let project = Project { frame, ..Project::new(toy, ADAPTIVE, Limits::spp(8.0)) };
        let mut keeper = Keeper::default();
        let whole = project.alone(None, &mut keeper);
        // Some states within passes, and the one after the last sample of the first round.
        let samples = |state: &[u8]| Snapshot::from_bytes(state).unwrap().film().record().samples;
        let within = keeper.0.iter().filter(|state| !samples(state).is_multiple_of(4500)).step_by(5);
        let round = keeper.0.iter().filter(|state| samples(state) == 4 * 4500);
        let states: Vec<_> = within.chain(round).collect();
        assert!(states.len() > 2, "{}", states.len());
        for (k, state) in states.into_iter().enumerate() {
            let film = project.together(2, Some(state), &mut NoMonitor);
            assert!(bits(&film) == bits(&whole), "toy {number}, state {k}");
            assert_eq!(film.record().passes, whole.record().passes, "toy {number}, state {k}");
        }
    }
}

#[test]
fn a_coordinator_that_prepares_once_does_so_for_all_its_stages() {
    let project = Project::new(Toy { prepares: Prepares::Once, ..Toy::default() }, ADAPTIVE, Limits::spp(9.0));
    let (mut first, mut toy) = (local(1).remove(0), project.toy.clone());
    let film = film_of(project.session(None), &mut toy, &mut first, &mut NoMonitor, &mut || false).unwrap();
    assert!(film.record().rounds.len() > 1 && toy.preparations == 1, "{}", toy.preparations);
}

#[test]
fn a_limit_of_time_is_that_of_the_first_process() {
    let toy = |sleeps| Toy { sleeps, passes: 2, ..Toy::default() };
    let project = |sleeps, limits| Project::new(toy(sleeps), ADAPTIVE, limits);
    let theirs = [project(150, Limits::seconds(77.0)), project(250, Limits::seconds(77.0))];
    let film = project(50, Limits::seconds(0.3)).with(&theirs, None, &mut NoMonitor).unwrap();
    assert!(film.record().rounds.len() > 1 && !film.record().interrupted);
    let (mut again, mut keeper) = (None, Keeper::default());
    for total in &film.record().budgets {
        let from = keeper.0.pop();
        again = Some(project(0, Limits::samples(*total)).alone(from.as_deref(), &mut keeper));
    }
    assert!(again.is_some_and(|again| again.image() == film.image()));
}

/// By its seconds, a limit of time finds how many samples it allows.
#[test]
fn a_round_takes_the_seconds_of_all_its_stages() {
    let project = Project::new(Toy { sleeps: 1000, passes: 3, ..Toy::default() }, UNIFORM, Limits::spp(8.0));
    let mut keeper = Keeper::default();
    // Eight samples of a millisecond in each of 50 rows, on two threads.
    let film = on_threads(2, || project.together(1, None, &mut keeper));
    let (taken, stages) = (film.record().trace_seconds(), keeper.0.len());
    assert!(taken > 0.2 && film.record().rounds.len() == 1 && stages > 3, "{taken} s in {stages} stages");
    let resumed = on_threads(2, || project.together(1, Some(&keeper.0[2]), &mut NoMonitor));
    assert!(resumed.record().trace_seconds() > 0.2);
}

#[test]
fn a_limit_of_error_of_the_filtered_image_ends_after_the_same_samples() {
    let limits = Limits::error(0.0004, 1 << 22);
    let project = Project { is_filtered: true, ..Project::new(Toy::default(), UNIFORM, limits) };
    let alone = project.alone(None, &mut NoMonitor);
    assert!(alone.record().rounds.len() > 2 && alone.record().filtered_relmse.is_some());
    for size in [1, 3] {
        let film = project.together(size, None, &mut NoMonitor);
        assert!(bits(&film) == bits(&alone));
        assert_eq!(film.record().filtered_relmse, alone.record().filtered_relmse);
    }
}

#[test]
fn rows_of_another_stage_rows_joined_twice_and_missing_rows_are_refused() {
    let project = Project::new(Toy::default(), ADAPTIVE, Limits::spp(8.0));
    let mut planning = project.session(None);
    let stage = planning.next_stage(&project.toy).unwrap().unwrap();
    let task = planning.rows_of(&stage, 0..16).unwrap();
    let is_refused = |planning: &mut Session<'_>, bytes: &[u8]| {
        matches!(planning.join(&stage, TracedRows::from_bytes(bytes).unwrap()), Err(Error::OtherRender { .. }))
    };
    assert!(is_refused(&mut planning, &task), "not traced");
    let whole = planning.snapshot();
    assert!(is_refused(&mut planning, &whole), "no rows");
    let mut damaged = task.clone();
    damaged[100] ^= 1;
    assert!(matches!(TracedRows::from_bytes(&damaged), Err(Error::BadSnapshot { .. })), "damaged");
    let trace = |task: &[u8]| {
        let (mut toy, mut sampler) = (project.toy.clone(), (project.sampler)());
        project.render().trace_rows(task, &mut Readiness::default(), &mut toy, &mut sampler).unwrap().unwrap()
    };
    let traced = trace(&task);
    planning.join(&stage, TracedRows::from_bytes(&traced).unwrap()).unwrap();
    let before = bits(planning.film());
    assert!(is_refused(&mut planning, &traced), "joined twice");
    assert!(bits(planning.film()) == before);
    assert!(matches!(planning.end_stage(&stage, &mut project.toy.clone()), Err(Error::OtherRender { .. })), "missing");
    let rest = trace(&planning.rows_of(&stage, 16..50).unwrap());
    planning.join(&stage, TracedRows::from_bytes(&rest).unwrap()).unwrap();
    planning.end_stage(&stage, &mut project.toy.clone()).unwrap();
    // A part is no render that could go on by itself.
    for part in [&task, &traced] {
        let snapshot = || Snapshot::from_bytes(part).unwrap();
        let resumed = project.render().resume(snapshot(), &mut project.toy.clone(), &mut (project.sampler)());
        assert!(matches!(resumed, Err(Error::OtherRender { .. })));
        let methods = Methods::from((project.sampler)()).with_needs(needs()).with_recorders(recorders());
        let resumed = Session::resume(project.frame, project.limits.clone(), methods, snapshot());
        assert!(matches!(resumed, Err(Error::OtherRender { .. })));
    }
}

#[test]
fn a_failure_of_one_process_is_the_render_s() {
    let panics = |passes| Toy { panics: Some(5), passes, ..Toy::default() };
    let strict = Limits::spp(16.0).with_invalid(InvalidSample::Fail);
    for (toy, limits, expected) in [
        (panics(0), Limits::spp(16.0), "a broken triangle"),
        (panics(2), Limits::spp(16.0), "a broken triangle"),
        (Toy::default(), strict, "replay the sample"),
    ] {
        for size in [1, 3] {
            let project = |toy: &Toy| Project::new(toy.clone(), UNIFORM, limits.clone());
            let theirs: Vec<_> = (1..size).map(|_| project(&toy)).collect();
            let failed = project(&toy).with(&theirs, None, &mut NoMonitor).unwrap_err().to_string();
            assert!(failed.contains(expected) && failed.contains("(3, 20)") == expected.contains("broken"), "{failed}");
        }
    }
    // A process with other settings reports the difference.
    let project = |sampler| Project::new(Toy::default(), sampler, Limits::spp(4.0));
    let failed = project(UNIFORM).with(&[project(ADAPTIVE)], None, &mut NoMonitor).unwrap_err().to_string();
    assert!(failed.contains("process 1") && failed.contains("the sampler was uniform, not adaptive"), "{failed}");
}

/// A connection that breaks: nothing can be received, and process 1 is gone.
struct Broken(Vec<u32>);

impl Processes for Broken {
    fn rank(&self) -> u32 {
        0
    }

    fn size(&self) -> u32 {
        4
    }

    fn send(&mut self, to: u32, bytes: &[u8]) -> Result<(), Error> {
        if dapple_core::container::sections(bytes).unwrap()[0].0 == "over" {
            self.0.push(to);
            return if to == 1 { Err(Error::other("process 1", "it has ended")) } else { Ok(()) };
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<(u32, Vec<u8>), Error> {
        Err(Error::other("the network", "it is down"))
    }
}

#[test]
fn all_processes_are_told_that_the_render_failed() {
    let project = Project::new(Toy::default(), UNIFORM, Limits::spp(4.0));
    let mut broken = Broken(Vec::new());
    let failed = film_of(project.session(None), &mut Toy::default(), &mut broken, &mut NoMonitor, &mut || false);
    assert!(failed.unwrap_err().to_string().contains("it is down"));
    assert_eq!(broken.0, [1, 2, 3]);
}

#[test]
fn a_stop_anywhere_interrupts_the_render() {
    let project = Project::new(Toy::default(), UNIFORM, Limits::spp(4.0));
    let mut ends = local(2).into_iter();
    let (mut first, mut second) = (ends.next().unwrap(), ends.next().unwrap());
    let film = std::thread::scope(|threads| {
        threads.spawn(move || serve(|_| Ok(None), &mut second).unwrap());
        film_of(project.session(None), &mut Toy::default(), &mut first, &mut NoMonitor, &mut || false).unwrap()
    });
    assert!(film.record().interrupted && film.record().samples == 0);
    // A stop within the first process's own rows, and one after a stage.
    let schedule = Schedule::default().with_progress_spp(1);
    let project = Project::new(Toy::default(), ADAPTIVE, Limits::spp(9.0).with_schedule(schedule));
    let (mut first, mut keeper) = (local(1).remove(0), Keeper::default());
    let film = film_of(project.session(None), &mut Toy::default(), &mut first, &mut keeper, &mut || true).unwrap();
    assert!(film.record().interrupted && film.record().samples == 0);
    let whole = bits(&project.alone(None, &mut NoMonitor));
    assert!(bits(&project.together(2, keeper.0.last().map(|state| &state[..]), &mut NoMonitor)) == whole);
    let film = project.together(3, None, &mut |_: &Status<'_>| Control::Stop);
    assert!(film.record().interrupted && film.record().samples > 0);
    assert_eq!(film.counts().iter().sum::<u64>(), film.record().samples);
}

/// A process prepares its integrator once, not for each run of rows; its rows of several passes are one run.
#[test]
fn runs_of_one_process_share_what_the_integrator_prepared() {
    for (prepares, wanted) in [(Prepares::Once, 1), (Prepares::EveryPass, 4)] {
        let toy = Toy { prepares, ..Toy::default() };
        let project = Project::new(toy, || Box::new(Uniform::new(Independent::new(3))), Limits::spp(4.0));
        let mut session = project.session(None);
        let stage = session.next_stage(&project.toy).unwrap().unwrap();
        let (mut toy, mut sampler, mut ready) = (project.toy.clone(), (project.sampler)(), Readiness::default());
        let runs = dapple_distributed::rows_of_part(&session, &stage, 0, 1);
        assert_eq!(runs.len() > 1, prepares == Prepares::Once);
        for rows in &runs {
            let rows = session.rows_of(&stage, rows.clone()).unwrap();
            project.render().trace_rows(&rows, &mut ready, &mut toy, &mut sampler).unwrap().unwrap();
        }
        assert!(toy.preparations <= wanted && toy.preparations as usize == stage.passes(), "{}", toy.preparations);
    }
}
