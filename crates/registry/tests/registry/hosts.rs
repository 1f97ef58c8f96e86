//! Creation of methods without a scene.

use dapple_cluster_adaptive::{FirstHitRay, FirstHitSurface};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, FirstHit, Frame, Integrator, Limits, Render, Worker};
use dapple_registry::{
    AnyPoints, ClusterFirstHits, DEFAULT_FILTER, DEFAULT_POINTS, DEFAULT_SAMPLER, FILTERS, HostClusters, POINTS,
    PointSettings, RegistryError, SAMPLERS, check_filter, check_sampler, default_pair, filter, points, sampler,
};

const SETTING: PointSettings = PointSettings { seed: 5, spp: Some(16) };

fn refusal<T>(made: Result<T, RegistryError>) -> String {
    made.err().map(|e| e.to_string()).unwrap_or_default()
}

fn sobol() -> AnyPoints {
    points("sobol", SETTING).expect("a point set")
}

#[test]
fn the_default_pair_is_made_of_the_defaults_by_name() {
    let (none, pair) = (HostClusters::none(), default_pair(9));
    let points = points(DEFAULT_POINTS, PointSettings { seed: 9, spp: None }).expect("points");
    let sampler = sampler(DEFAULT_SAMPLER, points, &none).expect("a sampler").sampler;
    assert_eq!(pair.sampler.describe(), sampler.describe());
    assert_eq!(pair.sampler.points().describe(), sampler.points().describe());
    let filter = filter(DEFAULT_FILTER, &none).expect("a filter");
    let paired = pair.filter.unwrap();
    assert_eq!((paired.describe(), paired.needs()), (filter.describe(), filter.needs()));
}

#[test]
fn every_method_states_where_it_fails() {
    let samplers = SAMPLERS.iter().map(|entry| (entry.name, entry.weakness));
    let points = POINTS.iter().map(|entry| (entry.name, entry.weakness));
    let filters = FILTERS.iter().map(|entry| (entry.name, entry.weakness));
    for (name, weakness) in samplers.chain(points).chain(filters) {
        assert!(!weakness.trim().is_empty(), "{name}: write its weakness into its entry");
    }
}

#[test]
fn counts_follow_each_error_that_the_help_offers_under_the_policy_that_it_names() {
    let none = HostClusters::none();
    let adaptive = SAMPLERS.iter().find(|entry| entry.name == "adaptive").expect("the default");
    let by =
        adaptive.parameters.iter().copied().flatten().find(|parameter| parameter.name == "by").expect("a parameter");
    let (alone, kept) = by.help.split_once("policy=keep").expect("the condition of error maps");
    assert!(alone.contains(by.default));
    for name in ["nlm", "bilateral", "cluster-regression"] {
        let made = sampler(&format!("adaptive:policy=keep,by={name}"), sobol(), &none);
        assert!(kept.contains(name) && made.is_ok(), "{name}: {}", refusal(made));
        let error = refusal(sampler(&format!("adaptive:by={name}"), sobol(), &none));
        assert!(error.contains("policy=keep"), "{name}: {error}");
    }
}

