//! Emitting shapes: light by light sampling, by BSDF sampling and by both against closed forms; samples against densities; the
//! emitting side.
#![allow(clippy::print_stderr)]

use crate::densities::Cone;
use crate::support::*;
use dapple_geometry::{PrimitiveId, Ray, SurfacePoint, spawn_ray};
use dapple_renderer::light::Target;
use dapple_renderer::shading::{Bsdf, ShadingFrame, power_heuristic};
use std::ops::Range;

const TESTS: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Strategy {
    Light,
    Bsdf,
    Both,
}

const STRATEGIES: [Strategy; 3] = [Strategy::Light, Strategy::Bsdf, Strategy::Both];

/// Returns the light scattered by a white diffuse point, by one strategy, with the renderer's coordinates.
fn scattered(world: &World, at: &SurfacePoint, strategy: Strategy, u: [f32; 4], choice: f32) -> f32 {
    let frame = ShadingFrame::from_normal(at.normal);
    let bsdf = Bsdf::Diffuse { reflectance: Vec3::ONE };
    let (lights, geometry) = (world.lights(), world.geometry());
    let mut sum = 0.0;
    if strategy != Strategy::Bsdf
        && let Some(light) = lights.sample(at.position, choice, [u[0], u[1]])
        && light.wi.dot(at.normal) > 0.0
    {
        let (f, pdf) = bsdf.evaluate_and_pdf(Vec3::Z, frame.to_local(light.wi));
        if !geometry.occluded(&light.shadow_ray(at)) {
            let alone = light.delta || strategy == Strategy::Light;
            let weight = if alone { 1.0 } else { power_heuristic(light.pdf, pdf) };
            sum += f.x * light.radiance.x * light.wi.dot(at.normal) * weight / light.pdf;
        }
    }
    if strategy != Strategy::Light
        && let Some(sample) = bsdf.sample(Vec3::Z, [u[2], u[3]], 0.0)
    {
        let ray = spawn_ray(at, frame.to_world(sample.wi));
        if let Some(met) = world.emitter(&ray) {
            let found = lights.pdf(met.light, at.position, &met.point);
            let weight = if strategy == Strategy::Both { power_heuristic(sample.pdf, found) } else { 1.0 };
            sum += sample.weight.x * met.radiance.x * weight;
        } else if lights.has_environment() && geometry.closest(&ray).is_none() {
            let radiance = match strategy {
                Strategy::Both => lights.environment_weighted(ray.direction, sample.pdf, |light| lights.pmf(light)),
                _ => lights.environment(ray.direction),
            };
            sum += sample.weight.x * radiance.x;
        }
    }
    sum
}

/// Returns the position of the scene's origin in a world.
fn origin(world: &World) -> Vec3 {
    world.space().point(DVec3::ZERO).as_vec3()
}

/// Adds samples of the irradiance at the scene's origin with normal +z, in units of the lamp's radiance, to 64 sums, one per
/// scramble of a net.
fn add_irradiance(world: &World, strategy: Strategy, sums: &mut [f64; 64], samples: Range<u64>) {
    let position = origin(world);
    let error = position.abs() * f32::EPSILON;
    let at = SurfacePoint { position, error, normal: Vec3::Z, primitive: PrimitiveId::NONE };
    let points = Sobol::new(90);
    for (replicate, sum) in sums.iter_mut().enumerate() {
        let of = |index: u64| {
            let id = SampleId::new([replicate as u32, 0], 0, index);
            let [u, choice] = [blocks::scatter(0), blocks::choose(0)].map(|block| points.block(id, block.number()));
            f64::from(scattered(world, &at, strategy, u, choice[0])) * PI
        };
        *sum += samples.clone().map(of).sum::<f64>();
    }
}

/// Performs a sequential test of equivalence within `delta`: samples are doubled while undecided.
fn verdict(world: &World, strategy: Strategy, reference: f64, delta: f64, most: u64) -> Verdict {
    // The one-sided level is 1e-6 over all tests. With 63 degrees of freedom, Student's t is 1.2 times the normal quantile.
    let z = 1.2 * critical(sidak(FAMILY, TESTS));
    let (mut sums, mut samples) = ([0.0; 64], 512);
    add_irradiance(world, strategy, &mut sums, 0..samples);
    loop {
        add_irradiance(world, strategy, &mut sums, samples..2 * samples);
        samples *= 2;
        let found: Mean = sums.iter().map(|sum| sum / samples as f64).collect();
        let verdict = found.equals(reference, delta * reference, z);
        if verdict != Verdict::Undecided || samples >= most {
            eprintln!("{strategy:?}: {:.7} of {reference:.7}, 64 x {samples}: {verdict:?}", found.mean);
            return verdict;
        }
    }
}

