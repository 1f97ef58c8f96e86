//! Methods made without a scene.

use super::*;
use dapple_cluster_adaptive::{ProbeHit, ProbeRay};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, FirstHit, Frame, Integrator, Limits, Render, Worker};

const SETTING: Setting = Setting { seed: 5, spp: Some(16) };

fn refusal<T>(made: Result<T, RegistryError>) -> String {
    made.err().map(|e| e.to_string()).unwrap_or_default()
}

fn sobol() -> AnyPoints {
    points("sobol", SETTING).expect("a point set")
}

#[test]
fn the_default_pair_is_made_of_the_defaults_by_name() {
    let (none, pair) = (HostClusters::none(), default_pair(9));
    let points = points(DEFAULT_POINTS, Setting { seed: 9, spp: None }).expect("points");
    let sampler = sampler(DEFAULT_SAMPLER, points, &none).expect("a sampler").sampler;
    assert_eq!(pair.sampler.describe(), sampler.describe());
    assert_eq!(pair.sampler.points().describe(), sampler.points().describe());
    let filter = filter(DEFAULT_FILTER, &none).expect("a filter");
    let paired = pair.filter.unwrap();
    assert_eq!((paired.describe(), paired.needs()), (filter.describe(), filter.needs()));
}

#[test]
fn without_clusters_only_methods_that_cannot_do_without_are_refused() {
    let none = HostClusters::none();
    let refused = |entries: Vec<(&'static str, String)>| -> Vec<&'static str> {
        entries.iter().filter(|(_, error)| error.contains("cluster inputs")).map(|entry| entry.0).collect()
    };
    let filters = FILTERS.iter().map(|entry| (entry.name, refusal(filter(entry.name, &none)))).collect();
    let samplers = SAMPLERS.iter().map(|entry| (entry.name, refusal(sampler(entry.name, sobol(), &none)))).collect();
    assert_eq!((refused(filters), refused(samplers)), (vec!["cluster-gaussian"], vec!["cluster-thesis"]));
    assert_eq!(filter("cluster-regression", &none).expect("a filter").needs().first_hits, 0);
    assert!(check_filter("cluster-gaussian").is_ok() && check_sampler("cluster-thesis").is_ok());
    let error = refusal(filter("cluster-gaussian", &none));
    assert_eq!(
        error,
        "cluster-gaussian needs clusters of the scene's surfaces; give it a world, or cluster inputs that have this"
    );
}

/// Two touching balls before a sky: a renderer without triangles. Its first hits have the ball's number.
struct Balls;

const SIZE: [u32; 2] = [24, 16];

/// The ball at this place of the film.
fn ball([x, y]: [f32; 2]) -> Option<u32> {
    let inside = |cx: f32, radius: f32| (x - cx).hypot(y - 8.0) < radius;
    if inside(7.0, 5.0) { Some(0) } else { inside(14.0, 3.0).then_some(1) }
}

impl Integrator for Balls {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, light, _] = draws.block(Block::new(0));
        let place = [draws.pixel()[0] as f32 + u, draws.pixel()[1] as f32 + v];
        let ball = ball(place);
        let hit = ball.map(|number| FirstHit::new([place[0], place[1], 0.0], [0.0, 0.0, 1.0], 10.0).with_shape(number));
        let radiance = ball.map_or(0.25, |number| light * (1.0 + 0.2 * number as f32));
        Estimate::new([radiance; 3]).with_first_hit(hit)
    }
}

fn probes() -> ClusterProbes {
    let bounds = [[[2.0, 3.0, 0.0], [12.0, 13.0, 10.0]], [[11.0, 5.0, 0.0], [17.0, 11.0, 6.0]]];
    ClusterProbes::of_objects(&bounds, |ray: ProbeRay| {
        ball(ray.film).map(|primitive| ProbeHit {
            primitive,
            direction: [0.0, 0.0, -1.0],
            distance: 10.0,
            normal: [0.0, 0.0, 1.0],
            footprint: 1.0,
        })
    })
}

#[test]
fn a_renderer_without_triangles_gets_clusters_by_the_numbers_of_its_objects() {
    let clusters = HostClusters::none().with_labels(|hit| Some(hit.shape)).with_probes(probes());
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let limits = Limits::samples(16 * frame.pixels() as u64);
    for name in ["cluster-gaussian", "bilateral:outside=0.2", "cluster-regression"] {
        let labelled = filter(name, &clusters).expect("a filter");
        assert!(labelled.needs().first_hits > 0, "{name} reads no clusters");
        let film: Film = Render::new(frame, &limits)
            .needs(labelled.needs())
            .run(&mut Balls, &mut Uniform::new(sobol()))
            .expect("a film");
        let image = labelled.apply(&film).expect("an image").radiance;
        let one = HostClusters::none().with_labels(|_| Some(0));
        let whole = filter(name, &one).expect("a filter").apply(&film).expect("an image").radiance;
        assert!(image != whole, "{name}: clusters have no effect");
    }
    let mut made = sampler("cluster-thesis", sobol(), &clusters).expect("a sampler");
    let film = Render::new(frame, &limits).run(&mut Balls, &mut *made.sampler).expect("a film");
    let count = |x: usize, y: usize| film.count(y * SIZE[0] as usize + x);
    assert!(count(14, 8) > count(7, 8), "the small ball gets more samples than the large one");
    assert_eq!(made.probes.probes().expect("probes").cost().rays, frame.pixels() as u64);
}

#[test]
fn sizes_of_clusters_that_need_more_of_the_scene_name_it() {
    let clusters = HostClusters::none().with_probes(probes());
    for (words, lacks) in [("size=screen", "the camera's matrix"), ("size=triangles", "the scene's triangles")] {
        let error = refusal(sampler(&format!("cluster-thesis:{words}"), sobol(), &clusters));
        assert!(error.contains(lacks), "{error}");
    }
    let identity = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| if i == j { 1.0 } else { 0.0 }));
    let clusters = clusters.with_world_to_clip(identity);
    assert_eq!(refusal(sampler("cluster-thesis:size=screen", sobol(), &clusters)), "");
}
