//! The number of a part of an image.

use std::str::FromStr;

/// A part of an image that one of several machines renders.
///
/// ```
/// let part: dapple_job::PartNumber = "2/4".parse()?;
/// assert_eq!((part.index(), part.of(), part.to_string()), (1, 4, "2/4".to_owned()));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartNumber {
    index: u32,
    of: u32,
}

impl PartNumber {
    /// The part's number, from 0.
    pub const fn index(&self) -> u32 {
        self.index
    }

    /// The number of parts of the image.
    pub const fn of(&self) -> u32 {
        self.of
    }
}

impl FromStr for PartNumber {
    type Err = String;

    /// Parses `I/N`: part I of N, counted from 1.
    fn from_str(text: &str) -> Result<Self, String> {
        let parse = |(i, n): (&str, &str)| Some((i.parse::<u32>().ok()?.checked_sub(1)?, n.parse().ok()?));
        match text.split_once('/').and_then(parse).filter(|(index, of)| index < of) {
            Some((index, of)) => Ok(Self { index, of }),
            None => Err(format!("\"{text}\" is not a part; write I/N with I from 1 to N, such as 1/4 or 4/4")),
        }
    }
}

impl std::fmt::Display for PartNumber {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.of)
    }
}

/// Serialisation of a part as `I/N`, with I from 1.
pub(crate) mod text {
    use super::PartNumber;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub(crate) fn serialize<S: Serializer>(part: &Option<PartNumber>, to: S) -> Result<S::Ok, S::Error> {
        part.map(|part| part.to_string()).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<PartNumber>, D::Error> {
        let text = Option::<String>::deserialize(from)?;
        text.map(|text| text.parse().map_err(D::Error::custom)).transpose()
    }
}
