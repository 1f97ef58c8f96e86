//! Jobs of several processes that go on from a checkpoint.

use dapple_core::exchange::{Exchange, InMemory, in_memory};
use dapple_core::{Control, Error, NoMonitor, Shard, Status};
use dapple_job::checkpoint::{Contents, Identity, Kind, Store};
use dapple_job::{
    BudgetSpec, CheckpointOptions, Job, JobMonitor, LoadOptions, LoadedScene, PreparedScene, RenderSpec, RenderedImage,
    Traced,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

fn spec(scene: &str) -> RenderSpec {
    RenderSpec::new(scene).resolution(48, 72).budget(BudgetSpec::Spp(17.0))
}

fn prepared(spec: &RenderSpec) -> PreparedScene {
    LoadedScene::read(spec, &LoadOptions::default()).and_then(LoadedScene::build).unwrap_or_else(|e| panic!("{e}"))
}

fn job(prepared: &PreparedScene, spec: &RenderSpec) -> Job {
    prepared.clone().job(spec).unwrap_or_else(|e| panic!("{e}"))
}

/// The image and the samples, as bits.
fn bits(image: &RenderedImage) -> Vec<u64> {
    let film = &image.film;
    let mut bits = vec![film.record().samples, film.record().rays];
    let floats = image.filtered.radiance.iter().flatten().chain(image.filtered.error.iter().flatten());
    bits.extend(floats.map(|v| u64::from(v.to_bits())));
    bits.extend((0..film.frame().pixels()).flat_map(|i| film.mean(i).map(f64::to_bits)));
    bits
}

fn alone(prepared: &PreparedScene, spec: &RenderSpec) -> Vec<u64> {
    bits(&job(prepared, spec).render().unwrap_or_else(|e| panic!("{e}")))
}

fn finished_together(job: &Job, traced: Traced, end: &mut dyn Exchange) -> Option<Vec<u64>> {
    let image = job.finish_together(traced.film, end).unwrap_or_else(|e| panic!("{e}"));
    image.as_ref().map(bits)
}

/// Runs one thread per process, each with its end of an exchange in memory.
fn together<T: Send>(of: u32, process: impl Fn(InMemory) -> T + Sync) -> Vec<T> {
    std::thread::scope(|threads| {
        let process = &process;
        let running: Vec<_> = in_memory(of).into_iter().map(|end| threads.spawn(move || process(end))).collect();
        running.into_iter().map(|one| one.join().expect("no process panics")).collect()
    })
}

/// Dies in the middle of a round.
struct Dies {
    in_round: u32,
}

impl JobMonitor for Dies {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        assert!(status.round < self.in_round, "killed");
        Control::Continue
    }
}

/// Notes the number of samples from which the render goes on.
#[derive(Default)]
struct Resumes {
    spp: Option<f64>,
}

impl JobMonitor for Resumes {
    fn slice(&mut self, _: &Status<'_>) -> Control {
        Control::Continue
    }

    fn resumed(&mut self, spp: f64) {
        self.spp = Some(spp);
    }
}

