//! Lightcuts [Walter et al. 2005]: direct lighting from many lights at the cost of a few groups of lights.
//!
//! Lights become points in binary trees. At the first non-specular surface of a path, a cut through the trees is refined until
//! no group's error bound exceeds a given fraction of the estimate. Later surfaces sample lights as in the path tracer.

mod common;
mod tree;

use crate::patches::{Division, Patches};
use crate::walk::{LIGHT, TOWARDS, first_hit, grid, is_non_specular, refuse, scattered_from, visible};
use common::CommonCuts;
use dapple_core::integrator::{Pass, PreparationCost, Prepares};
use dapple_core::options::Options as _;
use dapple_core::{Draws, Frame, Integrator, Worker};
use dapple_renderer::light::{SelectedLight, Target};
use dapple_renderer::{GatherPoint, MakeError, VertexLight, World, path_tracer_with};
use dapple_scene::Effect;
use glam::Vec3;
use std::collections::BinaryHeap;
use std::f32::consts::{FRAC_1_PI, PI};
use tree::{LightTree, Node, PointLight, SETS, luminance};

dapple_core::options! {
    /// The parameters of the integrator `lightcuts`.
    pub struct LightcutOptions {
        /// Maximum error bound of a light cluster, as a fraction of the estimate.
        pub error: f32 = 0.02, |error| error >= 0.0 && error.is_finite(), "0 or above";
        /// Maximum number of light clusters in a cut.
        pub cut: u32 = 1000, |cut| cut >= 1, "1 or above";
        /// Number of point lights that represent all area lights; each area light has at least one.
        pub points: u32 = 1024, |points| (1..=1 << 24).contains(&points), "1 to 16777216";
        /// Number of directional lights that represent each environment map.
        pub sky: u32 = 4096, |sky| (1..=1 << 24).contains(&sky), "1 to 16777216";
        /// Number of surface clusters, each with one initial cut for all its points; 0: every cut starts at the root.
        pub clusters: u32 = 0, |clusters| clusters <= 1 << 16, "0 to 65536";
    }
}

/// Makes the integrator from the text of its parameters, for the table of integrators.
pub(crate) fn make<'w>(parameters: &str, world: &'w World) -> Result<Box<dyn Integrator + 'w>, MakeError> {
    let options = LightcutOptions::parse(parameters)?;
    let reason = "scattering-media, but cuts are computed at surfaces only; use integrator \"path\"";
    refuse(world, &[(Effect::ScatteringMedia, reason)])?;
    let division = (options.clusters > 0).then(|| Division::new(world, options.clusters));
    let division = division.transpose().map_err(MakeError::Scene)?;
    Ok(path_tracer_with(world, CutLight::new(world, options, division)))
}

/// Errors below this fraction of the image's mean are ignored.
const FLOOR: f32 = 1e-3;

/// Lightcuts as a source of light at path vertices. The trees of all lights are built before the first sample.
struct CutLight<'w> {
    world: &'w World,
    options: LightcutOptions,
    trees: Vec<LightTree>,
    /// Errors below this luminance are ignored.
    floor: f32,
    /// The division of surfaces into clusters that share a cut; `None` without common cuts.
    division: Option<Division>,
    common: Option<CommonCuts>,
}

/// A node of one of the trees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct NodeId {
    tree: u32,
    node: u32,
}

/// The light estimated by a cut.
#[derive(Clone, Copy, Debug)]
struct CutSum {
    light: Vec3,
    /// The number of rays traced.
    rays: u32,
}

/// A group of lights in a cut.
#[derive(Clone, Copy, Debug)]
struct Member {
    /// An upper bound of the group's error, as a luminance.
    bound: f32,
    id: NodeId,
    /// The contribution of the group's representative light, per unit of intensity.
    unit: Vec3,
}

/// A cut during its refinement.
#[derive(Debug, Default)]
struct Refinement {
    members: Vec<Member>,
    /// A priority queue of the members that are too coarse: their bound (upper half) and their inverted index. Bounds are not
    /// negative, so their bits sort like their values.
    coarse: BinaryHeap<u64>,
}

impl Refinement {
    /// Queues a member for refinement if its bound is above `enough`.
    fn note(&mut self, number: usize, enough: f32) {
        let bound = self.members[number].bound;
        if bound > enough {
            self.coarse.push(u64::from(bound.to_bits()) << 32 | u64::from(!(number as u32)));
        }
    }

    /// Removes the coarsest member from the queue. Returns its index and bound.
    fn coarsest(&mut self) -> Option<(usize, f32)> {
        let key = self.coarse.pop()?;
        Some((!(key as u32) as usize, f32::from_bits((key >> 32) as u32)))
    }
}

