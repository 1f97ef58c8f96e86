//! Data of camera paths for samplers and filters: features of the first hit and of the first non-specular surface, the random
//! numbers with a geometric meaning, and the motion of the hit across the image.

use super::{Interaction, NO_LIGHT, World};
use crate::blocks;
use crate::material::Surface;
use crate::shading::Bsdf;
use dapple_core::{Block, FirstHit, SurfaceFeatures, integrator::Trajectory};
use dapple_geometry::Ray;
use dapple_scene::Effect;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// A [`Block`] of random numbers, and a range of its dimensions; the range may be empty.
pub type BlockDimensions = (Block, Range<u8>);

/// The random numbers that give a path-traced sample its position in the pixel, lens point, time and light point.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleDimensions {
    /// The position in the pixel: two dimensions.
    pub place: BlockDimensions,
    /// The point on the lens: two dimensions, or none without a lens.
    pub lens: BlockDimensions,
    /// The time within the exposure: one dimension, or none if nothing moves.
    pub time: BlockDimensions,
    /// The point on the light: two dimensions if the scene's only light is an area light or an environment, else none.
    pub light: BlockDimensions,
    /// A phrase that names the first random decision outside these dimensions, such as "scattering in media". `None` if these
    /// dimensions determine each sample.
    pub outside: Option<&'static str>,
}

impl World {
    /// Returns the path tracer's [`SampleDimensions`]; `None` unless the pixel filter is a box of one pixel.
    pub fn sample_dimensions(&self) -> Option<SampleDimensions> {
        let is_light_a_coordinate = self.lights.len() == 1 && !self.lights.has_delta();
        self.filter.is_one_pixel().then(|| SampleDimensions {
            place: (blocks::CAMERA, 0..2),
            lens: (blocks::CAMERA, if self.camera.has_lens() { 2..4 } else { 0..0 }),
            time: (blocks::TIME, if self.moves { 0..1 } else { 0..0 }),
            light: (blocks::scatter(0), if is_light_a_coordinate { 0..2 } else { 0..0 }),
            outside: self.outside(),
        })
    }

    /// Returns the first use of random numbers other than these dimensions, as a noun phrase.
    fn outside(&self) -> Option<&'static str> {
        let has = |effect| self.effects.has(effect);
        let uses = [
            (self.max_depth > 1 && has(Effect::Interreflection), "light that scatters more than once"),
            (has(Effect::ScatteringMedia), "scattering in media"),
            (self.has_passable_surfaces, "surfaces that rays may pass"),
            (self.lights.len() > 1, "the selection among several lights"),
            (
                has(Effect::SoftShadows) || has(Effect::Environment),
                "directions scattered towards a light with an extent",
            ),
        ];
        uses.into_iter().find_map(|(is_used, what)| is_used.then_some(what))
    }

    /// Returns the features of a camera ray's first hit (position, normals, albedo, ...), for samplers and denoisers.
    ///
    /// `u` in `[0, 1)` selects one material if the surface is a mix.
    pub fn first_hit(&self, ray: &Ray, at: &Interaction<'_>, u: f32) -> FirstHit {
        self.first_hit_of(*ray, *at, self.surface(at, u))
    }

    /// Returns the features of a first hit as [`Self::first_hit`] does, for the already selected material `surface`.
    ///
    /// Not inlined, since most renders need no such features. Arguments are passed by value, so that the caller's
    /// copies stay in registers.
    #[inline(never)]
    pub(crate) fn first_hit_of(&self, ray: Ray, at: Interaction<'_>, surface: &Surface) -> FirstHit {
        let bsdf = self.bsdf_of(&at, surface);
        let side = side(&ray, &at);
        let depth = (at.point.position - ray.origin).length();
        FirstHit::new(at.point.position.to_array(), (at.point.normal * side).to_array(), depth)
            .with_shading_normal((self.frame_of(&at, surface).normal * side).to_array())
            .with_albedo(albedo(&at, &bsdf).to_array())
            .with_footprint(self.camera.footprint(depth))
            .with_roughness(bsdf.roughness())
            .with_material(at.part.material)
            .with_shape(at.hit.shape)
            .with_primitive(at.hit.primitive)
    }

    /// Returns the features of a surface that a path hits behind mirrors, glass or smooth coats.
    ///
    /// `u` in `[0, 1)` selects one material if the surface is a mix. `tint` is the fraction of light that earlier surfaces and
    /// media pass on to the camera. `length` is the distance along the path from the camera to the previous surface.
    pub fn surface_features(
        &self,
        ray: &Ray,
        at: &Interaction<'_>,
        u: f32,
        tint: Vec3,
        length: f32,
    ) -> SurfaceFeatures {
        self.features_of(*ray, *at, self.surface(at, u), tint, length)
    }

    /// Returns the features as [`Self::surface_features`] does, for the already selected material `surface`.
    ///
    /// Not inlined, for the same reasons as [`Self::first_hit_of`].
    #[inline(never)]
    pub(crate) fn features_of(
        &self,
        ray: Ray,
        at: Interaction<'_>,
        surface: &Surface,
        tint: Vec3,
        length: f32,
    ) -> SurfaceFeatures {
        let normal = self.frame_of(&at, surface).normal * side(&ray, &at);
        let albedo = albedo(&at, &self.bsdf_of(&at, surface)) * tint;
        let depth = length + (at.point.position - ray.origin).length();
        SurfaceFeatures::new(at.point.position.to_array(), normal.to_array(), depth)
            .with_albedo(albedo.min(Vec3::ONE).to_array())
    }

    /// Returns the trajectory of a camera ray's first hit: its depth, and its motion across the image while the shutter is
    /// open. Both the object's and the camera's motion count. Reflections and objects behind glass are assumed to move with the
    /// surface that was hit.
    ///
    /// Returns `None` for a hit in the plane of the lens, and for a motion that overflows `f32`.
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

    /// Returns the change of a position while the shutter is open, divided by `depth`.
    fn motion(&self, at: impl Fn(f32, usize) -> DVec3, depth: f64) -> DVec3 {
        if !self.moves {
            return DVec3::ZERO;
        }
        let [opens, closes] = self.open;
        (at(closes, 1) - at(opens, 0)) / depth
    }
}

