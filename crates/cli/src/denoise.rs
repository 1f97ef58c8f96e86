//! The subcommand `dapple denoise IN [IN2] -o OUT`.

use crate::machine::start_threads;
use crate::output::{tell, warn};
use crate::{Failure, Outcome, Result};
use dapple_core::options::OptionValue as _;
use dapple_job::denoise::{
    DenoiseError, DenoiseSpec, DenoisedImage, DenoisedView, FireflyLight, LayerKind, denoise_files,
};
use dapple_job::registry::{RegistryError, check_filter};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Denoise an image of any renderer: an OpenEXR file with its variance, or two renders with different seeds
///
/// Layers are found by the names that pbrt-v4, Cycles, Mitsuba, Arnold, RenderMan and Dapple give them: image, variance,
/// sample counts, and as guides the normal, albedo, position or depth of the first hit, from the same view layer as the
/// image. With two files no variance layer is needed.
#[derive(clap::Args)]
#[command(after_help = include_str!("help/denoise.txt").trim_end())]
pub(crate) struct DenoiseArgs {
    /// One OpenEXR file (all views are denoised), or two renders of the same image with different seeds
    #[arg(value_name = "IN", num_args = 1..=2, required = true)]
    inputs: Vec<PathBuf>,

    /// Image file to write: .exr, .pfm or .png; may be repeated. Inputs are never replaced
    ///
    /// .exr: a copy of the first input with the denoised image and an added layer for the estimated error. .pfm and .png:
    /// the image alone, in Rec. 709.
    #[arg(short, long = "output", visible_alias = "outfile", value_name = "OUT", required = true)]
    outputs: Vec<PathBuf>,

    /// Name of a layer in the files: KIND=NAME, such as normal=shading.n; may be repeated
    ///
    /// Kinds: color, variance (of one sample), variance-of-mean (of the pixel value), second-moment (mean of squared
    /// samples), count (samples per pixel), normal, albedo, position, depth, coverage, emission (of lights seen directly),
    /// id (of objects or materials).
    #[arg(long = "layer", value_name = "KIND=NAME", value_parser = layer)]
    layers: Vec<(LayerKind, String)>,

    /// Samples per pixel of each file [default: read from the file's layers or header]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,

    /// The variance layer holds the variance of the pixel value (already divided by the sample count), not that of one sample
    #[arg(long)]
    variance_of_mean: bool,

    /// Filter (the denoiser) [default: cluster-regression]; `dapple filters` lists all
    #[arg(long, visible_alias = "denoiser", value_name = "NAME[:…]", value_parser = filter)]
    filter: Option<String>,

    /// Treatment of fireflies by the default filter: keep, drop, or spread (over neighbouring pixels)
    ///
    /// A firefly is a pixel at least 880 times as bright as its surroundings, in only one of the two halves of the samples.
    /// For one input file, two halves are simulated from its variance.
    #[arg(long, value_name = "PLACE", value_parser = fireflies, default_value = FireflyLight::default().name(), conflicts_with = "filter")]
    fireflies: FireflyLight,

    /// Exposure of PNG images in stops; each stop doubles the brightness
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,

    /// Number of threads; 0 is one per core
    #[arg(short = 't', long, visible_alias = "nthreads", value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,

    /// Print one line of JSON instead of text
    #[arg(long)]
    json: bool,
}

fn layer(argument: &str) -> std::result::Result<(LayerKind, String), String> {
    let wrong = || format!("\"{argument}\" is not of the form KIND=NAME; use, for example, normal=nn");
    let (kind, name) = argument.split_once('=').ok_or_else(wrong)?;
    let kind: LayerKind = kind.parse()?;
    match name {
        // An empty name is allowed for colour: it means R, G and B without a layer.
        "" if kind != LayerKind::Color => Err(wrong()),
        _ => Ok((kind, name.to_owned())),
    }
}

fn fireflies(name: &str) -> std::result::Result<FireflyLight, String> {
    FireflyLight::from_text(name).ok_or_else(|| format!("\"{name}\" is unknown; use keep, drop or spread"))
}

fn filter(description: &str) -> std::result::Result<String, RegistryError> {
    check_filter(description).map(|()| description.to_owned())
}

pub(crate) fn run(args: &DenoiseArgs) -> Result<Outcome> {
    if !args.exposure.is_finite() {
        Failure::usage("denoise", "--exposure: a finite number is required");
    }
    let spec = DenoiseSpec {
        inputs: args.inputs.clone(),
        layers: args.layers.clone(),
        spp: args.spp,
        variance_of_mean: args.variance_of_mean,
        filter: args.filter.clone(),
        fireflies: args.fireflies,
    };
    start_threads(args.threads)?;
    spec.check_outputs(&args.outputs).map_err(failure)?;
    let image = denoise_files(&spec).map_err(failure)?;
    image.notices.iter().for_each(warn);
    let written = args.outputs.iter().map(|path| image.write(&spec, path, args.exposure));
    let written = written.collect::<std::result::Result<Vec<_>, _>>().map_err(failure)?;
    written.iter().flat_map(|written| &written.notices).for_each(warn);
    if args.json {
        tell(line(&image, &args.outputs))?;
    } else {
        for view in &image.views {
            let found = view.found.iter().map(|(kind, name)| format!("{} ({name})", kind.name()));
            tell(format!("read {}", found.collect::<Vec<_>>().join(", ")))?;
        }
        written.iter().try_for_each(|written| tell(&written.about))?;
    }
    Ok(Outcome::Done)
}

fn failure(error: DenoiseError) -> Failure {
    Failure::lines(&error)
}

/// The printed line of JSON; its keys have the order of the fields.
#[derive(Serialize)]
struct Line<'a> {
    outputs: &'a [PathBuf],
    size: [u32; 2],
    filter: &'a str,
    layers: BTreeMap<&'static str, &'a str>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    other_views: BTreeMap<&'a str, BTreeMap<&'static str, &'a str>>,
    notices: &'a [String],
    read_seconds: f64,
    filter_seconds: f64,
}

fn layers(view: &DenoisedView) -> BTreeMap<&'static str, &str> {
    view.found.iter().map(|(kind, name)| (kind.name(), name.as_str())).collect()
}

fn line(image: &DenoisedImage, outputs: &[PathBuf]) -> String {
    let (first, others) = (&image.views[0], &image.views[1..]);
    let line = Line {
        outputs,
        size: first.filtered.size,
        filter: &image.filter,
        layers: layers(first),
        other_views: others.iter().map(|view| (view.view.as_str(), layers(view))).collect(),
        notices: &image.notices,
        read_seconds: image.seconds[0],
        filter_seconds: image.seconds[1],
    };
    // Serialising plain values cannot fail.
    serde_json::to_string(&line).unwrap_or_default()
}
