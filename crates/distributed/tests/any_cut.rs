//! Any cut of the rows at any stage, by any number of processes, gives the film of one machine.

use dapple_adaptive::Adaptive;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Error, Estimate, Film, FirstHit, Frame, Integrator, Limits, Needs, NoMonitor, PointSet, Render,
    Sampler, Session, Snapshot, TracedRows, TrainingData, Worker,
};
use dapple_distributed::{coordinate, local, serve};
use dapple_low_discrepancy::Sobol;

/// An edge under noise, with a light whose strength is learned in training passes, and splats.
#[derive(Clone, Default)]
struct Toy {
    learned: Vec<f64>,
    passes: usize,
    splats: bool,
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

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        Some(self.estimate(draws, &mut Worker::default()))
    }

    fn estimate(&self, draws: &Draws<'_>, worker: &mut Worker) -> Estimate {
        let ([u, v, w, _], [x, y]) = (draws.block(Block::new(0)), draws.pixel());
        let lit = f32::from(u8::from(x as f32 + u > 0.3 * y as f32));
        worker.note(u64::from(x / 3), u * lit);
        let learned = 1.0 + self.learned.iter().sum::<f64>() as f32 * 1e-3;
        if self.splats && w < 0.2 {
            worker.splat([(x * 7 + y) % 20, (y * 5 + x) % 50], [0.1 * v; 3]);
        }
        let hit =
            (lit > 0.0).then(|| FirstHit::new([x as f32, y as f32, u], [0.0, 0.0, 1.0], 1.0 + v).with_albedo([v; 3]));
        Estimate::new([lit * (0.5 + v) * learned, u * v, 0.1]).with_first_hit(hit).with_cost(1 + x % 2)
    }
}

fn frame() -> Frame {
    Frame::new(20, 60).unwrap().crop(0, 3, 20, 53).unwrap()
}

fn samplers() -> Vec<Box<dyn Fn() -> Box<dyn Sampler>>> {
    fn points() -> impl PointSet {
        Sobol::new(3)
    }
    vec![
        Box::new(|| Box::new(Uniform::new(points()))),
        Box::new(|| Box::new(Adaptive::new(points()))),
        Box::new(|| Box::new(Adaptive::variance(points()))),
    ]
}

fn needs() -> Needs {
    Needs::none().with_features().with_variance().with_halves()
}

/// Films are equal but for the seconds.
fn same(one: &Film, other: &Film) -> bool {
    let counted =
        |film: &Film| (film.record().samples, film.record().rays, film.record().rejected, film.record().rounds.len());
    let pixels = |film: &Film| -> Vec<String> {
        let of =
            |i: usize| format!("{:?} {:?} {:?} {:?}", film.half(0, i), film.half(1, i), film.features(i), film.mean(i));
        (0..film.frame().pixels()).map(of).collect()
    };
    counted(one) == counted(other) && pixels(one) == pixels(other)
}

fn alone(toy: &Toy, sampler: &mut dyn Sampler, limits: &Limits) -> Film {
    Render::new(frame(), limits).needs(needs()).run(&mut toy.clone(), sampler).unwrap()
}

fn session<'a>(toy: &Toy, sampler: Box<dyn Sampler>, limits: &Limits, from: Option<&[u8]>) -> Session<'a> {
    let methods = dapple_core::Methods::from(sampler).with_needs(needs().and(toy.needs()));
    match from {
        None => Session::new(frame(), limits.clone(), methods).unwrap(),
        Some(bytes) => Session::resume(frame(), limits.clone(), methods, Snapshot::from_bytes(bytes).unwrap()).unwrap(),
    }
}

#[test]
fn processes_have_the_film_of_one_machine() {
    let limits = Limits::spp(9.0);
    for (case, make) in samplers().iter().enumerate() {
        for (passes, splats) in [(0, false), (2, false), (1, true)] {
            let toy = Toy { passes, splats, ..Toy::default() };
            let whole = alone(&toy, &mut *make(), &limits);
            for size in [1, 2, 3, 7] {
                let mut ends = local(size).into_iter();
                let mut first = ends.next().unwrap();
                let film = std::thread::scope(|threads| {
                    for mut end in ends {
                        let (toy, limits) = (toy.clone(), &limits);
                        let mut sampler = make();
                        threads.spawn(move || {
                            let (mut toy, mut learned) = (toy, 0);
                            let needs = needs().and(toy.needs());
                            let trace = |rows: &[u8]| {
                                let render = Render::new(frame(), limits).needs(needs);
                                render.trace_rows(rows, &mut learned, &mut toy, &mut *sampler)
                            };
                            serve(trace, &mut end).unwrap();
                        });
                    }
                    let session = session(&toy, make(), &limits, None);
                    coordinate(session, &mut toy.clone(), &mut first, &mut NoMonitor, &mut || false).unwrap()
                });
                assert!(same(&film, &whole), "sampler {case}, {passes} passes, splats {splats}, {size} processes");
            }
        }
    }
}

