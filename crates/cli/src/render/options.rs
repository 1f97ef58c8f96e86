//! The words of `dapple render`.

use clap::{Args, ValueEnum};
use dapple_core::Shard;
use dapple_job::registry;
use dapple_renderer::light::LightSelection;
use dapple_scene::image::Format;
use dapple_scene::{Effect, bundled};
use std::path::{Path, PathBuf};

/// The words of `dapple render`, by themselves.
#[derive(clap::Parser)]
#[command(no_binary_name = true)]
pub(crate) struct Words {
    #[command(flatten)]
    pub(crate) options: Options,
}

/// Render an image, putting samples where it needs them
///
/// SCENE is a pbrt-v4 file, a model by itself (.obj, .ply, .stl: shown under a camera and a light of our own), or
/// the name of a bundled scene: teapot (the default), terrain, cornell, furnace, plates, lens, motion, glass, room, grass. Nothing is rendered before all settings are checked and all outputs can be written.
#[derive(Args)]
#[command(after_help = AFTER)]
pub(crate) struct Options {
    /// A pbrt-v4 file, a model (.obj, .ply, .stl), or a bundled scene
    #[arg(value_name = "SCENE", default_value = bundled::DEFAULT)]
    pub(super) scene: PathBuf,

    /// An image, by extension: .exr (every layer, settings in the header), .pfm or .png; may be given again
    ///
    /// Without any, SCENE.exr and SCENE.png are written to the current folder, and the sample map
    /// SCENE-samples.png where the sampler is adaptive. Files that are there are replaced.
    #[arg(short, long = "output", value_name = "OUT", value_parser = output)]
    pub(super) outputs: Vec<PathBuf>,

    /// How many samples each pixel gets; `dapple samplers` lists them
    ///
    /// By default counts follow errors relative to mean^2 + 0.3: what the default filter leaves is less so than with the
    /// sampler's own 0.01, which is for `--filter none`.
    #[arg(long, value_name = "NAME[:key=value,…]", default_value = "cluster:epsilon=0.3", value_parser = sampler)]
    #[arg(help_heading = "Method")]
    pub(super) sampler: String,

    /// Where samples lie; `dapple points` lists them
    #[arg(long, value_name = "NAME[:…]", default_value = "sobol", value_parser = points)]
    #[arg(help_heading = "Method")]
    pub(super) points: String,

    /// What makes the image of the samples; `dapple filters` lists them. `none` leaves each pixel the mean of its samples
    #[arg(long, value_name = "NAME[:…]", default_value = "cluster-regression", value_parser = filter)]
    #[arg(help_heading = "Method")]
    pub(super) filter: String,

    /// The shape of a pixel: the scene's, or one pixel's box
    #[arg(long, value_name = "SHAPE", default_value = "scene", help_heading = "Method")]
    pub(super) pixel_filter: PixelShape,

    /// Decides on all random numbers: the same seed gives the same image, whatever the threads
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Method")]
    pub(super) seed: u64,

    /// Spend this many samples per pixel on average, exactly [default: 64, whatever the file suggests]
    #[arg(long, value_name = "MEAN", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(super) spp: Option<f64>,

    /// Go on until the predicted relMSE before filtering is this small, or --max-spp is spent; costs some accuracy
    #[arg(long, value_name = "RELMSE", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(super) error: Option<f64>,

    /// Plan and trace for about this many seconds (reading and writing come on top)
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(super) time: Option<f64>,

    /// No pixel gets fewer samples
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Bounds")]
    pub(super) min_spp: u32,

    /// No pixel gets more samples [default: no bound; with --error, 16384]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Bounds")]
    pub(super) max_spp: Option<u32>,

    /// Most scattering events between camera and light [default: the scene's]
    #[arg(long, value_name = "N", help_heading = "Image")]
    pub(super) max_depth: Option<u32>,

    /// How one of several lights, or one tile of an environment map, is selected: power, uniform or learned
    ///
    /// [default: learned; with --shard, power]. Learned probabilities differ by cell of space.
    #[arg(long, value_name = "HOW", help_heading = "Image")]
    pub(super) light_choice: Option<LightSelection>,

    /// Leave an effect out that the scene calls for; may be given again. `dapple effects` lists what it calls for
    ///
    /// The image is another, cheaper one: a warning says how it differs, and the file's header that it does.
    #[arg(long, value_name = "EFFECT", help_heading = "Image")]
    pub(super) without: Vec<Effect>,

