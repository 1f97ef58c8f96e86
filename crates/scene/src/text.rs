//! Text of files: encodings, line ends, words and numbers, for every format that is text.

use std::borrow::Cow;
use std::path::Path;
use std::str::FromStr;

/// The byte order mark of UTF-8.
const MARK: &[u8] = b"\xef\xbb\xbf";
/// The number of bytes at the start of a file in which its first word is searched for.
const HEAD: usize = 1 << 16;

/// Returns the text of a file, without its byte order mark and without padding at the end (NUL, Ctrl-Z, and white space after
/// them). Each byte that is not valid UTF-8 is read as Latin-1, and every line end (CRLF, CR) becomes LF.
///
/// # Errors
/// Returns a message for a text in UTF-16 or UTF-32.
pub fn decode(bytes: &[u8]) -> Result<Cow<'_, str>, &'static str> {
    let content = without_mark(bytes)?;
    let is_end = |byte: &u8| matches!(byte, 0 | 0x1a);
    let last = content.iter().rposition(|byte| !is_end(byte) && !byte.is_ascii_whitespace()).map_or(0, |last| last + 1);
    let end = content[last..].iter().position(is_end).map_or(content.len(), |at| last + at);
    let text = lossless(&content[..end]);
    if !text.contains('\r') {
        return Ok(text);
    }
    let mut lines = String::with_capacity(text.len());
    let mut rest = &*text;
    while let Some((line, after)) = rest.split_once('\r') {
        lines.extend([line, "\n"]);
        rest = after.strip_prefix('\n').unwrap_or(after);
    }
    lines.push_str(rest);
    Ok(lines.into())
}

/// Decodes bytes, such as those of a path, as UTF-8. Each byte that is not valid UTF-8 is read as Latin-1.
pub fn lossless(bytes: &[u8]) -> Cow<'_, str> {
    if let Ok(text) = std::str::from_utf8(bytes) {
        return text.into();
    }
    let latin = |chunk: std::str::Utf8Chunk<'_>| {
        let other: String = chunk.invalid().iter().map(|&byte| char::from(byte)).collect();
        chunk.valid().to_owned() + &other
    };
    bytes.utf8_chunks().map(latin).collect::<String>().into()
}

/// The file name of a path without its extension, decoded by [`lossless`]; `None` for a path without a file name.
pub fn file_stem(path: &Path) -> Option<String> {
    path.file_stem().map(|stem| lossless(stem.as_encoded_bytes()).into_owned())
}

/// Returns the bytes of a text after its byte order mark.
///
/// # Errors
/// Returns a message for a text in UTF-16 or UTF-32.
pub(crate) fn without_mark(bytes: &[u8]) -> Result<&[u8], &'static str> {
    // Two characters of ASCII in either byte order.
    let is_wide = match *bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [0, 0, 0xfe, 0xff, ..] => true,
        [a, b, c, d, ..] => {
            let wide = |ascii: [u8; 2], zeros: [u8; 2]| zeros == [0; 2] && ascii.iter().all(|b| (9..127).contains(b));
            wide([a, c], [b, d]) || wide([b, d], [a, c])
        }
        _ => false,
    };
    if is_wide {
        return Err("this text is in UTF-16; save it as UTF-8");
    }
    Ok(bytes.strip_prefix(MARK).unwrap_or(bytes))
}

/// Takes the next line, with its line end, from `left`, a file of text and other bytes; `None` at the end of the file. `lone`
/// is true if CR alone ends lines, so that an LF after it is not part of the line's end.
pub(crate) fn take_line<'b>(left: &mut &'b [u8], lone: bool) -> Option<Cow<'b, str>> {
    let end = left.iter().position(|b| matches!(b, b'\r' | b'\n'))?;
    let crlf = !lone && left[end..].starts_with(b"\r\n");
    let line = lossless(&left[..end]);
    *left = &left[end + 1 + usize::from(crlf)..];
    Some(line)
}

/// The first word of a file, after empty lines and `#` comments. Only the first 64 KiB count.
pub(crate) fn first_word(content: &[u8]) -> Option<&[u8]> {
    let head = without_mark(&content[..content.len().min(HEAD)]).ok()?;
    let mut lines = head.split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"#"))?;
    first.split(|byte| byte.is_ascii_whitespace() || matches!(byte, b'"' | b'[')).next()
}

