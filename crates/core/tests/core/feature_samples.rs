//! Samples of features alone: where they are traced, and where not.

use crate::common::{Independent, frame};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, FirstHit, Integrator, Limits, Needs, Render, Worker, streams};

const PLACE: Block = Block::new(0);

/// Two walls that meet within each pixel of odd columns, and one wall in the others.
struct Walls {
    alone: bool,
}

impl Walls {
    fn hit(draws: &Draws<'_>) -> FirstHit {
        let [u, ..] = draws.block(PLACE);
        let normal = if draws.pixel()[0] % 2 == 1 && u < 0.3 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        FirstHit::new([0.0; 3], normal, 1.0)
    }
}

impl Integrator for Walls {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        assert_ne!(draws.id().stream, streams::FEATURES);
        Estimate::new([draws.block(PLACE)[1]; 3]).with_first_hit(Self::hit(draws)).with_cost(3)
    }

    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        assert_eq!(draws.id().stream, streams::FEATURES);
        self.alone.then(|| Estimate::new([9.0; 3]).with_first_hit(Self::hit(draws)))
    }
}

fn film(alone: bool, spp: f64, needs: Needs) -> Film {
    let limits = Limits::spp(spp);
    let render = Render::new(frame(6, 4), &limits).needs(needs);
    render.run(&mut Walls { alone }, &mut Uniform::new(Independent::new(5))).unwrap()
}

fn samples(film: &Film) -> Vec<u32> {
    (0..24).map(|i| film.features(i).unwrap().samples).collect()
}

#[test]
fn features_are_sampled_again_where_they_vary_and_light_is_not() {
    let needs = Needs::none().with_features();
    let (with, without) = (film(true, 4.0, needs), film(false, 4.0, needs));
    assert_eq!(with.image(), without.image());
    assert_eq!(samples(&without), [4; 24]);
    let found = samples(&with);
    // 8 samples miss the second wall in 6 % of the odd columns.
    assert!(found.iter().enumerate().all(|(i, n)| if i % 2 == 1 { [8, 16].contains(n) } else { *n == 8 }), "{found:?}");
    assert!(found.iter().filter(|n| **n == 16).count() >= 9, "{found:?}");
    assert_eq!(with.record().samples, without.record().samples);
    let alone: u32 = found.iter().map(|n| n - 4).sum();
    assert_eq!(with.record().rays, without.record().rays + u64::from(alone));
}

#[test]
fn known_features_are_not_sampled_again() {
    for (spp, needs) in [
        (16.0, Needs::none().with_features()),
        (4.0, Needs::none().with_feature_halves()),
        (4.0, Needs::none().with_first_hits(1)),
    ] {
        let [with, without] = [true, false].map(|alone| film(alone, spp, needs));
        assert_eq!(with.record().rays, without.record().rays, "{needs:?}");
        assert_eq!(with.features(1), without.features(1));
    }
}
