//! The scenes of a study: image settings, and rendering of images with measured cost.

use crate::{External, Method, Phases, StudyError};
use dapple_core::{Film, Filtered, Needs, render::Monitor};
use dapple_job::memory::MemoryLimit;
use dapple_job::{
    BudgetSpec, ContentHash, CropSpec, JobError, LoadOptions, LoadedScene, PhaseSeconds, PixelFilterSpec,
    PreparedScene, RenderMonitor, RenderSpec, Warning,
};
use dapple_renderer::light::LightSelection;
use dapple_scene::Scene;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// A named scene of a study, with the settings of its images.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct View {
    /// The scene's name in the study.
    pub name: String,
    /// The name of a bundled scene, or the path of a scene file.
    pub source: String,
    /// Width and height of the scene's images in pixels.
    pub resolution: [u32; 2],
    /// The largest number of scattering events between camera and light; `None` uses the scene's limit.
    pub max_depth: Option<u32>,
    /// True if unsupported directives of the scene file are warnings, false if they are errors.
    pub allow_unsupported: bool,
    /// The rule by which light sampling selects one of several lights.
    #[serde(default)]
    pub lights: LightSelection,
    /// The integrator, `NAME` or `NAME:key=value,…`; `auto` selects one for the scene.
    #[serde(default = "auto", skip_serializing_if = "is_auto")]
    pub integrator: String,
}

pub(crate) fn auto() -> String {
    dapple_job::DEFAULT_INTEGRATOR.to_owned()
}

pub(crate) fn is_auto(integrator: &str) -> bool {
    integrator == dapple_job::DEFAULT_INTEGRATOR
}

impl View {
    /// The description of a render of this view, with the default sampler, point set and filter.
    pub(crate) fn spec(&self) -> RenderSpec {
        let [w, h] = self.resolution;
        RenderSpec {
            crop: CropSpec::Whole,
            pixel_filter: PixelFilterSpec::Box,
            max_depth: self.max_depth,
            allow_unsupported: self.allow_unsupported,
            light_selection: Some(self.lights),
            ..RenderSpec::new(self.source.clone()).resolution(w, h).integrator(self.integrator.clone())
        }
    }

    /// The number of pixels of the scene's images.
    pub(crate) fn pixels(&self) -> u64 {
        self.resolution.into_iter().map(u64::from).product()
    }

    /// Returns this view with lights selected by power and the integrator `auto`, for rendering the reference. Views that
    /// differ only in lights and integrator share one reference.
    pub(crate) fn by_default(&self) -> Self {
        Self { lights: LightSelection::Power, integrator: auto(), ..self.clone() }
    }
}

/// A scene of a study that was read and built for tracing. It is uncropped, and its pixel filter is a box one pixel
/// wide.
pub(crate) struct Subject {
    pub(crate) view: View,
    pub(crate) scene: Arc<Scene>,
    /// The hash of all bytes that were read for the scene.
    pub(crate) content: ContentHash,
    /// The scene with the world built from it for tracing.
    pub(crate) prepared: PreparedScene,
}

/// The default name of a scene: the file name without extension, or the name of the folder if the file is called
/// `scene…`.
pub(crate) fn name_of(source: &str) -> String {
    let path = Path::new(source);
    let part = |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned());
    let stem = part(path.file_stem()).unwrap_or_else(|| "scene".into());
    match part(path.parent().and_then(Path::file_name)) {
        Some(folder) if stem.starts_with("scene") => folder,
        _ => stem,
    }
}

impl Subject {
    /// Reads and builds a scene.
    ///
    /// # Errors
    ///
    /// [`StudyError::Load`], with every problem of the scene's files, or for a scene that does not fit into memory.
    pub(crate) fn load(view: &View) -> Result<Self, StudyError> {
        let limit = MemoryLimit::of_machine();
        let loaded = LoadedScene::read(&view.spec(), &LoadOptions { limit, ..LoadOptions::default() })?;
        loaded.memory.check(limit)?;
        let prepared = loaded.build()?;
        let content = prepared.loaded.digest.clone().unwrap_or_default();
        Ok(Self { view: view.clone(), scene: prepared.loaded.scene.clone(), content, prepared })
    }

    /// The warnings of reading the scene, one line each; bundled scenes have none.
    pub(crate) fn notices(&self) -> Vec<String> {
        let notices = self.prepared.loaded.warnings.iter().filter(|warning| matches!(warning, Warning::Notice(_)));
        notices.map(Warning::to_string).collect()
    }

    /// A hash of a few rendered pixels in the middle of the image. It changes if a new version of the renderer computes other
    /// pixels.
    pub(crate) fn fingerprint(&self) -> Result<ContentHash, StudyError> {
        let middle = |side: u32| {
            let first = side.saturating_sub(CANARY_SIDE) / 2;
            (first, side.min(first + CANARY_SIDE))
        };
        let [(x0, x1), (y0, y1)] = self.view.resolution.map(middle);
        let spec = self.view.spec().sampler("uniform").points("random").filter("none").seed(1);
        let spec = RenderSpec { crop: CropSpec::Window([x0, y0, x1, y1]), ..spec.budget(BudgetSpec::Spp(CANARY_SPP)) };
        let image = self.prepared.job(&spec).and_then(|mut job| job.render());
        let film = image.map_err(|e| StudyError::refused(&self.view.name, e))?.film;
        let mut digest = ContentHash::new();
        film.image().as_flattened().iter().for_each(|v| digest.add(&v.to_bits().to_le_bytes()));
        Ok(digest)
    }
}

