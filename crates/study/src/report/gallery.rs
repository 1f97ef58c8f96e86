//! Images of the report: crops of renders and references, error maps and sample maps. All are PNG files embedded in the
//! page.

use super::colour_scale::{error_colour, sample_colour};
use crate::file_names::safe_file_name;
use crate::record::{Run, RunBudget, SceneRecord};
use crate::recorded_study::RecordedStudy;
use base64::Engine;
use dapple_metrics::{Pixels, downsample};
use dapple_scene::image::{Encoding, Image, encode_png, encode_png_rgb, read_image};
use std::path::Path;

/// The largest total size of all images in the page, in bytes.
const ROOM: f64 = 3.5e6;

/// The largest total size of the viewer's whole images in the page, in bytes.
const WHOLE_ROOM: f64 = 1.1e6;

/// A PNG image embedded in the page, as a data URI with its size in pixels.
pub(super) struct Embedded {
    pub(super) uri: String,
    pub(super) size: [u32; 2],
}

/// A rectangle of an image in pixels: left, top, width and height.
pub(super) type Crop = [u32; 4];

/// The report's images of one method on one scene.
pub(super) struct MethodImages {
    /// The method's index in the manifest.
    pub(super) method: usize,
    /// The method's image, cut to each of [`Gallery::crops`]; empty if the study has no image.
    pub(super) crops: Vec<Embedded>,
    pub(super) error_map: Option<Embedded>,
    pub(super) sample_map: Option<Embedded>,
    /// The files of the image and of the sample map, relative to the study's folder.
    pub(super) files: [Option<String>; 2],
}

/// A whole image of the viewer.
pub(super) struct Whole {
    /// The method's index in the manifest; `None` for the reference.
    pub(super) method: Option<usize>,
    pub(super) image: Embedded,
    /// The file with the full resolution, relative to the study's folder; `None` if the embedded image has it.
    pub(super) file: Option<String>,
}

/// The report's images of one scene.
pub(super) struct Gallery {
    pub(super) budget: Option<RunBudget>,
    /// The exposure in stops that is applied to all images of the scene.
    pub(super) exposure_stops: f32,
    pub(super) overview: Option<Embedded>,
    /// The crop in which the methods' errors differ most, then the crop with the median difference.
    pub(super) crops: Vec<Crop>,
    pub(super) reference_crops: Vec<Embedded>,
    pub(super) tiles: Vec<MethodImages>,
    /// The whole images of the methods that have one, then the reference; empty without a method's image.
    pub(super) whole: Vec<Whole>,
    /// PNG files at full resolution for the viewer: paths relative to the study's folder, and contents.
    pub(super) files: Vec<(String, Vec<u8>)>,
    /// Width and height of the whole images in pixels.
    pub(super) size: [u32; 2],
    /// The largest number of samples per pixel over all sample maps of the scene; `None` without maps.
    pub(super) most: Option<f64>,
    /// One message for each image that cannot be shown, with the reason.
    pub(super) problems: Vec<String>,
}

/// The side of crops and maps in pixels, 32 to 80, chosen so that all images together take about [`ROOM`] bytes. The
/// page shows a pixel of the largest crops as about 2x2 pixels.
fn side(recorded: &RecordedStudy) -> u32 {
    let tiles = recorded.manifest.scenes.len() * recorded.manifest.methods.len();
    // About 10.5 bytes per pixel of a side: two crops of 3 bytes that hardly compress, two maps that do, and a third
    // more for base64.
    let side = (ROOM / tiles.max(1) as f64 / 10.5).sqrt().clamp(32.0, 80.0);
    side as u32 / 8 * 8
}

