//! Lights of pbrt scenes, and the emission of shapes.

use super::directive::Directive;
use super::images::{Channel, Decoding};
use super::legacy::light_scale;
use super::params::{Params, Type};
use super::reader::{AreaLight, Reader};
use super::spectra::Gamut;
use super::tokens::shown;
use super::version::Version;
use crate::image::Image;
use crate::{Color, EnvironmentRadiance, Light, LightKind, SpotFalloff, TextureId, TextureKind, Wrap};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

impl Reader<'_> {
    /// Executes `AreaLightSource`: later shapes emit light.
    pub(super) fn set_area_light(&mut self, mut d: Directive<'_>) {
        self.lights_met += 1;
        let mut params = self.params(&mut d, "light");
        let line = d.source.line;
        let old = self.context.version.is_old();
        if !(d.texts[0] == "diffuse" || old && d.texts[0] == "area") {
            params.unsupported_type(line, "AreaLightSource", &d.texts[0], &["diffuse"]);
            params.finish(&mut self.log);
            return;
        }
        let has_color = params.has("L");
        let radiance = color(&mut params, "L");
        let two_sided = params.flag("twosided", false);
        let file = if old { None } else { params.text("filename") };
        if old {
            params.ignore(&["nsamples", "samples"]);
        }
        let power = positive(&mut params, "power");
        let mut texture = None;
        if let Some((file, line)) = file {
            if has_color {
                params.problem(line, format!("{} has both L and filename; remove one", params.of));
            }
            if power.is_some() {
                params.unsupported(line, "parameter power of an area light with an image (use scale)");
            }
            texture = self.shining_image(&file, line, &mut params);
        }
        if params.finish(&mut self.log) {
            self.state.emission = Some(AreaLight { radiance, two_sided, power, texture });
        }
    }

    /// Adds the image of an area light as a texture. `None`, with a reported problem, if it cannot be read.
    fn shining_image(&mut self, file: &str, line: u32, params: &mut Params) -> Option<TextureId> {
        let Some(image) = self.image(file, (Decoding::Srgb, Channel::Rgb), &params.at(line)) else {
            params.broken = true;
            return None;
        };
        let (scale, shift) = ([1.0; 2], [0.0; 2]);
        let kind = TextureKind::Image { image, scale, shift, factor: 1.0, invert: false, wrap: Wrap::Clamp };
        match self.add_texture(file, kind, params) {
            Color::Texture(id) => Some(id),
            Color::Constant(_) => None,
        }
    }

    /// Executes `LightSource`: adds a light to the scene.
    pub(super) fn add_light(&mut self, mut d: Directive<'_>) {
        self.lights_met += 1;
        let mut params = self.params(&mut d, "light");
        if self.context.version.is_old() {
            params.ignore(&["nsamples", "samples"]);
        }
        let made = match d.texts[0].as_str() {
            "infinite" => self.infinite(&mut params),
            "point" => Some(Self::point(&mut params)),
            "spot" => self.spot(&mut params),
            "distant" => Self::distant(&mut params),
            kind => {
                params.unsupported_type(d.source.line, "LightSource", kind, &["infinite", "point", "spot", "distant"]);
                None
            }
        };
        if self.state.ctm.moves_to().is_some() {
            let what = format!("{} does not move; it stays where the motion starts, as in pbrt", params.of);
            params.notice(d.source.line, what);
        }
        if params.finish(&mut self.log)
            && let Some((kind, to_light)) = made
        {
            self.scene.lights.push(Light { kind, to_world: self.state.ctm.start * to_light, source: d.source });
        }
    }

    fn point(params: &mut Params) -> (LightKind, DAffine3) {
        let mut intensity = color(params, "I");
        if let Some(power) = positive(params, "power") {
            intensity = brighter(intensity, power / (4.0 * PI), params);
        }
        (LightKind::Point { intensity }, DAffine3::from_translation(point(params, "from", DVec3::ZERO)))
    }

    fn spot(&self, params: &mut Params) -> Option<(LightKind, DAffine3)> {
        let mut intensity = color(params, "I");
        let cone = params.float32("coneangle", 30.0, |v| v > 0.0 && v <= 180.0, "above 0 and at most 180 degrees");
        let within = |v: f64| v >= 0.0 && v <= f64::from(cone);
        let delta = params.float32("conedeltaangle", 5.0f32.min(cone), within, "at least 0 and at most coneangle");
        if let Some(power) = positive(params, "power") {
            let [edge, start] = [cone, cone - delta].map(|angle| f64::from(angle).to_radians().cos());
            // The solid angle of the cone; the part within the falloff counts half.
            let filled = TAU * ((1.0 - start) + (start - edge) / 2.0);
            intensity = brighter(intensity, power / filled, params);
        }
        let falloff = if self.context.version.is_old() { SpotFalloff::Quartic } else { SpotFalloff::Smoothstep };
        let (from, frame) = pose(params, 1.0)?;
        let kind = LightKind::Spot { intensity, cone, falloff_start: cone - delta, falloff };
        Some((kind, DAffine3::from_mat3_translation(frame, from)))
    }

    fn distant(params: &mut Params) -> Option<(LightKind, DAffine3)> {
        let mut irradiance = color(params, "L");
        if let Some(illuminance) = positive(params, "illuminance") {
            irradiance = brighter(irradiance, illuminance, params);
        }
        let (_, frame) = pose(params, -1.0)?;
        Some((LightKind::Distant { irradiance }, DAffine3::from_mat3(frame)))
    }

    fn infinite(&mut self, params: &mut Params) -> Option<(LightKind, DAffine3)> {
        params.refuse(&["portal"]);
        let old = self.context.version.is_old();
        let constant = params.has("L").then(|| params.rgb("L", Gamut::Light).unwrap_or([1.0; 3]));
        let illuminance = positive(params, "illuminance");
        let file = params.text(if old { "mapname" } else { "filename" });
        let tint = scaled(constant.unwrap_or([1.0; 3]), params);
        let radiance = match (file, illuminance) {
            (Some((_, line)), _) if constant.is_some() && !old => {
                return params.fail(line, format!("{} has both L and filename; remove one", params.of));
            }
            (Some((file, line)), _) => self.environment((&file, line), tint, illuminance, params)?,
            (None, Some(illuminance)) => EnvironmentRadiance::Constant(brighter(tint, illuminance / PI, params)),
            (None, None) => EnvironmentRadiance::Constant(tint),
        };
        Some((LightKind::Infinite { radiance }, DAffine3::IDENTITY))
    }

    /// Makes the radiance of an environment map, multiplied by `tint` and scaled to `illuminance` if given. `None`,
    /// with a reported problem, if the image is unusable.
    fn environment(
        &mut self,
        (file, line): (&str, u32),
        tint: [f32; 3],
        illuminance: Option<f64>,
        params: &mut Params,
    ) -> Option<EnvironmentRadiance> {
        // pbrt-v2 decodes integers without the sRGB curve.
        let decoding = if self.context.version == Version::V2 { Decoding::Linear } else { Decoding::Srgb };
        let Some(mut image) = self.image(file, (decoding, Channel::Rgb), &params.at(line)) else {
            params.broken = true;
            return None;
        };
        let mut scale = tint[0];
        if tint != [scale; 3] {
            let pixels = image.pixels.iter().map(|p| std::array::from_fn(|i| p[i] * tint[i])).collect();
            image = Arc::new(Image { pixels, ..(*image).clone() });
            scale = 1.0;
        }
        // Older versions have only the latitude-longitude layout.
        let equal_area = image.size[0] == image.size[1] && !self.context.version.is_old();
        if let Some(wanted) = illuminance {
            let mut found = illuminance_of(&image, equal_area);
            if equal_area {
                // pbrt-v4 weights the square as half a sphere (lights.cpp, the image branch of `infinite`).
                found *= 0.5;
                let what = "pbrt-v4 halves the illuminance that it computes for a square image, so that the light is \
                            twice as bright as illuminance states; this reader does the same";
                params.notice(line, what);
            }
            if found <= 0.0 || !found.is_finite() {
                let what = "has no light from above, so that illuminance cannot be reached; remove illuminance";
                return params.fail(line, format!("{} {what}", shown(file)));
            }
            scale = brighter([scale; 3], wanted / found, params)[0];
        }
        let bad = image.pixels.iter().position(|p| p.iter().any(|&c| !(0.0..f32::INFINITY).contains(&(c * scale))));
        if let Some(at) = bad {
            let (x, y) = (at as u32 % image.size[0], at as u32 / image.size[0]);
            let what = format!("pixel {x}, {y} of {} is negative or not finite; repair the image", shown(file));
            return params.fail(line, what);
        }
        Some(match equal_area {
            true => EnvironmentRadiance::EqualArea { image, scale },
            false => EnvironmentRadiance::LatLong { image, scale },
        })
    }
}

