//! Jobs of several processes, and in stages: the bits of one process for the default sampler, light selection and filter.

use dapple_core::exchange::{Exchange, InMemory, in_memory};
use dapple_core::{Control, Film, NoMonitor, Shard, Status};
use dapple_job::checkpoint::{Disk, FileSystem, Store};
use dapple_job::{
    BudgetSpec, CheckpointOptions, Checkpoints, Job, JobError, JobMonitor, LoadOptions, LoadedScene, OutputFiles,
    PlanFile, PreparedScene, RenderSpec, RenderedImage, Traced, Warning,
};
use std::fs::File;
use std::path::Path;

/// Five bands of 16 rows: fewer than the largest number of processes.
const RANKS: [u32; 4] = [1, 2, 3, 7];

fn spec(scene: &str) -> RenderSpec {
    RenderSpec::new(scene).resolution(48, 72).budget(BudgetSpec::Spp(17.0))
}

fn prepared(spec: &RenderSpec) -> PreparedScene {
    LoadedScene::read(spec, &LoadOptions::default()).and_then(LoadedScene::build).unwrap_or_else(|e| panic!("{e}"))
}

fn job(prepared: &PreparedScene, spec: &RenderSpec) -> Job {
    let mut job = prepared.clone().job(spec).unwrap_or_else(|e| panic!("{e}"));
    job.set_outputs(OutputFiles::images(&["a.exr".into()]).unwrap_or_else(|e| panic!("{e}")));
    job
}

/// Traces and filters together; returns the bits of the image on process 0.
fn image_together(job: &mut Job, end: &mut InMemory) -> Option<Vec<u64>> {
    let traced = job.run_together(None, &mut NoMonitor, end).unwrap_or_else(|e| panic!("{e}"));
    finished_together(job, traced, end)
}

fn finished_together(job: &Job, traced: Traced, end: &mut InMemory) -> Option<Vec<u64>> {
    let image = job.finish_together(traced.film, end).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(image.is_some(), end.share().index() == 0);
    image.as_ref().map(bits)
}

/// Everything that an image shows, as bits.
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

fn alone(prepared: &PreparedScene, spec: &RenderSpec) -> Vec<u64> {
    bits(&job(prepared, spec).render().unwrap_or_else(|e| panic!("{e}")))
}

/// Runs one thread per process, each with its end of an exchange in memory.
fn together<T: Send>(of: u32, process: impl Fn(InMemory) -> T + Sync) -> Vec<T> {
    std::thread::scope(|threads| {
        let process = &process;
        let running: Vec<_> = in_memory(of).into_iter().map(|end| threads.spawn(move || process(end))).collect();
        running.into_iter().map(|one| one.join().expect("no process panics")).collect()
    })
}

#[test]
fn processes_render_the_default_image_of_six_scenes_with_the_bits_of_one() {
    for scene in ["cornell", "teapot", "many-lights", "glass", "motion", "caustic"] {
        let spec = spec(scene);
        let prepared = prepared(&spec);
        let wanted = alone(&prepared, &spec);
        for of in RANKS {
            let images = together(of, |mut end| image_together(&mut job(&prepared, &spec), &mut end));
            assert!(images.into_iter().flatten().all(|image| image == wanted), "{scene}, {of} processes");
        }
    }
}

#[test]
fn processes_filter_direct_and_indirect_light_with_the_bits_of_one() {
    let image_of = |layers: u32| {
        let spec = spec("cornell").filter(format!("cluster-regression:layers={layers}"));
        let prepared = prepared(&spec);
        let wanted = alone(&prepared, &spec);
        let images = together(3, |mut end| image_together(&mut job(&prepared, &spec), &mut end));
        assert!(images.into_iter().flatten().all(|image| image == wanted), "{layers} layers");
        wanted
    };
    assert_ne!(image_of(1), image_of(2));
}