/// Returns the irradiance at the origin with normal +z from a planar polygon of radiance 1, by Lambert's formula for its part
/// above the horizon [Lambert 1760].
fn polygon_irradiance(corners: &[DVec3]) -> f64 {
    let mut above = Vec::new();
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        if a.z >= 0.0 {
            above.push(a);
        }
        if (a.z >= 0.0) != (b.z >= 0.0) {
            above.push(a + (b - a) * (a.z / (a.z - b.z)));
        }
    }
    let edge = |i: usize| {
        let (a, b) = (above[i].normalize(), above[(i + 1) % above.len()].normalize());
        let across = a.cross(b);
        if across.length() == 0.0 { 0.0 } else { across.length().atan2(a.dot(b)) * across.z / across.length() }
    };
    0.5 * (0..above.len()).map(edge).sum::<f64>().abs()
}

/// A lamp of radiance 1, and a patch of ground at the origin that faces +z.
struct Lamp {
    name: String,
    geometry: Geometry,
    to_world: DAffine3,
    /// The centre of a sphere around the lamp.
    centre: DVec3,
    radius: f64,
    /// The ground's irradiance in closed form.
    irradiance: f64,
    /// True if light sampling is tested. Directly above a lamp, all light comes from a spot as small as the height.
    is_sampled: bool,
    /// True if samples are tested against their density, from the origin.
    is_counted: bool,
}

impl Lamp {
    /// Returns a polygon turned to face the origin.
    fn polygon(name: &str, corners: &[DVec3]) -> Self {
        let (centre, normal) = (corners[0], (corners[1] - corners[0]).cross(corners[2] - corners[1]));
        let mut turned = corners.to_vec();
        if normal.dot(-centre) < 0.0 {
            turned.reverse();
        }
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let radius = corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max);
        let (geometry, irradiance) = (polygon(&turned), polygon_irradiance(corners));
        Self::new(name, geometry, DAffine3::IDENTITY, (middle, radius), irradiance)
    }

    fn rectangle(name: &str, c: DVec3, u: DVec3, v: DVec3) -> Self {
        Self::polygon(name, &[c - u - v, c + u - v, c + u + v, c - u + v])
    }

    /// Returns a sphere of radius 1.
    fn sphere(name: &str, centre: DVec3) -> Self {
        let irradiance = PI * centre.z / centre.length().powi(3);
        Self::new(name, Geometry::Sphere { radius: 1.0 }, DAffine3::from_translation(centre), (centre, 1.0), irradiance)
    }

    /// Returns a ring of radius 1 that faces down, with the form factor of a disk parallel to the ground.
    fn ring(name: &str, centre: DVec3, inner_radius: f64) -> Self {
        let (h2, p2) = (centre.z * centre.z, centre.x * centre.x + centre.y * centre.y);
        let disk = |a2: f64| 0.5 * (1.0 - (p2 + h2 - a2) / ((p2 + h2 + a2).powi(2) - 4.0 * a2 * p2).sqrt());
        let irradiance = PI * (disk(1.0) - disk(inner_radius * inner_radius));
        let to_world = DAffine3::from_translation(centre) * DAffine3::from_rotation_x(PI);
        Self::new(name, Geometry::Disk { height: 0.0, radius: 1.0, inner_radius }, to_world, (centre, 1.0), irradiance)
    }

    fn new(
        name: &str,
        geometry: Geometry,
        to_world: DAffine3,
        (centre, radius): (DVec3, f64),
        irradiance: f64,
    ) -> Self {
        let name = name.to_owned();
        Self { name, geometry, to_world, centre, radius, irradiance, is_sampled: true, is_counted: false }
    }

    fn counted(self) -> Self {
        Self { is_counted: true, ..self }
    }

    fn scene(&self) -> Scene {
        let mut scene = empty([1, 1]);
        let grey = add_material(&mut scene, diffuse(0.5));
        add(&mut scene, self.geometry.clone(), self.to_world, grey, Some(1.0));
        plate(&mut scene, [DVec3::ZERO, 1e-3 * DVec3::X, 1e-3 * DVec3::Y], grey, None);
        scene
    }

    /// Tests equivalence within 0.1 %. This takes too long if fewer than 1 in 4 cosine-weighted directions hit the lamp
    /// (thorough test: 1 in 10). In that case, 3 10^5 samples must not refute the closed form. With fewer than 1000 expected
    /// hits, there is no test.
    fn check(&self) {
        let (world, name) = (world(&self.scene()), &self.name);
        for strategy in STRATEGIES.into_iter().filter(|s| self.is_sampled || *s != Strategy::Light) {
            let met = if strategy == Strategy::Bsdf { self.irradiance / PI } else { 1.0 };
            if met >= thorough(0.25, 0.1) {
                let verdict = verdict(&world, strategy, self.irradiance, 1e-3, 1 << 16);
                assert_eq!(verdict, Verdict::Pass, "{name}, {strategy:?}");
            } else if met * 64.0 * 4096.0 >= 1000.0 {
                let verdict = verdict(&world, strategy, self.irradiance, 1e-3, 1 << 12);
                assert_ne!(verdict, Verdict::Fail, "{name}, {strategy:?}");
            }
        }
    }
}

