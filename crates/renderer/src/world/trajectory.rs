//! The motion of a camera ray's first hit across the image, for filters that move samples over lens and time.

use super::{Interaction, World};
use dapple_core::Trajectory;
use dapple_geometry::Ray;
use glam::DVec3;

impl World {
    /// Returns the trajectory of a camera ray's first hit: its depth, and its motion across the image while the shutter is
    /// open, with the object and the camera. Reflections, and what is behind glass, are taken to move with the surface hit.
    ///
    /// Returns `None` for a hit in the plane of the lens, and for a motion beyond the range of `f32`.
    pub fn trajectory(&self, at: &Interaction<'_>) -> Option<Trajectory> {
        let now = at.point.position.as_dvec3();
        let ends = match self.geometry.to_world(at.hit.shape, at.time).filter(|_| self.moves) {
            None => [now; 2],
            Some(to_world) => {
                let inner = to_world.inverse().transform_point3(now);
                let place = |time| self.geometry.to_world(at.hit.shape, time).map(|map| map.transform_point3(inner));
                self.open.map(|time| place(time).unwrap_or(now))
            }
        };
        let (here, depth) = self.camera.project(at.time, now);
        let motion = self.motion(|time, end| self.camera.project(time, ends[end]).0, here.z);
        sound((depth > 0.0).then(|| 1.0 / depth)?, motion)
    }

    /// Returns the trajectory of the background along a camera ray that hits nothing; `None` if the camera is at rest or
    /// orthographic.
    pub fn background_trajectory(&self, ray: &Ray, time: f32) -> Option<Trajectory> {
        let direction = ray.direction.as_dvec3();
        let here = self.camera.project_direction(time, direction).filter(|_| self.camera.moves())?;
        let at = |time, _| self.camera.project_direction(time, direction).unwrap_or(here);
        sound(0.0, self.motion(at, here.z))
    }

    /// Returns the change of a position while the shutter is open, relative to `depth`.
    fn motion(&self, at: impl Fn(f32, usize) -> DVec3, depth: f64) -> DVec3 {
        if !self.moves {
            return DVec3::ZERO;
        }
        let [opens, closes] = self.open;
        (at(closes, 1) - at(opens, 0)) / depth
    }
}

