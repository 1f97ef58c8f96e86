//! Refinement by the shapes that samples hit.

use crate::common::*;
use dapple_core::{Block, Draws, Estimate, FirstHit, Integrator, Limits, Options as _, Sampler, Worker};
use dapple_mitchell::{MitchellPbrt, MitchellPbrtOptions, PbrtTest, PilotPolicy, Stopping};

/// A constant image in which the first number of a sample decides the triangle that it hits.
struct Triangles<F>(F);

impl<F: Fn(f32) -> Option<[u32; 2]> + Sync> Integrator for Triangles<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, ..] = draws.block(Block::new(0));
        let hit = |[shape, primitive]: [u32; 2]| {
            FirstHit::new([0.0; 3], [0.0, 0.0, 1.0], 1.0).with_shape(shape).with_primitive(primitive)
        };
        Estimate::new([0.5; 3]).with_first_hit((self.0)(u).map(hit))
    }
}

/// The share of 128x128 pixels that are refined.
fn refined(test: PbrtTest, policy: PilotPolicy, hit: impl Fn(f32) -> Option<[u32; 2]> + Sync) -> f64 {
    let size = frame(128, 128);
    let options = pbrt_options(4, 32, Stopping::Threshold, policy).test(test);
    let film = run(&mut Triangles(hit), &mut pbrt(options, 7), size, &Limits::spp(1000.0));
    let refined = film.counts().iter().filter(|&&n| n == 32).count();
    let others = film.counts().iter().filter(|&&n| n == 4).count();
    assert_eq!(refined + others, size.pixels());
    refined as f64 / size.pixels() as f64
}

#[test]
fn pixels_within_one_triangle_are_never_refined() {
    for policy in POLICIES {
        assert_eq!(refined(PbrtTest::ShapeId, policy, |_| Some([3, 5])), 0.0, "{policy:?}");
        assert_eq!(refined(PbrtTest::ShapeId, policy, |_| None), 0.0, "{policy:?}");
    }
}

#[test]
fn pixels_on_an_edge_are_refined_with_the_probability_that_samples_fall_to_both_sides() {
    for policy in POLICIES {
        for a in [0.5f32, 0.2, 0.03] {
            let closed = 1.0 - f64::from(a).powi(4) - f64::from(1.0 - a).powi(4);
            let error = (closed * (1.0 - closed) / 16384.0).sqrt();
            let triangles = |u: f32| Some([0, u32::from(u < a)]);
            let shapes = |u: f32| Some([u32::from(u < a), 0]);
            let silhouette = |u: f32| (u >= a).then_some([0, 0]);
            for found in [
                refined(PbrtTest::ShapeId, policy, triangles),
                refined(PbrtTest::ShapeId, policy, shapes),
                refined(PbrtTest::Shape, policy, shapes),
                refined(PbrtTest::ShapeId, policy, silhouette),
            ] {
                // 36 comparisons within 5 standard errors fail by chance with probability 2e-5.
                assert!((found - closed).abs() < 5.0 * error, "{policy:?}, {a}: {found} for {closed}");
            }
            // The control: edges within a shape do not count.
            assert_eq!(refined(PbrtTest::Shape, policy, triangles), 0.0);
        }
    }
}

#[test]
fn pixels_with_more_changes_come_first_within_a_budget() {
    let size = frame(64, 64);
    let options = pbrt_options(4, 32, Stopping::Budget, PilotPolicy::Keep).test(PbrtTest::ShapeId);
    // Refinement of all pixels would take 32 samples each.
    let mut scene = Triangles(|u: f32| Some([0, u32::from(u < 0.5)]));
    let film = run(&mut scene, &mut pbrt(options, 3), size, &Limits::spp(10.0));
    let changes = |i: usize| film.first_hits(i).windows(2).filter(|w| w[0] != w[1]).count();
    let least = (0..size.pixels()).filter(|&i| film.count(i) == 32).map(changes).min().unwrap();
    let most = (0..size.pixels()).filter(|&i| film.count(i) == 4).map(changes).max().unwrap();
    assert!(least >= most && least > 0, "{least} {most}");
}

#[test]
fn descriptions_name_the_test_and_large_pilots_are_refused_beside_it() {
    let made = |options| MitchellPbrt::with_options(dapple_low_discrepancy::Random::new(1), options);
    let options = MitchellPbrtOptions::parse("test=shapeid").unwrap();
    assert!(made(options).unwrap().describe().ends_with(",test=shapeid"));
    assert!(made(options.min(128).max(300)).is_ok() && made(options.min(129).max(300)).is_err());
}
