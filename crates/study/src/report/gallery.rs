//! The images of the report: renders, error maps and sample maps. All are PNG files embedded in the page.

use super::page::{ReportPage, link, phrase};
use super::tables::TableCell;
use crate::RecordedStudy;
use crate::record::{Run, RunBudget, SceneRecord, method_file_names, safe_file_name};
use base64::Engine;
use dapple_metrics::{Pixels, downsample};
use dapple_scene::image::{Encoding, Image, ImageError, encode_png, encode_png_rgb, read_image};

/// The largest total size in bytes of the methods' images and maps in the page.
const ROOM: f64 = 3.0e6;

/// The largest total size in bytes of the viewer's whole images in the page.
const WHOLE_ROOM: f64 = 1.1e6;

/// A PNG image embedded in the page, as a data URI with its size in pixels.
pub(super) struct Embedded {
    pub(super) uri: String,
    pub(super) size: [u32; 2],
}

/// The report's images of one scene.
#[derive(Default)]
pub(super) struct SceneImages {
    /// The budget of the images, as a phrase.
    pub(super) budget: String,
    /// The exposure that is applied to all images of the scene.
    pub(super) exposure: String,
    /// Width and height of the whole images in pixels.
    pub(super) size: [u32; 2],
    pub(super) tiles: Vec<MethodTile>,
    /// The whole images that the viewer compares, the reference last. Empty if no method has an image.
    pub(super) whole: Vec<WholeImage>,
    /// The ticks of the colour scale of sample counts: text, and position in percent.
    pub(super) sample_ticks: Vec<(String, f64)>,
    /// One message for each image that cannot be shown, with the reason.
    pub(super) problems: Vec<String>,
    /// PNG files at full resolution for the viewer: paths relative to the study's folder, and contents.
    pub(super) files: Vec<(String, Vec<u8>)>,
}

/// The images of one method, with captions.
pub(super) struct MethodTile {
    pub(super) method: String,
    pub(super) swatch: String,
    pub(super) ratio: Option<TableCell>,
    pub(super) baseline: bool,
    pub(super) image: Option<Embedded>,
    pub(super) error_map: Option<Embedded>,
    pub(super) sample_map: Option<Embedded>,
    /// The names and links of the files of the image and its sample map.
    pub(super) files: Vec<(&'static str, String)>,
}

/// A whole image for the viewer: a method's image or the reference.
pub(super) struct WholeImage {
    pub(super) name: String,
    pub(super) image: Embedded,
    /// The link to the file at full resolution, if the embedded image is smaller; empty otherwise.
    pub(super) file: String,
}

impl ReportPage<'_> {
    pub(super) fn images(&self, scene: &SceneRecord) -> SceneImages {
        let manifest = &self.recorded.manifest;
        let side = side_for(ROOM / 6.5, manifest.scenes.len() * manifest.methods.len()).clamp(32.0, 96.0) as u32;
        let mut found = SceneImages::default();
        let budget = budget(self.recorded, scene);
        let run = |method| budget.and_then(|budget| run(self.recorded, scene, method, budget));
        let runs: Vec<Option<&Run>> = (0..manifest.methods.len()).map(run).collect();
        let words = budget.map(|budget| budget.to_string()).unwrap_or_default();
        found.budget = budget.map(phrase).unwrap_or_default();
        let reference = self.load(&scene.reference.file, Encoding::Auto, &mut found.problems);
        let images: Vec<Option<Image>> =
            runs.iter().map(|run| self.image_of((*run)?, reference.as_ref(), &mut found.problems)).collect();
        let stops = reference.as_ref().map_or(0.0, exposure);
        found.exposure =
            if stops == 0.0 { "as rendered".into() } else { format!("{stops:+} stops").replace('-', "−") };
        if let Some(reference) = reference.as_ref().filter(|_| images.iter().any(Option::is_some)) {
            self.add_whole(&mut found, scene, &images, reference, stops);
        }
        let most = most_samples(&runs);
        found.sample_ticks = most.map_or_else(Vec::new, sample_ticks);
        for (method, run) in runs.iter().enumerate() {
            let Some(run) = run else { continue };
            let map = run.sample_map.as_deref().zip(run.white).zip(most);
            let map = map.and_then(|((file, white), most)| {
                let map = self.load(file, Encoding::Linear, &mut found.problems)?;
                coloured(&map, side, &|share| sample_colour(share * white, most))
            });
            let image = images[method].as_ref();
            let errors = image.zip(reference.as_ref()).and_then(|(image, reference)| relative_errors(image, reference));
            let row = self.summary.find(&scene.name, &manifest.methods[method], &words, "relmse ratio");
            let files = [("EXR", &run.image), ("sample map", &run.sample_map)];
            found.tiles.push(MethodTile {
                method: self.names[method].clone(),
                swatch: self.styles[method].swatch(),
                ratio: row.map(|row| TableCell::of(Some(row))),
                baseline: manifest.methods[method] == manifest.baseline,
                image: image.and_then(|image| embed_shrunk(image, side, stops)),
                error_map: errors.and_then(|errors| coloured(&errors, side, &error_colour)),
                sample_map: map,
                files: files.into_iter().filter_map(|(name, file)| Some((name, link(file.as_deref()?)))).collect(),
            });
        }
        found
    }