/// Parts as files: each stage is planned, dealt, traced and joined by programs that know nothing but bytes.
#[test]
fn stages_from_bytes_have_the_film_of_one_machine_whatever_the_number_of_parts() {
    let limits = Limits::spp(7.0);
    for (case, make) in samplers().iter().enumerate() {
        let toy = Toy { passes: 2, ..Toy::default() };
        let whole = alone(&toy, &mut *make(), &limits);
        let mut plan = session(&toy, make(), &limits, None).snapshot();
        for parts in [3, 1, 4, 2, 5, 2, 2, 3, 1, 1, 2, 2].into_iter().cycle() {
            let mut planner = toy.clone();
            let mut planning = session(&toy, make(), &limits, Some(&plan));
            planning.teach(&mut planner);
            let Some(stage) = planning.next_stage(&planner).unwrap() else {
                assert!(same(&planning.into_film(), &whole), "sampler {case}");
                break;
            };
            let runs = planning.deal(&stage, parts);
            assert_eq!(runs.first().map(|run| run.start), Some(stage.rows().start));
            assert!(runs.len() <= parts as usize && runs.windows(2).all(|two| two[0].end == two[1].start));
            for rows in runs.iter().rev() {
                let task = planning.rows_of(&stage, rows.clone()).unwrap();
                let render = Render::new(frame(), &limits).needs(needs());
                let traced = render.trace_rows(&task, &mut 0, &mut toy.clone(), &mut *make()).unwrap().unwrap();
                assert_eq!(planning.join(&stage, TracedRows::from_bytes(&traced).unwrap()).unwrap(), *rows);
            }
            planning.end_stage(&stage, &mut planner).unwrap();
            plan = planning.snapshot();
        }
    }
}

#[test]
fn rows_of_another_stage_or_untraced_rows_are_refused() {
    let (limits, toy) = (Limits::spp(8.0), Toy::default());
    let mut planning = session(&toy, Box::new(Adaptive::new(Sobol::new(3))), &limits, None);
    let stage = planning.next_stage(&toy).unwrap().unwrap();
    let task = planning.rows_of(&stage, 0..16).unwrap();
    assert!(
        matches!(planning.join(&stage, TracedRows::from_bytes(&task).unwrap()), Err(Error::OtherRender { .. })),
        "not traced"
    );
    let whole = planning.snapshot();
    assert!(
        matches!(planning.join(&stage, TracedRows::from_bytes(&whole).unwrap()), Err(Error::OtherRender { .. })),
        "no rows"
    );
    let mut damaged = task.clone();
    damaged[100] ^= 1;
    assert!(matches!(TracedRows::from_bytes(&damaged), Err(Error::BadSnapshot { .. })), "damaged");
}

#[test]
fn a_failure_of_one_process_is_the_render_s() {
    let limits = Limits::spp(4.0);
    let mut ends = local(2).into_iter();
    let (mut first, mut second) = (ends.next().unwrap(), ends.next().unwrap());
    let failed = std::thread::scope(|threads| {
        threads.spawn(move || serve(|_| Err(Error::other("toy", "no lamp")), &mut second).unwrap());
        let toy = Toy::default();
        let session = session(&toy, Box::new(Uniform::new(Sobol::new(3))), &limits, None);
        coordinate(session, &mut toy.clone(), &mut first, &mut NoMonitor, &mut || false).unwrap_err()
    });
    assert!(failed.to_string().contains("process 1") && failed.to_string().contains("no lamp"), "{failed}");
}

#[test]
fn a_stop_anywhere_interrupts_the_render() {
    let limits = Limits::spp(4.0);
    let mut ends = local(2).into_iter();
    let (mut first, mut second) = (ends.next().unwrap(), ends.next().unwrap());
    let film = std::thread::scope(|threads| {
        threads.spawn(move || serve(|_| Ok(None), &mut second).unwrap());
        let toy = Toy::default();
        let session = session(&toy, Box::new(Uniform::new(Sobol::new(3))), &limits, None);
        coordinate(session, &mut toy.clone(), &mut first, &mut NoMonitor, &mut || false).unwrap()
    });
    assert!(film.record().interrupted);
}
