//! The reference images of a study (files given by the user, or images rendered once and kept), and the measurement of errors
//! against them.

use crate::record::safe_file_name;
use crate::scene::{Order, Subject, name_of, shoot};
use crate::{ImageErrors, Method, Plan, ReferenceRecord, ScenePlan, StudyError};
use dapple_core::render::{Control, Status};
use dapple_job::ContentHash;
use dapple_metrics::{METRICS, Measurement, Metric, MetricsError, Pixels, RELATIVE_EPSILON, downsample};
use dapple_scene::image::{
    Channels, Encoding, Image, Layer, Plane, encode_exr, read_attributes, read_channels, read_image, write_file,
};
use std::path::{Path, PathBuf};

/// A reference image, with its variance if known.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReferenceImage {
    pub(crate) size: [u32; 2],
    pub(crate) mean: Vec<[f32; 3]>,
    /// The variance of the reference image, per pixel and channel, in squared radiance; `None` if unknown.
    pub(crate) variance: Option<Vec<[f32; 3]>>,
}

/// The attributes in the header of an image file, and the hash of the file.
pub(crate) struct FileHeader {
    pub(crate) attributes: Vec<(String, String)>,
    pub(crate) digest: ContentHash,
}

impl FileHeader {
    /// The value of the attribute `dapple:KEY`; `None` if the header lacks this attribute.
    pub(crate) fn attribute(&self, key: &str) -> Option<&str> {
        let known = |name: &str| name.strip_prefix("dapple:") == Some(key);
        self.attributes.iter().find(|(name, _)| known(name)).map(|(_, text)| text.as_str())
    }
}

impl ReferenceImage {
    /// Averages two independent halves to a reference. Its variance is estimated from the difference of the halves.
    pub(crate) fn of_halves(size: [u32; 2], [a, b]: [&[[f32; 3]]; 2]) -> Self {
        let both = |of: fn(f32, f32) -> f32| {
            a.iter().zip(b).map(|(a, b)| [0, 1, 2].map(|c| of(a[c], b[c]))).collect::<Vec<[f32; 3]>>()
        };
        let mean = both(|a, b| 0.5 * (a + b));
        Self { size, mean, variance: Some(both(|a, b| 0.25 * (a - b) * (a - b))) }
    }

    /// Reads a reference from an image file. Its `variance` layer is used only if a study wrote the file; in other files, this
    /// layer holds the variance of single samples.
    pub(crate) fn read(path: &Path) -> Result<(Self, FileHeader), StudyError> {
        let bytes = std::fs::read(path).map_err(|e| StudyError::file(path, "read the reference", e))?;
        let name = path.display().to_string();
        let image = read_image(&bytes, &name, Encoding::Auto)?;
        // Formats other than OpenEXR have no attributes.
        let attributes = read_attributes(&bytes, &name).unwrap_or_default();
        let about = FileHeader { attributes, digest: ContentHash::of(&bytes) };
        let variance = match about.attribute("study-key") {
            Some(_) => variance(&read_channels(&bytes, &name)?),
            None => None,
        };
        Ok((Self { size: image.size, mean: image.pixels, variance }, about))
    }

    /// Reduces the image to `size` by averaging pixels; `None` unless width and height are multiples of those in `size`.
    pub(crate) fn averaged_to(self, size: [u32; 2]) -> Option<Self> {
        if self.size == size {
            return Some(self);
        }
        if size.contains(&0) || !(0..2).all(|axis| self.size[axis].is_multiple_of(size[axis])) {
            return None;
        }
        let averaged = |values: &[[f32; 3]]| downsample(Pixels::new(self.size, values).ok()?, size).ok();
        let pixels = (self.size[0] / size[0] * (self.size[1] / size[1])) as f32;
        let mut reduced = Self { size, mean: averaged(&self.mean)?, variance: None };
        if let Some(variance) = &self.variance {
            // The pixels are independent, so the variance of their mean is the mean variance over their number.
            reduced.variance = Some(averaged(variance)?.into_iter().map(|v| v.map(|v| v / pixels)).collect());
        }
        Some(reduced)
    }

