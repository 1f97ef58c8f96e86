//! The overlap of two pixels' clusters.

use super::*;

fn votes(labels: &[u32]) -> Votes {
    Votes::count(labels.iter().copied())
}

#[test]
fn overlap_is_the_common_share() {
    let cases: [(&[u32], &[u32], f64); 9] = [
        (&[3], &[3], 1.0),
        (&[3], &[4], 0.0),
        (&[3, 3, 3], &[3], 1.0),
        (&[BACKGROUND], &[BACKGROUND, BACKGROUND], 1.0),
        (&[7, 3, 7, 3], &[3, 3], 0.5),
        (&[9, 1, 1, 1], &[1, 9, 9, 9], 0.5),
        (&[1, 2, 3, 4, 5, 6, 7, 8], &[8, 7, 6, 5, 4, 3, 2, 1], 1.0),
        (&[1, 2, 3, 4, 5, 6, 7, 8], &[0, 8, 9], 0.125),
        (&[], &[5, 6], 1.0),
    ];
    for (a, b, wanted) in cases {
        assert_eq!(votes(a).overlap(&votes(b)), wanted, "{a:?} {b:?}");
        assert_eq!(votes(b).overlap(&votes(a)), wanted, "{b:?} {a:?}");
    }
}

#[test]
fn a_ninth_vote_is_not_counted() {
    assert_eq!(votes(&[2; 9]), votes(&[2; 8]));
}
