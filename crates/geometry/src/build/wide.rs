//! From a binary tree to eight-wide nodes and leaves of up to eight triangles, at the least expected cost.
//!
//! Which subtrees become nodes, leaves, or are dissolved into their parent is decided by dynamic programming over the
//! surface-area cost [after Ylitie, Karras and Laine 2017, section 3.1].

use super::binary::{Below, Node2};
use super::{Content, Item, half_area};
use crate::lanes::WIDTH;
use crate::traverse::{Child, DEEPEST, Keys, Node8, Tree};
use crate::triangle::Triangles8;
use glam::Vec3;

/// Expected time of testing eight boxes, eight triangles, and one sphere or disk. Of 0.6, 1.2 and 2 for triangles, 0.6
/// gave the fastest rays and the smallest tree in each scene of benches/rays.rs, by 1 to 5 %.
const NODE_COST: f64 = 1.0;
const TRIANGLES_COST: f64 = 0.6;
const QUADRIC_COST: f64 = 2.5;
/// Of an instance: a guess, taking a ray to its space and a few nodes there.
const BOX_COST: f64 = 10.0;

/// What is known of a binary subtree.
#[derive(Clone, Copy, Debug, Default)]
struct Plan {
    /// Least cost of this subtree as at most 1, 2, … 7 children of some node.
    cost: [f64; WIDTH - 1],
    /// Triangles below, `usize::MAX` with anything else among them.
    triangles: usize,
    /// Whether, as one child, it is cheapest as a leaf.
    leaf: bool,
}

/// The eight-wide tree; `None` if it is empty or needs too deep a stack.
pub(super) fn collapse(nodes: &[Node2], items: &[Item]) -> Option<Tree> {
    let first = nodes.first()?;
    let unit = half_area(first.bounds);
    let mut plans = vec![Plan::default(); nodes.len()];
    for number in (0..nodes.len()).rev() {
        plans[number] = plan(&nodes[number], items, &plans, unit);
    }
    let mut tree = Wide { nodes, items, plans, tree: Tree::default() }.emit();
    tree.stack = stack(&tree.nodes);
    (tree.stack <= DEEPEST).then_some(tree)
}

fn plan(node: &Node2, items: &[Item], plans: &[Plan], unit: f64) -> Plan {
    let area = half_area(node.bounds) / unit;
    match node.below {
        Below::Item(item) => match items[item as usize].content {
            Content::Triangle(_) => Plan { cost: [area * TRIANGLES_COST; WIDTH - 1], triangles: 1, leaf: true },
            Content::Box(_) => Plan { cost: [area * BOX_COST; WIDTH - 1], triangles: usize::MAX, leaf: true },
            Content::Quadric(_) => Plan { cost: [area * QUADRIC_COST; WIDTH - 1], triangles: usize::MAX, leaf: true },
        },
        Below::Nodes(children) => {
            let [left, right] = children.map(|child| &plans[child as usize]);
            let triangles = left.triangles.saturating_add(right.triangles);
            let as_node = area * NODE_COST + share(left, right, WIDTH).1;
            let as_leaf = if triangles <= WIDTH { area * TRIANGLES_COST } else { f64::INFINITY };
            let mut cost = [as_node.min(as_leaf); WIDTH - 1];
            for slots in 2..WIDTH {
                cost[slots - 1] = cost[slots - 2].min(share(left, right, slots).1);
            }
            Plan { cost, triangles, leaf: as_leaf <= as_node }
        }
    }
}

/// How many of `slots` children the left side gets at the least cost, and that cost.
fn share(left: &Plan, right: &Plan, slots: usize) -> (usize, f64) {
    let cost = |i: usize| left.cost[i - 1] + right.cost[slots - i - 1];
    (1..slots).map(|i| (i, cost(i))).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((1, f64::INFINITY))
}

struct Wide<'a> {
    nodes: &'a [Node2],
    items: &'a [Item],
    plans: Vec<Plan>,
    tree: Tree,
}

