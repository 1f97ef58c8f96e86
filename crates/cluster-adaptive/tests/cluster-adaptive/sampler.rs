//! The sampler conforms in every combination, reads no radiance, and knows the lights' visibility.

use crate::support::*;
use dapple_cluster_adaptive::{
    AreaVectors, ClusterSize, ClusterThesis, ClusterThesisOptions, FirstHitRay, FirstHitSource, PixelArea, Placement,
    RateMap, TraceVisibility, first_hits, visibility_variances,
};
use dapple_clustering::Triangles;
use dapple_conformance::toys::{Field, raised};
use dapple_conformance::{Spending, sampler, sampler_on_frames};
use dapple_core::{Needs, Sampler as _};
use dapple_low_discrepancy::{Random, Sobol};
use std::sync::Arc;

#[test]
fn the_published_combination_conforms() {
    let published = || tracing(1, Placement::Centre, ClusterSize::ProjectedBox, ClusterThesisOptions::default());
    sampler(|| Box::new(published()));
}

#[test]
fn it_conforms_with_first_hits_made_beforehand() {
    let make = |frame: &dapple_core::Frame| {
        let made = ClusterThesis::published(Sobol::new(5), &seen(frame, Placement::Centre), &clusters());
        Box::new(made.unwrap()) as Box<dyn dapple_core::Sampler>
    };
    sampler_on_frames(make, Spending::Exact);
}

fn area_vectors() -> ClusterSize {
    let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let indices = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    let triangles = Triangles::new(&positions, &indices);
    ClusterSize::ProjectedTriangles(AreaVectors::new(&triangles, &LABELS, 4).unwrap())
}

#[test]
fn other_combinations_conform() {
    let corrected = ClusterThesisOptions::default().pixel(PixelArea::Footprint).angle(0.0).distance(0.0);
    for (placement, size, options) in [
        (Placement::Jittered(4), ClusterSize::Hits, corrected.map(RateMap::Identity)),
        (Placement::Jittered(3), area_vectors(), corrected.map(RateMap::Log)),
        (Placement::Centre, ClusterSize::ScreenBox(LOOK), corrected.min(1).max(0)),
        (Placement::Centre, ClusterSize::ProjectedBox, corrected.angle(3.0).max(64)),
    ] {
        sampler(|| Box::new(tracing(2, placement, size.clone(), options)));
    }
}

#[test]
fn the_description_has_all_parameters() {
    let sampler = tracing(1, Placement::Jittered(4), ClusterSize::Hits, ClusterThesisOptions::default());
    let said = dapple_core::Sampler::describe(&sampler);
    let wanted = "cluster-thesis:rays=4,size=hits,pixel=one,map=root,angle=0.25,distance=0.25,min=0,max=0,lights=0,policy=a-priori";
    assert_eq!(said, wanted);
}

#[test]
fn first_hits_of_another_frame_are_refused() {
    let first_hits = seen(&frame(8, 8), Placement::Centre);
    let mut sampler = ClusterThesis::published(Random::new(1), &first_hits, &clusters()).unwrap();
    let refused = first_counts(&mut sampler, frame(8, 9), 1000, [1, 100]).unwrap_err().to_string();
    assert!(refused.contains("traced for 8x8 pixels") && refused.contains("to render is 8x9 pixels"), "{refused}");
    let crop = frame(16, 16).crop(0, 0, 8, 8).unwrap();
    assert!(first_counts(&mut sampler, crop, 1000, [1, 100]).is_err(), "a window of the same size is another frame");
}

#[test]
fn tracing_first_hits_later_is_tracing_them_before() {
    let size = frame(19, 18);
    let mut later = tracing(3, Placement::Jittered(2), ClusterSize::ProjectedBox, ClusterThesisOptions::default());
    let handle = later.handle();
    assert!(handle.cost().is_none());
    let counts = first_counts(&mut later, size, 16 * 342, [1, 1000]).unwrap();
    let cost = handle.cost().unwrap();
    assert!(cost.rays == 2 * 342 && cost.seconds > 0.0, "{cost:?}");
    let first_hits = seen(&size, Placement::Jittered(2));
    assert_eq!(handle.first_hits().unwrap().all(), first_hits.all());
    assert_eq!(handle.first_hits().unwrap().cluster_map().len(), 342);
    let size_of = ClusterSize::ProjectedBox;
    let mut before =
        ClusterThesis::with_options(Random::new(3), &first_hits, &clusters(), size_of, ClusterThesisOptions::default())
            .unwrap();
    assert_eq!(first_counts(&mut before, size, 16 * 342, [1, 1000]).unwrap(), counts);
}

