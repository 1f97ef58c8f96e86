//! The arguments of `dapple render`.

use crate::{Failure, Result, failure};
use clap::{Args, ValueEnum};
use dapple_core::Shard;
use dapple_job::registry;
use dapple_job::{BudgetSpec, CheckpointOptions, CropSpec, DEFAULT_SPP, PixelFilterSpec, RenderSpec};
use dapple_renderer::light::LightSelection;
use dapple_scene::image::Format;
use dapple_scene::{Effect, bundled};
use std::path::{Path, PathBuf};

/// Render an image, putting samples where it needs them
///
/// SCENE is a pbrt file (v4, v3 or v2), a bare model (.obj, .ply, .stl; Dapple adds a camera and a light), or
/// the name of a bundled scene: teapot (the default), terrain, cornell, furnace, plates, lens, motion, glass, room, grass. Nothing is rendered before all settings are checked and all outputs can be written.
#[derive(Args)]
#[command(after_help = AFTER)]
pub(crate) struct RenderArgs {
    /// A pbrt file, a model (.obj, .ply, .stl), or a bundled scene
    #[arg(value_name = "SCENE", default_value = bundled::DEFAULT)]
    pub(crate) scene: PathBuf,

    /// An image, by extension: .exr (every layer, settings in the header), .pfm or .png; may be given again
    ///
    /// Without any, SCENE.exr and SCENE.png are written to the current folder, and the sample map
    /// SCENE-samples.png where the sampler is adaptive. Files that are there are replaced.
    #[arg(short, long = "output", value_name = "OUT", value_parser = output)]
    pub(crate) outputs: Vec<PathBuf>,

    /// The sampler (how many samples each pixel gets); `dapple samplers` lists them
    ///
    /// The default's `epsilon=0.3` suits the default filter; `adaptive:epsilon=0.01` suits `--filter none`.
    #[arg(long, value_name = "NAME[:key=value,…]", default_value = dapple_job::DEFAULT_SAMPLER, value_parser = sampler)]
    #[arg(help_heading = "Method")]
    pub(crate) sampler: String,

    /// The point set (where samples lie; pbrt and Mitsuba call this the sampler); `dapple points` lists them
    #[arg(long, value_name = "NAME[:…]", default_value = dapple_job::DEFAULT_POINTS, value_parser = points)]
    #[arg(help_heading = "Method")]
    pub(crate) points: String,

    /// The filter (the denoiser); `dapple filters` lists them. `none` leaves each pixel the mean of its samples
    #[arg(long, value_name = "NAME[:…]", default_value = dapple_job::DEFAULT_FILTER, value_parser = filter)]
    #[arg(help_heading = "Method")]
    pub(crate) filter: String,

    /// The integrator (how light is transported); `dapple integrators` lists them
    #[arg(long, value_name = "NAME", default_value = dapple_job::DEFAULT_INTEGRATOR, help_heading = "Method")]
    pub(crate) integrator: String,

    /// The pixel filter (pbrt's PixelFilter): the scene's, or a box of one pixel
    #[arg(long, value_name = "SHAPE", default_value = "scene", help_heading = "Method")]
    pub(crate) pixel_filter: PixelShape,

    /// Seed of all random numbers; the same seed gives the same image on any number of threads
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Method")]
    pub(crate) seed: u64,

    /// Mean samples per pixel, exactly [default: 64, whatever the file suggests]
    #[arg(long, value_name = "MEAN", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) spp: Option<f64>,

    /// Render until the predicted relMSE before filtering is this small, or --max-spp is spent; costs some accuracy
    #[arg(long, value_name = "RELMSE", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) error: Option<f64>,