    /// Width and height in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = resolution, help_heading = "Image")]
    pub(super) resolution: Option<[u32; 2]>,

    /// Render this window only; with --sampler uniform --filter none --light-choice power, the same bits as in the whole image [default: the scene's]
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop, help_heading = "Image")]
    pub(super) crop: Option<[u32; 4]>,

    /// Make PNG files brighter by this many powers of two
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = stops, help_heading = "Image")]
    #[arg(allow_negative_numbers = true)]
    pub(super) exposure: f32,

    /// A folder for maps as PNG: samples, albedo, normals, depth, and the predicted error with --error
    #[arg(long, value_name = "DIR", help_heading = "Image")]
    pub(super) maps: Option<PathBuf>,

    /// Keep a checkpoint in this file, now and then and at the end: --resume FILE goes on from it, whatever happened
    ///
    /// Written beside its place, flushed and renamed; the one before stays as FILE.previous. One process writes to it at a
    /// time (FILE.lock). A file that is there already is not written over: go on from it, or remove it.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(super) checkpoint: Option<PathBuf>,

    /// Seconds between checkpoints [default: 60, more where they would take above 1 % of the time; the first after 1]
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, help_heading = "Interruption")]
    #[arg(allow_negative_numbers = true)]
    pub(super) checkpoint_every: Option<f64>,

    /// Go on from this checkpoint, to the same bits as without interruption, and keep it up to date
    ///
    /// With the same words; a larger budget goes on further, and another filter is possible if its needs were recorded. Beside
    /// --checkpoint with the same FILE, starts where there is none yet: the same command can be given again and again.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(super) resume: Option<PathBuf>,

    /// Render the I-th of N shares (from 1), every N-th row, for `dapple merge`: -o names a .shard file
    ///
    /// With --spp and a sampler that plans a priori (uniform, cluster-thesis): each machine comes to the same plan.
    #[arg(long, value_name = "I/N", value_parser = shard, help_heading = "Interruption")]
    #[arg(conflicts_with_all = ["maps", "json", "time", "error"])]
    pub(super) shard: Option<Shard>,

    /// Refuse to start what takes more memory than this, such as 2G, 500M or plain bytes [default: what there is]
    ///
    /// The estimate (the scene as it was read, the film, and the most of sampler, filter and files) is printed with the summary.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(super) memory: Option<u64>,

    /// Threads to use; 0 is one per core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(super) threads: u16,

    /// List what the renderer cannot do as warnings, rather than refusing the scene
    #[arg(long)]
    pub(super) allow_unsupported: bool,

    /// Print one line of JSON rather than a summary; no progress
    #[arg(long)]
    pub(super) json: bool,

    /// No progress and no summary; warnings remain
    #[arg(short, long, conflicts_with = "json")]
    pub(super) quiet: bool,
}

const AFTER: &str = "\
Examples:
  dapple render
  dapple render scene.pbrt -o scene.exr -o scene.png --spp 128
  dapple render scene.pbrt -o scene.exr --time 30 --maps maps
  dapple render model.obj -o model.png
  dapple render terrain -o terrain.pfm --sampler variance:policy=cross --points random --seed 7
  dapple render cornell -o cornell.png --sampler uniform --spp 16 --resolution 128x128
  dapple render scene.pbrt -o scene.exr --spp 4096 --checkpoint c --resume c     again and again, until it is done
  dapple render scene.pbrt --sampler uniform --spp 256 --shard 3/8 -o 3.shard    one of eight machines (dapple merge)

Ctrl-C stops and saves what is done; a second one leaves at once.";

/// The shape of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum PixelShape {
    /// As the scene file says
    Scene,
    /// A box of one pixel
    Box,
}

impl Options {
    /// How one of several lights is selected: learned, unless machines that do not communicate render shards.
    pub(super) fn light_choice(&self) -> LightSelection {
        let default = if self.shard.is_some() { LightSelection::Power } else { LightSelection::Learned };
        self.light_choice.unwrap_or(default)
    }

