//! The subcommand `dapple info SCENE`.

use crate::output::{tell, warn};
use crate::{Failure, Outcome, Result, failure};
use dapple_job::memory::{MemoryEstimate, size};
use dapple_job::{JobError, LoadOptions, LoadedScene, OutputFiles, PreparedScene, RenderSpec, Warning, pixel_filter};
use dapple_renderer::World;
use dapple_scene::Scene;
use dapple_scene::bundled;
use dapple_scene::image::{ExrPart, ImageInfo, Window, image_info, is_image};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Print the contents of a scene, the effects that it uses and the estimated memory of a render; or the properties of an image
///
/// For images, prints size, channels and bits per value; for EXR files also parts, views, windows, chromaticities,
/// compression and layers.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  dapple info scene.pbrt\n  dapple info model.obj\n  dapple info image.exr\n  dapple info terrain"
)]
pub(crate) struct InfoArgs {
    /// A pbrt file (v4, v3 or v2), a model (.gltf, .glb, .obj, .ply, .stl), or a bundled scene: teapot, terrain, cornell, furnace, plates, lens,
    /// motion, glass, room, grass, door, tea, cabin, many-lights, caustic, chess, zone-plate, penumbra; or an image
    /// (.exr, .png, .jpg, .tga, .hdr, .pfm)
    #[arg(value_name = "SCENE", default_value = bundled::DEFAULT)]
    scene: PathBuf,
    /// Ignore unsupported scene features with a warning instead of stopping
    #[arg(long)]
    allow_unsupported: bool,
}

pub(crate) fn run(args: &InfoArgs) -> Result<Outcome> {
    if let Some(info) = image(&args.scene)? {
        facts_of_image(&info).into_iter().try_for_each(tell)?;
        return Ok(Outcome::Done);
    }
    let spec = RenderSpec { allow_unsupported: args.allow_unsupported, ..RenderSpec::new(&args.scene) };
    let loaded = LoadedScene::read(&spec, &LoadOptions { digest: false, ..LoadOptions::default() });
    let prepared = loaded.and_then(LoadedScene::build)?;
    for warning in prepared.loaded.warnings.iter().filter(|warning| matches!(warning, Warning::Notice(_))) {
        warn(failure::warning(warning));
    }
    for (name, what) in facts(&prepared.loaded.scene, &prepared.world) {
        tell(format!("{name:<12}{what}"))?;
    }
    let memory = match memory(&spec, &prepared) {
        Ok(estimate) => format!("a render with default options takes {estimate}"),
        Err(error) => format!("a render with default options fails: {}", failure::of_job(&error).0.join("; ")),
    };
    tell(format!("{:<12}{memory}", "memory"))?;
    let effects = prepared.world.effects();
    tell(format!("{:<12}{}", "effects", effects.called().len()))?;
    for called in effects.called() {
        tell(format!("  {:<18}{} ({})", called.effect.name(), called.because, called.source))?;
    }
    Ok(Outcome::Done)
}

/// The properties of an image file; `None` for any other file.
fn image(path: &Path) -> Result<Option<ImageInfo>> {
    let Ok(mut file) = File::open(path) else { return Ok(None) };
    let (name, mut bytes) = (path.display().to_string(), vec![0; 16]);
    let start = file.read(&mut bytes).unwrap_or_default();
    bytes.truncate(start);
    if !is_image(&bytes, &name) {
        return Ok(None);
    }
    file.read_to_end(&mut bytes).map_err(|e| Failure::new(format!("{name}: cannot read the file: {e}")))?;
    image_info(&bytes, &name).map(Some).map_err(Failure::new)
}

fn facts_of_image(info: &ImageInfo) -> Vec<String> {
    let parts = match info {
        ImageInfo::Flat { format, size: [w, h], channels, values } => {
            let facts = [("image", format!("{format}, {w}x{h}")), ("channels", format!("{channels} ({values})"))];
            return facts.map(|(name, what)| format!("{name:<12}{what}")).into();
        }
        ImageInfo::Exr(parts) => parts,
    };
    let first = [("image", "OpenEXR".to_owned()), ("parts", parts.len().to_string())];
    let mut lines: Vec<String> = first.map(|(name, what)| format!("{name:<12}{what}")).into();
    for (index, part) in parts.iter().enumerate() {
        if parts.len() > 1 {
            lines.push(format!("part {index}      \"{}\"", part.name));
        }
        lines.extend(facts_of_part(part).map(|(name, what)| format!("{name:<12}{what}")));
    }
    lines
}