/// The words of a decoded text, each with its line, from 1. Blanks, line breaks and control characters separate words.
#[derive(Clone)]
pub(crate) struct Words<'t> {
    rest: &'t str,
    line: u32,
}

impl<'t> Words<'t> {
    /// The words of a text whose first line has the number `line`.
    pub(crate) fn new(text: &'t str, line: u32) -> Self {
        Self { rest: text, line }
    }

    /// The text after the last word.
    pub(crate) fn rest(&self) -> &'t str {
        self.rest
    }

    /// The number of the current line.
    pub(crate) fn line(&self) -> u32 {
        self.line
    }

    /// Takes the next words if they are `first` and `second`, apart or joined, in upper or lower case. Returns true if so.
    pub(crate) fn take_pair(&mut self, [first, second]: [&str; 2]) -> bool {
        let mut one = self.clone();
        let Some((_, word)) = one.next() else { return false };
        let joined = word.split_at_checked(first.len());
        if joined.is_some_and(|(a, b)| a.eq_ignore_ascii_case(first) && b.eq_ignore_ascii_case(second)) {
            *self = one;
            return true;
        }
        let apart = word.eq_ignore_ascii_case(first) && one.next().is_some_and(|(_, w)| w.eq_ignore_ascii_case(second));
        if apart {
            *self = one;
        }
        apart
    }

    /// Skips words up to the pair of words, or to the end of the line. Returns true if the line has the pair.
    pub(crate) fn skip_line_to(&mut self, pair: [&str; 2]) -> bool {
        let line = self.line;
        loop {
            let mut ahead = self.clone();
            if ahead.next().is_none_or(|(at, _)| at != line) {
                return false;
            }
            if self.clone().take_pair(pair) {
                return true;
            }
            *self = ahead;
        }
    }
}

impl<'t> Iterator for Words<'t> {
    type Item = (u32, &'t str);

    fn next(&mut self) -> Option<Self::Item> {
        let is_blank = |byte: &u8| *byte <= b' ';
        let bytes = self.rest.as_bytes();
        let start = bytes.iter().position(|byte| !is_blank(byte)).unwrap_or(bytes.len());
        self.line += bytes[..start].iter().filter(|&&byte| byte == b'\n').count() as u32;
        let end = bytes[start..].iter().position(is_blank).map_or(bytes.len(), |length| start + length);
        let word = &self.rest[start..end];
        self.rest = &self.rest[end..];
        (!word.is_empty()).then_some((self.line, word))
    }
}

/// The number that a word holds. NaN and infinity may be written as Rust or Microsoft's runtime does (`nan(ind)`,
/// `-1.#IND`, `1.#INF00`).
pub(crate) fn number<T: FromStr + From<f32>>(word: &str) -> Option<T> {
    word.parse().ok().or_else(|| {
        let size = word.trim_start_matches(['+', '-']);
        let begins = |start: &str| size.get(..start.len()).is_some_and(|head| head.eq_ignore_ascii_case(start));
        match begins("1.#INF") {
            true if word.starts_with('-') => Some(f32::NEG_INFINITY.into()),
            true => Some(f32::INFINITY.into()),
            false => ["nan(", "1.#IND", "1.#QNAN", "1.#SNAN"].into_iter().any(begins).then(|| f32::NAN.into()),
        }
    })
}

/// The name in the argument of a statement, without the blanks and quotes around it.
pub(crate) fn name(argument: &str) -> &str {
    let argument = argument.trim();
    argument.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(argument)
}

/// The possible names in an argument: all of it, since names may hold `#`, and the text before a comment (` # …`).
pub(crate) fn names(argument: &str) -> impl Iterator<Item = &str> {
    let mut marks = argument.match_indices('#').map(|(at, _)| argument.split_at(at));
    let comment = marks.find(|(before, comment)| {
        before.ends_with([' ', '\t']) && comment[1..].chars().next().is_none_or(char::is_whitespace)
    });
    std::iter::once(name(argument)).chain(comment.map(|(before, _)| name(before)))
}
