//! The cost of the render loop, of sample allocation and of planning, on one thread.
//!
//! The loop's own cost per sample is the time of `render/*` or `pull/*` minus the time of `direct`, divided by 2^18 samples.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dapple_adaptive::{Adaptive, VarianceOptions};
use dapple_conformance::toys::{Points, Traced};
use dapple_core::plan::{BudgetLeft, Feedback, Ladder, Plan, allocate};
use dapple_core::point_set::streams;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Film, Frame, Integrator, Limits, Methods, Needs, PointSet, Render, SampleId, Sampler,
    Session, Worker,
};
use std::hint::black_box;

fn cheap() -> Points<fn(SampleId, u32) -> [f32; 4]> {
    Points(|id, _| {
        let u = (id.index as u32).wrapping_mul(0x9e37_79b9).wrapping_add(id.pixel[0]) >> 8;
        [u as f32 * (1.0 / 16_777_216.0); 4]
    })
}

fn one_block(draws: &Draws<'_>, _: &mut Worker) -> Estimate {
    let u = draws.block(Block::new(0));
    Estimate::new([u[0], u[1], u[2]])
}

const SIDE: u32 = 128;
const SPP: u64 = 16;

fn frame() -> Frame {
    Frame::new(SIDE, SIDE).expect("a frame")
}

fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool").install(work)
}

/// The same dynamic calls and a sum per pixel, without Dapple's loop.
fn direct(integrator: &dyn Integrator, points: &dyn PointSet) -> f64 {
    let mut observed = Worker::default();
    let mut total = 0.0;
    for y in 0..SIDE {
        for x in 0..SIDE {
            let mut sum = [0f64; 3];
            for index in 0..SPP {
                let draws = Draws::new(points, SampleId::new([x, y], streams::WHOLE, index));
                let estimate = integrator.estimate(&draws, &mut observed);
                for (sum, x) in sum.iter_mut().zip(estimate.radiance) {
                    *sum += f64::from(x);
                }
            }
            total += sum[0] + sum[1] + sum[2];
        }
    }
    total
}

fn driver(c: &mut Criterion) {
    let mut group = c.benchmark_group("driver");
    group.throughput(Throughput::Elements(u64::from(SIDE * SIDE) * SPP)).sample_size(20);
    group.bench_function("direct", |b| b.iter(|| direct(black_box(&Traced(one_block)), black_box(&cheap()))));
    let all = Needs::none().with_variance().with_halves().with_features().with_surfaces().with_cost().with_emission();
    for (name, needs) in [("none", Needs::none()), ("variance", Needs::none().with_variance()), ("all", all)] {
        let limits = Limits::samples(u64::from(SIDE * SIDE) * SPP);
        let once = || {
            let mut sampler = Uniform::new(cheap());
            on_one_thread(|| Render::new(frame(), &limits).needs(needs).run(&mut Traced(one_block), &mut sampler))
        };
        group.bench_function(BenchmarkId::new("render", name), |b| b.iter(|| once().expect("a film")));
        let pulled = || {
            let methods = Methods::from(Uniform::new(cheap())).with_needs(needs);
            let mut session = Session::new(frame(), limits.clone(), methods)?;
            let (mut worker, integrator): (_, &dyn Integrator) = (Worker::default(), black_box(&Traced(one_block)));
            while let Some(round) = session.next_round()? {
                while let Some(mut tile) = round.next_tile() {
                    for sample in tile.samples() {
                        tile.add(&sample, integrator.estimate(&sample, &mut worker));
                    }
                    round.submit(tile)?;
                }
            }
            Ok::<_, dapple_core::Error>(session.into_film())
        };
        group.bench_function(BenchmarkId::new("pull", name), |b| b.iter(|| pulled().expect("a film")));
    }
    group.finish();
}

fn planning(c: &mut Criterion) {
    let frame = Frame::new(512, 512).expect("a frame");
    let pixels = frame.pixels();
    let mut group = c.benchmark_group("planning");
    group.throughput(Throughput::Elements(pixels as u64)).sample_size(10);
    let hash = |i: usize| (i as u32).wrapping_mul(0x9e37_79b9) as f32 / u32::MAX as f32;
    let scores: Vec<f64> = (0..pixels).map(|i| 10f64.powf(f64::from(hash(i)) * 4.0)).collect();
    let floors = vec![4; pixels];
    let total = 32 * pixels as u64 + 77;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    group.bench_function("allocate", |b| {
        b.iter(|| pool.install(|| allocate(black_box(&scores), &floors, 192, total)).expect("counts"));
    });
    group.bench_function("allocate_on_ladder", |b| {
        b.iter(|| {
            pool.install(|| Ladder::Whole.allocate(black_box(&scores), &floors, 192, total, 1.3)).expect("counts")
        });
    });
    // Equal scores, which no threshold separates.
    let ties: Vec<f64> = scores.iter().map(|g| 4f64.powi(g.log10() as i32)).collect();
    let equal = vec![1.0; pixels];
    for (name, scores) in [("ties", &ties), ("equal", &equal)] {
        group.bench_function(BenchmarkId::new("allocate", name), |b| {
            b.iter(|| pool.install(|| allocate(black_box(scores), &floors, 192, total)).expect("counts"));
        });
    }
    let mut film = Film::new(frame, Needs::none().with_variance());
    for i in 0..pixels {
        (0..4).for_each(|k| film.push(i, 0, [hash(i + k * 7919) * (1.0 + (i % 512) as f32); 3]));
    }
    let budget = BudgetLeft::new(total).with_spent(4 * pixels as u64);
    group.bench_function("variance", |b| {
        // The film holds the pilot; the plan after it is timed.
        let options = VarianceOptions::default().pilot(4);
        let mut sampler = Adaptive::variance_with_options(cheap(), options).expect("options");
        b.iter(|| {
            let mut plan = Plan::empty(pixels);
            let seen = Feedback::new(1, &film, budget);
            pool.install(|| sampler.next_round(&seen, &mut plan)).expect("a plan");
            plan.total()
        });
    });
    group.finish();
}

criterion_group!(benches, driver, planning);
criterion_main!(benches);
