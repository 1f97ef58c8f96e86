//! Lamps whose emission is a texture, in every integrator.

use crate::support::*;

/// A chamber whose lamp is a checkerboard.
fn chamber_with_checks() -> Scene {
    let mut scene = chamber(diffuse(0.4));
    let colors = [0.0, 2.0].map(|value| Color::Constant([value; 3]));
    let kind = TextureKind::Checkerboard { scale: [3.0; 2], shift: [0.0; 2], colors };
    let texture = scene.add_texture("checks", kind, &Source::default());
    let lamp = scene.shapes.iter_mut().find_map(|shape| shape.emission.as_mut()).expect("a lamp");
    lamp.texture = Some(texture);
    scene
}

/// All integrators agree with the path tracer, within their bias. Negative control: a lamp without its texture differs.
#[test]
fn integrators_agree_on_a_textured_lamp() {
    let scene = chamber_with_checks();
    let expected = means(&scene, "path", 256, 0..8);
    for (request, spp, tolerance) in [
        ("bdpt:splat=1", 64, 2e-3),
        ("bdpt:splat=0", 64, 2e-3),
        ("metropolis", 64, 0.01),
        ("instant:paths=16,clamp=inf", 16, 0.01),
        ("photons:photons=4000,radius=0.05,small=10", 16, 0.02),
        ("radiosity:particles=4000,gather=1", 16, 0.01),
        ("lightcuts:points=512", 16, 0.03),
    ] {
        assert_near(request, &means(&scene, request, spp, 10..18), &expected, tolerance, 0.02);
    }
    let flat = chamber(diffuse(0.4));
    let bias = means(&flat, "path", 64, 0..4).mean / expected.mean - 1.0;
    assert!(bias.abs() > 0.05, "a flat lamp differs by {bias}");
}

/// Paths from the lights do not support surfaces that only the camera sees.
#[test]
fn bidirectional_paths_refuse_unlit_surfaces() {
    let scene = chamber(MaterialKind::Unlit { color: Color::Constant([0.5; 3]) });
    let world = world(&scene);
    let message = make_integrator("bdpt", &world).map(|_| ()).unwrap_err().to_string();
    assert!(
        message.contains("the scene has unlit surfaces") && message.contains("use integrator \"path\""),
        "{message}"
    );
    assert!(make_integrator("path", &world).is_ok());
}
