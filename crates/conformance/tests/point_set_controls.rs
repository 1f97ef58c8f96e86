//! Negative controls: point sets with one fault each, which the checks must report.

use dapple_conformance::toys::Points;
use dapple_core::point_set::mix;
use dapple_core::{PointSet, SampleId};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};

fn key(words: &[u64]) -> u64 {
    words.iter().fold(0x9e37_79b9_7f4a_7c15, |h, w| mix(h.wrapping_add(mix(w ^ h.rotate_left(17)))))
}

fn four(key: u64) -> [f32; 4] {
    [1, 2, 3, 4].map(|k| (mix(key.wrapping_add(mix(k))) >> 40) as f32 / 16_777_216.0)
}

fn pixel(id: &SampleId) -> u64 {
    u64::from(id.pixel[0]) | u64::from(id.pixel[1]) << 32
}

fn sound(id: SampleId, block: u32) -> [f32; 4] {
    four(key(&[pixel(&id), id.stream.into(), id.index, block.into()]))
}

/// Asserts that the check fails, with a message that names the fault.
fn rejected(points: &dyn PointSet, fault: &str) {
    let outcome = catch_unwind(AssertUnwindSafe(|| dapple_conformance::point_set(points)));
    let payload = outcome.expect_err("a broken point set was accepted");
    let fixed = payload.downcast_ref::<&str>().map(ToString::to_string);
    let message = payload.downcast_ref::<String>().cloned().or(fixed).unwrap_or_default();
    assert!(message.contains(fault), "rejected, but with {message:?} instead of {fault:?}");
}

#[test]
fn a_sound_set_is_accepted() {
    dapple_conformance::point_set(&Points(sound));
}

/// A point set that returns the wrong second block when two blocks are read together.
struct Mispaired;

impl PointSet for Mispaired {
    fn describe(&self) -> String {
        "mispaired".into()
    }
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        sound(id, block)
    }
    fn two_blocks(&self, id: SampleId, [first, second]: [u32; 2]) -> [[f32; 4]; 2] {
        [sound(id, first), sound(id, second.wrapping_add(1))]
    }
    fn capacity(&self) -> u64 {
        u64::MAX
    }
}

#[test]
fn blocks_that_differ_when_read_together_are_rejected() {
    rejected(&Mispaired, "differ when read together");
}

type Block = fn(SampleId, u32) -> [f32; 4];

/// Point sets with one fault each, and part of the message about the fault.
const FAULTS: [(&str, Block); 6] = [
    // Rounding to nearest reaches 1.0 once in 2^25 numbers; here at one index, so that the check meets it.
    ("not in [0, 1)", |id, block| if id.index == 5 && block == 3 { [0.5, 1.0, 0.5, 0.5] } else { sound(id, block) }),
    ("not in [0, 1)", |id, block| if id.index >> 53 == 1 { [f32::NAN; 4] } else { sound(id, block) }),
    ("streams 0 and 1", |id, block| sound(SampleId::new(id.pixel, id.stream & !1, id.index), block)),
    ("of block 15 and", |id, block| sound(id, block % 85)),
    ("repeats as", |id, block| sound(SampleId::new(id.pixel, id.stream, id.index % 65_536), block)),
    ("standard errors from", |id, block| sound(id, block).map(|u| u * 0.98)),
];

#[test]
fn faults_are_rejected() {
    for (fault, points) in FAULTS {
        rejected(&Points(points), fault);
    }
}

#[test]
fn a_cursor_is_rejected() {
    let cursor = AtomicU64::new(0);
    let points = |_: SampleId, _: u32| four(key(&[cursor.fetch_add(1, Ordering::Relaxed)]));
    rejected(&Points(points), "differs from reading forward");
}

#[test]
fn a_scramble_shared_by_pixels_is_rejected() {
    let points =
        |id: SampleId, block| sound(SampleId::new([id.pixel[0] & !63, id.pixel[1]], id.stream, id.index), block);
    rejected(&Points(points), "standard errors from");
    // Each repetition is shifted by a quarter, so that moments over the image stay correct and only the comparison of pixels
    // fails.
    for (period, apart) in [(2, "pixels (1, 0) apart"), (64, "pixels (64, 0) apart")] {
        let points = |id: SampleId, block| {
            let (first, repetition) = if period == 2 {
                (id.pixel[0] & !1, id.pixel[0] & 1)
            } else {
                (id.pixel[0] % period, id.pixel[0] / period % 4)
            };
            sound(SampleId::new([first, id.pixel[1]], id.stream, id.index), block)
                .map(|u| (f64::from(u) + f64::from(repetition) * 0.25).fract() as f32)
        };
        rejected(&Points(points), apart);
    }
}

#[test]
fn a_common_order_is_rejected() {
    // Van der Corput's points with an XOR scramble per block, but no shuffle.
    let points = |id: SampleId, block: u32| {
        let place = key(&[pixel(&id), id.stream.into(), block.into(), id.index >> 16]);
        [0, 1, 2, 3].map(|k| (((id.index as u32).reverse_bits() ^ mix(place + k) as u32) >> 8) as f32 / 16_777_216.0)
    };
    rejected(&Points(points), "the same order");
}

/// Sound points with one wrong method.
struct Counts(fn(u64) -> u64, &'static str);

impl PointSet for Counts {
    fn describe(&self) -> String {
        self.1.into()
    }
    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        sound(id, block)
    }
    fn capacity(&self) -> u64 {
        u64::MAX
    }
    fn preferred_count(&self, n: u64) -> u64 {
        (self.0)(n)
    }
}

#[test]
fn bad_counts_are_rejected() {
    rejected(&Counts(|n| n / 4 * 4, "mine"), "is less than");
    rejected(&Counts(|n| if n == 5 { 100 } else { n }, "mine"), "preferred_count fell");
    rejected(&Counts(|n| n + 1, "mine"), "but preferred_count(1) = 2");
    rejected(&Counts(|n| n, " "), "describe() is empty");
}
