//! Values of a plan that may be written in two ways.

use crate::Method;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::str::FromStr;

/// A TOML value that is either text to parse, or a value that serde reads.
#[derive(Deserialize)]
#[serde(untagged, expecting = "text, or a table of the keys that `dapple study --help` lists")]
enum Written<T> {
    Text(String),
    Value(T),
}

impl<T: FromStr<Err: fmt::Display>> Written<T> {
    fn read<E: Error>(self) -> Result<T, E> {
        match self {
            Self::Text(text) => text.parse().map_err(E::custom),
            Self::Value(value) => Ok(value),
        }
    }
}

pub(super) fn one<'de, D: Deserializer<'de>>(from: D) -> Result<Method, D::Error> {
    Written::deserialize(from)?.read()
}

pub(super) fn list<'de, T, D: Deserializer<'de>>(from: D) -> Result<Vec<T>, D::Error>
where
    T: FromStr<Err: fmt::Display> + Deserialize<'de>,
{
    Vec::<Written<T>>::deserialize(from)?.into_iter().map(Written::read).collect()
}

/// The largest number of seeds in a plan, so that a typing error does not fill the memory.
const MOST_SEEDS: u64 = 100_000;

/// Reads the seeds: a number N for the seeds 1 to N, or a list.
pub(super) fn seeds<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<u64>>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a number of seeds, or a list of seeds")]
    enum Seeds {
        Count(u64),
        List(Vec<u64>),
    }
    Ok(Some(match Seeds::deserialize(from)? {
        Seeds::Count(n) if n > MOST_SEEDS => {
            return Err(D::Error::custom(format!("{n} seeds are too many; use at most {MOST_SEEDS}")));
        }
        Seeds::Count(n) => (1..=n).collect(),
        Seeds::List(list) => list,
    }))
}

/// Reads a resolution: text such as `128x128`, or a pair.
pub(super) fn resolution<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[u32; 2]>, D::Error> {
    let text = match Written::deserialize(from)? {
        Written::Value(sides) => return Ok(Some(sides)),
        Written::Text(text) => text,
    };
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    let wrong = || format!("\"{text}\" is not a resolution; write WIDTHxHEIGHT in pixels, such as 128x128");
    sides.map(Some).ok_or_else(|| D::Error::custom(wrong()))
}
