//! Clusters that know the lights' visibility.

use crate::common::*;
use dapple_cluster_adaptive::{
    ClusterSize, ClusterThesis, ClusterThesisOptions, Placement, ProbeRay, ProbeSource, TraceVisibility, probe,
    visibility_variances,
};
use dapple_conformance::sampler;
use dapple_core::Sampler as _;
use dapple_low_discrepancy::Random;
use std::sync::Arc;

/// The floor's side in clusters. Each covers 2 x 2 pixels.
const SIDE: u32 = 32;

/// The place of a film position on the floor, from -2 to 2.
fn place(film: [f32; 2]) -> f32 {
    film[0] / (2 * SIDE) as f32 * 4.0 - 2.0
}

fn cluster_of(ray: &ProbeRay) -> u32 {
    let [x, y] = ray.film.map(|f| (f / 2.0) as u32 % SIDE);
    y * SIDE + x
}

/// A lamp from -0.6 to 0.6 above the floor. Half way, a card hides it from one half of the floor.
fn half_hidden() -> TraceVisibility {
    Arc::new(|ray: ProbeRay, [_, u, _]: [f32; 3]| 1.2 * u - 0.6 > -place(ray.film))
}

/// The fraction of the lamp that a place on the floor sees.
fn visible(x: f64) -> f64 {
    ((x + 0.6) / 1.2).clamp(0.0, 1.0)
}

fn floor_sampler(placement: Placement, lights: u32) -> ClusterThesis<Random> {
    let source = ProbeSource {
        labels: (0..SIDE * SIDE).collect(),
        clusters: vec![square(1.0); (SIDE * SIDE) as usize].into(),
        shoot: Arc::new(|ray: ProbeRay| Some(hit(cluster_of(&ray)))),
        placement,
        described: String::new(),
    };
    let options = ClusterThesisOptions::default().min(1).max(1000).lights(lights);
    ClusterThesis::probing(Random::new(1), source, ClusterSize::Hits, options).unwrap()
}

/// The mean counts of full light, penumbra and full shadow, and the counts of all.
fn mean_counts(sampler: &mut ClusterThesis<Random>) -> ([f64; 3], Vec<u32>) {
    let at = frame(2 * SIDE, 2 * SIDE);
    let counts = first_counts(sampler, at, 64 * at.pixels() as u64, [1, 1000]).unwrap();
    let (mut sums, mut pixels) = ([0.0; 3], [0.0; 3]);
    for (i, &count) in counts.iter().enumerate() {
        let x = place([(i as u32 % (2 * SIDE)) as f32 + 0.5, 0.0]);
        let part = if x > 0.75 {
            0
        } else if x.abs() < 0.3 {
            1
        } else {
            2
        };
        if part < 2 || x < -0.75 {
            (sums[part], pixels[part]) = (sums[part] + f64::from(count), pixels[part] + 1.0);
        }
    }
    ([0, 1, 2].map(|k| sums[k] / pixels[k]), counts)
}

#[test]
fn variances_of_visibility_are_those_of_the_penumbra() {
    let at = frame(2 * SIDE, 2 * SIDE);
    let labels: Vec<u32> = (0..SIDE * SIDE).collect();
    let clusters = labels.len();
    for placement in [Placement::Centre, Placement::Jittered(3)] {
        let shoot = |ray: ProbeRay| (ray.film[1] < 40.0).then(|| hit(cluster_of(&ray)));
        let points = Random::new(1);
        let probes = probe(&at, placement, &points, &labels, shoot).unwrap();
        let of = |rays| visibility_variances(&probes, clusters, &points, rays, &*half_hidden()).unwrap();
        let found = of(256);
        for (i, &variance) in found.iter().enumerate() {
            let x = (f64::from(i as u32 % SIDE) + 0.5) / f64::from(SIDE) * 4.0 - 2.0;
            let expected = if i as u32 / SIDE < 20 { visible(x) * (1.0 - visible(x)) } else { 0.0 };
            // A cluster is 0.125 wide, a tenth of the penumbra, and its hits lie anywhere in it.
            assert!((f64::from(variance) - expected).abs() < 0.03, "{placement} {i}: {variance} {expected}");
        }
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool(1).install(|| of(7)) == pool(3).install(|| of(7)));
    }
}

#[test]
fn clusters_in_the_penumbra_get_more_samples_than_those_in_full_light_or_shadow() {
    for placement in [Placement::Centre, Placement::Jittered(4)] {
        let ([light, penumbra, shadow], _) =
            mean_counts(&mut floor_sampler(placement, 64).with_visibility(half_hidden()));
        // 1 + v (1 - v) is 1.23 on average between -0.3 and 0.3.
        assert!(
            (penumbra / light - 1.23).abs() < 0.02 && (penumbra / shadow - 1.23).abs() < 0.02,
            "{penumbra} {light}"
        );
        // Negative control: without shadow rays all counts are the same but for rounding.
        let ([light, penumbra, shadow], counts) = mean_counts(&mut floor_sampler(Placement::Centre, 0));
        assert!((penumbra - light).abs() < 0.1 && (penumbra - shadow).abs() < 0.1);
        assert!(counts.iter().all(|&n| n == 64));
    }
}

#[test]
fn without_shadow_rays_counts_stay_as_they_are() {
    let size = ClusterSize::ProjectedBox;
    let mut plain = probing(3, Placement::Jittered(2), size.clone(), ClusterThesisOptions::default());
    let mut off =
        probing(3, Placement::Jittered(2), size, ClusterThesisOptions::default()).with_visibility(half_hidden());
    let counts =
        |sampler: &mut ClusterThesis<Random>| first_counts(sampler, frame(19, 18), 16 * 342, [1, 1000]).unwrap();
    assert_eq!(counts(&mut plain), counts(&mut off));
}

#[test]
fn shadow_rays_are_counted_and_need_a_function() {
    let mut sampler = floor_sampler(Placement::Centre, 16);
    let at = frame(2 * SIDE, 2 * SIDE);
    let refused = first_counts(&mut sampler, at, 64 * at.pixels() as u64, [1, 1000]).unwrap_err().to_string();
    assert!(refused.contains("lights = 16") && refused.contains("shadow rays"), "{refused}");
    let mut sampler = sampler.with_visibility(half_hidden());
    assert!(sampler.a_priori() && sampler.describe().contains("lights=16"));
    mean_counts(&mut sampler);
    let traced = 2 * 16 * u64::from(SIDE * SIDE);
    assert_eq!(sampler.handle().cost().unwrap().rays, at.pixels() as u64 + traced);
    let probes = probes(&frame(8, 8), Placement::Centre);
    let options = ClusterThesisOptions::default().lights(4);
    let made = ClusterThesis::with_options(Random::new(1), &probes, &clusters(), ClusterSize::Hits, options);
    assert!(made.is_err());
}

#[test]
fn clusters_that_know_the_lights_conform() {
    sampler(|| {
        let options = ClusterThesisOptions::default().lights(3);
        Box::new(probing(2, Placement::Jittered(2), ClusterSize::Hits, options).with_visibility(half_hidden()))
    });
}
