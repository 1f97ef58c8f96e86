//! The tables of the thesis behind the cluster sampler, repeated [Lan 2016].
//!
//! ```sh
//! cargo run --release --example thesis_tables -- --full --thesis-sizes > tables.md
//! ```
//!
//! Uniform, Mitchell's and the cluster sampler render the bundled terrain and teapot. Each film is filtered in three
//! ways. Errors are relative to references of another point set and another seed. Prints the equivalents of the thesis'
//! tables 4-4, 4-5, 4-6 and of its times as Markdown, at equal samples and at equal time. They have 95 % intervals and
//! the thesis' own numbers beside them; `docs/results/to_csv.py` makes CSV of it.
//!
//! * `--full`: 256x256 pixels, 8 to 64 spp, 8 seeds, references of 10,240 spp (about forty minutes on two cores).
//!   Without it a small form runs in seconds.
//! * `--thesis-sizes`: also renders, once, the thesis' 1024x1024 terrain and 800x800 teapot (as long again).
//! * `--spp 8,16`: only these budgets at the thesis' sizes.
//! * `--cache DIR`, or a bare `DIR`: the folder of references, `target/thesis-references` by default. A repeated run
//!   reuses them. Their names contain a hash of the scene; delete them after a change of the renderer itself.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a program whose tables are its result")]

mod measure;
mod published;
mod reference;
mod report;
mod statistics;

use measure::Plan;
use std::path::PathBuf;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The scenes, each with the voxels per cube root of the triangles and the size that the thesis used for its own.
const SCENES: [(&str, u32, u32); 2] = [("terrain", 9, 1024), ("teapot", 30, 800)];

fn main() -> Result<()> {
    let (mut full, mut thesis_sizes, mut cache) = (false, false, PathBuf::from("target/thesis-references"));
    let mut spp = "8,16,32,64".to_owned();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--full" => full = true,
            "--thesis-sizes" => thesis_sizes = true,
            "--spp" => spp = words.next().ok_or("--spp needs a list, such as 8,16")?,
            "--cache" => cache = words.next().ok_or("--cache needs a folder")?.into(),
            flag if flag.starts_with('-') => {
                return Err(format!(
                    "option \"{flag}\" is unknown; give --full, --thesis-sizes, --spp LIST or --cache DIR"
                )
                .into());
            }
            folder => cache = folder.into(),
        }
    }
    std::fs::create_dir_all(&cache)?;

    report::preamble();
    for (scene, k, _) in SCENES {
        let plan = match full {
            true => Plan { scene, k, side: 256, spp: &[8, 16, 32, 64], seeds: 8, reference_spp: 10_240 },
            false => Plan { scene, k, side: 32, spp: &[8, 16], seeds: 3, reference_spp: 256 },
        };
        report::scene(&measure::run(&plan, &cache)?);
    }
    if thesis_sizes {
        let spp: &'static [u64] = spp.split(',').map(str::parse).collect::<std::result::Result<Vec<_>, _>>()?.leak();
        for (scene, k, side) in SCENES {
            let plan = Plan { scene, k, side, spp, seeds: 1, reference_spp: 128 };
            report::scene(&measure::run(&plan, &cache)?);
        }
    }
    Ok(())
}
