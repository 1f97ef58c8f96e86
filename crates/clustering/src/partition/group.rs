//! Clustering of a group: the triangles of one material in one voxel. Classes of similar normals are split into connected
//! pieces by union-find over shared vertices [after Tarjan 1975].

use crate::Cluster;
use crate::params::{ClusterParams, Connection, Grouping, Insertion, Order};
use crate::partition::greedy::{Classes, Facet, Rule, classify};
use crate::partition::grid::{Mesh, centroid_sum};
use crate::partition::small_groups::{Batch, SmallGroups};
use crate::partition::triangle_normals::{MAX_SMALL, Members, Surface};

/// The scratch space of one thread for clustering groups. Triangles are identified by their index in the group.
#[derive(Default)]
pub(crate) struct Scratch {
    small: SmallGroups,
    facets: Vec<Facet>,
    classes: Classes,
    class: Vec<u32>,
    kept: Vec<u32>,
    connector: Connector,
}

/// The clustering parameters in the form used by [`Scratch::cluster`].
#[derive(Clone, Copy)]
pub(crate) struct GroupRule {
    grouping: Grouping,
    weld: bool,
    rule: Rule,
    /// `true` if every triangle keeps its cluster in the group, as with insertion by centroid.
    keeps_all: bool,
}

impl GroupRule {
    pub(crate) fn new(params: &ClusterParams) -> Self {
        let keeps_all = params.insertion == Insertion::Centroid;
        let weld = params.connection == Connection::Place;
        Self { grouping: params.grouping, weld, rule: Rule::new(params), keeps_all }
    }

    /// Returns `true` if the parameters allow [`SmallGroups`], the fast path for small groups.
    fn is_plain(&self) -> bool {
        self.keeps_all && self.grouping == Grouping::Greedy && self.rule.order == Order::Canonical
    }
}

impl Scratch {
    /// Clusters a group and adds its clusters to `batch`. With insertion by bounding box, a triangle stays in its cluster only
    /// if `keeps` returns `true` for its index in the group.
    #[inline(always)]
    pub(crate) fn cluster(
        &mut self,
        mesh: &Mesh<'_>,
        plan: &GroupRule,
        group: Members<'_>,
        keeps: impl Fn(usize) -> bool,
        batch: &mut Batch,
    ) {
        let count = group.triangles.len();
        let common = Cluster { material: mesh.material(group.triangles[0]), group: batch.groups, ..Cluster::NONE };
        if plan.is_plain() {
            let rule = plan.rule;
            let done = match count {
                0..=8 => self.small.cluster::<8>(rule, group, common, batch),
                9..=16 => self.small.cluster::<16>(rule, group, common, batch),
                17..=32 => self.small.cluster::<32>(rule, group, common, batch),
                33..=64 => self.small.cluster::<64>(rule, group, common, batch),
                65..=128 => self.small.cluster::<128>(rule, group, common, batch),
                129..=MAX_SMALL => self.small.cluster::<MAX_SMALL>(rule, group, common, batch),
                _ => false,
            };
            if done {
                return;
            }
        }
        self.classify(mesh, plan, group);
        let clusters = batch.clusters.len();
        for members in self.classes.iter() {
            let members = if plan.keeps_all {
                members
            } else {
                self.kept.clear();
                self.kept.extend(members.iter().copied().filter(|&i| keeps(i as usize)));
                &self.kept
            };
            if members.is_empty() {
                batch.phantoms += 1;
                continue;
            }
            batch.members.extend(members.iter().map(|&i| group.triangles[i as usize]));
            batch.clusters.push(measure(group, members, plan.rule.steep, common));
        }
        batch.groups += u32::from(batch.clusters.len() > clusters);
    }

    /// Sorts the triangles of a group into `self.classes`: sets of similar normals, or their connected pieces.
    fn classify(&mut self, mesh: &Mesh<'_>, plan: &GroupRule, group: Members<'_>) {
        self.facets.clear();
        let facet = |number| Facet { normal: group.normals.of(number), number: number as u32 };
        self.facets.extend((0..group.triangles.len()).map(facet));
        // Flat triangles are rare, so the loop above needs no branches.
        let flat = (0..group.triangles.len()).fold(false, |any, i| any | group.normals.is_flat(i));
        if flat {
            self.facets.retain(|facet| !group.normals.is_flat(facet.number as usize));
        }
        classify(&mut self.facets, plan.rule, &mut self.classes);
        if plan.grouping == Grouping::Connected {
            self.cut(Group { mesh, triangles: group.triangles, weld: plan.weld, order: plan.rule.order });
        } else if flat {
            // A triangle without a normal joins the first cluster.
            self.classes.join_first((0..group.triangles.len()).filter(|&i| group.normals.is_flat(i)));
        }
    }