/// A surface point that is lit by a cut.
struct Lit<'a> {
    vertex: &'a GatherPoint<'a>,
    /// The unit normal on the side of the previous vertex.
    normal: Vec3,
    /// An upper bound of the surface's BSDF, as a luminance.
    material: f32,
    set: usize,
}

impl<'a> Lit<'a> {
    fn new(vertex: &'a GatherPoint<'a>, set: usize) -> Self {
        let side = if vertex.frame.normal.dot(vertex.back) < 0.0 { -1.0 } else { 1.0 };
        let mirrored = Vec3::new(-vertex.wo.x, -vertex.wo.y, vertex.wo.z);
        // The peak of a wide lobe is near the mirror direction, and hardly higher than the value there.
        let peak = luminance(vertex.bsdf.evaluate(vertex.wo, mirrored));
        let material = (luminance(vertex.bsdf.albedo()) * FRAC_1_PI).max(1.1 * peak);
        Self { vertex, normal: vertex.frame.normal * side, material, set }
    }
}

impl<'w> CutLight<'w> {
    fn new(world: &'w World, options: LightcutOptions, division: Option<Division>) -> Self {
        Self { world, options, trees: Vec::new(), floor: 0.0, division, common: None }
    }

    /// Converts all lights to points and builds their trees.
    fn trees(&self, pass: &Pass<'_>) -> Vec<LightTree> {
        let lights = self.world.lights();
        let areas: f64 = (0..lights.len() as u32).filter(|l| self.is_area(*l)).map(|l| lights.power(l)).sum();
        let (mut omni, mut oriented, mut far) = (Vec::new(), Vec::new(), Vec::new());
        let mut path = 0;
        for light in 0..lights.len() as u32 {
            if let Some(point) = self.single_point(light) {
                omni.push(point);
                continue;
            }
            let count = match lights.light_sphere(light) {
                Some(_) => ((f64::from(self.options.points) * lights.power(light) / areas) as u32).max(1),
                None if lights.is_delta(light) => 1,
                None => self.options.sky,
            };
            for _ in 0..count {
                let draws = pass.draws(path);
                path += 1;
                let ([.., u, v], [x, y, ..]) = (draws.block(LIGHT), draws.block(TOWARDS));
                let selected = SelectedLight { index: light, pmf: 1.0 };
                let Some(ray) = lights.sample_emission_of(selected, [u, v], [x, y]) else { continue };
                let share = (count as f32).recip();
                match ray.source {
                    Target::Surface(point) => {
                        // A two-sided light has half of its points on each side.
                        let sides = ray.cosine * FRAC_1_PI / ray.pdf.direction;
                        let intensity = ray.radiance * (share * sides / ray.pdf.position);
                        let target = Target::Surface(point);
                        oriented.push(PointLight::new(ray.position, point.normal, intensity, target));
                    }
                    // Lights without extent are single points.
                    Target::Point(_) => {}
                    Target::Far => {
                        let irradiance = ray.radiance * (share / ray.pdf.direction);
                        far.push(PointLight::new(-ray.direction, Vec3::ZERO, irradiance, Target::Far));
                    }
                }
            }
        }
        let radius = lights.scene_sphere().1;
        let trees = [(omni, false), (oriented, false), (far, true)];
        let trees = trees.map(|(lights, far)| LightTree::new(lights, far, radius));
        trees.into_iter().filter(|tree| !tree.nodes.is_empty()).collect()
    }

    /// Returns true for a light that is represented by points on its surface.
    fn is_area(&self, light: u32) -> bool {
        let lights = self.world.lights();
        lights.light_sphere(light).is_some() && !lights.is_delta(light) && lights.ball(light).is_none()
    }

    /// Returns a spherical, point or spot light as a single point; `None` for other lights.
    fn single_point(&self, light: u32) -> Option<PointLight> {
        let lights = self.world.lights();
        if let Some((centre, radius, radiance)) = lights.ball(light) {
            // A sphere above the horizon gives the same irradiance as a point [e.g. Pharr et al. 2023, sec. 4.1].
            let point = PointLight::new(centre, Vec3::ZERO, radiance * (PI * radius * radius), Target::Point(centre));
            return Some(PointLight { radius, ..point });
        }
        let (centre, _) = lights.light_sphere(light).filter(|_| lights.is_delta(light))?;
        let intensity = lights.intensity(light)?;
        let point = PointLight::new(centre, Vec3::ZERO, intensity, Target::Point(centre));
        Some(PointLight { delta: light, ..point })
    }

