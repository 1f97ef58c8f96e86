//! Points, scenes, films and rounds of this crate's tests.

use crate::recorders::Singles;
use dapple_classics::{Axis, Domain, FilmPoints, PlacedHandle, Role};
use dapple_conformance::toys;
pub(crate) use dapple_conformance::toys::{Field, Traced};
use dapple_core::plan::{BudgetLeft, Feedback, Plan, Progress};
use dapple_core::point_set::mix;
use dapple_core::{
    Block, Draws, Estimate, Film, Filter, Frame, Integrator, Limits, Needs, PointSet, Render, SampleId, Sampler, Worker,
};
use dapple_low_discrepancy::{Random, Sobol};
use std::sync::Arc;

/// Points of one type, so that each method is compiled for one.
pub(crate) type Points = Arc<dyn PointSet>;

pub(crate) fn random(seed: u64) -> Points {
    Arc::new(Random::new(seed))
}

pub(crate) fn sobol(seed: u64) -> Points {
    Arc::new(Sobol::new(seed))
}

/// No bounds of a pixel's count.
pub(crate) const ANY: [u32; 2] = [1, u32::MAX];
pub(crate) const VARIANCE: Needs = Needs::none().with_variance();

/// A number in `[0, 1)` from a hash.
pub(crate) fn unit(key: u64) -> f32 {
    (mix(key) >> 40) as f32 / (1 << 24) as f32
}

