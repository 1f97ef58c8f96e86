//! Samplers, point sets and filters by name, created for a world, and the clusters of its shapes.
#![allow(clippy::print_stderr, reason = "tests say when they skip")]

use dapple_core::{PointSet as _, SampleId, Sampler as _};
use dapple_job::WorldTriangles;
use dapple_job::registry::{
    AnyPoints, FILTERS, MethodInputs, NOT_BUILT, POINTS, Parameter, PointSettings, RegistryError, SAMPLERS,
    check_filter, check_sampler, film_points, filter, points, sampler,
};
use dapple_renderer::World;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{Effect, Scene, bundled};
use std::sync::Arc;

const SETTING: PointSettings = PointSettings { seed: 5, spp: Some(16) };

/// A scene for which all methods can be created: light from a point light scatters once, and the camera has a lens.
fn inputs() -> MethodInputs {
    let mut scene = scene("furnace");
    scene.max_depth = Some(1);
    (scene.camera.lens_radius, scene.camera.focal_distance) = (0.05, 1.0);
    let scene = dapple_renderer::without(&scene, Effect::SoftShadows).unwrap();
    let world = Arc::new(World::new(&scene).unwrap());
    let points = Arc::from(points("sobol", SETTING).unwrap());
    let points = film_points(&world, points).expect("a box filter");
    MethodInputs { points: Some(points), ..MethodInputs::of(world) }
}

fn sobol() -> AnyPoints {
    points("sobol", SETTING).unwrap()
}

/// The bundled scene, and its world at this size.
fn world(name: &str, size: [u32; 2]) -> Arc<World> {
    Arc::new(World::with_resolution(&scene(name), size).unwrap())
}

fn scene(name: &str) -> Scene {
    bundled::files(name).expect("bundled").read().unwrap()
}

/// The filter, or `None` with a message if its shared library is missing.
fn available(words: &str, inputs: &MethodInputs) -> Option<Box<dyn dapple_core::Filter>> {
    match filter(words, inputs) {
        Ok(made) => Some(made.filter),
        Err(missing @ RegistryError::NoLibrary { .. }) => {
            eprintln!("skipped: {missing}");
            None
        }
        Err(e) => panic!("{words}: {e}"),
    }
}

fn refusal<T>(made: Result<T, RegistryError>) -> String {
    made.err().map(|e| e.to_string()).unwrap_or_default()
}

#[test]
fn every_entry_is_made_by_its_name() {
    let inputs = inputs();
    for entry in POINTS {
        let points = points(entry.name, SETTING).unwrap();
        assert!(points.describe().starts_with(entry.name), "{}", points.describe());
        let id = SampleId::new([3, 4], 0, 7);
        assert!(points.block(id, 2).iter().all(|u| (0.0..1.0).contains(u)));
    }
    for entry in SAMPLERS {
        let points = points("random", SETTING).unwrap();
        let sampler = sampler(entry.name, points, &inputs).unwrap().sampler;
        assert_eq!(sampler.name(), entry.name);
        assert!(sampler.points().describe().contains("random"));
    }
    for entry in FILTERS {
        let Some(filter) = available(entry.name, &inputs) else { continue };
        assert_eq!(filter.name(), entry.name);
    }
    let [points, samplers] = [POINTS.iter().map(|e| e.name).collect(), SAMPLERS.iter().map(|e| e.name).collect()];
    for names in [points, samplers, FILTERS.iter().map(|e| e.name).collect::<Vec<_>>()] {
        assert!(names.iter().enumerate().all(|(i, n)| !names[..i].contains(n)), "{names:?}");
    }
}