#[test]
fn without_clusters_only_methods_that_cannot_do_without_are_refused() {
    let none = HostClusters::none();
    let refused = |entries: Vec<(&'static str, String)>| -> Vec<&'static str> {
        entries.iter().filter(|(_, error)| error.contains("pass ClusterInputs")).map(|entry| entry.0).collect()
    };
    let filters = FILTERS.iter().map(|entry| (entry.name, refusal(filter(entry.name, &none)))).collect();
    let samplers = SAMPLERS.iter().map(|entry| (entry.name, refusal(sampler(entry.name, sobol(), &none)))).collect();
    let (mut filters, mut samplers) = (refused(filters), refused(samplers));
    // These need the meaning of coordinates or the lens instead of clusters.
    filters.retain(|name| !["mdas-boxes", "tlfr", "tree-mean", "staged", "splat", "dct"].contains(name));
    samplers.retain(|name| !["mdas", "subdivision", "hierarchical", "fourier-dof", "dct"].contains(name));
    assert_eq!((filters, samplers), (vec!["cluster-gaussian"], vec!["cluster-thesis"]));
    assert!(!filter("cluster-regression", &none).expect("a filter").needs().surfaces);
    assert!(check_filter("cluster-gaussian").is_ok() && check_sampler("cluster-thesis").is_ok());
    let error = refusal(filter("cluster-gaussian", &none));
    assert_eq!(
        error,
        "cluster-gaussian needs clusters of the scene's surfaces; pass ClusterInputs that provide this, such as those of a world"
    );
}

/// Two touching balls before a sky: a renderer without triangles. Its first hits have the ball's number.
struct Balls;

const SIZE: [u32; 2] = [24, 16];

/// The ball at this point of the film.
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

fn first_hits() -> ClusterFirstHits {
    let bounds = [[[2.0, 3.0, 0.0], [12.0, 13.0, 10.0]], [[11.0, 5.0, 0.0], [17.0, 11.0, 6.0]]];
    ClusterFirstHits::of_objects(&bounds, |ray: FirstHitRay| {
        ball(ray.film).map(|primitive| FirstHitSurface {
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
    let clusters =
        HostClusters { first_hits: Some(first_hits()), ..HostClusters::none().with_labels(|shape, _| Some(shape)) };
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let limits = Limits::samples(16 * frame.pixels() as u64);
    for name in ["cluster-gaussian", "bilateral:outside=0.2", "cluster-regression"] {
        let labelled = filter(name, &clusters).expect("a filter");
        assert!(labelled.needs().surfaces || labelled.needs().first_hits > 0, "{name} reads no clusters");
        let film: Film = Render::new(frame, &limits)
            .needs(labelled.needs())
            .run(&mut Balls, &mut Uniform::new(sobol()))
            .expect("a film");
        let image = labelled.apply(&film).expect("an image").radiance;
        let one = HostClusters::none().with_labels(|_, _| Some(0));
        let whole = filter(name, &one).expect("a filter").apply(&film).expect("an image").radiance;
        assert!(image != whole, "{name}: clusters have no effect");
    }
    let mut made = sampler("cluster-thesis", sobol(), &clusters).expect("a sampler");
    let film = Render::new(frame, &limits).run(&mut Balls, &mut *made.sampler).expect("a film");
    let count = |x: usize, y: usize| film.count(y * SIZE[0] as usize + x);
    assert!(count(14, 8) > count(7, 8), "the small ball gets more samples than the large one");
    assert_eq!(made.first_hits.first_hits().expect("first hits").cost().rays, frame.pixels() as u64);
}

#[test]
fn sizes_of_clusters_that_need_more_of_the_scene_name_it() {
    let clusters = HostClusters { first_hits: Some(first_hits()), ..HostClusters::none() };
    for (words, lacks) in [("size=screen", "the camera's matrix"), ("size=triangles", "the scene's triangles")] {
        let error = refusal(sampler(&format!("cluster-thesis:{words}"), sobol(), &clusters));
        assert!(error.contains(lacks), "{error}");
    }
    let error = refusal(sampler("cluster-thesis:lights=16", sobol(), &clusters));
    assert!(error.contains("shadow rays to the scene's lights"), "{error}");
    let seen = HostClusters { visibility: Some(std::sync::Arc::new(|_, _| true)), ..clusters.clone() };
    assert_eq!(refusal(sampler("cluster-thesis:lights=16", sobol(), &seen)), "");
    let identity = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| if i == j { 1.0 } else { 0.0 }));
    let clusters = HostClusters { world_to_clip: Some(identity), ..clusters };
    assert_eq!(refusal(sampler("cluster-thesis:size=screen", sobol(), &clusters)), "");
}

#[test]
fn a_sequence_of_samplers_is_made_of_nested_descriptions() {
    let none = HostClusters::none();
    let described = |words: &str| sampler(words, sobol(), &none).expect("a sampler").sampler.describe();
    let of = |name: &str| dapple_core::options::nested(&described(name));
    assert_eq!(described("sequence"), format!("sequence:first=uniform,spp=4,second={}", of("adaptive")));
    let words = "sequence:first=cycles/min=3/step=5,spp=6,second=mitchell/policy=discard";
    let [first, second] = [of("cycles:min=3,step=5"), of("mitchell:policy=discard")];
    assert_eq!(described(words), format!("sequence:first={first},spp=6,second={second}"));
    // Three stages: each separator of the inner sequence's own samplers is doubled.
    let words = "sequence:first=sequence/first=uniform/spp=2/second=cycles//min=3,spp=9,second=uniform";
    let inner = described("sequence:first=uniform,spp=2,second=cycles/min=3");
    assert_eq!(
        described(words),
        format!("sequence:first={},spp=9,second=uniform", dapple_core::options::nested(&inner))
    );
    assert_eq!(described(&described(words)), described(words));
}

#[test]
fn faults_of_nested_descriptions_name_the_parameter_and_the_remedy() {
    let refused = |words: &str| refusal(check_sampler(words).map(|()| 0));
    let says = |words: &str, parts: [&str; 2]| {
        let error = refused(words);
        assert!(error.starts_with("sequence: ") && parts.iter().all(|part| error.contains(part)), "{words}: {error}");
    };
    says("sequence:first=unifrom", ["first = \"unifrom\": there is no sampler", "did you mean \"uniform\"?"]);
    says(
        "sequence:second=cycles/mim=3",
        ["second = \"cycles/mim=3\": cycles: there is no parameter", "did you mean \"min\""],
    );
    says("sequence:second=cycles:min=3", ["write \"/\" for \":\" and \",\"", "second=cycles/min=3"]);
    says("sequence:first=cycles/step=0", ["first = \"cycles/step=0\": cycles: ", "step"]);
    says("sequence:spp=0", ["spp = 0 is out of range", "at least 1 sample per pixel"]);
    says("sequence:spp=few", ["spp = \"few\"", "is not a number; give a number"]);
    says("sequence:frist=uniform", ["there is no parameter \"frist\"", "did you mean \"first\"?"]);
    assert!(check_sampler("sequence:first=cluster-thesis/k=3").is_ok(), "clusters are checked with the scene");
    let error = refusal(sampler("sequence:first=cluster-thesis", sobol(), &HostClusters::none()));
    assert!(error.starts_with("cluster-thesis needs clusters"), "{error}");
}

#[test]
fn a_sequence_passes_on_the_first_hits_of_its_samplers() {
    let clusters = HostClusters { first_hits: Some(first_hits()), ..HostClusters::none() };
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    let pixels = frame.pixels() as u64;
    for (words, rays) in [
        ("sequence:first=cluster-thesis,second=adaptive", pixels),
        ("sequence:first=uniform,second=cluster-thesis/rays=2", 2 * pixels),
        ("sequence:first=cluster-thesis,second=cluster-thesis/probes=2", 3 * pixels),
        ("sequence:first=sequence/first=uniform/spp=2/second=cluster-thesis,spp=5,second=uniform", pixels),
    ] {
        let mut made = sampler(words, sobol(), &clusters).expect("a sampler");
        assert!(made.first_hits.cost().is_none());
        let film = Render::new(frame, &Limits::samples(16 * pixels + 7)).run(&mut Balls, &mut *made.sampler);
        assert_eq!(film.expect("a film").record().samples, 16 * pixels + 7, "{words}");
        assert_eq!(
            (made.first_hits.cost().map(|cost| cost.rays), made.first_hits.rejected()),
            (Some(rays), 0),
            "{words}"
        );
    }
}

#[cfg(feature = "classics")]
#[test]
fn samples_are_placed_for_renderers_that_name_their_dimensions() {
    use dapple_classics::{Axis, Domain, FilmPoints, Role};
    let place = [0, 1].map(|lane| Axis::new(Role::Place, 0, lane));
    let domain = Domain::new(place).expect("a domain");
    let host = HostClusters { domain: Some(domain.clone()), ..HostClusters::none() };
    let frame = Frame::new(SIZE[0], SIZE[1]).expect("not empty");
    for (name, reconstruction) in [
        ("mdas", "mdas-boxes"),
        ("subdivision", "tree-mean"),
        ("subdivision", "staged"),
        ("hierarchical", "tree-mean:tree=contrast"),
    ] {
        let error = refusal(sampler(name, sobol(), &HostClusters::none()));
        assert!(error.contains("the meaning of the samples' dimensions"), "{error}");
        let made = sampler(name, sobol(), &host).expect("a sampler");
        let points = FilmPoints::new(std::sync::Arc::from(sobol()), domain.clone()).with_placed(made.placed);
        let host = HostClusters { film_points: Some(points), ..host.clone() };
        let filter = filter(reconstruction, &host).expect("a filter");
        let mut sampler = made.sampler;
        let limits = Limits::spp(8.0);
        let render = Render::new(frame, &limits).needs(filter.needs()).recorders(filter.recorders());
        let film = render.run(&mut Balls, &mut *sampler);
        let image = filter.apply(&film.expect("a film")).expect("an image").radiance;
        // The sky.
        assert!((image[0][0] - 0.25).abs() < 1e-5, "{name}: {:?}", image[0]);
    }
}

/// The shifts stay the default, also in the point set's description.
#[test]
fn keys_of_blue_noise_are_shifts_unless_optimised_ones_are_requested() {
    let described = |name: &str| points(name, SETTING).map(|points| points.describe());
    assert_eq!(described("blue-noise").unwrap(), "blue-noise:seed=5,of=sobol:seed=5");
    assert_eq!(described("blue-noise:keys=shifts").unwrap(), "blue-noise:seed=5,of=sobol:seed=5");
    assert_eq!(described("blue-noise:keys=optimised").unwrap(), "blue-noise:seed=5,keys=optimised,of=sobol");
    let refused = refusal(described("blue-noise:of=halton,keys=optimised"));
    assert!(refused.contains("for sobol only; use keys=shifts"), "{refused}");
    assert!(refusal(described("blue-noise:keys=best")).contains("shifts, optimised"));
}
