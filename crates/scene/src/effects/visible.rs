//! The visible part of a scene: objects that can affect its image.

use crate::{Instance, Material, MaterialId, MaterialKind, Medium, MediumId, Scalar, Scene, Shape};

/// The shapes, instances, materials and media of a scene that can affect its image.
pub(super) struct Visible<'s> {
    pub(super) scene: &'s Scene,
    /// Shapes placed in the world, directly or through an instance, each once.
    pub(super) shapes: Vec<&'s Shape>,
    /// Instances of objects that have shapes.
    pub(super) instances: Vec<&'s Instance>,
    /// True for each material that a visible shape uses, directly or in a mix. Indexed by material.
    materials: Vec<bool>,
    /// True for each medium that borders on a visible shape or surrounds the camera. Indexed by medium.
    media: Vec<bool>,
}

impl<'s> Visible<'s> {
    pub(super) fn of(scene: &'s Scene) -> Self {
        let object = |i: &Instance| scene.objects.get(i.object.0 as usize);
        let instances: Vec<_> =
            scene.instances.iter().filter(|i| object(i).is_some_and(|o| !o.shapes.is_empty())).collect();
        let mut stands = vec![false; scene.objects.len()];
        for instance in &instances {
            stands[instance.object.0 as usize] = true;
        }
        let objects = scene.objects.iter().zip(stands).filter_map(|(object, stands)| stands.then_some(object));
        let shapes: Vec<_> = scene.shapes.iter().chain(objects.flat_map(|o| &o.shapes)).collect();
        let mut visible = Self {
            scene,
            shapes,
            instances,
            materials: vec![false; scene.materials.len()],
            media: vec![false; scene.media.len()],
        };
        for i in 0..visible.shapes.len() {
            let shape = visible.shapes[i];
            visible.wear(shape.material);
            let sides = shape.media.map(|m| [m.inside, m.outside]);
            sides.into_iter().flatten().flatten().for_each(|m| visible.border(m));
        }
        scene.camera.medium.into_iter().for_each(|m| visible.border(m));
        visible
    }

    /// Returns the materials that a visible shape uses.
    pub(super) fn materials(&self) -> impl Iterator<Item = &'s Material> {
        self.scene.materials.iter().zip(&self.materials).filter_map(|(material, worn)| worn.then_some(material))
    }

    /// Returns the media that border on a visible shape or surround the camera.
    pub(super) fn media(&self) -> impl Iterator<Item = &'s Medium> {
        self.scene.media.iter().zip(&self.media).filter_map(|(medium, used)| used.then_some(medium))
    }

    fn border(&mut self, medium: MediumId) {
        if let Some(visible) = self.media.get_mut(medium.0 as usize) {
            *visible = true;
        }
    }

    /// Marks a material and the materials that it mixes as visible. Skips marked materials, so that circular mixes end.
    fn wear(&mut self, first: MaterialId) {
        let mut waiting = vec![first];
        while let Some(id) = waiting.pop() {
            match self.materials.get_mut(id.0 as usize) {
                Some(visible) if !*visible => *visible = true,
                _ => continue,
            }
            if let MaterialKind::Mix { materials, amount } = &self.scene.materials[id.0 as usize].kind {
                waiting.extend(mixed(materials, *amount));
            }
        }
    }
}

/// Returns the materials of a mix whose weight is above 0: one or both.
fn mixed(materials: &[MaterialId; 2], amount: Scalar) -> impl Iterator<Item = MaterialId> {
    let [without_first, without_second] = match amount {
        Scalar::Constant(amount) => [amount >= 1.0, amount <= 0.0],
        Scalar::Texture(_) => [false; 2],
    };
    let [first, second] = *materials;
    (!without_first).then_some(first).into_iter().chain((!without_second).then_some(second))
}
