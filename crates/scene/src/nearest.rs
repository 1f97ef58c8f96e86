//! The nearest known name to a misspelt one.

/// The known name closest to a misspelt one, if any is close.
pub(crate) fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    // Words that only noise could make are not worth the time.
    if word.len() > 64 {
        return None;
    }
    let most = 1 + word.chars().count() / 4;
    known.into_iter().map(|k| (edit_distance(word, k), k)).filter(|&(d, _)| d <= most.min(3)).min().map(|(_, k)| k)
}

/// Insertions, deletions and replacements of ASCII-case-folded characters that turn `a` into `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().map(|c| c.to_ascii_lowercase()).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().map(|c| c.to_ascii_lowercase()).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_nearest_names() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("Fov", "fov"), 0);
        assert_eq!(nearest("fob", ["radius", "fov"]), Some("fov"));
        assert_eq!(nearest("zzz", ["radius", "fov"]), None);
    }
}
