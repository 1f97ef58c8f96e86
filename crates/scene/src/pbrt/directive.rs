//! Division of a pbrt file's tokens into directives: each a name, arguments, and a place.

use super::log::Log;
use super::params::{Param, read_param};
use super::tokens::{Fault, Kind, Token, Tokens, number, shown, unescape, unknown_name};
use crate::Source;
use crate::text::first_word;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

/// The form of the arguments that a pbrt directive takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// No arguments.
    Bare,
    /// Numbers, in brackets or not. The field is their count.
    Numbers(usize),
    /// Quoted strings. The fields are the smallest and the largest count.
    Texts(usize, usize),
    /// Quoted strings followed by parameters. The field is the count of strings.
    Named(usize),
    /// One unquoted word.
    Word,
}

/// Every directive of pbrt-v4, and the directives of pbrt-v2 and pbrt-v3 that pbrt-v4 dropped, by the form of its
/// arguments.
const FORMS: &[(Form, &str)] = &[
    (Form::Bare, "AttributeBegin AttributeEnd Identity ObjectEnd ReverseOrientation TransformBegin TransformEnd"),
    (Form::Bare, "WorldBegin WorldEnd"),
    (Form::Numbers(2), "TransformTimes"),
    (Form::Numbers(3), "Scale Translate"),
    (Form::Numbers(4), "Rotate"),
    (Form::Numbers(9), "LookAt"),
    (Form::Numbers(16), "ConcatTransform Transform"),
    (Form::Texts(1, 1), "ColorSpace CoordSysTransform CoordinateSystem Import Include NamedMaterial"),
    (Form::Texts(1, 1), "ObjectBegin ObjectInstance"),
    (Form::Texts(1, 2), "MediumInterface"),
    (Form::Named(0), "Option"),
    (Form::Named(1), "Accelerator AreaLightSource Attribute Camera Film Integrator LightSource MakeNamedMaterial"),
    (Form::Named(1), "MakeNamedMedium Material PixelFilter Renderer Sampler Shape SurfaceIntegrator Volume"),
    (Form::Named(1), "VolumeIntegrator"),
    (Form::Named(3), "Texture"),
    (Form::Word, "ActiveTransform"),
];

/// The names of all directives, each with its form.
fn forms() -> impl Iterator<Item = (&'static str, Form)> {
    FORMS.iter().flat_map(|(form, words)| words.split(' ').map(move |word| (word, *form)))
}

/// Returns true if the first word of a text is a directive.
pub(super) fn begins_a_scene(content: &[u8]) -> bool {
    let first = first_word(content).and_then(|word| std::str::from_utf8(word).ok());
    first.and_then(form_of).is_some()
}

/// One directive of a pbrt file: its name, arguments and place.
#[derive(Debug, Default)]
pub(super) struct Directive<'t> {
    pub(super) word: &'t str,
    pub(super) source: Source,
    pub(super) numbers: Vec<f64>,
    pub(super) texts: Vec<String>,
    pub(super) params: Vec<Param>,
}

/// An iterator over the directives of a pbrt file. Malformed directives are reported and skipped.
pub(super) struct Directives<'t> {
    tokens: Tokens<'t>,
    file: Arc<PathBuf>,
}

impl<'t> Directives<'t> {
    pub(super) fn new(text: &'t str, file: Arc<PathBuf>) -> Self {
        Self { tokens: Tokens::new(text), file }
    }

    /// Returns the file and the line that the reader has reached.
    pub(super) fn here(&self) -> Source {
        Source { file: self.file.clone(), line: self.tokens.line() }
    }

