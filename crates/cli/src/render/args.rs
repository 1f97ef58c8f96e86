//! The arguments of `dapple render`.

use super::live::Address;
use super::values::{
    EachLayer, ImageSize, above_zero, crop, error_of, filter, has_extension, integrator, layer, light_selection,
    output, pixel_filter, points, preview, sampler, seconds, size, size_of_image, stops,
};
use crate::{Failure, Result, failure};
use clap::Args;
use dapple_job::{
    BudgetSpec, CheckpointOptions, CropSpec, ErrorOf, PartNumber, PixelFilterSpec, RenderSpec, read_text,
};
use dapple_renderer::light::LightSelection;
use dapple_scene::image::Format;
use dapple_scene::{Effect, bundled};
use std::path::{Path, PathBuf};

/// Render an image with adaptive sampling: most samples go where the image needs them
///
/// SCENE is a pbrt file (v4, v3 or v2), a model (.gltf, .glb, .obj, .ply, .stl; Dapple adds a camera and a light), or the name of a
/// bundled scene: teapot (the default), terrain, cornell, furnace, plates, lens, motion, glass, room, grass, door, tea,
/// cabin, many-lights, caustic, chess, zone-plate, penumbra. Settings and output paths are
/// checked before rendering begins.
#[derive(Args)]
#[command(after_help = include_str!("../help/render.txt").trim_end())]
pub(crate) struct RenderArgs {
    /// A pbrt file, a model (.gltf, .glb, .obj, .ply, .stl), or a bundled scene
    #[arg(value_name = "SCENE", default_value = bundled::DEFAULT)]
    pub(crate) scene: PathBuf,

    /// Image file to write: .exr (all layers; settings in the header), .pfm or .png; may be repeated
    ///
    /// If the name ends in .plan, nothing is rendered; only the plan of the first stage of a multi-machine render is written
    /// (see `dapple plan --help`).
    ///
    /// Without this option, NAME.exr and NAME.png are written to the current folder, and the sample map
    /// NAME-samples.png unless the sampler is uniform. NAME is the file name in the scene's Film, otherwise the name of the
    /// scene file. Existing files are replaced.
    #[arg(short, long = "output", visible_alias = "outfile", value_name = "OUT", value_parser = output())]
    pub(crate) outputs: Vec<PathBuf>,

    /// Sampler (how many samples each pixel gets); `dapple samplers` lists all
    ///
    /// The default minimises squared error / (radiance² + epsilon); a smaller epsilon sends more samples to dark pixels. The
    /// default epsilon suits the default filter; with `--filter none`, use `adaptive:epsilon=0.01`.
    #[arg(long, value_name = "NAME[:key=value,…]", default_value = dapple_job::DEFAULT_SAMPLER, value_parser = sampler)]
    #[arg(help_heading = "Method")]
    pub(crate) sampler: String,

    /// Point set (where samples lie; pbrt and Mitsuba call this the sampler); `dapple points` lists all
    #[arg(long, value_name = "NAME[:…]", default_value = dapple_job::DEFAULT_POINTS, value_parser = points)]
    #[arg(help_heading = "Method")]
    pub(crate) points: String,

    /// Filter (the denoiser); `dapple filters` lists all
    ///
    /// `none` makes each pixel the mean of its own samples. `best` is the mean of the default filter and Open Image
    /// Denoise; without that library, it is the default filter.
    #[arg(long, visible_alias = "denoiser", value_name = "NAME[:…]", value_parser = filter)]
    #[arg(default_value = dapple_job::DEFAULT_FILTER, help_heading = "Method")]
    pub(crate) filter: String,

    /// Integrator (how the radiance of a sample is computed); `dapple integrators` lists all
    ///
    /// `auto` is `photons` if the scene has caustics that path tracing finds only by chance, otherwise `path`.
    #[arg(long, value_name = "NAME", default_value = dapple_job::DEFAULT_INTEGRATOR, value_parser = integrator)]
    #[arg(help_heading = "Method")]
    pub(crate) integrator: String,

    /// Pixel filter (pbrt's PixelFilter)
    #[arg(long, value_name = "SHAPE", default_value = "scene", help_heading = "Method", value_parser = pixel_filter())]
    pub(crate) pixel_filter: PixelFilterSpec,

    /// Seed of all random numbers; except with --time, the same seed gives the same image on any number of threads
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Method")]
    pub(crate) seed: u64,

