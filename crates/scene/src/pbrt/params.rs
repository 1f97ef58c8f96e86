//! The parameters of a directive: typed values by name, each taken at most once.

use super::log::Log;
use super::names::Textures;
use super::tokens::{Fault, Kind, Token, Tokens, did_you_mean, number, shown, unescape};
use super::version::Version;
use crate::Source;
use dapple_core::options::nearest_name;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

/// Declares the types of parameters, each with its name and the names of older versions.
macro_rules! types {
    ($($variant:ident $name:literal $($old:literal)*;)*) => {
        /// The type in a parameter's declaration, such as `float`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Type {
            $($variant,)*
        }

        impl Type {
            const NAMES: &[&str] = &[$($name),*];

            /// Returns the parameter type with this name in any version of pbrt; `None` for an unknown name.
            fn named(name: &str) -> Option<Self> {
                match name {
                    $($name $(| $old)* => Some(Self::$variant),)*
                    _ => None,
                }
            }

            fn name(self) -> &'static str {
                Self::NAMES[self as usize]
            }
        }
    };
}

types! {
    Float "float";
    Integer "integer";
    Bool "bool";
    Text "string";
    Point2 "point2";
    Vector2 "vector2";
    Point3 "point3" "point";
    Vector3 "vector3" "vector";
    Normal "normal" "normal3";
    Rgb "rgb" "color";
    Xyz "xyz";
    Spectrum "spectrum";
    Blackbody "blackbody";
    Texture "texture";
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Bools(Vec<bool>),
    /// An invalid value, which has been reported.
    Broken,
}

impl Values {
    fn new(ty: Type) -> Self {
        match ty {
            Type::Bool => Self::Bools(Vec::new()),
            Type::Text | Type::Texture => Self::Texts(Vec::new()),
            _ => Self::Numbers(Vec::new()),
        }
    }

    /// Appends the value of a token to the values of a parameter of type `ty`.
    fn push(&mut self, token: &Token<'_>, ty: Type) -> Result<(), Fault> {
        let wanted = match (&mut *self, token.kind) {
            (Self::Bools(list), _) if matches!(token.text, "true" | "false") => {
                list.push(token.text == "true");
                return Ok(());
            }
            (Self::Texts(list), Kind::Text) => return unescape(token).map(|text| list.push(text)),
            (Self::Numbers(list), Kind::Text) if ty == Type::Spectrum && list.is_empty() => {
                *self = Self::Texts(vec![unescape(token)?]);
                return Ok(());
            }
            (Self::Numbers(list), kind) if kind != Kind::Text => return number(token).map(|value| list.push(value)),
            (Self::Bools(_), _) => "true or false",
            _ if ty == Type::Spectrum => "either numbers or one name",
            (Self::Texts(_), _) => "a quoted name",
            _ => "numbers",
        };
        let ty = ty.name();
        Err((token.line, format!("a parameter of type {ty} takes {wanted}, not {}", shown(token.text))))
    }
}

/// One parameter of a directive, as written in the file.
#[derive(Clone, Debug)]
pub(super) struct Param {
    pub(super) ty: Type,
    pub(super) name: String,
    pub(super) values: Values,
    pub(super) line: u32,
    taken: bool,
    /// True if an `Attribute` directive set the parameter for later directives.
    inherited: bool,
}

/// Reads a parameter, `"type name" value` or `"type name" [ values ]`. Invalid values are reported and kept as
/// [`Values::Broken`], so that they do not count as missing.
pub(super) fn read_param(tokens: &mut Tokens<'_>, file: &Arc<PathBuf>, log: &mut Log) -> Result<Param, Fault> {
    let Some(declaration) = tokens.next() else { return Err((tokens.line(), "a parameter is missing".into())) };
    let declaration = declaration?;
    let words: Vec<&str> = declaration.text.split_ascii_whitespace().take(3).collect();
    let [type_name, name] = words[..] else {
        let text = shown(declaration.text);
        let what = format!("{text} declares no parameter; write a type and a name, as in \"float radius\"");
        return Err((declaration.line, what));
    };
    let mut report = |(line, message): Fault| log.problem(&Source { file: file.clone(), line }, message);
    let ty = Type::named(type_name);
    if ty.is_none() {
        let near = did_you_mean(type_name, Type::NAMES.iter().copied());
        report((declaration.line, format!("unknown parameter type {}{near}", shown(type_name))));
    }
    let mut faults = 0;
    let mut values = ty.map_or(Values::Broken, Values::new);
    let bracketed = tokens.open();
    loop {
        match tokens.peek_good() {
            Some(t) if t.kind == Kind::Close && bracketed => {
                tokens.next();
                break;
            }
            // A word that may begin a directive is no value: a bracket or a value is missing.
            Some(t) if t.is_name() || t.kind == Kind::Close || t.kind == Kind::Open => {
                let what = if bracketed { "a ] is missing after" } else { "a value is missing after" };
                return Err((t.line, format!("{what} {}", shown(declaration.text))));
            }
            _ => {}
        }
        let Some(token) = tokens.next() else {
            return Err((declaration.line, format!("the file ends within the values of {}", shown(declaration.text))));
        };
        let token = token?;
        if let Some(Err(fault)) = ty.map(|ty| values.push(&token, ty)) {
            faults += 1;
            if faults <= 3 {
                report(fault);
            }
        }
        if !bracketed {
            break;
        }
    }
    let values = if faults > 0 { Values::Broken } else { values };
    let (ty, name) = (ty.unwrap_or(Type::Float), name.to_owned());
    Ok(Param { ty, name, values, line: declaration.line, taken: false, inherited: false })
}

