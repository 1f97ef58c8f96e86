//! A tree of samples with bounds that are linear in time.

use super::samples::{At, Sample, Seen, radius};
use crate::Defocus;

/// The largest number of samples in a leaf.
const LEAF: usize = 8;
/// The number of samples from which on the two halves are built in parallel.
const PARALLEL: usize = 1 << 14;

/// The smallest and the largest column, row and inverse depth of a set of samples through the lens' centre. Each is given when the shutter
/// opens and when it closes, and holds for all times in between by linear interpolation.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 6],
    high: [f32; 6],
}

impl Bounds {
    const EMPTY: Self = Self { low: [f32::INFINITY; 6], high: [f32::NEG_INFINITY; 6] };

    /// The bounds of one sample: column, row and inverse depth at both ends, widened by the largest distance of its path from
    /// linear interpolation.
    fn of(sample: &Sample) -> Self {
        let [(from, near), (to, far)] = [sample.through_centre(0.0), sample.through_centre(1.0)];
        // The share of the way is `t b / ((1 - t) a + t b)` for depths `a` and `b`, which differs from `t` most by this.
        let [a, b] = [sample.depth(0.0).sqrt(), sample.depth(1.0).sqrt()];
        let apart = ((b - a) / (b + a)).abs();
        let mut bounds = Self::EMPTY;
        for (k, ends) in [[from[0], to[0]], [from[1], to[1]], [near, far]].into_iter().enumerate() {
            let slack = apart * (ends[1] - ends[0]).abs();
            for (end, x) in ends.into_iter().enumerate() {
                bounds.low[2 * k + end] = ((x - slack) as f32).next_down();
                bounds.high[2 * k + end] = ((x + slack) as f32).next_up();
            }
        }
        bounds
    }

    fn join(&mut self, other: &Self) {
        for k in 0..6 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }

    /// The axis along which the samples spread most, with inverse depths measured by their blur in pixels.
    fn widest(&self, defocus: &Defocus) -> usize {
        let blur = defocus.by_inverse_depth.map(f32::abs).into_iter().fold(0.0, f32::max);
        let extent = |k: usize| (self.high[k] - self.low[k]) * if k < 4 { 1.0 } else { blur };
        (1..6).fold(0, |best, k| if extent(k) > extent(best) { k } else { best })
    }

    /// Returns `true` if a sample within these bounds can be seen within `reach` of a point.
    fn reaches(&self, defocus: &Defocus, at: &At, reach: f64) -> bool {
        let between = |ends: &[f32; 6], k: usize| {
            let [from, to] = [2 * k, 2 * k + 1].map(|k| f64::from(ends[k]));
            from + at.time * (to - from)
        };
        let blurs = [between(&self.low, 2), between(&self.high, 2)].map(|q| radius(defocus, q));
        (0..2).all(|axis| {
            let [a, b] = blurs.map(|blur| blur[axis] * at.lens[axis]);
            let (low, high) = (between(&self.low, axis) + a.min(b), between(&self.high, axis) + a.max(b));
            low - reach <= at.place[axis] && at.place[axis] <= high + reach
        })
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// The distance to the second child; the first is the next node. 0 for a leaf.
    second: u32,
}

/// Samples in the order of a balanced tree.
#[derive(Debug)]
pub(super) struct Tree {
    samples: Vec<Sample>,
    nodes: Vec<Node>,
    defocus: Defocus,
}

/// The number of nodes over `count` samples.
fn nodes(count: usize) -> usize {
    if count <= LEAF { 1 } else { 1 + nodes(count / 2) + nodes(count - count / 2) }
}

/// Sorts samples into a tree, and writes its nodes.
fn build(samples: &mut [Sample], nodes: &mut [Node], defocus: &Defocus) {
    let mut bounds = Bounds::EMPTY;
    samples.iter().for_each(|sample| bounds.join(&Bounds::of(sample)));
    nodes[0] = Node { bounds, second: 0 };
    if samples.len() <= LEAF {
        return;
    }
    let axis = bounds.widest(defocus);
    let key = |sample: &Sample| {
        let (place, inverse_depth) = sample.through_centre((axis % 2) as f64);
        if axis < 4 { place[axis / 2] } else { inverse_depth }
    };
    let middle = samples.len() / 2;
    samples.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let (first, second) = samples.split_at_mut(middle);
    let behind = self::nodes(first.len());
    nodes[0].second = 1 + behind as u32;
    let (of_first, of_second) = nodes[1..].split_at_mut(behind);
    let mut both = [(first, of_first), (second, of_second)];
    if middle < PARALLEL {
        both.iter_mut().for_each(|(samples, nodes)| build(samples, nodes, defocus));
    } else {
        let [a, b] = &mut both;
        rayon::join(|| build(a.0, a.1, defocus), || build(b.0, b.1, defocus));
    }
}

impl Tree {
    /// The bytes per sample.
    pub(super) const BYTES: usize = size_of::<Sample>() + size_of::<Node>() / 2;

