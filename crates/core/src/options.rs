//! One declaration per parameter: the struct, its defaults, parsing, ranges, help and description.

use crate::plan::{PilotPolicy, Stopping};

/// A command-line parameter of a sampler, point set or filter: its name, its default as text, and one line of help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// The name, as in `name=value`.
    pub name: &'static str,
    /// The default value, as text that parses.
    pub default: &'static str,
    /// A one-line description of the parameter.
    pub help: &'static str,
    /// A former name, which is still accepted.
    pub alias: Option<&'static str>,
}

impl Parameter {
    /// A parameter declared by hand, without [`options!`](crate::options!).
    pub const fn new(name: &'static str, default: &'static str, help: &'static str) -> Self {
        Self { name, default, help, alias: None }
    }

    /// Sets the former name.
    #[must_use]
    pub const fn alias(mut self, alias: &'static str) -> Self {
        self.alias = Some(alias);
        self
    }
}

/// A value outside its parameter's range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name} = {value} is out of range; allowed: {allowed}")]
pub struct OutOfRange {
    /// The parameter's name.
    pub name: &'static str,
    /// The rejected value, as text.
    pub value: String,
    /// The allowed range, in words.
    pub allowed: &'static str,
}

impl From<OutOfRange> for crate::Error {
    fn from(OutOfRange { name, value, allowed }: OutOfRange) -> Self {
        Self::OutOfRange { name, value, allowed }
    }
}

/// An error in a list of `name=value` options.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OptionError {
    /// An item without an equals sign.
    #[error("\"{item}\" is not of the form key=value; give each parameter a value")]
    NotAPair {
        /// The list item, as given.
        item: String,
    },
    /// An unknown name.
    #[error(
        "there is no parameter \"{name}\"; {} parameters: {known}",
        .nearest.map_or("known".to_owned(), |n| format!("did you mean \"{n}\"? Known"))
    )]
    Unknown {
        /// The unknown name.
        name: String,
        /// The known name closest to the unknown one, if a few edits separate them.
        nearest: Option<&'static str>,
        /// The known names, as a list for messages.
        known: String,
    },
    /// A name that is given twice.
    #[error("parameter \"{name}\" is given twice; remove one")]
    Twice {
        /// The repeated name.
        name: &'static str,
    },
    /// A value that does not parse.
    #[error("{name} = \"{value}\" is not valid; use {wanted}")]
    Value {
        /// The parameter's name.
        name: &'static str,
        /// The value, as given.
        value: String,
        /// The values that would parse, in words.
        wanted: String,
    },
    /// A value outside its parameter's range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
}

/// A struct of options that is parsed from `name=value,name=value`, and written back in the same form.
///
/// [`options!`](crate::options!) declares a struct with this trait.
///
/// ```
/// use dapple_core::options::Options;
///
/// dapple_core::options! {
///     /// The parameters of a blur.
///     pub struct BlurOptions {
///         /// Half the width of the kernel in pixels.
///         pub radius: u32 = 4, |radius| radius <= 64, "at most 64 pixels";
///         /// The kernel's falloff.
///         pub alpha: f64 = 0.5, |alpha| alpha > 0.0, "above 0";
///     }
/// }
///
/// let options = BlurOptions::parse("radius=2")?;
/// assert_eq!(options, BlurOptions::default().radius(2));
/// assert_eq!(options.describe(), "radius=2,alpha=0.5");
/// assert_eq!(BlurOptions::PARAMETERS[1].help, "The kernel's falloff.");
/// let error = BlurOptions::parse("radios=2").unwrap_err().to_string();
/// assert!(error.contains("did you mean \"radius\"?"), "{error}");
/// assert!(BlurOptions::parse("radius=65").is_err());
/// # Ok::<(), dapple_core::options::OptionError>(())
/// ```
pub trait Options: Default {
    /// The parameters, in the order of the struct's fields.
    const PARAMETERS: &'static [Parameter];

    /// Sets a parameter from text, without checking the range. Returns `false` for an unknown name.
    ///
    /// # Errors
    ///
    /// [`OptionError::Value`] for text that does not parse as the parameter's type.
    fn set(&mut self, name: &str, value: &str) -> Result<bool, OptionError>;

    /// Checks each parameter against its range.
    ///
    /// # Errors
    ///
    /// The first parameter that is out of range.
    fn check_ranges(&self) -> Result<(), OutOfRange>;

    /// All parameters as `name=value,name=value`, in the order of the fields.
    fn describe(&self) -> String;

