//! Denoising of image files of any renderer: OpenEXR layers in, an image and its error out.
//!
//! [`DenoiseSpec`] names the files and settings; [`denoise_files`] reads and denoises them. Layers are found by the names
//! that renderers give them ([`KNOWN_LAYERS`]), or by a name that the caller gives. All views of an image are denoised.

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
    /// Layer names that the caller gives: the kind of layer, and its name in the files.
    pub layers: Vec<(LayerKind, String)>,
    /// The number of samples per pixel in each file, if the files do not hold it.
    pub spp: Option<u32>,
    /// True if the variance in the files is that of the mean, not of one sample.
    pub variance_of_mean: bool,
    /// The filter; `None` for the default.
    pub filter: Option<String>,
    /// The place of the light of fireflies, by the default filter.
    pub fireflies: FireflyLight,
}

/// A denoised image in all its views, and what was read for it.
#[derive(Clone, Debug)]
pub struct DenoisedImage {
    /// The views, the default one first; one in files without views.
    pub views: Vec<DenoisedView>,
    /// The filter with all its parameters.
    pub filter: String,
    /// Notices about layers that the files lack, about what was cut, and about assumptions; one sentence each.
    pub notices: Vec<String>,
    /// The seconds that reading and filtering took.
    pub seconds: [f64; 2],
    /// The first input.
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
/// [`DenoiseError`] for files that cannot be read, layers that are missing or do not fit each other, and the filter.
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
        let about = || format!("{}; --fireflies keep, drop or spread", filtered.fireflies);
        let fireflies = (filtered.fireflies.pixels > 0).then(about);
        let new: Vec<String> = read.notices.iter().cloned().chain(warnings).chain(fireflies).collect();
        notices.extend(new.into_iter().filter(|notice| !notices.contains(notice)).collect::<Vec<_>>());
        views.push(DenoisedView { view, filtered, found: read.found, target });
    }
    let seconds = [reading, start.elapsed().as_secs_f64()];
    Ok(DenoisedImage { views, filter: described, notices, seconds, original })
}

/// Reads all views. One without a variance is kept as it is if another one has its own.
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
                    images.notices.push(format!("{path}: it has no variance for {image}, which stays noisy, as it is"));
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

/// A warning about buffers, with advice for files with these layers.
fn for_files(found: &[(LayerKind, String)], warning: &str) -> String {
    let of_mean = found.iter().find(|(kind, _)| *kind == LayerKind::MeanVariance);
    let samples = match of_mean {
        Some((_, name)) => format!("give --layer variance={name}"),
        None => "leave out --variance-of-mean".to_owned(),
    };
    let mean = warning.replace("take Variance::OfMean", "give --variance-of-mean");
    mean.replace("take Variance::OfSamples", &samples)
}

/// Makes a filter by its name, without a scene.
fn filter(description: &str) -> Result<Box<dyn dapple_core::Filter>, DenoiseError> {
    match registry::filter(description, &MethodInputs::default()) {
        Ok(made) => Ok(made.filter),
        Err(RegistryError::NeedsWorld { of, .. }) => Err(DenoiseError::NeedsScene { filter: of }),
        Err(error) => Err(error.into()),
    }
}

