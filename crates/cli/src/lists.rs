//! The subcommands `dapple samplers`, `points`, `filters` and `integrators`, which list names and parameters, or describe
//! one method.

mod sources;

use crate::output::tell;
use crate::{Failure, Outcome, Result, hints};
use dapple_core::Parameter;
use dapple_job::registry::{Entry, FILTERS, NOT_BUILT, POINTS, SAMPLERS, check_filter, check_points, check_sampler};
use sources::source;

#[derive(clap::Args)]
pub(crate) struct ListArgs {
    /// Describe only this one: what it is, its parameters with their defaults, and its source
    #[arg(value_name = "NAME")]
    name: Option<String>,
}

/// A method of any kind, as it is described.
struct Described {
    name: &'static str,
    aliases: &'static [&'static str],
    about: &'static str,
    parameters: Vec<&'static Parameter>,
}

impl<Make> From<&Entry<Make>> for Described {
    fn from(entry: &Entry<Make>) -> Self {
        let parameters = entry.parameters().collect();
        Self { name: entry.name, aliases: entry.aliases, about: entry.about, parameters }
    }
}

pub(crate) fn samplers(args: &ListArgs) -> Result<Outcome> {
    let check = |name: &str| check_sampler(name).map_err(|e| hints::sampler(name, &e));
    list(args, "sampler", SAMPLERS.iter().map(Described::from).collect(), &check)
}

pub(crate) fn points(args: &ListArgs) -> Result<Outcome> {
    let check = |name: &str| check_points(name).map_err(|e| hints::points(name, &e));
    list(args, "points", POINTS.iter().map(Described::from).collect(), &check)
}

pub(crate) fn filters(args: &ListArgs) -> Result<Outcome> {
    let check = |name: &str| check_filter(name).map_err(|e| hints::filter(name, &e));
    list(args, "filter", FILTERS.iter().map(Described::from).collect(), &check)?;
    for (name, feature) in NOT_BUILT.iter().filter(|_| args.name.is_none()) {
        tell(format!("{name:<19}not in this program; build it with the feature \"{feature}\""))?;
    }
    Ok(Outcome::Done)
}

pub(crate) fn integrators(args: &ListArgs) -> Result<Outcome> {
    let described = dapple_renderer::integrators().iter().map(|entry| Described {
        name: entry.name,
        aliases: &[],
        about: entry.about,
        parameters: entry.parameters.iter().collect(),
    });
    let check =
        |name: &str| dapple_renderer::check_integrator(name).map_err(|e| hints::integrator(name, &e.to_string()));
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
    tell(format!("source: {}", source(method.name)))?;
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