#[test]
fn aliases_are_understood_and_the_library_has_the_same_defaults() {
    let describe = |name: &str| sampler(name, sobol(), &MethodInputs::default()).unwrap().sampler.describe();
    assert_eq!(describe("cluster"), describe("adaptive"));
    assert_eq!(dapple_adaptive::Adaptive::new(sobol()).describe(), describe("adaptive"));
    assert_eq!(describe("adaptive:epsilon=0.2"), describe("adaptive"));
    assert_eq!(describe("then:spp=3,first=then"), describe("sequence:spp=3,first=sequence"));
    let thesis =
        |key: &str| sampler(&format!("cluster-thesis:{key}=2"), sobol(), &inputs()).unwrap().sampler.describe();
    assert_eq!(thesis("probes"), thesis("rays"));
    let [blend, alias] = ["oidn-blend", "both"].map(|name| refusal(check_filter(&format!("{name}:alpha"))));
    assert!(blend.contains("oidn-blend") && blend == alias, "{alias}");
}

/// A sampler that follows a filter's own error requests the filter's statistics and describes itself with the filter's name.
#[test]
fn cluster_follows_a_filter_by_its_name() {
    let inputs = inputs();
    // The regression for plans uses no clusters.
    let quick = "cluster-regression:outside=1";
    for (name, read) in [("nlm", "nlm"), ("bilateral", "bilateral"), ("cluster-regression", quick)] {
        let make = |words: &str| sampler(words, sobol(), &inputs).unwrap().sampler;
        let made = make(&format!("adaptive:policy=keep,by={name}"));
        assert!(made.describe().starts_with(&format!("adaptive:by={name},")), "{}", made.describe());
        assert_eq!(make(&made.describe()).describe(), made.describe());
        let wanted = filter(read, &inputs).unwrap().filter.needs();
        assert_eq!(made.needs().and(wanted), made.needs(), "{name}");
        assert_ne!(made.needs(), make("adaptive").needs(), "{name}");
    }
    let refused = refusal(sampler("adaptive:policy=keep,by=gaussian", sobol(), &inputs));
    assert!(refused.contains("one of variance, nlm, bilateral, cluster-regression"), "{refused}");
}

/// A description parses again, names every parameter, and equals the default.
#[test]
fn descriptions_are_words() {
    let inputs = inputs();
    let said = |parameters: Vec<&Parameter>| -> String {
        parameters.iter().map(|p| format!("{}={}", p.name, p.default)).collect::<Vec<_>>().join(",")
    };
    let keys = |words: &str| -> Vec<String> {
        let words = words.split_once(':').map_or("", |w| w.1);
        let mut keys: Vec<_> = words.split(',').filter_map(|p| p.split_once('=')).map(|p| p.0.to_owned()).collect();
        keys.sort();
        keys
    };
    let check = |name: &str, parameters: Vec<&Parameter>, describe: &dyn Fn(&str) -> String| {
        let words = format!("{name}:{}", said(parameters));
        assert_eq!(describe(&words), describe(name));
        assert_eq!(describe(&describe(name)), describe(name));
        assert_eq!(keys(&describe(name)), keys(&words));
    };
    for entry in SAMPLERS {
        let describe = |words: &str| sampler(words, sobol(), &inputs).unwrap().sampler.describe();
        check(entry.name, entry.parameters().collect(), &describe);
    }
    for entry in FILTERS.iter().filter(|entry| available(entry.name, &inputs).is_some()) {
        let describe = |words: &str| filter(words, &inputs).unwrap().filter.describe();
        check(entry.name, entry.parameters().collect(), &describe);
    }
}

#[test]
fn wrong_words_are_refused_with_what_there_is() {
    let sampler = |words: &str| refusal(sampler(words, sobol(), &MethodInputs::default()));
    assert!(refusal(dapple_job::registry::points("sobel", SETTING)).contains("Choose among sobol"));
    assert!(sampler("").contains("variance, uniform"));
    assert!(refusal(check_filter("nune")).contains("none"));
    assert!(sampler("uniform:x=1").contains("known parameters: none"));
    assert!(sampler("variance:pilots=4").contains("Known parameters: pilot, radius"));
    assert!(sampler("variance:pilot=4,pilot=4").contains("given twice"));
    assert!(sampler("variance:pilot").contains("key=value"));
    assert!(sampler("variance:pilot=four").contains("a number"));
    assert!(sampler("variance:policy=maybe").contains("use keep, discard, cross or neighbours"));
    for bad in ["exponent=NaN", "epsilon=-1", "cap=0"] {
        assert_ne!(sampler(&format!("variance:{bad}")), "", "{bad}");
    }
    assert_eq!(sampler("variance: pilot = 8 , policy=cross "), "", "blanks do no harm");
}

