//! The image files of a render.

use super::GrayMap;
use super::header::{View, attributes};
use super::layers::{Asked, LAYERS, LayerEntry, OF_IMAGE, bytes_per_pixel};
use crate::output;
use crate::{Job, JobError, RenderedImage, Warning};
use dapple_core::{Frame, Needs};
use dapple_scene::image::{ExrHeader, encode_pfm, encode_png, rows_at_a_time};
use dapple_scene::image::{Format, Image, ImageError, Layer, check_writable, write_exr, write_file};
use std::path::{Path, PathBuf};

/// The kind of image in a file: the rendered image or one of the maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileContents {
    Image(Format),
    Samples,
    Error,
    Albedo,
    Normals,
    Depth,
    Clusters,
}

impl FileContents {
    /// The peak memory in bytes for writing one file of this kind, excluding film and image. `filtered` is `true` if a filter
    /// made the image.
    fn memory(self, frame: &Frame, needs: &Needs, filtered: bool) -> u64 {
        /// Bytes per pixel of red, green and blue as floats.
        const RGB: usize = 12;
        // The compressed data take at most the size of the uncompressed.
        let png = |channels: usize| 3 * channels;
        frame.bytes(match self {
            // Sample counts, clusters, and the rows being encoded.
            Self::Image(Format::Exr) => {
                let layers = bytes_per_pixel(needs, filtered);
                let rows = 2 * rows_at_a_time() * frame.size()[0] as usize * layers;
                8 + (frame.bytes(2 * layers).min(rows as u64) / frame.pixels() as u64) as usize
            }
            Self::Image(Format::Pfm) => RGB + RGB,
            Self::Image(_) => RGB + png(3),
            Self::Samples => 8 + png(1),
            Self::Error | Self::Depth => 8 + 8 + png(1),
            Self::Albedo | Self::Normals => png(3),
            Self::Clusters => 4 + png(3),
        })
    }
}

/// The image files that a render writes.
#[derive(Clone, Debug, Default)]
pub struct OutputFiles {
    files: Vec<(FileContents, PathBuf)>,
    maps: Option<PathBuf>,
    /// Exposure of PNG images in stops; one stop doubles the brightness.
    pub exposure: f32,
    /// If `true`, the film records features (albedo, normal, depth, coverage) for EXR files. If `false`, it records them only
    /// if the sampler, the filter, another file or [`layers`](Self::layers) needs them.
    pub features: bool,
    /// If `true`, image, unfiltered image, albedo, normal and coverage are 16-bit floats in EXR files.
    pub half: bool,
    /// The layers of EXR files besides the image, by their [names](super::layer_names); `None` for all that the film can fill.
    /// [`needs`](Self::needs) returns the statistics that the film must record for them.
    pub layers: Option<Vec<String>>,
    /// The command line that makes the image, for the headers of EXR files.
    pub command: Option<String>,
}

impl OutputFiles {
    /// Returns an empty list of files.
    pub fn none() -> Self {
        Self::default()
    }

    /// The default files of a scene, in the current folder: `NAME.exr`, `NAME.png`, and `NAME-samples.png` unless the
    /// sampler is `uniform`.
    pub fn defaults(scene: &str, sampler: &str) -> Self {
        let mut files = vec![
            (FileContents::Image(Format::Exr), PathBuf::from(format!("{scene}.exr"))),
            (FileContents::Image(Format::Png), PathBuf::from(format!("{scene}.png"))),
        ];
        if sampler.split(':').next().is_none_or(|name| name.trim() != "uniform") {
            files.push((FileContents::Samples, PathBuf::from(format!("{scene}-samples.png"))));
        }
        Self { files, ..Self::default() }
    }

    /// Returns a list of image files with these paths. Extensions determine the formats.
    ///
    /// # Errors
    ///
    /// [`ImageError`] for an unknown extension.
    pub fn images(paths: &[PathBuf]) -> Result<Self, ImageError> {
        let image = |path: &PathBuf| Ok((FileContents::Image(Format::from_path(path)?), path.clone()));
        Ok(Self { files: paths.iter().map(image).collect::<Result<_, ImageError>>()?, ..Self::default() })
    }

    /// Adds one PNG file in `folder` for each map (samples, error, albedo, normals, depth, clusters).
    #[must_use]
    pub fn with_maps(mut self, folder: &Path) -> Self {
        self.files.extend(MAPS.iter().map(|&(what, name)| (what, folder.join(name))));
        self.maps = Some(folder.to_owned());
        self
    }

    /// Returns `true` if the layer `name` is selected. A selected layer is missing in files if the film lacks its statistics.
    fn has_layer(&self, name: &str) -> bool {
        self.layers.as_ref().is_none_or(|layers| layers.iter().any(|layer| layer == name))
    }

