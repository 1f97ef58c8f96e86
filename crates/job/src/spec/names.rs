//! Default values of [`RenderSpec`](super::RenderSpec)'s fields, and the serialisation of values that are names in
//! JSON.

use super::DEFAULT_INTEGRATOR;
use super::Shard;
use dapple_registry::{DEFAULT_FILTER, DEFAULT_POINTS, DEFAULT_SAMPLER};

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

/// Serialisation of effects as a list of their names.
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

/// Serialisation of a shard as `I/N`, with I from 1.
pub(super) mod shard {
    use super::Shard;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(shard: &Option<Shard>, to: S) -> Result<S::Ok, S::Error> {
        match shard {
            Some(shard) => to.serialize_some(&shard.to_string()),
            None => to.serialize_none(),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Shard>, D::Error> {
        let text = Option::<String>::deserialize(from)?;
        text.map(|text| text.parse().map_err(D::Error::custom)).transpose()
    }
}
