//! Camera rays seen from the scene: where a point appears in the image, and how densely camera rays reach it.
//!
//! Light paths that end at the camera need both [after Veach 1997, ch. 8]. The importance of
//! a pixel times the cosine at the camera equals the density of its rays, so that neither appears alone here.

use super::CameraView;
use crate::shading::warp::concentric_disk;
use glam::{Vec2, Vec3};

/// The camera ray through a point of the scene, found by [`CameraView::connect`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraConnection {
    /// The place in the image, in pixels from the top left corner.
    pub place: Vec2,
    /// The start of the camera ray: the eye, a point on the lens, or a point on the screen of an orthographic camera.
    pub position: Vec3,
    /// The unit direction from the camera to the point.
    pub direction: Vec3,
    /// The distance from `position` to the point, in units of the renderer's space.
    pub distance: f32,
}

impl CameraView {
    /// Returns the density of camera rays along a unit `direction` at a `distance` from their start, per unit of area
    /// across them.
    ///
    /// The rays are those of places that are uniform over the whole image, at a time in `[0, 1]`. For a perspective
    /// camera, the density is the one per solid angle over the squared distance. With a lens, it holds for one point of
    /// the lens. Returns 0 for directions that no ray has, behind the camera.
    #[inline]
    pub fn density(&self, direction: Vec3, distance: f32, time: f32) -> f32 {
        let (_, axes) = self.pose(time);
        let across = axes.x_axis.cross(axes.y_axis);
        // The determinant, and the forward component of the direction in camera space times the determinant.
        let (volume, forward) = (across.dot(axes.z_axis), across.dot(direction));
        let image = 4.0 * self.half.x * self.half.y * (self.step.x * self.step.y);
        let forward = forward / volume;
        let density = match self.orthographic {
            // Rays through the same point of the lens are parallel.
            true => (image * volume.abs() * forward).recip(),
            false => (image * volume.abs() * (forward * distance) * (forward * distance) * forward).recip(),
        };
        if forward > 0.0 && density.is_finite() { density } else { 0.0 }
    }