/// Two images with nothing in common have the same counts. So they do not bias the image.
#[test]
fn counts_do_not_read_radiance_a01() {
    let (at, pixels) = (frame(64, 64), 64 * 64);
    let budgets = [pixels, 3 * pixels + 1, 10 * pixels];
    let ours = || tracing(1, Placement::Centre, ClusterSize::ProjectedBox, ClusterThesisOptions::default());
    let dark = raised(&mut Field(|_, _| [0.0; 3]), &mut ours(), Needs::none(), at, &budgets);
    let mut noisy = Field(|[x, y]: [u32; 2], u: [f32; 4]| [if x > y { f32::NAN } else { 100.0 * u[0] }; 3]);
    let bright = raised(&mut noisy, &mut ours(), Needs::none(), at, &budgets);
    assert_eq!(dark.counts(), bright.counts());
    assert!(dark.counts().iter().max() > dark.counts().iter().min());
}

/// The floor's side in clusters. Each covers 2 x 2 pixels.
const SIDE: u32 = 32;

/// The place of a film position on the floor, from -2 to 2.
fn place(film: [f32; 2]) -> f32 {
    film[0] / (2 * SIDE) as f32 * 4.0 - 2.0
}

fn cluster_of(ray: &FirstHitRay) -> u32 {
    let [x, y] = ray.film.map(|f| (f / 2.0) as u32 % SIDE);
    y * SIDE + x
}

/// A lamp from -0.6 to 0.6 above the floor. Half way, a card hides it from one half of the floor.
fn half_hidden() -> TraceVisibility {
    Arc::new(|ray: FirstHitRay, [_, u, _]: [f32; 3]| 1.2 * u - 0.6 > -place(ray.film))
}

/// The fraction of the lamp that a place on the floor sees.
fn visible(x: f64) -> f64 {
    ((x + 0.6) / 1.2).clamp(0.0, 1.0)
}

fn floor_sampler(placement: Placement, lights: u32) -> ClusterThesis<Random> {
    let source = FirstHitSource {
        labels: (0..SIDE * SIDE).collect(),
        clusters: vec![square(1.0); (SIDE * SIDE) as usize].into(),
        shoot: Arc::new(|ray: FirstHitRay| Some(hit(cluster_of(&ray)))),
        placement,
        described: String::new(),
    };
    let options = ClusterThesisOptions::default().min(1).max(1000).lights(lights);
    ClusterThesis::tracing(Random::new(1), source, ClusterSize::Hits, options).unwrap()
}

/// The mean counts of full light, penumbra and full shadow, and the counts of all.
fn mean_counts(sampler: &mut ClusterThesis<Random>) -> ([f64; 3], Vec<u32>) {
    let at = frame(2 * SIDE, 2 * SIDE);
    let counts = first_counts(sampler, at, 64 * at.pixels() as u64, [1, 1000]).unwrap();
    let (mut sums, mut pixels) = ([0.0; 3], [0.0; 3]);
    for (i, &count) in counts.iter().enumerate() {
        let x = place([(i as u32 % (2 * SIDE)) as f32 + 0.5, 0.0]);
        let part = match x {
            0.75.. => 0,
            -0.3..0.3 => 1,
            ..-0.75 => 2,
            _ => continue,
        };
        (sums[part], pixels[part]) = (sums[part] + f64::from(count), pixels[part] + 1.0);
    }
    ([0, 1, 2].map(|k| sums[k] / pixels[k]), counts)
}

#[test]
fn variances_of_visibility_are_those_of_the_penumbra() {
    let at = frame(2 * SIDE, 2 * SIDE);
    let labels: Vec<u32> = (0..SIDE * SIDE).collect();
    let clusters = labels.len();
    for placement in [Placement::Centre, Placement::Jittered(3)] {
        let shoot = |ray: FirstHitRay| (ray.film[1] < 40.0).then(|| hit(cluster_of(&ray)));
        let points = Random::new(1);
        let first_hits = first_hits(&at, placement, &points, &labels, shoot).unwrap();
        let of = |rays| visibility_variances(&first_hits, clusters, &points, rays, &*half_hidden()).unwrap();
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
    let first_hits = seen(&frame(8, 8), Placement::Centre);
    let options = ClusterThesisOptions::default().lights(4);
    let made = ClusterThesis::with_options(Random::new(1), &first_hits, &clusters(), ClusterSize::Hits, options);
    assert!(made.is_err());
}

#[test]
fn clusters_that_know_the_lights_conform() {
    sampler(|| {
        let options = ClusterThesisOptions::default().lights(3);
        Box::new(tracing(2, Placement::Jittered(2), ClusterSize::Hits, options).with_visibility(half_hidden()))
    });
}