/// The parameters of one directive. To take a parameter is to read it and mark it as used. [`finish`](Self::finish) reports
/// invalid parameters, and parameters that were never taken.
#[derive(Debug)]
pub(super) struct Params {
    /// The directive's name, for messages.
    pub(super) of: String,
    pub(super) source: Source,
    list: Vec<Param>,
    asked: Vec<&'static str>,
    reports: Vec<(Report, Fault)>,
    /// True after an invalid value or a reported failure; [`finish`](Self::finish) then returns false.
    pub(super) broken: bool,
    /// The state of the file before the directive.
    pub(super) context: Context,
}

/// The state of the file on which parameters depend.
#[derive(Clone, Debug, Default)]
pub(super) struct Context {
    pub(super) version: Version,
    /// The textures made so far.
    pub(super) textures: Rc<Textures>,
}

/// The kinds of messages, in the order in which they are reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Report {
    Problem,
    Unsupported,
    Notice,
}

impl Params {
    /// Makes the list of a directive's own parameters and the parameters inherited from `Attribute`. `of` names the directive
    /// in messages.
    pub(super) fn new(of: String, source: &Source, own: Vec<Param>, inherited: &[Param], context: Context) -> Self {
        let mut by_name: Vec<(&str, u32)> = own.iter().map(|p| (p.name.as_str(), p.line)).collect();
        by_name.sort();
        let twice = by_name.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| {
            let what = format!("parameter {} of {of} is given twice; remove one", shown(pair[0].0));
            (Report::Problem, (pair[1].1, what))
        });
        let reports = twice.collect();
        let mut list = own;
        list.extend(inherited.iter().map(|p| Param { inherited: true, ..p.clone() }));
        Self { of, source: source.clone(), list, asked: Vec::new(), reports, broken: false, context }
    }

    /// Returns the directive's line.
    pub(super) fn line(&self) -> u32 {
        self.source.line
    }

    /// Returns a line of the directive's file.
    pub(super) fn at(&self, line: u32) -> Source {
        Source { line, ..self.source.clone() }
    }

    pub(super) fn problem(&mut self, line: u32, message: impl Into<String>) {
        self.reports.push((Report::Problem, (line, message.into())));
    }

    /// Reports a problem; returns `None`.
    pub(super) fn fail<T>(&mut self, line: u32, message: impl Into<String>) -> Option<T> {
        self.problem(line, message);
        None
    }

    /// Reports an unsupported type of a directive, such as an unknown shape, and suggests the nearest name in `known`.
    /// Ignores the parameters.
    pub(super) fn unsupported_type(&mut self, line: u32, directive: &str, kind: &str, known: &[&str]) {
        let near = nearest_name(kind, known.iter().copied());
        let near = near.map_or(String::new(), |known| format!(" (did you mean \"{known}\"?)"));
        self.unsupported(line, format!("{directive} {}{near}", shown(kind)));
        self.ignore_rest();
    }

    pub(super) fn unsupported(&mut self, line: u32, what: impl Into<String>) {
        self.reports.push((Report::Unsupported, (line, what.into())));
    }

    /// Takes parameters that would change the image and are unsupported, and reports each that was given.
    pub(super) fn refuse(&mut self, names: &[&'static str]) {
        for param in self.given(names) {
            self.unsupported(param.line, format!("parameter {} of {}", param.name, self.of));
        }
    }

    /// Reports a missing parameter, unless an invalid one has been reported. Returns `None`.
    pub(super) fn lacks<T>(&mut self, what: &str) -> Option<T> {
        if !self.is_bad() {
            self.problem(self.source.line, format!("{} lacks {what}", self.of));
        }
        None
    }

    pub(super) fn notice(&mut self, line: u32, message: impl Into<String>) {
        self.reports.push((Report::Notice, (line, message.into())));
    }

    /// Returns true if a parameter taken so far was invalid, or if anything else failed.
    pub(super) fn is_bad(&self) -> bool {
        self.broken || self.reports.iter().any(|(report, _)| *report == Report::Problem)
    }

    /// Returns true if a parameter with this name was given and not yet taken.
    pub(super) fn has(&self, name: &str) -> bool {
        self.list.iter().any(|p| p.name == name && !p.taken)
    }

    /// Returns the parameter with this name without taking it; `None` if it is missing or already taken.
    pub(super) fn peek(&self, name: &str) -> Option<&Param> {
        self.list.iter().find(|p| p.name == name && !p.taken)
    }

    /// Takes the parameter with this name; `None` if it is missing or its value is broken.
    pub(super) fn take(&mut self, name: &'static str) -> Option<Param> {
        self.asked.push(name);
        let index = self.list.iter().position(|p| p.name == name && !p.taken)?;
        // Later parameters of this name are duplicates or hidden inherited ones.
        self.list.iter_mut().filter(|p| p.name == name).for_each(|p| p.taken = true);
        let values = std::mem::replace(&mut self.list[index].values, Values::Broken);
        self.broken |= values == Values::Broken;
        let taken = Param { name: name.to_owned(), values, ..self.list[index] };
        Some(taken).filter(|taken| taken.values != Values::Broken)
    }

    /// Takes the parameter with this name; `None` if it is missing or, with a reported problem, if its type is not
    /// among `types`.
    pub(super) fn take_typed(&mut self, name: &'static str, types: &[Type]) -> Option<Param> {
        let param = self.take(name)?;
        if types.contains(&param.ty) {
            return Some(param);
        }
        let what = format!("is declared {}; write \"{} {name}\"", param.ty.name(), types[0].name());
        self.wrong(name, param.line, what)
    }

    /// Reports a problem of the parameter `name`. The message is its name, then `what`.
    pub(super) fn bad(&mut self, name: &str, line: u32, what: impl std::fmt::Display) {
        self.problem(line, format!("parameter {name} of {} {what}", self.of));
    }

    /// Reports a problem of the parameter `name`; returns `None`.
    pub(super) fn wrong<T>(&mut self, name: &str, line: u32, what: impl std::fmt::Display) -> Option<T> {
        self.bad(name, line, what);
        None
    }

    /// Takes a parameter of numbers. Returns the numbers and the parameter's line.
    fn take_numbers(&mut self, name: &'static str, types: &[Type]) -> Option<(Vec<f64>, u32)> {
        match self.take_typed(name, types)? {
            Param { values: Values::Numbers(values), line, .. } => Some((values, line)),
            _ => None,
        }
    }

    /// Takes a parameter of texts. Returns the texts and the parameter's line.
    pub(super) fn take_texts(&mut self, name: &'static str, ty: Type) -> Option<(Vec<String>, u32)> {
        match self.take_typed(name, &[ty])? {
            Param { values: Values::Texts(values), line, .. } => Some((values, line)),
            _ => None,
        }
    }

    fn one<T: Clone>(&mut self, name: &str, line: u32, values: &[T]) -> Option<T> {
        if let [value] = values {
            return Some(value.clone());
        }
        self.wrong(name, line, format!("takes one value, not {}", values.len()))
    }

    fn number(&mut self, name: &'static str, ty: Type) -> Option<(f64, u32)> {
        let (values, line) = self.take_numbers(name, &[ty])?;
        self.one(name, line, &values).map(|value| (value, line))
    }

    /// Takes a number parameter; returns `default` if it is missing or `ok` rejects it. `range` describes the valid
    /// numbers in messages.
    pub(super) fn float(&mut self, name: &'static str, default: f64, ok: impl Fn(f64) -> bool, range: &str) -> f64 {
        let Some((value, line)) = self.number(name, Type::Float) else { return default };
        if ok(value) {
            return value;
        }
        self.bad(name, line, format!("must be {range}, not {value}"));
        default
    }

    /// Takes a number parameter in single precision; returns `default` if it is missing, overflows or `ok` rejects it.
    /// `range` describes the valid numbers in messages.
    pub(super) fn float32(&mut self, name: &'static str, default: f32, ok: impl Fn(f64) -> bool, range: &str) -> f32 {
        self.float(name, f64::from(default), |v| ok(v) && (v as f32).is_finite(), range) as f32
    }

    /// Takes an integer parameter; `None` if it is missing or not within `least..=most`.
    pub(super) fn integer(&mut self, name: &'static str, least: i32, most: i32) -> Option<i32> {
        let (value, line) = self.number(name, Type::Integer)?;
        if value.fract() == 0.0 && (f64::from(least)..=f64::from(most)).contains(&value) {
            return Some(value as i32);
        }
        let range = if most == i32::MAX { format!("at least {least}") } else { format!("in {least}..={most}") };
        self.wrong(name, line, format!("must be a whole number {range}, not {value}"))
    }

    pub(super) fn flag(&mut self, name: &'static str, default: bool) -> bool {
        let Some(Param { values: Values::Bools(values), line, .. }) = self.take_typed(name, &[Type::Bool]) else {
            return default;
        };
        self.one(name, line, &values).unwrap_or(default)
    }

    /// Takes a string parameter. Returns the string and the parameter's line.
    pub(super) fn text(&mut self, name: &'static str) -> Option<(String, u32)> {
        self.text_of(name, Type::Text)
    }

    /// Takes a parameter of one string, such as the name of a texture. Returns the string and the parameter's line.
    pub(super) fn text_of(&mut self, name: &'static str, ty: Type) -> Option<(String, u32)> {
        let (values, line) = self.take_texts(name, ty)?;
        self.one(name, line, &values).map(|text| (text, line))
    }

    /// Takes a string parameter, and reports a missing one.
    pub(super) fn needed_text(&mut self, name: &'static str) -> Option<(String, u32)> {
        self.text(name).or_else(|| self.lacks(&format!("\"string {name}\"")))
    }

    /// Takes a parameter of several numbers, whose count must be a multiple of `group`. Returns the numbers and the
    /// parameter's line.
    pub(super) fn numbers(&mut self, name: &'static str, types: &[Type], group: usize) -> Option<(Vec<f64>, u32)> {
        let (values, line) = self.take_numbers(name, types)?;
        if !values.is_empty() && values.len() % group == 0 {
            return Some((values, line));
        }
        self.wrong(name, line, format!("takes a multiple of {group} numbers, not {}", values.len()))
    }

    /// Takes a parameter of exactly `N` numbers. Returns the numbers and the parameter's line.
    pub(super) fn array<const N: usize>(&mut self, name: &'static str, ty: Type) -> Option<([f64; N], u32)> {
        let (values, line) = self.take_numbers(name, &[ty])?;
        let array = <[f64; N]>::try_from(values.as_slice()).map(|array| (array, line));
        array.ok().or_else(|| self.wrong(name, line, format!("takes {N} numbers, not {}", values.len())))
    }

    /// Takes unsupported parameters that may be ignored. Adds a notice for each parameter that was given.
    pub(super) fn not_followed(&mut self, names: &[&'static str]) {
        for param in self.given(names) {
            self.notice(param.line, format!("parameter {} of {} is ignored", param.name, self.of));
        }
    }

    /// Takes parameters that have no effect on the image, without a notice.
    pub(super) fn ignore(&mut self, names: &[&'static str]) {
        self.given(names);
    }

    /// Takes the parameters in `names` that were given and are not broken.
    pub(super) fn given(&mut self, names: &[&'static str]) -> Vec<Param> {
        names.iter().filter_map(|name| self.take(name)).collect()
    }

    /// Takes all remaining parameters, without a notice.
    pub(super) fn ignore_rest(&mut self) {
        self.list.iter_mut().for_each(|p| p.taken = true);
    }

    /// Reports all problems, notices and unknown parameters to `log`. Returns true if the directive can be executed.
    pub(super) fn finish(mut self, log: &mut Log) -> bool {
        let good = !self.is_bad();
        self.reports.sort_by_key(|(report, _)| *report);
        for p in self.list.iter().filter(|p| !p.taken && !p.inherited) {
            let near = did_you_mean(&p.name, self.asked.iter().copied());
            let message = format!("{} has no parameter {}; ignored{near}", self.of, shown(&p.name));
            self.reports.push((Report::Notice, (p.line, message)));
        }
        for (report, (line, message)) in self.reports {
            let at = Source { line, ..self.source.clone() };
            match report {
                Report::Problem => log.problem(&at, message),
                Report::Unsupported => log.unsupported(&at, &message),
                Report::Notice => log.notice(&at, message),
            }
        }
        good
    }
}
