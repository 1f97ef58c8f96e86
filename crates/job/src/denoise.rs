//! Denoising of image files from any renderer: OpenEXR layers in, an image and its error out.
//!
//! [`DenoiseSpec`] names the files and settings; [`denoise_files`] reads and denoises them. Layers are recognised by the names
//! that common renderers use ([`KNOWN_LAYERS`]), or by names that the caller passes. All views of an image are denoised.

mod assemble;
mod input;
mod output;

pub use dapple_scene::image::{KNOWN_LAYERS, LayerKind};
pub use output::WrittenImage;

use crate::output::FileIdentity;
use crate::registry::{self, MethodInputs, RegistryError};
use assemble::Assembled;
use dapple_core::{Filter as _, Filtered};
pub use dapple_denoise::FireflyLight;
use dapple_scene::image::{Chromaticities, ExrFile, Format, ImageError, Window, check_writable};
use input::{Images, Input};
use output::Target;
use std::path::PathBuf;
use std::time::Instant;

/// The files and settings of a denoising run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DenoiseSpec {
    /// One OpenEXR file with its variance, or two files of the same image rendered with different seeds.
    pub inputs: Vec<PathBuf>,
    /// Layer names set by the caller: the kind of each layer, and its name in the files.
    pub layers: Vec<(LayerKind, String)>,
    /// The number of samples per pixel in each file; `None` reads it from the files.
    pub spp: Option<u32>,
    /// `true` if the files hold the variance of each pixel's mean, `false` for the variance of one sample.
    pub variance_of_mean: bool,
    /// The filter, `NAME` or `NAME:key=value,…`; `None` for the default.
    pub filter: Option<String>,
    /// The default filter's treatment of the energy of fireflies.
    pub fireflies: FireflyLight,
}

/// A denoised image in all its views, with notices and timings.
#[derive(Clone, Debug)]
pub struct DenoisedImage {
    /// The views, the default view first; a single nameless view if the files have none.
    pub views: Vec<DenoisedView>,
    /// The filter with all its parameters.
    pub filter: String,
    /// Notices about missing layers, cropping and assumptions; one sentence each.
    pub notices: Vec<String>,
    /// Seconds spent on reading, and on filtering.
    pub seconds: [f64; 2],
    /// The first input file; EXR outputs are copies of it with the image replaced.
    original: ExrFile<'static>,
}

/// One view of a denoised image.
#[derive(Clone, Debug)]
pub struct DenoisedView {
    /// The name of the view; empty in files without views.
    pub view: String,
    /// The image and its estimated error.
    pub filtered: Filtered,
    /// The kinds of layers that were read, each with its name in the files.
    pub found: Vec<(LayerKind, String)>,
    target: Target,
}

/// Reads the files of `spec` and denoises their image.
///
/// # Errors
///
/// [`DenoiseError`] for files that cannot be read, layers that are missing or inconsistent, and errors of the filter.
pub fn denoise_files(spec: &DenoiseSpec) -> Result<DenoisedImage, DenoiseError> {
    let filter = spec.filter.as_deref().map(filter).transpose()?;
    let start = Instant::now();
    if spec.inputs.is_empty() || spec.inputs.len() > 2 {
        return Err(DenoiseError::Files { count: spec.inputs.len() });
    }
    let mut inputs = spec.inputs.iter().map(|path| Input::read(path)).collect::<Result<Vec<_>, _>>()?;
    let mut images = Images::choose(spec, &inputs)?;
    let read = read_views(spec, &inputs, &mut images)?;
    let mut original = inputs.swap_remove(0).file;
    drop(inputs);
    original.release();
    let reading = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let (mut views, mut notices, mut described) = (Vec::new(), images.notices, String::new());
    for (view, read, target) in read {
        let image = read.image().fireflies(spec.fireflies);
        let filtered: Filtered;
        (filtered, described) = match &filter {
            Some(filter) => (image.clone().filter(&**filter).run()?, filter.describe()),
            None => (image.run()?, image.default_filter()?.describe()),
        };
        let warnings = image.warnings()?.into_iter().map(|warning| for_files(&read.found, &warning.to_string()));
        let about = || format!("{}; to change this, use --fireflies keep, drop or spread", filtered.fireflies);
        let fireflies = (filtered.fireflies.pixels > 0).then(about);
        let new: Vec<String> = read.notices.iter().cloned().chain(warnings).chain(fireflies).collect();
        notices.extend(new.into_iter().filter(|notice| !notices.contains(notice)).collect::<Vec<_>>());
        views.push(DenoisedView { view, filtered, found: read.found, target });
    }
    let seconds = [reading, start.elapsed().as_secs_f64()];
    Ok(DenoisedImage { views, filter: described, notices, seconds, original })
}

