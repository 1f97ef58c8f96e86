//! The published grouping [Lan 2016]: a triangle joins the first class whose representative has a similar normal (first
//! fit).

use crate::params::{ClusterParams, Order, Sides};

/// The tolerance of a cosine. It exceeds the rounding error of the dot product of two `f32` unit vectors: at most `2 *
/// 2^-24` from their lengths and `3 * 2^-24` from the sum.
///
/// With this tolerance, equal normals are similar at any angle (a representative joins its own cluster), and an angle that
/// equals the limit counts as within.
const COSINE_SLACK: f64 = 1.0 / (1 << 21) as f64;

impl ClusterParams {
    /// Returns `true` if opposite normals are similar.
    pub(crate) fn two_sided(&self) -> bool {
        self.sides == Sides::Either
    }

    /// The smallest dot product of two unit normals that count as similar.
    pub(crate) fn cosine(&self) -> f32 {
        (self.angle.to_radians().cos() - COSINE_SLACK) as f32
    }
}

/// A triangle's unit normal and its index in the group (one material's triangles in a voxel).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Facet {
    pub(crate) normal: [f32; 3],
    pub(crate) number: u32,
}

/// The criterion for similar normals, and the order in which triangles are visited.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    pub(crate) cosine: f32,
    pub(crate) two_sided: bool,
    pub(crate) order: Order,
    /// The smallest z of a cluster's first normal for which all normals of the cluster surely lie on its side.
    pub(crate) steep: f32,
}

impl Rule {
    pub(crate) fn new(params: &ClusterParams) -> Self {
        Self { cosine: params.cosine(), two_sided: params.two_sided(), order: params.order, steep: steep(params) }
    }
}

/// The smallest z of a cluster's first normal for which all normals of the cluster surely lie on its side. Two-sided normals
/// point upwards, and normals of one cluster differ by at most twice the angle parameter.
///
/// The result is infinite if no z suffices, and negative infinity for signed normals.
fn steep(params: &ClusterParams) -> f32 {
    /// Tolerance for the rounding of normals, of products and of the angle.
    const SLACK: f64 = 1e-3;
    match (params.two_sided(), 2.0 * params.angle.to_radians()) {
        (false, _) => f32::NEG_INFINITY,
        (true, angle) if angle < std::f64::consts::FRAC_PI_2 => (angle.sin() + SLACK) as f32,
        (true, _) => f32::INFINITY,
    }
}

/// The number of classes found by one pass each over all remaining facets. After that, [`sweep`] sorts the rest.
const PASSES: usize = 24;
/// The smallest number of remaining facets for which sorting them ([`sweep`]) is faster.
const MANY: usize = 512;

#[inline]
fn dot<const TWO_SIDED: bool>(a: [f32; 3], b: [f32; 3]) -> f32 {
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    if TWO_SIDED { dot.abs() } else { dot }
}

/// Returns `true` if normal `a` precedes normal `b` in canonical order: larger z first, then larger y, then larger x.
#[inline]
fn before(a: [f32; 3], b: [f32; 3]) -> bool {
    a[2] > b[2] || (a[2] == b[2] && (a[1] > b[1] || (a[1] == b[1] && a[0] > b[0])))
}

/// The triangles of a group by their indices, class by class. A class holds triangles with similar normals.
#[derive(Debug, Default)]
pub(crate) struct Classes {
    /// The members of all classes, one class after another, ascending within each class.
    pub(crate) members: Vec<u32>,
    /// For each class, the end of its range in `members`.
    pub(crate) ends: Vec<u32>,
}

impl Classes {
    /// The number of classes.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// The members of each class.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let mut start = 0;
        self.ends.iter().map(move |&end| &self.members[std::mem::replace(&mut start, end as usize)..end as usize])
    }

    /// Adds `numbers` (ascending indices of triangles without a class) to the first class, or to a new class if there is none.
    pub(crate) fn join_first(&mut self, numbers: impl Iterator<Item = usize>) {
        let (first, count) = (self.ends.first().map_or(0, |&end| end as usize), self.members.len());
        drop(self.members.splice(first..first, numbers.map(|i| i as u32)));
        let more = self.members.len() - count;
        if self.ends.is_empty() {
            self.ends.push(0);
        }
        for end in &mut self.ends {
            *end += more as u32;
        }
        self.members[..first + more].sort_unstable();
    }

    /// Rebuilds the classes from `class`, the class of each triangle in the group.
    pub(crate) fn sort(&mut self, class: &[u32], classes: u32) {
        let Self { members, ends } = self;
        // First the beginning of each class, finally its end.
        ends.clear();
        ends.resize(classes as usize, 0);
        for &class in class {
            ends[class as usize] += 1;
        }
        let mut sum = 0;
        for end in ends.iter_mut() {
            sum += std::mem::replace(end, sum);
        }
        members.resize(class.len(), 0);
        for (number, &class) in (0..).zip(class) {
            let slot = &mut ends[class as usize];
            members[*slot as usize] = number;
            *slot += 1;
        }
    }
}