/// Returns the trajectory if its numbers are finite in `f32`.
fn sound(inverse_depth: f64, motion: DVec3) -> Option<Trajectory> {
    let (inverse_depth, motion) = (inverse_depth as f32, motion.as_vec3());
    (inverse_depth.is_finite() && motion.is_finite()).then(|| Trajectory::new(inverse_depth, motion.to_array()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shading::warp::concentric_disk;
    use crate::{blocks, integrator};
    use dapple_core::{Draws, Needs, PointSet, SampleId, Worker};
    use dapple_low_discrepancy::Random;
    use dapple_scene::{PixelFilter, Scene, bundled};
    use glam::{DAffine3, Vec2};

    const SIZE: [u32; 2] = [24, 16];

    fn scene(name: &str) -> Scene {
        let files = bundled::files(name).unwrap_or_else(|| panic!("no scene {name}"));
        let mut scene = files.read().unwrap_or_else(|e| panic!("{e}"));
        scene.film.pixel_filter = PixelFilter::default();
        scene
    }

    fn world(scene: &Scene) -> World {
        World::with_resolution(scene, SIZE).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The camera rays of some samples: place in the image, point on the lens, ray and time.
    fn rays(world: &World) -> Vec<([f32; 2], Vec2, Ray, f32)> {
        let ids = (0..400).map(|k| SampleId::new([k % SIZE[0], k / SIZE[0] % SIZE[1]], 0, u64::from(k)));
        let of = |id: SampleId| {
            let points = Random::new(4);
            let [x, y, u, v] = points.block(id, blocks::CAMERA.number());
            let (ray, time) = world.camera_ray(&Draws::new(&points, id));
            ([id.pixel[0] as f32 + x, id.pixel[1] as f32 + y], concentric_disk([u, v]), ray, time)
        };
        ids.map(of).collect()
    }

    #[test]
    fn a_sample_lies_at_its_depths_blur_from_its_hits_place_through_the_centre_of_the_lens() {
        let mut wide = scene("lens");
        wide.camera.lens_radius *= 3.0;
        for (scene, blur) in [(scene("lens"), 0.3), (wide, 1.0), (scene("cornell"), 0.0), (scene("motion"), 0.0)] {
            let world = world(&scene);
            let (mut hits, mut largest) = (0, 0.0_f32);
            for (place, on_lens, ray, time) in rays(&world) {
                let Some(at) = world.closest_hit(&ray, time) else { continue };
                let path = world.trajectory(&at).unwrap_or_else(|| panic!("no trajectory"));
                let (through, _) = world.camera.project(time, at.point.position.as_dvec3());
                let [far, by_inverse_depth] = world.camera.defocus().unwrap_or_default();
                let radius = [0, 1].map(|axis| far[axis] + by_inverse_depth[axis] * path.inverse_depth);
                let found = [through.x / through.z, through.y / through.z].map(|x| x as f32);
                for axis in 0..2 {
                    let expected = found[axis] + radius[axis] * on_lens[axis];
                    assert!((place[axis] - expected).abs() < 1e-3, "{place:?}: {expected} on axis {axis}");
                    largest = largest.max((radius[axis] * on_lens[axis]).abs());
                }
                hits += 1;
            }
            assert!(hits > 100 && largest >= blur, "{hits} hits, blurred by at most {largest} pixels");
        }
    }

    #[test]
    fn moved_samples_hit_the_same_point_of_the_object() {
        let moving = scene("motion");
        let mut panning = scene("lens");
        panning.camera.moves_to =
            Some(panning.camera.to_world * DAffine3::from_translation(DVec3::new(0.02, 0.01, 0.1)));
        // Rotating objects leave the straight line between their ends.
        for (scene, least, tolerance) in [(moving, 40, 0.1), (panning, 100, 1e-3)] {
            let world = world(&scene);
            let (mut moved, mut worst) = (0, 0.0_f64);
            for (_, _, ray, time) in rays(&world) {
                let Some(at) = world.closest_hit(&ray, time) else { continue };
                let path = world.trajectory(&at).unwrap_or_else(|| panic!("no trajectory"));
                moved += usize::from(path.motion != [0.0; 3]);
                // The point at the middle of the exposure, carried by its object.
                let (here, later) = (at.point.position.as_dvec3(), world.time(0.5));
                let carried = match world.geometry.to_world(at.hit.shape, time) {
                    None => here,
                    Some(map) => {
                        let inner = map.inverse().transform_point3(here);
                        world.geometry.to_world(at.hit.shape, later).map_or(here, |map| map.transform_point3(inner))
                    }
                };
                let (expected, _) = world.camera.project(later, carried);
                let (from, _) = world.camera.project(time, here);
                let [opens, closes] = world.open.map(f64::from);
                let share = (f64::from(later) - f64::from(time)) / (closes - opens);
                let found = from / from.z + share * DVec3::from(path.motion.map(f64::from));
                let apart = (found / found.z - expected / expected.z).truncate().length();
                worst = worst.max(apart);
            }
            assert!(moved >= least && worst < tolerance, "{moved} samples moved, {worst} pixels apart");
        }
    }

    #[test]
    fn path_tracers_report_trajectories_only_on_request() {
        for name in ["cornell", "lens", "motion", "room"] {
            let world = world(&scene(name));
            let (tracer, points) = (integrator(&world), Random::new(4));
            let (mut hits, mut misses) = (0, 0);
            for k in 0..200 {
                let id = SampleId::new([k % SIZE[0], k / SIZE[0] % SIZE[1]], 0, u64::from(k));
                let plain = tracer.estimate(&Draws::new(&points, id), &mut Worker::default());
                let asked = tracer
                    .estimate(&Draws::for_film(&points, id, Needs::none().with_trajectories()), &mut Worker::default());
                assert_eq!((plain.radiance, plain.trajectory), (asked.radiance, None));
                assert!(asked.first_hit.is_none() || asked.trajectory.is_some());
                (hits, misses) =
                    (hits + usize::from(asked.trajectory.is_some()), misses + usize::from(asked.first_hit.is_none()));
            }
            assert!(hits > 50 && hits + misses == 200, "{name}: {hits} hits and {misses} misses");
        }
    }

    #[test]
    fn the_background_moves_with_a_camera_that_turns_and_stays_with_one_that_does_not() {
        let mut turning = scene("lens");
        turning.camera.moves_to = Some(turning.camera.to_world * DAffine3::from_rotation_y(0.05));
        let (still, turning) = (world(&scene("lens")), world(&turning));
        for (place, on_lens, ray, time) in rays(&turning) {
            assert_eq!(still.background_trajectory(&ray, time), None);
            let path = turning.background_trajectory(&ray, time).unwrap_or_else(|| panic!("no trajectory"));
            let here = turning.camera.project_direction(time, ray.direction.as_dvec3()).unwrap_or_default();
            let [radius, _] = turning.camera.defocus().unwrap_or_default();
            let expected = Vec2::from(place) - Vec2::from(radius) * on_lens;
            let found = (here / here.z).truncate().as_vec2();
            assert!((found - expected).length() < 1e-3, "{found} instead of {expected}");
            assert!(path.inverse_depth == 0.0 && path.motion[0].abs() > 0.5);
        }
    }
}