/// Reads all views. Skips a view without a variance if another view has one.
fn read_views(
    spec: &DenoiseSpec,
    inputs: &[Input],
    images: &mut Images,
) -> Result<Vec<(String, Assembled, Target)>, DenoiseError> {
    let (mut read, mut without) = (Vec::new(), None);
    for colors in &images.views {
        let assembled = match Assembled::read(spec, inputs, colors) {
            Err(error @ DenoiseError::NoVariance { .. }) => {
                if let DenoiseError::NoVariance { path, image, .. } = &error {
                    let path = path.display();
                    images
                        .notices
                        .push(format!("{path}: there is no variance for {image}, so this image is not denoised"));
                }
                without.get_or_insert(error);
                continue;
            }
            assembled => assembled?,
        };
        let target = Target::of(inputs, colors, assembled.window)?;
        read.push((colors[0].view.clone(), assembled, target));
    }
    match without {
        Some(error) if read.is_empty() => Err(error),
        _ => Ok(read),
    }
}

/// Replaces advice about buffers in a warning by advice about files. `found` lists the layers that were read.
fn for_files(found: &[(LayerKind, String)], warning: &str) -> String {
    let of_mean = found.iter().find(|(kind, _)| *kind == LayerKind::MeanVariance);
    let samples = match of_mean {
        Some((_, name)) => format!("give --layer variance={name}"),
        None => "leave out --variance-of-mean".to_owned(),
    };
    let mean = warning.replace("use Variance::OfMean", "give --variance-of-mean");
    mean.replace("use Variance::OfSamples", &samples)
}

/// Creates a filter from its description, without a scene.
fn filter(description: &str) -> Result<Box<dyn dapple_core::Filter>, DenoiseError> {
    match registry::filter(description, &MethodInputs::default()) {
        Ok(made) => Ok(made.filter),
        Err(RegistryError::NeedsWorld { of, .. }) => Err(DenoiseError::NeedsScene { filter: of }),
        Err(error) => Err(error.into()),
    }
}

impl DenoiseSpec {
    /// Checks, before any file is read, that every output can be written. No two outputs may be the same file, and no output
    /// may be an input.
    ///
    /// # Errors
    ///
    /// [`DenoiseError::Overwrites`], [`DenoiseError::SameOutput`], and [`DenoiseError::Image`] for an unknown extension or a
    /// file that cannot be written.
    pub fn check_outputs(&self, outputs: &[PathBuf]) -> Result<(), DenoiseError> {
        let inputs: Vec<FileIdentity> = self.inputs.iter().map(|input| FileIdentity::of(input)).collect();
        for (i, output) in outputs.iter().enumerate() {
            Format::from_path(output)?;
            let identity = FileIdentity::of(output);
            if inputs.iter().any(|input| input.is_same(&identity)) {
                return Err(DenoiseError::Overwrites { path: output.clone() });
            }
            if let Some(first) = outputs[..i].iter().find(|first| FileIdentity::of(first).is_same(&identity)) {
                return Err(DenoiseError::SameOutput { path: output.clone(), first: first.clone() });
            }
            check_writable(output)?;
        }
        Ok(())
    }
}