/// Two halves of counts and means take 2 * 32 bytes per pixel, deviations 2 * 24, features 120, a first hit 76, emission 2 * 12,
/// and indirect light 2 * 24. An EXR file shows all but the last two, a PNG file only counts and means.
#[test]
fn the_writing_process_gets_the_statistics_that_its_files_show() {
    let spec = spec("cornell");
    let prepared = prepared(&spec);
    for (output, bytes) in [("a.exr", 64 + 48 + 120 + 76), ("a.png", 64)] {
        together(3, |mut end| {
            let mut job = job(&prepared, &spec);
            job.set_outputs(OutputFiles::images(&[output.into()]).unwrap_or_else(|e| panic!("{e}")));
            let traced = job.run_together(None, &mut NoMonitor, &mut end).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(Film::bytes_per_pixel(traced.film.needs()), 64 + 48 + 120 + 76 + 24 + 48);
            let image = job.finish_together(traced.film, &mut end).unwrap_or_else(|e| panic!("{e}"));
            if let Some(image) = image {
                assert_eq!(image.film.bytes(), bytes * 48 * 72, "{output}");
            }
        });
    }
}

/// The negative control: a film of some rows has no image.
#[test]
fn the_rows_of_one_process_are_refused_as_an_image() {
    let spec = spec("cornell");
    let prepared = prepared(&spec);
    let errors = together(2, |mut end| {
        let mut job = job(&prepared, &spec);
        let traced = job.run_together(None, &mut NoMonitor, &mut end).unwrap_or_else(|e| panic!("{e}"));
        job.finish(traced.film).err().expect("it is refused").to_string()
    });
    assert!(errors.iter().all(|error| error.contains("make the image by finish_together")), "{errors:?}");
}

/// Three messages agree and compare; the next ones plan the pilot and end it. Nobody reads its pixels.
#[test]
fn a_pilot_moves_few_bytes() {
    let spec = spec("cornell");
    let prepared = prepared(&spec);
    let sent = together(3, |mut end| {
        job(&prepared, &spec).run_together(None, &mut NoMonitor, &mut end).unwrap_or_else(|e| panic!("{e}"));
        end.sent()[3..20].iter().sum::<usize>()
    });
    let pilot = sent.into_iter().max().unwrap_or(0);
    assert!(pilot < 100 * 48 * 72, "{pilot}");
}

#[test]
fn a_limit_of_error_is_that_of_one_process() {
    let spec = spec("cornell").budget(BudgetSpec::Error(0.02));
    let prepared = prepared(&spec);
    let wanted = alone(&prepared, &spec);
    let images = together(2, |mut end| image_together(&mut job(&prepared, &spec), &mut end));
    assert_eq!(images, [Some(wanted), None]);
}

#[test]
fn processes_with_other_scenes_or_settings_list_the_differences() {
    let (first, other) = (spec("cornell"), spec("cornell").seed(9).budget(BudgetSpec::Spp(18.0)));
    let prepared = prepared(&first);
    let errors = together(2, |mut end| {
        let spec = if end.share().index() == 0 { &first } else { &other };
        job(&prepared, spec).run_together(None, &mut NoMonitor, &mut end).err().expect("it is refused").to_string()
    });
    for error in errors {
        for wanted in ["seed: 9 at rank 1, not 1", "budget: Spp(18.0) at rank 1, not Spp(17.0)"] {
            assert!(error.contains(wanted), "{error}");
        }
    }
    // One that cannot even take part ends all.
    let without = LoadedScene::read(&first, &LoadOptions::default().without_digest()).and_then(LoadedScene::build);
    let without = without.unwrap_or_else(|e| panic!("{e}"));
    let errors = together(2, |mut end| {
        let prepared = if end.share().index() == 0 { &prepared } else { &without };
        job(prepared, &first).run_together(None, &mut NoMonitor, &mut end).err().expect("it is refused").to_string()
    });
    assert!(errors[0].contains("rank 1: checkpoints and shards need a digest"), "{}", errors[0]);
    assert!(errors[1].starts_with("checkpoints and shards need a digest"), "{}", errors[1]);
}

/// A disk that is full after some bytes of each file.
struct Full {
    most: u64,
}

impl FileSystem for Full {
    fn write(&self, file: &mut File, bytes: &[u8]) -> std::io::Result<()> {
        match file.metadata()?.len() + bytes.len() as u64 > self.most {
            true => Err(std::io::ErrorKind::StorageFull.into()),
            false => Disk.write(file, bytes),
        }
    }
}

/// Keeps the warnings.
#[derive(Default)]
struct Warned(Vec<String>);

impl JobMonitor for Warned {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }

    fn warn(&mut self, warning: Warning) {
        self.0.push(warning.to_string());
    }
}

