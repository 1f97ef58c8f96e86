//! Shards: parts of an image for separate machines.

use std::str::FromStr;

/// A part of an image that one of several machines renders.
///
/// ```
/// let shard: dapple_job::Shard = "2/4".parse()?;
/// assert_eq!((shard.index(), shard.of(), shard.to_string()), (1, 4, "2/4".to_owned()));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    of: u32,
}

impl Shard {
    /// The shard's number, from 0.
    pub const fn index(&self) -> u32 {
        self.index
    }

    /// The number of shards of the image.
    pub const fn of(&self) -> u32 {
        self.of
    }
}

impl FromStr for Shard {
    type Err = String;

    /// Parses `I/N`, the I-th of N, counted from 1.
    fn from_str(text: &str) -> Result<Self, String> {
        let parse = |(i, n): (&str, &str)| Some((i.parse::<u32>().ok()?.checked_sub(1)?, n.parse().ok()?));
        match text.split_once('/').and_then(parse).filter(|(index, of)| index < of) {
            Some((index, of)) => Ok(Self { index, of }),
            None => Err(format!("\"{text}\" is not a shard I/N, the I-th of N; examples are 1/4 and 4/4")),
        }
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.of)
    }
}