    /// Returns the camera ray through a `point`, at a time in `[0, 1]`. `on_lens` in `[0, 1)^2` selects the point on the
    /// lens.
    ///
    /// The place may lie outside the image. Returns `None` for points behind the camera, and at the camera itself.
    pub fn connect(&self, point: Vec3, on_lens: [f32; 2], time: f32) -> Option<CameraConnection> {
        let (origin, axes) = self.pose(time);
        let to_camera = axes.inverse();
        let lens = if self.has_lens() { (concentric_disk(on_lens) * self.lens_radius).extend(0.0) } else { Vec3::ZERO };
        // The screen position is the one of the ray's point in the plane in focus.
        let (screen, position) = if self.orthographic {
            let inner = to_camera * (point - origin);
            let focus = if self.has_lens() { 1.0 - inner.z / self.focal_distance } else { 0.0 };
            let screen = inner - lens * focus;
            (screen, origin + axes * Vec3::new(screen.x + lens.x, screen.y + lens.y, 0.0))
        } else {
            let start = origin + axes * lens;
            let inner = to_camera * (point - start);
            let focus = if self.has_lens() { lens / self.focal_distance } else { Vec3::ZERO };
            (Vec3::new(inner.x / inner.z + focus.x, inner.y / inner.z + focus.y, inner.z), start)
        };
        let (x, y) = ((screen.x - self.shift.x) / self.step.x, (self.shift.y - screen.y) / self.step.y);
        let (to, place) = (point - position, Vec2::new(x, y) + self.half);
        let distance = to.length();
        let direction = to / distance;
        let in_front = screen.z > 0.0 && distance > 0.0 && direction.is_finite() && place.is_finite();
        in_front.then_some(CameraConnection { place, position, direction, distance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Space;
    use dapple_scene::{Camera, Projection, Scene};
    use glam::{DAffine3, DMat3, DVec3};

    /// Perspective and orthographic cameras, with and without a lens, under a transform that shears.
    fn views() -> Vec<CameraView> {
        let shear = DMat3::from_cols(DVec3::new(1.1, 0.2, 0.0), DVec3::new(0.0, 0.9, 0.1), DVec3::new(0.1, 0.0, 1.4));
        let turn = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.4);
        let to_world = DAffine3::from_mat3_translation(turn * shear, DVec3::new(0.3, -0.2, 0.5));
        let (perspective, window) = (Projection::Perspective { fov: 70.0 }, Some([-0.5, 1.0, -0.2, 0.9]));
        let cases =
            [(perspective, 0.0), (perspective, 0.2), (Projection::Orthographic, 0.0), (Projection::Orthographic, 0.2)];
        let view = |(projection, lens_radius)| {
            let screen_window = window;
            let camera =
                Camera { to_world, projection, lens_radius, focal_distance: 2.0, screen_window, ..Camera::default() };
            CameraView::new(&camera, [60, 44], &Space::of(&Scene::default())).unwrap_or_else(|e| panic!("{e}"))
        };
        cases.map(view).to_vec()
    }

    #[test]
    fn points_of_camera_rays_lead_back_to_their_rays() {
        for (case, view) in views().iter().enumerate() {
            for (pixel, u) in [([0, 0], [0.1, 0.9]), ([59, 43], [0.5, 0.5]), ([17, 30], [0.8, 0.3])] {
                let ray = view.ray(pixel, Vec2::new(0.3, -0.2), u);
                for t in [0.1, 1.0, 50.0] {
                    let found = view.connect(ray.at(t), u, 0.0).unwrap_or_else(|| panic!("case {case}"));
                    let expected = Vec2::new(pixel[0] as f32 + 0.8, pixel[1] as f32 + 0.3);
                    assert!((found.place - expected).length() < 2e-3, "case {case} at {t}: {found:?}, {expected}");
                    assert!(
                        (found.position - ray.origin).length() < 1e-4 * t.max(1.0),
                        "case {case} at {t}: {found:?}"
                    );
                    assert!((found.direction - ray.direction).length() < 1e-4, "case {case} at {t}: {found:?}");
                    assert!((found.distance - t).abs() < 1e-4 * t.max(1.0), "case {case} at {t}: {found:?}");
                }
                assert_eq!(view.connect(ray.at(-1.0), u, 0.0), None, "case {case}: behind the camera");
            }
        }
    }

    /// The area between the rays of neighbouring places, across the ray, is the inverse density.
    #[test]
    fn the_density_is_that_of_rays_at_uniform_places() {
        for (case, view) in views().iter().enumerate() {
            let u = [0.3, 0.7];
            for place in [Vec2::new(-25.0, 13.0), Vec2::new(0.0, 0.0), Vec2::new(20.0, -19.0)] {
                let ray = view.ray_at(place, u, 0.0);
                for t in [0.7_f32, 3.0] {
                    // Where a ray meets the plane across the middle ray.
                    let meets = |offset: Vec2| {
                        let [origin, direction] = {
                            let ray = view.ray_at(place + offset, u, 0.0);
                            [ray.origin, ray.direction].map(Vec3::as_dvec3)
                        };
                        let (middle, normal) = (ray.at(t).as_dvec3(), ray.direction.as_dvec3());
                        origin + direction * ((middle - origin).dot(normal) / direction.dot(normal))
                    };
                    let step = |axis: Vec2| meets(axis) - meets(-axis);
                    let area = step(Vec2::X).cross(step(Vec2::Y)).length() / 4.0;
                    let expected = 1.0 / (area * 60.0 * 44.0);
                    let found = f64::from(view.density(ray.direction, t, 0.0));
                    assert!((found / expected - 1.0).abs() < 2e-3, "case {case}, {place} at {t}: {found} {expected}");
                }
                assert_eq!(view.density(-ray.direction, 1.0, 0.0), 0.0);
            }
        }
    }
}
