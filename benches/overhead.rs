//! The cost per sample that a session adds to the host's own loop: random numbers, `Tile::add` and `Round::submit`.
//!
//! `cargo bench -p dapple-benches --bench overhead` prints nanoseconds on one thread, with the statistics that the default pair
//! records. The goal is under 20 ns. With `--test`, it runs once at a small size.

#![expect(clippy::print_stdout, reason = "the program prints its result")]

use dapple_core::samplers::Uniform;
use dapple_core::{Error, Estimate, FirstHit, Frame, Limits, Methods, Needs, Session};
use dapple_core::{PointSet, SampleId, Sampler};
use std::hint::black_box;
use std::time::Instant;

/// The side of the image, and of the host's blocks.
const SIDES: [u32; 2] = [256, 32];

/// A point set that costs almost nothing.
struct Cheap;

impl PointSet for Cheap {
    fn describe(&self) -> String {
        "cheap".into()
    }
    fn block(&self, id: SampleId, _: u32) -> [f32; 4] {
        let u = (id.index as u32).wrapping_mul(0x9e37_79b9).wrapping_add(id.pixel[0]) >> 8;
        [u as f32 * (1.0 / 16_777_216.0); 4]
    }
}

/// The blocks of the image, each as `[x0, y0, x1, y1]`.
fn blocks() -> impl Iterator<Item = [u32; 4]> {
    let [whole, side] = SIDES;
    let corners =
        (0..whole).step_by(side as usize).flat_map(move |y| (0..whole).step_by(side as usize).map(move |x| [x, y]));
    corners.map(move |[x, y]| [x, y, x + side, y + side])
}

/// The host's own loop: computes the mean of each pixel.
fn own(points: &dyn PointSet, spp: u32) -> Vec<[f32; 3]> {
    let mut image = vec![[0.0; 3]; (SIDES[0] * SIDES[0]) as usize];
    for [x0, y0, x1, y1] in blocks() {
        for [x, y] in (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y])) {
            let mean = &mut image[(y * SIDES[0] + x) as usize];
            for index in 0..spp {
                let [r, g, b, _] = points.block(SampleId::new([x, y], 0, index.into()), 0);
                *mean = [mean[0] + r / spp as f32, mean[1] + g / spp as f32, mean[2] + b / spp as f32];
            }
        }
    }
    image
}

/// Renders the same image through a session.
fn session(spp: u32, needs: Needs, hits: bool) -> Result<Vec<[f32; 3]>, Error> {
    let methods = Methods::from(Uniform::new(Cheap)).with_needs(needs);
    let session = Session::new(Frame::new(SIDES[0], SIDES[0])?, Limits::spp(spp.into()), methods)?;
    let trace = |sample: &dapple_core::Draws<'_>| {
        let [r, g, b, t] = sample.block(dapple_core::Block::new(0));
        let hit = hits.then(|| FirstHit::new([r, g, t], [0.0, 1.0, 0.0], t).with_albedo([b, 0.5, 0.5]));
        Estimate::new([r, g, b]).with_first_hit(hit)
    };
    Ok(session.run(|round| blocks().try_for_each(|area| round.trace_tile(area, trace)))?.radiance)
}

fn main() -> Result<(), Error> {
    let has = |name: &str| std::env::args().any(|argument| argument == name);
    let (spp, times) = if has("--bench") && !has("--test") { (64, 9) } else { (2, 1) };
    let pair = dapple_registry::default_pair(7);
    let needs = pair.filter.map_or(pair.sampler.needs(), |filter| filter.needs().and(pair.sampler.needs()));
    let seconds = |work: &mut dyn FnMut() -> Result<Vec<[f32; 3]>, Error>| {
        let began = Instant::now();
        black_box(work()?);
        Ok::<_, Error>(began.elapsed().as_secs_f64())
    };
    for (name, hits) in [("without first hits", false), ("with first hits", true)] {
        let mut least = [f64::INFINITY; 2];
        for _ in 0..times {
            least[0] = least[0].min(seconds(&mut || Ok(own(black_box(&Cheap), spp)))?);
            least[1] = least[1].min(seconds(&mut || session(spp, needs, black_box(hits)))?);
        }
        let samples = f64::from(SIDES[0] * SIDES[0] * spp);
        println!("{name}: {:.1} ns per sample", (least[1] - least[0]) * 1e9 / samples);
    }
    Ok(())
}