/// The checkpoint before stays, all processes end, and the image has all samples.
#[test]
fn a_full_disk_costs_only_the_checkpoint() {
    let spec = spec("cornell");
    let prepared = prepared(&spec);
    let wanted = alone(&prepared, &spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    // Full in the middle of a plane, between two planes, and at once; the last has room enough: the control.
    for most in [100_000, 48 * 72 * 8, 10, u64::MAX] {
        let before = b"the checkpoint before".as_slice();
        std::fs::write(&path, before).expect("written");
        let ends = together(3, |mut end| {
            let disk = || Store::lock_on(&path, Box::new(Full { most })).unwrap_or_else(|e| panic!("{e}"));
            let checkpoints = (end.share().index() == 0).then(|| Checkpoints::on(disk()));
            let (mut job, mut warned) = (job(&prepared, &spec), Warned::default());
            let traced = job.run_together(checkpoints, &mut warned, &mut end).unwrap_or_else(|e| panic!("{e}"));
            let outcome = traced.checkpoint.as_ref().map(|outcome| outcome.as_ref().err().map(ToString::to_string));
            let written = traced.checkpoints_written;
            (finished_together(&job, traced, &mut end), outcome, written, warned.0)
        });
        assert!(ends[0].0.as_ref() == Some(&wanted));
        let (_, outcome, written, warned) = &ends[0];
        let there = std::fs::read(&path).expect("it is there");
        if most < u64::MAX {
            let error = outcome.clone().flatten().expect("the last one failed too");
            assert!(error.contains("cannot write it") && error.contains("an existing file is unchanged"), "{error}");
            assert!(warned.len() == 1 && warned[0].contains("cannot write it") && *written == 0, "{warned:?}");
            assert!(there == before && !folder.path().join("checkpoint.part").exists());
        } else {
            assert!(outcome == &Some(None) && *written > 2 && warned.is_empty() && there.len() > 100_000);
        }
        assert!(ends[1..].iter().all(|end| end.1.is_none() && end.3.is_empty()));
    }
}

/// Stops in the middle of a round.
struct Stops;

impl JobMonitor for Stops {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Stop
    }
}

#[test]
fn a_stop_of_one_process_ends_all_and_leaves_no_checkpoint_of_half_a_round() {
    let spec = spec("cornell").budget(BudgetSpec::Spp(400.0));
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let traced: Vec<Traced> = together(2, |mut end| {
        let index = end.share().index();
        let options = CheckpointOptions::default().keep(&path);
        let checkpoints = if index == 0 { options.open().unwrap_or_else(|e| panic!("{e}")) } else { None };
        let monitor: &mut dyn JobMonitor = if index == 1 { &mut Stops } else { &mut NoMonitor };
        job(&prepared, &spec).run_together(checkpoints, monitor, &mut end).unwrap_or_else(|e| panic!("{e}"))
    });
    assert!(traced.iter().all(|traced| traced.film.record().interrupted));
    assert!(traced[0].checkpoint.is_none() && !path.exists());
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> std::path::PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    path
}

#[test]
fn a_job_in_stages_has_the_bits_of_one_process() {
    for (scene, of, stages) in [("many-lights", 2, 6), ("teapot", 3, 6), ("cornell", 7, 3)] {
        let spec = spec(scene);
        let prepared = prepared(&spec);
        let folder = tempfile::tempdir().expect("a folder");
        let first = job(&prepared, &spec).first_plan().unwrap_or_else(|e| panic!("{e}"));
        let mut plan = PlanFile::read(&written(folder.path(), "0.plan", &first)).unwrap_or_else(|e| panic!("{e}"));
        while !plan.is_done() {
            let part = |index| {
                let shard = Shard::new(index, of).expect("a part");
                let bytes = job(&prepared, &spec).part(&plan, shard, &mut NoMonitor).unwrap_or_else(|e| panic!("{e}"));
                written(folder.path(), &format!("{index}.part"), &bytes.expect("nothing stops it"))
            };
            let parts: Vec<_> = (0..of).map(part).collect();
            assert_eq!(PlanFile::of_part(&parts[0]).unwrap(), folder.path().join(format!("{}.plan", plan.stage())));
            let (bytes, done) = job(&prepared, &spec).next_plan(&plan, &parts).unwrap_or_else(|e| panic!("{e}"));
            let next = written(folder.path(), &format!("{}.plan", plan.stage() + 1), &bytes);
            plan = PlanFile::read(&next).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(plan.is_done(), done);
        }
        assert_eq!(plan.stage(), stages, "{scene}");
        let mut last = job(&prepared, plan.spec());
        let traced = last.finish_plan(&plan).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            bits(&last.finish(traced.film).unwrap_or_else(|e| panic!("{e}"))) == alone(&prepared, &spec),
            "{scene}"
        );
    }
}

