//! Types of option values.

use crate::{OptionError, PilotPolicy, Stopping};

/// A type of option value that is parsed from text and written back as text.
pub trait OptionValue: Sized {
    /// Parses `text`; `None` if it is not a value of this type.
    fn from_text(text: &str) -> Option<Self>;

    /// The value as text, which [`OptionValue::from_text`] parses to the same value.
    fn text(&self) -> String;

    /// A noun phrase for error messages that describes the accepted values. `allowed` is the parameter's declared
    /// range, in words.
    fn wanted(allowed: Option<&str>) -> String;

    /// Parses `value` for the parameter `name`. `allowed` is the declared range, for the error message.
    ///
    /// # Errors
    ///
    /// [`OptionError::Value`] if `value` does not parse.
    fn parse_as(name: &'static str, value: &str, allowed: Option<&str>) -> Result<Self, OptionError> {
        let wrong = || OptionError::Value { name, value: value.to_owned(), wanted: Self::wanted(allowed) };
        Self::from_text(value).ok_or_else(wrong)
    }
}

macro_rules! numbers {
    ($($Type:ty),*) => {$(
        impl OptionValue for $Type {
            fn from_text(text: &str) -> Option<Self> {
                text.parse().ok()
            }

            fn text(&self) -> String {
                self.to_string()
            }

            fn wanted(allowed: Option<&str>) -> String {
                allowed.map_or_else(|| "a number".into(), |allowed| format!("a number ({allowed})"))
            }
        }
    )*};
}

numbers!(u8, u32, u64, usize, i32, f32, f64);

/// Parses `true` and `false`.
impl OptionValue for bool {
    fn from_text(text: &str) -> Option<Self> {
        text.parse().ok()
    }

    fn text(&self) -> String {
        self.to_string()
    }

    fn wanted(allowed: Option<&str>) -> String {
        allowed.map_or_else(|| "true or false".into(), str::to_owned)
    }
}

/// Parses `none` as `None`, and other text as a value of the inner type.
impl<T: OptionValue> OptionValue for Option<T> {
    fn from_text(text: &str) -> Option<Self> {
        if text == "none" { Some(None) } else { T::from_text(text).map(Some) }
    }

    fn text(&self) -> String {
        self.as_ref().map_or_else(|| "none".into(), T::text)
    }

    fn wanted(allowed: Option<&str>) -> String {
        format!("none, or {}", T::wanted(allowed))
    }
}

crate::choices!(PilotPolicy { Keep = "keep", Refined = "refined", Discard = "discard", Cross = "cross", Neighbours = "neighbours" });
crate::choices!(Stopping { Budget = "budget", Threshold = "threshold" });
