//! Safeguards of rays and their price, relative to tracing alone.

mod faults;

use super::image::world;
use super::pairs::{in_turn, pairs, seconds};
use super::soup::direction;
use super::{Break, Effort, Error, Ratio, Result, Row};
use dapple_geometry::safeguards::{
    All, Safeguards, WithoutExact, WithoutOffsets, WithoutPadding, WithoutTies, build, closest, occluded, spawn_ray,
};
use dapple_geometry::{Geometry, Preset, Ray, Shape, SurfacePoint, spawn_ray_to_point};
use dapple_renderer::World;
use glam::{Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A box of few triangles, a model in a room, a landscape.
const SCENES: [&str; 3] = ["cornell", "teapot", "terrain"];

/// A scene's geometry and rays.
struct Set {
    shapes: Vec<Shape>,
    geometry: Geometry,
    primary: Vec<Ray>,
    /// Ends of primary rays, and directions of the bounces from there.
    left: Vec<(SurfacePoint, Vec3)>,
    bounce: Vec<Ray>,
    shadow: Vec<Ray>,
}

pub(crate) fn rows(effort: Effort, onlooker: &mut (dyn FnMut(&str) + Send)) -> Result<Vec<Row>> {
    let sets: Vec<Set> = SCENES.iter().map(|name| Set::new(name, effort)).collect::<Result<_>>()?;
    let count = match effort {
        Effort::Quick => 6,
        Effort::Full => 41,
    };
    let triangles: Vec<String> = sets.iter().map(|set| set.geometry.triangle_count().to_string()).collect();
    let price_of = format!(
        "tracing primary, bounce and shadow rays in {} ({} triangles), geometric mean",
        SCENES.join(", "),
        triangles.join(", ")
    );
    let mut rows = Vec::new();
    let mut add = |safeguard, does, price, price_of, breaks| {
        rows.push(Row { safeguard, does, price, price_of, breaks });
    };
    onlooker("exact");
    let price = traced::<WithoutExact>(&sets, count)?;
    add("exact", "triangles are finished in f64 where f32 cannot tell", price, price_of.clone(), faults::exact()?);
    onlooker("padding");
    let price = traced::<WithoutPadding>(&sets, count)?;
    add("padding", "boxes grow by what rounding asks for", price, price_of.clone(), faults::padding()?);
    onlooker("ties");
    let price = traced::<WithoutTies>(&sets, count)?;
    add("ties", "of hits at the same distance the smallest number wins", price, price_of, faults::ties()?);
    onlooker("offsets");
    let price = left(&sets, count)?;
    let price_of =
        format!("making and tracing bounce rays in {}, geometric mean; else they leave by 1e-4", SCENES.join(", "));
    add("offsets", "rays leave surfaces by a bound on the error of the point", price, price_of, faults::offsets()?);
    Ok(rows)
}

impl Set {
    fn new(name: &'static str, effort: Effort) -> Result<Self> {
        let side = match effort {
            Effort::Quick => 64,
            Effort::Full => 256,
        };
        let world = world(name, [side; 2])?;
        // Without instances and moving shapes.
        let shapes = world.geometry().shapes().to_vec();
        let geometry = build::<All>(shapes.clone(), Preset::default())?;
        Ok(Self::of(&world, side, shapes, geometry))
    }

    fn of(world: &World, side: u32, shapes: Vec<Shape>, geometry: Geometry) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let [low, high] = geometry.bounds().unwrap_or([Vec3::ZERO; 2]);
        let mut set = Self { shapes, geometry, primary: vec![], left: vec![], bounce: vec![], shadow: vec![] };
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            let offset = Vec2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
            let ray = world.camera().ray([x, y], offset, [0.5; 2]);
            set.primary.push(ray);
            let Some(hit) = set.geometry.closest(&ray) else { continue };
            let point = set.geometry.surface(&ray, &hit);
            let normal = if point.normal.dot(ray.direction) > 0.0 { -point.normal } else { point.normal };
            let onwards = normal + direction(&mut rng) * 0.999;
            set.left.push((point, onwards));
            set.bounce.push(spawn_ray::<All>(&point, onwards));
            let share = Vec3::from_array(std::array::from_fn(|_| rng.random_range(0.2..0.8)));
            set.shadow.push(spawn_ray_to_point(&point, low + (high - low) * share));
        }
        set
    }
}

/// The price of a safeguard of the traversal.
fn traced<S: Safeguards>(sets: &[Set], count: usize) -> Result<Ratio> {
    let without: Vec<Geometry> = sets
        .iter()
        .map(|set| build::<S>(set.shapes.clone(), Preset::default()))
        .collect::<std::result::Result<_, dapple_geometry::Error>>()?;
    pairs(count, |number| {
        let mut logs = Vec::new();
        for (set, without) in sets.iter().zip(&without) {
            for rays in [&set.primary, &set.bounce] {
                logs.push(log_ratio(
                    number,
                    || rays.iter().filter(|ray| closest::<All>(&set.geometry, ray).is_some()).count(),
                    || rays.iter().filter(|ray| closest::<S>(without, ray).is_some()).count(),
                )?);
            }
            logs.push(log_ratio(
                number,
                || set.shadow.iter().filter(|ray| occluded::<All>(&set.geometry, ray)).count(),
                || set.shadow.iter().filter(|ray| occluded::<S>(without, ray)).count(),
            )?);
        }
        Ok(mean(&logs))
    })
}

/// The price of error-bounded offsets: of creating and tracing rays that leave surfaces.
fn left(sets: &[Set], count: usize) -> Result<Ratio> {
    fn trace<S: Safeguards>(set: &Set) -> usize {
        let next = |(point, direction): &(SurfacePoint, Vec3)| spawn_ray::<S>(point, *direction);
        set.left.iter().filter(|left| closest::<All>(&set.geometry, &next(left)).is_some()).count()
    }
    pairs(count, |number| {
        let logs: Result<Vec<f64>> =
            sets.iter().map(|set| log_ratio(number, || trace::<All>(set), || trace::<WithoutOffsets>(set))).collect();
        Ok(mean(&logs?))
    })
}

/// The logarithm of the ratio of times.
fn log_ratio<T>(number: usize, with: impl FnOnce() -> T, without: impl FnOnce() -> T) -> Result<f64> {
    let [with, without] = in_turn::<Error>(number, || Ok(seconds(with)), || Ok(seconds(without)))?;
    Ok((with / without).ln())
}

/// The geometric mean, from logarithms.
fn mean(logs: &[f64]) -> f64 {
    (logs.iter().sum::<f64>() / logs.len() as f64).exp()
}

/// A failure of both variants of the code.
fn broken(input: String, seen: &'static str, of: usize, without: usize, with: usize) -> Break {
    Break { input, seen, of: of as u64, without: without as u64, with: with as u64 }
}
