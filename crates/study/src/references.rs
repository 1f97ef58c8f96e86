//! The reference images of a study: files given by the user, or images rendered once and kept.

use crate::file_names::safe_file_name;
use crate::measured_image::{Order, shoot};
use crate::reference_image::{FileHeader, ReferenceImage};
use crate::study_scene::name_of;
use crate::{Method, Plan, ReferenceRecord, ScenePlan, StudyError, Subject};
use dapple_core::{Control, Monitor};
use dapple_job::ContentHash;
use dapple_scene::image::{Image, Layer, encode_exr, write_file};
use std::path::{Path, PathBuf};

/// The seeds of a rendered reference's two halves, far above the usual seeds of runs.
const SEEDS: [u64; 2] = [0xda99_1e01, 0xda99_1e02];

/// Candidate point sets for rendered references. The first one that no method uses is taken, so that no run shares
/// points with its reference; if methods use all three, `random` is taken. On the bundled teapot and cornell at 512
/// spp, `halton` is as good as `sobol`, and has a quarter of the MSE of `random`.
const POINTS: [&str; 3] = ["sobol", "halton", "random"];

/// The origin of a reference image.
pub(crate) enum ReferenceSource {
    /// A file given by the user, already checked.
    File(ReferenceRecord),
    /// A reference that is rendered unless the file at `path` already holds it. The record's `relmse` is not known yet.
    Rendered { record: ReferenceRecord, path: PathBuf },
}

impl ReferenceSource {
    pub(crate) fn record(&self) -> &ReferenceRecord {
        match self {
            Self::File(record) | Self::Rendered { record, .. } => record,
        }
    }
}

/// The folder for rendered references: a part of the study's folder, or a folder that several studies share.
pub(crate) struct ReferenceFolder<'a> {
    pub(crate) study: &'a Path,
    pub(crate) shared: Option<&'a Path>,
}

impl ReferenceFolder<'_> {
    /// Creates the folder; returns the path of the file `name` as recorded in the study, and the path for opening it.
    fn place(&self, name: &str) -> Result<(String, PathBuf), StudyError> {
        let make = |folder: &Path| {
            std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "make the folder of references", e))
        };
        match self.shared {
            None => {
                let folder = self.study.join("references");
                make(&folder)?;
                Ok((format!("references/{name}"), folder.join(name)))
            }
            Some(shared) => {
                make(shared)?;
                let path = std::path::absolute(shared)
                    .map_err(|e| StudyError::file(shared, "find the folder of references", e))?
                    .join(name);
                Ok((path.display().to_string(), path))
            }
        }
    }
}

/// Decides from which file, or by which settings, a scene gets its reference. Returns an error for a user's file that
/// does not fit the scene.
pub(crate) fn plan_reference(
    plan: &Plan,
    scene: &ScenePlan,
    subject: &Subject,
    folders: &ReferenceFolder<'_>,
) -> Result<ReferenceSource, StudyError> {
    if let Some(file) = &scene.reference {
        return Ok(ReferenceSource::File(given(plan, file, subject)?));
    }
    let points = POINTS.iter().find(|p| plan.methods.iter().all(|m| kind(&m.points) != **p)).unwrap_or(&"random");
    let settings = settings(plan.reference_spp, points, subject)?;
    let mut key = ContentHash::new();
    for (name, value) in &settings {
        key.text(name);
        key.text(value);
    }
    let hash = key.hex();
    let (file, path) =
        folders.place(&format!("{}-{}.exr", safe_file_name(&name_of(&subject.view.source)), &hash[..16]))?;
    let record = ReferenceRecord {
        file,
        spp: Some(plan.reference_spp),
        points: Some((*points).to_owned()),
        seeds: Some(SEEDS),
        relmse: None,
        hash,
    };
    Ok(ReferenceSource::Rendered { record, path })
}

/// All settings that a rendered reference depends on, as pairs of name and value.
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

/// Loads or renders a reference, and returns its record with the relMSE due to the reference's own variance. A file
/// given by the user is not loaded. `None` if `monitor` stopped the rendering.
pub(crate) fn load_or_render(
    wanted: ReferenceSource,
    subject: &Subject,
    monitor: &mut dyn Monitor,
) -> Result<Option<ReferenceRecord>, StudyError> {
    let (mut record, path) = match wanted {
        ReferenceSource::File(record) => return Ok(Some(record)),
        ReferenceSource::Rendered { record, path } => (record, path),
    };
    // A broken file, or a file made with other settings, is rendered again.
    let kept = ReferenceImage::read(&path).ok();
    let kept = kept.filter(|(t, about)| about.attribute("study-key") == Some(&record.hash) && t.variance.is_some());
    let truth = match kept {
        Some((truth, _)) => Some(truth),
        None => render(&record, subject, monitor)?.map(|truth| keep(&path, truth, &record, subject)).transpose()?,
    };
    let Some(truth) = truth else { return Ok(None) };
    record.relmse = truth.own_relmse();
    Ok(Some(record))
}

