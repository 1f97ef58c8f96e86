//! Default values, and values that are written as names.

use super::{DEFAULT_FILTER, DEFAULT_INTEGRATOR, DEFAULT_POINTS, DEFAULT_SAMPLER};
use dapple_core::Shard;
use dapple_renderer::light::LightChoice;

pub(super) fn sampler() -> String {
    DEFAULT_SAMPLER.into()
}

pub(super) fn points() -> String {
    DEFAULT_POINTS.into()
}

pub(super) fn filter() -> String {
    DEFAULT_FILTER.into()
}

pub(super) fn integrator() -> String {
    DEFAULT_INTEGRATOR.into()
}

pub(super) const fn one() -> u32 {
    1
}

pub(super) const fn seed() -> u64 {
    1
}

/// The name of a way to select among lights.
pub const fn light_selection_name(selection: LightChoice) -> &'static str {
    match selection {
        LightChoice::Power => "power",
        LightChoice::Uniform => "uniform",
        LightChoice::Cells => "learned",
    }
}

/// The way to select among lights of a name: `power`, `uniform`, or `learned` (alias `cells`).
///
/// # Errors
///
/// A sentence that lists the names, for any other.
pub fn light_selection(name: &str) -> Result<LightChoice, String> {
    match name {
        "power" => Ok(LightChoice::Power),
        "uniform" => Ok(LightChoice::Uniform),
        "learned" | "cells" => Ok(LightChoice::Cells),
        _ => Err(format!("there is no light selection \"{name}\"; there are power, uniform, learned")),
    }
}

/// The shard that `I/N` names, I from 1.
///
/// # Errors
///
/// A sentence with examples, for any other text.
pub fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers =
        text.split_once('/').and_then(|(i, n)| Some((i.parse::<u32>().ok()?.checked_sub(1)?, n.parse().ok()?)));
    let shard = numbers.and_then(|(index, of)| Shard::new(index, of).ok());
    shard.ok_or_else(|| format!("\"{text}\" is not a shard I/N, the I-th of N; examples are 1/4 and 4/4"))
}

/// Effects as a list of their names.
pub(super) mod effects {
    use dapple_scene::Effect;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(effects: &[Effect], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(effects.iter().map(|effect| effect.name()))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Effect>, D::Error> {
        Vec::<String>::deserialize(from)?.iter().map(|name| name.parse().map_err(D::Error::custom)).collect()
    }
}

/// The selection among lights by its name.
pub(super) mod light_selection {
    use super::super::{light_selection, light_selection_name};
    use dapple_renderer::light::LightChoice;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(selection: &Option<LightChoice>, to: S) -> Result<S::Ok, S::Error> {
        match selection {
            Some(selection) => to.serialize_some(light_selection_name(*selection)),
            None => to.serialize_none(),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<LightChoice>, D::Error> {
        let name = Option::<String>::deserialize(from)?;
        name.map(|name| light_selection(&name).map_err(D::Error::custom)).transpose()
    }
}

/// A shard as `I/N`, I from 1.
pub(super) mod shard {
    use dapple_core::Shard;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(shard: &Option<Shard>, to: S) -> Result<S::Ok, S::Error> {
        match shard {
            Some(shard) => to.serialize_some(&shard.to_string()),
            None => to.serialize_none(),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Shard>, D::Error> {
        let text = Option::<String>::deserialize(from)?;
        text.map(|text| super::super::parse_shard(&text).map_err(D::Error::custom)).transpose()
    }
}