    /// The relMSE that the reference's own variance causes; `None` if the variance is unknown.
    pub(crate) fn own_relmse(&self) -> Option<f64> {
        let variance = self.variance.as_ref()?;
        let values = self.mean.as_flattened().iter().zip(variance.as_flattened());
        let sum: f64 = values.map(|(r, v)| f64::from(*v) / (f64::from(*r) * f64::from(*r) + RELATIVE_EPSILON)).sum();
        Some(sum / (3 * self.mean.len()) as f64)
    }

    /// The errors of `image` against this reference, and `true` if the reference's own variance limits their precision.
    /// The variance, if known, is subtracted from MSE, relMSE and sRGB MSE.
    pub(crate) fn measure(&self, image: &[[f32; 3]]) -> Result<(ImageErrors, bool), MetricsError> {
        let pixels = |values| Pixels::new(self.size, values);
        let variance = self.variance.as_deref().map(pixels).transpose()?;
        let found = Measurement::new(pixels(image)?, pixels(&self.mean)?, variance)?;
        let value = |metric: &Metric| Ok((metric.name, (metric.of)(&found)?));
        let errors = METRICS.iter().map(value).collect::<Result<ImageErrors, MetricsError>>()?;
        Ok((errors, found.reference_limited()))
    }
}

fn variance(channels: &Channels) -> Option<Vec<[f32; 3]>> {
    let plane = |name: &str| match channels.plane(name)? {
        Plane::F32(values) => Some(values.clone()),
        _ => None,
    };
    let [r, g, b] = [plane("variance.R")?, plane("variance.G")?, plane("variance.B")?];
    Some(r.iter().zip(g.iter()).zip(b.iter()).map(|((r, g), b)| [*r, *g, *b]).collect())
}

/// The seeds of the two halves of a rendered reference, far above the usual seeds of runs.
const SEEDS: [u64; 2] = [0xda99_1e01, 0xda99_1e02];

/// Candidate point sets for rendered references. A reference uses the first one that no method uses, so that no run shares
/// points with its reference. If methods use all three, it uses `random`. On the bundled teapot and cornell at 512 spp,
/// `halton` is as good as `sobol`, and has a quarter of the MSE of `random`.
const POINTS: [&str; 3] = ["sobol", "halton", "random"];

/// The origin of a reference image.
pub(crate) struct ReferenceSource {
    /// The reference's record. For a reference that is rendered, `relmse` is still unknown.
    pub(crate) record: ReferenceRecord,
    /// The file of a rendered reference, which is rendered if the file is missing; `None` for a user's file, which has been
    /// checked.
    pub(crate) rendered: Option<PathBuf>,
}

/// Creates the folder of references: `shared` (for several studies) or, with `None`, a subfolder of the study's folder. Returns
/// the path of the file `name` as recorded in the study, and the path for opening the file.
fn place(study: &Path, shared: Option<&Path>, name: &str) -> Result<(String, PathBuf), StudyError> {
    let own = study.join("references");
    let folder = shared.unwrap_or(&own);
    let wrong = |e| StudyError::file(folder, "create the folder of references", e);
    std::fs::create_dir_all(folder).map_err(wrong)?;
    if shared.is_none() {
        return Ok((format!("references/{name}"), folder.join(name)));
    }
    let path = std::path::absolute(folder).map_err(wrong)?.join(name);
    Ok((path.display().to_string(), path))
}

/// Chooses the file of a scene's reference, or the settings for rendering one. Returns an error for a user's file that does not
/// match the scene.
pub(crate) fn plan_reference(
    plan: &Plan,
    scene: &ScenePlan,
    subject: &Subject,
    folder: &Path,
    shared: Option<&Path>,
) -> Result<ReferenceSource, StudyError> {
    if let Some(file) = &scene.reference {
        return Ok(ReferenceSource { record: given(plan, file, subject)?, rendered: None });
    }
    let points = POINTS.iter().find(|p| plan.methods.iter().all(|m| kind(&m.points) != **p)).unwrap_or(&"random");
    let settings = settings(plan.settings.reference_spp, points, subject)?;
    let mut key = ContentHash::new();
    for (name, value) in &settings {
        key.text(name);
        key.text(value);
    }
    let hash = key.hex();
    let name = format!("{}-{}.exr", safe_file_name(&name_of(&subject.view.source)), &hash[..16]);
    let (file, path) = place(folder, shared, &name)?;
    let record = ReferenceRecord {
        file,
        spp: Some(plan.settings.reference_spp),
        points: Some((*points).to_owned()),
        seeds: Some(SEEDS),
        relmse: None,
        hash,
    };
    Ok(ReferenceSource { record, rendered: Some(path) })
}

