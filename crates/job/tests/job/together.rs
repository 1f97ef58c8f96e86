//! Jobs on several processes and in stages are bit-identical to one process, with the default sampler, light selection and
//! filter.

use dapple_core::render::{Control, NoMonitor, Status};
use dapple_distributed::{Processes, local};
use dapple_job::checkpoint::{StateFile, StateKind};
use dapple_job::{
    BudgetSpec, CheckpointOptions, Checkpoints, Job, JobError, JobMonitor, LoadOptions, LoadedScene, OutputFiles,
    PartNumber, PlanFile, PreparedScene, RenderSpec, RenderedImage, RowsFiles, Traced,
};
use std::path::{Path, PathBuf};

fn spec(scene: &str) -> RenderSpec {
    RenderSpec::new(scene).resolution(24, 72).budget(BudgetSpec::Spp(17.0))
}

fn prepared(spec: &RenderSpec) -> PreparedScene {
    LoadedScene::read(spec, &LoadOptions::default()).and_then(LoadedScene::build).unwrap()
}

fn job(prepared: &PreparedScene, spec: &RenderSpec) -> Job {
    let mut job = prepared.clone().job(spec).unwrap();
    job.set_outputs(OutputFiles::images(&["a.exr".into()]).unwrap());
    job
}

/// The description with its scene, and the bits of its image by one process.
fn rendered(spec: RenderSpec) -> (RenderSpec, PreparedScene, Vec<u64>) {
    let prepared = prepared(&spec);
    let wanted = bits(&job(&prepared, &spec).render().unwrap());
    (spec, prepared, wanted)
}

/// All values of an image as bits.
fn bits(image: &RenderedImage) -> Vec<u64> {
    let film = &image.film;
    let record = film.record();
    let mut bits = vec![record.samples, record.rays, record.blocks, record.rejected];
    bits.extend(&record.budgets);
    let floats = image.filtered.radiance.iter().flatten().chain(image.filtered.error.iter().flatten());
    bits.extend(floats.map(|v| u64::from(v.to_bits())));
    for i in 0..film.frame().pixels() {
        bits.push(film.count(i));
        bits.extend(film.mean(i).iter().chain(&film.moments(i).m2).map(|v| v.to_bits()));
        bits.extend(format!("{:?}", film.features(i)).bytes().map(u64::from));
    }
    bits
}

/// Renders with processes that are threads. Process 0 is `first`; a process whose rank is `stops` is stopped at once.
fn together(
    prepared: &PreparedScene,
    spec: &RenderSpec,
    size: u32,
    stops: Option<u32>,
    first: &mut dyn FnMut(&mut Job, &mut dyn Processes) -> Result<Traced, JobError>,
) -> Result<Traced, JobError> {
    std::thread::scope(|threads| {
        let mut ends = local(size).into_iter();
        let mut coordinator = ends.next().expect("a process");
        for mut end in ends {
            threads.spawn(move || {
                let stopped = stops == Some(end.rank());
                job(prepared, spec).serve(&mut end, &mut || stopped).unwrap();
            });
        }
        first(&mut job(prepared, spec), &mut coordinator)
    })
}

#[test]
fn processes_render_the_default_image_of_six_scenes_with_the_bits_of_one() {
    let limited = (spec("cornell").budget(BudgetSpec::Error(0.02)), &[2][..]);
    let scenes = [
        ("cornell", &[1, 2, 7][..]),
        ("teapot", &[2]),
        ("many-lights", &[7]),
        ("glass", &[2]),
        ("motion", &[7]),
        ("caustic", &[2]),
    ];
    for (spec, sizes) in scenes.map(|(scene, sizes)| (spec(scene), sizes)).into_iter().chain([limited]) {
        let (spec, prepared, wanted) = rendered(spec);
        for &size in sizes {
            let traced = together(&prepared, &spec, size, None, &mut |job, end| {
                job.coordinate(None, &mut NoMonitor, end, &mut || false)
            });
            let film = traced.unwrap().film;
            let image = job(&prepared, &spec).finish(film).unwrap();
            assert!(bits(&image) == wanted, "{spec:?}, {size} processes");
        }
    }
}

/// Stops after some stages, and records where a resumed render starts.
struct Stops {
    after: u32,
    resumed: Option<f64>,
}

