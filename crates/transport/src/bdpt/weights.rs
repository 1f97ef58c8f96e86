//! The strategies: connections of each light path with each camera path. Their weights are those of the power heuristic
//! [after Veach 1997, ch. 10], from ratios of densities.
//!
//! A path of n vertices v0 (on the light) to v(n-1) (the camera) can be made by several strategies: one for each number
//! s of vertices that the light path contributes. With the densities L(i) and C(i) of vertex i, sampled from the light's
//! and from the camera's side, the densities of neighbouring strategies have the ratio `p(s + 1) / p(s) = L(s) / C(s)`.

use super::Bdpt;
use super::vertex::{Connected, From, Kind, Vertex, on_light};
use super::walk::light_scatter;
use dapple_core::Draws;
use dapple_geometry::{Ray, spawn_ray_to, spawn_ray_to_point};
use dapple_renderer::light::Lights;
use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

/// The densities at the ends of a connection that neither path knows by itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ends {
    /// The densities of the camera path's last vertex, and of the one before, sampled from the light's side.
    pub(super) eye: [f32; 2],
    /// The densities of the light path's last vertex, and of the one before, sampled from the camera's side.
    pub(super) light: [f32; 2],
}

/// A path made by one strategy: the vertices of both parts, each from its own end.
pub(super) struct Path<'a, 'w> {
    pub(super) light: &'a [Vertex<'w>],
    pub(super) camera: &'a [Vertex<'w>],
    pub(super) ends: Ends,
}

impl<'w> Path<'_, 'w> {
    /// The number of vertices.
    fn len(&self) -> usize {
        self.light.len() + self.camera.len()
    }

    /// Returns vertex `i`, counted from the light.
    fn vertex(&self, i: usize) -> &Vertex<'w> {
        match i.checked_sub(self.light.len()) {
            None => &self.light[i],
            Some(beyond) => &self.camera[self.camera.len() - 1 - beyond],
        }
    }

    /// Returns true if nothing can be connected at vertex `i`. The ends of the connection made are never specular.
    fn is_specular(&self, i: usize) -> bool {
        let s = self.light.len();
        i + 1 != s && i != s && self.vertex(i).specular
    }

    /// Returns the densities of vertex `i` sampled from the light's side and from the camera's side.
    fn densities(&self, i: usize) -> [f64; 2] {
        let (s, vertex) = (self.light.len(), self.vertex(i));
        let pair = match i {
            _ if i >= s + 2 => [vertex.backward, vertex.forward],
            _ if i >= s => [self.ends.eye[i - s], vertex.forward],
            _ if i + 2 >= s => [vertex.forward, self.ends.light[s - 1 - i]],
            _ => [vertex.forward, vertex.backward],
        };
        pair.map(f64::from)
    }

    /// Returns true if `s` vertices from the light and the others from the camera can make this path. `fewest` is the
    /// smallest number of vertices from the camera.
    fn is_possible(&self, s: usize, fewest: usize) -> bool {
        let n = self.len();
        if n - s < fewest || (n == 2 && s > 0) {
            return false;
        }
        match s {
            0 => !matches!(self.vertex(0).kind, Kind::Delta { .. }),
            _ => !self.is_specular(s - 1) && !self.is_specular(s),
        }
    }

    /// Returns the density with which a light is sampled for vertex 1, relative to that of a light path's start.
    fn sampling(&self, lights: &Lights) -> f64 {
        let (start, next) = (self.vertex(0), self.vertex(1));
        let Some(light) = start.lamp() else { return 1.0 };
        let [own, _] = self.densities(0);
        let pdf = lights.pdf(light, next.point.position, &start.point);
        f64::from(start.density_from(next.point.position, pdf)) / own
    }

    /// Returns the power heuristic's weight of the strategy that made this path. `fewest` is the smallest number of
    /// vertices from the camera.
    pub(super) fn weight(&self, lights: &Lights, fewest: usize) -> f32 {
        let (s, n) = (self.light.len(), self.len());
        if n == 2 {
            return 1.0;
        }
        // Strategy 1 samples the light for the vertex that it lights, not as light paths start.
        let sampling = if self.is_possible(1, fewest) { self.sampling(lights) } else { 1.0 };
        let own = if s == 1 { sampling } else { 1.0 };
        let term = |strategy: usize, ratio: f64| {
            let ratio = if strategy == 1 { ratio * sampling } else { ratio } / own;
            if self.is_possible(strategy, fewest) { ratio * ratio } else { 0.0 }
        };
        let (mut sum, mut ratio) = (1.0, 1.0);
        for i in (0..s).rev() {
            let [from_light, from_camera] = self.densities(i);
            ratio *= from_camera / from_light;
            sum += term(i, ratio);
        }
        ratio = 1.0;
        for i in s..n - 1 {
            let [from_light, from_camera] = self.densities(i);
            ratio *= from_light / from_camera;
            sum += term(i + 1, ratio);
        }
        // Densities that under- or overflow leave no other strategy, or none at all.
        let weight = (1.0 / sum) as f32;
        if weight.is_nan() { 0.0 } else { weight }
    }
}