/// Returns a flat square `[-1, 1]^2` of 32 uneven triangles that faces down.
fn uneven() -> Geometry {
    let at = [-1.0, -0.9, 0.1, 0.15, 1.0];
    let positions = (0..25).map(|i| DVec3::new(at[i % 5], at[i / 5], 0.0)).collect();
    let quads = (0..16u32).map(|i| i / 4 * 5 + i % 4);
    let triangles = quads.flat_map(|a| [[a, a + 5, a + 6], [a, a + 6, a + 1]]).collect();
    Geometry::Mesh(Arc::new(MeshData { positions, triangles, ..MeshData::default() }))
}

fn flat_lamps() -> Vec<Lamp> {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let p = DVec3::new;
    let (sin, cos) = (0.5, 0.75_f64.sqrt());
    let rectangle = Lamp::rectangle;
    let triangle = |name, at: DVec3, u: DVec3, v: DVec3| Lamp::polygon(name, &[at, at + u, at + v]).counted();
    let mut mesh = rectangle("uneven mesh", p(0.3, 0.2, 1.0), x, y).counted();
    (mesh.geometry, mesh.to_world) = (uneven(), at(0.3, 0.2, 1.0));
    vec![
        // Near lamps are sampled by solid angle: from below the inside, beside an edge, and at a slant.
        triangle("triangle", p(0.5, -0.3, 1.0), x, y),
        triangle("triangle, close", p(-0.3, -0.3, 0.05), x, y),
        triangle("triangle, beside", p(0.1, -0.4, 0.2), x, y),
        triangle("triangle, narrow", p(0.0, 0.0, 0.3), 3.0 * x, 0.2 * y),
        rectangle("aside", p(0.3, 0.2, 2.0), x, y).counted(),
        rectangle("near", p(0.3, 0.2, 0.5), x, y).counted(),
        mesh,
        Lamp::ring("disk", p(0.4, 0.0, 1.0), 0.0).counted(),
        Lamp::ring("ring", p(0.4, 0.0, 1.0), 0.6).counted(),
        rectangle("centred", z, x, y),
        rectangle("over a corner", p(1.0, 1.0, 1.0), x, y),
        Lamp { is_sampled: false, ..rectangle("height 1e-3", 1e-3 * z, x, y) },
        rectangle("height 0.1", 0.1 * z, x, y),
        rectangle("height 1e3", 1e3 * z, x, y),
        rectangle("half under the horizon", x, y, z),
        rectangle("upright", p(2.0, 0.0, 1.5), y, z),
        rectangle("tilted, partly under the horizon", p(1.5, 0.0, 0.4), sin * x + cos * z, y),
        rectangle("a strip", p(0.5, 0.0, 1.0), x, 0.01 * y),
        rectangle("a ceiling", z, 10.0 * x, 10.0 * y),
        rectangle("askew", p(-0.7, 0.4, 0.8), cos * x + sin * y, -0.3 * (cos * y - sin * x) + 0.1 * z),
    ]
}

