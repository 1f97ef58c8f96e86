//! The program `dapple`: adaptively sampled images of pbrt-v4 scenes and of models.
//!
//! Nothing but argument parsing, progress and calls: what is done is done in the libraries.

mod compare;
mod effects;
mod info;
mod lists;
mod machine;
mod merge;
mod output;
mod price;
mod render;
mod scene;
mod stop;
mod study;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// How the program ended, as the shell sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Done,
    /// A signal ended it early; what was done is saved.
    Interrupted,
}

/// What went wrong: lines for stderr, each a sentence.
#[derive(Debug)]
struct Failure(Vec<String>);

impl Failure {
    fn new(line: impl ToString) -> Self {
        Self(vec![line.to_string()])
    }

    /// One line for each line of a message, so that each stands for itself.
    fn lines(message: &impl ToString) -> Self {
        Self(message.to_string().lines().map(str::to_owned).collect())
    }
}

type Result<T> = std::result::Result<T, Failure>;

/// Puts Monte Carlo samples where an image needs them.
#[derive(Parser)]
#[command(name = "dapple", version, after_help = AFTER, arg_required_else_help = true)]
struct Words {
    #[command(subcommand)]
    command: Command,
}

const AFTER: &str = "\
Examples:
  dapple render                                  the bundled teapot: teapot.exr, teapot.png, teapot-samples.png
  dapple render scene.pbrt -o scene.png --time 30
  dapple compare scene.exr reference.exr
  dapple effects scene.pbrt
  dapple study teapot -o teapot-study              what accuracy costs in time: runs.jsonl, report.html
  dapple price --quick                             what each numerical safeguard costs, and what breaks without it

Results go to stdout, progress and warnings to stderr.
Exit status: 0 done, 1 failed, 2 wrong words, 130 interrupted (what was done is saved).";

#[derive(Subcommand)]
enum Command {
    Render(Box<render::Options>),
    Merge(merge::Options),
    Compare(compare::Options),
    Info(info::Options),
    Effects(effects::Options),
    Price(price::Options),
    Study(Box<study::Options>),
    /// One run of a study, in a process of its own: JSON in, JSON out
    #[command(hide = true)]
    StudyRun,
    /// List the samplers: how many samples each pixel gets
    Samplers,
    /// List the point sets: where samples lie
    Points,
    /// List the filters: what makes an image of the samples
    Filters,
}

fn main() -> ExitCode {
    let outcome = match Words::parse().command {
        Command::Render(options) => render::run(&options),
        Command::Merge(options) => merge::run(&options),
        Command::Compare(options) => compare::run(&options),
        Command::Info(options) => info::run(&options),
        Command::Effects(options) => effects::run(&options),
        Command::Price(options) => price::run(&options),
        Command::Study(options) => study::run(&options),
        Command::StudyRun => study::run_one(),
        Command::Samplers => lists::samplers(),
        Command::Points => lists::points(),
        Command::Filters => lists::filters(),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Interrupted) => ExitCode::from(130),
        Err(Failure(lines)) => {
            lines.iter().for_each(|line| output::say("error", line));
            ExitCode::FAILURE
        }
    }
}