pub(super) fn gallery(recorded: &RecordedStudy, scene: &SceneRecord) -> Gallery {
    let side = side(recorded);
    let mut problems = Vec::new();
    let reference = load(&recorded.folder, &scene.reference.file, &mut problems);
    let budget = budget(recorded, scene);
    let runs: Vec<Option<&Run>> = (0..recorded.manifest.methods.len())
        .map(|method| budget.and_then(|budget| run(recorded, scene, method, budget)))
        .collect();
    let same_size = |p: &Image, r: &Image| p.size == r.size;
    let mut images: Vec<Option<Image>> = Vec::new();
    for run in &runs {
        let file = run.and_then(|run| run.image.as_deref());
        let image = file.and_then(|file| load(&recorded.folder, file, &mut problems));
        if let (Some(image), Some(reference), Some(file)) = (&image, &reference, file)
            && !same_size(image, reference)
        {
            let [a, b] = [image.size, reference.size].map(|s| format!("{}x{}", s[0], s[1]));
            problems.push(format!("{file} is {a}, its reference {b}"));
        }
        images.push(image.filter(|p| reference.as_ref().is_some_and(|r| same_size(p, r))));
    }
    let mut gallery = Gallery {
        budget,
        exposure_stops: 0.0,
        overview: None,
        crops: Vec::new(),
        reference_crops: Vec::new(),
        tiles: Vec::new(),
        whole: Vec::new(),
        files: Vec::new(),
        size: reference.as_ref().map_or([0, 0], |r| r.size),
        most: most_samples(&runs),
        problems: Vec::new(),
    };
    let mut errors: Vec<Option<Vec<f32>>> = vec![None; runs.len()];
    if let Some(reference) = &reference {
        gallery.exposure_stops = exposure(reference);
        errors = images.iter().map(|p| p.as_ref().map(|p| relative_errors(p, reference))).collect();
        gallery.crops = crops(reference.size, side, &errors);
        gallery.overview =
            shrink(reference, 4 * side).and_then(|p| embed(encode_png(&p, gallery.exposure_stops), p.size));
        gallery.reference_crops = cut_all(reference, &gallery);
        add_whole(&mut gallery, recorded, scene, &images, reference);
    }
    for (method, run) in runs.iter().enumerate() {
        let Some(run) = run else { continue };
        let map = run.sample_map.as_deref().zip(run.white).zip(gallery.most);
        let map = map.and_then(|((file, white), most)| {
            sample_map(&load_map(&recorded.folder, file, &mut problems)?, [white, most], side)
        });
        let size = reference.as_ref().map_or([0, 0], |r| r.size);
        gallery.tiles.push(MethodImages {
            method,
            crops: images[method].as_ref().map_or_else(Vec::new, |p| cut_all(p, &gallery)),
            error_map: errors[method].as_ref().and_then(|e| error_map(e, size, side)),
            sample_map: map,
            files: [run.image.clone(), run.sample_map.clone()],
        });
    }
    gallery.problems = problems;
    gallery
}

/// The budget whose images are shown: equal time if it has images, else the largest spp with images; `None` without
/// images.
pub(super) fn budget(recorded: &RecordedStudy, scene: &SceneRecord) -> Option<RunBudget> {
    let shown = || recorded.runs.iter().filter(|run| run.scene == scene.name && run.image.is_some());
    let spp = |run: &Run| if let RunBudget::Spp(spp) = run.budget { Some(spp) } else { None };
    let timed = shown().map(|run| run.budget).find(|b| matches!(b, RunBudget::TimeOf(_)));
    timed.or(shown().filter_map(spp).max().map(RunBudget::Spp))
}

/// The first run of a method at `budget` that has an image, else the first one that has a sample map. For the baseline
/// at equal time, its run at that spp may replace it.
pub(super) fn run<'a>(
    recorded: &'a RecordedStudy,
    scene: &SceneRecord,
    method: usize,
    budget: RunBudget,
) -> Option<&'a Run> {
    let method = &recorded.manifest.methods[method];
    let find = |budget: RunBudget, has: fn(&Run) -> bool| {
        let fits = |run: &&Run| run.scene == scene.name && run.method == *method && run.budget == budget && has(run);
        recorded.runs.iter().find(fits)
    };
    let either = |budget| find(budget, |run| run.image.is_some()).or(find(budget, |run| run.sample_map.is_some()));
    match budget {
        RunBudget::TimeOf(spp) if *method == recorded.manifest.baseline => {
            either(budget).or(either(RunBudget::Spp(spp)))
        }
        _ => either(budget),
    }
}

fn load(folder: &Path, file: &str, problems: &mut Vec<String>) -> Option<Image> {
    let bytes = std::fs::read(folder.join(file)).map_err(|e| problems.push(format!("{file}: {e}"))).ok()?;
    read_image(&bytes, file, Encoding::Auto).map_err(|e| problems.push(e.to_string())).ok()
}

fn embed(png: Result<Vec<u8>, dapple_scene::image::ImageError>, size: [u32; 2]) -> Option<Embedded> {
    let uri = format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png.ok()?));
    Some(Embedded { uri, size })
}

