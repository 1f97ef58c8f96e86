//! What a scene calls for, and why.

use crate::scene::{Color, ConductorFresnel, EnvironmentRadiance, Geometry, LightKind, MaterialKind, Scene, Source};
use crate::shading::TrowbridgeReitz;
use std::fmt;

/// Something that a scene may call for, and that costs time where it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Effect {
    /// Lamps with an area: shadows with soft borders.
    SoftShadows,
    /// More than one light to choose among.
    SeveralLights,
    /// Rough metals and coats.
    Glossy,
    /// Smooth metals and coats.
    Mirror,
    /// Light that was scattered more than once.
    Interreflection,
    /// Reflectances that vary over a surface.
    Textures,
    /// Light from beyond the scene.
    Environment,
    /// A lens with an opening.
    DepthOfField,
}

impl Effect {
    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SoftShadows => "soft-shadows",
            Self::SeveralLights => "several-lights",
            Self::Glossy => "glossy",
            Self::Mirror => "mirror",
            Self::Interreflection => "interreflection",
            Self::Textures => "textures",
            Self::Environment => "environment",
            Self::DepthOfField => "depth-of-field",
        }
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An effect with what calls for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Called {
    /// The effect.
    pub effect: Effect,
    /// Why, as a short phrase.
    pub because: String,
    /// The first object that calls for it.
    pub source: Source,
}

/// The effects that a scene calls for, each once, with the first object that does.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Effects {
    called: Vec<Called>,
    max_depth: Option<u32>,
}

impl Effects {
    /// Walks the scene once.
    pub fn of(scene: &Scene) -> Self {
        let mut effects = Self { called: Vec::new(), max_depth: scene.max_depth };
        effects.add_lights(scene);
        effects.add_materials(scene);
        let camera = &scene.camera;
        if camera.lens_radius > 0.0 {
            let because = format!("the lens has radius {}", camera.lens_radius);
            effects.add(Effect::DepthOfField, because, &camera.source);
        }
        if scene.max_depth.is_none_or(|d| d > 1) && !scene.shapes.is_empty() {
            let because = match scene.max_depth {
                Some(depth) => format!("up to {depth} scattering events are asked for"),
                None => "paths of any length are asked for".into(),
            };
            let source = Source { line: 0, ..camera.source.clone() };
            effects.add(Effect::Interreflection, because, &source);
        }
        effects.called.sort_by_key(|c| c.effect);
        effects
    }

    /// Whether the scene calls for an effect.
    pub fn has(&self, effect: Effect) -> bool {
        self.called.iter().any(|c| c.effect == effect)
    }

    /// The effects in a fixed order, with their reasons.
    pub fn called(&self) -> &[Called] {
        &self.called
    }

    /// Most scattering events between camera and light; `None` is unlimited.
    pub fn max_depth(&self) -> Option<u32> {
        self.max_depth
    }

    fn add(&mut self, effect: Effect, because: String, source: &Source) {
        if !self.has(effect) {
            self.called.push(Called { effect, because, source: source.clone() });
        }
    }

    fn add_lights(&mut self, scene: &Scene) {
        let mut lights = 0;
        for shape in &scene.shapes {
            let Some(emission) = shape.emission.filter(|e| e.radiance.iter().any(|&x| x > 0.0)) else { continue };
            let what = match &shape.geometry {
                Geometry::Mesh(mesh) => format!("a mesh of {} triangles shines", mesh.triangles.len()),
                Geometry::Sphere { .. } => "a sphere shines".into(),
                Geometry::Disk { .. } => "a disk shines".into(),
            };
            let sides = if emission.two_sided { " from both sides" } else { "" };
            self.add(Effect::SoftShadows, format!("{what}{sides}"), &shape.source);
            lights += 1;
            if lights == 2 {
                self.add(Effect::SeveralLights, "a second light".into(), &shape.source);
            }
        }
        for light in &scene.lights {
            let LightKind::Infinite { radiance } = &light.kind else { continue };
            if is_black(radiance) {
                continue;
            }
            let because = match radiance {
                EnvironmentRadiance::LatLong { picture, .. } => {
                    format!("a picture of {}x{} surrounds the scene", picture.size[0], picture.size[1])
                }
                _ => "the same light comes from everywhere".into(),
            };
            self.add(Effect::Environment, because, &light.source);
            lights += 1;
            if lights == 2 {
                self.add(Effect::SeveralLights, "a second light".into(), &light.source);
            }
        }
    }

    fn add_materials(&mut self, scene: &Scene) {
        let mut used = vec![false; scene.materials.len()];
        for shape in &scene.shapes {
            if let Some(used) = used.get_mut(shape.material.0 as usize) {
                *used = true;
            }
        }
        for (material, _) in scene.materials.iter().zip(used).filter(|(_, used)| *used) {
            let (roughness, color, what) = match &material.kind {
                MaterialKind::Diffuse { reflectance } => (None, Some(*reflectance), "diffuse"),
                MaterialKind::Conductor { fresnel, roughness } => {
                    let color = match fresnel {
                        ConductorFresnel::Reflectance(color) => Some(*color),
                        ConductorFresnel::EtaK { .. } => None,
                    };
                    (Some(roughness), color, "a metal")
                }
                MaterialKind::CoatedDiffuse { reflectance, roughness, .. } => {
                    (Some(roughness), Some(*reflectance), "coated")
                }
                _ => continue,
            };
            let name = &material.name;
            if let Some(Color::Texture(id)) = color {
                let texture = scene.textures.get(id.0 as usize).map_or("?", |t| &t.name);
                let because = format!("material \"{name}\" uses texture \"{texture}\"");
                self.add(Effect::Textures, because, &material.source);
            }
            if let Some(roughness) = roughness {
                let alpha = roughness.constants().unwrap_or([1.0; 2]).map(|r| match roughness.remap {
                    true => TrowbridgeReitz::roughness_to_alpha(r),
                    false => r,
                });
                let smooth = TrowbridgeReitz::effectively_smooth(alpha);
                let effect = if smooth { Effect::Mirror } else { Effect::Glossy };
                let because = format!("material \"{name}\" is {what} with alpha {}, {}", alpha[0], alpha[1]);
                self.add(effect, because, &material.source);
            }
        }
    }
}

/// Whether an environment gives no light, so that the world leaves it out.
fn is_black(radiance: &EnvironmentRadiance) -> bool {
    match radiance {
        EnvironmentRadiance::Constant(rgb) => *rgb == [0.0; 3],
        EnvironmentRadiance::LatLong { picture, scale } | EnvironmentRadiance::EqualArea { picture, scale } => {
            *scale == 0.0 || picture.pixels.iter().all(|p| *p == [0.0; 3])
        }
    }
}
