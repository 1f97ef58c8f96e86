//! The settings on which a render's samples depend: its description and the digest of the scene.

use super::Job;
use crate::JobError;
use crate::checkpoint::Identity;
use dapple_scene::PixelFilter;
use std::path::Path;

/// The identity's key for the filter. Only parts have it, since a checkpoint may be finished with another filter.
pub(super) const FILTER: &str = "filter";
/// The identity's key for the render's description as JSON, which is never compared.
pub(super) const SPEC: &str = "spec";

/// The identity's key for the path of the plan file, which is never compared.
pub(super) const PLAN: &str = "plan";
/// The identity's key for the part of the stage, `I/N`, whose rows are in the file.
pub(super) const PART: &str = "part";

/// The identity of a job: all settings that its samples depend on. The budget, which may be raised, and the number of
/// threads, which does not change the samples, are not compared.
pub(super) fn identity(job: &Job) -> Result<Identity, JobError> {
    let (spec, scene, frame) = (&job.spec, &job.prepared.loaded.scene, &job.frame);
    let digest = job.prepared.loaded.digest.as_ref().ok_or(JobError::NoDigest)?;
    let [[w, h], [x, y], [cw, ch]] = [frame.resolution(), frame.origin(), frame.size()];
    let without: Vec<&str> = job.prepared.loaded.without.iter().map(|effect| effect.name()).collect();
    let mut pairs = vec![
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", scene.name.clone()),
        ("scene files", digest.hex()),
        ("sampler", job.described.clone()),
        ("points", job.points.clone()),
        ("integrator", job.integrator.clone()),
        ("seed", spec.seed.to_string()),
        ("light selection", spec.selection().name().to_owned()),
        ("pixel filter", pixel_filter(&scene.film.pixel_filter)),
        ("max depth", scene.max_depth.map_or("none".into(), |depth| depth.to_string())),
        ("without", without.join(",")),
        ("resolution", format!("{w}x{h}")),
        ("window", format!("{x},{y},{},{}", x + cw, y + ch)),
        ("samples per pixel", format!("{} to {}", job.limits.min_spp, job.limits.max_spp)),
        (SPEC, spec.to_json()?),
    ];
    if spec.part.is_some() {
        pairs.push((FILTER, job.filter.describe()));
    }
    Ok(Identity::new(pairs))
}

/// Returns an error if `there`, the settings of the file at `path`, differ from `here`, the settings of this render.
pub(super) fn same_render(path: &Path, here: &Identity, there: &Identity) -> Result<(), JobError> {
    match here.differences(there) {
        differences if differences.is_empty() => Ok(()),
        differences => Err(JobError::OtherRender { path: path.to_owned(), differences }),
    }
}

/// The pairs of an identity that must be equal for a checkpoint to be resumed.
pub(super) fn compared(identity: &Identity) -> Identity {
    without(identity, &[SPEC, PLAN])
}

/// The pairs of an identity that must be equal in all parts of one image.
pub(super) fn common(identity: &Identity) -> Identity {
    without(identity, &[SPEC, PART])
}

/// The pairs of an identity that must be equal in a file of rows and in the job that merges the file.
pub(super) fn joined(identity: &Identity) -> Identity {
    without(identity, &[SPEC, PART, PLAN, FILTER])
}

fn without(identity: &Identity, names: &[&str]) -> Identity {
    Identity::new(identity.pairs().iter().filter(|(name, _)| !names.contains(&name.as_str())).cloned())
}

/// Describes a pixel filter in a phrase, such as `box filter of radius 0.5 x 0.5`.
pub fn pixel_filter(filter: &PixelFilter) -> String {
    match filter {
        PixelFilter::Box { radius: [x, y] } => format!("box filter of radius {x} x {y}"),
        PixelFilter::Triangle { radius: [x, y] } => format!("triangle filter of radius {x} x {y}"),
        PixelFilter::Gaussian { radius: [x, y], sigma } => {
            format!("Gaussian filter of radius {x} x {y}, sigma {sigma}")
        }
    }
}