/// The exposure in whole stops at which a scene's images are shown: 0, unless the reference is far too dark or too
/// bright. In that case it maps the 99th percentile of pixel values to about 1.
fn exposure(reference: &Image) -> f32 {
    let mut peaks: Vec<f32> = reference.pixels.iter().map(|p| p[0].max(p[1]).max(p[2])).collect();
    peaks.sort_by(f32::total_cmp);
    let bright = f64::from(peaks[(peaks.len() - 1) * 99 / 100]);
    if !(bright > 0.0 && bright.is_finite()) || (0.25..=4.0).contains(&bright) {
        return 0.0;
    }
    -libm::round(libm::log2(bright)) as f32
}

/// The squared error of each pixel over (squared reference + 0.01), the quantity whose mean is relMSE.
fn relative_errors(image: &Image, reference: &Image) -> Vec<f32> {
    let error = |(x, r): (&[f32; 3], &[f32; 3])| {
        let of = |c: usize| {
            let [x, r] = [x[c], r[c]].map(|v| if v.is_finite() { f64::from(v) } else { 0.0 });
            (x - r) * (x - r) / (r * r + dapple_metrics::RELATIVE_EPSILON)
        };
        ((of(0) + of(1) + of(2)) / 3.0) as f32
    };
    image.pixels.iter().zip(&reference.pixels).map(error).collect()
}

/// The smallest side in pixels of an image that is cropped; smaller images are shown whole.
const LEAST_SIDE: u32 = 24;

/// The two square crops to show: the one where the methods' errors differ most, then the one with the median
/// difference. Their side is `side`, at most half the image's. An image without room for two crops is shown whole.
/// Among equal crops, the first one in row order is taken.
fn crops(size: [u32; 2], side: u32, errors: &[Option<Vec<f32>>]) -> Vec<Crop> {
    let side = side.min(size[0].min(size[1]) / 2);
    if side < LEAST_SIDE {
        return vec![[0, 0, size[0], size[1]]];
    }
    let [width, height] = [side; 2];
    let starts = |whole: u32, part: u32| {
        let last = whole - part;
        let count = last.div_ceil((part / 2).max(1)).max(1);
        (0..=count).map(move |i| last * i / count)
    };
    let mut places: Vec<(f64, Crop)> = Vec::new();
    for y in starts(size[1], height) {
        for x in starts(size[0], width) {
            let crop = [x, y, width, height];
            if places.iter().all(|(_, other)| *other != crop) {
                places.push((spread(size, crop, errors), crop));
            }
        }
    }
    let most = places.iter().copied().fold(places[0], |best, one| if one.0 > best.0 { one } else { best });
    let apart = |crop: &Crop| (0..2).any(|axis| crop[axis].abs_diff(most.1[axis]) >= most.1[2 + axis]);
    let mut others: Vec<_> = places.iter().copied().filter(|(_, crop)| apart(crop)).collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    let typical = (!others.is_empty()).then(|| others[(others.len() - 1) / 2].1);
    [Some(most.1), typical].into_iter().flatten().collect()
}

/// A measure of how much the methods' errors differ in a crop: the logarithm of the largest over the smallest mean
/// error. If there is only one method, its mean error.
fn spread(size: [u32; 2], crop: Crop, errors: &[Option<Vec<f32>>]) -> f64 {
    let means: Vec<f64> = errors
        .iter()
        .flatten()
        .map(|errors| {
            let rows = (crop[1]..crop[1] + crop[3]).map(|y| (y * size[0] + crop[0]) as usize);
            let sum: f64 = rows.flat_map(|start| &errors[start..start + crop[2] as usize]).map(|&e| f64::from(e)).sum();
            sum / f64::from(crop[2] * crop[3])
        })
        .collect();
    let [low, high] = [means.iter().copied().fold(f64::INFINITY, f64::min), means.iter().copied().fold(0.0, f64::max)];
    // Errors below about 0.001 are invisible; adding 0.001 to both keeps them from mattering.
    if means.len() < 2 { high } else { libm::log((high + 1e-3) / (low + 1e-3)) }
}

fn cut_all(image: &Image, gallery: &Gallery) -> Vec<Embedded> {
    let cut = |crop: &Crop| {
        let rows = (crop[1]..crop[1] + crop[3]).map(|y| (y * image.size[0] + crop[0]) as usize);
        let pixels = rows.flat_map(|start| &image.pixels[start..start + crop[2] as usize]).copied().collect();
        let part = Image::new([crop[2], crop[3]], pixels).ok()?;
        embed(encode_png(&part, gallery.exposure_stops), part.size)
    };
    gallery.crops.iter().filter_map(cut).collect()
}

