//! Boxes of eight triangles at once, and the boxes of all items.

use super::binary::ItemBox;
use super::{FEW, GROWTH, Items, LEAST, ULPS};
use crate::lanes::{Eight, Lanes, Vectors, WIDTH};
use crate::pages::Pages;
use crate::triangle::Triangles8;
use crate::{Shape, build::Bounds};
use pulp::NullaryFnOnce;
use rayon::prelude::*;
use std::marker::PhantomData;

/// Returns the boxes of eight triangles, per axis and side. If `padded`, each is padded as [`Items::bounds`] does.
// Without closures, which compilers don't always compile for the vectors of the function around them.
#[inline(always)]
pub(super) fn boxes<L: Lanes>(token: L::Token, triangles: &Triangles8, padded: bool) -> [[Eight; 2]; 3] {
    let [x, y, z] = [triangles.bounds::<L>(token, 0), triangles.bounds::<L>(token, 1), triangles.bounds::<L>(token, 2)];
    if !padded {
        return [sides(x), sides(y), sides(z)];
    }
    let extent = (x[1] - x[0]).max(y[1] - y[0]).max(z[1] - z[0]);
    let reach = reach(x).max(reach(y)).max(reach(z));
    let by = extent * L::splat(token, GROWTH) + reach * L::splat(token, ULPS) + L::splat(token, LEAST);
    [sides([x[0] - by, x[1] + by]), sides([y[0] - by, y[1] + by]), sides([z[0] - by, z[1] + by])]
}

#[inline(always)]
fn sides<L: Lanes>([low, high]: [L; 2]) -> [Eight; 2] {
    [Eight(low.to_array()), Eight(high.to_array())]
}

/// Returns the larger magnitude of both sides.
#[inline(always)]
fn reach<L: Lanes>([low, high]: [L; 2]) -> L {
    low.abs().max(high.abs())
}

/// Returns the items' boxes, moved by `-origin` and then scaled.
pub(super) fn scaled(items: &Items<'_>, origin: [f64; 3], scale: f64) -> Pages<ItemBox> {
    let vectors = Vectors::default();
    let mut boxes = Pages::zeroed(items.keys.len());
    boxes.par_chunks_mut(FEW).enumerate().for_each(|(chunk, boxes)| {
        let first = (chunk * FEW) as u32;
        match vectors {
            #[cfg(target_arch = "x86_64")]
            Vectors::Whole(token) => {
                let lanes = PhantomData::<crate::lanes::Whole>;
                token.vectorize(Scaled { token, items, origin, scale, first, boxes, lanes });
            }
            Vectors::Pair => {
                let lanes = PhantomData::<crate::lanes::Pair>;
                Scaled { token: (), items, origin, scale, first, boxes, lanes }.call();
            }
        }
    });
    boxes
}

/// The boxes of the items from `first` on, compiled for each kind of vectors.
struct Scaled<'a, L: Lanes> {
    token: L::Token,
    items: &'a Items<'a>,
    origin: [f64; 3],
    scale: f64,
    first: u32,
    boxes: &'a mut [ItemBox],
    lanes: PhantomData<L>,
}

impl<L: Lanes> NullaryFnOnce for Scaled<'_, L> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (first, boxes) in (self.first..).step_by(WIDTH).zip(self.boxes.chunks_mut(WIDTH)) {
            let mut bounds = self.items.boxes_from::<L>(self.token, first, boxes.len());
            for (axis, origin) in bounds.iter_mut().zip(self.origin) {
                for side in axis {
                    for value in &mut side.0 {
                        *value = (((f64::from(*value) - origin) * self.scale) as f32).clamp(0.0, 1.0);
                    }
                }
            }
            let [[x, right], [y, top], [z, far]] = &bounds;
            for (lane, it) in boxes.iter_mut().enumerate() {
                let low = [x.0[lane & 7], y.0[lane & 7], z.0[lane & 7]];
                let high = [right.0[lane & 7], top.0[lane & 7], far.0[lane & 7]];
                *it = ItemBox::new([low, high], first + lane as u32);
            }
        }
    }
}

impl Items<'_> {
    /// Returns the boxes of up to eight items from `first` on, per axis and side.
    #[inline(always)]
    fn boxes_from<L: Lanes>(&self, token: L::Token, first: u32, count: usize) -> [[Eight; 2]; 3] {
        let count = count.min(WIDTH);
        let from = first as usize;
        if self.still {
            let mut triangles = Triangles8::default();
            for (lane, &key) in self.keys[from..from + count].iter().enumerate() {
                if let Shape::Mesh(mesh) = &self.shapes[(key >> 32) as usize] {
                    triangles.put(lane, mesh.corners(key as u32));
                }
            }
            return boxes::<L>(token, &triangles, self.padded);
        }
        let mut bounds = [[Eight::default(); 2]; 3];
        for lane in 0..count {
            let corners: Bounds = self.bounds(first + lane as u32);
            for (axis, sides) in bounds.iter_mut().enumerate() {
                sides[0].0[lane] = corners[0][axis];
                sides[1].0[lane] = corners[1][axis];
            }
        }
        bounds
    }
}