    /// Take exactly this mean number of samples per pixel [default: read from the scene file, otherwise 16]
    #[arg(short = 's', long, value_name = "MEAN", value_parser = above_zero, group = "budget")]
    #[arg(help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) spp: Option<f64>,

    /// Render until the predicted relMSE of the image is at most this value, or every pixel has --max-spp samples
    ///
    /// For the same number of samples, --spp gives a slightly lower error.
    #[arg(long, value_name = "RELMSE", value_parser = above_zero, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) error: Option<f64>,

    /// Image to which --error applies: the filtered (denoised) or the unfiltered one
    ///
    /// Filters without an error estimate (oidn, oidn-blend) always use the unfiltered image.
    #[arg(long, value_name = "IMAGE", default_value = "filtered", requires = "error", help_heading = "Bounds")]
    #[arg(value_parser = error_of())]
    pub(crate) error_of: ErrorOf,

    /// Render for about this many seconds, filter included; reading the scene and writing files take extra time
    ///
    /// At least one sample per pixel is always taken. If that alone exceeds the time, a warning with the estimated time
    /// appears after the first rows.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, group = "budget", help_heading = "Budget (one of)")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) time: Option<f64>,

    /// Minimum number of samples per pixel
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Bounds")]
    pub(crate) min_spp: u32,

    /// Maximum number of samples per pixel [default: no bound; with --error, 16384]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Bounds")]
    pub(crate) max_spp: Option<u32>,

    /// Maximum number of scattering events between camera and light [default: the scene's limit]
    #[arg(long, value_name = "N", help_heading = "Image")]
    pub(crate) max_depth: Option<u32>,

    /// How lights (and parts of environment maps) are selected: power (in proportion to power), uniform, or learned (from samples) [default: learned; with --part, power]
    #[arg(long, alias = "light-choice", value_name = "HOW", value_parser = light_selection)]
    #[arg(help_heading = "Method")]
    pub(crate) light_selection: Option<LightSelection>,

    /// Leave out effects that the scene uses, separated by commas; `dapple effects` lists a scene's effects
    ///
    /// The image then differs and costs less. The omitted effects are listed in a warning and in EXR headers.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',', help_heading = "Image")]
    pub(crate) without: Vec<Effect>,

    /// Width and height of the full image in pixels, or a percentage of the scene's [default: the scene's]
    #[arg(long, value_name = "WxH or N%", value_parser = size_of_image, help_heading = "Image")]
    pub(crate) resolution: Option<ImageSize>,

    /// Render only this window of the image, in pixels; X1 and Y1 are excluded [default: the scene's crop window]
    ///
    /// Sample counts, learned light selection and denoising use only samples inside the crop.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop, help_heading = "Image")]
    pub(crate) crop: Option<[u32; 4]>,

