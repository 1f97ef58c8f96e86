//! Division of a pbrt file's text into tokens, and of tokens into directives: each a name, arguments, and a place.

use super::Log;
use super::params::{Param, read_param};
use super::reader::unknown_name;
use crate::Source;
use crate::readers::first_word;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

/// One token of a pbrt file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Token<'t> {
    pub(super) kind: Kind,
    /// The text as written, without quotes.
    pub(super) text: &'t str,
    /// The line of the token, from 1.
    pub(super) line: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// An unquoted word: a directive, a number, `true` or `false`.
    Word,
    /// A quoted string.
    Text,
    /// An opening bracket, `[`.
    Open,
    /// A closing bracket, `]`.
    Close,
}

impl Token<'_> {
    /// Returns true if the token may begin a directive.
    pub(super) fn is_name(&self) -> bool {
        self.kind == Kind::Word
            && self.text.starts_with(|c: char| c.is_ascii_alphabetic())
            && !matches!(self.text, "true" | "false" | "nan" | "NaN" | "inf" | "Inf" | "infinity" | "Infinity")
    }
}

/// An error: its line, and its message.
pub(super) type Fault = (u32, String);

/// An iterator over the tokens of a text, with a look-ahead of one token.
#[derive(Debug)]
pub(super) struct Tokens<'t> {
    text: &'t str,
    at: usize,
    line: u32,
    ahead: Option<Option<Result<Token<'t>, Fault>>>,
}

impl<'t> Tokens<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { text, at: 0, line: 1, ahead: None }
    }

    /// Returns the line that the scan has reached, from 1.
    pub(super) fn line(&self) -> u32 {
        self.line
    }

    /// Returns the next token without consuming it; `None` at the end of the text.
    pub(super) fn peek(&mut self) -> Option<&Result<Token<'t>, Fault>> {
        if self.ahead.is_none() {
            self.ahead = Some(self.scan());
        }
        self.ahead.as_ref().and_then(Option::as_ref)
    }

    /// Returns the next token without consuming it; `None` if it is malformed or the text ends.
    pub(super) fn peek_good(&mut self) -> Option<Token<'t>> {
        self.peek().and_then(|t| t.as_ref().ok()).copied()
    }

    /// Consumes an opening bracket, if one is next.
    pub(super) fn open(&mut self) -> bool {
        self.peek_good().filter(|t| t.kind == Kind::Open).and_then(|_| self.next()).is_some()
    }

    pub(super) fn next(&mut self) -> Option<Result<Token<'t>, Fault>> {
        match self.ahead.take() {
            Some(token) => token,
            None => self.scan(),
        }
    }

    fn scan(&mut self) -> Option<Result<Token<'t>, Fault>> {
        self.skip_space();
        let bytes = self.text.as_bytes();
        let (start, line) = (self.at, self.line);
        let one = |kind| Token { kind, text: &self.text[start..=start], line };
        let token = match *bytes.get(start)? {
            b'[' => one(Kind::Open),
            b']' => one(Kind::Close),
            b'"' => return Some(self.scan_text()),
            _ => {
                let ends = |b: &u8| matches!(b, b' ' | b'\t' | b'\r' | b'\n' | b'"' | b'[' | b']' | b'#');
                let length = bytes[start..].iter().position(ends).unwrap_or(bytes.len() - start);
                self.at = start + length;
                return Some(Ok(Token { kind: Kind::Word, text: &self.text[start..self.at], line }));
            }
        };
        self.at += 1;
        Some(Ok(token))
    }

    fn skip_space(&mut self) {
        let bytes = self.text.as_bytes();
        while let Some(&b) = bytes.get(self.at) {
            match b {
                b'\n' => self.line += 1,
                b' ' | b'\t' | b'\r' => {}
                b'#' => {
                    let rest = &bytes[self.at..];
                    self.at += rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
                    continue;
                }
                _ => return,
            }
            self.at += 1;
        }
    }

    /// Scans a quoted string. As in pbrt, it must end on the line where it begins.
    fn scan_text(&mut self) -> Result<Token<'t>, Fault> {
        let bytes = self.text.as_bytes();
        let start = self.at + 1;
        let mut end = start;
        loop {
            match bytes.get(end) {
                Some(b'"') => break,
                Some(b'\\') if bytes.get(end + 1).is_some_and(|&b| b != b'\n') => end += 2,
                None | Some(b'\n') => {
                    self.at = end;
                    return Err((self.line, "a string lacks its closing quote; add \" on this line".into()));
                }
                Some(_) => end += 1,
            }
        }
        self.at = end + 1;
        Ok(Token { kind: Kind::Text, text: &self.text[start..end], line: self.line })
    }
}

