//! The tables of `docs/results/race.md`: goals of the default sampler and filter beside the measured values, and
//! every method on every scene.
//!
//! `cargo run --release -p dapple-study --example race_tables -- [OPTION DIR]... DIR...` reads folders of finished
//! studies with the same seeds (`docs/results/race.toml` and `race-curves.toml`) and prints Markdown.
//!
//! * `--long DIR`: the baseline alone at larger budgets, for times to equal error.
//! * `--besides DIR`: other methods on the same scenes, for the summaries.
//! * `--lights DIR`: the scenes `room`, `room-uniform` and `room-learned`.
//! * `--foreign DIR`: the same methods against references of another renderer, and the baseline at a very large budget.
//! * `--tuned NAME,…`: scenes that settings were tuned on.
//! * `--plain NAME,…`: scenes without interreflection.

// A report is printed.
#![allow(clippy::print_stdout, clippy::print_stderr)]

mod board;
mod tables;
mod targets;

use board::Board;
use dapple_study::Method;
use std::path::PathBuf;
use std::process::ExitCode;

/// The roles of the compared methods.
pub(crate) struct Roles {
    pub(crate) uniform: Method,
    pub(crate) counts: Method,
    pub(crate) default: Method,
    pub(crate) thesis: Method,
    pub(crate) oidn: Method,
    pub(crate) oidn_on_ours: Method,
    pub(crate) oidn_prefiltered: Method,
}

impl Roles {
    fn new() -> Self {
        let of = |sampler: &str, filter: &str| Method::new(sampler, "sobol", filter);
        Self {
            uniform: of("uniform", "none"),
            counts: of("adaptive:epsilon=0.01", "none"),
            default: of("adaptive:epsilon=0.3", "cluster-regression"),
            thesis: of("cluster-thesis", "cluster-gaussian"),
            oidn: of("uniform", "oidn"),
            oidn_on_ours: of("adaptive:epsilon=0.3", "oidn"),
            oidn_prefiltered: of("uniform", "oidn-prefiltered"),
        }
    }
}

#[derive(Default)]
struct Options {
    studies: Vec<PathBuf>,
    more: Vec<PathBuf>,
    lights: Vec<PathBuf>,
    foreign: Vec<PathBuf>,
    tuned: Vec<String>,
    plain: Vec<String>,
}

impl Options {
    fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut options = Self::default();
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word} needs a value after it"));
            let names = |list: String| list.split(',').map(|name| name.trim().to_owned()).collect();
            match word.as_str() {
                // Their runs are used only if the studies themselves have none.
                "--long" | "--besides" => options.more.push(value()?.into()),
                "--lights" => options.lights.push(value()?.into()),
                "--foreign" => options.foreign.push(value()?.into()),
                "--tuned" => options.tuned = names(value()?),
                "--plain" => options.plain = names(value()?),
                option if option.starts_with('-') => {
                    return Err(format!("unknown option \"{option}\"; see the head of this example"));
                }
                folder => options.studies.push(folder.into()),
            }
        }
        if options.studies.is_empty() {
            return Err("no study; pass the folder of at least one".into());
        }
        Ok(options)
    }
}

fn main() -> ExitCode {
    match page() {
        Ok(page) => {
            print!("{page}");
            ExitCode::SUCCESS
        }
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn page() -> Result<String, String> {
    let options = Options::parse(std::env::args().skip(1))?;
    let read = |folders: &[PathBuf], more: &[PathBuf]| Board::read(folders, more).map_err(|e| e.to_string());
    let board = read(&options.studies, &options.more)?;
    let lights = read(&options.lights, &[])?;
    let foreign = read(&options.foreign, &[])?;
    let named = |names: &[String]| match names.iter().find(|name| !board.scenes.contains(name)) {
        Some(name) => Err(format!("unknown scene \"{name}\"; the scenes are {}", board.scenes.join(", "))),
        None => Ok(()),
    };
    named(&options.tuned)?;
    named(&options.plain)?;
    let roles = Roles::new();
    let groups = Groups::new(&board, &options);
    let mut page = tables::head(&board);
    page += &targets::seen(&board, &lights, &roles, &groups);
    page += &tables::times_to_error(&board, &roles, &groups);
    page += &tables::costs(&board, &roles);
    page += &tables::lights(&lights, &roles);
    page += &tables::foreign(&foreign, &board, &roles);
    page += &tables::all(&board, &roles, &groups);
    Ok(page)
}

/// Groups of scenes with something in common.
pub(crate) struct Groups<'a> {
    pub(crate) all: Vec<&'a str>,
    pub(crate) tuned: Vec<&'a str>,
    pub(crate) held_out: Vec<&'a str>,
    pub(crate) indirect: Vec<&'a str>,
}

impl<'a> Groups<'a> {
    fn new(board: &'a Board, options: &Options) -> Self {
        let all: Vec<&str> = board.scenes.iter().map(String::as_str).collect();
        let those = |keep: &dyn Fn(&str) -> bool| all.iter().copied().filter(|s| keep(s)).collect::<Vec<_>>();
        let is = |list: &[String], scene: &str| list.iter().any(|name| name == scene);
        Self {
            tuned: those(&|s| is(&options.tuned, s)),
            held_out: those(&|s| !is(&options.tuned, s)),
            indirect: those(&|s| !is(&options.plain, s)),
            all,
        }
    }
}