/// The reason why image files cannot be denoised. Each message contains a remedy.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// No input file, or more than two.
    #[error(
        "{count} input files are given; give one OpenEXR file that holds an image and its variance, or two renders with different seeds"
    )]
    Files {
        /// The number of files.
        count: usize,
    },
    /// A file that cannot be opened.
    #[error("{}: cannot read the file: {source}; check the name of the file", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file of another format, which cannot hold layers.
    #[error("{}: this is not an OpenEXR file; save the image as OpenEXR with its variance, or save two renders with different seeds as OpenEXR", path.display())]
    NotExr {
        /// The file.
        path: PathBuf,
    },
    /// A file that is not an image, or an image that cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Two files of different sizes.
    #[error("{}: the image has {}x{} pixels, but {} has {}x{}; render both with equal settings and different seeds",
        paths[1].display(), sizes[1][0], sizes[1][1], paths[0].display(), sizes[0][0], sizes[0][1])]
    Sizes {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The sizes of their display windows in pixels.
        sizes: [[u32; 2]; 2],
    },
    /// Layers without a common pixel.
    #[error("the data windows do not overlap: layer \"{}\" of {} covers pixels {}, layer \"{}\" of {} covers pixels {}; save both layers with the same data window",
        layers[0], paths[0].display(), windows[0], layers[1], paths[1].display(), windows[1])]
    Windows {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The names of the layers.
        layers: Box<[String; 2]>,
        /// The data windows of the layers.
        windows: Box<[Window; 2]>,
    },
    /// Two files that show different views.
    #[error("{}: the image shows view \"{}\", but {} shows view \"{}\"; give two renders of the same view",
        paths[1].display(), views[1], paths[0].display(), views[0])]
    Views {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The names of the views.
        views: Box<[String; 2]>,
    },
    /// Two files with the same pixels.
    #[error("{}: the image is identical to that of {}, so the noise cannot be estimated; give two renders with different seeds, or one file with its variance",
        paths[1].display(), paths[0].display())]
    Equal {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
    },
    /// Two files of different colour spaces.
    #[error("{}: the image is in colour space {}, but {} is in {}; convert one file (image and variance) to the other's colour space",
        paths[1].display(), spaces[1], paths[0].display(), spaces[0])]
    ColorSpaces {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The colour spaces of the two images.
        spaces: Box<[Chromaticities; 2]>,
    },
    /// A layer named by the caller that is missing in a file.
    #[error("{}: there is no layer \"{name}\" for {}{}; choose among {}", path.display(), kind.name(),
        near.as_ref().map_or(String::new(), |near| format!(" (did you mean \"{near}\"?)")), layers.join(", "))]
    NoLayer {
        /// The file.
        path: PathBuf,
        /// The kind of layer.
        kind: LayerKind,
        /// The name that was given.
        name: String,
        /// The most similar name of a layer in the file.
        near: Option<String>,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// A layer named by the caller without the channels of its kind.
    #[error("{}: layer \"{name}\" has the channels {}, but layers of the kind {} have {}; rename its channels in the file, or choose another layer with --layer {}=NAME",
        path.display(), letters.join(", "), kind.name(), kind.channels(), kind.name())]
    LayerChannels {
        /// The file.
        path: PathBuf,
        /// The kind of layer.
        kind: LayerKind,
        /// The name that was given.
        name: String,
        /// The letters of the layer's channels.
        letters: Vec<String>,
    },
    /// A file without an image.
    #[error("{}: no image was found among the channels {} (an image has the channels {}); choose the layer to denoise with --layer color=NAME",
        path.display(), channels.join(", "), LayerKind::Color.channels())]
    NoImage {
        /// The file.
        path: PathBuf,
        /// All channels of the file.
        channels: Vec<String>,
    },
    /// A file with several images.
    #[error("{}: the file holds several images, {}; choose one with --layer color=NAME", path.display(), layers.join(", "))]
    Ambiguous {
        /// The file.
        path: PathBuf,
        /// The names of the images' layers.
        layers: Vec<String>,
    },
    /// One file without its variance.
    #[error("{}: there is no variance for {image} among the layers {}, and one image alone does not reveal its noise; give a second render with another seed, or choose the variance layer with --layer variance=NAME",
        path.display(), layers.join(", "))]
    NoVariance {
        /// The file.
        path: PathBuf,
        /// The names of the image's layer and view.
        image: String,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// A layer with the variance of one sample, in a file that does not state the number of samples.
    #[error("{}: layer \"{layer}\" holds the variance of a sample, so the number of samples per pixel is needed; give this number with --spp N, or give --variance-of-mean if the layer holds the variance of the mean", path.display())]
    NoCount {
        /// The file.
        path: PathBuf,
        /// The name of the variance layer.
        layer: String,
    },
    /// A filter that needs the clusters of a scene.
    #[error(
        "filter \"{filter}\" needs the clusters of a scene, which image files do not hold; set outside=1, as in \"{filter}:outside=1\", or omit --filter"
    )]
    NeedsScene {
        /// The filter's name.
        filter: &'static str,
    },
    /// An output that is one of the inputs.
    #[error("{}: this output is also an input; choose another name for the output", path.display())]
    Overwrites {
        /// The output.
        path: PathBuf,
    },
    /// Two outputs with the same file.
    #[error("{}: this output is the same file as {}; give each output its own file", path.display(), first.display())]
    SameOutput {
        /// The later output.
        path: PathBuf,
        /// The earlier output that is the same file.
        first: PathBuf,
    },
    /// A filter that cannot be created.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// Buffers that do not form an image, or an error of the filter.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
}
