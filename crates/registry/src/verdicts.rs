//! Results of the race of all methods.

/// The rows that `docs/results/methods.py` writes: kind, description of the method and result, with tabs between.
const TABLE: &str = include_str!("verdicts.tsv");

/// The results of a method in the race of all methods (docs/results/methods.md): each description of it that took part, with its
/// result in one line.
///
/// `kind` is `sampler`, `points` or `filter`; `name` is the entry's. Methods that took no part have none.
///
/// ```
/// assert_eq!(dapple_registry::verdicts("sampler", "none of ours").count(), 0);
/// ```
pub fn verdicts<'a>(kind: &'a str, name: &'a str) -> impl Iterator<Item = (&'static str, &'static str)> + 'a {
    let rows = TABLE.lines().filter_map(|line| {
        let (of, rest) = line.split_once('\t')?;
        let (description, result) = rest.split_once('\t')?;
        Some((of, description, result))
    });
    let is_meant = move |of: &str, description: &str| of == kind && description.split([':', ' ']).next() == Some(name);
    rows.filter(move |(of, description, _)| is_meant(of, description))
        .map(|(_, description, result)| (description, result))
}