    /// Returns the contribution of a light at a point per unit of the light's intensity, and the number of rays traced.
    fn unit(&self, lit: &Lit<'_>, light: &PointLight, far: bool) -> (Vec3, u32) {
        let at = lit.vertex.at;
        let from = at.point();
        let to = light.position - from.position;
        let distance = to.length();
        let wi = if far { light.position } else { to / distance };
        let mut geometry = if far { 1.0 } else { 1.0 / (distance * distance) };
        if light.facing != Vec3::ZERO {
            geometry *= (-light.facing.dot(wi)).max(0.0);
        }
        if light.delta != u32::MAX {
            let selected = SelectedLight { index: light.delta, pmf: 1.0 };
            let sample = self.world.lights().sample_selected(selected, from.position, [0.5; 2]);
            let Some(sample) = sample else { return (Vec3::ZERO, 0) };
            geometry = luminance(sample.radiance) / luminance(light.intensity);
        }
        let scattered = scattered_from(lit.vertex, wi).filter(|_| geometry > 0.0 && geometry.is_finite());
        let unit = scattered.map_or(Vec3::ZERO, |(f, cosine)| f * (cosine.abs() * geometry));
        if unit == Vec3::ZERO {
            return (Vec3::ZERO, 0);
        }
        let target = match light.target {
            // Just above the sphere's surface.
            Target::Point(centre) if light.radius > 0.0 => {
                let above = (light.radius * (1.0 + 1e-3)).min(0.5 * distance);
                Target::Point(centre - wi * above)
            }
            target => target,
        };
        let (share, rays) = visible(self.world, at, wi, target);
        (unit * share, rays)
    }

    /// Iterates over the roots of all trees.
    fn roots(&self) -> impl Iterator<Item = NodeId> {
        (0..self.trees.len() as u32).map(|tree| NodeId { tree, node: 0 })
    }

    /// Estimates the light from all lights at a point by a cut, which is stored in `cut`. The cut is refined from the nodes of
    /// `start`, or from the roots if `start` is empty.
    fn cut(&self, lit: &Lit<'_>, start: &[NodeId], cut: &mut Refinement) -> CutSum {
        cut.members.clear();
        cut.coarse.clear();
        let mut sum = CutSum { light: Vec3::ZERO, rays: 0 };
        let roots = self.roots().filter(|_| start.is_empty());
        cut.members.extend(start.iter().copied().chain(roots).map(|id| self.member(lit, id, None, 0.0, &mut sum)));
        while (cut.members.len() as u32) < self.options.cut {
            let enough = self.enough(&sum);
            let Some((number, bound)) = cut.coarsest() else {
                // All members are queued again, since the sum may be smaller than when they were added.
                (0..cut.members.len()).for_each(|number| cut.note(number, enough));
                if cut.coarse.is_empty() {
                    break;
                }
                continue;
            };
            if bound <= enough {
                cut.coarse.clear();
                continue;
            }
            let Member { id, unit, .. } = cut.members[number];
            let of = &self.trees[id.tree as usize];
            let parent = &of.nodes[id.node as usize];
            let Some(children) = parent.children else { break };
            sum.light -= unit * parent.intensity;
            let [one, other] = children.map(|node| {
                let same = of.nodes[node as usize].lights[lit.set] == parent.lights[lit.set];
                self.member(lit, NodeId { node, ..id }, same.then_some(unit), enough, &mut sum)
            });
            cut.members[number] = one;
            cut.members.push(other);
            let enough = self.enough(&sum);
            cut.note(number, enough);
            cut.note(cut.members.len() - 1, enough);
        }
        // Subtractions leave rounding errors, so the sum is computed again.
        let light = |m: &Member| m.unit * self.trees[m.id.tree as usize].nodes[m.id.node as usize].intensity;
        CutSum { light: cut.members.iter().map(light).sum(), ..sum }
    }

    /// Returns the error bound below which a group needs no refinement.
    fn enough(&self, sum: &CutSum) -> f32 {
        self.options.error * luminance(sum.light).max(self.floor)
    }

    /// Returns a node as a member of a cut, and adds its light to `sum`. `unit` is given if the node has the same
    /// representative light as its parent.
    fn member(&self, lit: &Lit<'_>, id: NodeId, unit: Option<Vec3>, enough: f32, sum: &mut CutSum) -> Member {
        let of = &self.trees[id.tree as usize];
        let group = &of.nodes[id.node as usize];
        let bound = group.children.map_or(0.0, |_| {
            let enough = enough / lit.material;
            group.bound(of.far, lit.vertex.at.point().position, lit.normal, enough) * lit.material
        });
        let (unit, rays) = match unit {
            Some(unit) => (unit, 0),
            None => self.unit(lit, &of.lights[group.lights[lit.set] as usize], of.far),
        };
        sum.light += unit * group.intensity;
        sum.rays += rays;
        Member { bound, id, unit }
    }
}

