//! Lightcuts: exact with a bound of 0, within the bound otherwise. Virtual lights: the path tracer's mean in diffuse scenes.
//! The same bits everywhere.

use crate::support::*;

const SIZE: [u32; 2] = [24, 18];

/// A floor with two columns under 300 points, 100 small lamps and a distant light; light scatters once.
fn many(shadows: bool) -> Scene {
    // No lamp is in view, since the camera would find lamps by chance.
    let mut scene = scene(SIZE, 24.0, DVec3::new(0.0, -3.5, 1.2), DVec3::new(0.0, 0.0, -0.1));
    scene.max_depth = Some(1);
    let grey = add_material(&mut scene, diffuse(0.5));
    let black = add_material(&mut scene, diffuse(0.0));
    add(&mut scene, rectangle(DVec3::ZERO, 4.0 * DVec3::X, 4.0 * DVec3::Y), DAffine3::IDENTITY, grey, None);
    for x in if shadows { &[-0.7, 0.8][..] } else { &[] } {
        let cube = Geometry::Mesh(std::sync::Arc::new(cube()));
        let column = DAffine3::from_translation(DVec3::new(*x, 0.5, 0.5));
        add(&mut scene, cube, column * DAffine3::from_scale(DVec3::new(0.1, 0.1, 0.5)), grey, None);
    }
    let place = |i: u32| {
        let unit = |a: f64| (f64::from(i) * a).fract();
        DVec3::new(6.0 * unit(0.754_877) - 3.0, 6.0 * unit(0.569_840) - 3.0, 1.5 + unit(0.321_927))
    };
    for i in 0..300 {
        let kind = LightKind::Point { intensity: [0.01 + 0.02 * f32::from(i as u8 % 5); 3] };
        scene.lights.push(Light { kind, to_world: DAffine3::from_translation(place(i)), source: line(200 + i) });
    }
    (300..400).for_each(|i| add_sphere(&mut scene, place(i), 0.01, black, 30.0));
    let kind = LightKind::Distant { irradiance: [0.2; 3] };
    scene.lights.push(Light { kind, to_world: DAffine3::from_rotation_x(0.4), source: line(199) });
    scene
}

fn image(scene: &Scene, request: &str, spp: u64) -> Film {
    film(&world(scene), request, SIZE, spp, 5)
}

/// Returns the largest and the mean relative difference between the pixels of two films.
fn differences(a: &Film, b: &Film) -> [f64; 2] {
    let relative = |i: usize| (a.mean(i)[1] / b.mean(i)[1] - 1.0).abs();
    let all: Vec<f64> = (0..a.frame().pixels()).filter(|i| b.mean(*i)[1] > 0.0).map(relative).collect();
    assert!(all.len() > 200, "most pixels are lit");
    [all.iter().copied().fold(0.0, f64::max), all.iter().sum::<f64>() / all.len() as f64]
}

#[test]
fn the_error_is_within_its_bound_and_rays_fall_with_it() {
    let scene = many(false);
    let exact = image(&scene, "lightcuts:error=0,cut=100000", 4);
    let mut before = exact.record().rays;
    for error in [0.002, 0.02, 0.2] {
        let cut = image(&scene, &format!("lightcuts:error={error},cut=100000"), 4);
        // Bounds hold for single groups, whose errors have both signs.
        let [largest, mean] = differences(&cut, &exact);
        assert!(largest <= 2.0 * error && mean <= error, "{largest}, {mean} with a bound of {error}");
        assert!(cut.record().rays < before, "{} rays with a bound of {error}", cut.record().rays);
        before = cut.record().rays;
    }
    let rough = image(&scene, "lightcuts:error=0.2,cut=1", 4);
    assert!(differences(&rough, &exact)[0] > 0.02, "one group for each tree is no image");
}

#[test]
fn all_lights_one_by_one_make_the_path_tracers_mean() {
    let scene = many(true);
    let [exact, cut] = ["lightcuts:error=0,cut=100000", "lightcuts"].map(|request| image(&scene, request, 16));
    // The camera's own noise at 16 spp is small beside that of light sampling, and counts as 1e-3 here.
    assert_near("exact", &exactly(mean_of(&exact)), &means(&scene, "path", 128, 0..8), 1e-3, 2e-3);
    assert!((mean_of(&cut) / mean_of(&exact) - 1.0).abs() < 0.01);
    assert!(cut.record().rays < exact.record().rays / 2, "{} of {}", cut.record().rays, exact.record().rays);
}

#[test]
fn environments_and_flat_lamps_have_the_path_tracers_mean() {
    let scene = Scene { max_depth: Some(3), ..room([12, 12]) };
    let expected = means(&scene, "path", 256, 0..8);
    assert_near("room", &means(&scene, "lightcuts:sky=1024,points=512", 16, 0..4), &expected, 0.02, 0.01);
}

/// Negative control: direct light alone is darker.
#[test]
fn virtual_lights_make_the_path_tracers_mean() {
    for wall in [diffuse(0.6), metal(0.0)] {
        let scene = chamber(wall.clone());
        let expected = means(&scene, "path", 64, 0..8);
        let found = means(&scene, "instant:paths=16,clamp=inf", 16, 0..16);
        assert_near(&format!("{wall:?}"), &found, &expected, 0.0, 0.02);
        let direct = Scene { max_depth: Some(1), ..scene };
        assert!(means(&direct, "path", 64, 0..4).mean < 0.8 * expected.mean);
    }
}

#[test]
fn cuts_and_virtual_lights_have_the_same_bits_on_any_threads() {
    assert_same_bits_on_threads(&world(&many(true)), "lightcuts", SIZE);
    assert_same_bits_on_threads(&world(&chamber(metal(0.0))), "instant:paths=8", [12, 12]);
}

/// Negative controls: cuts of one group differ, and common cuts change bits.
#[test]
fn common_cuts_leave_the_light() {
    let mut world = bundle("many-lights", SIZE);
    world.set_max_depth(1);
    let [plain, common, coarse] = ["cut=400", "cut=400,clusters=100", "cut=1"]
        .map(|options| film(&world, &format!("lightcuts:{options}"), SIZE, 1, 5));
    let [all, others] = [&common, &plain].map(|film| (film.record().rays - film.record().prepare_rays) as f64);
    let rays = all / others;
    let [[_, common], [_, coarse]] = [&common, &coarse].map(|film| differences(film, &plain));
    assert!((0.9..1.1).contains(&rays), "{rays} of the rays");
    assert!(0.0 < common && common < 0.02, "a mean difference of {common}");
    assert!(coarse > 0.05, "the test sees nothing: {coarse}");
}

/// A low bound leaves much of the light to paths. Negative control: direct light alone is darker.
#[test]
fn bounded_virtual_lights_have_the_path_tracers_mean() {
    for name in &["cornell", "lens", "tea", "teapot", "room", "door"][..thorough(1, 6)] {
        let size = [24, 16];
        let mut world = bundle(name, size);
        world.set_max_depth(world.max_depth().min(6));
        let expected = means_by(&mut *integrator(&world), size, 64, 100..116);
        let found = means_by(&mut *made("instant:paths=32,clamp=2", &world), size, 32, 200..216);
        world.set_max_depth(1);
        let less = means_by(&mut *integrator(&world), size, 16, 200..216);
        let [z, lost] = [&found, &less].map(|mean| mean.against_estimate(&expected).z());
        let error = found.standard_error() / expected.mean;
        assert!(z.abs() < 3.0 && error < 0.02, "{name}: {found:?}, not {expected:?}, {z:.2}");
        assert!(*name != "cornell" || lost < -5.0, "the test sees nothing: {less:?}");
    }
}