/// All settings on which a rendered reference depends, as pairs of name and value.
fn settings(spp: u64, points: &str, subject: &Subject) -> Result<Vec<(&'static str, String)>, StudyError> {
    let view = &subject.view;
    let [w, h] = view.resolution;
    Ok(vec![
        ("study-scene", subject.content.hex()),
        ("study-resolution", format!("{w}x{h}")),
        ("study-max-depth", depth(subject)),
        ("study-spp", spp.to_string()),
        ("study-points", points.to_owned()),
        ("study-seeds", SEEDS.map(|s| s.to_string()).join(",")),
        ("study-version", env!("CARGO_PKG_VERSION").to_owned()),
        ("study-fingerprint", subject.fingerprint()?.hex()),
    ])
}

fn depth(subject: &Subject) -> String {
    subject.scene.max_depth.map_or("unlimited".into(), |d| d.to_string())
}

/// Loads or renders a reference, and returns its record with the relMSE due to the reference's own variance. A file given by
/// the user is not loaded. `look` receives the rendered fraction and can stop the rendering; the result is then `None`.
pub(crate) fn load_or_render(
    wanted: ReferenceSource,
    subject: &Subject,
    look: &mut dyn FnMut(f64) -> Control,
) -> Result<Option<ReferenceRecord>, StudyError> {
    let ReferenceSource { mut record, rendered: Some(path) } = wanted else { return Ok(Some(wanted.record)) };
    // A broken file, or a file made with other settings, is rendered again.
    let kept = ReferenceImage::read(&path).ok();
    let kept = kept.filter(|(t, about)| about.attribute("study-key") == Some(&record.hash) && t.variance.is_some());
    let truth = match kept {
        Some((truth, _)) => Some(truth),
        None => render(&record, subject, look)?.map(|truth| keep(&path, truth, &record, subject)).transpose()?,
    };
    let Some(truth) = truth else { return Ok(None) };
    record.relmse = truth.own_relmse();
    Ok(Some(record))
}

/// Renders the two halves of a reference, one per seed; `None` if `look` stops the rendering.
fn render(
    record: &ReferenceRecord,
    subject: &Subject,
    look: &mut dyn FnMut(f64) -> Control,
) -> Result<Option<ReferenceImage>, StudyError> {
    let pixels = subject.view.pixels();
    let samples = record.spp.unwrap_or(2) / 2 * pixels;
    let method = Method::new("uniform", record.points.as_deref().unwrap_or("random"), "none");
    let mut halves = Vec::new();
    for (half, seed) in SEEDS.into_iter().enumerate() {
        let mut stopped = false;
        let mut monitor = |status: &Status<'_>| {
            let control = look(0.5 * (half as f64 + status.samples as f64 / status.expected.max(1) as f64));
            stopped |= control == Control::Stop;
            control
        };
        let order = Order { method: &method, seed, samples, external: None, threads: 0 };
        let shot = shoot(subject, order, None, &mut monitor, || None)?;
        if stopped || shot.film.record().interrupted {
            return Ok(None);
        }
        halves.push(shot.filtered.radiance);
    }
    Ok(Some(ReferenceImage::of_halves(subject.view.resolution, [&halves[0], &halves[1]])))
}

