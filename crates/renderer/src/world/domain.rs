//! The dimensions in which a path tracer's samples have a meaning.

use super::World;
use crate::blocks;
use dapple_core::{Axis, Domain, Role};
use dapple_scene::Effect;

impl World {
    /// Returns the dimensions in which the samples of the path tracer have a meaning: the place in the pixel, the lens if the
    /// camera has one, the time if something moves, and the point on the light if there is one light with an extent.
    ///
    /// [`Domain::outside`] names the first use of other random numbers: light that scatters more than once, scattering in
    /// media, surfaces that rays may pass, the selection among lights, and directions towards lights with an extent.
    /// `None` for pixel filters other than a box of one pixel, since the place in the pixel is not a coordinate then.
    pub fn domain(&self) -> Option<Domain> {
        let axes = |role, block: dapple_core::Block, lanes: std::ops::Range<u8>| {
            lanes.map(move |lane| Axis::new(role, block.number(), lane))
        };
        let lens = if self.camera.has_lens() { 2..4 } else { 0..0 };
        let time = if self.moves { 0..1 } else { 0..0 };
        let light = if self.lights.len() == 1 && !self.lights.has_delta() { 0..2 } else { 0..0 };
        let all = axes(Role::Place, blocks::CAMERA, 0..2)
            .chain(axes(Role::Lens, blocks::CAMERA, lens))
            .chain(axes(Role::Time, blocks::TIME, time))
            .chain(axes(Role::Light, blocks::scatter(0), light));
        let domain = Domain::new(all).ok().filter(|_| self.filter.is_one_pixel())?;
        Some(match self.outside() {
            Some(what) => domain.with_outside(what),
            None => domain,
        })
    }

    /// Returns the first use of random numbers outside the domain, as a noun phrase.
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{integrator, without};
    use dapple_core::{Draws, Estimate, Frame, Placed, PointSet, SampleId, Worker, streams};
    use dapple_low_discrepancy::Random;
    use dapple_scene::{PixelFilter, Scene, bundled};

    const SIZE: [u32; 2] = [24, 16];

    fn scene(name: &str) -> Scene {
        let files = bundled::files(name).unwrap_or_else(|| panic!("no scene {name}"));
        let mut scene = files.read().unwrap_or_else(|e| panic!("{e}"));
        scene.film.pixel_filter = PixelFilter::default();
        scene
    }

    /// A scene whose light scatters once, from one point light.
    fn simple(name: &str) -> Scene {
        let mut scene = scene(name);
        scene.max_depth = Some(1);
        for effect in [Effect::Environment, Effect::SoftShadows, Effect::SeveralLights] {
            if dapple_scene::Effects::of(&scene).has(effect) {
                scene = without(&scene, effect).unwrap_or_else(|e| panic!("{e}"));
            }
        }
        scene
    }

    fn roles(world: &World) -> Vec<Role> {
        world.domain().map(|domain| domain.axes().iter().map(|axis| axis.role).collect()).unwrap_or_default()
    }

    fn world(scene: &Scene) -> World {
        World::with_resolution(scene, SIZE).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn a_domain_has_the_dimensions_that_the_scene_uses() {
        use Role::{Lens, Light, Place, Time};
        assert_eq!(roles(&world(&simple("lens"))), [Place, Place, Lens, Lens]);
        assert_eq!(roles(&world(&simple("motion"))), [Place, Place, Time]);
        let cornell = world(&scene("cornell"));
        assert_eq!(roles(&cornell), [Place, Place, Light, Light]);
        let outside = cornell.domain().and_then(|domain| domain.outside().map(str::to_owned));
        assert_eq!(outside.as_deref(), Some("light that scatters more than once"));
    }

    #[test]
    fn other_pixel_filters_have_no_domain() {
        let mut scene = scene("cornell");
        for radius in [[1.0, 1.0], [0.5, 0.25]] {
            scene.film.pixel_filter = PixelFilter::Box { radius };
            assert_eq!(world(&scene).domain(), None);
        }
        scene.film.pixel_filter = PixelFilter::Triangle { radius: [0.5, 0.5] };
        assert_eq!(world(&scene).domain(), None);
    }

    /// The share of samples whose radiance changes with the random numbers outside the domain.
    fn changed(world: &World) -> f64 {
        let domain = world.domain().unwrap_or_else(|| panic!("no domain"));
        let frame = Frame::new(SIZE[0], SIZE[1]).unwrap_or_else(|e| panic!("{e}"));
        let tracer = integrator(world);
        let mut changed = 0;
        let ids = (0..frame.pixels()).map(|i| SampleId::new(frame.pixel(i), streams::WHOLE, 0));
        for id in ids.clone() {
            let mut at = vec![0.0; domain.axes().len()];
            domain.read(&Random::new(1), id, &mut at);
            let trace = |seed| -> Estimate {
                let mut points = Placed::new(Random::new(seed), domain.clone());
                points.add(&frame, id, &at).unwrap_or_else(|e| panic!("{e}"));
                tracer.estimate(&Draws::new(&points as &dyn PointSet, id), &mut Worker::default())
            };
            changed += usize::from(trace(2).radiance != trace(3).radiance);
        }
        changed as f64 / ids.len() as f64
    }

    #[test]
    fn random_numbers_outside_the_domain_change_samples_exactly_if_it_says_so() {
        for name in ["lens", "motion", "cornell", "plates", "terrain"] {
            let world = world(&simple(name));
            assert_eq!(world.domain().and_then(|domain| domain.outside().map(str::to_owned)), None, "{name}");
            assert_eq!(changed(&world), 0.0, "{name}");
        }
        for (name, outside) in [("cornell", "directions"), ("lens", "light that scatters"), ("glass", "light that")] {
            let mut scene = scene(name);
            if outside == "directions" {
                scene.max_depth = Some(1);
            }
            let world = world(&scene);
            let found = world.domain().and_then(|domain| domain.outside().map(str::to_owned));
            assert!(found.as_ref().is_some_and(|what| what.starts_with(outside)), "{name}: {found:?}");
            assert!(changed(&world) > 0.0, "{name}");
        }
    }
}