/// The contribution of a strategy before its weight, with the densities at the ends of the connection.
pub(super) struct Contribution {
    pub(super) radiance: Vec3,
    pub(super) ends: Ends,
}

impl Bdpt<'_> {
    /// Returns the light that the camera path with `t` vertices finds by itself (s = 0).
    pub(super) fn found(&self, camera: &[Vertex<'_>]) -> Option<Contribution> {
        let lights = self.world.lights();
        let (last, before) = (&camera[camera.len() - 1], &camera[camera.len() - 2]);
        let (emitted, eye) = if matches!(last.kind, Kind::Sky) {
            let (_, radius) = lights.scene_sphere();
            let disk = FRAC_1_PI / (radius * radius);
            let start = lights.environment_emission_pdf(last.wo);
            (lights.environment(last.wo), [start, disk * before.cosine(last.wo)])
        } else {
            let light = last.lamp()?;
            let emitted = lights.emitted(light, &last.point, last.point.normal.dot(last.wo));
            let pdf = lights.emission_pdf(light, &last.facing(last.wo), last.wo);
            let direction = before.density_from(last.point.position, pdf.direction);
            (emitted, [pdf.position * lights.pmf(light), direction])
        };
        let (radiance, ends) = (last.throughput * emitted, Ends { eye, ..Ends::default() });
        (radiance != Vec3::ZERO).then_some(Contribution { radiance, ends })
    }

    /// Returns true if light arrives along a shadow ray. Only light above 0 is traced and counted in `rays`.
    fn arrives(&self, radiance: Vec3, shadow_ray: impl FnOnce() -> Ray, (time, rays): (f32, &mut u32)) -> bool {
        if !(radiance.is_finite() && radiance.max_element() > 0.0) {
            return false;
        }
        *rays += 1;
        !self.world.occluded(&shadow_ray(), time)
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
        let (kind, point) = on_light(light, sample.target, sample.delta, last.point.position);
        if matches!(kind, Kind::Sky) {
            // All environments together are one light.
            sample.radiance = lights.environment(sample.wi);
            sample.pdf = lights.environment_emission_pdf(sample.wi);
        }
        let radiance = last.throughput * connected.factor * sample.radiance / sample.pdf;
        if !self.arrives(radiance, || sample.shadow_ray(&last.point), (time, rays)) {
            return None;
        }
        let mut vertex = Vertex::new(kind, point, sample.wi, Vec3::ONE, 0.0);
        let pdf = lights.emission_pdf(light, &vertex.facing(-sample.wi), -sample.wi);
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
        let [at_eye, at_lit] = [eye, lit].map(|vertex| vertex.point.position);
        let to = at_eye - at_lit;
        let squared = to.length_squared();
        let direction = to / squared.sqrt();
        if !(squared > 0.0 && direction.is_finite()) {
            return None;
        }
        let of_lit = lit.connect(From::Light, direction)?;
        let of_eye = eye.connect(From::Camera, -direction)?;
        // The factor at the light path's end has the cosine with which light leaves; the camera path's has its own.
        let radiance = lit.throughput * of_lit.factor * of_eye.factor * eye.throughput / squared;
        if !self.arrives(radiance, || spawn_ray_to(&lit.point, &eye.point), (time, rays)) {
            return None;
        }
        let ends = Ends {
            eye: [eye.density_from(at_lit, of_lit.forward), before_eye.density_from(at_eye, of_eye.backward)],
            light: [lit.density_from(at_eye, of_eye.forward), before_lit.density_from(at_lit, of_lit.backward)],
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
            if !self.arrives(radiance, || spawn_ray_to_point(&lit.point, found.position), (time, rays)) {
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
