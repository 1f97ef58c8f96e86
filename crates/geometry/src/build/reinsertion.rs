//! Reinsertion of subtrees at places where the tree's expected cost is lower
//! [after Meister and Bittner 2018, their paper on parallel reinsertion].
//!
//! The moves are those of obvhs, but for the order of moves that gain the same: here the node's number decides. obvhs
//! keeps its nodes in a `Vec`, which has small pages only, and clears a byte for each node twice a round.

use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Reinserts subtrees in rounds of fewer and fewer candidates, the largest of the first nodes. `ratio` is the part of
/// all nodes that the first round tries.
pub(super) fn reinsert(nodes: &mut [Bvh2Node], ratio: f32) {
    let count = nodes.len();
    if count < 2 || ratio <= 0.0 {
        return;
    }
    let mut tree = Linked::new(nodes);
    for part in (1..32).step_by(2) {
        let candidates = (((count as f32 * ratio) * (1.0 / part as f32)) as usize).clamp(1, count - 1);
        tree.round(candidates);
    }
}

/// A binary tree whose nodes know their parents.
struct Linked<'a> {
    nodes: &'a mut [Bvh2Node],
    /// The parent of each pair of siblings.
    parents: Vec<AtomicU32>,
    /// True for nodes that moves of this round concern; false for all between rounds.
    touched: Vec<bool>,
}

/// A move of a subtree to the side of another.
#[derive(Clone, Copy, Default)]
struct Move {
    from: u32,
    to: u32,
    /// The area that the tree's nodes lose. Without a move that helps it is 0.
    gain: f32,
}

fn sibling(node: u32) -> u32 {
    ((node - 1) ^ 1) + 1
}

impl<'a> Linked<'a> {
    fn new(nodes: &'a mut [Bvh2Node]) -> Self {
        let parents: Vec<AtomicU32> = (0..nodes.len() / 2).into_par_iter().map(|_| AtomicU32::new(0)).collect();
        let touched = bytemuck::zeroed_vec(nodes.len());
        let tree = Self { nodes, parents, touched };
        (0..tree.nodes.len() as u32).into_par_iter().for_each(|number| tree.link(number));
        tree
    }

    /// Returns a node's parent; 0 for the root.
    #[inline(always)]
    fn parent(&self, node: u32) -> u32 {
        self.parents.get((node.wrapping_sub(1) / 2) as usize).map_or(0, |parent| parent.load(Ordering::Relaxed))
    }

    #[inline(always)]
    fn area(&self, node: u32) -> f32 {
        self.nodes[node as usize].aabb().half_area()
    }

    /// Records a node as the parent of its children.
    fn link(&self, number: u32) {
        let node = &self.nodes[number as usize];
        if !node.is_leaf() {
            self.parents[(node.first_index as usize - 1) / 2].store(number, Ordering::Relaxed);
        }
    }

