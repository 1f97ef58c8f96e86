//! Directives of materials.

use super::directive::Directive;
use super::legacy::{OLD_MATERIALS, old_material};
use super::materials::{Mixes, NEW_MATERIALS, default_kind, new_material};
use super::params::Params;
use super::reader::{MaterialRef, Reader};
use super::tokens::shown;
use crate::{Color, Material, MaterialId, MaterialKind, Scalar, TextureKind};

impl Reader<'_> {
    /// Executes `Material`: makes the current material.
    pub(super) fn set_material(&mut self, mut d: Directive<'_>) {
        let params = self.params(&mut d, "material");
        let name = format!("material {}", self.scene.materials.len());
        let (material, mixes) = self.make_material(name, (&d.texts[0], d.source.line), params);
        let id = self.scene.add_material(material);
        self.settle_mix(id, mixes);
        self.state.material = MaterialRef::Made(id);
    }

    /// Executes `MakeNamedMaterial`: defines a named material.
    pub(super) fn make_named_material(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "material");
        let name = d.texts.swap_remove(0);
        let kind = params.text("type").or_else(|| params.lacks("its type; add \"string type\" \"diffuse\""));
        if let Some(first) = self.named_materials.get(&name) {
            let first = &self.scene.materials[first].source;
            let what = |how| format!("material {} is {how} (first at {first})", shown(&name));
            match self.context.version.is_old() {
                true => params.notice(d.source.line, what("redefined")),
                false => params.problem(d.source.line, what("defined twice") + "; rename one"),
            }
        }
        let (kind, line) = kind.unwrap_or(("diffuse".into(), d.source.line));
        let (material, mixes) = self.make_material(name.clone(), (&kind, line), params);
        let id = MaterialId(self.named_materials.define(&name, material, &mut self.scene.materials) as u32);
        self.settle_mix(id, mixes);
    }

    /// Makes a material of type `kind`; after an error a placeholder, so that reading can continue. Also returns the names
    /// of the materials that it mixes, if it is a mix.
    fn make_material(&mut self, name: String, kind: (&str, u32), mut params: Params) -> (Material, Mixes) {
        let ((kind, line), old) = (kind, self.context.version.is_old());
        let shades = !matches!(kind, "mix" | "interface" | "none" | "");
        let bump_name = if old { "bumpmap" } else { "displacement" };
        let bump = (shades && params.has(bump_name))
            .then(|| params.scalar(bump_name, 0.0, |_| true, "finite"))
            // A constant height tilts no normals.
            .filter(|bump| matches!(bump, Scalar::Texture(_)));
        let normal_map = if shades && !old { self.normal_map(&mut params) } else { None };
        if let (Some(_), Some(_)) = (bump, normal_map) {
            params.problem(line, format!("{} has both displacement and normalmap; remove one", params.of));
        }
        let made = match kind {
            "diffusetransmission" if !old => Some(self.diffuse_transmission(&mut params).into()),
            _ if old => old_material(kind, &mut params),
            _ => new_material(kind, &mut params),
        };
        let made = made.unwrap_or_else(|| {
            let known: Vec<&str> = if old { OLD_MATERIALS } else { NEW_MATERIALS }.split(' ').chain(["mix"]).collect();
            params.unsupported_type(line, "Material", kind, &known);
            default_kind().into()
        });
        let material = Material { bump, normal_map, ..Material::new(name, made.kind, params.source.clone()) };
        params.finish(&mut self.log);
        (material, made.mixes)
    }

    /// Sets the materials of a mix by their names.
    fn settle_mix(&mut self, mix: MaterialId, names: Mixes) {
        let Some(names) = names else { return };
        let source = self.scene.materials[mix.0 as usize].source.clone();
        let found = names.map(|name| self.material_named(&name, &source));
        if let MaterialKind::Mix { materials, .. } = &mut self.scene.materials[mix.0 as usize].kind {
            *materials = found;
        }
    }

    fn diffuse_transmission(&mut self, params: &mut Params) -> MaterialKind {
        let given = ["reflectance", "transmittance"].map(|name| params.color(name, [0.25; 3]));
        let scale = params.float32("scale", 1.0, |v| v >= 0.0, "at least 0");
        let [reflectance, transmittance] = given.map(|color| match color {
            Color::Constant(c) => Color::Constant(c.map(|c| c * scale)),
            color if scale == 1.0 => color,
            color => {
                let factors = [color, Color::Constant([scale; 3])];
                self.add_texture("scaled", TextureKind::Product { factors }, params)
            }
        });
        if let (Color::Constant(r), Color::Constant(t)) = (reflectance, transmittance) {
            if r.iter().chain(&t).any(|&c| c > 1.0) {
                let what = format!("{}: reflectance and transmittance, scaled, must not be above 1", params.of);
                params.problem(params.line(), what);
            } else if (0..3).any(|i| r[i] + t[i] > 1.0) {
                let what = format!("{} creates light: the sum of reflectance and transmittance is above 1", params.of);
                params.notice(params.line(), what);
            }
        }
        MaterialKind::DiffuseTransmission { reflectance, transmittance }
    }
}