/// Without the feature, the error names it; with it, the error of a missing library comes before that of a missing world.
#[test]
fn optional_filters_are_there_or_name_their_feature() {
    for name in ["oidn", "oidn-blend"] {
        let built = FILTERS.iter().any(|entry| entry.name == name && entry.feature == Some("oidn"));
        assert_eq!((built, NOT_BUILT.is_empty()), (cfg!(feature = "oidn"), cfg!(feature = "oidn")), "{name}");
        let refused = refusal(check_filter(&format!("{name}:prefilter=false")));
        if built {
            assert!(refused.is_empty() || refused.contains("set DAPPLE_OIDN"), "{refused}");
            assert!(refusal(check_filter(&format!("{name}:prefilter=maybe"))).contains("true or false"));
        } else {
            let expected = "is not in this program; build Dapple with the feature \"oidn\" (cargo … --features oidn)";
            assert_eq!(refused, format!("the filter \"{name}\" {expected}"));
        }
    }
    assert!(FILTERS.iter().filter(|entry| entry.feature.is_none()).count() >= 6);
}

/// Wrong parameters are rejected without a world, so that a program can report them before it reads a scene.
#[test]
fn wrong_cluster_words_are_refused_without_a_world() {
    let wrong = "rays=0 rays=many size=large map=square angle=-1 distance=NaN min=9,max=8 k=0 k=NaN clamp=0 normals=91 normals=-1 \
        sides=3 policy=keep lights=1 lights=1025";
    for words in wrong.split(' ') {
        assert_ne!(refusal(check_sampler(&format!("cluster-thesis:{words}"))), "", "{words}");
    }
    for words in "by=guess policy=keep,pilot=1 rounds=65 pool=sea prior=-1 gain=2 policy=maybe".split(' ') {
        assert_ne!(refusal(check_sampler(&format!("adaptive:{words}"))), "", "{words}");
    }
    for words in "outside=2 hits=0 hits=9 alpha=0 radius=-1 k=NaN order=random".split(' ') {
        assert_ne!(refusal(check_filter(&format!("cluster-gaussian:{words}"))), "", "{words}");
    }
    assert!(check_sampler("cluster-thesis").is_ok() && check_filter("cluster-gaussian").is_ok());
    let made = sampler("cluster-thesis", sobol(), &MethodInputs::default());
    assert!(refusal(made).contains("world"));
}

/// Every choice of the cluster sampler renders, to the exact budget.
#[test]
fn every_cluster_choice_renders() {
    let world = world("cornell", [9, 7]);
    let inputs = MethodInputs::of(world.clone());
    let (mut rays, mut rejected) = (0, 0);
    let clusters = ["insertion=box,order=input", "insertion=centroid,grouping=connected,order=canonical,sides=2"];
    for size in ["box", "triangles", "screen", "hits"] {
        for (pixel, map) in [("one", "identity"), ("footprint", "root"), ("one", "log")] {
            for (first_hits, clusters) in ["centre", "3"].into_iter().zip(clusters) {
                let words = format!("cluster-thesis:size={size},pixel={pixel},map={map},rays={first_hits},{clusters}");
                let mut made = sampler(&words, sobol(), &inputs).unwrap();
                let frame = dapple_core::Frame::new(9, 7).expect("not empty");
                let film = dapple_core::Render::new(frame, &dapple_core::Limits::samples(63 * 8))
                    .run(&mut *dapple_renderer::integrator(&world), &mut *made.sampler);
                let counts = film.unwrap().counts();
                assert_eq!(counts.iter().sum::<u64>(), 63 * 8, "{words}");
                assert_ne!(counts.iter().min(), counts.iter().max(), "{words} tells nothing apart");
                let first_hits = made.first_hits.first_hits().unwrap_or_else(|| panic!("{words}: no first-hit rays"));
                rays += first_hits.cost().rays;
                rejected += first_hits.rejected();
            }
        }
    }
    assert_eq!((rays, rejected), (63 * 12 * (1 + 3), 0));
}