    /// Plan and trace for about this many seconds; reading, filtering and writing come on top
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) time: Option<f64>,

    /// Smallest number of samples per pixel
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Bounds")]
    pub(crate) min_spp: u32,

    /// Largest number of samples per pixel [default: no bound; with --error, 16384]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Bounds")]
    pub(crate) max_spp: Option<u32>,

    /// Most scattering events between camera and light [default: the scene's]
    #[arg(long, value_name = "N", help_heading = "Image")]
    pub(crate) max_depth: Option<u32>,

    /// Selection among several lights, and among parts of an environment map: power, uniform or learned
    /// [default: learned; with --shard, power]
    #[arg(long, alias = "light-choice", value_name = "HOW", value_parser = light_selection)]
    #[arg(help_heading = "Method")]
    pub(crate) light_selection: Option<LightSelection>,

    /// Leave an effect out that the scene calls for; may be given again. `dapple effects` lists what it calls for
    ///
    /// Makes a different, cheaper image. A warning reports the difference, and the file's header records the effect.
    #[arg(long, value_name = "EFFECT", help_heading = "Image")]
    pub(crate) without: Vec<Effect>,

    /// Width and height in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = resolution, help_heading = "Image")]
    pub(crate) resolution: Option<[u32; 2]>,

    /// Render this window of the whole image only [default: the scene's]
    ///
    /// Its bits are those of the whole render with --sampler uniform --filter none --light-selection power; else counts differ.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop, help_heading = "Image")]
    pub(crate) crop: Option<[u32; 4]>,

    /// Make PNG files brighter by this many powers of two
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = stops, help_heading = "Image")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) exposure: f32,

    /// A folder for maps as PNG: samples, albedo, normals, depth, and the predicted error with --error
    #[arg(long, value_name = "DIR", help_heading = "Image")]
    pub(crate) maps: Option<PathBuf>,

    /// Keep a checkpoint in this file, now and then and at the end, for --resume FILE
    ///
    /// Written to a temporary file and renamed, so that a crash never destroys it. The previous one is kept as
    /// FILE.previous; FILE.lock keeps other processes out. Refuses to overwrite an existing checkpoint unless resuming from
    /// it.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(crate) checkpoint: Option<PathBuf>,

    /// Seconds between checkpoints [default: 60, or longer so that they take at most 1 % of the time; the first after 1]
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, help_heading = "Interruption")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) checkpoint_every: Option<f64>,

    /// Resume from this checkpoint, to the same bits as without interruption, and keep it up to date
    ///
    /// Give the same arguments as before. The budget may be larger, and the filter may differ if the checkpoint holds the
    /// data that it reads. With --checkpoint FILE too, a render starts afresh while FILE is missing, so that the same
    /// command can be repeated.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(crate) resume: Option<PathBuf>,

    /// Render the I-th of N shards (from 1), every N-th row, for `dapple merge`; -o names a .shard file
    ///
    /// Needs --spp and a sampler that plans a priori (uniform, cluster-thesis), so that each machine has the same plan.
    #[arg(long, value_name = "I/N", value_parser = dapple_job::parse_shard, help_heading = "Interruption")]
    #[arg(conflicts_with_all = ["maps", "json", "time", "error"])]
    pub(crate) shard: Option<Shard>,

    /// Render the description in this file; it replaces SCENE and the options of Method, Budget, Bounds and Image
    #[arg(long, value_name = "FILE", help_heading = "Description")]
    pub(crate) spec: Option<PathBuf>,

    /// Print the description of the render as JSON, for --spec, and render nothing
    #[arg(long, help_heading = "Description")]
    pub(crate) print_spec: bool,

    /// Memory limit, such as 2G, 500M or plain bytes; a render that needs more is refused [default: the machine's]
    ///
    /// The summary prints the estimate: scene and film, and the largest of sampler, filter and file writing.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(crate) memory: Option<u64>,

    /// Threads to use; 0 is one per core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(crate) threads: u16,

    /// Warn about unsupported features and render without them, instead of refusing the scene
    #[arg(long)]
    pub(crate) allow_unsupported: bool,

    /// Print one line of JSON rather than a summary; no progress
    #[arg(long)]
    pub(crate) json: bool,

    /// No progress and no summary; warnings remain
    #[arg(short, long, conflicts_with = "json")]
    pub(crate) quiet: bool,
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

impl From<PixelShape> for PixelFilterSpec {
    fn from(shape: PixelShape) -> Self {
        match shape {
            PixelShape::Scene => Self::Scene,
            PixelShape::Box => Self::Box,
        }
    }
}

/// The shape of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelShape {
    /// The scene's pixel filter
    Scene,
    /// A box of one pixel
    Box,
}

impl RenderArgs {
    /// The description of the render, from `--spec` or from the other options.
    pub(crate) fn spec(&self) -> Result<RenderSpec> {
        let spec = match &self.spec {
            Some(path) => {
                let read = |e| Failure::new(format!("{}: cannot read the file: {e}", path.display()));
                let json = std::fs::read_to_string(path).map_err(read)?;
                RenderSpec::from_json(&json).map_err(|e| Failure::new(format!("{}: {e}", path.display())))?
            }
            None => self.described(),
        };
        spec.check().map_err(|e| failure::of_spec(&e))?;
        self.check(&spec).map_err(|wrong| Failure::usage("render", wrong))?;
        Ok(spec)
    }

