//! Filters have no runaway negative weights, and their result does not depend on tiles.

use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Filter, FirstHit, Frame, Integrator, Limits, Needs, Render, Worker};
use dapple_denoise::{Bilateral, ClusterGaussian, ClusterLookup, ClusterRegression, Gaussian, NlMeans};
use dapple_low_discrepancy::Random;
use std::sync::Arc;

/// Samples that are 0 or 1 at random, on surfaces in stripes.
struct TwoLevels;

impl Integrator for TwoLevels {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, a, _] = draws.block(Block::new(0));
        let [x, y] = draws.pixel();
        let first_hit = draws.wants_first_hit().then_some(
            FirstHit::new([x as f32 + u, y as f32 + v, 0.0], [0.0, 0.0, 1.0], 50.0 + u)
                .with_shading_normal(if x % 16 < 8 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] })
                .with_albedo([if y % 12 < 6 { 0.3 } else { 0.8 }; 3])
                .with_footprint(1.0)
                .with_material(x / 16 % 3)
                .with_primitive(y / 6),
        );
        let likely = if (x / 8 + y / 8).is_multiple_of(2) { 0.1 } else { 0.7 };
        Estimate::new([f32::from(u8::from(a < likely)); 3]).with_first_hit(first_hit)
    }
}

const NEEDS: Needs = Needs::none().with_halves().with_variance().with_features().with_first_hits(1);

fn film(frame: Frame, spp: u64) -> Film {
    let limits = Limits::samples(spp * frame.pixels() as u64);
    Render::new(frame, &limits).needs(NEEDS).run(&mut TwoLevels, &mut Uniform::new(Random::new(3))).unwrap()
}

/// Every filter of this crate with its reach in pixels: kernels, windows and patches added up.
fn filters() -> Vec<(Box<dyn Filter>, u32)> {
    let label: ClusterLookup = Arc::new(|hit| Some(hit.material));
    vec![
        (Box::new(Gaussian::default()), 4),
        (Box::new(Gaussian::new(0.5, 3.0).unwrap()), 4),
        (Box::new(ClusterGaussian::from_hits(label.clone())), 4),
        (Box::new(NlMeans::default()), 24),
        (Box::new(Bilateral::default()), 24),
        (Box::new(ClusterRegression::new().with_clusters(label, "")), 32),
    ]
}

/// An image of two levels stays within [-1, 2]: no sum of weights comes near 0 and no slope runs away.
#[test]
fn two_levels_stay_in_range_f07() {
    for (spp, side) in [(2, 400), (4, 160)] {
        let film = film(Frame::new(side, side).unwrap(), spp);
        for (filter, _) in filters() {
            let image = filter.apply(&film).unwrap();
            let off = image.radiance.iter().flatten().find(|v| !(-1.0..=2.0).contains(*v));
            assert_eq!(off, None, "{} at {spp} spp", filter.describe());
        }
    }
    // Control: the kernel of Mitchell and Netravali runs away when one random sample per pixel weighs it.
    assert!(splatted(200_000) > 2.0);
}

/// The largest pixel of a row of two levels, one sample per pixel, splatted with the cubic kernel of B = 0, C = 1/2 and
/// radius 1.
fn splatted(pixels: u64) -> f64 {
    let kernel = |x: f64| {
        let x = 2.0 * x.abs();
        if x < 1.0 {
            1.5 * x * x * x - 2.5 * x * x + 1.0
        } else if x < 2.0 {
            -0.5 * x * x * x + 2.5 * x * x - 4.0 * x + 2.0
        } else {
            0.0
        }
    };
    let sample = |i: u64| {
        let x = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x >> 40) as f64 / (1u64 << 24) as f64, (x & 1) as f64)
    };
    let pixel = |i: u64| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for k in i.saturating_sub(1)..=i + 1 {
            let (u, value) = sample(k);
            let weight = kernel(k as f64 + u - i as f64 - 0.5);
            sum += weight * value;
            weights += weight;
        }
        (sum / weights).abs()
    };
    (0..pixels).map(pixel).fold(0.0, f64::max)
}

/// A window of the image filtered by itself equals the whole image bit for bit, beyond the kernel's reach of its
/// border, on any number of threads.
///
/// Filters over halves use statistics of the whole image, so a window may differ. They are tested for equal results on
/// any number of threads.
#[test]
fn results_do_not_depend_on_tiles_f10() {
    let frame = Frame::new(150, 131).unwrap();
    let whole = film(frame, 4);
    let on = |threads: usize, filter: &dyn Filter, film: &Film| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| filter.apply(film)).unwrap()
    };
    for (filter, reach) in filters() {
        let expected = on(1, &*filter, &whole);
        assert_eq!(on(7, &*filter, &whole), expected, "{}", filter.describe());
        if reach > 4 {
            continue;
        }
        for (x0, y0, width, height, threads) in [(0, 0, 97, 90, 3), (2, 6, 140, 80, 2), (34, 18, 100, 111, 7)] {
            let window = frame.crop(x0, y0, x0 + width, y0 + height).unwrap();
            let cut = on(threads, &*filter, &film(window, 4));
            let inside = |at: u32, size: u32, full: u32, origin: u32| {
                (origin == 0 || at >= reach) && (origin + size == full || at + reach < size)
            };
            let mut compared = 0;
            for (i, got) in cut.radiance.iter().enumerate() {
                let (x, y) = (i as u32 % width, i as u32 / width);
                if inside(x, width, 150, x0) && inside(y, height, 131, y0) {
                    let there = expected.radiance[((y0 + y) * 150 + x0 + x) as usize];
                    assert_eq!(got.map(f32::to_bits), there.map(f32::to_bits), "{}, ({x}, {y})", filter.describe());
                    compared += 1;
                }
            }
            assert!(compared > 500, "{}: {compared}", filter.describe());
        }
    }
}
