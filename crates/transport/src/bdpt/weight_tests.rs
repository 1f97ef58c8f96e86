//! The weights of all strategies that can make one path sum to one.

use super::Bdpt;
use super::tests::{bdpt, cameras, diffuse, room};
use super::vertex::{From, Kind, Vertex};
use super::weights::Ends;
use dapple_core::{Draws, Estimate, PointSet, SampleId};
use dapple_low_discrepancy::Random;
use dapple_renderer::World;
use dapple_scene::{Color, MaterialKind, Roughness, Scalar};
use glam::Vec3;

/// The unit direction from one vertex to another.
fn towards(from: &Vertex<'_>, to: &Vertex<'_>) -> Vec3 {
    (to.point.position - from.point.position).normalize()
}

/// Computes the densities of a path from the camera to a lamp anew, vertex by vertex, as both ends would sample them.
/// Returns `None` if a vertex scatters nothing, or if two vertices are so close that rounding turns their direction.
fn complete(path: &mut [Vertex<'_>]) -> Option<()> {
    let n = path.len();
    if path.windows(2).any(|pair| pair[0].point.position.distance(pair[1].point.position) < 0.05) {
        return None;
    }
    for i in 1..n {
        path[i].wo = towards(&path[i], &path[i - 1]);
        if i >= 2 {
            let density = path[i - 1].connect(From::Camera, -path[i].wo)?.forward;
            path[i].forward = path[i].density_from(path[i - 1].point.position, density);
        }
    }
    for i in 0..n - 2 {
        let density = path[i + 1].connect(From::Camera, towards(&path[i + 1], &path[i + 2]))?.backward;
        path[i].backward = path[i].density_from(path[i + 1].point.position, density);
    }
    Some(())
}

/// The vertices of a complete path from the lamp on, as a light path samples them.
fn from_light<'w>(world: &World, path: &[Vertex<'w>]) -> Option<Vec<Vertex<'w>>> {
    let (n, lights) = (path.len(), world.lights());
    let mut light: Vec<Vertex<'w>> = path.iter().rev().take(n - 1).copied().collect();
    let index = light[0].lamp()?;
    let direction = towards(&light[0], &light[1]);
    let pdf = lights.emission_pdf(index, light[0].facing(direction), direction);
    light[0] = Vertex { kind: Kind::Lamp { light: index }, wo: Vec3::ZERO, ..light[0] };
    light[0].forward = pdf.position * lights.pmf(index);
    for j in 1..light.len() {
        light[j].wo = towards(&light[j], &light[j - 1]);
        let density = if j == 1 { pdf.direction } else { light[j - 1].connect(From::Light, -light[j].wo)?.forward };
        light[j].forward = light[j].density_from(light[j - 1].point.position, density);
    }
    for j in 0..light.len().saturating_sub(2) {
        let density = light[j + 1].connect(From::Light, towards(&light[j + 1], &light[j + 2]))?.backward;
        light[j].backward = light[j].density_from(light[j + 1].point.position, density);
    }
    light.iter_mut().for_each(|vertex| vertex.throughput = Vec3::ONE);
    Some(light)
}

/// The weight of each strategy that can make a complete path, for s = 0, 1, …; `None` if rounding hides one vertex from
/// another. `wrong` is a factor of the density of the vertex that the lamp lights.
fn weights<'w>(bdpt: &Bdpt<'w>, draws: &Draws<'_>, path: &[Vertex<'w>], wrong: f32) -> Option<Vec<f32>> {
    let (n, world) = (path.len(), bdpt.world);
    let mut light = from_light(world, path)?;
    light[1].forward *= wrong;
    let mut found = Vec::new();
    for s in 0..n {
        let (lit, camera) = (&light[..s], &path[..n - s]);
        let ends = match s {
            0 => bdpt.found(camera)?.ends,
            1 => sampled_ends(world, &light[0], camera)?,
            _ if s < n - 1 => bdpt.connected(lit, camera, (0.0, &mut 0))?.ends,
            _ if bdpt.splats => {
                let mut seen = None;
                bdpt.seen(draws, lit, (0.0, &mut 0), |_, vertices, found| {
                    seen = seen.or((vertices == s).then_some(found.ends));
                });
                seen?
            }
            _ => continue,
        };
        found.push(bdpt.weight(lit, camera, &ends));
    }
    Some(found)
}

