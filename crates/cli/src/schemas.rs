//! The subcommand `dapple schemas`: JSON schemas of what the program prints and writes as JSON.

use crate::output::tell;
use crate::{Failure, Outcome, Result};

/// List the JSON schemas of the program's output, or print one
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  dapple schemas\n  dapple schemas render > render.schema.json")]
pub(crate) struct SchemasArgs {
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

pub(crate) fn run(args: &SchemasArgs) -> Result<Outcome> {
    match &args.name {
        None => SCHEMAS.iter().try_for_each(|(name, what, _)| tell(format!("{name:<10}{what}")))?,
        Some(requested) => match SCHEMAS.iter().find(|(name, ..)| name == requested) {
            Some((_, _, text)) => tell(text.trim_end())?,
            None => {
                let known = SCHEMAS.map(|(name, ..)| name).join(", ");
                return Err(Failure::new(format!("there is no schema \"{requested}\"; choose among {known}")));
            }
        },
    }
    Ok(Outcome::Done)
}