    /// Returns the next well-formed directive; `None` at the end of the file. Reports malformed directives to `log`.
    pub(super) fn next(&mut self, log: &mut Log) -> Option<Directive<'t>> {
        loop {
            let result = match self.tokens.next()? {
                Ok(token) if token.is_name() => self.read(token, log),
                Ok(token) => Err((token.line, format!("expected a directive, not {}; remove it", shown(token.text)))),
                Err(fault) => Err(fault),
            };
            match result {
                Ok(directive) => return Some(directive),
                Err((line, message)) => {
                    log.problem(&Source { file: self.file.clone(), line }, message);
                    self.skip_to_directive();
                }
            }
        }
    }

    fn skip_to_directive(&mut self) {
        while let Some(token) = self.tokens.peek() {
            if token.as_ref().is_ok_and(|t| t.is_name() && form_of(t.text).is_some()) {
                return;
            }
            self.tokens.next();
        }
    }

    fn read(&mut self, word: Token<'t>, log: &mut Log) -> Result<Directive<'t>, Fault> {
        let Some(form) = form_of(word.text) else {
            let known = forms().map(|(known, _)| known);
            let what = unknown_name("directive", word.text, known, "remove it or correct its spelling");
            return Err((word.line, what));
        };
        let source = Source { file: self.file.clone(), line: word.line };
        let mut directive = Directive { word: word.text, source, ..Directive::default() };
        match form {
            Form::Bare => {}
            Form::Numbers(count) => directive.numbers = self.read_numbers(word, count)?,
            Form::Texts(least, most) => directive.texts = self.read_texts(word, least, most)?,
            Form::Named(count) => {
                directive.texts = self.read_texts(word, count, count)?;
                while self.tokens.peek_good().is_some_and(|t| t.kind == Kind::Text) {
                    directive.params.push(read_param(&mut self.tokens, &self.file, log)?);
                }
            }
            Form::Word => {
                let token = self.argument(word, "a word")?;
                directive.texts.push(token.text.to_owned());
            }
        }
        Ok(directive)
    }

    /// Returns the next token as an argument of the directive `word`. `wanted` names the argument in the error at the
    /// end of the file.
    fn argument(&mut self, word: Token<'t>, wanted: &str) -> Result<Token<'t>, Fault> {
        match self.tokens.next() {
            Some(token) => token,
            None => Err((word.line, format!("the file ends within {}: {wanted} is missing", word.text))),
        }
    }

    fn read_numbers(&mut self, word: Token<'t>, count: usize) -> Result<Vec<f64>, Fault> {
        let bracketed = self.tokens.open();
        let mut numbers = Vec::with_capacity(count);
        loop {
            let full = numbers.len() == count;
            if full && !bracketed {
                return Ok(numbers);
            }
            let wanted = if full { "]".to_owned() } else { format!("number {} of {count}", numbers.len() + 1) };
            let missing = format!("{} takes {count} numbers: {wanted} is missing", word.text);
            // A directive in place of a number is not consumed, so that it is read next.
            if let Some(token) = self.tokens.peek_good().filter(|t| t.is_name() || t.kind == Kind::Text) {
                return Err((token.line, missing));
            }
            let token = self.argument(word, &wanted)?;
            match token.kind {
                Kind::Close if bracketed && full => return Ok(numbers),
                Kind::Word if !full => numbers.push(number(&token)?),
                _ if full => return Err((token.line, format!("{} takes {count} numbers, not more", word.text))),
                _ => return Err((token.line, missing)),
            }
        }
    }

    fn read_texts(&mut self, word: Token<'t>, least: usize, most: usize) -> Result<Vec<String>, Fault> {
        let mut texts = Vec::with_capacity(most);
        while texts.len() < most {
            match self.tokens.peek() {
                Some(Ok(token)) if token.kind == Kind::Text => texts.push(unescape(token)?),
                Some(Err(_)) => {}
                _ if texts.len() >= least => return Ok(texts),
                other => {
                    let line = other.and_then(|t| t.as_ref().ok()).map_or(word.line, |t| t.line);
                    let what = format!("{} takes a quoted name here; write it as {} \"…\"", word.text, word.text);
                    return Err((line, what));
                }
            }
            if let Some(Err(fault)) = self.tokens.next() {
                return Err(fault);
            }
        }
        Ok(texts)
    }
}

fn form_of(word: &str) -> Option<Form> {
    static KNOWN: LazyLock<HashMap<&str, Form>> = LazyLock::new(|| forms().collect());
    KNOWN.get(word).copied()
}