/// The state of a path.
#[derive(Clone, Copy, Default)]
struct Cut {
    /// True once the path has computed a cut.
    is_made: bool,
    /// True if a cut provided the direct light of the last vertex (`has_direct`) or of the current vertex (`next`).
    has_direct: bool,
    next: bool,
}

impl VertexLight for CutLight<'_> {
    const ACTIVE: bool = true;
    type State = Cut;

    fn gather(&self, state: &mut Cut, vertex: &GatherPoint<'_>, draws: &Draws<'_>, worker: &mut Worker) -> (Vec3, u32) {
        state.next = false;
        if state.is_made || !is_non_specular(vertex.bsdf) {
            return (Vec3::ZERO, 0);
        }
        (state.is_made, state.next) = (true, true);
        let set = (draws.sample_number() % SETS as u64) as usize;
        let start = self.common.as_ref().map_or(&[][..], |common| common.at(self.world, vertex));
        let sum = self.cut(&Lit::new(vertex, set), start, worker.scratch());
        (sum.light, sum.rays)
    }

    fn samples_lights(&self, state: &Cut, vertex: &GatherPoint<'_>) -> bool {
        state.is_made || !is_non_specular(vertex.bsdf)
    }

    fn scattered(&self, state: &mut Cut, specular: bool) {
        state.has_direct = !specular && state.next;
        state.next = false;
    }

    fn scattered_in_medium(&self, state: &mut Cut) {
        (state.has_direct, state.next) = (false, false);
    }

    fn replaces(&self, state: &Cut, _: u32, specular: bool) -> bool {
        !specular && state.has_direct
    }

    fn prepares(&self) -> Prepares {
        Prepares::Once
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        self.trees = self.trees(pass);
        let (floor, mut rays) = self.mean(&pass.frame);
        self.floor = FLOOR * floor;
        if let Some(division) = &self.division {
            let (common, more) = self.common_cuts(Patches::new(self.world, division), &pass.frame);
            (self.common, rays) = (Some(common), rays + more);
        }
        PreparationCost { rays }
    }

    fn memory(&self, _: &Frame) -> u64 {
        let lights = self.world.lights();
        let skies = (0..lights.len() as u32).filter(|l| !lights.is_delta(*l) && lights.light_sphere(*l).is_none());
        let points = u64::from(self.options.points) + lights.len() as u64;
        let all = points + skies.count() as u64 * u64::from(self.options.sky);
        let of_trees = all * (size_of::<PointLight>() + 2 * size_of::<Node>()) as u64;
        let patches = self.division.as_ref().map_or(0, Division::bytes);
        let cuts = 2 * u64::from(self.options.clusters) * all.min(u64::from(self.options.cut));
        of_trees + patches + cuts * size_of::<NodeId>() as u64
    }
}

impl CutLight<'_> {
    /// Returns the mean luminance estimated by cuts at a grid of first hits, and the number of rays traced.
    fn mean(&self, frame: &Frame) -> (f32, u64) {
        const SIDE: u32 = 16;
        let (mut sum, mut rays, mut made) = (0.0, u64::from(SIDE * SIDE), Refinement::default());
        for pixel in grid(frame, SIDE) {
            let cut = self.at_first_hit(pixel, |vertex| self.cut(&Lit::new(vertex, 0), &[], &mut made));
            if let Some(CutSum { light, rays: traced }) = cut {
                (sum, rays) = (sum + luminance(light), rays + u64::from(traced));
            }
        }
        (sum / (SIDE * SIDE) as f32, rays)
    }

    /// Evaluates a function at the first hit of a camera ray through a pixel. Returns `None` if the hit would not be lit by a
    /// cut.
    fn at_first_hit<T>(&self, pixel: [u32; 2], at: impl FnOnce(&GatherPoint<'_>) -> T) -> Option<T> {
        let (hit, direction) = first_hit(self.world, pixel)?;
        let (bsdf, frame) = self.world.scattering(&hit, || [0.5; 2])?;
        let (wo, back) = (frame.to_local(-direction), -direction);
        let vertex = GatherPoint { at: &hit, bsdf: &bsdf, frame: &frame, wo, back, depth: 0 };
        is_non_specular(&bsdf).then(|| at(&vertex))
    }
}
