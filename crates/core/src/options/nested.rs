//! Descriptions of methods as the values of other methods' parameters.

/// Writes a description `NAME:key=value,key=value` so that it can be the value of a parameter: `NAME/key=value/key=value`.
///
/// Descriptions that are values of this description's own parameters get one more `/` at each separator, so any depth
/// is unambiguous. [`unnested`] is the inverse.
///
/// ```
/// use dapple_core::{nested, unnested};
///
/// let inner = nested("gaussian:alpha=2,radius=1");
/// assert_eq!(inner, "gaussian/alpha=2/radius=1");
/// let outer = nested(&format!("blend:of={inner},weight=0.5"));
/// assert_eq!(outer, "blend/of=gaussian//alpha=2//radius=1/weight=0.5");
/// assert_eq!(unnested(&unnested(&outer)["blend:of=".len()..].split(',').next().unwrap()), "gaussian:alpha=2,radius=1");
/// ```
pub fn nested(description: &str) -> String {
    let mut text = String::with_capacity(description.len());
    let mut named = false;
    let mut before = ' ';
    for c in description.chars() {
        match c {
            ':' if !named => {
                named = true;
                text.push('/');
            }
            ',' => text.push('/'),
            // One more at the start of each run.
            '/' if before != '/' => text.push_str("//"),
            c => text.push(c),
        }
        before = c;
    }
    text
}

/// Reads the value of a parameter that [`nested`] writes: `NAME/key=value/key=value` is the description
/// `NAME:key=value,key=value`.
pub fn unnested(value: &str) -> String {
    let mut text = String::with_capacity(value.len());
    let mut separators = [':'].into_iter().chain(std::iter::repeat(','));
    let mut rest = value;
    while let Some(at) = rest.find('/') {
        text.push_str(&rest[..at]);
        let run = rest[at..].len() - rest[at..].trim_start_matches('/').len();
        match run {
            1 => text.extend(separators.next()),
            deeper => text.extend(std::iter::repeat_n('/', deeper - 1)),
        }
        rest = &rest[at + run..];
    }
    text.push_str(rest);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptions_of_any_depth_are_read_back() {
        let mut description = "uniform".to_owned();
        for depth in 0..6 {
            let value = nested(&description);
            assert!(!value.contains([':', ',']), "{value} cannot be the value of a parameter");
            assert_eq!(unnested(&value), description, "depth {depth}");
            description = format!("then:first={value},spp={depth},second=adaptive/by=nlm/pilot=4");
        }
    }

    #[test]
    fn only_the_first_separator_follows_a_name() {
        assert_eq!(unnested("a/b=1/c=2/d=3"), "a:b=1,c=2,d=3");
        assert_eq!(unnested("a"), "a");
        assert_eq!(unnested("a/of=b//c=1//d=2/e=3"), "a:of=b/c=1/d=2,e=3");
        assert_eq!((unnested(""), unnested("/"), nested("")), (String::new(), ":".into(), String::new()));
    }
}