/// Writes a rendered reference to its file, with the settings in the header.
fn keep(
    path: &Path,
    truth: ReferenceImage,
    record: &ReferenceRecord,
    subject: &Subject,
) -> Result<ReferenceImage, StudyError> {
    let mut attributes = settings(record.spp.unwrap_or(0), record.points.as_deref().unwrap_or(""), subject)?;
    attributes.push(("study-key", record.hash.clone()));
    attributes.push(("scene", subject.scene.name.clone()));
    attributes.push(("study-relmse", truth.own_relmse().unwrap_or(0.0).to_string()));
    let attributes: Vec<_> = attributes.into_iter().map(|(key, text)| (format!("dapple:{key}"), text)).collect();
    let mut layers = vec![Layer::of_image("", &Image::new(truth.size, truth.mean.clone())?)];
    if let Some(variance) = &truth.variance {
        layers.push(Layer::of_image("variance", &Image::new(truth.size, variance.clone())?));
    }
    write_file(path, &encode_exr(truth.size, &layers, &attributes)?.bytes)?;
    Ok(truth)
}

/// Checks the size, the pixels and the header of a reference file given by the user, and returns its record.
fn given(plan: &Plan, file: &Path, subject: &Subject) -> Result<ReferenceRecord, StudyError> {
    let (whole, about) = ReferenceImage::read(file)?;
    let refuse = |why: String| StudyError::reference(file, &subject.view.name, why);
    let ([w, h], [rw, rh]) = (subject.view.resolution, whole.size);
    let Some(truth) = whole.averaged_to([w, h]) else {
        return Err(refuse(format!(
            "it has {rw}x{rh} pixels, but the study uses {w}x{h}; omit the study's resolution, or render the reference with \
             {w}x{h} pixels or a multiple"
        )));
    };
    if let Some(at) = truth.mean.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        let (x, y) = (at % w as usize, at / w as usize);
        return Err(refuse(format!("its pixel at column {x}, row {y} is NaN or infinite; render another reference")));
    }
    differences(plan, &about, subject).map_or(Ok(()), |why| Err(refuse(why)))?;
    let number = |key: &str| about.attribute(key).and_then(|text| text.parse().ok());
    let seeds = about.attribute("study-seeds").and_then(|text| text.split_once(','));
    Ok(ReferenceRecord {
        file: std::path::absolute(file).unwrap_or_else(|_| file.to_owned()).display().to_string(),
        spp: number("study-spp"),
        points: about.attribute("study-points").or(about.attribute("points")).map(str::to_owned),
        seeds: seeds.and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?])),
        relmse: truth.own_relmse(),
        hash: about.digest.hex(),
    })
}

/// Describes the first setting in which the header of a reference file differs from the study; `None` if all settings agree.
/// `dapple render` or a study may have written the header.
fn differences(plan: &Plan, about: &FileHeader, subject: &Subject) -> Option<String> {
    const DEPTH: &str = "render the reference with the study's depth, or set max_depth to the depth of the reference";
    let depth = depth(subject);
    let scene = &subject.scene.name;
    let expected = [
        ("study-scene", subject.content.hex(), "omit the reference, since the scene's files have changed"),
        ("study-max-depth", depth.clone(), DEPTH),
        ("scene", scene.clone(), "give a reference of the study's scene"),
        ("max-depth", depth, DEPTH),
        ("without", "none".into(), "render the reference with all effects"),
        ("interrupted", "false".into(), "finish the render of the reference, which was stopped"),
        ("pixel-filter", "box filter of radius 0.5 x 0.5".into(), "render the reference with --pixel-filter box"),
    ];
    for (key, here, advice) in expected {
        if let Some(there) = about.attribute(key).filter(|there| *there != here) {
            return Some(format!(
                "its header states {} \"{there}\", but the study has \"{here}\"; {advice}",
                key.replace('-', " ")
            ));
        }
    }
    // A run with the reference's points and seed would share samples with it, and show too small an error.
    let points = kind(about.attribute("points")?);
    let seed = about.attribute("seed")?.parse().ok()?;
    let shares = plan.seeds.contains(&seed) && plan.methods.iter().any(|m| kind(&m.points) == points);
    shares.then(|| format!("it was rendered with points {points} and seed {seed}, as some runs are, and would share samples with those runs; render the reference with another seed"))
}

/// The name in `NAME:key=value,…`, without its parameters.
fn kind(words: &str) -> &str {
    words.split(':').next().unwrap_or(words).trim()
}