/// Returns the text of a quoted string with escapes such as `\n`, `\t` and `\"` replaced.
pub(super) fn unescape(token: &Token<'_>) -> Result<String, Fault> {
    let mut text = String::with_capacity(token.text.len());
    let mut chars = token.text.chars();
    while let Some(c) = chars.next() {
        if c != '\\' {
            text.push(c);
            continue;
        }
        text.push(match chars.next() {
            Some('n') => '\n',
            Some('t') => '\t',
            Some('r') => '\r',
            Some('b') => '\u{8}',
            Some('f') => '\u{c}',
            Some(c @ ('\\' | '"' | '\'')) => c,
            other => {
                let escape = other.map_or(String::new(), |c| c.to_string());
                return Err((token.line, format!("unknown escape \\{escape} in a string; write \\\\ for a backslash")));
            }
        });
    }
    Ok(text)
}

/// Returns the number that a token holds, correctly rounded to f64; an error if it is not a finite number.
pub(super) fn number(token: &Token<'_>) -> Result<f64, Fault> {
    let plain = |b: u8| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'e' | b'E');
    let bad = |advice: &str| Err((token.line, format!("{} is not a number; {advice}", shown(token.text))));
    if !token.text.bytes().all(plain) {
        return bad(match token.text {
            t if t.contains(',') => "write a point, not a comma, before decimals, and spaces between numbers",
            t if t.to_ascii_lowercase().contains("nan") || t.to_ascii_lowercase().contains("inf") => {
                "only finite numbers are allowed"
            }
            _ => "write it as in -1.5e3",
        });
    }
    match token.text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err((token.line, format!("{} is too large; at most 1.8e308 can be stored", shown(token.text)))),
        Err(_) => bad("write it as in -1.5e3"),
    }
}

/// Returns the text of a token for a message: quoted, and cut after 60 characters.
pub(super) fn shown(text: &str) -> String {
    const MOST: usize = 60;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("\"{}…\"", &text[..end]),
        None => format!("\"{text}\""),
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<(Kind, &str, u32)> {
        let mut tokens = Tokens::new(text);
        std::iter::from_fn(|| tokens.next()).map(|t| t.unwrap()).map(|t| (t.kind, t.text, t.line)).collect()
    }

    #[test]
    fn tokens_have_lines() {
        use Kind::{Close, Open, Text, Word};
        let text = "A[1 2]#c \"[\r\n\"b c\"-1\r\n\n# end\nZ";
        let expected = [
            (Word, "A", 1),
            (Open, "[", 1),
            (Word, "1", 1),
            (Word, "2", 1),
            (Close, "]", 1),
            (Text, "b c", 2),
            (Word, "-1", 2),
            (Word, "Z", 5),
        ];
        assert_eq!(words(text), expected);
    }

    #[test]
    fn strings_end_on_their_line() {
        let mut tokens = Tokens::new("\"ab\ncd");
        assert!(tokens.next().unwrap().unwrap_err().1.contains("closing quote"));
        assert_eq!(tokens.next().unwrap().unwrap().text, "cd");
        let token = |text| Token { kind: Kind::Text, text, line: 1 };
        assert_eq!(unescape(&token(r#"a\"b\\c\n"#)).unwrap(), "a\"b\\c\n");
        assert!(unescape(&token(r"a\q")).is_err());
        assert!(Tokens::new("\"a\\").next().unwrap().is_err());
        assert!(Tokens::new("\"a\\\"").next().unwrap().is_err());
    }

    #[test]
    fn numbers_round_correctly_or_are_errors_i04() {
        let read = |text: &str| number(&Token { kind: Kind::Word, text, line: 3 });
        for (text, value) in [("1", 1.0), ("-0", -0.0), (".5", 0.5), ("+1.", 1.0), ("1e-50", 1e-50), ("1E+3", 1000.0)] {
            assert_eq!(read(text).unwrap().to_bits(), f64::to_bits(value), "{text}");
        }
        // A number of 1000 digits is rounded correctly: it lies just above a tie.
        let long = format!("9007199254740993.{}1", "0".repeat(1000));
        assert_eq!(read(&long).unwrap(), 9_007_199_254_740_994.0);
        for text in ["nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "0x10", "1,5", "1e", "--1", ".", "1_0", "１"]
        {
            let (line, message) = read(text).unwrap_err();
            assert_eq!(line, 3);
            assert!(message.contains(text), "{message}");
        }
    }
}