    /// Exposure of PNG images in stops; each stop doubles the brightness
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = stops, help_heading = "Image")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) exposure: f32,

    /// Folder for maps as PNG files: samples, albedo, normals, depth, clusters and predicted error, if the render has
    /// them
    #[arg(long, value_name = "DIR", help_heading = "Image")]
    pub(crate) maps: Option<PathBuf>,

    /// Write albedo, normal, depth and coverage of the first non-specular surface to the EXR files, whichever filter is used
    ///
    /// Other denoisers read these layers. The default filter writes them anyway. The image itself does not change.
    #[arg(long, help_heading = "Image")]
    pub(crate) features: bool,

    /// Rewrite this PNG file with the image so far, every few seconds; the last one is the final image
    ///
    /// Samples are shown unfiltered until the end. The file is always complete: each image is written under a temporary
    /// name, then renamed.
    #[arg(long, value_name = "FILE.png", value_parser = preview(), help_heading = "While it renders")]
    pub(crate) preview: Option<PathBuf>,

    /// Show the image so far in a viewer, with layers of samples per pixel (count) and predicted squared error (error)
    ///
    /// tev (https://github.com/Tom94/tev) must be running. Dapple connects to 127.0.0.1:14158 by default.
    #[arg(long, value_name = "tev[:HOST[:PORT]]", help_heading = "While it renders")]
    pub(crate) view: Option<Address>,

    /// Seconds between updates of --preview and --view [default: 2]
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, help_heading = "While it renders")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) preview_every: Option<f64>,

    /// Seconds between lines of progress [default: a bar on a terminal, elsewhere a line every 10 s]
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, help_heading = "While it renders")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) progress_every: Option<f64>,

    /// Layers of EXR files besides the image, separated by commas, or none [default: all that the render has]
    ///
    /// Available layers: unfiltered, variance, count, error, cluster, albedo, normal, depth (path length to the first hit),
    /// coverage, A (coverage, as alpha), Z (distance along the camera's axis). Listing albedo, normal, depth, coverage, A or
    /// Z also turns on recording, as --features does.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = layer, help_heading = "Image")]
    #[arg(conflicts_with = "features")]
    pub(crate) layers: Option<Vec<EachLayer>>,

    /// Store image, unfiltered, albedo, normal and coverage in EXR files as 16-bit floats: half the size, 3 digits
    ///
    /// Variance, error and depth stay 32-bit floats, whose range they need.
    #[arg(long, help_heading = "Image")]
    pub(crate) half: bool,

    /// Write checkpoints to this file, at intervals and at the end, for --resume FILE
    ///
    /// A crash never destroys the file: each checkpoint is written under a temporary name, then renamed. FILE.previous is the
    /// checkpoint before it; FILE.lock excludes other processes. An existing checkpoint is overwritten only if the
    /// render resumes from it.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(crate) checkpoint: Option<PathBuf>,

    /// Seconds between checkpoints [default: 60, or more if checkpoints would take over 1 % of the time; the first after 1 s]
    #[arg(long, value_name = "SECONDS", value_parser = above_zero, help_heading = "Interruption")]
    #[arg(allow_negative_numbers = true)]
    pub(crate) checkpoint_every: Option<f64>,

    /// Resume from this checkpoint, and keep writing to it; the image has the same bits as without interruption
    ///
    /// Repeat the arguments of the interrupted render. The budget may be larger, and the filter may differ if the
    /// checkpoint holds the data that it needs.
    ///
    /// If FILE does not exist, Dapple stops with an error, unless --checkpoint names the same FILE; then the render starts
    /// from the beginning. So the same command can be repeated until the render is done.
    #[arg(long, value_name = "FILE", help_heading = "Interruption")]
    pub(crate) resume: Option<PathBuf>,

    /// Render part I of N (I = 1 to N): every N-th band of rows. Write it with `-o FILE.part`; `dapple merge` joins the parts
    ///
    /// Without --from, it needs --spp and a sampler whose counts do not depend on the samples (uniform, cluster-thesis).
    /// Finished bands are saved with --checkpoint.
    #[arg(long, alias = "shard", value_name = "I/N", help_heading = "Interruption")]
    #[arg(conflicts_with_all = ["maps", "features", "json", "time", "error", "preview", "view"])]
    pub(crate) part: Option<PartNumber>,

    /// Render one part of the stage planned in this file. Requires `--part I/N`; write the part with `-o FILE.part`, for
    /// `dapple plan`
    ///
    /// Scene and settings come from the plan; do not repeat them. Any sampler and learned light selection work.
    #[arg(long, value_name = "PLAN", requires = "part", help_heading = "Interruption")]
    #[arg(conflicts_with_all = ["maps", "features", "json", "time", "error", "preview", "view"])]
    pub(crate) from: Option<PathBuf>,

    /// Read the render settings from this JSON file, in place of SCENE and the options of Method, Budget, Bounds and Image
    ///
    /// --exposure, --maps, --features, --layers and --half still apply.
    #[arg(long, value_name = "FILE", help_heading = "Description")]
    pub(crate) spec: Option<PathBuf>,

    /// Print the render settings as JSON, for --spec, without rendering
    #[arg(long, help_heading = "Description")]
    pub(crate) print_spec: bool,

    /// Memory limit, such as 2G, 500M or a number of bytes; larger renders are refused [default: the machine's memory]
    ///
    /// The summary prints the estimate: scene + film + sampler + the largest of three phases: planning sample counts,
    /// filtering, and writing.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(crate) memory: Option<u64>,

    /// Number of threads; 0 is one per core
    #[arg(short = 't', long, visible_alias = "nthreads", value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(crate) threads: u16,

    /// Ignore unsupported scene features with a warning instead of stopping
    #[arg(long)]
    pub(crate) allow_unsupported: bool,

    /// Print one line of JSON instead of the summary; show no progress
    #[arg(long)]
    pub(crate) json: bool,

    /// Show no progress and no summary; warnings and the --json line are still printed
    #[arg(short, long)]
    pub(crate) quiet: bool,
}

/// Reads the description of a render from a JSON file.
pub(crate) fn described_in(path: &Path) -> Result<RenderSpec> {
    let read = |e| Failure::new(format!("{}: cannot read the file: {e}", path.display()));
    let json = read_text(path, LONGEST_SPEC).map_err(read)?;
    RenderSpec::from_json(&json).map_err(|e| Failure::new(format!("{}: {e}", path.display())))
}

