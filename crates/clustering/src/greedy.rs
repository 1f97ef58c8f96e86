//! The published grouping: first fit to a representative's normal.

use crate::params::{Order, Params};
use std::cmp::Ordering;

/// A triangle's normal, with its number in its group.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Facet {
    pub(crate) normal: [f32; 3],
    pub(crate) number: u32,
}

/// When two normals are alike, and who represents.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    pub(crate) cosine: f32,
    pub(crate) two_sided: bool,
    pub(crate) order: Order,
}

impl Rule {
    pub(crate) fn new(params: &Params) -> Self {
        Self { cosine: params.cosine(), two_sided: params.two_sided, order: params.order }
    }
}

/// Clusters taken out one by one, each in a pass over all that remain, before those are sorted.
const PASSES: u32 = 24;
/// Facets worth sorting.
const MANY: usize = 512;

#[inline]
fn dot<const TWO_SIDED: bool>(a: [f32; 3], b: [f32; 3]) -> f32 {
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    if TWO_SIDED { dot.abs() } else { dot }
}

/// Whether `a` represents before `b`: by z, then y, then x.
#[inline]
fn before(a: [f32; 3], b: [f32; 3]) -> bool {
    a[2] > b[2] || (a[2] == b[2] && (a[1] > b[1] || (a[1] == b[1] && a[0] > b[0])))
}

/// Gives each facet a class, by its number; the number of classes. Takes the facets away.
///
/// First fit in an order is the same as: the first that remains represents, all that remain and are like it join, and so
/// on. So no facet is compared with more representatives than come before its own, and nothing need be sorted.
pub(crate) fn classify(facets: &mut Vec<Facet>, rule: Rule, class: &mut [u32]) -> u32 {
    match (rule.two_sided, rule.order) {
        (false, Order::Canonical) => classify_by::<false, true>(facets, rule.cosine, class),
        (true, Order::Canonical) => classify_by::<true, true>(facets, rule.cosine, class),
        (false, Order::Input) => classify_by::<false, false>(facets, rule.cosine, class),
        (true, Order::Input) => classify_by::<true, false>(facets, rule.cosine, class),
    }
}

fn classify_by<const TWO_SIDED: bool, const CANONICAL: bool>(
    facets: &mut Vec<Facet>,
    cosine: f32,
    class: &mut [u32],
) -> u32 {
    let Some(&first) = facets.first() else { return 0 };
    let mut representative = first.normal;
    if CANONICAL {
        for facet in facets.iter() {
            if before(facet.normal, representative) {
                representative = facet.normal;
            }
        }
    }
    let mut classes = 0;
    while !facets.is_empty() {
        if CANONICAL && classes >= PASSES && facets.len() >= MANY {
            return sweep::<TWO_SIDED>(facets, cosine, class, classes);
        }
        representative = take::<TWO_SIDED, CANONICAL>(facets, representative, cosine, class, classes);
        classes += 1;
    }
    classes
}

/// Moves all facets like the representative to a class; the representative of those that remain.
fn take<const TWO_SIDED: bool, const CANONICAL: bool>(
    facets: &mut Vec<Facet>,
    representative: [f32; 3],
    cosine: f32,
    class: &mut [u32],
    number: u32,
) -> [f32; 3] {
    let mut kept = 0;
    let mut next = [f32::NEG_INFINITY; 3];
    for i in 0..facets.len() {
        let facet = facets[i];
        // Whoever does not join is written over later.
        class[facet.number as usize] = number;
        facets[kept] = facet;
        let joins = dot::<TWO_SIDED>(facet.normal, representative) >= cosine;
        kept += usize::from(!joins);
        if CANONICAL && !joins && before(facet.normal, next) {
            next = facet.normal;
        }
    }
    // A representative is like itself but for rounding, which the cosine leaves room for.
    debug_assert!(kept < facets.len());
    facets.truncate(kept);
    if CANONICAL { next } else { facets.first().map_or(next, |facet| facet.normal) }
}

/// The same for many facets in many classes: sorted by z, those like a representative lie within a short run.
fn sweep<const TWO_SIDED: bool>(facets: &mut Vec<Facet>, cosine: f32, class: &mut [u32], classes: u32) -> u32 {
    facets.sort_unstable_by(|a, b| {
        if before(a.normal, b.normal) {
            Ordering::Less
        } else if before(b.normal, a.normal) {
            Ordering::Greater
        } else {
            Ordering::Equal
        }
    });
    // Rounding of the cosine and of the normals widens the angle by less than this where it is not tiny anyway.
    const WIDEN: f32 = 1e-3;
    let angle = cosine.clamp(-1.0, 1.0).acos() + WIDEN;
    // `next[i]`: the first facet from i on that may still be without class.
    let mut next: Vec<u32> = (0..=facets.len() as u32).collect();
    let mut classes = classes;
    let mut head = 0;
    while head < facets.len() {
        let representative = facets[head].normal;
        let lowest =
            (representative[2].clamp(-1.0, 1.0).acos() + angle).min(std::f32::consts::PI).cos() - WIDEN * WIDEN;
        // Two-sided normals have z >= 0, so that the far side of a representative is within the angle only if z = 0 is.
        let mut i = head;
        while i < facets.len() && facets[i].normal[2] >= lowest {
            let facet = facets[i];
            if dot::<TWO_SIDED>(facet.normal, representative) >= cosine {
                class[facet.number as usize] = classes;
                next[i] = i as u32 + 1;
            }
            i = skip(&mut next, i + 1);
        }
        classes += 1;
        head = skip(&mut next, head);
    }
    facets.clear();
    classes
}

/// The first place from `i` on that leads to itself; the way there is halved for the next one to come.
fn skip(next: &mut [u32], mut i: usize) -> usize {
    while next[i] as usize != i {
        next[i] = next[next[i] as usize];
        i = next[i] as usize;
    }
    i
}