/// The side in pixels of the square that is rendered for a fingerprint. Rendering it takes milliseconds.
const CANARY_SIDE: u32 = 32;
const CANARY_SPP: f64 = 4.0;

/// The settings for rendering one image: method, seed, samples and external filter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order<'a> {
    pub(crate) method: &'a Method,
    pub(crate) seed: u64,
    /// The total number of samples to trace.
    pub(crate) samples: u64,
    /// The external program that is the method's filter; `None` for built-in filters.
    pub(crate) external: Option<&'a External>,
    /// The number of threads of the external program; 0 means one per core.
    pub(crate) threads: usize,
}

/// A rendered image and its cost.
pub(crate) struct Shot {
    pub(crate) film: Film,
    pub(crate) filtered: Filtered,
    pub(crate) seconds: Phases,
    /// The number of rays traced, first-hit rays included.
    pub(crate) rays: u64,
    pub(crate) cpu_s: Option<f64>,
}

/// Samples that several filters share.
pub(crate) struct Shared {
    /// The scene, the sampler and point set, and the seed and number of samples.
    key: (View, [String; 2], [u64; 2]),
    film: Film,
    cpu_s: Option<f64>,
}

/// Renders an image and measures its cost, including the time of clustering. Time spent in `monitor` does not count. `cpu`
/// returns the user and system seconds of this process so far.
///
/// If `shared` holds samples of the same scene, sampler, points, seed and number, with the statistics that the filter needs,
/// the filter uses them. Otherwise new samples are traced and stored in `shared`.
pub(crate) fn shoot(
    subject: &Subject,
    order: Order<'_>,
    mut shared: Option<&mut Option<Shared>>,
    monitor: &mut dyn Monitor,
    cpu: fn() -> Option<f64>,
) -> Result<Shot, StudyError> {
    let Order { method, seed, samples, external, threads } = order;
    let run = || format!("{}, {method}, seed {seed}, {samples} samples", subject.view.name);
    let wrong = |why: String| StudyError::refused(run(), why);
    let job = |e: JobError| wrong(e.to_string());
    let before = cpu();
    let filter = if external.is_some() { "none" } else { &method.filter };
    let spec = subject.view.spec().sampler(&method.sampler).points(&method.points).filter(filter);
    let spec = spec.seed(seed).budget(BudgetSpec::Samples(samples));
    let mut render = subject.prepared.job(&spec).map_err(job)?;
    let features = |_| Needs::none().with_features();
    render.record(external.map_or(Needs::none(), features));
    let key = (subject.view.clone(), [&method.sampler, &method.points].map(String::clone), [seed, samples]);
    let known = shared.as_ref().and_then(|shared| shared.as_ref());
    let known = known.filter(|known| known.key == key && render.is_recorded_by(&known.film));
    let (film, sampled) = match known {
        Some(known) => (known.film.clone(), known.cpu_s),
        None => {
            let traced = render.run(None, &mut RenderMonitor(monitor)).map_err(job)?;
            if let Some(panicked) = traced.failure {
                return Err(wrong(panicked));
            }
            let cpu_s = cpu().zip(before).map(|(after, before)| after - before);
            if let Some(shared) = &mut shared {
                **shared = Some(Shared { key, film: traced.film.clone(), cpu_s });
            }
            (traced.film, cpu_s)
        }
    };
    let before = cpu();
    let image = match external {
        None => render.finish(film).map_err(job)?,
        Some(external) => {
            let unit = 1.0 / render.world().space().scale();
            let (filtered, seconds) = external.apply(&film, unit, threads).map_err(wrong)?;
            render.finished(film, filtered, external.name.clone(), seconds)
        }
    };
    if let Some(shared) = shared.filter(|_| image.first_hit_rays > 0) {
        // A later use of the samples would not count the first-hit rays.
        *shared = None;
    }
    let PhaseSeconds { load, bvh, cluster, first_hits, plan, trace, filter, .. } = image.seconds;
    // The time of an external program is its reported time, else its wall-clock time.
    let of_filter =
        if external.is_none() { cpu().zip(before).map(|(after, before)| after - before) } else { Some(filter) };
    let cpu_s = sampled.zip(of_filter).map(|(samples, filter)| samples + filter);
    let (seconds, rays) = (Phases { load, bvh, cluster, first_hits, plan, trace, filter }, image.rays());
    Ok(Shot { film: image.film, filtered: image.filtered, seconds, rays, cpu_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_that_people_use() {
        let cases = [
            ("teapot", "teapot"),
            ("a/b/box.pbrt", "box"),
            ("cornell-box/scene-v4.pbrt", "cornell-box"),
            ("scene.pbrt", "scene"),
            ("../x/model.obj", "model"),
        ];
        for (source, name) in cases {
            assert_eq!(name_of(source), name, "{source}");
        }
    }
}
