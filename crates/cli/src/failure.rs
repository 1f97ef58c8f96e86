//! Messages for errors and warnings of jobs, with advice that names command-line options.

use crate::Failure;
use crate::render;
use dapple_job::memory::MemoryAdvice;
use dapple_job::{JobError, SpecError, Warning};
use dapple_scene::{Problem, ProblemKind, ReadError};

/// Makes the failure for an error of a job, with one line per line of the error's message.
pub(crate) fn of_job(error: &JobError) -> Failure {
    match error {
        JobError::Spec(error) => of_spec(error),
        JobError::Read(error) => of_reader(error),
        JobError::NotCalledFor { .. } | JobError::Without { .. } => Failure::new(format!("--{error}")),
        JobError::NoShard { .. } => Failure::new(format!("--{error}")),
        JobError::CheckpointExists { path } => {
            let path = path.display();
            Failure::new(format!(
                "{path}: a checkpoint exists; resume from it with --resume {path}, or remove it and {path}.previous"
            ))
        }
        JobError::Memory { estimate, limit, advice } => {
            let advice = match advice {
                MemoryAdvice::Scene if limit.is_given() => {
                    "the scene alone does not fit; raise --memory, or simplify the scene"
                }
                MemoryAdvice::Scene => "the scene alone does not fit; simplify it, or use a machine with more memory",
                MemoryAdvice::Filter => "lower --resolution, use --filter none, or render crops (--crop)",
                MemoryAdvice::AddressSpace => {
                    return Failure::new(format!("this render takes {estimate}; smaller crops (--crop) fit"));
                }
                _ => "lower --resolution, or render crops (--crop)",
            };
            let of = if limit.is_given() {
                "the limit (--memory)"
            } else {
                "all there is (--memory SIZE sets another limit)"
            };
            let limit = limit.bytes().map_or_else(String::new, dapple_job::memory::size);
            Failure::new(format!("this render takes {estimate}, and {limit} is {of}; {advice}"))
        }
        _ => Failure::lines(error),
    }
}

/// Makes the failure for the problems of a scene file. For unsupported features it names the option that allows them.
pub(crate) fn of_reader(error: &ReadError) -> Failure {
    let line = |problem: &Problem| match problem.kind {
        ProblemKind::Unsupported => {
            format!("{}: {}; remove it, or pass --allow-unsupported", problem.source, problem.message)
        }
        _ => problem.to_string(),
    };
    let more = (error.more > 0).then(|| format!("… and {} more problems", error.more));
    Failure(error.problems.iter().map(line).chain(more).collect())
}

/// Makes the failure for an invalid description of a render, with the name of the wrong command-line option.
pub(crate) fn of_spec(error: &SpecError) -> Failure {
    match error {
        SpecError::Field { .. } => Failure::usage("render", option(error)),
        _ => Failure::lines(error),
    }
}

/// A message with the name of the wrong field's command-line option, and the problem.
fn option(error: &SpecError) -> String {
    match error {
        SpecError::Field { field: "seconds", what } => format!("--time: {what}"),
        SpecError::Field { field, what } => format!("--{}: {what}", field.replace('_', "-")),
        _ => error.to_string(),
    }
}

/// The text of a warning, with advice that names command-line options.
pub(crate) fn warning(warning: &Warning) -> String {
    match warning {
        Warning::ErrorNotReached { .. } => format!("{warning}; --max-spp raises the latter"),
        Warning::RejectedSamples { first, .. } => match render::replay(first) {
            Some(advice) => format!("{warning}; {advice}"),
            None => warning.to_string(),
        },
        _ => warning.to_string(),
    }
}