/// One set of clusters serves the sampler and the filter, unless their parameters differ.
#[test]
fn clusters_are_made_once_for_each_set_of_parameters() {
    let mut inputs = inputs();
    inputs.clusters = sampler("cluster-thesis", sobol(), &inputs).unwrap().clusters;
    let is_shared = |words: &str| {
        let made = filter(words, &inputs).unwrap();
        let [known, used] = [&inputs.clusters, &made.clusters].map(|set| set.as_ref().expect("clusters were made"));
        Arc::ptr_eq(known, used)
    };
    assert!(is_shared("cluster-gaussian") && is_shared("cluster-regression"));
    assert!(!is_shared("cluster-gaussian:sides=2"));
    // Without an effect on the image, none are made.
    assert!(filter("bilateral", &inputs).unwrap().clusters.is_none());
}

/// These texts are stored in checkpoints, parts and EXR headers.
#[test]
fn descriptions_stay_as_files_hold_them() {
    const CLUSTERS: &str = "k=9,clamp=32,normals=10,insertion=box,grouping=greedy,order=input,sides=1";
    let inputs = inputs();
    let described = |words: &str| {
        if SAMPLERS.iter().any(|entry| entry.is_called(words.split(':').next().unwrap_or(words))) {
            return sampler(words, sobol(), &inputs).unwrap().sampler.describe();
        }
        filter(words, &inputs).unwrap().filter.describe()
    };
    for (words, expected) in [
        ("none", "none"),
        ("gaussian", "gaussian:alpha=0.5,radius=4"),
        ("gaussian:alpha=2,radius=1.50", "gaussian:alpha=2,radius=1.5"),
        ("nlm", "nlm:window=7,patch=3,k=0.45,features=none"),
        ("nlm:features=0.60,window=3", "nlm:window=3,patch=3,k=0.45,features=0.6"),
        ("uniform", "uniform"),
        ("variance", "variance:pilot=0,radius=2,exponent=1.3,epsilon=0.01,cap=6,policy=keep,cost=0"),
        (
            "adaptive",
            "adaptive:by=variance,pilot=0,rounds=0,pool=similar,radius=2,prior=12,power=1,exponent=1.15,\
             epsilon=0.2,cap=8,mix=0.5,gain=0.98,policy=neighbours,cost=0",
        ),
        ("mitchell", "mitchell:initial=0,additional=0,red=0.4,green=0.3,blue=0.6,radius=1,mode=budget,policy=keep"),
        ("mitchell-pbrt", "mitchell-pbrt:min=4,max=32,threshold=0.5,mode=budget,policy=refined,test=contrast"),
        ("cycles", "cycles:threshold=0,min=0,step=16,mode=budget,policy=keep"),
    ] {
        assert_eq!(described(words), expected);
    }
    for (words, expected) in [
        ("cluster-gaussian", "cluster-gaussian:alpha=0.5,radius=4,outside=0.05,hits=1"),
        ("cluster-gaussian:hits=4,outside=1", "cluster-gaussian:alpha=0.5,radius=4,outside=1,hits=4"),
        ("bilateral", "bilateral:window=7,falloff=0.03,colour=0.8,features=1,outside=1"),
        (
            "bilateral:outside=0.5,falloff=1e-3,colour=10.0",
            "bilateral:window=7,falloff=0.001,colour=10,features=1,outside=0.5",
        ),
        ("cluster-regression", "cluster-regression:outside=0.2,layers=auto,network=true,fireflies=keep"),
        ("cluster-regression:outside=1,layers=2", "cluster-regression:outside=1,layers=2,network=true,fireflies=keep"),
        (
            "cluster-thesis",
            "cluster-thesis:rays=centre,size=box,pixel=one,map=root,angle=0.25,distance=0.25,min=0,max=0,\
             lights=0,policy=a-priori",
        ),
    ] {
        assert_eq!(described(words), format!("{expected},{CLUSTERS}"));
    }
}