fn spheres() -> Vec<Lamp> {
    let slanted = DVec3::new(0.6, 0.0, 0.8);
    let straight = [1.0 + 1e-4, 1.1, 2.0, 1e2, 1e4, 1e6].map(|d| Lamp::sphere(&format!("sphere at {d}"), d * DVec3::Z));
    let slant = [2.0, 10.0, 1e3, 1e5].map(|d| Lamp::sphere(&format!("sphere at {d}, aslant"), d * slanted));
    let counted = [DVec3::new(0.5, 0.5, 2.0), 1.01 * DVec3::Z, DVec3::new(0.0, 300.0, 400.0)]
        .map(|centre| Lamp::sphere(&format!("sphere at {centre}"), centre).counted());
    straight.into_iter().chain(slant).chain(counted).collect()
}

/// Negative controls: a reference 0.5 % off and a lamp that faces away are detected.
#[test]
fn flat_lamps_have_their_closed_form_l03() {
    let lamps = flat_lamps();
    lamps.iter().for_each(Lamp::check);
    let centred = lamps.iter().find(|lamp| lamp.name == "centred").expect("a lamp");
    let reference = centred.irradiance;
    assert!((reference - 1.740_839_5).abs() < 1e-7, "{reference}");
    let mut scene = centred.scene();
    let plain = world(&scene);
    scene.shapes[0].reversed = true;
    let dark = world(&scene);
    scene.shapes[0].emission.as_mut().expect("it shines").two_sided = true;
    for strategy in STRATEGIES {
        assert_eq!(verdict(&plain, strategy, 1.005 * reference, 1e-3, 1 << 16), Verdict::Fail);
        let mut sums = [0.0; 64];
        add_irradiance(&dark, strategy, &mut sums, 0..64);
        assert_eq!(sums, [0.0; 64], "the dark side");
        assert_eq!(verdict(&world(&scene), strategy, reference, 1e-3, 1 << 16), Verdict::Pass, "two-sided");
    }
}

/// From inside a sphere that emits inwards, and on it, everything around emits: E = pi L.
#[test]
fn spheres_have_their_closed_form_l04() {
    spheres().iter().for_each(Lamp::check);
    for at in [DVec3::ZERO, DVec3::new(0.3, 0.5, -0.2), DVec3::new(0.0, 0.0, -0.999), DVec3::NEG_Z] {
        let mut scene = empty([1, 1]);
        let grey = add_material(&mut scene, diffuse(0.5));
        let lamp = ball(&mut scene, -at, 1.0, grey, Some(1.0));
        scene.shapes[lamp].reversed = true;
        let world = world(&scene);
        for strategy in STRATEGIES {
            assert_eq!(verdict(&world, strategy, PI, 1e-3, 1 << 16), Verdict::Pass, "inside at {at}");
        }
    }
}

/// Returns the p-value of samples of a world's only lamp from the origin, against the masses of the given lamp's density.
fn lamp_test(world: &World, lamp: &Lamp, seed: u64, cone: &Cone, masses: &[f64]) -> f64 {
    let from = origin(world);
    let mut random = Pcg32::seed_from_u64(seed);
    let draw = || {
        let u = [random.random(), random.random()];
        let drawn = world.lights().sample(from, random.random(), u)?;
        assert!(drawn.pdf > 0.0 && !drawn.delta && drawn.radiance.x == 1.0, "{drawn:?}");
        let Target::Surface(point) = &drawn.target else { panic!("on a surface") };
        // Both ways to compute the density agree.
        let again = world.lights().pdf(0, from, point);
        assert!((again / drawn.pdf - 1.0).abs() < 1e-3, "{} {again}", drawn.pdf);
        // At the limb of a sphere the direction is more exact than the point: 2e-4 of its radius.
        let to = point.position - from;
        let off = f64::from((to - drawn.wi * to.length()).length());
        assert!(off < 5e-4 * lamp.radius * world.space().scale(), "{to} {}", drawn.wi);
        Some(drawn.wi)
    };
    // Few enough samples to keep the file within seconds.
    cone.test(200_000, draw, masses)
}

