//! The subcommands `dapple samplers`, `points`, `filters` and `integrators`, which list names and parameters.

use crate::output::tell;
use crate::{Outcome, Result};
use dapple_core::Parameter;
use dapple_job::registry::{Entry, FILTERS, NOT_BUILT, POINTS, SAMPLERS};

pub(crate) fn samplers() -> Result<Outcome> {
    list(SAMPLERS)
}

pub(crate) fn points() -> Result<Outcome> {
    list(POINTS)
}

pub(crate) fn filters() -> Result<Outcome> {
    list(FILTERS)?;
    for (name, feature) in NOT_BUILT {
        tell(format!("{name:<18}not in this program; build it with the feature \"{feature}\""))?;
    }
    Ok(Outcome::Done)
}

/// Prints the name of each registry entry, and below it the entry's parameters with their defaults.
fn list<Make>(entries: &[Entry<Make>]) -> Result<Outcome> {
    for entry in entries {
        tell(format!("{:<18}{}", entry.name, entry.about))?;
        list_parameters(entry.parameters())?;
    }
    Ok(Outcome::Done)
}

fn list_parameters<'p>(parameters: impl IntoIterator<Item = &'p Parameter>) -> Result<()> {
    for parameter in parameters {
        let given = format!("{}={}", parameter.name, parameter.default);
        tell(format!("  {given:<16}{}", parameter.help))?;
    }
    Ok(())
}

pub(crate) fn integrators() -> Result<Outcome> {
    for entry in dapple_renderer::integrators() {
        tell(format!("{:<18}{}", entry.name, entry.about))?;
        list_parameters(entry.parameters)?;
    }
    Ok(Outcome::Done)
}