#[test]
fn scenes_with_random_numbers_outside_the_domain_are_refused_by_mdas_unless_forced() {
    let inputs = MethodInputs::of(world("cornell", [24, 16]));
    let made = |words: &str| sampler(words, points("random", SETTING).expect("points"), &inputs);
    let error = refusal(made("mdas"));
    assert!(error.contains("light that scatters more than once") && error.contains("force=1"), "{error}");
    assert!(made("mdas:force=1").is_ok() && made("hierarchical").is_ok());
    assert!(made("mdas:force=1").is_ok_and(|made| made.placed.is_some()));
}

#[test]
fn samples_are_not_placed_in_scenes_with_other_pixel_filters() {
    let mut scene = scene("cornell");
    scene.film.pixel_filter = dapple_scene::PixelFilter::Triangle { radius: [1.0, 1.0] };
    let inputs = MethodInputs::of(Arc::new(World::new(&scene).unwrap()));
    let error = refusal(sampler("subdivision", points("random", SETTING).expect("points"), &inputs));
    assert!(error.contains("must be a box one pixel wide"), "{error}");
    assert!(refusal(filter("tree-mean", &inputs)).contains("must be a box one pixel wide"));
}

#[test]
fn fourier_dof_refuses_scenes_without_a_lens_unless_forced() {
    let of = |name: &str| MethodInputs::of(world(name, [48, 32]));
    let made = |words: &str, inputs: &MethodInputs| sampler(words, points("random", SETTING).expect("points"), inputs);
    let cornell = of("cornell");
    let error = refusal(made("fourier-dof", &cornell));
    assert!(error.contains("the camera has no lens") && error.contains("force=1"), "{error}");
    assert!(made("fourier-dof:force=1", &cornell).is_ok() && filter("splat", &cornell).is_ok());
    assert!(made("fourier-dof", &of("chess")).is_ok());
    assert!(check_sampler("fourier-dof").is_ok() && check_filter("splat").is_ok());
    assert!(refusal(check_filter("splat:zero=0")).contains("zero"));
}

/// Few pixels have samples, the budget is exact, and the filter fills the others.
#[test]
fn fourier_dof_and_splat_render_a_scene_with_a_lens() {
    let world = world("chess", [96, 64]);
    let inputs = MethodInputs::of(world.clone());
    let frame = dapple_core::Frame::new(96, 64).expect("not empty");
    let mut limits = dapple_core::Limits::spp(8.0);
    limits.min_spp = 0;
    let mut made = sampler("fourier-dof", sobol(), &inputs).unwrap().sampler;
    let film = dapple_core::Render::new(frame, &limits).run(&mut *dapple_renderer::integrator(&world), &mut *made);
    let film = film.expect("a film");
    assert_eq!(film.record().samples, 8 * frame.pixels() as u64);
    let empty = film.counts().iter().filter(|&&n| n == 0).count();
    assert!(empty > frame.pixels() / 10, "{empty}");
    let image = filter("splat", &inputs).unwrap().filter.apply(&film).expect("an image");
    assert!(image.radiance.iter().all(|pixel| pixel.iter().sum::<f32>() > 0.0));
}

