//! Division of a pbrt file's text into tokens. Texts and names for messages.

use dapple_core::options::nearest_name;

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

/// An iterator over the tokens of a decoded text, with a look-ahead of one token.
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
                let ends = |b: &u8| matches!(b, b' ' | b'\t' | b'\n' | b'"' | b'[' | b']' | b'#');
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
                b' ' | b'\t' => {}
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

/// Returns the message for an unknown name. It suggests the nearest known name or, if none is near, gives `advice`.
pub(super) fn unknown_name<'k>(
    what: &str,
    name: &str,
    known: impl IntoIterator<Item = &'k (impl AsRef<str> + ?Sized + 'k)>,
    advice: &str,
) -> String {
    match nearest_name(name, known.into_iter().map(AsRef::as_ref)) {
        Some(near) => format!("unknown {what} {}; did you mean \"{near}\"?", shown(name)),
        None => format!("unknown {what} {}; {advice}", shown(name)),
    }
}

/// Returns advice to be appended to a message about an unknown name: the nearest known name, if there is one.
pub(super) fn did_you_mean<'k>(name: &str, known: impl IntoIterator<Item = &'k str>) -> String {
    nearest_name(name, known).map_or(String::new(), |near| format!("; did you mean \"{near}\"?"))
}