/// Takes a number parameter of pbrt-v4. `None` if it is missing or not above 0: pbrt ignores such values, too.
fn positive(params: &mut Params, name: &'static str) -> Option<f64> {
    if params.context.version.is_old() {
        return None;
    }
    let given = params.has(name);
    let value = params.float(name, 0.0, |_| true, "finite");
    (given && value > 0.0).then_some(value)
}

/// Takes a light's colour, white by default, times the light's parameter `scale`.
fn color(params: &mut Params, name: &'static str) -> [f32; 3] {
    let color = params.rgb(name, Gamut::Light).unwrap_or([1.0; 3]);
    scaled(color, params)
}

/// Returns a light's colour times the light's parameter `scale`.
fn scaled(color: [f32; 3], params: &mut Params) -> [f32; 3] {
    if params.context.version.is_old() {
        let scale = light_scale(params);
        return finite(std::array::from_fn(|i| color[i] * scale[i]), params);
    }
    let largest = color.iter().fold(0.0f32, |a, &b| a.max(b));
    let ok = |v: f64| v >= 0.0 && (largest * v as f32).is_finite();
    let scale = params.float32("scale", 1.0, ok, "at least 0, and its product with L below 3.4e38");
    color.map(|c| c * scale)
}

fn brighter(color: [f32; 3], by: f64, params: &mut Params) -> [f32; 3] {
    finite(color.map(|c| (f64::from(c) * by) as f32), params)
}

