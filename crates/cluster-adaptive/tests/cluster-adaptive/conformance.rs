//! The sampler conforms in every combination.

use crate::common::*;
use dapple_cluster_adaptive::{
    AreaVectors, ClusterSize, ClusterThesis, ClusterThesisOptions, PixelArea, Placement, RateMap,
};
use dapple_clustering::Triangles;
use dapple_conformance::{Spending, sampler, sampler_on_frames};
use dapple_low_discrepancy::{Random, Sobol};

#[test]
fn the_published_combination_conforms() {
    let published = || probing(1, Placement::Centre, ClusterSize::ProjectedBox, ClusterThesisOptions::default());
    sampler(|| Box::new(published()));
}

#[test]
fn it_conforms_with_probes_made_beforehand() {
    let make = |frame: &dapple_core::Frame| {
        let made = ClusterThesis::published(Sobol::new(5), &probes(frame, Placement::Centre), &clusters());
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
        sampler(|| Box::new(probing(2, placement, size.clone(), options)));
    }
}

#[test]
fn the_description_has_all_parameters() {
    let sampler = probing(1, Placement::Jittered(4), ClusterSize::Hits, ClusterThesisOptions::default());
    let said = dapple_core::Sampler::describe(&sampler);
    let wanted = "cluster-thesis:probes=4,size=hits,pixel=one,map=root,angle=0.25,distance=0.25,min=0,max=0,lights=0,policy=a-priori";
    assert_eq!(said, wanted);
}

#[test]
fn probes_of_another_frame_are_refused() {
    let probes = probes(&frame(8, 8), Placement::Centre);
    let mut sampler = ClusterThesis::published(Random::new(1), &probes, &clusters()).unwrap();
    let refused = first_counts(&mut sampler, frame(8, 9), 1000, [1, 100]).unwrap_err().to_string();
    assert!(refused.contains("[8, 8]") && refused.contains("[8, 9]"), "{refused}");
    let crop = frame(16, 16).crop(0, 0, 8, 8).unwrap();
    assert!(first_counts(&mut sampler, crop, 1000, [1, 100]).is_err(), "a window of the same size is another frame");
}

#[test]
fn probing_later_is_probing_before() {
    let size = frame(19, 18);
    let mut later = probing(3, Placement::Jittered(2), ClusterSize::ProjectedBox, ClusterThesisOptions::default());
    let handle = later.handle();
    assert!(handle.cost().is_none());
    let counts = first_counts(&mut later, size, 16 * 342, [1, 1000]).unwrap();
    let cost = handle.cost().unwrap();
    assert!(cost.rays == 2 * 342 && cost.seconds > 0.0, "{cost:?}");
    let probes = probes(&size, Placement::Jittered(2));
    assert_eq!(handle.probes().unwrap().all(), probes.all());
    assert_eq!(handle.probes().unwrap().cluster_map().len(), 342);
    let size_of = ClusterSize::ProjectedBox;
    let mut before =
        ClusterThesis::with_options(Random::new(3), &probes, &clusters(), size_of, ClusterThesisOptions::default())
            .unwrap();
    assert_eq!(first_counts(&mut before, size, 16 * 342, [1, 1000]).unwrap(), counts);
}
