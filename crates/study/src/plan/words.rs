//! Lists of registry words, which hold commas themselves.

/// Splits a list at its commas, but for those between the parameters of one word: after a comma, `key=value` belongs
/// to the word before it, and anything else (a name, or a name with `:key=value`) begins the next.
///
/// ```
/// let words = dapple_study::split_words("uniform,mitchell:mode=budget,radius=2,variance");
/// assert_eq!(words, ["uniform", "mitchell:mode=budget,radius=2", "variance"]);
/// ```
pub fn split_words(list: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for piece in list.split(',').map(str::trim).filter(|piece| !piece.is_empty()) {
        let first = piece.find([':', '=']).map(|at| piece.as_bytes()[at]);
        match words.last_mut() {
            Some(word) if first == Some(b'=') => {
                word.push(',');
                word.push_str(piece);
            }
            _ => words.push(piece.to_owned()),
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_stay_with_their_word() {
        let cases: [(&str, &[&str]); 6] = [
            ("", &[]),
            ("a", &["a"]),
            (" a , b ,", &["a", "b"]),
            ("a:x=1,y=2,b:z=3,w=4,c", &["a:x=1,y=2", "b:z=3,w=4", "c"]),
            // What no registry knows is a word of its own, so that the registry says what there is.
            ("a,nonesuch,b", &["a", "nonesuch", "b"]),
            ("x=1,a", &["x=1", "a"]),
        ];
        for (list, words) in cases {
            assert_eq!(split_words(list), words, "{list}");
        }
    }
}