    /// The paths of the files, in the order in which they are written.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(_, path)| path.as_path())
    }

    /// Creates the folder of the maps, and checks that every file can be written.
    ///
    /// # Errors
    ///
    /// [`JobError::Files`] with a line for each file that cannot be written.
    pub fn prepare(&self) -> Result<(), JobError> {
        if let Some(folder) = &self.maps {
            let cannot = |e| {
                JobError::Files(vec![format!("{}: cannot create the folder: {e}; choose another", folder.display())])
            };
            std::fs::create_dir_all(folder).map_err(cannot)?;
        }
        let troubles = self.paths().filter_map(|path| check_writable(path).err());
        let troubles: Vec<String> = troubles.map(|e| e.to_string()).collect();
        if troubles.is_empty() { Ok(()) } else { Err(JobError::Files(troubles)) }
    }

    /// The per-pixel statistics that the film must record for these files. `clusters` is `true` if the render groups triangles
    /// into clusters.
    pub fn needs(&self, clusters: bool) -> Needs {
        let shown = |(what, _): &(FileContents, PathBuf)| match what {
            FileContents::Clusters => true,
            FileContents::Image(Format::Exr) => self.has_layer("cluster"),
            _ => false,
        };
        let named = |name: &str| self.layers.is_some() && self.has_layer(name);
        let asked = |layer: &&LayerEntry| match layer.asked {
            Asked::Always => self.has_layer(layer.name),
            Asked::Named => named(layer.name),
            Asked::Never => false,
        };
        let features = self.features || OF_IMAGE.into_iter().any(named);
        let mut needs = Needs::none();
        needs.surfaces = clusters && self.files.iter().any(shown);
        self.files.iter().fold(needs, |needs, (what, _)| match what {
            FileContents::Image(Format::Exr) => {
                let needs = LAYERS.iter().filter(asked).fold(needs, |needs, layer| (layer.needs)(needs));
                if features { needs.with_features() } else { needs }
            }
            FileContents::Albedo | FileContents::Normals | FileContents::Depth => needs.with_features(),
            _ => needs,
        })
    }

    /// The peak memory in bytes for writing the files, excluding film and image. `filtered` is `true` if a filter made the
    /// image.
    pub(crate) fn memory(&self, frame: &Frame, needs: &Needs, filtered: bool) -> u64 {
        self.files.iter().map(|(what, _)| what.memory(frame, needs, filtered)).max().unwrap_or(0)
    }

    /// Writes every file, even if others cannot be written. Returns one line per written file, and the warnings.
    ///
    /// `cpu` is the processor time in seconds, for the headers of EXR files; `None` if unknown.
    ///
    /// # Errors
    ///
    /// [`JobError::Files`] with a line for each file that was not written.
    pub fn write(
        &self,
        job: &Job,
        image: &RenderedImage,
        cpu: Option<f64>,
    ) -> Result<(Vec<String>, Vec<Warning>), JobError> {
        let view = View::new(&job.scene().camera, job.frame().resolution());
        let report = Report { job, image, cpu, view };
        let (mut lines, mut troubles, mut warnings) = (Vec::new(), Vec::new(), Vec::new());
        for (what, path) in &self.files {
            match self.encode(*what, path, &report, &mut warnings) {
                Ok(None) => {}
                Ok(Some((write, about))) => match write(path) {
                    Ok(clamped) => {
                        lines.push(format!("{}: {about}", path.display()));
                        if clamped > 0 {
                            warnings.push(Warning::Clamped { path: path.to_owned(), values: clamped });
                        }
                    }
                    Err(e) => troubles.push(write_elsewhere(path, &*write, e.to_string())),
                },
                Err(e) => troubles.push(format!("{}: {e}", path.display())),
            }
        }
        if troubles.is_empty() { Ok((lines, warnings)) } else { Err(JobError::Files(troubles)) }
    }

    /// Removes layers that are not selected, and warns about selected layers that the render lacks.
    fn selected<'a>(&self, mut layers: Vec<Layer<'a>>, path: &Path, warnings: &mut Vec<Warning>) -> Vec<Layer<'a>> {
        let holds = |name: &str| {
            layers.iter().any(|layer| layer.name == name) || layers[0].channels.iter().any(|channel| channel.0 == name)
        };
        for name in self.layers.iter().flatten().filter(|name| !holds(name)) {
            warnings.push(Warning::NoLayer { path: path.to_owned(), layer: name.clone() });
        }
        layers.retain(|layer| layer.name.is_empty() || self.has_layer(&layer.name));
        layers[0].channels.retain(|(name, _)| !OF_IMAGE.contains(name) || self.has_layer(name));
        if self.half {
            super::layers::halve(&mut layers);
        }
        layers
    }

    /// Encodes a file, or prepares a file that is written block by block. Returns a function that writes the file, and a phrase
    /// about its contents; `None` if the film lacks the statistics for the file.
    fn encode<'a>(
        &'a self,
        what: FileContents,
        path: &Path,
        report: &'a Report<'a>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<(Write<'a>, String)>, ImageError> {
        let filtered = &report.image.filtered;
        let image = || Image::new(filtered.size, filtered.radiance.clone());
        let encoded = match what {
            FileContents::Image(Format::Exr) => return Ok(Some(self.exr(path, report, warnings))),
            FileContents::Image(Format::Pfm) => Some((encode_pfm(&image()?)?, "the image".into())),
            FileContents::Image(Format::Png) => Some((encode_png(&image()?, self.exposure)?, "the image, sRGB".into())),
            _ => map(what, report).transpose()?,
        };
        let write = |bytes: Vec<u8>| -> Write<'a> { Box::new(move |path| write_file(path, &bytes).map(|()| 0)) };
        Ok(encoded.map(|(bytes, about)| (write(bytes), about)))
    }

    fn exr<'a>(&'a self, path: &Path, report: &'a Report<'a>, warnings: &mut Vec<Warning>) -> (Write<'a>, String) {
        let Report { job, image, cpu, view } = report;
        let mut layers = output::layers(&image.film, &image.filtered, report.unit(), report.clusters());
        layers[0].channels.extend(view.channels(&image.film, report.unit()));
        let layers = self.selected(layers, path, warnings);
        let mut attributes = attributes(job, image, *cpu);
        attributes.extend(self.command.clone().map(|command| ("dapple:command".to_owned(), command)));
        let names: Vec<&str> = layers.iter().map(|l| l.name.as_str()).skip(1).collect();
        let with = if names.is_empty() { String::new() } else { format!(", with layers {}", names.join(", ")) };
        let about = format!("the image{with}");
        let write = move |path: &Path| {
            let software = format!("dapple {}", env!("CARGO_PKG_VERSION"));
            let [world_to_camera, world_to_ndc] = view.matrices().map_or([None; 2], |m| m.map(Some));
            let header =
                ExrHeader { attributes: &attributes, software: Some(&software), world_to_camera, world_to_ndc };
            write_exr(path, image.filtered.size, &layers, &header)
        };
        (Box::new(write), about)
    }
}