/// A standard normal number by Box and Muller's method, a function of `key`.
pub(crate) fn normal(key: u64) -> f64 {
    let u = |key: u64| ((mix(key.wrapping_mul(0x9e37_79b9_7f4a_7c15)) >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let radius = libm::sqrt(-2.0 * libm::log(u(key.wrapping_mul(2) ^ 1)));
    radius * libm::cos(std::f64::consts::TAU * u(key.wrapping_mul(2)))
}

/// A grey film of `image(x, y)` with `spp` samples per pixel and normal noise of standard deviation `noise(x, y)`. The two
/// halves take turns if the film has halves.
pub(crate) fn noisy_film(
    size: [u32; 2],
    spp: u64,
    needs: Needs,
    seed: u64,
    image: impl Fn(u32, u32) -> f64,
    noise: impl Fn(u32, u32) -> f64,
) -> Film {
    let mut film = Film::new(frame(size), needs);
    for i in 0..film.frame().pixels() {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        for sample in 0..spp {
            let key = mix(seed).wrapping_add(i as u64 * spp + sample);
            let value = (image(x, y) + noise(x, y) * normal(key)) as f32;
            film.push(i, if needs.halves { sample as usize % 2 } else { 0 }, [value; 3]);
        }
    }
    film
}

pub(crate) fn frame([width, height]: [u32; 2]) -> Frame {
    Frame::new(width, height).unwrap()
}

pub(crate) fn run(integrator: &mut dyn Integrator, sampler: &mut dyn Sampler, size: [u32; 2], limits: &Limits) -> Film {
    Render::new(frame(size), limits).run(integrator, sampler).unwrap()
}

/// The image of a filter.
pub(crate) fn image(filter: &dyn Filter, film: &Film) -> Vec<[f32; 3]> {
    filter.apply(film).unwrap().radiance
}

/// The mean squared difference of the red of an image from the truth of each pixel.
pub(crate) fn squared_error(image: &[[f32; 3]], truth: impl Fn(usize) -> f64) -> f64 {
    let error = |(i, x): (usize, &[f32; 3])| (f64::from(x[0]) - truth(i)).powi(2);
    image.iter().enumerate().map(error).sum::<f64>() / image.len() as f64
}

/// The mean of the red of an image.
pub(crate) fn mean_of(image: &[[f32; 3]]) -> f64 {
    image.iter().map(|x| f64::from(x[0])).sum::<f64>() / image.len() as f64
}

/// The mean of a value of the pixels in some columns.
pub(crate) fn mean_of_columns(film: &Film, columns: std::ops::Range<usize>, of: impl Fn(usize) -> f64) -> f64 {
    let [width, height] = film.frame().size().map(|n| n as usize);
    let pixels = (0..width * height).filter(|i| columns.contains(&(i % width)));
    pixels.map(of).sum::<f64>() / (columns.len() * height) as f64
}

/// The counts of the round after these samples, within a budget of `total` and the bounds of a pixel's count.
pub(crate) fn next_counts(
    sampler: &mut dyn Sampler,
    film: &Film,
    total: u64,
    [min_spp, max_spp]: [u32; 2],
) -> Vec<u32> {
    let budget = BudgetLeft::new(total).with_spent(film.counts().iter().sum());
    let budget = budget.with_min_spp(min_spp).with_max_spp(max_spp);
    let mut plan = Plan::empty(film.frame().pixels());
    let answer = sampler.next_round(&Feedback::new(1, film, budget), &mut plan);
    assert!(matches!(answer, Ok(Progress::Trace)), "{answer:?}");
    plan.counts
}

/// The film of a sampler that plans until it is done. `sample` returns the estimate of a pixel's k-th sample.
pub(crate) fn planned_until_done(
    sampler: &mut dyn Sampler,
    size: [u32; 2],
    total: u64,
    sample: impl Fn(usize, u64) -> Estimate,
) -> Film {
    let mut film = Film::with_recorders(frame(size), sampler.needs(), sampler.recorders());
    for round in 0.. {
        let budget = BudgetLeft::new(total).with_spent(film.record().samples);
        let mut plan = Plan::empty(film.frame().pixels());
        if sampler.next_round(&Feedback::new(round, &film, budget), &mut plan).unwrap() == Progress::Done {
            break;
        }
        assert!(plan.total() <= budget.left() && round < 10_000);
        for (i, &count) in plan.counts.iter().enumerate() {
            (0..count).for_each(|_| film.push_estimate(i, 0, &sample(i, film.count(i))));
        }
    }
    film
}

/// Radiance by the place in the image and by lens (two coordinates), time, and a coordinate outside the domain.
pub(crate) type Made = fn([f32; 2], [f32; 4]) -> f32;

/// The place, and these axes: two of the lens, one of the time.
pub(crate) fn domain(roles: &[Role]) -> Domain {
    let place = [0, 1].map(|lane| Axis::new(Role::Place, 0, lane));
    let mut lens = 0;
    let rest = roles.iter().map(|&role| {
        let lane = if role == Role::Time { 2 } else { lens };
        lens += u8::from(role != Role::Time);
        Axis::new(role, 1, lane)
    });
    Domain::new(place.into_iter().chain(rest)).unwrap()
}

pub(crate) fn film_points(points: Points, roles: &[Role], placed: Option<PlacedHandle>) -> FilmPoints {
    FilmPoints::new(points, domain(roles)).with_placed(placed)
}

/// The film of samples with these places in the image, one by one, and their points.
pub(crate) fn film_at(size: [u32; 2], samples: &[([f32; 2], [f32; 3])]) -> (Film, FilmPoints) {
    let mut film = Film::with_recorders(frame(size), Needs::none(), Singles::All.list());
    let mut places = vec![Vec::new(); film.frame().pixels()];
    for &([x, y], value) in samples {
        let i = y as usize * size[0] as usize + x as usize;
        film.push(i, 0, value);
        places[i].push([x.fract(), y.fract(), 0.0, 0.0]);
    }
    let at = move |id: SampleId, _| places[(id.pixel[1] * size[0] + id.pixel[0]) as usize][id.index as usize];
    (film, film_points(Arc::new(toys::Points(at)), &[], None))
}

/// The film of a function, with all samples.
pub(crate) fn render(made: Made, sampler: &mut dyn Sampler, size: [u32; 2], spp: f64) -> Film {
    render_with(Needs::none(), made, sampler, size, spp)
}

pub(crate) fn render_with(needs: Needs, made: Made, sampler: &mut dyn Sampler, size: [u32; 2], spp: f64) -> Film {
    let mut scene = Traced(move |draws: &Draws<'_>, _: &mut Worker| {
        let ([x, y], [u, v, ..]) = (draws.pixel().map(|n| n as f32), draws.block(Block::new(0)));
        Estimate::new([made([x + u, y + v], draws.block(Block::new(1))); 3])
    });
    let limits = Limits::spp(spp);
    let render = Render::new(frame(size), &limits).needs(needs).recorders(Singles::All.list());
    render.run(&mut scene, sampler).unwrap()
}