/// Shrinks an image by averaging pixels until its longer side is at most `most` pixels; `None` if that fails.
fn shrink(image: &Image, most: u32) -> Option<Image> {
    let [width, height] = image.size;
    let longer = width.max(height);
    if longer <= most {
        return Some(image.clone());
    }
    let target = [width, height].map(|s| (u64::from(s) * u64::from(most) / u64::from(longer)).max(1) as u32);
    let pixels: Vec<[f32; 3]> = image.pixels.iter().map(|p| p.map(|v| if v.is_finite() { v } else { 0.0 })).collect();
    let small = downsample(Pixels::new(image.size, &pixels).ok()?, target).ok()?;
    Image::new(target, small).ok()
}

fn error_map(errors: &[f32], size: [u32; 2], side: u32) -> Option<Embedded> {
    let image = Image::new(size, errors.iter().map(|&e| [e; 3]).collect()).ok()?;
    let small = shrink(&image, side)?;
    let bytes: Vec<[u8; 3]> = small.pixels.iter().map(|p| error_colour(f64::from(p[0]))).collect();
    embed(encode_png_rgb(small.size, &bytes), small.size)
}

fn load_map(folder: &Path, file: &str, problems: &mut Vec<String>) -> Option<Image> {
    let bytes = std::fs::read(folder.join(file)).map_err(|e| problems.push(format!("{file}: {e}"))).ok()?;
    read_image(&bytes, file, Encoding::Linear).map_err(|e| problems.push(e.to_string())).ok()
}

/// A sample map on the scene's colour scale, from 0 to `most` samples per pixel. `white` is the number that white
/// represents in `map`.
fn sample_map(map: &Image, [white, most]: [f64; 2], side: u32) -> Option<Embedded> {
    let small = shrink(map, side)?;
    let values: Vec<[u8; 3]> = small.pixels.iter().map(|p| sample_colour(f64::from(p[0]) * white, most)).collect();
    embed(encode_png_rgb(small.size, &values), small.size)
}

/// The largest number of samples per pixel in the sample maps of `runs`.
fn most_samples(runs: &[Option<&Run>]) -> Option<f64> {
    let mapped = runs.iter().flatten().filter(|run| run.sample_map.is_some());
    mapped.filter_map(|run| run.white).filter(|white| white.is_finite()).reduce(f64::max)
}

/// Adds the whole images of the methods and the reference for the viewer. Images that are too large for the page are
/// embedded at a lower resolution, and their PNG files at full resolution are added to [`Gallery::files`].
fn add_whole(
    gallery: &mut Gallery,
    recorded: &RecordedStudy,
    scene: &SceneRecord,
    images: &[Option<Image>],
    reference: &Image,
) {
    if images.iter().all(Option::is_none) {
        return;
    }
    let names = crate::file_names::method_file_names(&recorded.manifest.methods);
    let side = whole_side(recorded, reference.size);
    let methods = images.iter().enumerate().filter_map(|(i, image)| Some((Some(i), image.as_ref()?)));
    for (method, image) in methods.chain([(None, reference)]) {
        let stops = gallery.exposure_stops;
        let Some(embedded) = shrink(image, side).and_then(|p| embed(encode_png(&p, stops), p.size)) else { continue };
        let mut file = None;
        if embedded.size != image.size
            && let Ok(png) = encode_png(image, stops)
        {
            let name = method.map_or("reference", |method| &names[method]);
            let path = format!("viewer/{}/{name}.png", safe_file_name(&scene.name));
            gallery.files.push((path.clone(), png));
            file = Some(path);
        }
        gallery.whole.push(Whole { method, image: embedded, file });
    }
}

/// The longer side in pixels of the viewer's embedded images, chosen so that all of the page take about [`WHOLE_ROOM`]
/// bytes: 4 per pixel, as 3 bytes hardly compress and base64 takes a third more.
fn whole_side(recorded: &RecordedStudy, [width, height]: [u32; 2]) -> u32 {
    let images = recorded.manifest.scenes.len() * (recorded.manifest.methods.len() + 1);
    let pixels = WHOLE_ROOM / images.max(1) as f64 / 4.0;
    let factor = (pixels / (f64::from(width) * f64::from(height)).max(1.0)).sqrt().min(1.0);
    ((f64::from(width.max(height)) * factor) as u32).max(32)
}
