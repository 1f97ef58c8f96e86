//! An absorbing medium in images: Beer and Lambert's law on the way to the camera, to a lamp and between them. The
//! short way through a medium agrees with the longer walk, which looks for transparent surfaces.

use crate::statistics::{FAMILY, Mean, Verdict, critical, sidak};
use crate::support::*;
use dapple_core::Film;
use dapple_scene::{Geometry, Light, LightKind, MaterialKind, Medium, MediumId, Scene};
use glam::{DAffine3, DVec3};
use std::f64::consts::PI;

const ABSORPTION: [f32; 3] = [0.05, 0.3, 1.2];
/// The largest number of equivalence tests in this file.
const TESTS: usize = 32;

/// Fills all space with a medium.
fn fill(scene: &mut Scene, absorption: [f32; 3]) {
    let medium = Medium { name: "ink".into(), absorption, scattering: [0.0; 3], g: 0.0, source: line(500) };
    scene.media.push(medium);
    scene.camera.medium = Some(MediumId(0));
}

/// A border without a medium on either side, off all rays. Shadow rays must still look for it.
fn add_border(scene: &mut Scene, at: DVec3) {
    let border = add_material(scene, MaterialKind::Interface);
    add(scene, Geometry::Sphere { radius: 0.1 }, DAffine3::from_translation(at), border, None);
}

/// A point lamp at `lamp` over a floor, and a camera at height `eye` over the origin that sees a millionth of it.
fn lit_floor(lamp: DVec3, eye: f64) -> Scene {
    let mut scene = scene([8, 8], 1e-3, DVec3::new(0.0, 0.0, eye), DVec3::ZERO);
    let grey = add_material(&mut scene, diffuse(0.5));
    add(&mut scene, rectangle(DVec3::ZERO, 20.0 * DVec3::X, 20.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    let kind = LightKind::Point { intensity: [3.0; 3] };
    scene.lights.push(Light { kind, to_world: DAffine3::from_translation(lamp), source: line(200) });
    scene
}

/// The verdict on equality with the reference within `delta`, relatively.
fn verdict(film: &Film, channel: usize, reference: f64, delta: f64) -> Verdict {
    let mut mean = Mean::default();
    (0..film.frame().pixels()).for_each(|i| mean.add(film.mean(i)[channel]));
    mean.equals(reference, delta * reference, critical(sidak(FAMILY, TESTS)))
}

#[test]
fn light_through_an_absorbing_medium_is_beer_and_lamberts() {
    for border in [false, true] {
        // A shell of radiance 1 around the camera: one leg of 2.5.
        let mut shell = scene([8, 8], 70.0, DVec3::ZERO, DVec3::Y);
        let black = add_material(&mut shell, diffuse(0.0));
        let number = add(&mut shell, Geometry::Sphere { radius: 2.5 }, DAffine3::IDENTITY, black, Some(1.0));
        shell.shapes[number].reversed = true;
        // Two legs, to a lamp at a slant and to the camera.
        let (lamp, eye) = (DVec3::new(1.5, 0.0, 2.0), 1.25);
        let mut floor = lit_floor(lamp, eye);
        for scene in [&mut shell, &mut floor] {
            fill(scene, ABSORPTION);
            if border {
                add_border(scene, DVec3::new(0.0, -60.0, 0.0));
            }
        }
        let [shell, floor] = [shell, floor].map(|scene| image(&scene, 16, 3));
        for (c, sigma) in ABSORPTION.map(f64::from).into_iter().enumerate() {
            let through = (-sigma * 2.5).exp();
            assert_eq!(verdict(&shell, c, through, 1e-5), Verdict::Pass, "shell, channel {c}, border {border}");
            let legs = lamp.length() + eye;
            let arrives = 0.5 / PI * 3.0 * lamp.z / lamp.length().powi(3);
            let lit = arrives * (-sigma * legs).exp();
            assert_eq!(verdict(&floor, c, lit, 1e-4), Verdict::Pass, "floor, channel {c}, border {border}");
            // The controls: one leg forgotten, and 1 % more of the medium.
            for wrong in [arrives * (-sigma * lamp.length()).exp(), arrives * (-1.01 * sigma * legs).exp()] {
                assert_eq!(verdict(&floor, c, wrong, 1e-4), Verdict::Fail, "floor, channel {c}, border {border}");
            }
        }
    }
}

/// Lamps of every kind, glossy things and several bounces in ink: the longer walk gives the same image.
#[test]
fn the_short_way_through_a_medium_gives_the_image_of_the_longer_walk() {
    let inked = |border: bool, absorption: [f32; 3]| {
        let mut scene = room([32, 24]);
        // On an unbounded way no light remains: the sky would be black.
        scene.lights.clear();
        fill(&mut scene, absorption);
        if border {
            // Within the box of metal, so that the scene's bounds, which normalise it, stay.
            add_border(&mut scene, DVec3::new(-1.0, 0.3, 0.4));
        }
        scene
    };
    let rooms = [false, true].map(|border| inked(border, [0.02, 0.1, 0.3]));
    let replicates = |scene: &Scene, from: u64| (from..from + 16).map(|seed| image(scene, 4, seed)).collect::<Vec<_>>();
    let [short, long] = rooms.each_ref().map(|room| replicates(room, 0));
    // The same seeds give the same paths, with lengths that differ by rounding.
    for (a, b) in short.iter().zip(&long) {
        for i in 0..a.frame().pixels() {
            for (x, y) in a.mean(i).into_iter().zip(b.mean(i)) {
                assert!((x - y).abs() <= 1e-5 * (x + y), "pixel {i}: {x} {y}");
            }
        }
    }
    // The control: a tenth more of the medium is detected.
    let thicker = replicates(&inked(true, [0.022, 0.11, 0.33]), 100);
    assert!(!Agreement::of(&short, &thicker).holds(FAMILY));
    assert!(Agreement::of(&short, &replicates(&rooms[1], 200)).holds(FAMILY));
}