    fn described(&self) -> RenderSpec {
        let budget = match (self.spp, self.error, self.time) {
            (_, Some(relmse), _) => BudgetSpec::Error(relmse),
            (_, _, Some(seconds)) => BudgetSpec::Seconds(seconds),
            (spp, None, None) => BudgetSpec::Spp(spp.unwrap_or(DEFAULT_SPP)),
        };
        let mut spec = RenderSpec::new(self.scene.to_string_lossy())
            .sampler(&self.sampler)
            .points(&self.points)
            .filter(&self.filter)
            .integrator(&self.integrator)
            .budget(budget)
            .bounds(self.min_spp, self.max_spp)
            .crop(self.crop.map_or(CropSpec::Scene, CropSpec::Window))
            .seed(self.seed)
            .max_depth(self.max_depth)
            .pixel_filter(self.pixel_filter.into())
            .without(self.without.iter().copied())
            .allow_unsupported(self.allow_unsupported)
            .shard(self.shard);
        spec.resolution = self.resolution;
        spec.light_selection = self.light_selection;
        spec
    }

    /// The checkpoint files to write and to resume from.
    pub(crate) fn checkpoints(&self) -> CheckpointOptions {
        let mut options = CheckpointOptions::default();
        options.keep.clone_from(&self.checkpoint);
        options.resume.clone_from(&self.resume);
        options.every = self.checkpoint_every;
        options
    }

    /// Checks the options that the description does not contain.
    fn check(&self, spec: &RenderSpec) -> std::result::Result<(), String> {
        if self.checkpoint_every.is_some() && self.checkpoint.is_none() && self.resume.is_none() {
            return Err("--checkpoint-every needs --checkpoint FILE or --resume FILE".into());
        }
        let shards = self.outputs.iter().filter(|path| is_shard(path)).count();
        if spec.shard.is_some() && (self.outputs.len() > 1 || shards < self.outputs.len()) {
            return Err("--shard takes one --output, a .shard file; dapple merge makes images of all shards".into());
        }
        if spec.shard.is_none() && shards > 0 {
            return Err("--output: a .shard file needs --shard I/N".into());
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
}

fn light_selection(name: &str) -> std::result::Result<LightSelection, String> {
    name.parse().map_err(|e: dapple_renderer::light::UnknownLightSelection| e.to_string())
}

fn above_zero(word: &str) -> std::result::Result<f64, String> {
    match word.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("a finite number above zero is required".into()),
    }
}

fn stops(word: &str) -> std::result::Result<f32, String> {
    match word.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("a finite number is required, 0 to leave the image as it is".into()),
    }
}

pub(crate) fn resolution(word: &str) -> std::result::Result<[u32; 2], String> {
    let sides = word.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let sides: [u32; 2] = sides.ok_or("WIDTHxHEIGHT in pixels is required, such as 640x360")?;
    dapple_core::Frame::new(sides[0], sides[1]).map_err(|e| e.to_string())?;
    Ok(sides)
}

fn crop(word: &str) -> std::result::Result<[u32; 4], String> {
    let sides: Option<Vec<u32>> = word.split(',').map(|side| side.trim().parse().ok()).collect();
    match sides.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok([x0, y0, x1, y1]),
        Some([_, _, _, _]) => Err("the window is empty: X0 < X1 and Y0 < Y1 are required".into()),
        _ => Err("X0,Y0,X1,Y1 in pixels are required, such as 0,0,64,32".into()),
    }
}

pub(crate) fn output(word: &str) -> std::result::Result<PathBuf, String> {
    let path = PathBuf::from(word);
    if !is_shard(&path) {
        Format::from_path(&path).map_err(|e| e.to_string())?;
    }
    Ok(path)
}

fn is_shard(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("shard"))
}

/// Parses a memory size: bytes, or a number with a unit such as K, M or G (powers of 1024).
fn size(word: &str) -> std::result::Result<u64, String> {
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
        _ => Err("a size above zero is required, such as 2G, 500M or 1000000 (1024 bytes are a K)".into()),
    }
}

/// Checks the name of a sampler by making one, so that a wrong name is reported before the scene is read.
fn sampler(name: &str) -> std::result::Result<String, String> {
    registry::check_sampler(name).map_err(|e| e.to_string())?;
    Ok(name.to_owned())
}

fn points(name: &str) -> std::result::Result<String, String> {
    registry::check_points(name).map_err(|e| e.to_string())?;
    Ok(name.to_owned())
}

fn filter(name: &str) -> std::result::Result<String, String> {
    registry::check_filter(name).map_err(|e| e.to_string())?;
    Ok(name.to_owned())
}