/// The bundled scene `penumbra`, its floor a grid of 32 x 32 squares.
fn tessellated_penumbra() -> MethodInputs {
    let mut bundle = bundled::files("penumbra").expect("bundled");
    let main = bundle.main.clone();
    let text = String::from_utf8(bundle.file(&main).expect("the scene file").to_vec()).expect("text");
    let corners =
        (0..33 * 33).map(|i| format!("{} {} 0 ", f64::from(i % 33) * 0.25 - 4.0, f64::from(i / 33) * 0.25 - 4.0));
    let squares = (0..32 * 32).map(|i| {
        let a = i / 32 * 33 + i % 32;
        format!("{a} {} {} {a} {} {} ", a + 1, a + 34, a + 34, a + 33)
    });
    let (corners, squares) = (corners.collect::<String>(), squares.collect::<String>());
    let one = "\"point3 P\" [ -4 -4 0  4 -4 0  4 4 0  -4 4 0 ]\n  \"integer indices\" [ 0 1 2  0 2 3 ]";
    assert!(text.contains(one));
    let text = text.replace(one, &format!("\"point3 P\" [ {corners}] \"integer indices\" [ {squares}]"));
    bundle.files.iter_mut().filter(|(name, _)| *name == main).for_each(|(_, bytes)| *bytes = text.clone().into_bytes());
    let scene = bundle.read().unwrap();
    MethodInputs::of(Arc::new(World::with_resolution(&scene, [64, 64]).unwrap()))
}

#[test]
fn clusters_in_a_penumbra_get_more_samples_with_shadow_rays() {
    let inputs = tessellated_penumbra();
    let counts = |lights: u32| {
        let words = format!("cluster-thesis:size=hits,angle=0,distance=0,min=1,max=1000,sides=2,lights={lights}");
        let mut made = sampler(&words, sobol(), &inputs).unwrap();
        let frame = dapple_core::Frame::new(64, 64).expect("not empty");
        let film = dapple_core::Film::new(frame, made.sampler.needs());
        let budget = dapple_core::plan::BudgetLeft::new(64 * frame.pixels() as u64);
        let mut plan = dapple_core::plan::Plan::empty(frame.pixels());
        made.sampler.next_round(&dapple_core::plan::Feedback::new(0, &film, budget), &mut plan).expect("a plan");
        let mean = |columns: std::ops::Range<usize>| {
            let all = columns.clone().flat_map(|x| (0..64).map(move |y| y * 64 + x));
            all.map(|i| f64::from(plan.counts[i])).sum::<f64>() / (64 * columns.len()) as f64
        };
        // Full light and full shadow at the sides, the penumbra in the middle.
        [mean(0..18), mean(28..36), mean(46..64)]
    };
    // Clusters differ in size, so that counts differ without shadow rays too.
    let (with, without) = (counts(64), counts(0));
    let [light, penumbra, shadow] = [0, 1, 2].map(|k| with[k] / without[k]);
    assert!(penumbra > 1.1 * light && penumbra > 1.1 * shadow, "{with:?} {without:?}");
    assert!((light / shadow - 1.0).abs() < 0.02, "{with:?} {without:?}");
}

/// Traces paths, and reports their trajectories only if requested.
struct Tracer<'w>(Box<dyn dapple_core::Integrator + 'w>, bool);

impl dapple_core::Integrator for Tracer<'_> {
    fn estimate(&self, draws: &dapple_core::Draws<'_>, log: &mut dapple_core::Worker) -> dapple_core::Estimate {
        let mut estimate = self.0.estimate(draws, log);
        estimate.trajectory = estimate.trajectory.filter(|_| self.1);
        estimate
    }
}

/// The scene `lens` with a wide lens, or a moving camera; lit by one point light.
fn blurred(moves: bool) -> dapple_scene::Scene {
    let mut scene = scene("lens");
    scene.film.pixel_filter = dapple_scene::PixelFilter::default();
    scene.max_depth = Some(1);
    for effect in [Effect::Environment, Effect::SoftShadows, Effect::SeveralLights] {
        if dapple_scene::Effects::of(&scene).has(effect) {
            scene = dapple_renderer::without(&scene, effect).unwrap();
        }
    }
    let mut end = scene.camera.to_world;
    end.translation += 0.1 * end.matrix3.x_axis * scene.camera.focal_distance;
    scene.camera.moves_to = moves.then_some(end);
    scene.camera.lens_radius *= if moves { 0.0 } else { 2.0 };
    scene
}