/// Renders the two halves of a reference, one per seed; `None` if the monitor stopped it.
fn render(
    record: &ReferenceRecord,
    subject: &Subject,
    monitor: &mut dyn Monitor,
) -> Result<Option<ReferenceImage>, StudyError> {
    let pixels = subject.frame()?.pixels() as u64;
    let samples = record.spp.unwrap_or(2) / 2 * pixels;
    let method = Method::new("uniform", record.points.as_deref().unwrap_or("random"), "none");
    let mut halves = Vec::new();
    for seed in SEEDS {
        let mut stopped = false;
        let mut look = |status: &dapple_core::Status<'_>| {
            let control = monitor.slice(status);
            stopped |= control == Control::Stop;
            control
        };
        let shot = shoot(subject, Order { seed, ..Order::new(&method, samples) }, &mut look, || None)?;
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
    let refuse = |why: String| StudyError::Reference { file: file.to_owned(), scene: subject.view.name.clone(), why };
    let ([w, h], [rw, rh]) = (subject.view.resolution, whole.size);
    let Some(truth) = whole.averaged_to([w, h]) else {
        return Err(refuse(format!(
            "it is {rw}x{rh}, and the study {w}x{h}: leave the resolution out, or render the reference at the study's, or at a \
             multiple of it"
        )));
    };
    if let Some(at) = truth.mean.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        let (x, y) = (at % w as usize, at / w as usize);
        return Err(refuse(format!("its pixel at column {x}, row {y} is NaN or infinite; render a finite one")));
    }
    differences(plan, &about, subject).map_or(Ok(()), |why| Err(refuse(why)))?;
    let number = |key: &str| about.attribute(key).and_then(|text| text.parse().ok());
    let seeds = about.attribute("study-seeds").and_then(|text| {
        let (a, b) = text.split_once(',')?;
        Some([a.parse().ok()?, b.parse().ok()?])
    });
    Ok(ReferenceRecord {
        file: std::path::absolute(file).unwrap_or_else(|_| file.to_owned()).display().to_string(),
        spp: number("study-spp"),
        points: about.attribute("study-points").or(about.attribute("points")).map(str::to_owned),
        seeds,
        relmse: truth.own_relmse(),
        hash: about.digest.hex(),
    })
}

/// Describes the first setting in which the header of a reference file differs from the study; `None` if none differs.
/// The header may be written by `dapple render` or by a study.
fn differences(plan: &Plan, about: &FileHeader, subject: &Subject) -> Option<String> {
    let depth = depth(subject);
    let scene = &subject.scene.name;
    let expected = [
        ("study-scene", subject.content.hex(), "the scene's files have changed; leave the reference out to render one"),
        ("study-max-depth", depth.clone(), "render it with the study's depth, or give the study its depth"),
        ("scene", scene.clone(), "it shows another scene"),
        ("max-depth", depth, "render it with the study's depth, or give the study its depth"),
        ("without", "none".into(), "effects are left out of it"),
        ("interrupted", "false".into(), "it is unfinished"),
        ("pixel-filter", "box filter of radius 0.5 x 0.5".into(), "render it with --pixel-filter box, as a study does"),
    ];
    for (key, here, advice) in expected {
        if let Some(there) = about.attribute(key).filter(|there| *there != here) {
            return Some(format!("its {} is \"{there}\", and the study's \"{here}\"; {advice}", key.replace('-', " ")));
        }
    }
    // A run with the reference's points and seed would share samples with it, and show too small an error.
    let points = kind(about.attribute("points")?);
    let seed = about.attribute("seed")?.parse().ok()?;
    let shares = plan.seeds.contains(&seed) && plan.methods.iter().any(|m| kind(&m.points) == points);
    shares.then(|| format!("its points are {points} of seed {seed}, as in runs; render it with another seed"))
}

/// The name in `NAME:key=value,…`, without its parameters.
fn kind(words: &str) -> &str {
    words.split(':').next().unwrap_or(words).trim()
}
