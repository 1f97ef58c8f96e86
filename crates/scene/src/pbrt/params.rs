//! The parameters of a directive: typed values by name, each taken at most once.

use super::diagnostics::Log;
use super::legacy::Version;
use super::tokens::{Fault, Kind, Token, Tokens, number, shown, unescape};
use crate::Source;
use dapple_core::nearest_name;
use std::path::PathBuf;
use std::sync::Arc;

/// The type in a parameter's declaration, such as `float`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    Float,
    Integer,
    Bool,
    Text,
    Point2,
    Vector2,
    Point3,
    Vector3,
    Normal,
    Rgb,
    Xyz,
    Spectrum,
    Blackbody,
    Texture,
}

/// The names of the types in any version of pbrt; a type's own name comes before its older ones.
const TYPES: [(&str, Type); 18] = [
    ("float", Type::Float),
    ("integer", Type::Integer),
    ("bool", Type::Bool),
    ("string", Type::Text),
    ("point2", Type::Point2),
    ("vector2", Type::Vector2),
    ("point3", Type::Point3),
    ("vector3", Type::Vector3),
    ("normal", Type::Normal),
    ("rgb", Type::Rgb),
    ("spectrum", Type::Spectrum),
    ("blackbody", Type::Blackbody),
    ("texture", Type::Texture),
    ("xyz", Type::Xyz),
    ("point", Type::Point3),
    ("vector", Type::Vector3),
    ("normal3", Type::Normal),
    ("color", Type::Rgb),
];

impl Type {
    /// Returns the parameter type with this name in any version of pbrt; `None` for an unknown name.
    fn named(name: &str) -> Option<Self> {
        TYPES.iter().find(|(known, _)| *known == name).map(|(_, ty)| *ty)
    }

    fn name(self) -> &'static str {
        TYPES.iter().find(|(_, ty)| *ty == self).map_or("", |(name, _)| name)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Bools(Vec<bool>),
    /// An invalid value, which has been reported.
    Broken,
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
        let what = format!(
            "{} declares no parameter; write a type and a name, as in \"float radius\"",
            shown(declaration.text)
        );
        return Err((declaration.line, what));
    };
    let mut report = |(line, message): Fault| log.problem(&Source { file: file.clone(), line }, message);
    let ty = Type::named(type_name);
    if ty.is_none() {
        report((declaration.line, unknown_type(type_name)));
    }
    let mut faults = 0;
    let mut values: Option<Values> = None;
    let bracketed = tokens.peek_good().is_some_and(|t| t.kind == Kind::Open);
    if bracketed {
        tokens.next();
    }
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
        if let Err(fault) = push_value(&mut values, &token?, ty) {
            faults += 1;
            if faults <= 3 {
                report(fault);
            }
        }
        if !bracketed {
            break;
        }
    }
    let values =
        if faults > 0 || ty.is_none() { Values::Broken } else { values.unwrap_or(Values::Numbers(Vec::new())) };
    let name = name.to_owned();
    Ok(Param { ty: ty.unwrap_or(Type::Float), name, values, line: declaration.line, taken: false, inherited: false })
}

fn unknown_type(name: &str) -> String {
    // Without the names of older versions.
    let near = nearest_name(name, TYPES[..13].iter().map(|(known, _)| *known))
        .map_or(String::new(), |k| format!("; did you mean \"{k}\"?"));
    format!("unknown parameter type {}{near}", shown(name))
}

/// Appends the value of a token to the values of a parameter of type `ty`.
fn push_value(values: &mut Option<Values>, token: &Token<'_>, ty: Option<Type>) -> Result<(), Fault> {
    let wrong = |wanted: &str| {
        let ty = ty.map_or("this type", Type::name);
        Err((token.line, format!("a parameter of type {ty} takes {wanted}, not {}", shown(token.text))))
    };
    match (ty, token.kind) {
        (None, _) => Ok(()),
        (Some(Type::Bool), _) => {
            let flag = match token.text {
                "true" => true,
                "false" => false,
                _ => return wrong("true or false"),
            };
            if let Values::Bools(list) = values.get_or_insert(Values::Bools(Vec::new())) {
                list.push(flag);
            }
            Ok(())
        }
        (Some(Type::Text | Type::Texture | Type::Spectrum), Kind::Text) => {
            let Values::Texts(list) = values.get_or_insert(Values::Texts(Vec::new())) else {
                return wrong("either numbers or one name");
            };
            list.push(unescape(token)?);
            Ok(())
        }
        (Some(Type::Text | Type::Texture), _) => wrong("a quoted name"),
        (_, Kind::Text) => wrong("numbers"),
        (Some(_), _) => {
            let Values::Numbers(list) = values.get_or_insert(Values::Numbers(Vec::new())) else {
                return wrong("either numbers or one name");
            };
            list.push(number(token)?);
            Ok(())
        }
    }
}

