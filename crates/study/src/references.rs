//! References: files from elsewhere, or rendered once and kept.

use crate::digest::Digest;
use crate::shot::{Order, shoot};
use crate::subject::name_of;
use crate::truth::{About, Truth};
use crate::{Method, Plan, Reference, ScenePlan, StudyError, Subject};
use dapple_core::{Control, Monitor};
use dapple_scene::image::{Image, Layer, encode_exr, write_file};
use std::path::{Path, PathBuf};

/// Seeds of the halves: none that a study counts up to.
const SEEDS: [u64; 2] = [0xda99_1e01, 0xda99_1e02];

/// What references are made of: the first that no method uses, so that no run shares its points. On the bundled
/// teapot and cornell at 512 spp, `halton` is as good as `sobol`, and has a quarter of the MSE of `random`.
const POINTS: [&str; 3] = ["sobol", "halton", "random"];

/// A reference that is at hand, or could be.
pub(crate) enum Wanted {
    /// A file from elsewhere, looked through.
    File(Reference),
    /// To be rendered, unless it was: its record but for its own variance, and where it is kept.
    Rendered { record: Reference, path: PathBuf },
}

impl Wanted {
    pub(crate) fn record(&self) -> &Reference {
        match self {
            Self::File(record) | Self::Rendered { record, .. } => record,
        }
    }
}

/// Where a study keeps its references: in its folder, or in one that several share.
pub(crate) struct Shelf<'a> {
    pub(crate) folder: &'a Path,
    pub(crate) shared: Option<&'a Path>,
}

impl Shelf<'_> {
    /// The file with this name: as a study's record calls it, and where it is.
    fn place(&self, name: &str) -> Result<(String, PathBuf), StudyError> {
        let make = |folder: &Path| {
            std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "make the folder of references", e))
        };
        match self.shared {
            None => {
                let folder = self.folder.join("references");
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

/// Says what a scene's reference is, and refuses a file that is not.
pub(crate) fn want(plan: &Plan, scene: &ScenePlan, subject: &Subject, shelf: &Shelf<'_>) -> Result<Wanted, StudyError> {
    if let Some(file) = &scene.reference {
        return Ok(Wanted::File(given(plan, file, subject)?));
    }
    let points = POINTS.iter().find(|p| plan.methods.iter().all(|m| kind(&m.points) != **p)).unwrap_or(&"random");
    let settings = settings(plan.reference_spp, points, subject)?;
    let mut key = Digest::new();
    for (name, value) in &settings {
        key.text(name);
        key.text(value);
    }
    let hash = key.hex();
    let (file, path) = shelf.place(&format!("{}-{}.exr", file_name(&name_of(&subject.view.source)), &hash[..16]))?;
    let record = Reference {
        file,
        spp: Some(plan.reference_spp),
        points: Some((*points).to_owned()),
        seeds: Some(SEEDS),
        relmse: None,
        hash,
    };
    Ok(Wanted::Rendered { record, path })
}

/// Everything that a rendered reference depends on.
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

/// Finds the reference, or renders it, and says what its own variance is; `None` where `monitor` said stop.
pub(crate) fn obtain(
    wanted: Wanted,
    subject: &Subject,
    monitor: &mut dyn Monitor,
) -> Result<Option<Reference>, StudyError> {
    let (mut record, path) = match wanted {
        Wanted::File(record) => return Ok(Some(record)),
        Wanted::Rendered { record, path } => (record, path),
    };
    // A file that is broken, or another's, is made anew.
    let kept = Truth::read(&path).ok();
    let kept = kept.filter(|(t, about)| about.says("study-key") == Some(&record.hash) && t.variance.is_some());
    let truth = match kept {
        Some((truth, _)) => Some(truth),
        None => render(&record, subject, monitor)?.map(|truth| keep(&path, truth, &record, subject)).transpose()?,
    };
    let Some(truth) = truth else { return Ok(None) };
    record.relmse = truth.own_relmse();
    Ok(Some(record))
}

/// Two halves by two seeds.
fn render(record: &Reference, subject: &Subject, monitor: &mut dyn Monitor) -> Result<Option<Truth>, StudyError> {
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
    Ok(Some(Truth::of_halves(subject.view.resolution, [&halves[0], &halves[1]])))
}

/// Writes it with all that it depends on in its header.
fn keep(path: &Path, truth: Truth, record: &Reference, subject: &Subject) -> Result<Truth, StudyError> {
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

/// A file from elsewhere: refused where its size differs, or what it says about itself.
fn given(plan: &Plan, file: &Path, subject: &Subject) -> Result<Reference, StudyError> {
    let (whole, about) = Truth::read(file)?;
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
        return Err(refuse(format!("it is no number at column {x}, row {y}: mend or replace it")));
    }
    differences(plan, &about, subject).map_or(Ok(()), |why| Err(refuse(why)))?;
    let number = |key: &str| about.says(key).and_then(|text| text.parse().ok());
    let seeds = about.says("study-seeds").and_then(|text| {
        let (a, b) = text.split_once(',')?;
        Some([a.parse().ok()?, b.parse().ok()?])
    });
    Ok(Reference {
        file: std::path::absolute(file).unwrap_or_else(|_| file.to_owned()).display().to_string(),
        spp: number("study-spp"),
        points: about.says("study-points").or(about.says("points")).map(str::to_owned),
        seeds,
        relmse: truth.own_relmse(),
        hash: about.digest.hex(),
    })
}

/// What the header of `dapple render` or of a study's reference says that is not so here.
fn differences(plan: &Plan, about: &About, subject: &Subject) -> Option<String> {
    let depth = depth(subject);
    let scene = &subject.scene.name;
    let expected = [
        (
            "study-scene",
            subject.content.hex(),
            "the scene's files have other contents now: leave the reference out to have one rendered",
        ),
        ("study-max-depth", depth.clone(), "render it with the study's depth, or give the study its depth"),
        ("scene", scene.clone(), "it shows another scene"),
        ("max-depth", depth, "render it with the study's depth, or give the study its depth"),
        ("without", "none".into(), "effects are left out of it"),
        ("interrupted", "false".into(), "it is unfinished"),
        ("pixel-filter", "box filter of radius 0.5 x 0.5".into(), "render it with --pixel-filter box, as a study does"),
    ];
    for (key, here, advice) in expected {
        if let Some(there) = about.says(key).filter(|there| *there != here) {
            return Some(format!("its {} is {there}, and the study's {here}: {advice}", key.replace('-', " ")));
        }
    }
    // A run's own samples in the reference would hide their error.
    let points = kind(about.says("points")?);
    let seed = about.says("seed")?.parse().ok()?;
    let shares = plan.seeds.contains(&seed) && plan.methods.iter().any(|m| kind(&m.points) == points);
    shares.then(|| format!("its points are {points} of seed {seed}, as those of runs are: render it with another seed"))
}

/// The name without parameters.
fn kind(words: &str) -> &str {
    words.split(':').next().unwrap_or(words).trim()
}

/// A name as part of a file name.
pub(crate) fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    name.chars().map(plain).take(80).collect()
}
