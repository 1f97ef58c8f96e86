//! Depth of field and motion blur beside averages of many images without them.
#![allow(clippy::print_stderr)]

use crate::statistics::FAMILY;
use crate::support::*;
use dapple_low_discrepancy::Sobol;
use dapple_renderer::World;
use dapple_scene::bundled::{self, Bundle};
use dapple_scene::{Color, Emission, Light, LightKind, MaterialKind, Projection, Scene};
use dapple_scene::{Effect, Effects};
use glam::{DAffine3, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const SIZE: [u32; 2] = [48, 32];
/// Independent images, or averages of images, on either side.
const REPLICATES: u64 = 12;
/// Samples per pixel of an image with the effect; also the number of images in an average, with one sample per pixel
/// each.
const SPP: u64 = 96;
const SEED: u64 = 9300;

type Blocks = Vec<Vec<[f64; 3]>>;

fn bundle(name: &str) -> Bundle {
    bundled::files(name).expect("bundled")
}

/// The same scene with emission instead of scattering, a different amount for each shape. The light has no noise of its
/// own, so all noise comes from visibility.
fn glowing(mut scene: Scene) -> Scene {
    let black = Color::Constant([0.0; 3]);
    scene.materials.iter_mut().for_each(|m| m.kind = MaterialKind::Diffuse { reflectance: black });
    for (i, shape) in scene.shapes.iter_mut().enumerate() {
        let radiance = [1, 2, 3].map(|c| ((i + 1) * (2 * c + 1) % 7) as f32);
        shape.emission = Some(Emission { radiance, two_sided: true });
    }
    scene.lights.clear();
    scene.max_depth = Some(0);
    scene
}

/// The same scene in direct light of a far lamp: for shapes that cannot emit, since they move.
fn sunlit(mut scene: Scene) -> Scene {
    for material in &mut scene.materials {
        if let MaterialKind::CoatedDiffuse { reflectance, .. } = material.kind {
            material.kind = MaterialKind::Diffuse { reflectance };
        }
    }
    scene.shapes.retain(|s| s.emission.is_none());
    let to_world = look_at(DVec3::ZERO, DVec3::new(-0.4, -0.7, 0.8), DVec3::Z);
    scene.lights = vec![Light { kind: LightKind::Distant { irradiance: [3.0; 3] }, to_world, source: line(200) }];
    scene.max_depth = Some(1);
    scene
}

fn small(scene: &Scene) -> World {
    World::with_resolution(scene, SIZE).unwrap_or_else(|e| panic!("{e}"))
}

/// Block means of independent images.
fn images(scene: &Scene) -> Blocks {
    let world = small(scene);
    (0..REPLICATES).map(|r| block_means(&film_of(&world, SIZE, SPP, Sobol::new(SEED + r)))).collect()
}

/// Block means of averages of the images that `still` makes. It takes numbers below 1 that fill the unit square evenly.
fn averages(mut still: impl FnMut([f64; 2]) -> Scene) -> Blocks {
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let average = |replicate: u64| {
        let mut sums: Vec<[f64; 3]> = Vec::new();
        for i in 0..SPP {
            let place = [(i as f64 + random.random::<f64>()) / SPP as f64, random.random()];
            let world = small(&still(place));
            let film = film_of(&world, SIZE, 1, Sobol::new(SEED + 1000 + replicate * SPP + i));
            let means = block_means(&film);
            sums.resize(means.len(), [0.0; 3]);
            sums.iter_mut().zip(means).for_each(|(sum, mean)| (0..3).for_each(|c| sum[c] += mean[c] / SPP as f64));
        }
        sums
    };
    (0..REPLICATES).map(average).collect()
}

/// Prints the deviation, and returns true if both agree.
fn agree(name: &str, a: &Blocks, b: &Blocks) -> bool {
    // Averages round differently from images, which shows in blocks without variance.
    let rounded = |blocks: &Blocks| -> Blocks {
        blocks.iter().map(|r| r.iter().map(|m| m.map(|x| f64::from(x as f32))).collect()).collect()
    };
    let found = Agreement::of_blocks(&rounded(a), &rounded(b));
    eprintln!("{name}: worst block {:.2}, whole {:.2}, of {} tests", found.worst, found.whole, found.tests);
    found.holds(FAMILY)
}

/// Every point of the lens is a pinhole. Its image is shifted so that points in focus stay in place.
#[test]
fn a_lens_is_many_pinholes() {
    let mut scene = glowing(bundle("lens").read().expect("it reads"));
    // A lens five times as wide, so that blur spreads over blocks.
    scene.camera.lens_radius *= 5.0;
    assert!(Effects::of(&scene).has(Effect::DepthOfField));
    let lens = scene.camera.clone();
    let Projection::Perspective { fov } = lens.projection else { panic!("the lens scene is in perspective") };
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let pinhole = |[u, v]: [f64; 2]| {
        // Uniform on the disk, by radius and angle.
        let (radius, angle) = (lens.lens_radius * u.sqrt(), std::f64::consts::TAU * v);
        let [x, y] = [radius * angle.cos(), radius * angle.sin()];
        let mut still = scene.clone();
        still.camera.lens_radius = 0.0;
        still.camera.to_world = lens.to_world * DAffine3::from_translation(DVec3::new(x, y, 0.0));
        // In units of the screen's half height.
        let unit = lens.focal_distance * (fov.to_radians() / 2.0).tan();
        let [dx, dy] = [x / unit, y / unit];
        still.camera.screen_window = Some([-aspect - dx, aspect - dx, -1.0 - dy, 1.0 - dy]);
        still
    };
    assert!(!Effects::of(&pinhole([0.5; 2])).has(Effect::DepthOfField));
    let expected = averages(pinhole);
    assert!(agree("thin lens", &images(&scene), &expected));
    // Negative controls: a focus a fifth too near, a lens a fifth too small, and a pinhole.
    for (name, change) in [("focus", [1.0, 0.8]), ("radius", [0.8, 1.0]), ("pinhole", [0.0, 1.0])] {
        let mut other = scene.clone();
        other.camera.lens_radius *= change[0];
        other.camera.focal_distance *= change[1];
        assert!(!agree(name, &images(&other), &expected), "{name}");
    }
}

/// The motion scene at a time: the motion at its end, by the scene's text, done in part.
fn still_at(bundle: &Bundle, moved: f64, turned: f64) -> Scene {
    let text = String::from_utf8(bundle.files[0].1.clone()).expect("text");
    let mut moving = false;
    let part = |line: &str| -> String {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |word: &str| word.parse::<f64>().expect("a number");
        match words[..] {
            ["Translate", x, y, z] => {
                let [x, y, z] = [x, y, z].map(|w| number(w) * moved);
                format!("Translate {x} {y} {z}")
            }
            ["Rotate", angle, x, y, z] => format!("Rotate {} {x} {y} {z}", number(angle) * turned),
            _ => panic!("not expected to move: {line}"),
        }
    };
    let mut still = String::new();
    for line in text.lines() {
        match line.trim() {
            "ActiveTransform EndTime" => moving = true,
            "ActiveTransform All" => moving = false,
            line if moving => still += &part(line),
            line => still += line,
        }
        still.push('\n');
    }
    let mut bundle = bundle.clone();
    bundle.files[0].1 = still.into_bytes();
    sunlit(bundle.read().unwrap_or_else(|e| panic!("{e}")))
}

#[test]
fn motion_blur_is_many_stills_and_not_one() {
    check_stills(false);
}

#[test]
#[ignore = "16 s: three negative controls; the shortest is tested always"]
fn motion_blur_is_many_stills() {
    check_stills(true);
}

/// Each time while the shutter is open has its still.
fn check_stills(all_controls: bool) {
    let bundle = bundle("motion");
    let scene = sunlit(bundle.read().expect("it reads"));
    assert!(Effects::of(&scene).has(Effect::MotionBlur));
    assert!(!Effects::of(&still_at(&bundle, 0.5, 0.5)).has(Effect::MotionBlur));
    let blurred = images(&scene);
    assert!(agree("motion", &blurred, &averages(|[t, _]| still_at(&bundle, t, t))));
    // Negative controls: a still, a shutter that closes a fifth too early, and objects that do not turn.
    assert!(!agree("still", &blurred, &images(&still_at(&bundle, 0.5, 0.5))));
    if all_controls {
        assert!(!agree("early", &blurred, &averages(|[t, _]| still_at(&bundle, 0.8 * t, 0.8 * t))));
        assert!(!agree("unturned", &blurred, &averages(|[t, _]| still_at(&bundle, t, 0.0))));
    }
}

/// All bundled scenes are read without a warning, and small images of them have valid light.
#[test]
fn bundled_scenes_render() {
    for name in bundled::names() {
        let scene = bundle(name).read().unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(scene.notices.iter().all(|n| n.message.starts_with("Sampler")), "{name}: {:?}", scene.notices);
        let size = [64, 64];
        let world = World::with_resolution(&scene, size).unwrap_or_else(|e| panic!("{name}: {e}"));
        let film = film_of(&world, size, 1, Sobol::new(SEED));
        assert_eq!((film.record().rejected, world.dropped_triangles()), (0, 0), "{name}");
        let image = film.image();
        assert!(image.iter().flatten().all(|&x| x.is_finite() && x >= 0.0), "{name}");
        assert!(mean(&film).iter().all(|&m| m > 0.01), "{name}: {:?}", mean(&film));
    }
    for (name, effects) in [
        ("lens", &[Effect::DepthOfField, Effect::SeveralLights][..]),
        ("motion", &[Effect::MotionBlur]),
        ("tea", &[Effect::Refraction, Effect::Glossy, Effect::AbsorbingMedia]),
        ("cabin", &[Effect::SeveralLights, Effect::Glossy]),
        ("many-lights", &[Effect::SeveralLights, Effect::Glossy]),
        ("caustic", &[Effect::Refraction, Effect::SeveralLights]),
        ("chess", &[Effect::DepthOfField, Effect::SoftShadows]),
        ("penumbra", &[Effect::SoftShadows]),
        (
            "glass",
            &[
                Effect::Refraction,
                Effect::Glossy,
                Effect::Transparency,
                Effect::AbsorbingMedia,
                Effect::ScatteringMedia,
            ],
        ),
    ] {
        let found = Effects::of(&bundle(name).read().expect("it reads"));
        assert!(effects.iter().all(|&e| found.has(e)), "{name}: {found:?}");
    }
}
