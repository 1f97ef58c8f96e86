//! Surfaces among the samples around an output point.

use super::samples::Seen;

/// A sample near the output point: its index, and its place relative to the point.
pub(super) type Near = (u32, Seen);

/// The least number of samples of a surface.
const LEAST: usize = 4;
/// The number of samples with which a surface covers the output point in any case.
const MANY: usize = 200;

/// Returns true if two samples pass each other within a box around the output point: `lens` is its half width on the lens,
/// and `time` that in time.
///
/// They do if the offset from one to the other, in its own direction, reverses.
fn pass(a: &Seen, b: &Seen, [lens, time]: [f64; 2]) -> bool {
    let apart = |of: fn(&Seen) -> [f64; 2]| [0, 1].map(|axis| of(b)[axis] - of(a)[axis]);
    let ([x, y], [u, v], [s, t]) = (apart(|seen| seen.place), apart(|seen| seen.by_lens), apart(|seen| seen.by_time));
    let least = lens * ((x * u).abs() + (y * v).abs()) + time * (x * s + y * t).abs();
    let moves = [u, v, s, t] != [0.0; 4];
    moves && x * x + y * y <= least
}

/// Sorts samples by depth, and divides them into surfaces: consecutive samples of which no two pass each other. Writes the
/// end of each surface.
pub(super) fn divide(near: &mut [Near], widths: [f64; 2], ends: &mut Vec<usize>) {
    near.sort_unstable_by(|(a, p), (b, q)| q.inverse_depth.total_cmp(&p.inverse_depth).then(a.cmp(b)));
    ends.clear();
    let mut first = 0;
    for next in 1..near.len() {
        if near[first..next].iter().any(|(_, seen)| pass(seen, &near[next].1, widths)) {
            ends.push(next);
            first = next;
        }
    }
    if !near.is_empty() {
        ends.push(near.len());
    }
}

/// Joins surfaces of less than four samples to the next one behind.
pub(super) fn join_small(ends: &mut Vec<usize>) {
    let (mut first, last) = (0, ends.last().copied());
    ends.retain(|&end| {
        let stays = end - first >= LEAST || Some(end) == last;
        if stays {
            first = end;
        }
        stays
    });
}

/// Returns true if there are samples in all four quadrants around the output point.
pub(super) fn surrounds(surface: &[Near]) -> bool {
    let quadrant = |(_, seen): &Near| 1 << (2 * u8::from(seen.place[0] >= 0.0) + u8::from(seen.place[1] >= 0.0));
    surface.iter().fold(0_u8, |all, near| all | quadrant(near)) == 15
}

/// Returns true if a surface covers the output point: if it has many samples, or a triangle of them around the point. Its
/// edges are at most two radii long, and a corner lies within one.
pub(super) fn covers(surface: &[Near], radius: f64) -> bool {
    let cross = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| ax * by - ay * bx;
    let apart = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| (ax - bx) * (ax - bx) + (ay - by) * (ay - by);
    let (inner, edge) = (radius * radius, 4.0 * radius * radius);
    let corners = || surface.iter().map(|(_, seen)| seen.place);
    let is_corner = |a: [f64; 2]| {
        let beside = |b: &[f64; 2]| apart(a, *b) <= edge;
        // Counterclockwise: b to the left of the line from the point to a, c to its right.
        corners().filter(beside).filter(|&b| cross(a, b) >= 0.0 && b != a).any(|b| {
            corners().filter(beside).any(|c| cross(c, a) >= 0.0 && cross(b, c) >= 0.0 && apart(b, c) <= edge && c != b)
        })
    };
    surface.len() >= MANY || corners().filter(|&a| apart(a, [0.0; 2]) <= inner).any(is_corner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(place: [f64; 2], by_lens: f64, by_time: [f64; 2]) -> Seen {
        Seen { place, inverse_depth: 1.0, by_lens: [by_lens; 2], by_time }
    }

    #[test]
    fn samples_pass_each_other_exactly_if_their_offset_reverses_within_the_box() {
        let rest = seen([0.0; 2], 0.0, [0.0; 2]);
        for (other, expected) in [
            (seen([0.5, 0.0], 4.9, [0.0; 2]), false),
            (seen([0.5, 0.0], -5.1, [0.0; 2]), true),
            (seen([0.5, 0.0], 0.0, [9.9, 0.0]), false),
            (seen([0.5, 0.0], 0.0, [-10.1, 0.0]), true),
            (seen([0.5, 0.0], 0.0, [0.0, 99.0]), false),
            (seen([0.0, 0.0], 0.0, [0.0, 0.0]), false),
            (seen([0.0, 0.0], 0.0, [0.1, 0.0]), true),
        ] {
            assert_eq!(
                [pass(&rest, &other, [0.1, 0.05]), pass(&other, &rest, [0.1, 0.05])],
                [expected; 2],
                "{other:?}"
            );
        }
    }

    #[test]
    fn small_surfaces_join_the_next_one_and_the_last_stays() {
        let joined = |ends: &[usize]| {
            let mut ends = ends.to_vec();
            join_small(&mut ends);
            ends
        };
        assert_eq!(joined(&[3, 7, 8, 9, 12, 14]), [7, 12, 14]);
        assert_eq!(joined(&[2]), [2]);
        assert_eq!(joined(&[4, 8]), [4, 8]);
    }

    #[test]
    fn a_triangle_covers_the_points_inside_and_no_others() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let around = |[x, y]: [f64; 2], radius: f64| {
            let near: Vec<Near> = corners.map(|[a, b]| (0, seen([a - x, b - y], 0.0, [0.0; 2]))).to_vec();
            covers(&near, radius)
        };
        for (k, inside) in (0..400).map(|k| (k, [0.037, 0.041].map(|x| x - 0.2))) {
            let [x, y] = [inside[0] + 0.07 * f64::from(k % 20), inside[1] + 0.07 * f64::from(k / 20)];
            assert_eq!(around([x, y], 0.8), x > 0.0 && y > 0.0 && x + y < 1.0, "{x} {y}");
        }
        assert!(!around([0.3, 0.3], 0.7), "an edge is longer than two radii");
        assert!(covers(&vec![(0, seen([9.0, 9.0], 0.0, [0.0; 2])); 200], 0.1));
    }

    #[test]
    fn samples_in_four_quadrants_surround() {
        let of =
            |places: &[[f64; 2]]| places.iter().map(|&place| (0, seen(place, 0.0, [0.0; 2]))).collect::<Vec<Near>>();
        assert!(surrounds(&of(&[[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [0.0, -2.0]])));
        assert!(!surrounds(&of(&[[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [-0.1, -2.0]])));
    }
}
