//! The subcommand `dapple compare A REF`.

use crate::output::{tell, warn};
use crate::{Failure, Outcome, Result};
use dapple_metrics::{Comparison, PIXELS_PER_DEGREE, Pixels, WorstBlock, compare, flip};
use dapple_scene::files::{Disk, Files};
use dapple_scene::image::{Encoding, Image, read_image};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Compare an image with its reference
///
/// Reads EXR (its main layer), PFM, Radiance HDR, PNG, JPEG and TGA; integer values are decoded as sRGB. Errors
/// are of linear values, unless they are labelled "display" or "sRGB". FLIP estimates the difference that
/// a viewer sees on a display 0.7 m wide with 3840 pixels across, from 0.7 m.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  dapple compare scene.exr reference.exr\n  dapple compare --json a.pfm b.exr")]
pub(crate) struct CompareArgs {
    /// Image to measure
    #[arg(value_name = "A")]
    image: PathBuf,
    /// Reference image, of the same size
    #[arg(value_name = "REF")]
    reference: PathBuf,
    /// Print one line of JSON instead of a table
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &CompareArgs) -> Result<Outcome> {
    let image = read(&options.image)?;
    let reference = read(&options.reference)?;
    let [x, r] = [pixels(&image)?, pixels(&reference)?];
    let found = compare(x, r).map_err(Failure::new)?;
    let seen = flip(x, r, PIXELS_PER_DEGREE).map_err(Failure::new)?.mean;
    if found.non_finite > 0 {
        let name = options.image.display();
        warn(format!("{name}: {} channels are NaN or infinite; they count as 0 in every figure", found.non_finite));
    }
    tell(if options.json { line(&found, seen) } else { table(&found, seen) })?;
    Ok(Outcome::Done)
}

fn pixels(image: &Image) -> Result<Pixels<'_>> {
    Pixels::new(image.size, &image.pixels).map_err(Failure::new)
}

fn read(path: &Path) -> Result<Image> {
    let name = path.display().to_string();
    let bytes = Disk
        .read(path)
        .map_err(|e| Failure::new(format!("{name}: cannot read it: {e}; check the name of the image")))?;
    read_image(&bytes, &name, Encoding::Auto).map_err(Failure::new)
}

/// The JSON line that is printed; its keys have the order of the fields.
#[derive(Serialize)]
struct Line {
    mse: f64,
    relmse: f64,
    relmse_trimmed: f64,
    smape: f64,
    psnr: f64,
    srgb8_mse: f64,
    flip: f64,
    mean_ratio: f64,
    channel_ratios: [f64; 3],
    non_finite: u64,
    worst_block: Block,
}

#[derive(Serialize)]
struct Block {
    position: [u32; 2],
    size: [u32; 2],
    relmse: f64,
}

fn line(c: &Comparison, flip: f64) -> String {
    let WorstBlock { position, size, rel_mse, .. } = c.worst_block;
    let line = Line {
        mse: c.mse,
        relmse: c.rel_mse,
        relmse_trimmed: c.rel_mse_trimmed,
        smape: c.smape,
        psnr: c.psnr,
        srgb8_mse: c.srgb8_mse,
        flip,
        mean_ratio: c.mean_ratio,
        channel_ratios: c.channel_ratios,
        non_finite: c.non_finite,
        worst_block: Block { position, size, relmse: rel_mse },
    };
    // Serialising plain numbers cannot fail.
    serde_json::to_string(&line).unwrap_or_default()
}

fn table(c: &Comparison, flip: f64) -> String {
    let worst = &c.worst_block;
    let [r, g, b] = c.channel_ratios;
    let rows = [
        ("MSE", figure(c.mse), String::new()),
        ("relMSE", figure(c.rel_mse), "squared error over squared reference + 0.01".into()),
        ("  trimmed", figure(c.rel_mse_trimmed), "without the worst 0.1 % of the pixels".into()),
        ("  worst block", figure(worst.rel_mse), {
            let ([x, y], [w, h]) = (worst.position, worst.size);
            format!("{w}x{h} pixels at column {x}, row {y}")
        }),
        ("SMAPE", figure(c.smape), "0 to 2".into()),
        ("PSNR", format!("{:.2}", c.psnr), "dB, as displayed; 200 is equal".into()),
        ("sRGB MSE", figure(c.srgb8_mse), "as displayed, on a scale of 0 to 255".into()),
        ("FLIP", figure(flip), "0 to 1, as seen at 67 pixels per degree".into()),
        ("ratio of means", format!("{:.6}", c.mean_ratio), format!("red {r:.6}, green {g:.6}, blue {b:.6}")),
    ];
    let row = |(name, value, about): &(&str, String, String)| format!("{name:<16}{value:<12}{about}");
    rows.iter().map(row).map(|r| r.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

/// Formats a number with five significant digits.
fn figure(x: f64) -> String {
    if x == 0.0 || (1e-4..1e5).contains(&x) { format!("{x:.*}", decimals(x)) } else { format!("{x:.4e}") }
}

fn decimals(x: f64) -> usize {
    if x == 0.0 { 0 } else { (4 - x.log10().floor() as i32).max(0) as usize }
}