/// The short test uses every second lamp. Negative control: a lamp moved by 3 % of its radius is detected.
#[test]
fn area_light_samples_match_their_densities_l04() {
    let lamps = flat_lamps().into_iter().chain(spheres()).filter(|lamp| lamp.is_counted);
    for (seed, mut lamp) in lamps.enumerate().step_by(thorough(2, 1)) {
        let (here, name) = (world(&lamp.scene()), lamp.name.clone());
        let sine = lamp.radius / lamp.centre.length();
        let angle = if sine < 1.0 { 1.05 * sine.asin() } else { PI };
        let cone = Cone { axis: lamp.centre.normalize(), angle: angle.min(PI) };
        let masses = cone.masses(|w| match here.emitter(&Ray::new(origin(&here), w)) {
            Some(met) if met.radiance != Vec3::ZERO => here.lights().pdf(met.light, origin(&here), &met.point),
            _ => 0.0,
        });
        let (p, integral) = (lamp_test(&here, &lamp, seed as u64, &cone, &masses), masses.iter().sum::<f64>());
        assert!((integral - 1.0).abs() < 1e-3 && p > sidak(FAMILY, TESTS), "{name}: {integral}, p = {p:e}");
        let off = -0.03 * lamp.radius * DVec3::new(0.6, -0.8, 0.3);
        lamp.to_world = DAffine3::from_translation(off) * lamp.to_world;
        let p = lamp_test(&world(&lamp.scene()), &lamp, seed as u64, &cone, &masses);
        assert!(p < sidak(FAMILY, TESTS), "{name} elsewhere: p = {p:e}");
    }
}

/// Returns the world of a two-sided lamp of one triangle.
fn triangle_lamp(corners: [DVec3; 3]) -> World {
    let mut scene = empty([1, 1]);
    let grey = add_material(&mut scene, diffuse(0.5));
    let lamp = add(&mut scene, polygon(&corners), DAffine3::IDENTITY, grey, Some(1.0));
    scene.shapes[lamp].emission.as_mut().expect("it shines").two_sided = true;
    world(&scene)
}

fn corner(random: &mut Pcg32) -> DVec3 {
    DVec3::from([0, 1, 2].map(|_| 2.0 * random.random::<f64>() - 1.0))
}

/// Returns receivers for a triangle: random, in its plane, on an edge, at a corner, very near and very far.
fn receivers([a, b, c]: [DVec3; 3], random: &mut Pcg32) -> Vec<DVec3> {
    let normal = (b - a).cross(c - a).normalize();
    let mut all = vec![a, b, c];
    for _ in 0..15 {
        let [s, t] = [random.random::<f64>(), random.random::<f64>()];
        let inside = a + (b - a) * s * (1.0 - t) + (c - a) * t * s;
        let beside = a + (b - a) * (4.0 * s - 2.0) + (c - a) * (4.0 * t - 2.0);
        let anywhere = corner(random) * 3.0;
        all.extend([anywhere, beside, inside, a + (b - a) * s, inside + normal * 1e-6, beside + normal * 1e-6]);
        all.push(anywhere * 1e6);
    }
    all
}

/// The test uses 130,000 pairs of a triangle and a receiver; the thorough test uses 10^8.
#[test]
fn triangle_lights_are_sound_at_any_receiver_l05() {
    let mut random = Pcg32::seed_from_u64(1);
    let (mut pairs, mut none) = (0u64, 0u64);
    for _ in 0..thorough(400, 310_000) {
        let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
        let world = triangle_lamp(corners);
        for receiver in receivers(corners.map(|c| world.space().point(c)), &mut random) {
            let from = receiver.as_vec3();
            for u in [[random.random(), random.random()], [0.0, 0.0], [0.0, BELOW_ONE]] {
                pairs += 1;
                let Some(sample) = world.lights().sample(from, 0.5, u) else {
                    none += 1;
                    continue;
                };
                assert!(sample.pdf > 0.0 && sample.pdf.is_finite(), "{corners:?} {from} {u:?}: {sample:?}");
                assert!((sample.wi.length() - 1.0).abs() < 1e-6 && sample.radiance == Vec3::ONE, "{sample:?}");
                let Target::Surface(point) = &sample.target else { panic!("on a surface") };
                // Rounding decides the cosine of a grazing direction.
                if sample.wi.dot(point.normal).abs() > 1e-2 {
                    let again = world.lights().pdf(0, from, point);
                    assert!((again / sample.pdf - 1.0).abs() < 1e-3, "{from}: {again} {}", sample.pdf);
                }
            }
        }
    }
    // From its own plane, a triangle is no wider than rounding; at its corners, some samples are at distance 0.
    assert!(none < pairs / 4, "{none} of {pairs}");
}