#[test]
fn plans_and_parts_of_another_render_are_refused_with_a_list() {
    let (here, other) = (spec("cornell").sampler("uniform"), spec("cornell").sampler("uniform").seed(9));
    let prepared = prepared(&here);
    let folder = tempfile::tempdir().expect("a folder");
    let plan = |name: &str, spec: &RenderSpec| {
        let bytes = job(&prepared, spec).first_plan().unwrap_or_else(|e| panic!("{e}"));
        PlanFile::read(&written(folder.path(), name, &bytes)).unwrap_or_else(|e| panic!("{e}"))
    };
    let (mine, theirs) = (plan("a.plan", &here), plan("b.plan", &other));
    let part = |plan: &PlanFile, spec: &RenderSpec, index| {
        let shard = Shard::new(index, 2).expect("a part");
        job(&prepared, spec).part(plan, shard, &mut NoMonitor).map(|bytes| bytes.expect("nothing stops it"))
    };
    let error = part(&theirs, &here, 0).expect_err("another render").to_string();
    assert!(error.contains("b.plan: the file is of another render") && error.contains("seed: 9, not 1"), "{error}");
    let first = written(folder.path(), "1.part", &part(&mine, &here, 0).unwrap());
    let second = written(folder.path(), "2.part", &part(&theirs, &other, 1).unwrap());
    let cut = written(folder.path(), "cut.part", &part(&mine, &here, 1).unwrap()[..300]);
    let nowhere = folder.path().join("nowhere.part");
    let refused = |parts: &[std::path::PathBuf]| match job(&prepared, &here).next_plan(&mine, parts) {
        Err(JobError::Shards(lines)) => lines.join("\n"),
        other => panic!("{:?}", other.map(|_| ()).map_err(|e| e.to_string())),
    };
    let message = refused(&[first.clone(), second, cut, nowhere]);
    for wanted in
        ["2.part: it is of another render: seed: 9, not 1", "cut.part: it is ", "nowhere.part: there is no such file"]
    {
        assert!(message.contains(wanted), "{message}");
    }
    assert!(refused(std::slice::from_ref(&first)).contains("a.plan: missing parts: 2/2"));
    assert!(refused(&[first.clone(), first]).contains("part 1/2 is given twice"));
    assert!(
        job(&prepared, &here)
            .finish_plan(&mine)
            .err()
            .expect("samples are left")
            .to_string()
            .contains("samples are left")
    );
}

