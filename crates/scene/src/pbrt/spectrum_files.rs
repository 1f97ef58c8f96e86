//! Files of spectra: pairs of a wavelength in nm and a value.

use super::params::{Param, Type, Values};
use super::reader::Reader;
use super::spectra::{is_named, near_name};
use super::tokens::shown;
use crate::Source;
use std::io::ErrorKind;

impl Reader<'_> {
    /// Replaces each file name in a spectrum parameter by the numbers in the file.
    pub(super) fn load_spectra(&mut self, params: &mut [Param], source: &Source) {
        for param in params.iter_mut().filter(|p| p.ty == Type::Spectrum) {
            let Values::Texts(names) = &param.values else { continue };
            let [name] = &names[..] else { continue };
            if is_named(name) {
                continue;
            }
            let at = Source { line: param.line, ..source.clone() };
            let name = name.clone();
            param.values = self.spectrum_file(&name, &at).map_or(Values::Broken, Values::Numbers);
        }
    }

    fn spectrum_file(&mut self, name: &str, at: &Source) -> Option<Vec<f64>> {
        let path = self.resolve(name);
        match self.files.read(&path) {
            Err(e) if e.kind() == ErrorKind::NotFound => {
                let near = near_name(name).map_or(String::new(), |n| format!("; did you mean \"{n}\"?"));
                self.log.problem(at, format!("spectrum {} is neither known by name nor a file{near}", shown(name)));
                return None;
            }
            // `load` reads the file again and reports the error.
            Err(_) => {
                self.load(&path, at);
                return None;
            }
            Ok(bytes) => match numbers(&bytes) {
                Ok(numbers) => return Some(numbers),
                Err((line, what)) => {
                    let file = std::sync::Arc::new(path);
                    self.log.problem(&Source { file, line }, what);
                }
            },
        }
        None
    }
}

/// Parses all numbers of a text; `#` begins a comment. The error is the line, from 1, and a message.
fn numbers(bytes: &[u8]) -> Result<Vec<f64>, (u32, String)> {
    let mut numbers = Vec::new();
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let line_number = i as u32 + 1;
        let content = line.split(|&b| b == b'#').next().unwrap_or_default();
        let text = std::str::from_utf8(content).map_err(|_| (line_number, "this is not UTF-8".to_owned()))?;
        for word in text.split_ascii_whitespace() {
            match word.parse::<f64>() {
                Ok(value) if value.is_finite() => numbers.push(value),
                _ => {
                    let what = format!("{} is not a number; a spectrum file holds wavelengths and values", shown(word));
                    return Err((line_number, what));
                }
            }
        }
    }
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use super::numbers;

    #[test]
    fn files_of_numbers() {
        assert_eq!(numbers(b"# gold\n400 1.5\r\n500 2e0 # end\n").unwrap(), [400.0, 1.5, 500.0, 2.0]);
        let (line, what) = numbers(b"400 1\n500 x").unwrap_err();
        assert!(line == 2 && what.contains("\"x\" is not a number"));
        assert!(numbers(b"400 nan").is_err() && numbers(b"\xff").is_err());
    }
}