/// The mean of 1/pdf over a lattice of coordinates is the solid angle of the triangle [Van Oosterom and Strackee 1983], even
/// directly above the triangle, where few samples of its area matter (a ratio of 0.842 at a height of 1e-3).
#[test]
fn solid_angles_of_triangles_match_their_closed_form_l05() {
    let exact = |corners: [DVec3; 3], from: DVec3| {
        let [a, b, c] = corners.map(|p| (p - from).normalize());
        (2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))).abs()
    };
    let found = |corners: [DVec3; 3], from: DVec3| {
        let world = triangle_lamp(corners);
        let at = world.space().point(from).as_vec3();
        let u = |i: u32| (i as f32 + 0.5) / 256.0;
        let sample = |i: u32| world.lights().sample(at, 0.5, [u(i % 256), u(i / 256)]);
        (0..1 << 16).map(|i| sample(i).map_or(0.0, |s| 1.0 / f64::from(s.pdf))).sum::<f64>() / f64::from(1 << 16)
    };
    let mut random = Pcg32::seed_from_u64(5);
    let mut cases: Vec<([DVec3; 3], DVec3)> = [1e-1, 1e-2, 1e-3, 1e-4, 1e-6]
        .map(|height| ([DVec3::ZERO, DVec3::X, DVec3::Y], DVec3::new(0.3, 0.3, height)))
        .into();
    for _ in 0..100 {
        let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
        let from = corners[0] + corner(&mut random).normalize() * 10_f64.powf(3.0 * random.random::<f64>());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        // In the plane of the triangle the solid angle is nothing but rounding.
        if normal.dot(from - corners[0]).abs() >= 1e-3 {
            cases.push((corners, from));
        }
    }
    for (corners, from) in cases {
        let ratio = found(corners, from) / exact(corners, from);
        assert!((ratio - 1.0).abs() < 0.01, "{corners:?} {from}: {ratio}");
    }
    // Negative control: the solid angle of another triangle.
    let (corners, other) = ([DVec3::X, DVec3::Y, DVec3::Z], [DVec3::X, DVec3::Y, DVec3::Z + 0.1 * DVec3::X]);
    assert!((found(corners, DVec3::ZERO) / exact(other, DVec3::ZERO) - 1.0).abs() > 0.01);
}

/// Returns true for each side, above (+z) and below, to which the shape emits. Checks that light sampling agrees.
fn shines(geometry: Geometry, to_world: DAffine3, reversed: bool) -> [bool; 2] {
    let mut scene = empty([1, 1]);
    let grey = add_material(&mut scene, diffuse(0.5));
    let lamp = add(&mut scene, geometry, to_world, grey, Some(1.0));
    scene.shapes[lamp].reversed = reversed;
    let world = world(&scene);
    [1.0, -1.0].map(|side| {
        // The centre is avoided, where rings have a hole.
        let eye = world.space().point(DVec3::new(0.6, 0.1, 4.0 * side)).as_vec3();
        let met = world.emitter(&Ray::new(eye, Vec3::Z * -side as f32)).expect("it is in the way");
        let seen = met.radiance != Vec3::ZERO;
        let u = |i: u32| [(i % 8) as f32 / 8.0 + 0.05, (i / 8) as f32 / 8.0 + 0.05];
        let drawn = (0..64).any(|i| world.lights().sample(eye, 0.5, u(i)).is_some());
        assert_eq!(seen, drawn, "what is seen and what is sampled, side {side}");
        assert_eq!(f64::from(met.point.normal.z) * side > 0.0, seen, "the normal points to the side that shines");
        seen
    })
}

