//! Comparison of Dapple's and pbrt-v4's images of published scenes: ratios of means and of block means, and pairs of images.
//!
//! ```sh
//! cargo run --release --example references -- --full [--images DIR] [SCENE]... > table.md
//! ```
//!
//! Renders each scene of `shared/scenes/pbrt-v4` that has an image in `shared/references`, at that image's size. It uses the
//! scene's own depth limit, a box filter and uniform `sobol` samples, with several seeds. `--images` writes `SCENE.png`: Dapple
//! on the left, pbrt on the right. Prints Markdown (`docs/results/to_csv.py` converts it to CSV). Without `--full`, it renders
//! only a few samples, as a test.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a program whose table is its result")]

use dapple_core::{Frame, Limits, Render};
use dapple_job::registry::{self, MethodInputs};
use dapple_metrics::{Pixels, block_ratios, compare};
use dapple_renderer::{World, integrator};
use dapple_scene::image::{Encoding, Image, encode_png, read_image, write_file};
use dapple_scene::{self as scene, pbrt};
use std::path::{Path, PathBuf};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The scenes, with the number of samples per pixel in each replicate.
const SCENES: [(&str, u64); 8] = [
    ("cornell-box", 64),
    ("veach-mis", 128),
    ("teapot", 64),
    ("coffee", 128),
    ("dining-room", 128),
    ("staircase2", 128),
    ("veach-bidir", 256),
    ("water-caustic", 64),
];
/// The number of replicates. Their variance gives the noise of Dapple's images.
const SEEDS: u64 = 8;
/// The side of a block in pixels.
const BLOCK: u32 = 10;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (mut full, mut images, mut wanted) = (false, None, Vec::new());
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--full" => full = true,
            "--images" => images = Some(PathBuf::from(arguments.next().ok_or("--images needs a folder")?)),
            name if SCENES.iter().any(|(known, _)| *known == name) => wanted.push(argument),
            other if Path::new(other).is_dir() => {}
            other => return Err(format!("unknown scene \"{other}\"; use one of the constant SCENES").into()),
        }
    }
    let folder = std::env::var("DAPPLE_SCENES").unwrap_or_else(|_| "../shared/scenes".into());
    println!(
        "| scene | spp x seeds | ratio of means R G B | +- | 10x10 blocks, 5 % | 50 % | 95 % | relMSE without the worst 0.1 % |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (name, spp) in SCENES {
        if !wanted.is_empty() && !wanted.iter().any(|w| w == name) {
            continue;
        }
        let file = Path::new(&folder).join(format!("pbrt-v4/{name}/scene-v4.pbrt"));
        let reference = Path::new(&folder).join(format!("../references/{name}-rgb.exr"));
        if !(file.is_file() && reference.is_file()) {
            eprintln!("skipped: {name}, no {} or {}", file.display(), reference.display());
            continue;
        }
        let (spp, seeds) = if full { (spp, SEEDS) } else { (1, 2) };
        println!("{}", row(name, &file, &reference, spp, seeds, images.as_deref())?);
    }
    Ok(())
}

fn row(name: &str, file: &Path, reference: &Path, spp: u64, seeds: u64, images: Option<&Path>) -> Result<String> {
    let mut scene = pbrt::read_scene(file, &pbrt::ReadOptions::default())?;
    let reference = read_image(&std::fs::read(reference)?, name, Encoding::Auto)?;
    scene.film.resolution = reference.size;
    scene.film.pixel_filter = scene::PixelFilter::default();
    let world = World::new(&scene)?;
    let films: Vec<Vec<[f32; 3]>> =
        (0..seeds).map(|seed| image(&world, reference.size, spp, 500 + seed)).collect::<Result<_>>()?;
    let count = films.len() as f64;
    let mean: Vec<[f32; 3]> = (0..films[0].len())
        .map(|i| std::array::from_fn(|c| (films.iter().map(|f| f64::from(f[i][c])).sum::<f64>() / count) as f32))
        .collect();
    let (ours, theirs) = (Pixels::new(reference.size, &mean)?, Pixels::new(reference.size, &reference.pixels)?);
    let all = compare(ours, theirs)?;
    let blocks = block_ratios(ours, theirs, [BLOCK; 2])?;
    let noise: [f64; 3] = std::array::from_fn(|c| {
        let means: Vec<f64> = films.iter().map(|f| f.iter().map(|p| f64::from(p[c])).sum::<f64>()).collect();
        let mean = means.iter().sum::<f64>() / count;
        let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1.0);
        (variance / count).sqrt() / mean
    });
    if let Some(folder) = images {
        std::fs::create_dir_all(folder)?;
        write_file(&folder.join(format!("{name}.png")), &beside(&mean, &reference)?)?;
    }
    let three = |x: [f64; 3]| format!("{:.4} {:.4} {:.4}", x[0], x[1], x[2]);
    Ok(format!(
        "| {name} | {spp} x {seeds} | {} | {} | {} | {} | {} | {:.5} |",
        three(all.channel_ratios),
        three(noise),
        three(blocks.percentile(5.0)),
        three(blocks.percentile(50.0)),
        three(blocks.percentile(95.0)),
        all.rel_mse_trimmed
    ))
}

fn image(world: &World, size: [u32; 2], spp: u64, seed: u64) -> Result<Vec<[f32; 3]>> {
    let mut integrator = integrator(world);
    let points = registry::points("sobol", registry::PointSettings { seed, spp: Some(spp) })?;
    let mut sampler = registry::sampler("uniform", points, &MethodInputs::default())?.sampler;
    let frame = Frame::new(size[0], size[1])?;
    let limits = Limits::samples(spp * u64::from(size[0]) * u64::from(size[1]));
    let film = Render::new(frame, &limits).run(&mut *integrator, &mut *sampler)?;
    Ok(film.image())
}

/// Dapple's image and the reference, side by side.
fn beside(ours: &[[f32; 3]], theirs: &Image) -> Result<Vec<u8>> {
    let [width, height] = theirs.size.map(|n| n as usize);
    let mut pixels = Vec::with_capacity(2 * width * height);
    for y in 0..height {
        pixels.extend_from_slice(&ours[y * width..(y + 1) * width]);
        pixels.extend_from_slice(theirs.row(y));
    }
    Ok(encode_png(&Image::new([2 * theirs.size[0], theirs.size[1]], pixels)?, 0.0)?)
}