/// The largest size in bytes of a file for `--spec`.
const LONGEST_SPEC: u64 = 1 << 20;

impl RenderArgs {
    /// Makes the description of the render, from `--spec` or from the other options.
    pub(crate) fn spec(&self) -> Result<RenderSpec> {
        let mut spec = self.spec.as_deref().map_or_else(|| Ok(self.described()), described_in)?;
        if self.part.is_some() && self.from.is_none() {
            spec.part = self.part;
        }
        spec.check().map_err(|e| failure::of_spec(&e))?;
        if self.part.is_none() {
            self.check().map_err(|wrong| Failure::usage("render", wrong))?;
        }
        Ok(spec)
    }

    fn described(&self) -> RenderSpec {
        let budget = match (self.spp, self.error, self.time) {
            (_, Some(relmse), _) => BudgetSpec::Error(relmse),
            (_, _, Some(seconds)) => BudgetSpec::Seconds(seconds),
            (spp, None, None) => spp.map_or(BudgetSpec::Scene, BudgetSpec::Spp),
        };
        let (resolution, scale) = match self.resolution {
            Some(ImageSize::Pixels(resolution)) => (Some(resolution), None),
            Some(ImageSize::Scale(scale)) => (None, Some(scale)),
            None => (None, None),
        };
        RenderSpec {
            sampler: self.sampler.clone(),
            points: self.points.clone(),
            filter: self.filter.clone(),
            integrator: self.integrator.clone(),
            light_selection: self.light_selection,
            budget,
            error_of: self.error_of,
            min_spp: self.min_spp,
            max_spp: self.max_spp,
            resolution,
            scale,
            crop: self.crop.map_or(CropSpec::Scene, CropSpec::Window),
            seed: self.seed,
            max_depth: self.max_depth,
            pixel_filter: self.pixel_filter,
            without: self.without.clone(),
            allow_unsupported: self.allow_unsupported,
            part: self.part,
            ..RenderSpec::new(&self.scene)
        }
    }

    /// Returns `true` if a live image is shown anywhere.
    pub(crate) fn is_live(&self) -> bool {
        self.preview.is_some() || self.view.is_some()
    }

    /// The options for the checkpoint files to write and to resume from.
    pub(crate) fn checkpoints(&self) -> CheckpointOptions {
        CheckpointOptions { keep: self.checkpoint.clone(), resume: self.resume.clone(), every: self.checkpoint_every }
    }

    /// Checks the outputs of a part.
    pub(crate) fn check_part(&self) -> std::result::Result<(), String> {
        let is_part = |path: &PathBuf| has_extension(path, "part") || has_extension(path, "shard");
        if self.outputs.len() > 1 || !self.outputs.iter().all(is_part) {
            return Err(
                "--part needs a single --output, a .part file; dapple merge makes the image from all parts".into()
            );
        }
        Ok(())
    }

    /// Checks the options that are not part of the description: checkpoints and outputs.
    fn check(&self) -> std::result::Result<(), String> {
        if self.checkpoint_every.is_some() && self.checkpoint.is_none() && self.resume.is_none() {
            return Err("--checkpoint-every needs --checkpoint FILE or --resume FILE".into());
        }
        if self.preview_every.is_some() && !self.is_live() {
            return Err("--preview-every needs --preview FILE.png or --view tev".into());
        }
        let are = |extension| self.outputs.iter().filter(|path| has_extension(path, extension)).count();
        if are("part") > 0 {
            return Err("--output: a .part file needs --part I/N".into());
        }
        if are("plan") > 0 && self.outputs.len() > 1 {
            return Err("--output: a .plan file must be the only output; remove the other outputs".into());
        }
        let has_layers = |path: &PathBuf| matches!(Format::from_path(path), Ok(Format::Exr));
        let concerns = [("--features", self.features), ("--layers", self.layers.is_some()), ("--half", self.half)];
        if let Some((option, _)) = concerns.iter().find(|(_, given)| *given)
            && !self.outputs.is_empty()
            && !self.outputs.iter().any(has_layers)
        {
            return Err(format!("{option} concerns only layers of EXR files; add --output FILE.exr"));
        }
        let twice = (1..self.outputs.len()).find(|&i| self.outputs[..i].contains(&self.outputs[i]));
        twice.map_or(Ok(()), |i| Err(format!("--output {} is given twice; remove one", self.outputs[i].display())))
    }
}