impl JobMonitor for Stops {
    fn progress(&mut self, _: &Status<'_>) -> Control {
        self.after = self.after.saturating_sub(1);
        if self.after == 0 { Control::Stop } else { Control::Continue }
    }

    fn resumed(&mut self, spp: f64) {
        self.resumed = Some(spp);
    }
}

fn opened(path: &Path) -> Option<Checkpoints> {
    CheckpointOptions { keep: Some(path.into()), resume: Some(path.into()), every: None }.open().unwrap()
}

#[test]
fn a_render_that_was_stopped_goes_on_from_its_checkpoint_with_any_number_of_processes() {
    let (spec, prepared, wanted) = rendered(spec("many-lights"));
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let run = |size, stops, after| {
        let mut watched = Stops { after, resumed: None };
        let traced = together(&prepared, &spec, size, stops, &mut |job, end| {
            job.coordinate(opened(&path), &mut watched, end, &mut || false)
        });
        (traced.unwrap(), watched.resumed)
    };
    let (stopped, from) = run(3, None, 2);
    assert!(stopped.film.record().interrupted && from.is_none());
    assert_eq!(stopped.checkpoint.map(|saved| saved.is_ok()), Some(true));
    // One of seven processes is stopped within a stage, whose rows are discarded.
    let (again, from) = run(7, Some(4), u32::MAX);
    let spp = again.film.record().samples as f64 / f64::from(24 * 72);
    assert!(again.film.record().interrupted && from.is_some_and(|from| from > 0.0 && from <= spp), "{from:?}, {spp}");
    let (done, from) = run(2, None, u32::MAX);
    assert!(from == Some(spp));
    let image = job(&prepared, &spec).finish(done.film).unwrap();
    assert!(bits(&image) == wanted);
}

#[test]
fn a_damaged_checkpoint_is_refused_with_the_reason_and_its_older_version_taken() {
    let spec = spec("cornell").budget(BudgetSpec::Spp(2.0));
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let run = || job(&prepared, &spec).run(opened(&path), &mut NoMonitor).map(|_| ());
    assert!(run().is_ok());
    let bytes = std::fs::read(&path).expect("it is there");
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 1;
    // A file whose state is invalid but whose header is valid.
    let file = StateFile::from_bytes(bytes.clone()).unwrap();
    let empty = StateFile::new(StateKind::Checkpoint, file.identity, dapple_core::container::begin(0));
    for (damaged, what) in [
        (&bytes[..bytes.len() - 9], "the file is truncated"),
        (&changed, "a checksum is wrong"),
        (empty.bytes(), "checkpoint: "),
    ] {
        std::fs::write(&path, damaged).expect("written");
        let _ = std::fs::remove_file(folder.path().join("checkpoint.previous"));
        let error = run().expect_err("damaged").to_string();
        assert!(error.contains(what) && error.contains("checkpoint: "), "{error}");
        // The other processes end with process 0, instead of waiting for it.
        let together = together(&prepared, &spec, 3, None, &mut |job, end| {
            job.coordinate(opened(&path), &mut NoMonitor, end, &mut || false)
        });
        assert!(together.err().is_some_and(|e| e.to_string().contains(what)));
    }
    std::fs::write(folder.path().join("checkpoint.previous"), &bytes).expect("written");
    std::fs::write(&path, &changed).expect("written");
    assert!(run().is_ok());
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    path
}

/// Traces a part of a stage, to a file.
fn part(job: &mut Job, plan: &PlanFile, shard: &str, folder: &Path) -> Result<PathBuf, JobError> {
    let bytes = job.trace_part(Some(plan), shard.parse().expect("a part"), None, &mut NoMonitor)?;
    Ok(written(folder, &shard.replace('/', "-of-"), &bytes.expect("nothing stops it")))
}

fn rows(paths: &[PathBuf]) -> RowsFiles {
    RowsFiles::read(paths).unwrap()
}

