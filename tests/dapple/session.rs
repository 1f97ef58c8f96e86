//! The pull driver gives the bits of the render loop on real scenes, with the default pair of sampler and filter.

use dapple_core::{Filtered, Frame, Limits, Render, Round, Session, Worker};
use dapple_core::{Integrator, Snapshot};
use dapple_denoise::warnings_of;
use dapple_renderer::{World, integrator};
use dapple_scene::bundled;

const SIZE: [u32; 2] = [40, 30];

fn frame() -> Frame {
    Frame::new(SIZE[0], SIZE[1]).expect("a frame")
}

fn session<'a>() -> Session<'a> {
    Session::new(frame(), Limits::spp(8.0), dapple::default_pair(5)).expect("a session").with_tile_side(8)
}

/// The image of the render loop.
fn rendered(integrator: &mut dyn Integrator) -> Filtered {
    let mut pair = dapple::default_pair(5);
    let filter = pair.filter.expect("a pair has one");
    let limits = Limits::spp(8.0);
    let render = Render::new(frame(), &limits).needs(filter.needs());
    filter.apply(&render.run(integrator, &mut *pair.sampler).expect("a film")).expect("an image")
}

/// Traces some tiles of a round in one of three orders, and returns how many.
fn trace(integrator: &dyn Integrator, round: &Round<'_>, order: usize, at_most: usize) -> usize {
    let mut tiles: Vec<_> = std::iter::from_fn(|| round.next_tile()).collect();
    if order > 0 {
        tiles.reverse();
    }
    let mut worker = Worker::default();
    let count = tiles.len().min(at_most);
    for mut tile in tiles.into_iter().take(count) {
        tile.sample_features(|draws| integrator.features_alone(draws));
        let mut samples: Vec<_> = tile.samples().collect();
        match order {
            0 => {}
            1 => samples.reverse(),
            _ => samples.sort_by_key(|sample| (sample.id().index * 7919 + u64::from(sample.pixel()[0]) * 31) % 101),
        }
        for sample in &samples {
            tile.add(sample, integrator.estimate(sample, &mut worker));
        }
        round.submit(tile).expect("complete");
    }
    count
}

fn same_bits_on(scene: &str) {
    let scene = bundled::files(scene).expect("bundled").read().expect("it reads");
    let world = World::with_resolution(&scene, SIZE).expect("sound");
    let mut integrator = integrator(&world);
    let whole = rendered(&mut *integrator);
    for order in 0..3 {
        let mut pulled = session();
        while let Some(round) = pulled.next_round().expect("a round") {
            trace(&*integrator, &round, order, usize::MAX);
        }
        // No rule warns of a right host.
        assert_eq!(warnings_of(pulled.film()), []);
        assert_eq!(pulled.finish().expect("an image"), whole, "order {order}");
    }
    // Killed after 3 tiles of the second round, and continued by another session.
    let mut killed = session();
    let first = killed.next_round().expect("a round").expect("a first one");
    trace(&*integrator, &first, 1, usize::MAX);
    drop(first);
    let second = killed.next_round().expect("a round").expect("a second one");
    assert_eq!(trace(&*integrator, &second, 2, 3), 3);
    let snapshot = Snapshot::from_bytes(&second.snapshot()).expect("a snapshot");
    drop(second);
    drop(killed);
    let mut resumed =
        Session::resume(frame(), Limits::spp(8.0), dapple::default_pair(5), snapshot).expect("the same render");
    while let Some(round) = resumed.next_round().expect("a round") {
        trace(&*integrator, &round, 0, usize::MAX);
    }
    assert_eq!(resumed.finish().expect("an image"), whole, "killed in the middle");
}

#[test]
fn a_session_has_the_bits_of_a_render_on_cornell() {
    same_bits_on("cornell");
}

#[test]
fn a_session_has_the_bits_of_a_render_on_glass() {
    same_bits_on("glass");
}

#[test]
fn a_session_has_the_bits_of_a_render_on_tea() {
    same_bits_on("tea");
}