impl DenoiseSpec {
    /// Checks before reading that every output can be written, and that each is a file of its own and none is an input.
    ///
    /// # Errors
    ///
    /// [`DenoiseError::Overwrites`], [`DenoiseError::SameOutput`], and [`DenoiseError::Image`] for an unknown extension or a file that cannot be written.
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

/// The reason why image files cannot be denoised. Each message says what to do.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// No file, or more than two.
    #[error("{count} files are given; give one OpenEXR file with its variance, or two renders with different seeds")]
    Files {
        /// The number of files.
        count: usize,
    },
    /// A file that cannot be opened.
    #[error("{}: cannot read it: {source}; check the name of the file", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file of another format, which cannot hold layers.
    #[error("{}: it is no OpenEXR file; save the image as OpenEXR with its variance, or with a second seed", path.display())]
    NotExr {
        /// The file.
        path: PathBuf,
    },
    /// A file that is not an image, or an image that cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Two files of different sizes.
    #[error("{}: it has {}x{} pixels, and {} has {}x{}; render both alike but for the seed",
        paths[1].display(), sizes[1][0], sizes[1][1], paths[0].display(), sizes[0][0], sizes[0][1])]
    Sizes {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The sizes of their displays in pixels.
        sizes: [[u32; 2]; 2],
    },
    /// Layers without a common pixel.
    #[error("{}: layer \"{}\" has pixels {}, none of which {} has in layer \"{}\", {}; save both with one data window",
        paths[1].display(), layers[1], windows[1], paths[0].display(), layers[0], windows[0])]
    Windows {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The names of the layers.
        layers: Box<[String; 2]>,
        /// The pixels that they have.
        windows: Box<[Window; 2]>,
    },
    /// Two files that show different views.
    #[error("{}: its image is view \"{}\", and {} has view \"{}\"; give two renders of the same view",
        paths[1].display(), views[1], paths[0].display(), views[0])]
    Views {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// The names of the views.
        views: Box<[String; 2]>,
    },
    /// Two files with the same pixels.
    #[error("{}: its image equals that of {}, so the halves show no noise; give two renders with different seeds, or one file with its variance",
        paths[1].display(), paths[0].display())]
    Equal {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
    },
    /// Two files of different colour spaces.
    #[error("{}: its colours are those of {}, and {} has {}; convert one of them, with its variance",
        paths[1].display(), spaces[1], paths[0].display(), spaces[0])]
    ColorSpaces {
        /// The two files.
        paths: Box<[PathBuf; 2]>,
        /// Their colour spaces.
        spaces: Box<[Chromaticities; 2]>,
    },
    /// A layer that the caller names and that no file has.
    #[error("{}: it has no layer \"{name}\" for {}; {}its layers are {}", path.display(), kind.name(),
        near.as_ref().map_or(String::new(), |near| format!("did you mean \"{near}\"? ")), layers.join(", "))]
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
    /// A layer that the caller names, without the channels of its kind.
    #[error("{}: layer \"{name}\" has the channels {}, but layers of the kind {} have {}; rename them, or name another layer",
        path.display(), letters.join(", "), kind.name(), kind.channels())]
    LayerChannels {
        /// The file.
        path: PathBuf,
        /// The kind of layer.
        kind: LayerKind,
        /// The name that was given.
        name: String,
        /// The letters of its channels.
        letters: Vec<String>,
    },
    /// A file without an image.
    #[error("{}: no image was found among its channels {}; name its layer with --layer color=NAME; its channels are {}",
        path.display(), channels.join(", "), LayerKind::Color.channels())]
    NoImage {
        /// The file.
        path: PathBuf,
        /// All channels of the file.
        channels: Vec<String>,
    },
    /// A file with several images.
    #[error("{}: it holds several images, {}; name one with --layer color=NAME", path.display(), layers.join(", "))]
    Ambiguous {
        /// The file.
        path: PathBuf,
        /// The names of their layers.
        layers: Vec<String>,
    },
    /// One file without its variance.
    #[error("{}: it has no variance for {image}, and one image alone does not show its noise; give a second render with another seed, or name the layer with --layer variance=NAME. Its layers are {}",
        path.display(), layers.join(", "))]
    NoVariance {
        /// The file.
        path: PathBuf,
        /// The name of the image's layer, and its view.
        image: String,
        /// All layers of the file.
        layers: Vec<String>,
    },
    /// The variance of a sample, without the number of samples.
    #[error("{}: layer \"{layer}\" holds the variance of a sample, so the number of samples per pixel is needed; give it with --spp N, or --variance-of-mean if the layer holds the variance of the mean", path.display())]
    NoCount {
        /// The file.
        path: PathBuf,
        /// The name of the variance layer.
        layer: String,
    },
    /// A filter that reads the clusters of a scene.
    #[error(
        "filter \"{filter}\" reads clusters of a scene, which images lack; set outside=1, as in \"{filter}:outside=1\", or leave --filter out"
    )]
    NeedsScene {
        /// The filter's name.
        filter: &'static str,
    },
    /// An output that is one of the inputs.
    #[error("{}: it is an input; choose another name for the output", path.display())]
    Overwrites {
        /// The output.
        path: PathBuf,
    },
    /// Two outputs that are one file.
    #[error("{}: this is the file of {}; give each output its own file", path.display(), first.display())]
    SameOutput {
        /// The later output.
        path: PathBuf,
        /// The first output with this file.
        first: PathBuf,
    },
    /// A filter that cannot be made.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// Buffers that do not make an image, or an error of the filter.
    #[error(transparent)]
    Core(#[from] dapple_core::Error),
}