    /// What no single word can say.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(max) = self.max_spp.filter(|&max| max < self.min_spp) {
            return Err(format!(
                "--min-spp {} is above --max-spp {max}: the smallest count must not exceed the largest",
                self.min_spp
            ));
        }
        let (min, most) = (self.min_spp, self.max_spp.unwrap_or(u32::MAX));
        if let Some(spp) = self.mean_spp() {
            if spp < f64::from(min) {
                return Err(format!(
                    "--spp {spp} is below --min-spp {min}: raise it, or lower --min-spp (0 is allowed)"
                ));
            }
            if spp > f64::from(most) {
                return Err(format!("--spp {spp} is above {most}, the most that a pixel may take: lower it"));
            }
        }
        if self.checkpoint_every.is_some() && self.checkpoint.is_none() && self.resume.is_none() {
            return Err("--checkpoint-every needs a --checkpoint FILE (or --resume FILE)".into());
        }
        let shards = self.outputs.iter().filter(|path| is_shard(path)).count();
        if self.shard.is_some() && (self.outputs.len() > 1 || shards < self.outputs.len()) {
            return Err("with --shard there is one --output, a .shard file: dapple merge makes images of all".into());
        }
        if self.shard.is_none() && shards > 0 {
            return Err("a .shard file is made by --shard I/N".into());
        }
        let mut seen: Vec<&PathBuf> = Vec::new();
        for output in &self.outputs {
            if seen.contains(&output) {
                return Err(format!("--output {} is given twice", output.display()));
            }
            seen.push(output);
        }
        Ok(())
    }

    /// The mean samples per pixel, where they are the budget.
    pub(super) fn mean_spp(&self) -> Option<f64> {
        let other = self.error.is_some() || self.time.is_some();
        if other { None } else { Some(self.spp.unwrap_or(super::DEFAULT_SPP)) }
    }
}

fn above_zero(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("a finite number above zero is wanted".into()),
    }
}

fn stops(word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("a finite number is wanted, 0 to leave the image as it is".into()),
    }
}

pub(crate) fn resolution(word: &str) -> Result<[u32; 2], String> {
    let sides = word.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let sides: [u32; 2] = sides.ok_or("WIDTHxHEIGHT in pixels is wanted, such as 640x360")?;
    dapple_core::Frame::new(sides[0], sides[1]).map_err(|e| e.to_string())?;
    Ok(sides)
}

fn crop(word: &str) -> Result<[u32; 4], String> {
    let sides: Option<Vec<u32>> = word.split(',').map(|side| side.trim().parse().ok()).collect();
    match sides.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok([x0, y0, x1, y1]),
        Some([_, _, _, _]) => Err("the window is empty: X0 < X1 and Y0 < Y1 are wanted".into()),
        _ => Err("X0,Y0,X1,Y1 in pixels are wanted, such as 0,0,64,32".into()),
    }
}

fn output(word: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(word);
    if !is_shard(&path) {
        Format::from_path(&path).map_err(|e| e.to_string())?;
    }
    Ok(path)
}

fn is_shard(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("shard"))
}

/// A number of bytes, or of 1024, 1024^2, … of them.
fn size(word: &str) -> Result<u64, String> {
    let number = word.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match word[number.len()..].to_ascii_uppercase().as_str() {
        "" | "B" => 1,
        "K" | "KB" | "KIB" => 1 << 10,
        "M" | "MB" | "MIB" => 1 << 20,
        "G" | "GB" | "GIB" => 1 << 30,
        "T" | "TB" | "TIB" => 1u64 << 40,
        _ => 0,
    };
    match number.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 && unit > 0 => Ok((x * unit as f64) as u64),
        _ => Err("a size above zero is wanted, such as 2G, 500M or 1000000 (1024 bytes are a K)".into()),
    }
}

fn shard(word: &str) -> Result<Shard, String> {
    let numbers =
        word.split_once('/').and_then(|(i, n)| Some((i.parse::<u32>().ok()?.checked_sub(1)?, n.parse().ok()?)));
    let shard = numbers.and_then(|(index, of)| Shard::new(index, of).ok());
    shard.ok_or_else(|| "I/N is wanted, the I-th of N shares, such as 1/4 to 4/4".into())
}

/// Makes it for trial: what is wrong with the words is known before anything is read.
fn sampler(words: &str) -> Result<String, String> {
    registry::check_sampler(words).map_err(|e| e.to_string())?;
    Ok(words.to_owned())
}

fn points(words: &str) -> Result<String, String> {
    registry::points(words, TRIAL).map_err(|e| e.to_string())?;
    Ok(words.to_owned())
}

fn filter(words: &str) -> Result<String, String> {
    registry::check_filter(words).map_err(|e| e.to_string())?;
    Ok(words.to_owned())
}

const TRIAL: registry::Setting = registry::Setting { seed: 0, spp: None };
