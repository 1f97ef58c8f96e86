//! The worth of each option of the sampler `adaptive`: its error over that of uniform counts, at equal samples.
//!
//! ```sh
//! cargo run --release --example counts_ablation -- --full
//! cargo run --release --example counts_ablation -- --full --method adaptive:epsilon=0.01,prior=inf
//! ```
//!
//! Bundled scenes on `sobol`, unfiltered. The reference is `sobol` of another seed with many more samples. Prints the
//! ratios of the mean errors over seeds, sRGB MSE and relMSE, per scene and as geometric means. Also prints seconds
//! over those of uniform counts, as Markdown (`docs/results/to_csv.py` makes CSV of it). Without `--full` a small form
//! runs in seconds.
//!
//! `--method` may begin with a light selection, such as `learned@uniform`; the default is by power. `--against` names
//! the method of comparison (`uniform`). Further options: `--scenes` and `--spp`, lists with commas; `--seeds`,
//! `--side`, `--reference`.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a program whose table is its result")]

use dapple::core::{Frame, Limits, Render};
use dapple::job::registry::{self, MethodInputs};
use dapple::metrics::{Pixels, compare};
use dapple::renderer::light::LightSelection;
use dapple::renderer::{World, integrator};
use dapple_scene::{self as scene, bundled};
use std::sync::Arc;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const METHODS: [&str; 15] = [
    "variance",
    "adaptive:epsilon=0.01",
    "adaptive:epsilon=0.01,gain=1",
    "adaptive:policy=keep,epsilon=0.01,pilot=4",
    "adaptive:policy=keep,epsilon=0.01,pilot=16",
    "adaptive:policy=keep,epsilon=0.01,prior=inf",
    "adaptive:policy=keep,epsilon=0.01,prior=12",
    "adaptive:policy=keep,epsilon=0.01,prior=3",
    "adaptive:policy=keep,epsilon=0.01,radius=1",
    "adaptive:policy=keep,epsilon=0.01,radius=3",
    "adaptive:policy=keep,epsilon=0.01,exponent=1",
    "adaptive:policy=keep,epsilon=0.01,exponent=1.3",
    "adaptive:policy=keep,epsilon=0.01,rounds=2",
    "adaptive:policy=keep,epsilon=0.01,rounds=3",
    "adaptive:epsilon=0.01,policy=discard",
];

struct Run {
    scenes: Vec<String>,
    side: u32,
    spp: Vec<u64>,
    seeds: u64,
    reference_spp: u64,
    methods: Vec<String>,
    against: String,
}

impl Run {
    fn from_arguments() -> Result<Self> {
        let full = std::env::args().any(|a| a == "--full");
        let names = |list: &str| list.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut run = Self {
            scenes: names("teapot,terrain,cornell,glass"),
            side: if full { 160 } else { 24 },
            spp: if full { vec![8, 32] } else { vec![8] },
            seeds: if full { 4 } else { 1 },
            reference_spp: if full { 2048 } else { 64 },
            methods: Vec::new(),
            against: "uniform".into(),
        };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
            match argument.as_str() {
                "--full" => {}
                "--scenes" => run.scenes = names(&value()?),
                "--seeds" => run.seeds = value()?.parse()?,
                "--side" => run.side = value()?.parse()?,
                "--reference" => run.reference_spp = value()?.parse()?,
                "--spp" => {
                    run.spp = names(&value()?).iter().map(|n| n.parse()).collect::<std::result::Result<_, _>>()?
                }
                "--against" => run.against = value()?,
                "--method" => run.methods.push(value()?),
                // CI passes a folder to every example; this one writes nothing.
                folder if !folder.starts_with('-') => {}
                other => {
                    return Err(
                        format!("option \"{other}\" is unknown; the first lines of this example list all").into()
                    );
                }
            }
        }
        if run.methods.is_empty() {
            run.methods = METHODS.map(str::to_owned).to_vec();
        }
        Ok(run)
    }
}