    /// Splits `self.classes` (sets of triangles with similar normals) into their connected pieces.
    fn cut(&mut self, group: Group<'_>) {
        self.class.clear();
        self.class.resize(group.triangles.len(), u32::MAX);
        for (number, members) in (0..).zip(self.classes.iter()) {
            for &member in members {
                self.class[member as usize] = number;
            }
        }
        let pieces = self.connector.cut(group, &mut self.class, self.classes.len() as u32);
        self.classes.sort(&self.class, pieces);
    }
}

/// Creates a cluster from its members: their bounds, area, mean normal and cone.
fn measure(group: Members<'_>, members: &[u32], steep: f32, common: Cluster) -> Cluster {
    let numbers = || members.iter().map(|&i| i as usize);
    let mut sum = Surface::NOTHING;
    let lead = numbers().find(|&i| !group.normals.is_flat(i)).map_or([0.0, 0.0, 1.0], |i| group.normals.of(i));
    let turns = lead[2] < steep;
    for i in numbers() {
        sum = sum.and(group.surfaces[i].turned(turns && group.normals.dot(i, lead) < 0.0));
    }
    let normal = sum.normal();
    let cone = cone(normal, numbers().map(|i| group.normals.cosine(i, normal)), steep > f32::NEG_INFINITY);
    Cluster { triangles: members.len() as u32, normal, cone, ..sum.cluster(common) }
}

/// The smallest of `cosines` (between `normal` and the normals of its cluster's triangles); -1 if `normal` is zero. If `both`,
/// absolute values are used.
fn cone(normal: [f32; 3], cosines: impl Iterator<Item = f32>, both: bool) -> f32 {
    if normal == [0.0; 3] {
        return -1.0;
    }
    let cosines = cosines.map(|cosine| if both { cosine.abs() } else { cosine });
    cosines.fold(1.0_f32, |cone, cosine| if cosine < cone { cosine } else { cone }).max(-1.0)
}

/// Marks the absence of a triangle or of a piece.
const NONE: u32 = u32::MAX;

/// The scratch space of one thread for finding connected pieces.
#[derive(Default)]
struct Connector {
    /// A hash table with open addressing. A slot holds a vertex, with its first triangle or the lowest piece that touches it.
    slots: Vec<[u32; 2]>,
    parent: Vec<u32>,
}

impl Connector {
    /// Splits each class of a group (the triangles of one material in a voxel) into its connected pieces. `class` holds the
    /// class of each triangle and receives its piece. Pieces are numbered class by class. Returns the number of pieces.
    ///
    /// Triangles of class `u32::MAX` have no normal and are connected among themselves. Each piece of these joins the
    /// lowest-numbered other piece that shares a vertex with it, or remains on its own.
    fn cut(&mut self, group: Group<'_>, class: &mut [u32], classes: u32) -> u32 {
        let mut lists = vec![Vec::new(); classes as usize];
        let mut flat = Vec::new();
        for (triangle, &class) in class.iter().enumerate() {
            match lists.get_mut(class as usize) {
                Some(list) => list.push(triangle as u32),
                None => flat.push(triangle as u32),
            }
        }
        self.parent.clear();
        self.parent.extend(0..class.len() as u32);
        let mut pieces = 0;
        for list in &lists {
            pieces = self.number(group, list, class, pieces);
        }
        if !flat.is_empty() {
            let numbered: Vec<u32> = lists.concat();
            let touched = self.touched(group, &numbered, &flat, class);
            pieces = self.number(group, &flat, class, pieces);
            pieces = hand_over(&flat, &touched, class, pieces);
        }
        pieces
    }

    /// Finds the connected pieces of the triangles in `list` and writes their numbers, starting at `pieces`, to `class`.
    /// Returns the next free number.
    fn number(&mut self, group: Group<'_>, list: &[u32], class: &mut [u32], pieces: u32) -> u32 {
        self.join(group, list);
        let mut roots: Vec<u32> = list.iter().copied().filter(|&triangle| self.root(triangle) == triangle).collect();
        if roots.len() > 1 && group.order == Order::Canonical {
            self.order_by_place(group, list, &mut roots);
        }
        for (number, &root) in roots.iter().enumerate() {
            class[root as usize] = pieces + number as u32;
        }
        for &triangle in list {
            class[triangle as usize] = class[self.root(triangle) as usize];
        }
        pieces + roots.len() as u32
    }