/// pbrt-v4's rules of normals, mirrors and `ReverseOrientation`, as in `scene::Shape`: mirroring across the lamp's plane flips
/// the normal, mirroring along the plane does not; vertex normals override the winding; spheres emit outwards.
#[test]
fn shapes_emit_from_the_side_of_their_normal_l12() {
    let mesh = |normal: Option<f32>| {
        let Geometry::Mesh(mesh) = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y) else { unreachable!("a mesh") };
        let normals = normal.map_or(Vec::new(), |z| vec![[0.1, 0.0, z]; 4]);
        Geometry::Mesh(Arc::new(MeshData { normals, ..(*mesh).clone() }))
    };
    let disk = Geometry::Disk { height: 0.0, radius: 1.0, inner_radius: 0.25 };
    let maps = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-2.0, -2.0, -2.0]];
    for (i, scale) in maps.into_iter().enumerate() {
        let map = DAffine3::from_scale(DVec3::from(scale));
        for reversed in [false, true] {
            let up = (i >= 2) == reversed;
            for (geometry, up) in [(mesh(None), up), (disk.clone(), up), (mesh(Some(1.0)), up), (mesh(Some(-1.0)), !up)]
            {
                assert_eq!(shines(geometry.clone(), map, reversed), [up, !up], "{geometry:?}, {map}, {reversed}");
            }
            let sphere = Geometry::Sphere { radius: 1.0 };
            assert_eq!(shines(sphere, map, reversed), [!reversed; 2], "sphere, {map}, {reversed}");
        }
    }
}

#[test]
fn stretched_round_lamps_are_refused_l06() {
    for geometry in [Geometry::Sphere { radius: 1.0 }, Geometry::Disk { height: 0.5, radius: 1.0, inner_radius: 0.0 }] {
        let mut scene = empty([1, 1]);
        let grey = add_material(&mut scene, diffuse(0.5));
        add(&mut scene, geometry, DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0)), grey, Some(1.0));
        let expected = "made.pbrt:10: an emitting sphere or disk must not be stretched";
        assert!(refusal(&scene).starts_with(expected), "{}", refusal(&scene));
        // Without emission it is allowed.
        scene.shapes[0].emission = None;
        assert_eq!(refusal(&scene), "");
    }
}

/// Returns the irradiance of the environment on a floor that faces up, by a midpoint rule over equal cosine-weighted areas.
fn floor_irradiance(world: &World) -> f64 {
    let one = |i: u32| {
        let [r2, turn] = [i % 1024, i / 1024].map(|k| (f64::from(k) + 0.5) / 1024.0);
        let (sin, cos) = (turn * TAU).sin_cos();
        let w = DVec3::new(r2.sqrt() * cos, r2.sqrt() * sin, (1.0 - r2).sqrt()).as_vec3();
        f64::from(world.lights().environment(w).x)
    };
    PI * (0..1 << 20).map(one).sum::<f64>() / f64::from(1 << 20)
}

/// The radiances of several environments in all layouts add up, each with its own weights. The tolerance is 1 %, since light
/// sampling selects one of four lights, and half of its light is below the floor.
#[test]
fn several_environments_add_up_l09() {
    let mut scene = empty([1, 1]);
    let grey = add_material(&mut scene, diffuse(0.5));
    plate(&mut scene, [DVec3::ZERO, 1e-3 * DVec3::X, 1e-3 * DVec3::Y], grey, None);
    for radiance in [
        EnvironmentRadiance::Constant([0.3; 3]),
        // 30 degrees per row.
        lat_long([4, 6], |_, y| [4.0, 1.0, 0.5, 0.3, 0.3, 0.3][y as usize]),
        EnvironmentRadiance::Constant([0.4; 3]),
        equal_area(8, |x, y| if x.abs_diff(7 - x) + y.abs_diff(7 - y) <= 6 { 1.0 } else { 0.25 }),
    ] {
        add_light(&mut scene, LightKind::Infinite { radiance }, DAffine3::IDENTITY);
    }
    let four = world(&scene);
    scene.lights.pop();
    // A ring of the sky between two angles gives pi (sin^2 - sin^2).
    let three = PI * (0.3 + 0.4 + 0.5 * (4.0 * 0.25 + 1.0 * 0.5 + 0.5 * 0.25));
    for (world, reference) in [(&four, floor_irradiance(&four)), (&world(&scene), three)] {
        for strategy in STRATEGIES {
            assert_eq!(verdict(world, strategy, reference, 5e-3, 1 << 16), Verdict::Pass, "{strategy:?}");
            assert_eq!(verdict(world, strategy, 1.02 * reference, 5e-3, 1 << 16), Verdict::Fail, "{strategy:?}");
        }
    }
}