impl Wide<'_> {
    fn emit(mut self) -> Tree {
        self.tree.nodes.push(Node8::EMPTY);
        let mut open = vec![(0_u32, 0_u32)];
        while let Some((binary, wide)) = open.pop() {
            let mut children = Vec::with_capacity(WIDTH);
            match self.nodes[binary as usize].below {
                Below::Nodes(below) if !(self.plans[binary as usize].leaf) => self.divide(below, WIDTH, &mut children),
                // Only the root can be a leaf here.
                _ => children.push(binary),
            }
            for (lane, &child) in children.iter().enumerate() {
                let below = if self.plans[child as usize].leaf {
                    self.leaf(child)
                } else {
                    let number = self.tree.nodes.len() as u32;
                    self.tree.nodes.push(Node8::EMPTY);
                    open.push((child, number));
                    Child::Node(number)
                };
                let node = &mut self.tree.nodes[wide as usize];
                node.children[lane] = below.code();
                let [low, high] = self.nodes[child as usize].bounds.map(|corner| corner.to_array());
                for axis in 0..3 {
                    node.bounds[axis][0].0[lane] = low[axis];
                    node.bounds[axis][1].0[lane] = high[axis];
                }
            }
        }
        self.tree
    }

    /// The binary nodes that become up to `slots` children in place of these two.
    fn divide(&self, below: [u32; 2], slots: usize, children: &mut Vec<u32>) {
        let [left, right] = below.map(|child| &self.plans[child as usize]);
        let lefts = share(left, right, slots).0;
        for (child, slots) in below.into_iter().zip([lefts, slots - lefts]) {
            let cost = &self.plans[child as usize].cost;
            // The fewest slots that reach the least cost.
            let slots = (1..=slots).find(|&i| cost[i - 1] <= cost[slots - 1]).unwrap_or(1);
            match self.nodes[child as usize].below {
                Below::Nodes(below) if slots > 1 => self.divide(below, slots, children),
                _ => children.push(child),
            }
        }
    }

    /// Packs a leaf.
    fn leaf(&mut self, binary: u32) -> Child {
        let mut triangles = [([Vec3::ZERO; 3], 0_u64); WIDTH];
        let mut count = 0;
        let mut open = vec![binary];
        while let Some(number) = open.pop() {
            match self.nodes[number as usize].below {
                Below::Nodes(children) => open.extend(children),
                Below::Item(item) => {
                    let item = &self.items[item as usize];
                    match item.content {
                        Content::Triangle(corners) => {
                            triangles[count] = (corners, item.key);
                            count += 1;
                        }
                        Content::Box(number) => return Child::Box(number),
                        Content::Quadric(quadric) => {
                            self.tree.quadrics.push(quadric);
                            self.tree.quadric_keys.push(item.key);
                            return Child::Quadric(self.tree.quadrics.len() as u32 - 1);
                        }
                    }
                }
            }
        }
        let first = triangles[0];
        triangles[count..].fill(first);
        self.tree.triangles.push(Triangles8::new(&triangles.map(|(corners, _)| corners)));
        self.tree.triangle_keys.push(Keys::new(triangles.map(|(_, key)| key)));
        Child::Triangles(self.tree.triangles.len() as u32 - 1)
    }
}

/// Most children that can be put aside at once: all but one on each level of some path.
fn stack(nodes: &[Node8]) -> usize {
    let mut needs = vec![0_usize; nodes.len()];
    for number in (0..nodes.len()).rev() {
        let node = &nodes[number];
        let used = (0..WIDTH).filter(|&lane| node.bounds[0][0].0[lane] <= node.bounds[0][1].0[lane]);
        let below = used.clone().map(|lane| needs.get(node.children[lane] as usize).copied().unwrap_or(0)).max();
        needs[number] = below.map_or(0, |below| used.count() - 1 + below);
    }
    needs[0]
}
