//! The fuzz target `checkpoint` on its seeds, so that breakage shows without `cargo fuzz`.
//!
//! `DAPPLE_WRITE_SEEDS=1 cargo test -p dapple-job --test job fuzz_corpus` rewrites the seeds.

#[allow(unreachable_pub)] // A target of its own where cargo-fuzz builds it.
#[path = "../../../../fuzz/src/checkpoint.rs"]
mod target;

use dapple_core::integrator::TrainingData;
use dapple_core::render::{Control, Readiness, Status, TracedRows};
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Draws, Estimate, Film, FirstHit, Frame, Integrator, Limits, Methods, Needs, PointSet, Render, SampleId,
    Sampler, Session, Worker,
};
use dapple_job::checkpoint::{Identity, StateFile, StateKind};
use std::path::Path;

/// SplitMix64's finaliser.
pub(crate) fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

struct Hashed;

impl PointSet for Hashed {
    fn describe(&self) -> String {
        "hashed".into()
    }

    fn block(&self, id: SampleId, block: u32) -> [f32; 4] {
        let name = [id.pixel[0], id.pixel[1], id.stream, block].map(u64::from);
        let hash = name.into_iter().chain([id.index, 1]).fold(1, |hash, word| mix(hash ^ mix(word)));
        [0, 16, 32, 48].map(|shift| (hash >> shift & 0xffff) as f32 / 65536.0)
    }

    fn capacity(&self) -> u64 {
        u64::MAX
    }
}

/// An integrator that learns, reports hits, and sometimes returns an invalid sample.
struct Field;

impl Integrator for Field {
    fn estimate(&self, draws: &Draws<'_>, observed: &mut Worker) -> Estimate {
        let u = draws.block(Block::new(0));
        observed.note((u[0] * 4.0) as u64, u[1]);
        let first_hit = (u[2] > 0.3).then_some(
            FirstHit::new([u[0]; 3], [0.0, 0.0, 1.0], 1.0)
                .with_shading_normal([0.0, 1.0, 0.0])
                .with_albedo([0.5; 3])
                .with_footprint(0.1)
                .with_material(1)
                .with_shape(2)
                .with_primitive(3),
        );
        Estimate::new([u[0] - 0.05, u[1], u[3]]).with_first_hit(first_hit).with_cost(2)
    }

    fn wants_training(&self) -> bool {
        true
    }

    fn learn(&mut self, _: &TrainingData) {}
}

fn rendered(sampler: &mut dyn Sampler, needs: Needs) -> (Film, Vec<u8>) {
    let mut bytes = Vec::new();
    let mut monitor = |status: &Status<'_>| {
        bytes = status.snapshot();
        if status.samples > 12 { Control::Stop } else { Control::Continue }
    };
    let frame = Frame::new(5, 4).and_then(|frame| frame.crop(1, 1, 4, 3)).unwrap();
    let film =
        Render::new(frame, &Limits::samples(19)).needs(needs).monitor(&mut monitor).run(&mut Field, sampler).unwrap();
    (film, bytes)
}

fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let everything = Needs::none()
        .with_variance()
        .with_halves()
        .with_feature_halves()
        .with_first_hits(1)
        .with_surfaces()
        .with_cost()
        .with_emission();
    let (_, snapshot) = rendered(&mut Uniform::new(Hashed), everything);
    let (_, plain) = rendered(&mut Uniform::new(Hashed), Needs::none());
    let identity = Identity::new([("scene", "teapot"), ("seed", "7")]);
    let file = StateFile::new(StateKind::Checkpoint, identity, plain.clone()).bytes().to_vec();
    let unsigned = file[..file.len() - 4].to_vec();
    let (frame, limits) = (Frame::new(3, 2).unwrap(), Limits::samples(19));
    let mut sampler = Uniform::new(Hashed);
    let methods = Methods::from(&mut sampler).with_needs(Needs::none().with_variance());
    let mut session = Session::new(frame, limits.clone(), methods).unwrap();
    let stage = session.next_stage(&Field).unwrap().unwrap();
    let rows = session.rows_of(&stage, 0..2).unwrap();
    let render = Render::new(frame, &limits).needs(Needs::none().with_variance());
    let part =
        render.trace_rows(&rows, &mut Readiness::default(), &mut Field, &mut Uniform::new(Hashed)).unwrap().unwrap();
    vec![("file", file), ("unsigned", unsigned), ("snapshot", snapshot), ("plain", plain), ("part", part)]
}

/// Stored seeds and newly made ones, which differ in their timings, are damaged in many ways without causing a panic.
#[test]
fn checkpoints_bear_damage_i01() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/seeds/checkpoint"));
    let made = seeds();
    if std::env::var_os("DAPPLE_WRITE_SEEDS").is_some() {
        std::fs::create_dir_all(folder).unwrap();
        made.iter().for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes).unwrap());
    }
    let stored = made.iter().map(|(name, _)| std::fs::read(folder.join(name)).unwrap()).collect::<Vec<_>>();
    assert!(dapple_core::Snapshot::from_bytes(&stored[2]).is_ok(), "of another version: set DAPPLE_WRITE_SEEDS=1");
    assert!(TracedRows::from_bytes(&stored[4]).is_ok() && StateFile::from_bytes(stored[0].clone()).is_ok());
    let mut state = 1;
    let mut random = |below: usize| {
        state = mix(state + 1);
        state as usize % below
    };
    for input in made.into_iter().map(|(_, bytes)| bytes).chain(stored) {
        target::checkpoint(&input);
        for _ in 0..2000 {
            let mut bytes = input.clone();
            for _ in 0..=random(4) {
                let (at, from) = (random(bytes.len()), random(bytes.len()));
                match random(5) {
                    0 => bytes[at] ^= 1 << random(8),
                    1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random(5)],
                    2 => bytes[at] = bytes[from],
                    3 => bytes.truncate(at.max(1)),
                    _ => {
                        let piece = bytes[at.min(from)..at.max(from).min(at.min(from) + 16)].to_vec();
                        bytes.splice(at..at, piece);
                    }
                }
            }
            target::checkpoint(&bytes);
        }
    }
}
