//! The strategies: connections of each light path with each camera path.

use super::Bdpt;
use super::vertex::{Connected, From, Kind, Vertex};
use super::walk::{light_scatter, point_in_space};
use super::weights::{Ends, Path};
use dapple_core::Draws;
use dapple_geometry::{spawn_ray_to, spawn_ray_to_point};
use dapple_renderer::light::Target;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// The contribution of a strategy before its weight, with the densities at the ends of the connection.
pub(super) struct Contribution {
    pub(super) radiance: Vec3,
    pub(super) ends: Ends,
}

impl Bdpt<'_> {
    /// Returns the light that the camera path with `t` vertices finds by itself (s = 0).
    pub(super) fn found(&self, camera: &[Vertex<'_>]) -> Option<Contribution> {
        let (world, lights) = (self.world, self.world.lights());
        let (last, before) = (&camera[camera.len() - 1], &camera[camera.len() - 2]);
        if matches!(last.kind, Kind::Sky) {
            let radiance = last.throughput * lights.environment(last.wo);
            let start = lights.environment_emission_pdf(last.wo);
            let (_, radius) = lights.scene_sphere();
            let disk = FRAC_1_PI / (radius * radius);
            let ends = Ends { eye: [start, disk * before.cosine(last.wo)], ..Ends::default() };
            return (radiance != Vec3::ZERO).then_some(Contribution { radiance, ends });
        }
        let light = last.lamp()?;
        let radiance = last.throughput * last.emitted(world, last.wo);
        if radiance == Vec3::ZERO {
            return None;
        }
        let pdf = lights.emission_pdf(light, last.facing(last.wo), last.wo);
        let start = pdf.position * lights.pmf(light);
        let eye = [start, before.density_from(last.point.position, pdf.direction)];
        Some(Contribution { radiance, ends: Ends { eye, ..Ends::default() } })
    }

    /// Returns the light from a point sampled on a light for the last vertex of a camera path (s = 1), and the vertex on
    /// the light.
    pub(super) fn sampled<'w>(
        &self,
        camera: &[Vertex<'w>],
        (time, rays): (f32, &mut u32),
    ) -> Option<(Contribution, Vertex<'w>)> {
        let lights = self.world.lights();
        let (last, before) = (&camera[camera.len() - 1], &camera[camera.len() - 2]);
        let [choice, u, v] = last.to_light;
        let selected = lights.select(choice)?;
        let mut sample = lights.sample_selected(selected, last.point.position, [u, v])?;
        let connected = last.connect(From::Camera, sample.wi)?;
        let light = selected.index;
        let (kind, point) = match sample.target {
            Target::Surface(point) => (Kind::Lamp { light }, point),
            Target::Point(position) => (Kind::Delta { parallel: false }, point_in_space(position)),
            Target::Far if sample.delta => (Kind::Delta { parallel: true }, point_in_space(last.point.position)),
            Target::Far => {
                // All environments together are one light.
                sample.radiance = lights.environment(sample.wi);
                sample.pdf = lights.environment_emission_pdf(sample.wi);
                (Kind::Sky, point_in_space(last.point.position))
            }
        };
        let radiance = last.throughput * connected.factor * sample.radiance / sample.pdf;
        if !(radiance.is_finite() && radiance.max_element() > 0.0) {
            return None;
        }
        *rays += 1;
        if self.world.occluded(&sample.shadow_ray(&last.point), time) {
            return None;
        }
        let throughput = Vec3::ONE;
        let (specular, to_light, [forward, backward]) = (false, [0.0; 3], [0.0; 2]);
        let mut vertex = Vertex { kind, point, wo: sample.wi, throughput, specular, forward, backward, to_light };
        let pdf = lights.emission_pdf(light, vertex.facing(-sample.wi), -sample.wi);
        let towards = if vertex.is_far() {
            pdf.position * last.cosine(sample.wi)
        } else {
            last.density_from(vertex.point.position, pdf.direction)
        };
        vertex.forward = match vertex.kind {
            Kind::Sky => sample.pdf,
            _ => selected.pmf * pdf.position,
        };
        let eye = [towards, before.density_from(last.point.position, connected.backward)];
        let light = [vertex.density_from(last.point.position, connected.forward), 0.0];
        Some((Contribution { radiance, ends: Ends { eye, light } }, vertex))
    }

    /// Returns the light along the connection of the last vertices of both paths (s > 1, t > 1).
    pub(super) fn connected(
        &self,
        light: &[Vertex<'_>],
        camera: &[Vertex<'_>],
        (time, rays): (f32, &mut u32),
    ) -> Option<Contribution> {
        let [(eye, before_eye), (lit, before_lit)] = [camera, light].map(|p| (&p[p.len() - 1], &p[p.len() - 2]));
        let to = eye.point.position - lit.point.position;
        let squared = to.length_squared();
        let direction = to / squared.sqrt();
        if !(squared > 0.0 && direction.is_finite()) {
            return None;
        }
        let at_light = lit.connect(From::Light, direction)?;
        let at_eye = eye.connect(From::Camera, -direction)?;
        // The factor at the light path's end has the cosine with which light leaves; the camera path's has its own.
        let radiance = lit.throughput * at_light.factor * at_eye.factor * eye.throughput / squared;
        if !(radiance.is_finite() && radiance.max_element() > 0.0) {
            return None;
        }
        *rays += 1;
        if self.world.occluded(&spawn_ray_to(&lit.point, &eye.point), time) {
            return None;
        }
        let ends = Ends {
            eye: [
                eye.density_from(lit.point.position, at_light.forward),
                before_eye.density_from(eye.point.position, at_eye.backward),
            ],
            light: [
                lit.density_from(eye.point.position, at_eye.forward),
                before_lit.density_from(lit.point.position, at_light.backward),
            ],
        };
        Some(Contribution { radiance, ends })
    }

    /// Calls `add` with the place in the image and the light of each vertex of a light path that the camera sees (t = 1).
    /// The place is in pixels from the top left corner. The light is that of the mean over the image's pixels.
    pub(super) fn seen(
        &self,
        draws: &Draws<'_>,
        light: &[Vertex<'_>],
        (time, rays): (f32, &mut u32),
        mut add: impl FnMut(Vec2, usize, Contribution),
    ) {
        let camera = self.world.camera();
        for s in (self.least + 1).max(2)..=light.len() {
            let (lit, before) = (&light[s - 1], &light[s - 2]);
            if !lit.connects() {
                continue;
            }
            let lens = if camera.has_lens() { draws.block(light_scatter(s as u32 - 2)) } else { [0.0; 4] };
            let Some(found) = camera.connect(lit.point.position, [lens[0], lens[1]], time) else { continue };
            if !self.world.is_in_image(found.place) {
                continue;
            }
            let Some(Connected { factor, backward, .. }) = lit.connect(From::Light, -found.direction) else {
                continue;
            };
            let density = camera.density(found.direction, found.distance, time);
            let radiance = lit.throughput * factor * density;
            if !(radiance.is_finite() && radiance.max_element() > 0.0) {
                continue;
            }
            *rays += 1;
            if self.world.occluded(&spawn_ray_to_point(&lit.point, found.position), time) {
                continue;
            }
            let light = [density * lit.cosine(found.direction), before.density_from(lit.point.position, backward)];
            add(found.place, s, Contribution { radiance, ends: Ends { light, ..Ends::default() } });
        }
    }

    /// Returns the weight of the strategy that joined these paths. `light` is empty for s = 0, and `camera` has the
    /// camera alone for t = 1.
    pub(super) fn weight(&self, light: &[Vertex<'_>], camera: &[Vertex<'_>], ends: &Ends) -> f32 {
        Path { light, camera, ends: *ends }.weight(self.world.lights(), if self.splats { 1 } else { 2 })
    }
}