    /// Reads an image of the study; `None` with a message in `problems` if that fails.
    fn load(&self, file: &str, encoding: Encoding, problems: &mut Vec<String>) -> Option<Image> {
        let bytes = std::fs::read(self.recorded.folder.join(file)).map_err(|e| problems.push(format!("{file}: {e}")));
        read_image(&bytes.ok()?, file, encoding).map_err(|e| problems.push(e.to_string())).ok()
    }

    /// The image of a run; `None` if the run has no image, or one of another size than the reference.
    fn image_of(&self, run: &Run, reference: Option<&Image>, problems: &mut Vec<String>) -> Option<Image> {
        let file = run.image.as_deref()?;
        let image = self.load(file, Encoding::Auto, problems)?;
        let reference = reference?;
        if image.size != reference.size {
            let [a, b] = [image.size, reference.size].map(|s| format!("{}x{}", s[0], s[1]));
            problems.push(format!("{file} has {a} pixels, but its reference has {b}"));
            return None;
        }
        Some(image)
    }

    /// Adds the whole images of the methods and the reference for the viewer. Images that are too large for the page
    /// are embedded at a lower resolution, and their PNG files at full resolution are added to [`SceneImages::files`].
    fn add_whole(
        &self,
        found: &mut SceneImages,
        scene: &SceneRecord,
        images: &[Option<Image>],
        reference: &Image,
        stops: f32,
    ) {
        let manifest = &self.recorded.manifest;
        let [width, height] = reference.size;
        found.size = reference.size;
        let side = side_for(WHOLE_ROOM / 4.0, manifest.scenes.len() * (manifest.methods.len() + 1));
        let factor = (side / (f64::from(width) * f64::from(height)).sqrt()).min(1.0);
        let longer = ((f64::from(width.max(height)) * factor) as u32).max(32);
        let files = method_file_names(&manifest.methods);
        let methods =
            images.iter().enumerate().filter_map(|(i, image)| Some((&*self.names[i], &*files[i], image.as_ref()?)));
        for (name, file, image) in methods.chain([("reference", "reference", reference)]) {
            let Some(embedded) = embed_shrunk(image, longer, stops) else { continue };
            let mut whole = WholeImage { name: name.to_owned(), image: embedded, file: String::new() };
            if whole.image.size != image.size
                && let Ok(png) = encode_png(image, stops)
            {
                let path = format!("viewer/{}/{file}.png", safe_file_name(&scene.name));
                whole.file = link(&path);
                found.files.push((path, png));
            }
            found.whole.push(whole);
        }
    }
}

/// The side in pixels of each of `count` squares that together have `pixels` pixels.
fn side_for(pixels: f64, count: usize) -> f64 {
    (pixels / count.max(1) as f64).sqrt()
}

/// The budget whose images are shown: equal time if there are such images, else the largest spp with images. `None` without
/// images.
fn budget(recorded: &RecordedStudy, scene: &SceneRecord) -> Option<RunBudget> {
    // Equal time sorts after samples per pixel.
    let shown = recorded.runs.iter().filter(|run| run.scene == scene.name && run.image.is_some());
    shown.map(|run| run.budget).max()
}

/// The first run of a method at `budget` with an image, else the first with a sample map.
fn run<'a>(recorded: &'a RecordedStudy, scene: &SceneRecord, method: usize, budget: RunBudget) -> Option<&'a Run> {
    let method = &recorded.manifest.methods[method];
    let of = |run: &&Run| run.scene == scene.name && run.method == *method && run.budget == budget;
    let mut runs = recorded.runs.iter().filter(of);
    runs.clone().find(|run| run.image.is_some()).or(runs.find(|run| run.sample_map.is_some()))
}

/// The exposure in whole stops at which a scene's images are shown: 0, unless the reference is far too dark or too bright. In
/// that case, the 99th percentile of pixel values is mapped to about 1.
fn exposure(reference: &Image) -> f32 {
    let mut peaks: Vec<f32> = reference.pixels.iter().map(|p| p[0].max(p[1]).max(p[2])).collect();
    peaks.sort_by(f32::total_cmp);
    let bright = f64::from(peaks[(peaks.len() - 1) * 99 / 100]);
    if !(bright > 0.0 && bright.is_finite()) || (0.25..=4.0).contains(&bright) {
        return 0.0;
    }
    -libm::round(libm::log2(bright)) as f32
}