fn main() -> Result<()> {
    let run = Run::from_arguments()?;
    println!(
        "{0}x{0} pixels, {1} seeds, reference {2} spp; sRGB MSE / relMSE over `{3}`, on `sobol`, unfiltered.",
        run.side, run.seeds, run.reference_spp, run.against
    );
    let scenes: Vec<Course> = run.scenes.iter().map(|name| Course::of(name, &run)).collect::<Result<_>>()?;
    for &spp in &run.spp {
        println!("\n| {spp} spp | {} | geometric mean | time |", run.scenes.join(" | "));
        println!("|---|{}---|---|", "---|".repeat(run.scenes.len()));
        let against: Vec<[f64; 3]> = scenes.iter().map(|s| s.errors(&run.against, spp, &run)).collect::<Result<_>>()?;
        for method in &run.methods {
            let mut logs = [0.0; 3];
            let mut row = format!("| `{method}` |");
            for (scene, against) in scenes.iter().zip(&against) {
                let found = scene.errors(method, spp, &run)?;
                let ratio = [0, 1, 2].map(|k| found[k] / against[k]);
                (0..3).for_each(|k| logs[k] += ratio[k].ln() / scenes.len() as f64);
                row += &format!(" {:.3} / {:.3} |", ratio[0], ratio[1]);
            }
            println!("{row} {:.3} / {:.3} | {:.2} |", logs[0].exp(), logs[1].exp(), logs[2].exp());
        }
    }
    Ok(())
}

/// A scene with each light selection, and its reference.
struct Course {
    worlds: [Arc<World>; 3],
    image: Vec<[f32; 3]>,
}

const CHOICES: [(&str, LightSelection); 3] =
    [("power", LightSelection::Power), ("uniform", LightSelection::Uniform), ("learned", LightSelection::Learned)];

impl Course {
    fn of(name: &str, run: &Run) -> Result<Self> {
        let mut scene = bundled::files(name).ok_or("no such bundled scene")?.read()?;
        scene.film.pixel_filter = scene::PixelFilter::default();
        let world = World::with_resolution(&scene, [run.side; 2])?;
        let worlds = CHOICES.map(|(_, choice)| {
            let mut world = world.clone();
            world.set_light_selection(choice);
            Arc::new(world)
        });
        let mut course = Self { worlds, image: Vec::new() };
        course.image = course.render("uniform", 777, run.reference_spp, run)?;
        eprintln!("{name}: reference made");
        Ok(course)
    }

    fn render(&self, method: &str, seed: u64, spp: u64, run: &Run) -> Result<Vec<[f32; 3]>> {
        let (selection, sampler) = method.split_once('@').unwrap_or(("power", method));
        let choice = CHOICES
            .iter()
            .position(|(name, _)| *name == selection)
            .ok_or("a light selection is power, uniform or learned")?;
        let world = &self.worlds[choice];
        let points = registry::points("sobol", registry::Setting { seed, spp: Some(spp) })?;
        let mut sampler = registry::sampler(sampler, points, &MethodInputs::of(world.clone()))?.sampler;
        let frame = Frame::new(run.side, run.side)?;
        let limits = Limits::samples(spp * frame.pixels() as u64);
        let film = Render::new(frame, &limits).run(&mut *integrator(world), &mut *sampler)?;
        Ok(film.image())
    }

    /// sRGB MSE, relMSE and seconds, summed over seeds.
    fn errors(&self, method: &str, spp: u64, run: &Run) -> Result<[f64; 3]> {
        let mut sums = [0.0; 3];
        for seed in 1..=run.seeds {
            let began = Instant::now();
            let found = self.render(method, seed, spp, run)?;
            let seconds = began.elapsed().as_secs_f64();
            let size = [run.side; 2];
            let compared = compare(Pixels::new(size, &found)?, Pixels::new(size, &self.image)?)?;
            sums = [sums[0] + compared.srgb8_mse, sums[1] + compared.rel_mse, sums[2] + seconds];
        }
        Ok(sums)
    }
}
