//! Indirect light, and the rest: the light that one rough surface or one point in a medium scatters.

use crate::support::*;
use dapple_core::samplers::Uniform;
use dapple_core::{Film, Frame, Limits, Needs, Render};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::light::LightSelection;
use dapple_renderer::{World, integrator};
use dapple_scene::{Color, MaterialKind, Medium, MediumId, MediumInterface, Scene, bundled};
use glam::{DAffine3, DVec3};

fn film(scene: &Scene, depth: u32) -> Film {
    let mut scene = scene.clone();
    scene.max_depth = Some(depth);
    let mut world = World::new(&scene).expect("a world");
    world.set_light_selection(LightSelection::Power);
    let limits = Limits::samples(16 * 24 * 24);
    let render = Render::new(Frame::new(24, 24).expect("not empty"), &limits);
    let needs = Needs::none().with_halves().with_indirect();
    render.needs(needs).run(&mut *integrator(&world), &mut Uniform::new(Sobol::new(3))).expect("it renders")
}

/// The light of half `half` of pixel `i` that is not indirect.
fn direct(film: &Film, half: usize, i: usize) -> [f64; 3] {
    let (all, indirect) = (film.half(half, i).expect("halves").mean, film.indirect(half, i).expect("recorded").mean);
    [0, 1, 2].map(|c| all[c] - indirect[c])
}

fn sum_of_indirect(film: &Film) -> f64 {
    (0..film.frame().pixels()).map(|i| film.indirect(0, i).expect("recorded").mean[1]).sum()
}

/// The same samples, stopped after one scattering.
#[test]
fn direct_light_is_that_of_one_scattering() {
    let clear = bundled::files("cornell").expect("bundled").read().expect("it reads");
    let mut foggy = clear.clone();
    let fog = Medium { name: "fog".into(), absorption: [2e-4; 3], scattering: [1e-3; 3], g: 0.3, source: line(500) };
    foggy.media.push(fog);
    foggy.camera.medium = Some(MediumId(0));
    let around = MediumInterface { inside: Some(MediumId(0)), outside: Some(MediumId(0)) };
    foggy.shapes.iter_mut().for_each(|shape| shape.media = Some(around));
    for scene in [clear, foggy] {
        let (whole, once) = (film(&scene, 6), film(&scene, 1));
        assert_eq!(sum_of_indirect(&once), 0.0);
        assert!(sum_of_indirect(&whole) > 1.0, "{}", sum_of_indirect(&whole));
        for i in 0..whole.frame().pixels() {
            for half in [0, 1] {
                let (got, wanted) = (direct(&whole, half, i), once.half(half, i).expect("halves").mean);
                let near = (0..3).all(|c| (got[c] - wanted[c]).abs() < 1e-5 * (1.0 + wanted[c]));
                assert!(near, "pixel {i}: {got:?}, not {wanted:?}");
            }
        }
    }
}

/// A surface beside the view of a wall under a sky; paths have three scattering events.
fn beside_a_wall(kind: MaterialKind) -> Film {
    let mut scene = scene([24, 24], 0.1, DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO);
    add_sky(&mut scene, 1.0);
    let wall = MaterialKind::Diffuse { reflectance: Color::Constant([0.5; 3]) };
    for (kind, y) in [(kind, 0.0), (wall, -6.0)] {
        let material = add_material(&mut scene, kind);
        let plane = rectangle(DVec3::new(0.0, y, 0.0), 2.0 * DVec3::X, 2.0 * DVec3::Z);
        add(&mut scene, plane, DAffine3::IDENTITY, material, None);
    }
    film(&scene, 3)
}

#[test]
fn mirrors_scatter_no_indirect_light() {
    let mirror = MaterialKind::Mirror { reflectance: Color::Constant([0.9; 3]) };
    let matte = MaterialKind::Diffuse { reflectance: Color::Constant([0.9; 3]) };
    assert_eq!(sum_of_indirect(&beside_a_wall(mirror)), 0.0);
    assert!(sum_of_indirect(&beside_a_wall(matte)) > 0.1);
}