    pub(super) fn new(mut samples: Vec<Sample>, defocus: Defocus) -> Self {
        let mut nodes = vec![Node { bounds: Bounds::EMPTY, second: 0 }; nodes(samples.len())];
        build(&mut samples, &mut nodes, &defocus);
        Self { samples, nodes, defocus }
    }

    pub(super) fn sample(&self, index: u32) -> &Sample {
        &self.samples[index as usize]
    }

    /// Calls `visit` with each sample within `reach` of a point, as seen from there, and its index. Places are relative to
    /// the point's.
    pub(super) fn gather(&self, at: &At, reach: f64, mut visit: impl FnMut(u32, Seen)) {
        // Node, first sample, and number of samples. The depth of the tree is below 32.
        let mut stack = [(0_usize, 0_usize, 0_usize); 40];
        stack[0] = (0, 0, self.samples.len());
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (number, first, count) = stack[waiting];
            let node = &self.nodes[number];
            if !node.bounds.reaches(&self.defocus, at, reach) {
                continue;
            }
            if node.second > 0 {
                let half = count / 2;
                stack[waiting] = (number + node.second as usize, first + half, count - half);
                stack[waiting + 1] = (number + 1, first, half);
                waiting += 2;
                continue;
            }
            for index in first..first + count {
                let mut seen = self.samples[index].seen(&self.defocus, at.lens, at.time);
                (0..2).for_each(|axis| seen.place[axis] -= at.place[axis]);
                let [x, y] = seen.place;
                if x * x + y * y <= reach * reach {
                    visit(index as u32, seen);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::unit;
    use dapple_core::Trajectory;

    #[test]
    fn a_gather_finds_exactly_the_samples_within_reach() {
        let defocus = Defocus::new([9.0, -8.0], [-20.0, 18.0]);
        let of = |k: u64| {
            let u = |lane: u64| f64::from(unit(16 * k + lane));
            let at = At {
                place: [40.0 * u(0), 30.0 * u(1)],
                lens: super::super::samples::on_disk([u(2), u(3)]),
                time: u(4),
            };
            let motion = [6.0 * u(5) - 3.0, 4.0 * u(6) - 2.0, 1.4 * u(7) - 0.7].map(|x| x as f32);
            (at, Trajectory::new(u(8) as f32, motion))
        };
        let made = (0..3000).map(|k| {
            let (at, path) = of(k);
            Sample::new(&at, &path, &defocus, [k as f32; 3])
        });
        let samples: Vec<Sample> = made.collect();
        let tree = Tree::new(samples.clone(), defocus);
        let mut most = 0;
        for k in 0..400 {
            let (at, reach) = (of(10_000 + k).0, 0.3 * (1 << (k % 4)) as f64);
            let mut found = Vec::new();
            tree.gather(&at, reach, |index, _| found.push(tree.sample(index).radiance[0]));
            found.sort_by(f32::total_cmp);
            let near = |sample: &&Sample| {
                let [x, y] = sample.seen(&defocus, at.lens, at.time).place;
                (x - at.place[0]).powi(2) + (y - at.place[1]).powi(2) <= reach * reach
            };
            let expected: Vec<f32> = samples.iter().filter(near).map(|sample| sample.radiance[0]).collect();
            assert_eq!(found, expected);
            most = most.max(found.len());
        }
        assert!(most > 20, "{most}");
    }

    #[test]
    fn a_sample_made_at_a_point_is_seen_there() {
        let defocus = Defocus::new([9.0, -8.0], [-20.0, 18.0]);
        let at = At { place: [17.5, 3.25], lens: [0.5, -0.25], time: 0.75 };
        let sample = Sample::new(&at, &Trajectory::new(0.7, [2.0, -1.0, 0.3]), &defocus, [0.0; 3]);
        let seen = sample.seen(&defocus, at.lens, at.time);
        assert!((0..2).all(|axis| (seen.place[axis] - at.place[axis]).abs() < 1e-5), "{seen:?}");
        // Its changes with lens and time are those of finite differences.
        let step = 1e-6;
        let later = sample.seen(&defocus, at.lens, at.time + step);
        let aside = sample.seen(&defocus, at.lens.map(|x| x + step), at.time);
        for axis in 0..2 {
            let [by_time, by_lens] = [later, aside].map(|other| (other.place[axis] - seen.place[axis]) / step);
            assert!((by_time - seen.by_time[axis]).abs() < 1e-3 && (by_lens - seen.by_lens[axis]).abs() < 1e-3);
        }
    }
}