    /// Parses `name=value,name=value`. Parameters that are not listed keep their defaults.
    ///
    /// # Errors
    ///
    /// [`OptionError`] for a malformed item, an unknown or repeated name, or a value that is wrong or out of range.
    fn parse(text: &str) -> Result<Self, OptionError> {
        let mut options = Self::default();
        for (name, value) in parse_pairs(text, Self::PARAMETERS)? {
            options.set(name, value)?;
        }
        options.check_ranges()?;
        Ok(options)
    }
}

/// Splits `name=value,name=value` into pairs of name and value. Each name must be in `known`; a former name becomes the
/// present one.
///
/// # Errors
///
/// [`OptionError::NotAPair`], [`OptionError::Unknown`] and [`OptionError::Twice`].
pub fn parse_pairs<'t, 'p>(
    text: &'t str,
    known: impl IntoIterator<Item = &'p Parameter>,
) -> Result<Vec<(&'static str, &'t str)>, OptionError> {
    let known: Vec<&Parameter> = known.into_iter().collect();
    let mut pairs: Vec<(&'static str, &str)> = Vec::new();
    for item in text.split(',').map(str::trim).filter(|item| !item.is_empty()) {
        let (name, value) = item.split_once('=').ok_or_else(|| OptionError::NotAPair { item: item.to_owned() })?;
        let (name, value) = (name.trim(), value.trim());
        let known_as = |k: &&&Parameter| k.name == name || k.alias == Some(name);
        let Some(&&Parameter { name, .. }) = known.iter().find(known_as) else {
            let known: Vec<&str> = known.iter().map(|parameter| parameter.name).collect();
            let nearest = nearest_name(name, known.iter().copied());
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            return Err(OptionError::Unknown { name: name.to_owned(), nearest, known });
        };
        if pairs.iter().any(|pair| pair.0 == name) {
            return Err(OptionError::Twice { name });
        }
        pairs.push((name, value));
    }
    Ok(pairs)
}

/// The known name closest to `name` by edit distance; `None` if all are too different.
///
/// ```
/// assert_eq!(dapple_core::options::nearest_name("sobel", ["halton", "sobol"]), Some("sobol"));
/// assert_eq!(dapple_core::options::nearest_name("sphere", ["halton", "sobol"]), None);
/// ```
pub fn nearest_name<'k>(name: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    // A name longer than any real one is not worth the quadratic time.
    if name.len() > 64 {
        return None;
    }
    let (most, name) = ((1 + name.chars().count() / 4).min(3), name.to_lowercase());
    known
        .into_iter()
        .map(|k| (strsim::levenshtein(&name, &k.to_lowercase()), k))
        .filter(|&(d, _)| d <= most)
        .min()
        .map(|(_, k)| k)
}

