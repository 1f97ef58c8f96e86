//! Comma-separated lists of names whose parameters contain commas, too.

/// Splits a list of names at its commas, except at commas between the parameters of one name.
///
/// After a comma, `key=value` is a parameter of the name before it. Anything else begins the next name.
///
/// ```
/// let names = dapple_study::split_names("uniform,mitchell:mode=budget,radius=2,variance");
/// assert_eq!(names, ["uniform", "mitchell:mode=budget,radius=2", "variance"]);
/// ```
pub fn split_names(list: &str) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for piece in list.split(',').map(str::trim).filter(|piece| !piece.is_empty()) {
        let first = piece.find([':', '=']).map(|at| piece.as_bytes()[at]);
        match names.last_mut() {
            Some(name) if first == Some(b'=') => {
                name.push(',');
                name.push_str(piece);
            }
            _ => names.push(piece.to_owned()),
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_stay_with_their_name() {
        let cases: [(&str, &[&str]); 6] = [
            ("", &[]),
            ("a", &["a"]),
            (" a , b ,", &["a", "b"]),
            ("a:x=1,y=2,b:z=3,w=4,c", &["a:x=1,y=2", "b:z=3,w=4", "c"]),
            // An unknown name is a name too, so that the registry can list the known ones.
            ("a,nonesuch,b", &["a", "nonesuch", "b"]),
            ("x=1,a", &["x=1", "a"]),
        ];
        for (list, names) in cases {
            assert_eq!(split_names(list), names, "{list}");
        }
    }
}