/// The parameters of one directive. To take a parameter is to read it and mark it as used. [`finish`](Self::finish)
/// reports invalid parameters, and those never taken.
#[derive(Debug)]
pub(super) struct Params {
    of: String,
    file: Arc<PathBuf>,
    line: u32,
    list: Vec<Param>,
    asked: Vec<&'static str>,
    problems: Vec<Fault>,
    unsupported: Vec<Fault>,
    notices: Vec<Fault>,
    broken: bool,
    version: Version,
}

impl Params {
    /// Makes the list of a directive's own parameters and those inherited from `Attribute`. `of` names the directive in
    /// messages.
    pub(super) fn new(of: String, source: &Source, own: Vec<Param>, inherited: &[Param], version: Version) -> Self {
        let mut problems = Vec::new();
        let mut by_name: Vec<(&str, u32)> = own.iter().map(|p| (p.name.as_str(), p.line)).collect();
        by_name.sort();
        for pair in by_name.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            problems.push((pair[1].1, format!("parameter {} of {of} is given twice; remove one", shown(pair[0].0))));
        }
        let mut list = own;
        list.extend(inherited.iter().map(|p| Param { inherited: true, ..p.clone() }));
        Self {
            of,
            file: source.file.clone(),
            line: source.line,
            list,
            asked: Vec::new(),
            problems,
            unsupported: Vec::new(),
            notices: Vec::new(),
            broken: false,
            version,
        }
    }

    /// Returns the directive's name, for messages.
    pub(super) fn of(&self) -> &str {
        &self.of
    }

    /// Returns the directive's line.
    pub(super) fn line(&self) -> u32 {
        self.line
    }

    /// Returns the pbrt version of the file.
    pub(super) fn version(&self) -> Version {
        self.version
    }

    pub(super) fn problem(&mut self, line: u32, message: impl Into<String>) {
        self.problems.push((line, message.into()));
    }

    /// Reports an unsupported type of a directive, such as an unknown shape, and suggests the nearest of the supported
    /// types `known`. Ignores the parameters.
    pub(super) fn unsupported_type(&mut self, line: u32, directive: &str, kind: &str, known: &[&str]) {
        let near = nearest_name(kind, known.iter().copied());
        let near = near.map_or(String::new(), |known| format!(" (did you mean \"{known}\"?)"));
        self.unsupported(line, format!("{directive} {}{near}", shown(kind)));
        self.ignore_rest();
    }

    pub(super) fn unsupported(&mut self, line: u32, what: impl Into<String>) {
        self.unsupported.push((line, what.into()));
    }

    /// Reports an unsupported feature at the directive's line.
    pub(super) fn unsupported_here(&mut self, what: &str) {
        let line = self.line;
        self.unsupported(line, what);
    }

    /// Takes parameters that would change the image and are unsupported, and reports those that were given.
    pub(super) fn refuse(&mut self, names: &[&'static str]) {
        for &name in names {
            if let Some(param) = self.take(name) {
                self.unsupported(param.line, format!("parameter {name} of {}", self.of));
            }
        }
    }

    /// Reports a missing parameter, unless an invalid one has been reported.
    pub(super) fn lacks(&mut self, line: u32, what: &str) {
        if !self.is_bad() {
            self.problem(line, format!("{} lacks {what}", self.of));
        }
    }

    /// Makes [`finish`](Self::finish) return false, for a failure that the caller has reported.
    pub(super) fn fail(&mut self) {
        self.broken = true;
    }

    pub(super) fn notice(&mut self, line: u32, message: impl Into<String>) {
        self.notices.push((line, message.into()));
    }

    /// Returns true if a parameter taken so far was invalid, or if [`fail`](Self::fail) was called.
    pub(super) fn is_bad(&self) -> bool {
        self.broken || !self.problems.is_empty()
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
        let mut taken = self.list[index].clone_head();
        for p in self.list.iter_mut().filter(|p| p.name == name) {
            p.taken = true;
        }
        taken.values = std::mem::replace(&mut self.list[index].values, Values::Broken);
        if taken.values == Values::Broken {
            self.broken = true;
            return None;
        }
        Some(taken)
    }

    /// Takes the parameter with this name; `None` if it is missing or, with a reported problem, if its type is not
    /// among `types`.
    pub(super) fn take_typed(&mut self, name: &'static str, types: &[Type]) -> Option<Param> {
        let param = self.take(name)?;
        if types.contains(&param.ty) {
            return Some(param);
        }
        let what = format!(
            "parameter {name} of {} is declared {}; write \"{} {name}\"",
            self.of,
            param.ty.name(),
            types[0].name()
        );
        self.problem(param.line, what);
        None
    }

    fn one<T: Clone>(&mut self, name: &str, line: u32, values: &[T]) -> Option<T> {
        if let [value] = values {
            return Some(value.clone());
        }
        self.problem(line, format!("parameter {name} of {} takes one value, not {}", self.of, values.len()));
        None
    }

    fn number(&mut self, name: &'static str, ty: Type) -> Option<(f64, u32)> {
        let param = self.take_typed(name, &[ty])?;
        let Values::Numbers(values) = param.values else { return None };
        self.one(name, param.line, &values).map(|value| (value, param.line))
    }

    /// Takes a number parameter; returns `default` if it is missing or `ok` rejects it. `range` describes the valid
    /// numbers in messages.
    pub(super) fn float(&mut self, name: &'static str, default: f64, ok: impl Fn(f64) -> bool, range: &str) -> f64 {
        let Some((value, line)) = self.number(name, Type::Float) else { return default };
        if ok(value) {
            return value;
        }
        self.problem(line, format!("parameter {name} of {} must be {range}, not {value}", self.of));
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
        self.problem(line, format!("parameter {name} of {} must be a whole number {range}, not {value}", self.of));
        None
    }

    pub(super) fn flag(&mut self, name: &'static str, default: bool) -> bool {
        let Some(Param { values: Values::Bools(values), line, .. }) = self.take_typed(name, &[Type::Bool]) else {
            return default;
        };
        self.one(name, line, &values).unwrap_or(default)
    }

    /// Takes a string parameter. Returns the string and the parameter's line.
    pub(super) fn text(&mut self, name: &'static str) -> Option<(String, u32)> {
        let param = self.take_typed(name, &[Type::Text])?;
        let Values::Texts(values) = param.values else { return None };
        self.one(name, param.line, &values).map(|text| (text, param.line))
    }

    /// Takes a parameter of several numbers, whose count must be a multiple of `group`. Returns the numbers and the
    /// parameter's line.
    pub(super) fn numbers(&mut self, name: &'static str, types: &[Type], group: usize) -> Option<(Vec<f64>, u32)> {
        let param = self.take_typed(name, types)?;
        let Values::Numbers(values) = param.values else { return None };
        if !values.is_empty() && values.len() % group == 0 {
            return Some((values, param.line));
        }
        let (of, count) = (&self.of, values.len());
        self.problem(param.line, format!("parameter {name} of {of} takes a multiple of {group} numbers, not {count}"));
        None
    }

    /// Takes a parameter of exactly `N` numbers. Returns the numbers and the parameter's line.
    pub(super) fn array<const N: usize>(&mut self, name: &'static str, ty: Type) -> Option<([f64; N], u32)> {
        let param = self.take_typed(name, &[ty])?;
        let Values::Numbers(values) = param.values else { return None };
        let array = <[f64; N]>::try_from(values.as_slice()).ok();
        if array.is_none() {
            let what = format!("parameter {name} of {} takes {N} numbers, not {}", self.of, values.len());
            self.problem(param.line, what);
        }
        array.map(|a| (a, param.line))
    }

    /// Takes unsupported parameters that may be ignored. Adds a notice for each parameter that was given.
    pub(super) fn not_followed(&mut self, names: &[&'static str]) {
        for &name in names {
            if let Some(param) = self.take(name) {
                self.notice(param.line, format!("parameter {name} of {} is not followed", self.of));
            }
        }
    }

    /// Takes parameters that have no effect on the image, without a notice.
    pub(super) fn ignore(&mut self, names: &[&'static str]) {
        for &name in names {
            self.take(name);
        }
    }

    /// Takes all remaining parameters, without a notice.
    pub(super) fn ignore_rest(&mut self) {
        self.list.iter_mut().for_each(|p| p.taken = true);
    }

    /// Reports all problems, notices and unknown parameters to `log`. Returns true if the directive can be executed.
    pub(super) fn finish(mut self, log: &mut Log) -> bool {
        let source = |line| Source { file: self.file.clone(), line };
        for (line, message) in &self.problems {
            log.problem(&source(*line), message.clone());
        }
        for (line, what) in &self.unsupported {
            log.unsupported(&source(*line), what);
        }
        for (line, message) in &self.notices {
            log.notice(&source(*line), message.clone());
        }
        self.list.retain(|p| !p.taken && !p.inherited);
        for p in &self.list {
            let near = nearest_name(&p.name, self.asked.iter().copied());
            let near = near.map_or(String::new(), |k| format!("; did you mean \"{k}\"?"));
            let message = format!("{} has no parameter {}; ignored{near}", self.of, shown(&p.name));
            log.notice(&Source { file: self.file.clone(), line: p.line }, message);
        }
        !self.is_bad()
    }
}

impl Param {
    fn clone_head(&self) -> Self {
        Self { name: self.name.clone(), values: Values::Broken, ..*self }
    }
}