/// Declares a struct of options: its fields, setters, defaults, ranges, table of [`Parameter`]s, parsing and
/// description.
///
/// The default follows `=`. Unless it is a plain number, `=> "text"` states it as text. The line ends with a closure that
/// returns `true` for values in range, and a text that describes the range.
///
/// The struct is `non_exhaustive`, and has a setter of the same name for each field.
#[macro_export]
macro_rules! options {
    (
        $(#[$meta:meta])*
        $vis:vis struct $Name:ident {
            $(
                #[doc = $help:literal]
                $(#[doc = $more:literal])*
                pub $field:ident: $Type:ty = $default:expr $(=> $text:literal)?
                    $(, |$value:ident| $holds:expr, $allowed:literal)?;
            )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[non_exhaustive]
        $vis struct $Name {
            $(
                #[doc = $help]
                $(#[doc = $more])*
                #[doc = concat!("\n\nDefault: `", $crate::options!(@text $default $(=> $text)?), "`.")]
                pub $field: $Type,
            )*
        }

        impl Default for $Name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        #[allow(dead_code, reason = "options that only the registry reads need no setters")]
        impl $Name {
            $(
                #[doc = concat!("Sets [`", stringify!($field), "`](Self::", stringify!($field), ").")]
                #[must_use]
                $vis const fn $field(mut self, $field: $Type) -> Self {
                    self.$field = $field;
                    self
                }
            )*
        }

        impl $crate::options::Options for $Name {
            const PARAMETERS: &'static [$crate::options::Parameter] = &[
                $($crate::options::Parameter::new(
                    stringify!($field),
                    $crate::options!(@text $default $(=> $text)?),
                    $help.trim_ascii(),
                ),)*
            ];

            fn set(&mut self, name: &str, value: &str) -> Result<bool, $crate::options::OptionError> {
                match name {
                    $(stringify!($field) => {
                        let range: &[&str] = &[$($allowed)?];
                        self.$field = $crate::options::OptionValue::parse_as(stringify!($field), value, range.first().copied())?;
                    })*
                    _ => return Ok(false),
                }
                Ok(true)
            }

            fn check_ranges(&self) -> Result<(), $crate::options::OutOfRange> {
                $($(
                    let $value = self.$field;
                    if !($holds) {
                        let value = $crate::options::OptionValue::text(&self.$field);
                        return Err($crate::options::OutOfRange { name: stringify!($field), value, allowed: $allowed });
                    }
                )?)*
                Ok(())
            }

            fn describe(&self) -> String {
                let values: &[String] =
                    &[$(format!(concat!(stringify!($field), "={}"), $crate::options::OptionValue::text(&self.$field)),)*];
                values.join(",")
            }
        }
    };
    (@text $default:expr) => { stringify!($default) };
    (@text $default:expr => $text:literal) => { $text };
}

/// Declares the names of an enum's variants: the method `name()`, and parsing as an
/// [`OptionValue`](crate::options::OptionValue).
#[macro_export]
macro_rules! choices {
    ($Type:ident { $($variant:ident = $name:literal),* $(,)? }) => {
        #[allow(unreachable_pub, reason = "the enum may be private")]
        impl $Type {
            /// The variant's name on the command line.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }
        }

        impl $crate::options::OptionValue for $Type {
            fn from_text(text: &str) -> Option<Self> {
                match text {
                    $($name => Some(Self::$variant),)*
                    _ => None,
                }
            }

            fn text(&self) -> String {
                self.name().to_owned()
            }

            fn wanted(allowed: Option<&str>) -> String {
                allowed.map_or_else(|| format!("one of {}", [$($name),*].join(", ")), str::to_owned)
            }
        }
    };
}

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

macro_rules! parsed {
    ($($Type:ty: $wanted:expr;)*) => {$(
        impl OptionValue for $Type {
            fn from_text(text: &str) -> Option<Self> {
                text.parse().ok()
            }

            fn text(&self) -> String {
                self.to_string()
            }

            fn wanted(allowed: Option<&str>) -> String {
                let wanted: fn(Option<&str>) -> String = $wanted;
                wanted(allowed)
            }
        }
    )*};
}

fn number(allowed: Option<&str>) -> String {
    allowed.map_or_else(|| "a number".into(), |allowed| format!("a number ({allowed})"))
}

parsed! {
    u8: number; u32: number; u64: number; usize: number; i32: number; f32: number; f64: number;
    bool: |allowed| allowed.unwrap_or("true or false").to_owned();
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

/// Converts `NAME:key=value,key=value` to `NAME/key=value/key=value`, a form that can be the value of another parameter.
/// [`unnested`] is the inverse.
///
/// Separators that are slashes already get one more `/`: two slashes separate the parameters of a value nested twice.
///
/// ```
/// use dapple_core::options::{nested, unnested};
///
/// let inner = nested("gaussian:alpha=2,radius=1");
/// assert_eq!(inner, "gaussian/alpha=2/radius=1");
/// let outer = nested(&format!("blend:of={inner},weight=0.5"));
/// assert_eq!(outer, "blend/of=gaussian//alpha=2//radius=1/weight=0.5");
/// assert_eq!(unnested(&unnested(&outer)["blend:of=".len()..].split(',').next().unwrap()), "gaussian:alpha=2,radius=1");
/// ```
pub fn nested(description: &str) -> String {
    let mut text = String::with_capacity(description.len());
    let mut named = false;
    let mut before = ' ';
    for c in description.chars() {
        match c {
            ':' if !named => {
                named = true;
                text.push('/');
            }
            ',' => text.push('/'),
            // One more at the start of each run.
            '/' if before != '/' => text.push_str("//"),
            c => text.push(c),
        }
        before = c;
    }
    text
}

/// Converts `NAME/key=value/key=value` back to `NAME:key=value,key=value`: the inverse of [`nested`].
pub fn unnested(value: &str) -> String {
    let mut text = String::with_capacity(value.len());
    let mut separators = [':'].into_iter().chain(std::iter::repeat(','));
    let mut rest = value;
    while let Some(at) = rest.find('/') {
        text.push_str(&rest[..at]);
        let run = rest[at..].len() - rest[at..].trim_start_matches('/').len();
        match run {
            1 => text.extend(separators.next()),
            deeper => text.extend(std::iter::repeat_n('/', deeper - 1)),
        }
        rest = &rest[at + run..];
    }
    text.push_str(rest);
    text
}
