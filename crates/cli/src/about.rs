//! The subcommands `dapple samplers`, `points`, `filters` and `integrators`, which list methods or describe one with its
//! parameters, and the subcommands `schemas`, `completions` and `man`.

use crate::output::tell;
use crate::render::values::{self, resolution};
use crate::{Arguments, Failure, Outcome, Result, failure};
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use dapple_core::{PointSet, SampleId, options::Parameter};
use dapple_job::registry::{self, Entry, FILTERS, NOT_BUILT, POINTS, PointSettings, SAMPLERS};
use dapple_scene::image::write_file;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(crate) struct ListArgs {
    /// Describe only this one: title, source, weakness, results and parameters with their defaults
    #[arg(value_name = "NAME")]
    name: Option<String>,
}

#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  dapple points zsobol\n  dapple points zsobol:count=4 --csv 256 > points.csv\n  dapple points blue-noise --csv 1 --pixels 128x128 > image.csv"
)]
pub(crate) struct PointsArgs {
    #[command(flatten)]
    list: ListArgs,

    /// Print the coordinates of the first N points of each pixel as CSV, which docs/results/spectra.py plots
    #[arg(long, value_name = "N", requires = "name")]
    csv: Option<u64>,

    /// Width and height of the image whose points are printed
    #[arg(long, value_name = "WxH", value_parser = resolution, default_value = "1x1", requires = "csv")]
    pixels: [u32; 2],
}

/// The printed description of a method of any kind.
struct Described {
    name: &'static str,
    aliases: &'static [&'static str],
    about: &'static str,
    source: &'static str,
    weakness: &'static str,
    parameters: Vec<&'static Parameter>,
}

impl<Make> From<&Entry<Make>> for Described {
    fn from(entry: &Entry<Make>) -> Self {
        let parameters = entry.parameters().collect();
        let &Entry { name, aliases, about, source, weakness, .. } = entry;
        Self { name, aliases, about, source, weakness, parameters }
    }
}

pub(crate) fn samplers(args: &ListArgs) -> Result<Outcome> {
    list(args, "sampler", SAMPLERS.iter().map(Described::from).collect(), values::sampler)
}

pub(crate) fn points(args: &PointsArgs) -> Result<Outcome> {
    match (&args.list.name, args.csv) {
        (Some(name), Some(count)) => {
            values::points(name).map_err(Failure::new)?;
            print_points(name, count, args.pixels)
        }
        _ => list(&args.list, "points", POINTS.iter().map(Described::from).collect(), values::points),
    }
}

/// Prints the first `count` points of each pixel in eight dimensions. Dapple's integrators use the first two for the position
/// in the pixel, the next two for the lens, and the others for light.
fn print_points(name: &str, count: u64, [width, height]: [u32; 2]) -> Result<Outcome> {
    let points = registry::points(name, PointSettings { seed: PRINTED_SEED, spp: Some(count) });
    let points = points.map_err(|e| Failure::new(failure::points(name, &e)))?;
    if count > points.capacity() {
        return Err(Failure::new(format!("\"{name}\" has only {} points per pixel; lower --csv", points.capacity())));
    }
    tell("x,y,sample,d0,d1,d2,d3,d4,d5,d6,d7")?;
    for pixel in (0..height).flat_map(|y| (0..width).map(move |x| [x, y])) {
        for sample in 0..count {
            let block = |block| points.block(SampleId::new(pixel, 0, sample), block);
            let values = [block(0), block(1)].concat();
            let values = values.iter().map(f32::to_string).collect::<Vec<_>>().join(",");
            tell(format!("{},{},{sample},{values}", pixel[0], pixel[1]))?;
        }
    }
    Ok(Outcome::Done)
}

/// The seed of the printed point sets.
const PRINTED_SEED: u64 = 1;

pub(crate) fn filters(args: &ListArgs) -> Result<Outcome> {
    list(args, "filter", FILTERS.iter().map(Described::from).collect(), values::filter)?;
    for (name, feature) in NOT_BUILT.iter().filter(|_| args.name.is_none()) {
        tell(format!("{name:<19}not in this build; build dapple with the feature \"{feature}\""))?;
    }
    if args.name.as_ref().is_none_or(|name| name == "best") {
        tell(format!("{:<19}{}", "best", best()))?;
    }
    Ok(Outcome::Done)
}

/// The filter that `best` selects on this machine, and how to get the blend with Open Image Denoise if it is not that one.
fn best() -> String {
    let name = registry::best_filter();
    match registry::open_image_denoise() {
        None => {
            format!("{name} in this build; build dapple with the feature \"oidn\" to blend it with Open Image Denoise")
        }
        Some(Ok(library)) => format!("{name} on this machine, with {library}"),
        Some(Err(why)) => format!("{name} on this machine; install Open Image Denoise 2 to blend both\n  {why}"),
    }
}

