//! From a binary tree to eight-wide nodes and leaves of up to eight triangles, at the least expected cost.
//!
//! Which subtrees become nodes, leaves, or are dissolved into their parent is decided by dynamic programming over the
//! surface-area cost [after Ylitie, Karras and Laine 2017, section 3.1].

use super::binary::{Below, Node2};
use super::{Content, Item, half_area};
use crate::Shape;
use crate::lanes::WIDTH;
use crate::shape::Quadric;
use crate::traverse::{Child, DEEPEST, Keys, Node8, Tree, Way};
use crate::triangle::Triangles8;
use glam::Vec3;

/// Expected time of testing eight boxes, eight triangles, and one sphere or disk. Of 0.6, 1.2 and 2 for triangles, 0.6
/// gave the fastest rays and the smallest tree in each scene of benches/rays.rs, by 1 to 5 %.
const NODE_COST: f32 = 1.0;
const TRIANGLES_COST: f32 = 0.6;
const QUADRIC_COST: f32 = 2.5;
/// Of an instance: a guess, taking a ray to its space and a few nodes there.
const BOX_COST: f32 = 10.0;

/// What is known of a binary subtree, in 32 bytes: there are two for each primitive.
#[derive(Clone, Copy, Debug, Default)]
struct Plan {
    /// Least cost of this subtree as at most 1, 2, … 7 children of some node.
    cost: [f32; WIDTH - 1],
    /// Triangles below, [`MANY`] if there are more than a leaf takes, or anything else among them.
    triangles: u8,
    /// Whether, as one child, it is cheapest as a leaf.
    leaf: bool,
}

const MANY: u8 = u8::MAX;

/// The eight-wide tree; `None` if it is empty or needs too deep a stack.
pub(super) fn collapse(nodes: &[Node2], items: &[Item], shapes: &[Shape]) -> Option<Tree> {
    let first = nodes.first()?;
    let unit = half_area(first.bounds);
    let mut plans = vec![Plan::default(); nodes.len()];
    for number in (0..nodes.len()).rev() {
        plans[number] = plan(&nodes[number], items, &plans, unit);
    }
    let moves = shapes.iter().any(|shape| matches!(shape, Shape::Moving(_)));
    let mut tree = Wide { nodes, items, shapes, moves, plans, tree: Tree::default() }.emit();
    if moves {
        tree.way = Way::moving();
    }
    tree.stack = stack(&tree.nodes);
    (tree.stack <= DEEPEST).then_some(tree)
}

fn plan(node: &Node2, items: &[Item], plans: &[Plan], unit: f64) -> Plan {
    let area = (half_area(node.bounds) / unit) as f32;
    match node.below {
        Below::Item(item) => match items[item as usize].content {
            Content::Triangle => Plan { cost: [area * TRIANGLES_COST; WIDTH - 1], triangles: 1, leaf: true },
            Content::Box => Plan { cost: [area * BOX_COST; WIDTH - 1], triangles: MANY, leaf: true },
            Content::Quadric => Plan { cost: [area * QUADRIC_COST; WIDTH - 1], triangles: MANY, leaf: true },
        },
        Below::Nodes(children) => {
            let [left, right] = children.map(|child| &plans[child as usize]);
            let triangles = match left.triangles.saturating_add(right.triangles) {
                few if usize::from(few) <= WIDTH => few,
                _ => MANY,
            };
            let as_node = area * NODE_COST + share(left, right, WIDTH).1;
            let as_leaf = if triangles == MANY { f32::INFINITY } else { area * TRIANGLES_COST };
            let mut cost = [as_node.min(as_leaf); WIDTH - 1];
            for slots in 2..WIDTH {
                cost[slots - 1] = cost[slots - 2].min(share(left, right, slots).1);
            }
            Plan { cost, triangles, leaf: as_leaf <= as_node }
        }
    }
}

/// How many of `slots` children the left side gets at the least cost, and that cost.
#[inline(always)]
fn share(left: &Plan, right: &Plan, slots: usize) -> (usize, f32) {
    let mut best = (1, f32::INFINITY);
    for i in 1..slots {
        let cost = left.cost[i - 1] + right.cost[slots - i - 1];
        if cost < best.1 {
            best = (i, cost);
        }
    }
    best
}

/// A few numbers without an allocation.
struct Few {
    numbers: [u32; WIDTH],
    count: usize,
}

impl Few {
    fn of(number: u32) -> Self {
        Self { numbers: [number; WIDTH], count: 1 }
    }

    fn push(&mut self, number: u32) {
        self.numbers[self.count] = number;
        self.count += 1;
    }

    fn pop(&mut self) -> Option<u32> {
        self.count = self.count.checked_sub(1)?;
        Some(self.numbers[self.count])
    }
}

struct Wide<'a> {
    nodes: &'a [Node2],
    items: &'a [Item],
    shapes: &'a [Shape],
    /// Whether one of them does.
    moves: bool,
    plans: Vec<Plan>,
    tree: Tree,
}

impl Wide<'_> {
    fn emit(mut self) -> Tree {
        self.tree.nodes.push(Node8::EMPTY);
        let mut open = vec![(0_u32, 0_u32)];
        while let Some((binary, wide)) = open.pop() {
            let mut children = Few { numbers: [0; WIDTH], count: 0 };
            match self.nodes[binary as usize].below {
                Below::Nodes(below) if !(self.plans[binary as usize].leaf) => self.divide(below, WIDTH, &mut children),
                // Only the root can be a leaf here.
                _ => children.push(binary),
            }
            for (lane, &child) in children.numbers[..children.count].iter().enumerate() {
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
    fn divide(&self, below: [u32; 2], slots: usize, children: &mut Few) {
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
        // Where they are at time 1.
        let mut ends = [[Vec3::ZERO; 3]; WIDTH];
        let mut count = 0;
        // Of at most eight triangles, at most seven wait.
        let mut open = Few::of(binary);
        while let Some(number) = open.pop() {
            match self.nodes[number as usize].below {
                Below::Nodes([left, right]) => {
                    open.push(left);
                    open.push(right);
                }
                Below::Item(item) => {
                    let Item { key, content, .. } = self.items[item as usize];
                    if content == Content::Box {
                        return Child::Box(key as u32);
                    }
                    let quadric = match &self.shapes[(key >> 32) as usize] {
                        Shape::Mesh(mesh) => {
                            triangles[count] = (mesh.corners(key as u32), key);
                            ends[count] = triangles[count].0;
                            count += 1;
                            continue;
                        }
                        Shape::Moving(mesh) => {
                            triangles[count] = (mesh.corners(key as u32, 0.0), key);
                            ends[count] = mesh.ends_of(key as u32);
                            count += 1;
                            continue;
                        }
                        Shape::Sphere(sphere) => Quadric::Sphere(*sphere),
                        Shape::Disk(disk) => Quadric::Disk(*disk),
                    };
                    self.tree.quadrics.push(quadric);
                    self.tree.quadric_keys.push(key);
                    return Child::Quadric(self.tree.quadrics.len() as u32 - 1);
                }
            }
        }
        let first = (triangles[0], ends[0]);
        triangles[count..].fill(first.0);
        ends[count..].fill(first.1);
        self.tree.triangles.push(Triangles8::new(&triangles.map(|(corners, _)| corners)));
        if self.moves {
            self.tree.moved.push(Triangles8::new(&ends));
        }
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