/// Returns the trajectory; `None` if a number is not finite in `f32`.
fn sound(inverse_depth: f64, motion: DVec3) -> Option<Trajectory> {
    let (inverse_depth, motion) = (inverse_depth as f32, motion.as_vec3());
    (inverse_depth.is_finite() && motion.is_finite()).then(|| Trajectory { inverse_depth, motion: motion.to_array() })
}

/// Returns the factor, 1 or -1, that flips a surface's normals to the side of the ray's origin.
fn side(ray: &Ray, at: &Interaction<'_>) -> f32 {
    if at.point.normal.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 }
}

/// Returns the albedo of a surface; 1 for emitters.
fn albedo(at: &Interaction<'_>, bsdf: &Bsdf<'_>) -> Vec3 {
    if at.part.light == NO_LIGHT { bsdf.albedo() } else { Vec3::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shading::warp::concentric_disk;
    use crate::support::*;
    use crate::without;
    use dapple_conformance::toys::Points;

    const SIZE: [u32; 2] = [24, 16];

    fn boxed(name: &str) -> Scene {
        let mut scene = bundle(name);
        scene.film.pixel_filter = PixelFilter::default();
        scene
    }

    /// Returns a scene with a single point light and one scattering event per path.
    fn simple(name: &str) -> Scene {
        let scene = Scene { max_depth: Some(1), ..boxed(name) };
        let effects = [Effect::Environment, Effect::SoftShadows, Effect::SeveralLights];
        effects.into_iter().fold(scene, |scene, effect| match Effects::of(&scene).has(effect) {
            true => without(&scene, effect).unwrap_or_else(|e| panic!("{e}")),
            false => scene,
        })
    }

    fn dimensions(world: &World) -> SampleDimensions {
        world.sample_dimensions().unwrap_or_else(|| panic!("no dimensions"))
    }

    /// Pixel position, lens, time and light have these numbers of dimensions. Other pixel filters than a box of one pixel have
    /// none.
    #[test]
    fn dimensions_are_those_that_the_scene_uses() {
        for (scene, expected) in
            [(simple("lens"), [2, 2, 0, 0]), (simple("motion"), [2, 0, 1, 0]), (boxed("cornell"), [2, 0, 0, 2])]
        {
            let SampleDimensions { place, lens, time, light, .. } = dimensions(&small(&scene, SIZE));
            assert_eq!([place, lens, time, light].map(|(_, lanes)| lanes.len()), expected);
        }
        let triangle = PixelFilter::Triangle { radius: [0.5, 0.5] };
        for filter in [[1.0, 1.0], [0.5, 0.25]].map(|radius| PixelFilter::Box { radius }).into_iter().chain([triangle])
        {
            let mut scene = boxed("cornell");
            scene.film.pixel_filter = filter;
            assert_eq!(small(&scene, SIZE).sample_dimensions(), None);
        }
    }

    /// Returns the number of samples whose radiance changes with the random numbers outside the dimensions.
    fn changed(world: &World) -> usize {
        let SampleDimensions { place, lens, time, light, .. } = dimensions(world);
        let is_inside = |block, lane| {
            [&place, &lens, &time, &light].iter().any(|(of, lanes)| of.number() == block && lanes.contains(&lane))
        };
        let tracer = integrator(world);
        let is_changed = |i: &u32| {
            let [one, other] = [2, 3].map(|seed| {
                let points = Points(|id, block| {
                    let [fixed, free] = [1, seed].map(|seed| Random::new(seed).block(id, block));
                    std::array::from_fn(|lane| if is_inside(block, lane as u8) { fixed[lane] } else { free[lane] })
                });
                let id = SampleId::new([i % SIZE[0], i / SIZE[0]], streams::WHOLE, 0);
                tracer.estimate(&Draws::new(&points, id), &mut Worker::default()).radiance
            });
            one != other
        };
        (0..SIZE[0] * SIZE[1]).filter(is_changed).count()
    }

    #[test]
    fn random_numbers_outside_the_dimensions_change_samples_exactly_if_there_is_such_a_use() {
        for name in ["lens", "motion", "cornell", "plates", "terrain"] {
            let world = small(&simple(name), SIZE);
            assert_eq!((dimensions(&world).outside, changed(&world)), (None, 0), "{name}");
        }
        let once = Scene { max_depth: Some(1), ..boxed("cornell") };
        let twice = "light that scatters more than once";
        for (scene, outside) in [
            (once, "directions scattered towards a light with an extent"),
            (boxed("cornell"), twice),
            (boxed("lens"), twice),
            (boxed("glass"), twice),
        ] {
            let world = small(&scene, SIZE);
            assert_eq!(dimensions(&world).outside, Some(outside), "{}", scene.name);
            assert!(changed(&world) > 0, "{}", scene.name);
        }
    }

    /// Returns the first hits of some camera rays: image position, point on the lens, hit, trajectory and time.
    fn hits(world: &World) -> Vec<([f32; 2], Vec2, Interaction<'_>, Trajectory, f32)> {
        let points = Random::new(4);
        let ids = (0..400).map(|k| SampleId::new([k % SIZE[0], k / SIZE[0] % SIZE[1]], 0, u64::from(k)));
        let hit = |id: SampleId| {
            let [x, y, u, v] = points.block(id, blocks::CAMERA.number());
            let (ray, time) = world.camera_ray(&Draws::new(&points, id));
            let at = world.closest_hit(&ray, time)?;
            let path = world.trajectory(&at).unwrap_or_else(|| panic!("no trajectory"));
            let place = [id.pixel[0] as f32 + x, id.pixel[1] as f32 + y];
            Some((place, concentric_disk([u, v]), at, path, time))
        };
        ids.filter_map(hit).collect()
    }

    #[test]
    fn a_sample_lies_at_its_depths_blur_from_its_hits_place_through_the_centre_of_the_lens() {
        let mut wide = boxed("lens");
        wide.camera.lens_radius *= 3.0;
        for (scene, blur) in [(boxed("lens"), 0.3), (wide, 1.0), (boxed("cornell"), 0.0), (boxed("motion"), 0.0)] {
            let world = small(&scene, SIZE);
            let (hits, mut largest) = (hits(&world), 0.0_f32);
            for (place, on_lens, at, path, time) in &hits {
                let (through, _) = world.camera.project(*time, at.point.position.as_dvec3());
                let [far, by_inverse_depth] = world.camera.defocus().unwrap_or_default();
                for axis in 0..2 {
                    let radius = far[axis] + by_inverse_depth[axis] * path.inverse_depth;
                    let expected = (through[axis] / through.z) as f32 + radius * on_lens[axis];
                    assert!((place[axis] - expected).abs() < 1e-3, "{place:?}: {expected} on axis {axis}");
                    largest = largest.max((radius * on_lens[axis]).abs());
                }
            }
            assert!(hits.len() > 100 && largest >= blur, "{} hits, blurred by {largest} pixels", hits.len());
        }
    }

    #[test]
    fn moved_samples_hit_the_same_point_of_the_object() {
        let mut panning = boxed("lens");
        panning.camera.moves_to = Some(panning.camera.to_world * at(0.02, 0.01, 0.1));
        // Points of rotating objects do not move in a straight line.
        for (scene, least, tolerance) in [(boxed("motion"), 40, 0.1), (panning, 100, 1e-3)] {
            let world = small(&scene, SIZE);
            let (mut moved, mut worst) = (0, 0.0_f64);
            for (_, _, at, path, time) in hits(&world) {
                moved += usize::from(path.motion != [0.0; 3]);
                // The same point of the object, at the middle of the exposure.
                let (here, later) = (at.point.position.as_dvec3(), world.time(0.5));
                let map = |time| world.geometry.to_world(at.hit.shape, time);
                let inner = map(time).map(|map| map.inverse().transform_point3(here));
                let carried = inner.zip(map(later)).map_or(here, |(inner, map)| map.transform_point3(inner));
                let [(expected, _), (from, _)] =
                    [(later, carried), (time, here)].map(|(t, p)| world.camera.project(t, p));
                let [opens, closes] = world.open.map(f64::from);
                let share = (f64::from(later) - f64::from(time)) / (closes - opens);
                let found = from / from.z + share * DVec3::from(path.motion.map(f64::from));
                worst = worst.max((found / found.z - expected / expected.z).truncate().length());
            }
            assert!(moved >= least && worst < tolerance, "{moved} samples moved, {worst} pixels apart");
        }
    }

    #[test]
    fn path_tracers_report_trajectories_only_on_request() {
        for name in ["cornell", "lens", "motion", "room"] {
            let world = small(&boxed(name), SIZE);
            let (tracer, points) = (integrator(&world), Random::new(4));
            let mut hits = 0;
            for k in 0..200 {
                let id = SampleId::new([k % SIZE[0], k / SIZE[0] % SIZE[1]], 0, u64::from(k));
                let plain = tracer.estimate(&Draws::new(&points, id), &mut Worker::default());
                let asked = tracer
                    .estimate(&Draws::for_film(&points, id, Needs::none().with_trajectories()), &mut Worker::default());
                assert_eq!((plain.radiance, plain.trajectory), (asked.radiance, None));
                assert_eq!(asked.first_hit.is_some(), asked.trajectory.is_some());
                hits += u32::from(asked.trajectory.is_some());
            }
            assert!(hits > 50, "{name}: {hits} hits");
        }
    }

    #[test]
    fn the_background_moves_with_a_camera_that_turns_and_stays_with_one_that_does_not() {
        let mut turning = boxed("lens");
        turning.camera.moves_to = Some(turning.camera.to_world * DAffine3::from_rotation_y(0.05));
        let [still, turning] = [boxed("lens"), turning].map(|scene| small(&scene, SIZE));
        let points = Random::new(4);
        for k in 0..400 {
            let id = SampleId::new([k % SIZE[0], k / SIZE[0] % SIZE[1]], 0, u64::from(k));
            let [x, y, u, v] = points.block(id, blocks::CAMERA.number());
            let (ray, time) = turning.camera_ray(&Draws::new(&points, id));
            assert_eq!(still.background_trajectory(&ray, time), None);
            let path = turning.background_trajectory(&ray, time).unwrap_or_else(|| panic!("no trajectory"));
            let here = turning.camera.project_direction(time, ray.direction.as_dvec3()).unwrap_or_default();
            let [radius, _] = turning.camera.defocus().unwrap_or_default();
            let place = Vec2::new(id.pixel[0] as f32 + x, id.pixel[1] as f32 + y);
            let expected = place - Vec2::from(radius) * concentric_disk([u, v]);
            let found = (here / here.z).truncate().as_vec2();
            assert!((found - expected).length() < 1e-3, "{found} instead of {expected}");
            assert!(path.inverse_depth == 0.0 && path.motion[0].abs() > 0.5);
        }
    }
}
