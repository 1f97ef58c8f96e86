//! Jobs are bit-identical however they are divided, saved and merged.

use dapple_core::container;
use dapple_core::render::{Control, NoMonitor, Status};
use dapple_job::checkpoint::{Identity, StateFile, StateKind};
use dapple_job::{
    BudgetSpec, CheckpointOptions, Job, JobError, JobMonitor, LoadOptions, LoadedScene, PartNumber, PixelFilterSpec,
    RenderSpec, RowsFiles,
};
use std::path::{Path, PathBuf};

fn spec() -> RenderSpec {
    RenderSpec::new("cornell").sampler("uniform").filter("none").resolution(16, 12).budget(BudgetSpec::Spp(6.0))
}

fn render(spec: &RenderSpec) -> Vec<[f32; 3]> {
    let image = Job::prepare(spec).and_then(|mut job| job.render());
    image.unwrap().filtered.radiance
}

fn shards(folder: &Path, spec: &RenderSpec, of: u32) -> Vec<PathBuf> {
    let shard = |index| {
        let shard: PartNumber = format!("{}/{of}", index + 1).parse().expect("a part");
        let spec = RenderSpec { part: Some(shard), ..spec.clone() };
        let mut job = Job::prepare(&spec).unwrap();
        let bytes = job.trace_part(None, shard, None, &mut NoMonitor).unwrap();
        let path = folder.join(format!("{index}.shard"));
        std::fs::write(&path, bytes.expect("nothing stops it")).expect("written");
        path
    };
    (0..of).map(shard).collect()
}

#[test]
fn merged_shards_have_the_bits_of_one_machine() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = RowsFiles::read(&shards(folder.path(), &spec(), 3)).unwrap();
    let mut job = Job::prepare(&set.spec).unwrap();
    let whole = render(&set.spec);
    let image = job.merge(&set).and_then(|traced| job.finish(traced.film)).unwrap();
    assert_eq!(image.filtered.radiance, whole);
}

/// A render whose counts depend on other machines' samples cannot be sharded.
#[test]
fn a_sampler_that_reads_samples_has_no_shards() {
    let shard: PartNumber = "1/2".parse().expect("a part");
    let spec = RenderSpec { part: Some(shard), ..spec().sampler("variance") };
    let mut job = Job::prepare(&spec).unwrap();
    let error = job.trace_part(None, shard, None, &mut NoMonitor).expect_err("it reads").to_string();
    assert!(error.contains("render in stages"), "{error}");
}

/// The file holds the description, not the arguments of a command line.
#[test]
fn a_shard_carries_the_description_as_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = &shards(folder.path(), &spec(), 2)[1];
    let file = StateFile::read(path, StateKind::Rows).unwrap();
    let json = file.identity.value("spec").expect("a description");
    let expected = RenderSpec { part: Some("2/2".parse().expect("a part")), ..spec() };
    assert_eq!(RenderSpec::from_json(json).unwrap(), expected);
    let text: Vec<&String> = file.identity.pairs().iter().map(|(_, value)| value).collect();
    assert!(text.iter().all(|value| !value.contains("--")), "{text:?}");
}

#[test]
fn shards_with_a_description_of_another_version_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = shards(folder.path(), &spec(), 1);
    let file = StateFile::read(&paths[0], StateKind::Rows).unwrap();
    let newer = |(name, value): &(String, String)| (name.clone(), value.replace("\"version\":1", "\"version\":9"));
    let identity = Identity::new(file.identity.pairs().iter().map(newer));
    let file = StateFile::new(StateKind::Rows, identity, container::begin(0));
    std::fs::write(&paths[0], file.bytes()).expect("written");
    let error = RowsFiles::read(&paths).err().expect("another version").to_string();
    assert!(error.contains("version 9"), "{error}");
}

/// Stops after the first slice.
struct Impatient;

impl JobMonitor for Impatient {
    fn progress(&mut self, _: &Status<'_>) -> Control {
        Control::Stop
    }
}

#[test]
fn a_resumed_render_has_the_bits_of_one_that_was_not_stopped() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("c");
    let spec = spec().sampler("variance").budget(BudgetSpec::Spp(12.0));
    let open =
        || CheckpointOptions { keep: Some(path.clone()), resume: Some(path.clone()), every: None }.open().unwrap();
    let mut job = Job::prepare(&spec).unwrap();
    let stopped = job.run(open(), &mut Impatient).unwrap();
    assert!(stopped.film.record().interrupted && stopped.checkpoint.is_some_and(|saved| saved.is_ok()));
    // Another render cannot resume from the file; the error names the difference.
    let mut other = Job::prepare(&spec.clone().seed(2)).unwrap();
    let refused = other.run(open(), &mut NoMonitor).err().expect("another render");
    assert!(matches!(refused, JobError::OtherRender { .. }) && refused.to_string().contains("seed: 1, not 2"));
    let mut job = Job::prepare(&spec).unwrap();
    let film = job.run(open(), &mut NoMonitor).unwrap().film;
    assert_eq!(film.image(), render(&spec));
}

#[test]
fn jobs_share_a_prepared_scene_and_refuse_another() {
    let loaded = LoadedScene::read(&spec(), &LoadOptions::default());
    let prepared = loaded.and_then(LoadedScene::build).unwrap();
    let other = spec().seed(5).points("random");
    let image = prepared.job(&other).and_then(|mut job| job.render()).unwrap();
    assert_eq!(image.filtered.radiance, render(&other));
    let elsewhere = prepared.job(&RenderSpec { pixel_filter: PixelFilterSpec::Box, max_depth: Some(1), ..spec() });
    assert!(matches!(elsewhere.err(), Some(JobError::OtherWorld)));
}

#[test]
fn the_clusters_of_a_render_are_those_of_its_sampler_before_those_of_its_filter() {
    let clusters = |sampler: &str, filter: &str| {
        let job = Job::prepare(&spec().sampler(sampler).filter(filter)).unwrap();
        job.clusters().map(|clusters| clusters.clusters().len())
    };
    assert_eq!(clusters("uniform", "none"), None);
    let by_filter = clusters("uniform", "cluster-gaussian:sides=2");
    let by_sampler = clusters("cluster-thesis:normals=90", "none");
    assert!(by_filter.is_some() && by_sampler.is_some());
    assert_eq!(clusters("cluster-thesis:normals=90", "cluster-gaussian:sides=2"), by_sampler);
}

#[test]
fn a_description_chooses_the_integrator() {
    let open = spec().integrator("ambient-occlusion:distance=0.5");
    assert_ne!(render(&open), render(&spec()));
    let wrong = Job::prepare(&spec().integrator("ambient-occlusion:far=1")).err().expect("no such parameter");
    assert!(wrong.to_string().contains("there is no parameter \"far\""), "{wrong}");
}