/// The densities at the ends of light sampling, by the vertices alone.
fn sampled_ends(world: &World, lamp: &Vertex<'_>, camera: &[Vertex<'_>]) -> Option<Ends> {
    let (last, before) = (&camera[camera.len() - 1], &camera[camera.len() - 2]);
    let to = towards(last, lamp);
    let connected = last.connect(From::Camera, to)?;
    let pdf = world.lights().emission_pdf(lamp.lamp()?, lamp.facing(-to), -to);
    let eye = [
        last.density_from(lamp.point.position, pdf.direction),
        before.density_from(last.point.position, connected.backward),
    ];
    Some(Ends { eye, light: [lamp.density_from(last.point.position, connected.forward), 0.0] })
}

/// Calls `check` with the camera path of each of some samples.
fn camera_paths<'w>(bdpt: &Bdpt<'w>, mut check: impl FnMut(&Draws<'_>, &[Vertex<'w>])) {
    let points = Random::new(5);
    for i in 0..20_000 {
        let draws = Draws::new(&points as &dyn PointSet, SampleId::new([i % 8, i / 8 % 8], 0, u64::from(i / 64)));
        let mut camera = Vec::new();
        bdpt.camera_path(&draws, &mut camera, &mut Estimate::new([0.0; 3]));
        check(&draws, &camera);
    }
}

#[test]
fn weights_of_one_path_sum_to_one() {
    let [(_, pinhole), _, (_, orthographic)] = cameras();
    let white = Color::Constant([1.0; 3]);
    let roughness = Roughness { u: Scalar::Constant(0.5), v: Scalar::Constant(0.5), remap: false };
    let glass = MaterialKind::Dielectric { eta: 1.5, roughness, reflectance: white, transmittance: white };
    for (camera, middle) in [(pinhole.clone(), diffuse(0.7)), (pinhole, glass), (orthographic, diffuse(0.7))] {
        let world = World::new(&room(camera, middle, Some(0.6))).expect("a world");
        for options in ["", "splat=0"] {
            let bdpt = bdpt(&world, options);
            let mut seen = [0_u32; 6];
            let mut wrong = (0, 0);
            camera_paths(&bdpt, |draws, camera| {
                for n in 3..=camera.len() {
                    let mut path = camera[..n].to_vec();
                    if bdpt.found(&path).is_none() || complete(&mut path).is_none() {
                        continue;
                    }
                    let Some(found) = weights(&bdpt, draws, &path, 1.0) else { continue };
                    let sum: f32 = found.iter().sum();
                    assert!((sum - 1.0).abs() < 2e-3, "{options}, {n} vertices: {found:?} sum to {sum}");
                    seen[n] += 1;
                    // Negative control: a density that is off by a half.
                    let Some(found) = weights(&bdpt, draws, &path, 1.5) else { continue };
                    wrong.0 += u32::from((found.iter().sum::<f32>() - 1.0).abs() > 0.02);
                    wrong.1 += 1;
                }
            });
            assert!(seen[3..=5].iter().all(|count| *count > 50), "{options}: {seen:?} paths");
            assert!(4 * wrong.0 > wrong.1, "{options}: a wrong density shows in {wrong:?} paths");
        }
    }
}

/// The densities that light sampling itself states give the weight that the vertices alone give.
#[test]
fn light_sampling_has_the_weight_of_its_path() {
    let [(_, pinhole), ..] = cameras();
    let world = World::new(&room(pinhole, diffuse(0.7), Some(0.6))).expect("a world");
    let (bdpt, mut compared) = (bdpt(&world, ""), 0);
    camera_paths(&bdpt, |draws, camera| {
        for t in 2..=camera.len() {
            if !camera[t - 1].connects() {
                continue;
            }
            let Some((found, start)) = bdpt.sampled(&camera[..t], (0.0, &mut 0)) else { continue };
            let mut path = [&camera[..t], &[start]].concat();
            if complete(&mut path).is_none() {
                continue;
            }
            let Some(expected) = weights(&bdpt, draws, &path, 1.0) else { continue };
            let weight = bdpt.weight(&[start], &camera[..t], &found.ends);
            let places: Vec<Vec3> = path.iter().map(|vertex| vertex.point.position).collect();
            let told = || format!("{t} vertices: {weight}, not {expected:?}, at {places:?}");
            assert!((weight - expected[1]).abs() < 2e-3, "{}", told());
            compared += 1;
        }
    });
    assert!(compared > 10_000, "{compared} paths");
}