/// Sorts facets into classes and empties `facets`. The numbers of the facets must ascend.
///
/// First fit is computed in passes: the first remaining facet becomes the representative of a class, and all remaining similar
/// facets join it. So a facet is compared only with representatives up to its own, and no sorting is needed.
pub(crate) fn classify(facets: &mut Vec<Facet>, rule: Rule, classes: &mut Classes) {
    classes.ends.clear();
    classes.members.resize(facets.len(), 0);
    match (rule.two_sided, rule.order) {
        (false, Order::Canonical) => classify_by::<false, true>(facets, rule.cosine, classes),
        (true, Order::Canonical) => classify_by::<true, true>(facets, rule.cosine, classes),
        (false, Order::Input) => classify_by::<false, false>(facets, rule.cosine, classes),
        (true, Order::Input) => classify_by::<true, false>(facets, rule.cosine, classes),
    }
}

fn classify_by<const TWO_SIDED: bool, const CANONICAL: bool>(
    facets: &mut Vec<Facet>,
    cosine: f32,
    classes: &mut Classes,
) {
    let seen = if CANONICAL { &facets[..] } else { &[] };
    let mut top = seen.iter().fold(f32::NEG_INFINITY, |top, facet| higher(facet.normal[2], top));
    let mut joined = 0;
    while let Some(&first) = facets.first() {
        if CANONICAL && classes.len() >= PASSES && facets.len() >= MANY {
            return sweep::<TWO_SIDED>(facets, cosine, classes, joined);
        }
        let representative = if CANONICAL { first_at(facets, top) } else { first.normal };
        let room = &mut classes.members[joined..];
        joined += take::<TWO_SIDED, CANONICAL>(facets, representative, cosine, room, &mut top);
        classes.ends.push(joined as u32);
    }
}

#[inline]
fn higher(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The normal that comes first in canonical order (by z, then y, then x), given the largest z, `top`.
fn first_at(facets: &[Facet], top: f32) -> [f32; 3] {
    let mut tied = facets.iter().map(|facet| facet.normal).filter(|normal| normal[2] == top);
    let first = tied.next().unwrap_or([f32::NEG_INFINITY; 3]);
    tied.fold(first, |first, normal| if before(normal, first) { normal } else { first })
}

/// Moves the numbers of all facets similar to the representative from `facets` to `room`, and returns their count. `top` is set
/// to the largest z of the remaining facets.
fn take<const TWO_SIDED: bool, const CANONICAL: bool>(
    facets: &mut Vec<Facet>,
    representative: [f32; 3],
    cosine: f32,
    room: &mut [u32],
    top: &mut f32,
) -> usize {
    let mut joined = 0;
    let mut highest = f32::NEG_INFINITY;
    for i in 0..facets.len() {
        let facet = facets[i];
        // Written to both places; one of them is overwritten later.
        room[joined] = facet.number;
        facets[i - joined] = facet;
        let joins = dot::<TWO_SIDED>(facet.normal, representative) >= cosine;
        joined += usize::from(joins);
        if CANONICAL {
            highest = higher(if joins { f32::NEG_INFINITY } else { facet.normal[2] }, highest);
        }
    }
    // A representative is similar to itself up to rounding, which the cosine tolerates.
    debug_assert!(joined > 0);
    facets.truncate(facets.len() - joined);
    *top = highest;
    joined
}

/// Finds all remaining classes, like repeated calls of [`take`]. Facets are sorted by z, so those similar to a representative
/// lie within a short run.
fn sweep<const TWO_SIDED: bool>(facets: &mut Vec<Facet>, cosine: f32, classes: &mut Classes, joined: usize) {
    facets.sort_unstable_by(|a, b| before(b.normal, a.normal).cmp(&before(a.normal, b.normal)));
    // Rounding of the cosine and of the normals widens the angle by less than this, unless it is tiny.
    const WIDEN: f32 = 1e-3;
    let angle = cosine.clamp(-1.0, 1.0).acos() + WIDEN;
    // `next[i]`: the first facet from i on that may still be without a class.
    let mut next: Vec<u32> = (0..=facets.len() as u32).collect();
    let mut joined = joined;
    let mut head = 0;
    while head < facets.len() {
        let representative = facets[head].normal;
        let lowest =
            (representative[2].clamp(-1.0, 1.0).acos() + angle).min(std::f32::consts::PI).cos() - WIDEN * WIDEN;
        // Two-sided normals have z >= 0. Opposite normals are within the angle only if z = 0 is.
        let mut i = head;
        let start = joined;
        while i < facets.len() && facets[i].normal[2] >= lowest {
            let facet = facets[i];
            if dot::<TWO_SIDED>(facet.normal, representative) >= cosine {
                classes.members[joined] = facet.number;
                joined += 1;
                next[i] = i as u32 + 1;
            }
            i = skip(&mut next, i + 1);
        }
        classes.members[start..joined].sort_unstable();
        classes.ends.push(joined as u32);
        head = skip(&mut next, head);
    }
    facets.clear();
}

/// The first index from `i` on with `next[index] == index`: the next facet without a class. Shortens the path for later
/// searches.
fn skip(next: &mut [u32], mut i: usize) -> usize {
    while next[i] as usize != i {
        next[i] = next[next[i] as usize];
        i = next[i] as usize;
    }
    i
}
