//! Reinsertion: moves of subtrees of a binary tree to cheaper positions, which obvhs finds.

use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::{Reinsertion, find_reinsertion, reinsert_node};
use rayon::prelude::*;

/// Moves subtrees to cheaper positions, as obvhs's `ReinsertionOptimizer::run` does: in rounds, each with fewer candidates. The
/// candidates are the largest nodes. In obvhs, the order of nodes with equal area, and of moves with equal gain, depends on the
/// number of threads. Here, the node with the smaller number comes first.
pub(super) fn reinsert(tree: &mut Bvh2, ratio: f32) {
    let nodes = tree.nodes.len();
    if nodes < 2 || ratio <= 0.0 {
        return;
    }
    tree.update_parents();
    let candidates = |part: usize| (((nodes as f32 * ratio) * (1.0 / part as f32)) as usize).clamp(1, nodes - 1);
    // Areas change from round to round, so twice as many are kept.
    let mut large = large(tree, 2 * candidates(1));
    let mut moved = vec![0; nodes];
    for (round, part) in (1..).zip((1..32).step_by(2)) {
        let mut order: Vec<(u32, u32)> = large.par_iter().map(|&number| by_area(tree, number)).collect();
        largest(&mut order, 2 * candidates(part));
        large = order.iter().map(|&(_, number)| number).collect();
        largest(&mut order, candidates(part));
        let found = order.into_par_iter().map(|(_, number)| find_reinsertion(tree, number as usize));
        let mut found: Vec<Reinsertion> = found.filter(|found| found.area_diff > 0.0).collect();
        found.par_sort_unstable_by(|a, b| b.area_diff.total_cmp(&a.area_diff).then(a.from.cmp(&b.from)));
        make_moves(tree, &found, &mut moved, round);
    }
}

/// Performs all moves, except moves that involve nodes changed by an earlier move of the same round, since their gain may be
/// wrong. `moved` holds the last round in which each node was changed.
fn make_moves(tree: &mut Bvh2, moves: &[Reinsertion], moved: &mut [u8], round: u8) {
    for &Reinsertion { from, to, .. } in moves {
        let parent = |node: u32| tree.parents[node as usize] as usize;
        let [start, end] = [from as usize, to as usize];
        let at = [start, end, Bvh2Node::get_sibling_id(start), parent(from), parent(to)];
        if at.iter().all(|&node| moved[node] < round) {
            at.into_iter().for_each(|node| moved[node] = round);
            reinsert_node(tree, start, end);
        }
    }
}

/// Returns the sort key of a node: largest area first, then smallest number. Areas are not negative, so their bits sort like
/// their values.
fn by_area(tree: &Bvh2, number: u32) -> (u32, u32) {
    (!tree.nodes[number as usize].aabb().half_area().to_bits(), number)
}

/// The number of nodes sampled to estimate the area of the largest nodes.
const ASKED: usize = 1 << 14;

/// Returns about `count` of the largest nodes, without the root.
fn large(tree: &Bvh2, count: usize) -> Vec<u32> {
    let step = (tree.nodes.len() / ASKED).max(1);
    let numbers = (1..tree.nodes.len() as u32).step_by(step);
    let mut asked: Vec<u32> = numbers.map(|number| by_area(tree, number).0).collect();
    let last = (count / step).min(asked.len() - 1);
    let limit = *asked.select_nth_unstable(last).1;
    // A child is never larger than its parent.
    let mut large = vec![0];
    let mut next = 0;
    while let Some(&number) = large.get(next) {
        let node = &tree.nodes[number as usize];
        if !node.is_leaf() {
            let below = [node.first_index, node.first_index + 1];
            large.extend(below.into_iter().filter(|&child| by_area(tree, child).0 <= limit));
        }
        next += 1;
    }
    large.split_off(1)
}

/// Keeps only the `count` smallest keys, in any order.
fn largest(order: &mut Vec<(u32, u32)>, count: usize) {
    if count < order.len() {
        order.select_nth_unstable(count);
        order.truncate(count);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{binary::balanced, items::ItemBox};
    use super::*;

    /// Returns a tree over boxes of very different sizes, split at medians.
    fn tree() -> Bvh2 {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let mut item = |n: u32| {
            let (low, size) = ([random(), random(), random()], 0.3 * random().powi(6));
            ItemBox::new([low, low.map(|at| at + size)], n)
        };
        let mut items: Vec<ItemBox> = (0..20_000).map(&mut item).collect();
        let mut tree = Bvh2 { nodes: balanced(&mut items).nodes, ..Bvh2::default() };
        tree.update_parents();
        tree
    }

    /// Returns the sum of the areas of all nodes.
    fn cost(tree: &Bvh2) -> f32 {
        tree.nodes.iter().map(|node| node.aabb().half_area()).sum()
    }

    #[test]
    fn reinsertion_makes_a_tree_cheaper_and_keeps_its_items() {
        let before = tree();
        let mut after = tree();
        reinsert(&mut after, 0.05);
        assert!(cost(&after) < 0.975 * cost(&before), "{}, before {}", cost(&after), cost(&before));
        let items = |tree: &Bvh2| {
            let mut open = vec![0];
            let mut items = Vec::new();
            while let Some(number) = open.pop() {
                let node = &tree.nodes[number as usize];
                if node.is_leaf() {
                    items.push(node.first_index);
                } else {
                    open.extend([node.first_index, node.first_index + 1]);
                }
            }
            items.sort_unstable();
            items
        };
        assert_eq!(items(&after), items(&before));
    }

    #[test]
    fn candidates_are_the_largest_nodes() {
        let tree = tree();
        for count in [2, 100, 3000, 60_000] {
            let large = large(&tree, count);
            let area = |number: u32| tree.nodes[number as usize].aabb().half_area();
            let least = large.iter().map(|&number| area(number)).fold(f32::INFINITY, f32::min);
            let larger = (1..tree.nodes.len() as u32).filter(|&number| area(number) >= least).count();
            assert_eq!(large.len(), larger, "some {count}");
            let wanted = count.min(tree.nodes.len() - 1) as f32;
            assert!((0.7 * wanted..=1.4 * wanted + 3.0).contains(&(larger as f32)), "{larger}, not {count}");
        }
    }

    #[test]
    fn moves_beside_an_earlier_one_wait_for_the_next_round() {
        let find = |tree: &Bvh2| (1..).map(|n| find_reinsertion(tree, n)).find(|found| found.area_diff > 0.0).unwrap();
        let [mut once, mut twice] = [tree(), tree()];
        let found = find(&once);
        let moved = || vec![0; once.nodes.len()];
        let (mut of_once, mut of_twice) = (moved(), moved());
        make_moves(&mut once, &[found], &mut of_once, 1);
        make_moves(&mut twice, &[found, found], &mut of_twice, 1);
        let same =
            |a: &Bvh2, b: &Bvh2| bytemuck::cast_slice::<_, u8>(&a.nodes) == bytemuck::cast_slice::<_, u8>(&b.nodes);
        assert!(same(&once, &twice) && !same(&once, &tree()));
        // The control: in the next round, the move is performed.
        make_moves(&mut twice, &[found], &mut of_twice, 2);
        assert!(!same(&once, &twice));
    }
}