pub(crate) fn integrators(args: &ListArgs) -> Result<Outcome> {
    let described = dapple_transport::integrators().iter().map(|entry| Described {
        name: entry.name,
        aliases: &[],
        about: entry.about,
        source: entry.source,
        weakness: "",
        parameters: entry.parameters.iter().collect(),
    });
    let check =
        |name: &str| dapple_transport::check_integrator(name).map_err(|e| failure::integrator(name, &e.to_string()));
    list(args, "integrator", described.collect(), check)
}

/// Lists all methods, or describes the one named in `args`. `check` returns the error message for an unknown name.
fn list<T>(
    args: &ListArgs,
    option: &str,
    all: Vec<Described>,
    check: impl Fn(&str) -> std::result::Result<T, String>,
) -> Result<Outcome> {
    match &args.name {
        None => all.iter().try_for_each(|method| {
            tell(format!("{:<19}{}", method.name, method.about))?;
            list_parameters(&method.parameters)
        })?,
        Some(name) => {
            let plain = name.split(':').next().unwrap_or_default().trim();
            let found = all.iter().find(|method| method.name == plain || method.aliases.contains(&plain));
            // A filter is described even if its library is missing.
            if found.is_none() || name.contains(':') {
                check(name).map_err(Failure::new)?;
            }
            found.map_or(Ok(()), |method| describe(option, method))?;
        }
    }
    Ok(Outcome::Done)
}

fn describe(option: &str, method: &Described) -> Result<()> {
    tell(format!("{}: {}", method.name, method.about))?;
    if !method.aliases.is_empty() {
        tell(format!("aliases: {}", method.aliases.join(", ")))?;
    }
    for (what, text) in [("source", method.source), ("weakness", method.weakness)] {
        if !text.is_empty() {
            tell(format!("{what}: {text}"))?;
        }
    }
    for (description, result) in registry::verdicts(option, method.name) {
        tell(format!("result of {description}: {result}"))?;
    }
    let usage = format!("use: dapple render scene.pbrt --{option} {}", method.name);
    if method.parameters.is_empty() {
        return tell(format!("{usage}\nno parameters"));
    }
    tell(format!("{usage}[:key=value,…]\nparameters and their defaults:"))?;
    list_parameters(&method.parameters)
}

fn list_parameters(parameters: &[&Parameter]) -> Result<()> {
    for parameter in parameters {
        let given = format!("{}={}", parameter.name, parameter.default);
        tell(format!("  {given:<19}{}", parameter.help))?;
    }
    Ok(())
}

/// List the JSON schemas of the program's output, or print one
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  dapple schemas\n  dapple schemas render > render.schema.json")]
pub(crate) struct SchemasArgs {
    /// Print this schema
    #[arg(value_name = "NAME")]
    name: Option<String>,
}

/// The name of each schema, the JSON that it describes, and its text.
const SCHEMAS: [(&str, &str, &str); 7] = [
    ("render", "dapple render --json, dapple merge --json", include_str!("../schemas/render.schema.json")),
    ("spec", "dapple render --print-spec, and --spec", include_str!("../schemas/spec.schema.json")),
    ("compare", "dapple compare --json", include_str!("../schemas/compare.schema.json")),
    ("denoise", "dapple denoise --json", include_str!("../schemas/denoise.schema.json")),
    ("effects", "dapple effects --json", include_str!("../schemas/effects.schema.json")),
    ("run", "each line of a study's runs.jsonl", include_str!("../schemas/run.schema.json")),
    ("study", "a study's study.json", include_str!("../schemas/study.schema.json")),
];

pub(crate) fn schemas(args: &SchemasArgs) -> Result<Outcome> {
    match &args.name {
        None => SCHEMAS.iter().try_for_each(|(name, what, _)| tell(format!("{name:<10}{what}")))?,
        Some(requested) => {
            let known = || SCHEMAS.map(|(name, ..)| name).join(", ");
            let unknown = || Failure::new(format!("there is no schema \"{requested}\"; choose among {}", known()));
            let (_, _, text) = SCHEMAS.iter().find(|(name, ..)| name == requested).ok_or_else(unknown)?;
            tell(text.trim_end())?;
        }
    }
    Ok(Outcome::Done)
}