/// A function that writes a file to a path and returns the number of [clamped](dapple_scene::image::EncodedExr::clamped)
/// values.
type Write<'a> = Box<dyn Fn(&Path) -> Result<u64, ImageError> + 'a>;

/// Encodes a map; `None` if the film lacks the statistics for it.
fn map(what: FileContents, report: &Report<'_>) -> Option<Result<Named, ImageError>> {
    let (film, filtered) = (&report.image.film, &report.image.filtered);
    let gray = |map: &GrayMap, about: String| map.png().map(|png| (png, about));
    let known = |png: Result<Vec<u8>, ImageError>, about: &str| png.map(|png| (png, about.to_owned()));
    Some(match what {
        FileContents::Image(_) => return None,
        FileContents::Samples => {
            let map = output::sample_map(film);
            gray(&map, format!("the sample map; white is {} samples per pixel", map.white))
        }
        FileContents::Clusters => {
            known(output::cluster_map(filtered.size, &report.clusters()?), "clusters, one colour each")
        }
        FileContents::Error => {
            let map = output::error_map(filtered)?;
            gray(&map, format!("the predicted relative error over 5x5 pixels; white is {:.3}", map.white))
        }
        FileContents::Depth => {
            let map = output::depth_map(film, report.unit())?;
            gray(&map, format!("distances; white is {:.4} or no hit", map.white))
        }
        FileContents::Albedo => known(output::albedo_map(film)?, "albedo, sRGB"),
        FileContents::Normals => known(output::normal_map(film)?, "shading normals; -1 is black, 1 is white"),
    })
}

/// Saves an image in the folder of temporary files, because it could not be written to `path`. Returns the error
/// message `trouble`, extended by the new path if saving succeeded.
fn write_elsewhere(path: &Path, write: &dyn Fn(&Path) -> Result<u64, ImageError>, trouble: String) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let elsewhere = std::env::temp_dir().join(format!("dapple-{}-{name}", std::process::id()));
    match write(&elsewhere) {
        Ok(_) => format!("{trouble}; the file was written to {} instead", elsewhere.display()),
        Err(_) => trouble,
    }
}

/// The job and its image, from which files are encoded.
struct Report<'a> {
    job: &'a Job,
    image: &'a RenderedImage,
    cpu: Option<f64>,
    view: View,
}

impl Report<'_> {
    /// The integrator's unit of length, in the scene file's units.
    fn unit(&self) -> f64 {
        1.0 / self.job.world().space().scale()
    }

    /// The index of the cluster that each pixel shows.
    fn clusters(&self) -> Option<Vec<u32>> {
        output::cluster_ids(&self.image.film, self.job.clusters()?)
    }
}

/// The bytes of a file, and a phrase about its contents.
type Named = (Vec<u8>, String);

/// The maps and their file names; the map of clusters is written only if the render has clusters.
const MAPS: [(FileContents, &str); 6] = [
    (FileContents::Samples, "samples.png"),
    (FileContents::Error, "error.png"),
    (FileContents::Albedo, "albedo.png"),
    (FileContents::Normals, "normals.png"),
    (FileContents::Depth, "depth.png"),
    (FileContents::Clusters, "clusters.png"),
];
