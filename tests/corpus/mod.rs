//! A corpus of small files as people have them, for every reader of scenes, models and images.
//!
//! Each file is made from a plain one by drawn variations: byte order mark, line ends, white space, blank lines,
//! comments, encodings. It is read to the same value as the plain file. `crates/scene/tests/scene/corpus.rs` reads all
//! of it, and the fuzz targets start from it: `DAPPLE_WRITE_CORPUS=fuzz/corpus cargo test -p dapple-scene --test scene
//! corpus` writes it.

mod bases;

/// A file with those that it names, and its right value.
pub(crate) struct Case {
    /// The fuzz target that reads the file.
    pub(crate) target: &'static str,
    /// A name, for messages.
    pub(crate) name: String,
    /// The names of the files and their bytes, the main one first.
    pub(crate) files: Vec<(String, Vec<u8>)>,
    /// The value in words (triangles, area, colours, notices; pixels), or part of the error's message.
    pub(crate) right: &'static str,
}

/// A reader's plain file: its text, or bytes behind a text.
pub(crate) struct Base {
    pub(crate) target: &'static str,
    pub(crate) right: &'static str,
    /// The names of the files and their texts, the main one first. In a text `~` is a blank that stays, and `^` a
    /// backslash before a line end.
    pub(crate) texts: Vec<(&'static str, String)>,
    /// Bytes behind the text of the main file.
    pub(crate) bytes: Vec<u8>,
    pub(crate) form: Form,
}

/// The variations that a format allows.
#[derive(Clone, Copy, Default)]
pub(crate) struct Form {
    /// The word that begins a comment, and the line of the main file before which comments begin.
    pub(crate) comment: Option<(&'static str, usize)>,
    /// Comments may follow values.
    pub(crate) comments_follow: bool,
    /// A line end may stand for a blank.
    pub(crate) free: bool,
    /// The last line must end.
    pub(crate) whole: bool,
}

/// The number of drawn variations of each base.
const DRAWN: usize = 13;
/// The seed of the draws.
const SEED: u64 = 59;

/// All cases. The same ones at every call.
pub(crate) fn cases() -> Vec<Case> {
    let mut random = Random(SEED);
    let mut cases = Vec::new();
    for (number, base) in bases::all().iter().enumerate() {
        for draw in 0..DRAWN {
            let texts = base.texts.iter().enumerate();
            let dressed = texts.map(|(k, (name, text))| {
                let form = if k == 0 { base.form } else { Form { whole: base.form.whole, ..bases::SIDE } };
                let mut bytes = Style::drawn(&mut random, draw).dress(text, form);
                bytes.extend(if k == 0 { &base.bytes[..] } else { &[] });
                ((*name).to_owned(), bytes)
            });
            let name = format!("{}-{number}-{draw}", base.target);
            cases.push(Case { target: base.target, name, files: dressed.collect(), right: base.right });
        }
    }
    cases.extend(bases::wide());
    cases.extend(bases::binary());
    cases
}

/// A drawn variation of a text.
struct Style {
    mark: bool,
    end: &'static str,
    blank: &'static str,
    trailing: &'static str,
    blank_lines: bool,
    latin: bool,
    /// No comments, lines of comments, or comments behind values; those that end in a backslash.
    comments: usize,
    backslash: bool,
    last_end: bool,
}

impl Style {
    /// Draws a style. The first draws of a base have all line ends and both encodings.
    fn drawn(random: &mut Random, draw: usize) -> Self {
        Self {
            mark: random.below(2) == 1,
            end: ["\n", "\r\n", "\r"][draw % 3],
            blank: [" ", "\t", "  ", "\n"][random.below(4)],
            trailing: ["", " ", "\t \t"][random.below(3)],
            blank_lines: random.below(3) == 1,
            latin: draw / 3 % 2 == 1,
            comments: random.below(3),
            backslash: random.below(2) == 1,
            last_end: random.below(4) > 0,
        }
    }

    fn dress(&self, text: &str, form: Form) -> Vec<u8> {
        let blank = if form.free || self.blank != "\n" { self.blank } else { " " };
        let remark = if self.backslash { "caf\u{e9} C:\\" } else { "caf\u{e9}" };
        let mut lines = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let mut line = line.replace(' ', blank).replace('~', " ");
            if let Some((word, first)) = form.comment.filter(|_| self.comments > 0) {
                let is_value =
                    line.starts_with(|c: char| c.is_ascii_lowercase()) && line.ends_with(|c: char| c.is_ascii_digit());
                if self.comments == 2 && form.comments_follow && is_value {
                    line += &format!(" {word} {remark}");
                } else if number >= first && number < first + 3 {
                    lines.push(format!("{word} {remark}"));
                }
            }
            // A backslash must be the last of a line's words.
            lines.push(line.replace('^', &format!("\\{}\n", self.trailing)) + self.trailing);
            if self.blank_lines {
                lines.push(self.trailing.to_owned());
            }
        }
        if self.blank_lines {
            // Bytes may follow the last line.
            lines.pop();
        }
        let mut text = lines.join("\n") + if form.whole || self.last_end { "\n" } else { "" };
        text = text.replace('\n', self.end);
        let mark = if self.mark { &b"\xef\xbb\xbf"[..] } else { b"" };
        let bytes = if self.latin { text.chars().map(|c| c as u8).collect() } else { text.into_bytes() };
        [mark, &bytes].concat()
    }
}

/// Random numbers of SplitMix64 [Steele et al. 2014].
struct Random(u64);

impl Random {
    fn below(&mut self, most: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ mixed >> 31) % most as u64) as usize
    }
}
