//! The subcommands `dapple samplers`, `points`, `filters` and `integrators`, which list names and parameters, or describe
//! one method.

use crate::output::tell;
use crate::render::values::resolution;
use crate::{Failure, Outcome, Result, hints};
use dapple_core::{Parameter, PointSet, SampleId};
use dapple_job::registry::{
    self, Entry, FILTERS, NOT_BUILT, POINTS, SAMPLERS, Setting, check_filter, check_points, check_sampler,
};

#[derive(clap::Args)]
pub(crate) struct ListArgs {
    /// Describe only this one: what it is, its source, and its parameters with their defaults
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

    /// Print the coordinates of the first N points of each pixel as CSV; docs/results/spectra.py plots them
    #[arg(long, value_name = "N", requires = "name")]
    csv: Option<u64>,

    /// Width and height of the image whose points are printed
    #[arg(long, value_name = "WxH", value_parser = resolution, default_value = "1x1", requires = "csv")]
    pixels: [u32; 2],
}

/// A method of any kind, as it is described.
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
    let check = |name: &str| check_sampler(name).map_err(|e| hints::sampler(name, &e));
    list(args, "sampler", SAMPLERS.iter().map(Described::from).collect(), &check)
}

pub(crate) fn points(args: &PointsArgs) -> Result<Outcome> {
    let check = |name: &str| check_points(name).map_err(|e| hints::points(name, &e));
    match (&args.list.name, args.csv) {
        (Some(name), Some(count)) => {
            check(name).map_err(Failure::new)?;
            print_points(name, count, args.pixels)
        }
        _ => list(&args.list, "points", POINTS.iter().map(Described::from).collect(), &check),
    }
}

/// Prints the first `count` points of each pixel: eight dimensions, of which Dapple's integrators use the first two for
/// the place in the pixel, the next two for the lens, and the others for light.
fn print_points(name: &str, count: u64, [width, height]: [u32; 2]) -> Result<Outcome> {
    let points = registry::points(name, Setting { seed: PRINTED_SEED, spp: Some(count) });
    let points = points.map_err(|e| Failure::new(hints::points(name, &e)))?;
    if count > points.capacity() {
        return Err(Failure::new(format!("\"{name}\" has {} points per pixel; lower --csv", points.capacity())));
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
    let check = |name: &str| check_filter(name).map_err(|e| hints::filter(name, &e));
    list(args, "filter", FILTERS.iter().map(Described::from).collect(), &check)?;
    for (name, feature) in NOT_BUILT.iter().filter(|_| args.name.is_none()) {
        tell(format!("{name:<19}not in this program; build it with the feature \"{feature}\""))?;
    }
    Ok(Outcome::Done)
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
        |name: &str| dapple_transport::check_integrator(name).map_err(|e| hints::integrator(name, &e.to_string()));
    list(args, "integrator", described.collect(), &check)
}

/// Lists all methods, or describes the one that is named. `check` makes the message for an unknown name.
fn list(
    args: &ListArgs,
    option: &str,
    all: Vec<Described>,
    check: &dyn Fn(&str) -> std::result::Result<(), String>,
) -> Result<Outcome> {
    match &args.name {
        None => all.iter().try_for_each(|method| {
            tell(format!("{:<19}{}", method.name, method.about))?;
            list_parameters(&method.parameters)
        })?,
        Some(name) => {
            check(name).map_err(Failure::new)?;
            let plain = name.split(':').next().unwrap_or_default().trim();
            let found = all.iter().find(|method| method.name == plain || method.aliases.contains(&plain));
            found.map_or(Ok(()), |method| describe(option, method))?;
        }
    }
    Ok(Outcome::Done)
}

fn describe(option: &str, method: &Described) -> Result<()> {
    tell(format!("{}: {}", method.name, method.about))?;
    if !method.aliases.is_empty() {
        tell(format!("former names: {}", method.aliases.join(", ")))?;
    }
    for (what, text) in [("source", method.source), ("weakness", method.weakness)] {
        if !text.is_empty() {
            tell(format!("{what}: {text}"))?;
        }
    }
    for (description, result) in registry::verdicts(option, method.name) {
        tell(format!("result of {description}: {result}"))?;
    }
    let example = match method.parameters.first() {
        Some(Parameter { name, default, .. }) => format!("{}:{name}={default}", method.name),
        None => method.name.to_owned(),
    };
    tell(format!("use: dapple render scene.pbrt --{option} {example}"))?;
    tell(if method.parameters.is_empty() { "no parameters" } else { "parameters and their defaults:" })?;
    list_parameters(&method.parameters)
}

fn list_parameters(parameters: &[&Parameter]) -> Result<()> {
    for parameter in parameters {
        let given = format!("{}={}", parameter.name, parameter.default);
        tell(format!("  {given:<19}{}", parameter.help))?;
    }
    Ok(())
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