/// Print the completion script for a shell
#[derive(clap::Args)]
#[command(after_help = "Examples:
  dapple completions bash > ~/.local/share/bash-completion/completions/dapple
  dapple completions zsh > ~/.zfunc/_dapple
  dapple completions fish > ~/.config/fish/completions/dapple.fish")]
pub(crate) struct CompletionsArgs {
    /// Shell that will load the script
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// Print the man page of this program or of one of its commands
#[derive(clap::Args)]
#[command(after_help = "Examples:
  dapple man render | man -l -
  dapple man -o ~/.local/share/man/man1")]
pub(crate) struct ManArgs {
    /// Command, such as render; without it, the page of the program
    #[arg(value_name = "COMMAND")]
    command: Option<String>,

    /// Write all pages to this folder instead of printing one
    #[arg(short, long = "output", value_name = "DIR", conflicts_with = "command")]
    output: Option<PathBuf>,
}

pub(crate) fn completions(args: &CompletionsArgs) -> Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Arguments::command(), "dapple", &mut script);
    print(script)
}

pub(crate) fn man(args: &ManArgs) -> Result<Outcome> {
    let mut program = Arguments::command();
    program.build();
    if let Some(folder) = &args.output {
        write_all(&program, folder)?;
        return Ok(Outcome::Done);
    }
    let Some(name) = &args.command else { return print(page(program)?) };
    match program.get_subcommands().find(|command| command.get_name() == name && !command.is_hide_set()) {
        Some(command) => print(page(titled(command))?),
        None => {
            let known: Vec<&str> = shown(&program).map(Command::get_name).collect();
            Err(Failure::new(format!("there is no command \"{name}\"; choose among {}", known.join(", "))))
        }
    }
}

fn shown(program: &Command) -> impl Iterator<Item = &Command> {
    program.get_subcommands().filter(|command| !command.is_hide_set())
}

/// Renames a command to the name of its man page, such as `dapple-render`.
fn titled(command: &Command) -> Command {
    let name: &'static str = Box::leak(format!("dapple-{}", command.get_name()).into_boxed_str());
    command.clone().name(name)
}

fn page(command: Command) -> Result<Vec<u8>> {
    let mut roff = Vec::new();
    let cannot = |e| Failure::new(format!("cannot create the man page: {e}"));
    clap_mangen::Man::new(command).render(&mut roff).map_err(cannot)?;
    Ok(roff)
}

fn write_all(program: &Command, folder: &Path) -> Result<()> {
    let cannot = |e| Failure::new(format!("{}: cannot create the folder: {e}", folder.display()));
    std::fs::create_dir_all(folder).map_err(cannot)?;
    let pages = shown(program).map(titled).chain([program.clone()]);
    for command in pages {
        let path = folder.join(format!("{}.1", command.get_name()));
        write_file(&path, &page(command)?).map_err(Failure::new)?;
        tell(path.display().to_string())?;
    }
    Ok(())
}

/// Prints a text that already ends with a line break.
fn print(text: Vec<u8>) -> Result<Outcome> {
    let text = String::from_utf8(text).map_err(Failure::new)?;
    tell(text.trim_end())?;
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_names_a_source_and_the_bibliography_lists_each() {
        let sources = SAMPLERS.iter().map(|entry| entry.source).chain(POINTS.iter().map(|entry| entry.source));
        let sources = sources.chain(FILTERS.iter().map(|entry| entry.source));
        let sources: Vec<&str> =
            sources.chain(dapple_transport::integrators().iter().map(|entry| entry.source)).collect();
        assert!(sources.iter().all(|source| !source.is_empty()));
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/references.bib");
        let bibliography = std::fs::read_to_string(path).expect("the bibliography");
        // A name followed by "et al.", a second name or a title, and later a year: "Lan, Title, 2016", "Neyman 1934".
        let mut found = 0;
        for source in sources {
            for part in source.split(';').filter(|part| part.contains(char::is_numeric)) {
                let lower = |text: &str| text.trim().starts_with(char::is_lowercase);
                let part =
                    part.split_once(": ").filter(|(label, _)| lower(label)).map_or(part, |(_, rest)| rest).trim();
                let first = part.split([' ', ',']).next().unwrap_or_default();
                let name: String = first.chars().filter(|c| c.is_alphabetic()).collect();
                let year = part.split(|c: char| !c.is_ascii_digit()).find(|word| word.len() == 4);
                let (Some(year), false) = (year, name.is_empty() || lower(&name) || name == "Dapple") else { continue };
                let known = |entry: &str| entry.starts_with(&name) && entry[name.len()..].contains(year);
                assert!(bibliography.split("{").any(known), "{source}: {name} {year}");
                found += 1;
            }
        }
        assert!(found > 12, "{found}");
    }
}
