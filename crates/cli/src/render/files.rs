//! Which files are written, and writing them.

use super::Options;
use super::report::Report;
use super::settings::Settings;
use crate::output::warn;
use crate::{Failure, Result};
use dapple_core::{Frame, Needs};
use dapple_job::output::{self, GrayMap};
use dapple_scene::image::{Format, Image, ImageError, check_writable, write_file};
use dapple_scene::image::{encode_exr, encode_pfm, encode_png, rows_at_a_time};
use std::path::{Path, PathBuf};

/// What a file shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    Image(Format),
    Samples,
    Error,
    Albedo,
    Normals,
    Depth,
    Clusters,
}

impl What {
    /// As [`Files::memory`], of one file.
    fn memory(self, frame: &Frame, needs: &Needs, filtered: bool) -> u64 {
        /// Red, green and blue as floats.
        const RGB: usize = 12;
        // What is compressed takes its own size at most.
        let png = |channels: usize| 3 * channels;
        frame.bytes(match self {
            Self::Image(Format::Exr) => {
                let rgb = 1 + usize::from(filtered) + usize::from(needs.variance) + 2 * usize::from(needs.features);
                let one =
                    1 + usize::from(needs.halves) + usize::from(needs.first_hits > 0) + usize::from(needs.features);
                let layers = RGB * rgb + 4 * one;
                // The image's copy, all layers, the file and what is on its way there; or the layers up to the variance,
                // which stands beside means and a copy of its own.
                let [width, height] = frame.size().map(|n| n as usize);
                let batch =
                    frame.bytes(layers).min((layers * width * rows_at_a_time()) as u64) / (width * height) as u64;
                RGB + (2 * layers + batch as usize).max(RGB * (rgb + 2))
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

/// The files to write.
pub(super) struct Files {
    files: Vec<(What, PathBuf)>,
    exposure: f32,
}

impl Files {
    /// Decides on the files.
    pub(super) fn new(options: &Options, scene: &str, settings: &Settings) -> Result<Self> {
        let mut files = Vec::new();
        if options.shard.is_some() {
            return Ok(Self { files, exposure: options.exposure });
        }
        for path in &options.outputs {
            files.push((What::Image(Format::from_path(path).map_err(Failure::new)?), path.clone()));
        }
        if files.is_empty() {
            files.push((What::Image(Format::Exr), PathBuf::from(format!("{scene}.exr"))));
            files.push((What::Image(Format::Png), PathBuf::from(format!("{scene}.png"))));
            if settings.adaptive {
                files.push((What::Samples, PathBuf::from(format!("{scene}-samples.png"))));
            }
        }
        if let Some(folder) = &options.maps {
            files.extend(MAPS.iter().map(|&(what, name)| (what, folder.join(name))));
        }
        Ok(Self { files, exposure: options.exposure })
    }

    /// Makes the folder of the maps, and sure that each file can be written.
    pub(super) fn prepare(&self, options: &Options) -> Result<()> {
        if let Some(folder) = options.maps.as_ref().filter(|_| !self.files.is_empty()) {
            std::fs::create_dir_all(folder)
                .map_err(|e| Failure::new(format!("{}: cannot make the folder: {e}", folder.display())))?;
        }
        let troubles: Vec<String> =
            self.files.iter().filter_map(|(_, path)| check_writable(path).err()).map(|e| e.to_string()).collect();
        if troubles.is_empty() { Ok(()) } else { Err(Failure(troubles)) }
    }

    /// What the files show of the samples, and of `clusters` where there are some.
    pub(super) fn needs(&self, clusters: bool) -> Needs {
        let mut needs = Needs::none();
        let shown = |(what, _): &(What, PathBuf)| matches!(what, What::Clusters | What::Image(Format::Exr));
        if clusters && self.files.iter().any(shown) {
            needs = needs.with_first_hits(1);
        }
        for (what, _) in &self.files {
            match what {
                What::Image(Format::Exr) => needs = needs.with_variance(),
                What::Albedo | What::Normals | What::Depth => needs = needs.with_features(),
                _ => {}
            }
        }
        needs
    }

    /// The most that making the bytes of a file takes besides film and image. `filtered`: whether the image is another
    /// than the film's own.
    pub(super) fn memory(&self, frame: &Frame, needs: &Needs, filtered: bool) -> u64 {
        self.files.iter().map(|(what, _)| what.memory(frame, needs, filtered)).max().unwrap_or(0)
    }

    /// Writes every file, whatever becomes of the others, and says for each what it is. `unit` as in
    /// [`output::layers`].
    pub(super) fn write(&self, report: &Report<'_>, unit: f64) -> Result<Vec<String>> {
        let (mut lines, mut troubles) = (Vec::new(), Vec::new());
        for (what, path) in &self.files {
            match self.encode(*what, path, report, unit) {
                Ok(None) => {}
                Ok(Some((bytes, about))) => match write_file(path, &bytes) {
                    Ok(()) => lines.push(format!("{}: {about}", path.display())),
                    Err(e) => troubles.push(write_elsewhere(path, &bytes, e.to_string())),
                },
                Err(e) => troubles.push(format!("{}: {e}", path.display())),
            }
        }
        if troubles.is_empty() { Ok(lines) } else { Err(Failure(troubles)) }
    }

    /// The bytes of a file and a phrase about it; `None` for what the film does not hold.
    fn encode(&self, what: What, path: &Path, report: &Report<'_>, unit: f64) -> Encoded {
        let (film, filtered) = (report.film, report.filtered);
        let known = |bytes: Vec<u8>, about: String| Ok(Some((bytes, about)));
        let ids = || output::cluster_ids(film, report.clusters?);
        let gray = |map: GrayMap, about: String| known(map.png()?, about);
        match what {
            What::Image(format) => {
                let image = Image::new(filtered.size, filtered.radiance.clone())?;
                match format {
                    Format::Exr => {
                        let layers = output::layers(film, filtered, unit, ids());
                        let file = encode_exr(filtered.size, &layers, &report.attributes())?;
                        if file.clamped > 0 {
                            warn(format!("{}: {} values were too large for it", path.display(), file.clamped));
                        }
                        let names: Vec<&str> = layers.iter().map(|l| l.name.as_str()).skip(1).collect();
                        known(file.bytes, format!("the image, with layers {}", names.join(", ")))
                    }
                    Format::Pfm => known(encode_pfm(&image)?, "the image".into()),
                    Format::Png => known(encode_png(&image, self.exposure)?, "the image, sRGB".into()),
                }
            }
            What::Samples => {
                let map = output::sample_map(film);
                let about = format!("the sample map; white is {} samples per pixel", map.white);
                gray(map, about)
            }
            What::Clusters => match ids() {
                Some(ids) => known(output::cluster_map(filtered.size, &ids)?, "clusters, a colour each".into()),
                None => Ok(None),
            },
            What::Error => match output::error_map(filtered) {
                Some(map) => {
                    let about = format!("the predicted relative error over 5x5 pixels; white is {:.3}", map.white);
                    gray(map, about)
                }
                None => Ok(None),
            },
            What::Depth => match output::depth_map(film, unit) {
                Some(map) => {
                    let about = format!("distances; white is {:.4}, or nothing hit", map.white);
                    gray(map, about)
                }
                None => Ok(None),
            },
            What::Albedo => match output::albedo_map(film) {
                Some(png) => known(png?, "albedo, sRGB".into()),
                None => Ok(None),
            },
            What::Normals => match output::normal_map(film) {
                Some(png) => known(png?, "shading normals; -1 is black, 1 is white".into()),
                None => Ok(None),
            },
        }
    }
}

/// What took long to make is not lost with the disk it was meant for: tries the folder of temporary files, and adds to the
/// trouble where the file lies.
fn write_elsewhere(path: &Path, bytes: &[u8], trouble: String) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let elsewhere = std::env::temp_dir().join(format!("dapple-{}-{name}", std::process::id()));
    match write_file(&elsewhere, bytes) {
        Ok(()) => format!("{trouble}; written there instead: {}", elsewhere.display()),
        Err(_) => trouble,
    }
}

type Encoded = std::result::Result<Option<(Vec<u8>, String)>, ImageError>;

/// The maps, with their names; clusters where a sampler or a filter made some.
const MAPS: [(What, &str); 6] = [
    (What::Samples, "samples.png"),
    (What::Error, "error.png"),
    (What::Albedo, "albedo.png"),
    (What::Normals, "normals.png"),
    (What::Depth, "depth.png"),
    (What::Clusters, "clusters.png"),
];