/// The renderer's depths, motions and lens are consistent: samples move to the positions where the renderer sees them. The
/// negative control has no trajectories.
#[test]
fn tlfr_moves_samples_to_where_the_renderer_sees_them() {
    use dapple_core::{Film, Filter, Frame, Limits, Render, samplers::Uniform};
    const SIZE: [u32; 2] = [60, 40];
    for moves in [false, true] {
        let world = World::with_resolution(&blurred(moves), SIZE).unwrap();
        let world = Arc::new(world);
        let sobol = |seed| points("sobol", PointSettings { seed, spp: Some(16) }).unwrap();
        let render = |seed, spp, of: Option<&dyn Filter>, reports: bool| -> Film {
            let frame = Frame::new(SIZE[0], SIZE[1]).unwrap();
            let (limits, mut tracer) = (Limits::spp(spp), Tracer(dapple_renderer::integrator(&world), reports));
            let (needs, recorders) = of.map(|of| (of.needs(), of.recorders())).unwrap_or_default();
            let render = Render::new(frame, &limits).needs(needs).recorders(recorders);
            render.run(&mut tracer, &mut Uniform::new(sobol(seed))).unwrap()
        };
        let points = film_points(&world, Arc::from(sobol(1))).expect("a box filter");
        let inputs = MethodInputs { points: Some(points), ..MethodInputs::of(world.clone()) };
        let tlfr = filter("tlfr", &inputs).unwrap().filter;
        let reference = render(2, 128.0, None, false).image();
        let error = |image: &[[f32; 3]]| -> f64 {
            let square = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
            image.iter().zip(&reference).map(square).sum::<f64>()
        };
        let [share, control] = [true, false].map(|reports| {
            let film = render(1, 8.0, Some(&*tlfr), reports);
            error(&tlfr.apply(&film).unwrap().radiance) / error(&film.image())
        });
        assert!(share < 0.8 && control > 2.0 * share, "{moves}: {share} is left, {control} in the control");
    }
}

const PLACES: [&str; 2] =
    ["Translate 3 0 1 Rotate 30 0 1 0 Scale 2 1 0.5", "Translate -2 1 0 Rotate 70 1 0.5 0 Scale -1 1 1"];
const TENTS: &str = "Shape \"trianglemesh\" \"integer indices\" [ 0 1 3 1 2 3 ] \
    \"point3 P\" [ -1 -1 0  1 -1 0  0 1 0  0 -0.2 1 ]\n Material \"conductor\"\n Shape \"trianglemesh\" \
    \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 0 0 2  1 0 2  0 1 3 ]\n";

/// Triangles, and their vertices in the units of the file.
fn triangles(shapes: &str) -> (WorldTriangles, Vec<[f64; 3]>) {
    let file = format!("LookAt 0 0 9 0 0 0 0 1 0 Camera \"perspective\"\nWorldBegin\nLightSource \"point\"\n{shapes}");
    let files: &[(&str, &[u8])] = &[("scene.pbrt", file.as_bytes())];
    let scene = read_scene_from(files, "scene.pbrt", &ReadOptions::default()).unwrap();
    let world = World::new(&scene).unwrap();
    let triangles = WorldTriangles::of(&world);
    let positions = triangles.positions.iter().map(|&p| world.space().world(p)).collect();
    (triangles, positions)
}

#[test]
fn clusters_see_the_triangles_of_instances_as_those_of_copies() {
    let placed = |shapes: &str| PLACES.map(|place| format!("AttributeBegin {place} {shapes} AttributeEnd\n")).concat();
    let (instances, of_instances) =
        triangles(&format!("ObjectBegin \"tents\" {TENTS} ObjectEnd\n{}", placed("ObjectInstance \"tents\"")));
    let (copies, of_copies) = triangles(&placed(TENTS));
    assert_eq!(instances.indices, copies.indices);
    assert_eq!(instances.indices.len(), 6);
    assert_eq!(instances.positions.len(), 14);
    let pairs = of_instances.as_flattened().iter().zip(of_copies.as_flattened());
    pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
}
