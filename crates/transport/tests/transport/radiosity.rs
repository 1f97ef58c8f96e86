//! Radiosity: closed forms, the path tracer's image up to a bias that falls with smaller patches, the same bits.

#[path = "../../src/patches/parts.rs"]
mod parts;

use crate::support::*;
use parts::{divide, part_at, triangle_area};

/// Negative control: patches as large as walls have a large bias.
#[test]
fn the_bias_falls_with_smaller_patches() {
    let world = world(&chamber(diffuse(0.6)));
    let expected = pixels(&film(&world, "path", [12, 12], 1024, 3));
    // The root mean square of the relative differences of pixels in the green channel.
    let at = |patches: u32, gather: u32| {
        let request = format!("radiosity:patches={patches},gather={gather},particles=20000");
        let found = pixels(&film(&world, &request, [12, 12], 16, 40));
        let squares = found.iter().zip(&expected).map(|(a, b)| (a[1] / b[1] - 1.0).powi(2));
        squares.collect::<Mean>().mean.sqrt()
    };
    let shown = [8, 64, 512].map(|patches| at(patches, 0));
    let gathered = [8, 512].map(|patches| at(patches, 1));
    // All these include the noise of 16 spp and of the reference.
    assert!(shown[0] > 2.0 * shown[1] && shown[1] > 1.3 * shown[2] && shown[2] < 0.03, "shown {shown:.4?}");
    assert!(shown[0] > 0.1 && gathered[0] > 2.0 * gathered[1], "{shown:.4?}, {gathered:.4?}");
}

/// Glossy walls, mirrors and transmitting sheets add no bias. Negative control: direct light alone.
#[test]
fn means_are_the_path_tracers() {
    let [reflectance, transmittance] = [0.4, 0.3].map(|x| Color::Constant([x; 3]));
    let sheet = MaterialKind::DiffuseTransmission { reflectance, transmittance };
    for wall in &[metal(0.3), diffuse(0.3), metal(0.0), sheet][..thorough(1, 4)] {
        let scene = chamber(wall.clone());
        let expected = means(&scene, "path", 128, 0..8);
        for request in ["radiosity:particles=4000,gather=0", "radiosity:particles=4000,gather=1"] {
            assert_near(&format!("{wall:?}, {request}"), &means(&scene, request, 16, 10..18), &expected, 0.005, 0.008);
        }
        let direct = Scene { max_depth: Some(1), ..scene };
        assert!(means(&direct, "path", 64, 0..4).mean < 0.9 * expected.mean, "the test sees nothing");
    }
}

#[test]
fn furnaces_have_their_radiance_and_keep_their_energy() {
    let cases = [(0.5, 20, false), (0.8, 5, true), (0.8, 5, false), (0.8, 1, true), (0.8, 30, true)];
    for &(rho, depth, is_cubic) in &cases[..thorough(2, 5)] {
        let (scene, expected) = furnace(rho, Some(depth), is_cubic);
        for gather in [0, 1] {
            let request = format!("radiosity:patches=300,particles=4000,gather={gather}");
            // Cells of a sphere have its area to 2e-3.
            let tolerance = if is_cubic { 1e-6 } else { 2e-3 };
            let name = format!("albedo {rho}, depth {depth}, gather {gather}");
            assert_near(&name, &means(&scene, &request, 8, 0..8), &expected, tolerance, 0.01);
        }
    }
}

#[test]
fn patches_have_the_same_bits_on_any_threads_and_resumed() {
    let (film, _) = with_the_same_bits_on_any_threads_and_resumed(&chamber(metal(0.3)), "radiosity:patches=500");
    assert!(film.record().prepare_rays > 5000);
}

#[test]
fn scenes_that_patches_lack_are_refused() {
    let mut moving = chamber(diffuse(0.3));
    moving.shapes[1].moves_to = Some(DAffine3::from_translation(2.0 * DVec3::Z));
    moving.camera.shutter = [0.0, 1.0];
    for (scene, request, expected) in [
        (moving, "radiosity", "radiosity: the scene has motion-blur, but patches do not move; use integrator \"path\""),
        (chamber(diffuse(0.3)), "radiosity:patches=0", "radiosity: patches = 0 is out of range; allowed: 1 to 1048576"),
    ] {
        let error = make_integrator(request, &world(&scene)).err().expect("refused").to_string();
        assert_eq!(error, expected);
    }
}

#[test]
fn parts_of_a_triangle_are_found_by_their_weights() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for parts in [1, 2, 3, 7, 64] {
        let mut number = 0;
        divide(corners, parts, |part| {
            // Its middle and points near its corners.
            let middle = (part[0] + part[1] + part[2]) / 3.0;
            for point in part.map(|corner| corner.lerp(middle, 0.05)).into_iter().chain([middle]) {
                assert_eq!(part_at([point.x as f32, point.y as f32], parts), number, "{parts} parts, {point}");
            }
            let share = triangle_area(part) * 2.0 * f64::from(parts * parts);
            assert!((share - 1.0).abs() < 1e-9);
            number += 1;
        });
        assert_eq!(number, parts * parts);
        // Weights moved out of the triangle by rounding belong to a part.
        for weights in [[1.0, 0.0], [0.0, 1.0], [0.5, 0.500_001], [1.0, 1.0]] {
            assert!(part_at(weights, parts) < parts * parts);
        }
    }
}
