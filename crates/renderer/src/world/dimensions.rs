//! The dimensions in which a path tracer's samples have a meaning.

use super::World;
use crate::blocks;
use dapple_core::Block;
use dapple_scene::Effect;
use std::ops::Range;

/// A group of random numbers, and its dimensions that have a meaning.
pub type Lanes = (Block, Range<u8>);

/// The dimensions in which the samples of the path tracer have a meaning.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleDimensions {
    /// The place in the pixel: two dimensions.
    pub place: Lanes,
    /// The point on the lens: two dimensions, or none without a lens.
    pub lens: Lanes,
    /// The time within the exposure: one dimension, or none if nothing moves.
    pub time: Lanes,
    /// The point on the light: two dimensions, or none unless there is one light with an extent.
    pub light: Lanes,
    /// The first use of other random numbers, as a noun phrase: light that scatters more than once, scattering in media, surfaces
    /// that rays may pass, the selection among lights, and directions towards lights with an extent.
    pub outside: Option<&'static str>,
}

impl World {
    /// Returns the dimensions in which the samples of the path tracer have a meaning. `None` for pixel filters other than a box of
    /// one pixel, since the place in the pixel is not a coordinate then.
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

    /// Returns the first use of random numbers beside these dimensions, as a noun phrase.
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
    use dapple_core::{Draws, Estimate, Frame, PointSet, SampleId, Worker, streams};
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

    fn dimensions(world: &World) -> SampleDimensions {
        world.sample_dimensions().unwrap_or_else(|| panic!("no dimensions"))
    }

    /// The numbers of dimensions of place, lens, time and light.
    fn numbers(world: &World) -> [usize; 4] {
        let SampleDimensions { place, lens, time, light, .. } = dimensions(world);
        [place, lens, time, light].map(|(_, lanes)| lanes.len())
    }

    fn world(scene: &Scene) -> World {
        World::with_resolution(scene, SIZE).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn dimensions_are_those_that_the_scene_uses() {
        assert_eq!(numbers(&world(&simple("lens"))), [2, 2, 0, 0]);
        assert_eq!(numbers(&world(&simple("motion"))), [2, 0, 1, 0]);
        let cornell = world(&scene("cornell"));
        assert_eq!(numbers(&cornell), [2, 0, 0, 2]);
        assert_eq!(dimensions(&cornell).outside, Some("light that scatters more than once"));
    }

    #[test]
    fn other_pixel_filters_have_no_dimensions() {
        let mut scene = scene("cornell");
        for radius in [[1.0, 1.0], [0.5, 0.25]] {
            scene.film.pixel_filter = PixelFilter::Box { radius };
            assert_eq!(world(&scene).sample_dimensions(), None);
        }
        scene.film.pixel_filter = PixelFilter::Triangle { radius: [0.5, 0.5] };
        assert_eq!(world(&scene).sample_dimensions(), None);
    }

    /// Random numbers of which those with a meaning do not depend on the seed.
    struct Outside(SampleDimensions, u64);

    impl PointSet for Outside {
        fn describe(&self) -> String {
            "outside".to_owned()
        }

        fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
            let Self(SampleDimensions { place, lens, time, light, .. }, seed) = self;
            let [fixed, free] = [1, *seed].map(|seed| Random::new(seed).block(id, block));
            let inside = |lane: u8| {
                [place, lens, time, light].iter().any(|(of, lanes)| of.number() == block && lanes.contains(&lane))
            };
            std::array::from_fn(|lane| if inside(lane as u8) { fixed[lane] } else { free[lane] })
        }

        fn capacity(&self) -> u64 {
            u64::MAX
        }
    }

    /// The share of samples whose radiance changes with the random numbers outside the dimensions.
    fn changed(world: &World) -> f64 {
        let dimensions = dimensions(world);
        let frame = Frame::new(SIZE[0], SIZE[1]).unwrap_or_else(|e| panic!("{e}"));
        let tracer = integrator(world);
        let mut changed = 0;
        let ids = (0..frame.pixels()).map(|i| SampleId::new(frame.pixel(i), streams::WHOLE, 0));
        for id in ids.clone() {
            let trace = |seed| -> Estimate {
                let points = Outside(dimensions.clone(), seed);
                tracer.estimate(&Draws::new(&points as &dyn PointSet, id), &mut Worker::default())
            };
            changed += usize::from(trace(2).radiance != trace(3).radiance);
        }
        changed as f64 / ids.len() as f64
    }

    #[test]
    fn random_numbers_outside_the_dimensions_change_samples_exactly_if_there_is_such_a_use() {
        for name in ["lens", "motion", "cornell", "plates", "terrain"] {
            let world = world(&simple(name));
            assert_eq!(dimensions(&world).outside, None, "{name}");
            assert_eq!(changed(&world), 0.0, "{name}");
        }
        for (name, outside) in [("cornell", "directions"), ("lens", "light that scatters"), ("glass", "light that")] {
            let mut scene = scene(name);
            if outside == "directions" {
                scene.max_depth = Some(1);
            }
            let world = world(&scene);
            let found = dimensions(&world).outside;
            assert!(found.is_some_and(|what| what.starts_with(outside)), "{name}: {found:?}");
            assert!(changed(&world) > 0.0, "{name}");
        }
    }
}