#[test]
fn stages_in_files_have_the_bits_of_one_process() {
    for scene in ["many-lights", "motion"] {
        let (spec, prepared, wanted) = rendered(spec(scene));
        let folder = tempfile::tempdir().expect("a folder");
        let new = || job(&prepared, &spec);
        let mut bytes = new().first_plan().unwrap();
        let image = loop {
            let path = written(folder.path(), "plan", &bytes);
            let plan = PlanFile::read(&path).unwrap();
            let parts = ["1/3", "2/3", "3/3"].map(|shard| part(&mut new(), &plan, shard, folder.path()).unwrap());
            let (next, is_done) = new().next_plan(&plan, &rows(&parts)).unwrap();
            bytes = next;
            if is_done {
                let plan = PlanFile::read(&written(folder.path(), "plan", &bytes)).unwrap();
                let traced = new().finish_plan(&plan).unwrap();
                break new().finish(traced.film).unwrap();
            }
        };
        assert!(bits(&image) == wanted, "{scene}");
    }
}

#[test]
fn plans_and_parts_of_another_render_are_refused_with_a_list() {
    let (here, other) = (spec("cornell").sampler("uniform"), spec("cornell").sampler("uniform").seed(9));
    let prepared = prepared(&here);
    let folder = tempfile::tempdir().expect("a folder");
    let plan = |spec: &RenderSpec, name: &str| {
        let bytes = job(&prepared, spec).first_plan().unwrap();
        PlanFile::read(&written(folder.path(), name, &bytes)).unwrap()
    };
    let (mine, theirs) = (plan(&here, "a.plan"), plan(&other, "b.plan"));
    let error =
        part(&mut job(&prepared, &here), &theirs, "1/2", folder.path()).expect_err("another render").to_string();
    assert!(
        error.contains("b.plan: the file belongs to another render") && error.contains("seed: 9, not 1"),
        "{error}"
    );
    let first = part(&mut job(&prepared, &here), &mine, "1/2", folder.path()).unwrap();
    let second = part(&mut job(&prepared, &other), &theirs, "2/2", folder.path()).unwrap();
    let cut = written(folder.path(), "cut", &std::fs::read(&first).expect("a part")[..300]);
    let listed = |outcome: Option<JobError>| match outcome {
        Some(JobError::Parts(lines)) => lines.join("\n"),
        other => panic!("{:?}", other.map(|e| e.to_string())),
    };
    let read = listed(RowsFiles::read(&[first.clone(), second, cut, folder.path().join("nowhere")]).err());
    for wanted in [
        "2-of-2: the part belongs to another render",
        "seed: 9, not 1",
        "cut: the file is ",
        "nowhere: there is no such file",
    ] {
        assert!(read.contains(wanted), "{wanted}: {read}");
    }
    let joined = |paths: &[PathBuf]| listed(job(&prepared, &here).next_plan(&mine, &rows(paths)).err());
    assert!(joined(std::slice::from_ref(&first)).contains("are missing"));
    assert!(joined(&[first.clone(), first]).contains("the rows were joined already"));
    let early = job(&prepared, &here).finish_plan(&mine).err().expect("samples are left").to_string();
    assert!(early.contains("samples are left"), "{early}");
}

/// Stops once there is a file.
struct StopsAtFile<'a>(&'a Path);

impl JobMonitor for StopsAtFile<'_> {
    fn progress(&mut self, _: &Status<'_>) -> Control {
        if self.0.exists() { Control::Stop } else { Control::Continue }
    }
}

/// A stopped part resumes with the rows that it lacks.
#[test]
fn a_stopped_part_goes_on_from_its_checkpoint() {
    let spec = spec("cornell").sampler("uniform");
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = job(&prepared, &spec).first_plan().unwrap();
    let plan = PlanFile::read(&written(folder.path(), "plan", &bytes)).unwrap();
    let shard: PartNumber = "1/1".parse().expect("a part");
    let path = folder.path().join("checkpoint");
    let trace = |checkpoints, monitor: &mut dyn JobMonitor| {
        let traced = job(&prepared, &spec).trace_part(Some(&plan), shard, checkpoints, monitor);
        traced.unwrap()
    };
    let whole = trace(None, &mut NoMonitor).expect("nothing stops it");
    assert!(trace(opened(&path), &mut StopsAtFile(&path)).is_none());
    let saved = std::fs::read(&path).expect("a checkpoint");
    let rows = |bytes: Vec<u8>| StateFile::from_bytes(bytes).unwrap().rows().count();
    assert!((1..8).contains(&rows(saved)), "stopped within the part");
    let went_on = trace(opened(&path), &mut NoMonitor).expect("nothing stops it");
    assert_eq!(rows(went_on), rows(whole));
}
