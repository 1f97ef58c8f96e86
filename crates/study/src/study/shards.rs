//! Studies in shards: every machine makes some of the runs in a folder of its own, and the folders are merged.

use super::manifest;
use crate::run_log::RunLog;
use crate::{Machine, Manifest, Run, StudyError};
use dapple_scene::image::write_file;
use std::path::Path;

/// Merges the runs of studies with the same settings into the study in `folder`, which is created. Returns the number of
/// its runs.
///
/// Runs that are there already are skipped, so that a merge can be repeated when more are finished. Images and references
/// are copied. If the machines differ, [`Run::machine`] names that of each run.
///
/// # Errors
///
/// [`StudyError::AnotherStudy`] with the differences if the settings differ, and errors of the disk.
pub fn merge_studies(shards: &[impl AsRef<Path>], folder: &Path) -> Result<usize, StudyError> {
    let read = |shard: &Path| -> Result<Manifest, StudyError> {
        let missing = || StudyError::AnotherStudy {
            folder: shard.to_owned(),
            differences: vec!["it holds no study: study.json is missing".into()],
        };
        manifest::read(&shard.join("study.json"))?.ok_or_else(missing)
    };
    let manifests = shards.iter().map(|shard| read(shard.as_ref())).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = manifests.first() else { return Ok(0) };
    std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "make the folder", e))?;
    let file = folder.join("study.json");
    let there = manifest::read(&file)?;
    let others = shards.iter().map(|shard| shard.as_ref()).zip(&manifests);
    for (path, other) in others.chain(there.iter().map(|there| (folder, there))) {
        let differences = manifest::differences(other, &Manifest { machine: other.machine.clone(), ..first.clone() });
        if !differences.is_empty() {
            return Err(StudyError::AnotherStudy { folder: path.to_owned(), differences });
        }
    }
    let several = manifests.iter().chain(&there).any(|other| name(&other.machine) != name(&first.machine));
    let mut log = RunLog::open(&folder.join("runs.jsonl"))?;
    let mut runs: Vec<(usize, Run)> = Vec::new();
    for (number, shard) in shards.iter().enumerate() {
        let path = shard.as_ref().join("runs.jsonl");
        let own = RunLog::open(&path)?;
        runs.extend(own.runs().iter().map(|run| (number, run.clone())));
    }
    runs.sort_by_key(|(_, run)| place(first, run));
    for (number, mut run) in runs {
        if log.runs().iter().any(|there| there.is_same_as(&run)) {
            continue;
        }
        for image in [&run.image, &run.sample_map].into_iter().flatten() {
            copy(shards[number].as_ref(), folder, image)?;
        }
        if several {
            run.machine = run.machine.or_else(|| Some(name(&manifests[number].machine)));
        }
        log.append(run)?;
    }
    for scene in &first.scenes {
        copy(shards[0].as_ref(), folder, &scene.reference.file)?;
    }
    if there.is_none() {
        write_file(&file, &manifest::bytes(first))?;
    }
    Ok(log.runs().len())
}

/// The place of a run in the order in which one machine makes all.
fn place(manifest: &Manifest, run: &Run) -> [usize; 4] {
    let of = |at: Option<usize>| at.unwrap_or(usize::MAX);
    [
        of(manifest.scenes.iter().position(|scene| scene.name == run.scene)),
        of(manifest.seeds.iter().position(|seed| *seed == run.seed)),
        of(manifest.spp.iter().position(|spp| run.budget == crate::RunBudget::Spp(*spp))),
        of(manifest.methods.iter().position(|method| *method == run.method)),
    ]
}

/// A machine's processor and threads in words.
fn name(machine: &Machine) -> String {
    let processor = machine.processor.as_deref().unwrap_or("unknown processor");
    format!("{processor}, {} threads", machine.threads)
}

/// Copies a file whose path is relative to a study's folder; those elsewhere stay where they are.
fn copy(from: &Path, to: &Path, name: &str) -> Result<(), StudyError> {
    let (from, to) = (from.join(name), to.join(name));
    if Path::new(name).is_absolute() || !from.exists() || to.exists() {
        return Ok(());
    }
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(|e| StudyError::file(folder, "make the folder", e))?;
    }
    let bytes = std::fs::read(&from).map_err(|e| StudyError::file(&from, "read the image", e))?;
    Ok(write_file(&to, &bytes)?)
}
