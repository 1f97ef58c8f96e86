//! Effects that lights call for.

use super::{Effect, Effects};
use crate::description::light_power::LampShape;
use crate::{Geometry, Scene};

impl Effects {
    pub(super) fn add_lights(&mut self, scene: &Scene) {
        let mut sources = Vec::new();
        for shape in &scene.shapes {
            let Some(lamp) = LampShape::of(shape) else { continue };
            let because = || {
                let sides = if lamp.emission.two_sided { " from both sides" } else { "" };
                match &shape.geometry {
                    Geometry::Mesh(mesh) => format!("a mesh of {} triangles shines{sides}", mesh.triangles.len()),
                    Geometry::Sphere { .. } => format!("a sphere shines{sides}"),
                    Geometry::Disk { .. } => format!("a disk shines{sides}"),
                }
            };
            self.add(Effect::SoftShadows, because, &shape.source);
            sources.push(&shape.source);
        }
        for light in scene.lights.iter().filter(|l| l.kind.shines()) {
            if let Some(radiance) = light.kind.environment() {
                let because = || match radiance.image() {
                    Some(image) => format!("an image of {}x{} surrounds the scene", image.size[0], image.size[1]),
                    None => "the same light comes from everywhere".into(),
                };
                self.add(Effect::Environment, because, &light.source);
            }
            sources.push(&light.source);
        }
        if let Some(second) = sources.get(1) {
            self.add(Effect::SeveralLights, || format!("the second of {} lights", sources.len()), second);
            self.count(Effect::SeveralLights, sources.len());
        }
    }
}
