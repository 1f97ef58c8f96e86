//! The program `dapple`: adaptively sampled images of pbrt-v4 scenes and of models.
//!
//! The program handles arguments, progress and printing; the libraries do all other work.

mod about;
mod compare;
mod denoise;
mod effects;
mod failure;
mod farm;
mod info;
mod machine;
mod output;
mod progress;
mod render;
mod study;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use render::many;
use std::process::ExitCode;

/// The result of the program, from which the exit status follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Done,
    /// A signal ended the program early; the samples taken so far are saved.
    Interrupted,
    /// The render is done, but none of its checkpoints could be written.
    NoCheckpoint,
}

/// An error, as lines that are printed to stderr.
#[derive(Debug)]
struct Failure(Vec<String>);

impl Failure {
    fn new(line: impl ToString) -> Self {
        Self(vec![line.to_string()])
    }

    /// Prints an error about wrong arguments of a subcommand in clap's form, with its usage, and exits with status 2.
    fn usage(command: &str, wrong: impl std::fmt::Display) -> Self {
        let mut arguments = Arguments::command();
        arguments.build();
        let kind = ErrorKind::ValueValidation;
        match arguments.find_subcommand_mut(command) {
            Some(command) => command.error(kind, wrong).exit(),
            None => arguments.error(kind, wrong).exit(),
        }
    }

    /// Converts a message of several lines to a failure; each line is printed as an error.
    fn lines(message: &impl ToString) -> Self {
        Self(message.to_string().lines().map(str::to_owned).collect())
    }
}

type Result<T> = std::result::Result<T, Failure>;

/// Puts Monte Carlo samples where an image needs them.
#[derive(Parser)]
#[command(name = "dapple", version, after_help = include_str!("help/dapple.txt").trim_end(), arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<render::RenderArgs>),
    Merge(many::MergeArgs),
    Plan(many::PlanArgs),
    Compare(compare::CompareArgs),
    Denoise(denoise::DenoiseArgs),
    Info(info::InfoArgs),
    Effects(effects::EffectsArgs),
    Study(Box<study::StudyArgs>),
    Farm(Box<farm::FarmArgs>),
    /// Make one run of a study in a process of its own: reads a request as JSON, prints the run as JSON
    #[command(hide = true)]
    StudyRun,
    /// List the samplers, which decide how many samples each pixel gets, or describe one
    Samplers(about::ListArgs),
    /// List the point sets, which decide where samples lie, describe one, or print its points as CSV
    Points(about::PointsArgs),
    /// List the integrators, which compute the radiance of a sample, or describe one
    Integrators(about::ListArgs),
    /// List the filters (denoisers), which make the image from the samples, or describe one
    #[command(visible_alias = "denoisers")]
    Filters(about::ListArgs),
    Completions(about::CompletionsArgs),
    Man(about::ManArgs),
    Schemas(about::SchemasArgs),
}

fn main() -> ExitCode {
    machine::turn_file_limits_into_errors();
    let arguments = Arguments::try_parse().unwrap_or_else(|error| failure::add_to(error).exit());
    let outcome = match arguments.command {
        Command::Render(args) => render::run(&args),
        Command::Merge(args) => many::merge(&args),
        Command::Plan(args) => many::plan(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Denoise(args) => denoise::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Study(args) => study::run(&args),
        Command::Farm(args) => farm::run(&args),
        Command::StudyRun => study::run_one(),
        Command::Samplers(args) => about::samplers(&args),
        Command::Points(args) => about::points(&args),
        Command::Integrators(args) => about::integrators(&args),
        Command::Filters(args) => about::filters(&args),
        Command::Completions(args) => about::completions(&args),
        Command::Man(args) => about::man(&args),
        Command::Schemas(args) => about::schemas(&args),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Interrupted) => ExitCode::from(130),
        Ok(Outcome::NoCheckpoint) => ExitCode::from(3),
        Err(Failure(lines)) => {
            lines.iter().for_each(|line| output::say("error", line));
            ExitCode::FAILURE
        }
    }
}