#[test]
fn a_render_whose_process_died_goes_on_from_the_last_barrier_with_any_number_of_processes() {
    let spec = spec("many-lights");
    let prepared = prepared(&spec);
    let wanted = alone(&prepared, &spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    let options = || CheckpointOptions::default().keep(&path).resume(&path);
    // The second of three dies in the second round, then one of seven in the third.
    let mut before = 0.0;
    for (of, in_round) in [(3, 1), (7, 2)] {
        let ends = together(of, |mut end| {
            let index = end.share().index();
            let checkpoints = if index == 0 { options().open().unwrap_or_else(|e| panic!("{e}")) } else { None };
            let mut resumes = Resumes::default();
            let mut dies = Dies { in_round };
            let outcome = catch_unwind(AssertUnwindSafe(|| {
                let monitor: &mut dyn JobMonitor = if index == 1 { &mut dies } else { &mut resumes };
                let ran = job(&prepared, &spec).run_together(checkpoints, monitor, &mut end).map(|_| ());
                drop(end);
                ran
            }));
            (outcome, resumes.spp)
        });
        for (index, (outcome, resumed)) in ends.into_iter().enumerate() {
            match outcome {
                Err(_) => assert_eq!(index, 1),
                Ok(ran) => {
                    assert!(ran.expect_err("one is gone").to_string().contains("a process of this render is gone"))
                }
            }
            if index != 1 && in_round > 1 {
                // The first round was not repeated.
                let spp = resumed.expect("it goes on");
                assert!(spp > before);
                before = if index == 0 { spp - 1e-9 } else { before };
            }
        }
    }
    // All rounds but the one that was cut are kept: two processes end it, and an ordinary render does.
    let images = together(2, |mut end| {
        let checkpoints = if end.share().index() == 0 {
            std::fs::copy(&path, folder.path().join("copy")).expect("a copy");
            let copy = folder.path().join("copy");
            CheckpointOptions::default().resume(copy).open().unwrap_or_else(|e| panic!("{e}"))
        } else {
            None
        };
        let mut job = job(&prepared, &spec);
        let mut resumes = Resumes::default();
        let traced = job.run_together(checkpoints, &mut resumes, &mut end).unwrap_or_else(|e| panic!("{e}"));
        assert!(resumes.spp.expect("it goes on") > before);
        finished_together(&job, traced, &mut end)
    });
    assert!(images[0].as_ref() == Some(&wanted));
    let mut one = job(&prepared, &spec);
    let checkpoints = options().open().unwrap_or_else(|e| panic!("{e}"));
    let traced = one.run(checkpoints, &mut NoMonitor).unwrap_or_else(|e| panic!("{e}"));
    assert!(bits(&one.finish(traced.film).unwrap_or_else(|e| panic!("{e}"))) == wanted);
}

/// An exchange that counts the bytes that a process gets from others.
struct Counted(InMemory, usize);

impl Counted {
    fn count(&mut self, got: &[Vec<u8>]) {
        let me = self.0.share().index() as usize;
        self.1 += got.iter().enumerate().filter(|(who, _)| *who != me).map(|(_, bytes)| bytes.len()).sum::<usize>();
    }
}

impl Exchange for Counted {
    fn share(&self) -> Shard {
        self.0.share()
    }

    fn all_gather(&mut self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, Error> {
        let got = self.0.all_gather(mine)?;
        self.count(&got);
        Ok(got)
    }

    fn all_to_all(&mut self, to_each: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Error> {
        let got = self.0.all_to_all(to_each)?;
        self.count(&got);
        Ok(got)
    }
}

/// Writes the checkpoint of a whole render by one process.
fn checkpoint_at(path: &Path, prepared: &PreparedScene, spec: &RenderSpec) {
    let options = CheckpointOptions::default().keep(path);
    let checkpoints = options.open().unwrap_or_else(|e| panic!("{e}"));
    let traced = job(prepared, spec).run(checkpoints, &mut NoMonitor).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(traced.checkpoint.map(|path| path.is_ok()), Some(true));
}

/// The whole render is done: processes get their rows of the checkpoint, and settings, sums of the training passes and counts.
/// A checkpoint that travels whole to each is the control: its length is known.
#[test]
fn each_process_gets_its_rows_of_a_checkpoint_only() {
    let spec = RenderSpec::new("cornell").resolution(96, 128).budget(BudgetSpec::Spp(4.0));
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    checkpoint_at(&path, &prepared, &spec);
    let length = std::fs::metadata(&path).expect("it is there").len() as usize;
    let wanted = alone(&prepared, &spec);
    let ends = together(4, |end| {
        let mut end = Counted(end, 0);
        let resumed = end.share().index() == 0;
        let options = CheckpointOptions::default().resume(&path);
        let checkpoints = if resumed { options.open().unwrap_or_else(|e| panic!("{e}")) } else { None };
        let mut job = job(&prepared, &spec);
        let traced = job.run_together(checkpoints, &mut NoMonitor, &mut end).unwrap_or_else(|e| panic!("{e}"));
        let got = end.1;
        assert!(!traced.film.is_whole());
        (got, finished_together(&job, traced, &mut end))
    });
    for (got, _) in &ends[1..] {
        assert!(*got < length * 2 / 5, "{got} of {length} bytes");
    }
    assert!(ends[0].1.as_ref() == Some(&wanted));
}

/// One process finds the damage, and all end with its report; the older version of the file is taken where there is one.
#[test]
fn a_damaged_checkpoint_ends_all_processes_with_the_reason() {
    let spec = spec("cornell").budget(BudgetSpec::Spp(2.0));
    let prepared = prepared(&spec);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint");
    checkpoint_at(&path, &prepared, &spec);
    let bytes = std::fs::read(&path).expect("it is there");
    let errors = || {
        together(3, |mut end| {
            let options = CheckpointOptions::default().resume(&path);
            let checkpoints =
                if end.share().index() == 0 { options.open().unwrap_or_else(|e| panic!("{e}")) } else { None };
            let ran = job(&prepared, &spec).run_together(checkpoints, &mut NoMonitor, &mut end);
            ran.err().map(|e| e.to_string())
        })
    };
    let mut changed = bytes.clone();
    changed[bytes.len() / 2] ^= 1;
    // Of another layout within, with a right checksum.
    let Contents { identity, body, .. } = Contents::read(&path, Kind::Checkpoint).unwrap_or_else(|e| panic!("{e}"));
    let cut = |identity: Identity| Contents { kind: Kind::Checkpoint, identity, body: body[..body.len() / 2].to_vec() };
    let inconsistent = cut(identity).to_bytes().unwrap_or_else(|e| panic!("{e}"));
    let faults = [
        (&bytes[..bytes.len() - 9], "it is cut short"),
        (&changed, "its checksum is wrong"),
        (&inconsistent, "they end too early"),
    ];
    for (damaged, what) in faults {
        std::fs::write(&path, damaged).expect("written");
        for (rank, error) in errors().into_iter().enumerate() {
            let error = error.unwrap_or_else(|| panic!("rank {rank} took it"));
            assert!(error.contains(what), "rank {rank}: {error}");
            assert!(rank > 0 || error.contains("checkpoint: "), "{error}");
        }
    }
    std::fs::write(folder.path().join("checkpoint.previous"), &bytes).expect("written");
    std::fs::write(&path, &changed).expect("written");
    assert!(Store::open(&path, Kind::Checkpoint).is_ok_and(|found| found.trouble.is_some()));
    assert_eq!(errors(), [None, None, None]);
}
