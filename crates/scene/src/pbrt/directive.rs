//! Conversion of tokens to directives: each a name, arguments, and a place in the file.

use super::diagnostics::Log;
use super::params::{Param, read_param};
use super::tokens::{Fault, Kind, Token, Tokens, number, shown, unescape};
use crate::Source;
use crate::readers::first_word;
use dapple_core::nearest_name;
use std::path::PathBuf;
use std::sync::Arc;

/// The form of the arguments that a pbrt directive takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// No arguments.
    Bare,
    /// Numbers, in brackets or not. The field is their count.
    Numbers(usize),
    /// Quoted strings. The fields are their smallest and their largest count.
    Texts(usize, usize),
    /// Quoted strings followed by parameters. The field is the count of strings.
    Named(usize),
    /// One unquoted word.
    Word,
}

/// Every directive of pbrt-v4, and the directives of pbrt-v2 and pbrt-v3 that pbrt-v4 dropped, with the form of its
/// arguments. Sorted by name.
const FORMS: &[(&str, Form)] = &[
    ("Accelerator", Form::Named(1)),
    ("ActiveTransform", Form::Word),
    ("AreaLightSource", Form::Named(1)),
    ("Attribute", Form::Named(1)),
    ("AttributeBegin", Form::Bare),
    ("AttributeEnd", Form::Bare),
    ("Camera", Form::Named(1)),
    ("ColorSpace", Form::Texts(1, 1)),
    ("ConcatTransform", Form::Numbers(16)),
    ("CoordSysTransform", Form::Texts(1, 1)),
    ("CoordinateSystem", Form::Texts(1, 1)),
    ("Film", Form::Named(1)),
    ("Identity", Form::Bare),
    ("Import", Form::Texts(1, 1)),
    ("Include", Form::Texts(1, 1)),
    ("Integrator", Form::Named(1)),
    ("LightSource", Form::Named(1)),
    ("LookAt", Form::Numbers(9)),
    ("MakeNamedMaterial", Form::Named(1)),
    ("MakeNamedMedium", Form::Named(1)),
    ("Material", Form::Named(1)),
    ("MediumInterface", Form::Texts(1, 2)),
    ("NamedMaterial", Form::Texts(1, 1)),
    ("ObjectBegin", Form::Texts(1, 1)),
    ("ObjectEnd", Form::Bare),
    ("ObjectInstance", Form::Texts(1, 1)),
    ("Option", Form::Named(0)),
    ("PixelFilter", Form::Named(1)),
    ("Renderer", Form::Named(1)),
    ("ReverseOrientation", Form::Bare),
    ("Rotate", Form::Numbers(4)),
    ("Sampler", Form::Named(1)),
    ("Scale", Form::Numbers(3)),
    ("Shape", Form::Named(1)),
    ("SurfaceIntegrator", Form::Named(1)),
    ("Texture", Form::Named(3)),
    ("Transform", Form::Numbers(16)),
    ("TransformBegin", Form::Bare),
    ("TransformEnd", Form::Bare),
    ("TransformTimes", Form::Numbers(2)),
    ("Translate", Form::Numbers(3)),
    ("Volume", Form::Named(1)),
    ("VolumeIntegrator", Form::Named(1)),
    ("WorldBegin", Form::Bare),
    ("WorldEnd", Form::Bare),
];

/// Returns true if the first word of a text is a directive.
pub(super) fn begins_a_scene(content: &[u8]) -> bool {
    let first = first_word(content).and_then(|word| std::str::from_utf8(word).ok());
    first.is_some_and(|word| FORMS.iter().any(|(known, _)| *known == word))
}

/// One directive of a pbrt file: its name, arguments and place.
#[derive(Debug)]
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
                Ok(token) => Err((token.line, format!("a directive should stand here, not {}", shown(token.text)))),
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
        let Some(form) = form_of(word.text) else { return Err((word.line, unknown(word.text))) };
        let source = Source { file: self.file.clone(), line: word.line };
        let mut directive =
            Directive { word: word.text, source, numbers: Vec::new(), texts: Vec::new(), params: Vec::new() };
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
        let bracketed = self.tokens.peek_good().is_some_and(|t| t.kind == Kind::Open);
        if bracketed {
            self.tokens.next();
        }
        let mut numbers = Vec::with_capacity(count);
        loop {
            let full = numbers.len() == count;
            if full && !bracketed {
                return Ok(numbers);
            }
            let wanted = if full { "]".to_owned() } else { format!("number {} of {count}", numbers.len() + 1) };
            // A directive in place of a number is not consumed, so that it is read next.
            if let Some(token) = self.tokens.peek_good().filter(|t| t.is_name() || t.kind == Kind::Text) {
                return Err((token.line, format!("{} takes {count} numbers: {wanted} is missing", word.text)));
            }
            let token = self.argument(word, &wanted)?;
            match token.kind {
                Kind::Close if bracketed && full => return Ok(numbers),
                Kind::Word if !full => numbers.push(number(&token)?),
                _ if full => return Err((token.line, format!("{} takes {count} numbers, not more", word.text))),
                _ => return Err((token.line, format!("{} takes {count} numbers: {wanted} is missing", word.text))),
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
    FORMS.binary_search_by(|(name, _)| (*name).cmp(word)).ok().map(|i| FORMS[i].1)
}

fn unknown(word: &str) -> String {
    match nearest_name(word, FORMS.iter().map(|f| f.0)) {
        Some(known) => format!("unknown directive {}; did you mean \"{known}\"?", shown(word)),
        None => format!("unknown directive {}; remove it or correct its spelling", shown(word)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_are_sorted() {
        assert!(FORMS.is_sorted_by(|a, b| a.0 < b.0));
    }
}