/// The squared error of each pixel divided by (squared reference + 0.01). The mean of these values is relMSE.
fn relative_errors(image: &Image, reference: &Image) -> Option<Image> {
    let error = |(x, r): (&[f32; 3], &[f32; 3])| {
        let of = |c: usize| {
            let [x, r] = [x[c], r[c]].map(|v| if v.is_finite() { f64::from(v) } else { 0.0 });
            (x - r) * (x - r) / (r * r + dapple_metrics::RELATIVE_EPSILON)
        };
        [((of(0) + of(1) + of(2)) / 3.0) as f32; 3]
    };
    Image::new(image.size, image.pixels.iter().zip(&reference.pixels).map(error).collect()).ok()
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

fn embed_shrunk(image: &Image, most: u32, stops: f32) -> Option<Embedded> {
    let small = shrink(image, most)?;
    embed(encode_png(&small, stops), small.size)
}

/// A map of the image's values, shown as colours.
fn coloured(image: &Image, side: u32, colour: &dyn Fn(f64) -> [u8; 3]) -> Option<Embedded> {
    let small = shrink(image, side)?;
    let bytes: Vec<[u8; 3]> = small.pixels.iter().map(|p| colour(f64::from(p[0]))).collect();
    embed(encode_png_rgb(small.size, &bytes), small.size)
}

fn embed(png: Result<Vec<u8>, ImageError>, size: [u32; 2]) -> Option<Embedded> {
    let uri = format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png.ok()?));
    Some(Embedded { uri, size })
}

/// The largest number of samples per pixel in the sample maps of `runs`.
fn most_samples(runs: &[Option<&Run>]) -> Option<f64> {
    let mapped = runs.iter().flatten().filter(|run| run.sample_map.is_some());
    mapped.filter_map(|run| run.white).filter(|white| white.is_finite()).reduce(f64::max)
}

/// The ends of the error map's colour scale: the exponents of powers of ten of the relative squared error.
const ERROR_DECADES: [f64; 2] = [-4.0, 0.0];

/// A colour scale: the colours at 0, 1/4, 1/2, 3/4 and 1, in 8-bit sRGB. Lightness increases along the scale, so that it can be
/// read in black and white and by colour-blind readers.
type Colours = [[f64; 3]; 5];

/// The colours of error maps [after van der Walt 2015, matplotlib's `inferno`].
const ERRORS: Colours =
    [[0.0, 0.0, 4.0], [87.0, 16.0, 110.0], [188.0, 55.0, 84.0], [249.0, 142.0, 9.0], [252.0, 255.0, 164.0]];

/// The colours of sample maps [after van der Walt 2015, matplotlib's `viridis`].
const SAMPLES: Colours =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// The colour of a relative squared error.
fn error_colour(error: f64) -> [u8; 3] {
    colour(&ERRORS, error_place(error))
}

fn error_place(error: f64) -> f64 {
    let [low, high] = ERROR_DECADES;
    if error > 0.0 { ((libm::log10(error) - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 }
}

/// The colour of `count` samples on a scale from 0 to `most`, proportional to `log(1 + count)`.
fn sample_colour(count: f64, most: f64) -> [u8; 3] {
    colour(&SAMPLES, sample_place(count, most))
}

fn sample_place(count: f64, most: f64) -> f64 {
    (libm::log1p(count.max(0.0)) / libm::log1p(most.max(1.0))).clamp(0.0, 1.0)
}

fn colour(colours: &Colours, share: f64) -> [u8; 3] {
    let last = colours.len() - 1;
    let place = share * last as f64;
    let below = (place as usize).min(last - 1);
    let t = place - below as f64;
    std::array::from_fn(|c| {
        let [a, b] = [colours[below][c], colours[below + 1][c]];
        (a + t * (b - a)).round() as u8
    })
}

/// The ticks of the error scale: text, and position in percent.
pub(super) fn error_ticks() -> [(&'static str, f64); 3] {
    [("≤ 10⁻⁴", 1e-4), ("0.01", 1e-2), ("≥ 1", 1.0)].map(|(text, error)| (text, 100.0 * error_place(error)))
}

/// The ticks of a sample scale from 0 to `most`: text, and position in percent. Between the ends, there are ticks at powers of
/// 4 with room for their text.
fn sample_ticks(most: f64) -> Vec<(String, f64)> {
    let tick = |count: f64| (count.round().to_string(), 100.0 * sample_place(count, most));
    let mut ticks = vec![tick(0.0)];
    for count in (1..16).map(|power| libm::pow(4.0, f64::from(power))) {
        let place = 100.0 * sample_place(count, most);
        let last = ticks.last().map_or(0.0, |(_, place)| *place);
        if count < most && place - last >= 20.0 && place <= 80.0 {
            ticks.push(tick(count));
        }
    }
    ticks.push(tick(most));
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_begin_and_end_at_their_colours() {
        assert_eq!((error_colour(0.0), error_colour(7.0)), ([0, 0, 4], [252, 255, 164]));
        assert_eq!((sample_colour(0.0, 64.0), sample_colour(64.0, 64.0)), ([68, 1, 84], [253, 231, 37]));
        let ticks = sample_ticks(100.0);
        assert_eq!((ticks[0].0.as_str(), ticks.last().map(|t| t.0.as_str())), ("0", Some("100")));
        assert!(ticks.windows(2).all(|pair| pair[0].1 + 15.0 < pair[1].1), "{ticks:?}");
    }
}