fn finite(color: [f32; 3], params: &mut Params) -> [f32; 3] {
    if color.iter().all(|c| c.is_finite()) {
        return color;
    }
    params.problem(params.line(), format!("{} is brighter than 3.4e38; lower its scale or power", params.of));
    [0.0; 3]
}

fn point(params: &mut Params, name: &'static str, default: DVec3) -> DVec3 {
    params.array::<3>(name, Type::Point3).map_or(default, |(p, _)| DVec3::from_array(p))
}

/// Takes the parameters `from` and `to`. Returns `from`, and orthonormal axes whose z points from there to `to`, times
/// `sign`. `None`, with a reported problem, if both are the same.
fn pose(params: &mut Params, sign: f64) -> Option<(DVec3, DMat3)> {
    let (from, to) = (point(params, "from", DVec3::ZERO), point(params, "to", DVec3::Z));
    let direction = (to - from) * sign;
    let Some(z) = (direction / direction.abs().max_element()).try_normalize() else {
        return params.fail(params.line(), format!("parameters from and to of {} must differ", params.of));
    };
    let (x, y) = z.any_orthonormal_pair();
    Some((from, DMat3::from_cols(x, y, z)))
}

/// Returns the illuminance of an upward surface under the upper half (z > 0) of an environment map: the integral of
/// luminance times cosine. `equal_area` is the layout of the image: equal-area square if true, else latitude-longitude.
fn illuminance_of(image: &Image, equal_area: bool) -> f64 {
    let [width, height] = image.size.map(f64::from);
    let luminance = |p: &[f32; 3]| {
        let [r, g, b] = p.map(f64::from);
        0.212_639 * r + 0.715_169 * g + 0.072_192 * b
    };
    let columns = image.size[0] as usize;
    let mut sum = 0.0;
    for (y, row) in image.pixels.chunks(columns).enumerate() {
        let v = (y as f64 + 0.5) / height;
        if equal_area {
            let weight = 4.0 * PI / (width * height);
            for (x, pixel) in row.iter().enumerate() {
                let z = height_of((x as f64 + 0.5) / width, v);
                if z > 0.0 {
                    sum += luminance(pixel) * z * weight;
                }
            }
        } else {
            let (sin, cos) = (PI * v).sin_cos();
            if cos > 0.0 {
                let weight = sin * cos * (PI / height) * (TAU / width);
                sum += row.iter().map(luminance).sum::<f64>() * weight;
            }
        }
    }
    sum
}

/// Returns z of the unit direction at the point (u, v) of the equal-area square [Clarberg 2008].
fn height_of(u: f64, v: f64) -> f64 {
    let inward = 1.0 - (2.0 * u - 1.0).abs() - (2.0 * v - 1.0).abs();
    let r = 1.0 - inward.abs();
    (1.0 - r * r).copysign(inward)
}
