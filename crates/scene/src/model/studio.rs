//! The default camera and light of models, whose files have neither.

use super::UpAxis;
use crate::bundled::directions::{dot, lat_long_direction, mix, normalize, smoothstep};
use crate::image::Image;
use crate::{Camera, EnvironmentRadiance, FilmSettings, Light, LightKind, Projection, Scene, Source};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::{Arc, LazyLock};

/// Full angle of view along the shorter side of the image, in degrees: about that of a portrait lens.
const FOV: f64 = 35.0;
/// The sine of half of `FOV`, a literal so that it is the same on every machine.
const SIN_HALF_FOV: f64 = 0.300_705_799_504_273_1;
/// Direction from the model to the camera: components to the front, to the right and up. It is normalized at its use.
const VIEW: [f64; 3] = [1.0, 0.6, 0.45];
/// Factor by which the view is wider than the model's bounding sphere.
const MARGIN: f64 = 1.02;
/// The largest number of scattering events per path. Grey surfaces leave little light after this number.
const MAX_DEPTH: u32 = 6;
const RESOLUTION: [u32; 2] = [960, 720];

/// Sets camera, film, path depth and light of a scene for a model whose vertices are `points`.
///
/// # Errors
/// Returns a message if all vertices coincide, or if the size overflows.
pub(super) fn set(
    scene: &mut Scene,
    points: impl Iterator<Item = DVec3> + Clone,
    up: UpAxis,
    source: &Source,
) -> Result<(), &'static str> {
    let (low, high) =
        points.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let centre = low + 0.5 * (high - low);
    let radius = points.map(|p| p.distance(centre)).fold(0.0, f64::max);
    if !(centre.is_finite() && radius.is_finite()) {
        return Err("the model is too large to be seen; its size overflows; scale it down");
    }
    if radius == 0.0 {
        return Err("all corners of the model lie in one point; there is nothing to see");
    }
    let (front, right, up) = up.axes();
    let towards = (VIEW[0] * front + VIEW[1] * right + VIEW[2] * up).normalize();
    let eye = centre + towards * (MARGIN * radius / SIN_HALF_FOV);
    let camera_right = (-towards).cross(up).normalize();
    let camera_up = camera_right.cross(-towards);
    scene.camera = Camera {
        to_world: DAffine3 { matrix3: DMat3::from_cols(camera_right, camera_up, -towards), translation: eye },
        projection: Projection::Perspective { fov: FOV },
        source: source.clone(),
        ..Camera::default()
    };
    scene.film = FilmSettings { resolution: RESOLUTION, ..FilmSettings::default() };
    scene.max_depth = Some(MAX_DEPTH);
    let radiance = EnvironmentRadiance::LatLong { image: STUDIO.clone(), scale: 1.0 };
    // The environment is turned with the camera: its x axis points horizontally to the viewer.
    let level = (VIEW[0] * front + VIEW[1] * right).normalize();
    let to_world = DAffine3::from_mat3(DMat3::from_cols(level, up.cross(level), up));
    scene.lights = vec![Light { kind: LightKind::Infinite { radiance }, to_world, source: source.clone() }];
    Ok(())
}

/// The environment map of model scenes. It is made once, since that takes longer than reading a small model.
static STUDIO: LazyLock<Arc<Image>> = LazyLock::new(|| Arc::new(studio()));

/// Makes the environment map of model scenes: brighter above than below, with a round lamp over the viewer's left
/// shoulder. z is up, and x points to the viewer.
fn studio() -> Image {
    const SIZE: [u32; 2] = [512, 256];
    const FLOOR: [f64; 3] = [0.16, 0.15, 0.14];
    const HORIZON: [f64; 3] = [0.34, 0.34, 0.35];
    const ZENITH: [f64; 3] = [0.55, 0.60, 0.68];
    const LAMP: [f64; 3] = [13.0, 12.2, 11.0];
    /// Cosines of the angular radii of the lamp's outer edge (17 degrees) and of its fully bright part (13 degrees).
    const EDGE: [f64; 2] = [0.956, 0.974];
    let lamp = normalize([0.62, -0.62, 0.72]);
    let radiance = |x: usize, y: usize| {
        let direction = lat_long_direction(x, y, SIZE[0] as usize, SIZE[1] as usize);
        let height = direction[2];
        let sky = mix(HORIZON, ZENITH, smoothstep(0.0, 1.0, height));
        let room = mix(sky, FLOOR, smoothstep(0.0, 0.35, -height));
        mix(room, LAMP, smoothstep(EDGE[0], EDGE[1], dot(direction, lamp))).map(|c| c as f32)
    };
    let pixels = (0..SIZE[1] as usize).flat_map(|y| (0..SIZE[0] as usize).map(move |x| (x, y)));
    let pixels = pixels.map(|(x, y)| radiance(x, y)).collect();
    Image { size: SIZE, pixels, alpha: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_and_its_sine_agree() {
        assert!((SIN_HALF_FOV - (FOV / 2.0).to_radians().sin()).abs() < 1e-15);
    }

    #[test]
    fn a_cube_fills_the_image_without_leaving_it() {
        let corner =
            |i: i32, scale: f64| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * scale;
        for (up, scale) in [(UpAxis::Y, 1.0), (UpAxis::Z, 1e-9), (UpAxis::Y, 1e12)] {
            let points: Vec<DVec3> = (0..8).map(|i| corner(i, scale) + DVec3::splat(3.0 * scale)).collect();
            let mut scene = Scene::default();
            set(&mut scene, points.iter().copied(), up, &Source::default()).unwrap();
            let to_camera = scene.camera.to_world.inverse();
            let most = (FOV / 2.0).to_radians().tan();
            let seen: Vec<DVec3> = points.iter().map(|p| to_camera.transform_point3(*p)).collect();
            let reach = seen.iter().map(|p| p.x.abs().max(p.y.abs()) / p.z).fold(0.0, f64::max);
            assert!(seen.iter().all(|p| p.z > 0.0) && reach < most && reach > 0.7 * most, "{reach} {most}");
            // Up is up, and the camera looks down on it.
            let top = if up == UpAxis::Y { [2, 0] } else { [4, 0] };
            assert!(seen[top[0]].y > seen[top[1]].y);
            // Towards the viewer's right is to the right.
            assert!(seen[1].x > seen[0].x);
        }
        let same = [DVec3::ONE; 3];
        assert!(set(&mut Scene::default(), same.into_iter(), UpAxis::Y, &Source::default()).is_err());
    }
}