fn facts_of_part(part: &ExrPart) -> impl Iterator<Item = (&'static str, String)> + use<> {
    let Window { size: [w, h], .. } = part.data_window;
    let views = part.view.iter().chain(&part.views).map(String::as_str).collect::<Vec<_>>().join(", ");
    let space = part.chromaticities.map(|space| space.to_string());
    let tiles = part.tiles.map_or_else(|| "scan lines".to_owned(), |[w, h]| format!("tiles of {w}x{h}"));
    let levels = if part.levels { ", with smaller versions" } else { "" };
    let facts = [
        ("views", views),
        ("size", format!("{w}x{h}")),
        ("data", part.data_window.to_string()),
        ("display", part.display_window.to_string()),
        ("aspect", format!("{} (width of a pixel divided by its height)", part.pixel_aspect)),
        ("colours", space.unwrap_or_else(|| "Rec. 709 (the file states no chromaticities)".to_owned())),
        ("compression", format!("{}, {tiles}{levels}", part.compression)),
    ];
    let mut layers: Vec<(&str, &str, Vec<&str>)> = Vec::new();
    for channel in &part.channels {
        let (layer, letter) = channel.name.rsplit_once('.').unwrap_or(("", &channel.name));
        match layers.iter_mut().find(|(name, values, _)| *name == layer && *values == channel.values) {
            Some((.., letters)) => letters.push(letter),
            None => layers.push((layer, channel.values, vec![letter])),
        }
    }
    let layers = layers.into_iter().map(|(layer, values, letters)| {
        let layer = if layer.is_empty() { String::new() } else { format!("{layer}: ") };
        ("channels", format!("{layer}{} ({values})", letters.join(", ")))
    });
    let layers: Vec<_> = layers.collect();
    facts.into_iter().filter(|(_, what)| !what.is_empty()).chain(layers)
}

/// The memory estimate of a render with the default arguments.
fn memory(spec: &RenderSpec, prepared: &PreparedScene) -> std::result::Result<MemoryEstimate, JobError> {
    let mut job = prepared.job(spec)?;
    job.set_outputs(OutputFiles::defaults(&prepared.loaded.scene.name, &spec.sampler));
    Ok(job.memory(false))
}

fn facts(scene: &Scene, world: &World) -> Vec<(&'static str, String)> {
    let ([w, h], spp) = (scene.film.resolution, scene.film.spp);
    let geometry = world.geometry();
    let depth = scene.max_depth.map_or("unlimited".into(), |d| d.to_string());
    let triangles = match world.dropped_triangles() {
        0 => geometry.triangle_count().to_string(),
        dropped => format!("{} ({dropped} more have no area and are left out)", geometry.triangle_count()),
    };
    vec![
        ("scene", scene.name.clone()),
        ("image", format!("{w}x{h}, {}, {}", crop(scene), pixel_filter(&scene.film.pixel_filter))),
        ("spp", spp.map_or("the file states none".into(), |n| format!("the file states {n}; --spp overrides it"))),
        ("max depth", depth),
        ("triangles", triangles),
        ("shapes", count(scene.shapes.iter().map(|shape| shape.geometry.name()))),
        ("materials", count(scene.materials.iter().map(|material| material.kind.name()))),
        ("textures", scene.textures.len().to_string()),
        ("lights", lights(scene)),
        ("bounds", bounds(world)),
        ("geometry", format!("{} in memory", size(geometry.memory_bytes() as u64))),
    ]
}

fn crop(scene: &Scene) -> String {
    match scene.film.crop {
        Some([x0, y0, x1, y1]) => format!("crop {x0},{y0},{x1},{y1}"),
        None => "whole".into(),
    }
}

/// Formats the number of objects and of each kind, such as `3 (2 diffuse, 1 metal)`, with kinds in the order of first
/// occurrence.
fn count(kinds: impl Iterator<Item = &'static str>) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    let mut all = 0;
    for kind in kinds {
        all += 1;
        match counts.iter_mut().find(|c| c.0 == kind) {
            Some(c) => c.1 += 1,
            None => counts.push((kind, 1)),
        }
    }
    let each: Vec<String> = counts.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
    if each.is_empty() { "0".into() } else { format!("{all} ({})", each.join(", ")) }
}

fn lights(scene: &Scene) -> String {
    let shining = scene.shapes.iter().filter(|s| s.emission.is_some()).map(|_| "area");
    let others = scene.lights.iter().map(|light| light.kind.name());
    count(shining.chain(others))
}

/// Formats the corners of the scene's bounding box, in the scene file's units.
fn bounds(world: &World) -> String {
    let Some([low, high]) = world.geometry().bounds() else { return "nothing".into() };
    let corner = |p: [f32; 3]| {
        let [x, y, z] = world.space().world(p);
        format!("({x:.4}, {y:.4}, {z:.4})")
    };
    format!("{} to {}", corner(low.to_array()), corner(high.to_array()))
}