    /// Sorts the pieces' root triangles by the smallest centroid of each piece (by x, then y, then z), so that the result does
    /// not depend on the order of triangles.
    fn order_by_place(&mut self, group: Group<'_>, list: &[u32], roots: &mut [u32]) {
        let place = |&triangle: &u32| (self.root(triangle), centroid_sum(group.corners(triangle)));
        let mut first: Vec<(u32, [f64; 3])> = list.iter().map(place).collect();
        let compare =
            |a: &[f64; 3], b: &[f64; 3]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]));
        first.sort_unstable_by(|a, b| compare(&a.1, &b.1).then(a.0.cmp(&b.0)));
        let mut seen = vec![false; self.parent.len()];
        let mut ordered = roots.iter_mut();
        for (root, _) in first {
            if !std::mem::replace(&mut seen[root as usize], true)
                && let Some(slot) = ordered.next()
            {
                *slot = root;
            }
        }
    }

    /// Unites all triangles in a list that share vertices.
    fn join(&mut self, group: Group<'_>, list: &[u32]) {
        self.clear(list.len());
        for &triangle in list {
            for vertex in group.vertices(triangle) {
                let slot = self.slot(group, vertex);
                if self.slots[slot][1] == NONE {
                    self.slots[slot] = [vertex, triangle];
                } else {
                    self.unite(self.slots[slot][1], triangle);
                }
            }
        }
    }

    /// For each triangle in `flat` (triangles without a normal), the lowest number of the pieces that share a vertex with it;
    /// [`NONE`] if there is none.
    fn touched(&mut self, group: Group<'_>, numbered: &[u32], flat: &[u32], class: &[u32]) -> Vec<u32> {
        self.clear(numbered.len());
        for &triangle in numbered {
            for vertex in group.vertices(triangle) {
                let slot = self.slot(group, vertex);
                let lowest = self.slots[slot][1].min(class[triangle as usize]);
                self.slots[slot] = [vertex, lowest];
            }
        }
        let lowest = |&triangle: &u32| {
            let slots = group.vertices(triangle).map(|vertex| self.slots[self.slot(group, vertex)][1]);
            slots[0].min(slots[1]).min(slots[2])
        };
        flat.iter().map(lowest).collect()
    }

    /// Empties the hash table and resizes it for the vertices of `triangles` triangles, which then fill at most half of the
    /// slots.
    fn clear(&mut self, triangles: usize) {
        self.slots.clear();
        self.slots.resize((6 * triangles).next_power_of_two(), [NONE; 2]);
    }

    /// The index of the slot that holds a vertex, or of the empty slot for it.
    fn slot(&self, group: Group<'_>, vertex: u32) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = group.hash(vertex) as usize & mask;
        while self.slots[slot][1] != NONE && !group.same(self.slots[slot][0], vertex) {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn root(&mut self, mut triangle: u32) -> u32 {
        while self.parent[triangle as usize] != triangle {
            let above = self.parent[self.parent[triangle as usize] as usize];
            self.parent[triangle as usize] = above;
            triangle = above;
        }
        triangle
    }

    /// Unites the pieces of triangles `a` and `b`. The root with the smaller number becomes the common root.
    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

/// Merges each piece of flat triangles (triangles without a normal) into the lowest-numbered piece that it touches. Pieces of
/// flat triangles have the highest numbers in `class`; those that touch no other piece are renumbered. Returns the number of
/// remaining pieces.
fn hand_over(flat: &[u32], touched: &[u32], class: &mut [u32], pieces: u32) -> u32 {
    let first = flat.iter().map(|&triangle| class[triangle as usize]).min().unwrap_or(pieces);
    let mut owner = vec![NONE; (pieces - first) as usize];
    for (&triangle, &touched) in flat.iter().zip(touched) {
        let owner = &mut owner[(class[triangle as usize] - first) as usize];
        *owner = touched.min(*owner);
    }
    let mut pieces = first;
    for owner in &mut owner {
        if *owner == NONE {
            *owner = pieces;
            pieces += 1;
        }
    }
    for &triangle in flat {
        class[triangle as usize] = owner[(class[triangle as usize] - first) as usize];
    }
    pieces
}

/// The triangles of one material in a voxel. Methods identify a triangle by its index in this group.
#[derive(Clone, Copy)]
struct Group<'a> {
    mesh: &'a Mesh<'a>,
    triangles: &'a [u32],
    weld: bool,
    order: Order,
}

impl Group<'_> {
    fn vertices(&self, triangle: u32) -> [u32; 3] {
        self.mesh.indices[self.triangles[triangle as usize] as usize]
    }

    fn corners(&self, triangle: u32) -> [[f32; 4]; 3] {
        self.mesh.corners(self.triangles[triangle as usize])
    }

    /// Returns `true` if two vertices count as one: the same index, or with `weld` the same position.
    fn same(&self, a: u32, b: u32) -> bool {
        a == b || (self.weld && self.mesh.positions[a as usize] == self.mesh.positions[b as usize])
    }

    fn hash(&self, vertex: u32) -> u64 {
        // Odd numbers whose products spread all bits upwards: 2^64 divided by the golden ratio, and two of its successors under
        // the same map.
        const SPREAD: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xc2b2_ae3d_27d4_eb4f, 0x1656_67b1_9e37_79f9];
        let key = if self.weld {
            // Adding 0.0 changes -0.0 to 0.0.
            let bits = self.mesh.positions[vertex as usize].map(|x| u64::from((x + 0.0).to_bits()));
            (0..3).fold(0, |key: u64, axis| (key ^ bits[axis]).wrapping_mul(SPREAD[axis]).rotate_left(29))
        } else {
            u64::from(vertex).wrapping_mul(SPREAD[0])
        };
        key ^ key >> 32
    }
}