    /// Tries the `count` largest of the first nodes at all other places, and moves those that gain by it and that no
    /// earlier move concerns.
    fn round(&mut self, count: usize) {
        let numbered = (1..).zip(&self.nodes[1..self.nodes.len().min(2 * count + 2)]);
        // Areas are not negative, so their bits have their order. Of equal areas, the node's number decides.
        let mut order: Vec<(u32, u32)> =
            numbered.map(|(number, node)| (!node.aabb().half_area().to_bits(), number)).collect();
        if count < order.len() {
            order.select_nth_unstable(count);
            order.truncate(count);
        }
        order.par_sort_unstable();
        let best = order.into_par_iter().map_init(Vec::new, |stack, (_, number)| self.best_move(number, stack));
        let mut moves: Vec<Move> = best.filter(|it| it.gain > 0.0).collect();
        moves.par_sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.from.cmp(&b.from)));
        let mut marked = Vec::with_capacity(5 * moves.len());
        for Move { from, to, .. } in moves {
            let concerned = [to, from, sibling(from), self.parent(to), self.parent(from)];
            if concerned.iter().all(|&node| !self.touched[node as usize]) {
                concerned.iter().for_each(|&node| self.touched[node as usize] = true);
                marked.extend(concerned);
                self.apply(from, to);
            }
        }
        marked.into_iter().for_each(|node: u32| self.touched[node as usize] = false);
    }

    /// Returns the move of a subtree that gains most. `stack` is memory to work in.
    fn best_move(&self, from: u32, stack: &mut Vec<(f32, u32)>) -> Move {
        let mut best = Move { from, to: 0, gain: 0.0 };
        let aabb = self.nodes[from as usize].aabb();
        let area = aabb.half_area();
        let parent = self.parent(from);
        // Without the node, its sibling takes its parent's place, and the boxes above shrink.
        let mut gain = self.area(parent);
        let (mut aside, mut pivot) = (sibling(from), parent);
        let mut rest = *self.nodes[aside as usize].aabb();
        loop {
            stack.push((gain, aside));
            while let Some((gain, number)) = stack.pop() {
                if gain - area <= best.gain {
                    continue;
                }
                let node = &self.nodes[number as usize];
                let here = gain - node.aabb().union(aabb).half_area();
                if here > best.gain {
                    best = Move { to: number, gain: here, ..best };
                }
                if !node.is_leaf() {
                    let below = here + node.aabb().half_area();
                    stack.extend([(below, node.first_index), (below, node.first_index + 1)]);
                }
            }
            if pivot != parent {
                rest = rest.union(self.nodes[aside as usize].aabb());
                gain += self.area(pivot) - rest.half_area();
            }
            if pivot == 0 {
                break;
            }
            (aside, pivot) = (sibling(pivot), self.parent(pivot));
        }
        if best.to == sibling(from) || best.to == parent { Move::default() } else { best }
    }

    /// Moves the subtree `from` to the side of the subtree `to`. Its sibling takes the place of their parent.
    fn apply(&mut self, from: u32, to: u32) {
        let (beside, parent) = (sibling(from), self.parent(from));
        let [beside_node, to_node] = [beside, to].map(|node| self.nodes[node as usize]);
        self.nodes[to as usize].make_inner(from.min(beside));
        self.nodes[beside as usize] = to_node;
        self.nodes[parent as usize] = beside_node;
        [beside, parent, to].into_iter().for_each(|node| self.link(node));
        self.refit(to);
        self.refit(parent);
    }

    /// Sets the boxes of a node and those above from their children, until two stay the same.
    fn refit(&mut self, mut number: u32) {
        let mut same = 0;
        loop {
            let node = self.nodes[number as usize];
            if !node.is_leaf() {
                let first = node.first_index as usize;
                let around = self.nodes[first].aabb().union(self.nodes[first + 1].aabb());
                same += u32::from(*node.aabb() == around);
                if same == 2 {
                    return;
                }
                self.nodes[number as usize].set_aabb(around);
            }
            if number == 0 {
                return;
            }
            number = self.parent(number);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;
    use obvhs::aabb::Aabb;
    use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
    use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn area(nodes: &[Bvh2Node]) -> f32 {
        nodes.iter().filter(|node| !node.is_leaf()).map(|node| node.aabb().half_area()).sum()
    }

    /// Both leave it open, or decide differently, which of two moves that gain the same comes first.
    #[test]
    fn trees_are_sound_and_as_good_as_those_of_obvhs() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        for count in [2, 3, 10, 1000, 20_000] {
            let mut vector = |size: f32| Vec3A::from_array([0; 3].map(|_| rng.random_range(0.0..size)));
            let boxes: Vec<Aabb> = (0..count)
                .map(|_| {
                    let low = vector(1.0);
                    Aabb::new(low, low + vector(0.1))
                })
                .collect();
            let numbers = (0..count as u32).collect();
            let distance = PlocSearchDistance::Minimum;
            let mut theirs = PlocBuilder::new().build(distance, &boxes, numbers, SortPrecision::U64, 0);
            let mut ours = theirs.nodes.clone();
            let before = area(&ours);
            let mut tree = Linked::new(&mut ours);
            for _ in 0..3 {
                let candidates: Vec<u32> = (1..theirs.nodes.len() as u32).collect();
                ReinsertionOptimizer::default().run_with_candidates(&mut theirs, &candidates, 1);
                tree.round(candidates.len());
                assert!(!tree.touched.contains(&true));
            }
            let mut items: Vec<u32> = Vec::new();
            for (number, node) in (0..).zip(&*tree.nodes) {
                if node.is_leaf() {
                    items.push(node.first_index);
                    continue;
                }
                let first = node.first_index as usize;
                assert!(tree.parent(node.first_index) == number);
                assert!(*node.aabb() == tree.nodes[first].aabb().union(tree.nodes[first + 1].aabb()));
            }
            items.sort_unstable();
            assert!(items.into_iter().eq(0..count as u32), "{count}");
            let (ours, theirs) = (area(&ours), area(&theirs.nodes));
            assert!((ours / theirs - 1.0).abs() < 0.01 && ours <= before, "{count}: {before}, {ours}, {theirs}");
            assert!(count < 1000 || ours < 0.98 * before, "{before}, {ours}");
        }
    }
}
