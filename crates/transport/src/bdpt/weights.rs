//! Weights of strategies by the power heuristic [after Veach 1997, ch. 10], from ratios of densities.
//!
//! A path of n vertices v0 (on the light) to v(n-1) (the camera) can be made by several strategies: one for each number
//! s of vertices that the light path contributes. With the densities L(i) and C(i) of vertex i, sampled from the light's
//! and from the camera's side, the densities of neighbouring strategies have the ratio `p(s + 1) / p(s) = L(s) / C(s)`.

use super::vertex::{Kind, Vertex};
use dapple_renderer::light::Lights;

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