/// A task reads the beginning of a plan file and its own bands. Bands that it doesn't read may be damaged; its own may not.
#[test]
fn a_part_reads_its_own_bands_of_a_plan_only() {
    let spec = RenderSpec::new("cornell").resolution(40, 160).budget(BudgetSpec::Spp(4.0));
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("0.plan");
    let bytes = job(&prepared, &spec).first_plan().unwrap_or_else(|e| panic!("{e}"));
    std::fs::write(&path, &bytes).expect("a plan");
    let read = |of: u32| -> Vec<u64> {
        let one =
            |index| PlanFile::read_part(&path, Shard::new(index, of)?).map_err(Box::<dyn std::error::Error>::from);
        (0..of).map(|index| one(index).unwrap_or_else(|e| panic!("{e}")).bytes_read()).collect()
    };
    let all = PlanFile::read(&path).unwrap_or_else(|e| panic!("{e}")).bytes_read();
    assert_eq!((all, read(1)), (bytes.len() as u64, vec![all]));
    // Ten bands of 16 rows: every part reads the beginning, and all of them read each band once.
    let [five, ten] = [read(5), read(10)];
    let start = (five.iter().sum::<u64>() - all) / 4;
    assert_eq!(ten.iter().sum::<u64>(), all + 9 * start);
    assert!(ten.iter().all(|part| *part == start + (all - start) / 10), "{ten:?}");
    // The counts of the plan are 4 bytes per pixel, and few bytes more.
    assert!(start > 4 * 40 * 160 && start < 4 * 40 * 160 + 8192 && all > 40 * start / 10, "{start} of {all}");

    let message = |bytes: &[u8], index: Option<u32>| -> Option<String> {
        std::fs::write(&path, bytes).expect("a plan");
        let read = match index {
            Some(index) => PlanFile::read_part(&path, Shard::new(index, 10).expect("a shard")),
            None => PlanFile::read(&path),
        };
        read.err().map(|e| e.to_string())
    };
    // The last bytes belong to the last band.
    let mut damaged = bytes.clone();
    *damaged.last_mut().expect("bytes") ^= 1;
    let hit: Vec<u32> = (0..10).filter(|index| message(&damaged, Some(*index)).is_some()).collect();
    assert_eq!(hit.len(), 1, "{hit:?}");
    let said = [message(&damaged, Some(hit[0])), message(&damaged, None)].map(|said| said.unwrap_or_default());
    assert!(said.iter().all(|said| said.contains("0.plan") && said.contains("checksum")), "{said:?}");
    for cut in [10, start as usize - 1, start as usize, bytes.len() - 1] {
        for index in [Some(0), None] {
            let said = message(&bytes[..cut], index).unwrap_or_default();
            assert!(said.contains("0.plan: it is cut short"), "{cut}: {said}");
        }
    }
    damaged = [&bytes[..], b"more"].concat();
    assert!(message(&damaged, Some(0)).is_some_and(|said| said.contains("make no sense")));
    assert_eq!(message(&bytes, Some(0)), None);
}

/// A band of another render's plan fits by its length, and its checksum tells it apart.
#[test]
fn a_plan_with_a_band_of_another_plan_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    // The plans after one stage, whose bands have samples.
    let plan = |seed: u64| {
        let spec = RenderSpec::new("cornell").resolution(40, 160).budget(BudgetSpec::Spp(17.0)).seed(seed);
        let prepared = prepared(&spec);
        let first = job(&prepared, &spec).first_plan().unwrap_or_else(|e| panic!("{e}"));
        let plan = PlanFile::read(&written(folder.path(), "0.plan", &first)).unwrap_or_else(|e| panic!("{e}"));
        let part = job(&prepared, &spec).part(&plan, Shard::new(0, 1).expect("a shard"), &mut NoMonitor);
        let part = written(folder.path(), "0.part", &part.unwrap_or_else(|e| panic!("{e}")).expect("nothing stops it"));
        job(&prepared, &spec).next_plan(&plan, &[part]).unwrap_or_else(|e| panic!("{e}")).0
    };
    let (mine, theirs) = (plan(3), plan(9));
    // Ten bands: all parts together read the beginning ten times, and each band once.
    let path = written(folder.path(), "1.plan", &mine);
    let part = |index| PlanFile::read_part(&path, Shard::new(index, 10).expect("a shard"));
    let read: u64 = (0..10).map(|index| part(index).unwrap_or_else(|e| panic!("{e}")).bytes_read()).sum();
    let all = mine.len() as u64;
    let band = ((all - (read - all) / 9) / 10) as usize;
    // The sixth band shows the scene; those at the edges are black.
    let (from, to) = (mine.len() - 5 * band, mine.len() - 4 * band);
    let shifted = |at: usize| at + theirs.len() - mine.len();
    let swapped = &theirs[shifted(from)..shifted(to)];
    let message = |bytes: &[u8]| {
        let path = written(folder.path(), "1.plan", bytes);
        let parts = (0..10).map(|index| PlanFile::read_part(&path, Shard::new(index, 10).expect("a shard")).err());
        let refused: Vec<_> = std::iter::once(PlanFile::read(&path).err()).chain(parts).flatten().collect();
        refused.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    // The negative control: with its own band, all read it.
    assert!(message(&mine).is_empty());
    let refused = message(&[&mine[..from], swapped, &mine[to..]].concat());
    assert_eq!(refused.len(), 2, "the whole plan and one part: {refused:?}");
    assert!(refused.iter().all(|error| error.contains("1.plan") && error.contains("checksum")), "{refused:?}");
}
