//! Renders in stages: plan files, and the parts that machines trace of them.

use super::progress::Progress;
use super::{Live, RenderArgs, Show, load, prepare, roles, values, warn_all};
use crate::machine::start_threads;
use crate::output::{tell, warn};
use crate::stop::Stop;
use crate::{Failure, Outcome, Result, failure};
use dapple_core::Shard;
use dapple_job::memory::MemoryLimit;
use dapple_job::output::FileIdentity;
use dapple_job::{Job, LoadOptions, OutputFiles, PlanFile, RenderSpec, StageTask, Warning};
use dapple_scene::image::{check_writable, write_file};
use std::path::{Path, PathBuf};

/// Options of a process that plans or traces a part.
pub(crate) struct StageOptions {
    pub(crate) threads: u16,
    pub(crate) memory: Option<u64>,
    pub(crate) quiet: bool,
    pub(crate) progress_every: Option<f64>,
}

impl From<&RenderArgs> for StageOptions {
    fn from(args: &RenderArgs) -> Self {
        let RenderArgs { threads, memory, quiet, progress_every, .. } = *args;
        Self { threads, memory, quiet, progress_every }
    }
}

impl StageOptions {
    fn memory(&self) -> MemoryLimit {
        self.memory.map_or_else(MemoryLimit::of_machine, MemoryLimit::given)
    }

    fn progress(&self) -> Result<Progress> {
        let stop = Stop::listen()?;
        start_threads(self.threads)?;
        let show = Show {
            outputs: &[],
            maps: None,
            features: false,
            half: false,
            layers: None,
            exposure: 0.0,
            json: false,
            quiet: self.quiet,
            progress_every: self.progress_every,
        };
        Ok(Progress::new(&show, stop, Live::default()))
    }

    /// The job of a render whose image nobody writes yet; `None` if the user stopped it. `output` may be none of the files
    /// that the scene reads.
    fn job(&self, (spec, task): (&RenderSpec, StageTask), output: &Path, progress: &Progress) -> Result<Option<Job>> {
        progress.phase("reading");
        let limit = self.memory();
        let loaded = load(spec, &LoadOptions::default().with_limit(limit), limit)?;
        roles::check_inputs(&loaded, std::iter::once(("--output", output)))?;
        check_writable(output).map_err(Failure::new)?;
        warn_all(loaded.warnings());
        let Some((mut job, _)) = prepare(loaded, OutputFiles::none(), progress)? else { return Ok(None) };
        let expected = job.memory_in_stages(task).map_err(|e| failure::of_job(&e))?;
        expected.check(limit).map_err(|e| failure::of_job(&e))?;
        Ok(Some(job))
    }
}

/// Plans the first stage of a render, and traces nothing.
pub(crate) fn first(spec: &RenderSpec, output: &Path, options: &StageOptions) -> Result<Outcome> {
    let progress = options.progress()?;
    let Some(mut job) = options.job((spec, StageTask::First), output, &progress)? else {
        return Ok(Outcome::Interrupted);
    };
    progress.phase("planning");
    let bytes = job.first_plan().map_err(|e| failure::of_job(&e))?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        tell(format!("{}: the plan of stage 0; render its parts with --from and --shard I/N", output.display()))?;
    }
    Ok(Outcome::Done)
}

/// Makes the next plan of all parts of one.
pub(crate) fn next(parts: &[PathBuf], from: Option<&Path>, output: &Path, options: &StageOptions) -> Result<Outcome> {
    let named = || PlanFile::of_part(&parts[0]).map_err(|e| failure::of_job(&e));
    let from = from.map_or_else(named, |from| Ok(from.to_owned()))?;
    keep(output, parts.iter().map(|part| ("a part", part.as_path())).chain([("--from", from.as_path())]))?;
    let plan = PlanFile::read(&from).map_err(|e| failure::of_job(&e))?;
    let progress = options.progress()?;
    let Some(mut job) = options.job((plan.spec(), StageTask::Next), output, &progress)? else {
        return Ok(Outcome::Interrupted);
    };
    progress.phase("planning");
    let (bytes, done) = job.next_plan(&plan, parts).map_err(|e| failure::of_job(&e))?;
    write_file(output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !options.quiet {
        let (path, stage) = (output.display(), plan.stage() + 1);
        tell(match done {
            true => format!("{path}: done after {stage} stages; dapple merge makes the image"),
            false => format!("{path}: the plan of stage {stage}"),
        })?;
    }
    Ok(Outcome::Done)
}

/// Traces one part of a plan.
pub(super) fn part(args: &RenderArgs, from: &Path) -> Result<Outcome> {
    let shard = args.shard.ok_or_else(|| Failure::usage("render", "--from needs --shard I/N, the part to trace"))?;
    let plan = PlanFile::read_part(from, shard).map_err(|e| failure::of_job(&e))?;
    let spec = if args.spec.is_some() { args.spec()? } else { plan.spec().clone() };
    let options = StageOptions::from(args);
    let output = match &args.outputs[..] {
        [] => part_name(&spec, &plan, shard),
        [one] if values::has_extension(one, "part") => one.clone(),
        _ => {
            return Err(Failure::usage(
                "render",
                "--from takes one --output, a .part file; dapple plan reads all parts",
            ));
        }
    };
    keep(&output, std::iter::once(("--from", from)))?;
    let mut progress = options.progress()?;
    let Some(mut job) = options.job((&spec, StageTask::Part), &output, &progress)? else {
        return Ok(Outcome::Interrupted);
    };
    progress.begin(&job);
    let Some(bytes) = job.part(&plan, shard, &mut progress).map_err(|e| failure::of_job(&e))? else {
        warn(failure::warning(&Warning::ShardStopped(shard)));
        return Ok(Outcome::Interrupted);
    };
    write_file(&output, &bytes).map_err(Failure::new)?;
    drop(progress);
    if !args.quiet {
        tell(format!(
            "{}: part {shard} of stage {}; dapple plan makes the next plan of all parts",
            output.display(),
            plan.stage()
        ))?;
    }
    Ok(Outcome::Done)
}

/// The default name of a part file.
fn part_name(spec: &RenderSpec, plan: &PlanFile, shard: Shard) -> PathBuf {
    let scene = Path::new(&spec.scene).file_stem().map_or("scene".into(), |stem| stem.to_string_lossy());
    format!("{scene}-{}-{}-of-{}.part", plan.stage(), shard.index() + 1, shard.of()).into()
}

/// Refuses an output that is one of the files read.
fn keep<'a>(output: &Path, inputs: impl Iterator<Item = (&'static str, &'a Path)>) -> Result<()> {
    let written = FileIdentity::of(output);
    for (who, input) in inputs {
        if FileIdentity::of(input).is_same(&written) {
            let (path, input) = (output.display(), input.display());
            let wrong = format!("--output {path}: this is {who} ({input}), which would be lost; write to another file");
            return Err(Failure::new(wrong));
        }
    }
    Ok(())
}
