//! The images of one scene in the report.

use super::colour_scale::{error_ticks, sample_ticks};
use super::gallery::{Embedded, Gallery};
use super::html::{Builder, link, phrase};
use super::log_log_chart::swatch;
use super::table_cell::TableCell;
use crate::record::SceneRecord;

/// The images of one scene, with captions, as the template needs them.
pub(super) struct SceneImages {
    pub(super) budget: String,
    pub(super) exposure: String,
    pub(super) overview: Option<Embedded>,
    pub(super) marks: Vec<CropMark>,
    pub(super) reference_crops: Vec<Embedded>,
    pub(super) tiles: Vec<MethodTile>,
    /// The whole images that the viewer compares, the reference last.
    pub(super) whole: Vec<WholeImage>,
    pub(super) size: [u32; 2],
    /// The ticks of the sample maps' colour scale, as text with their places in percent; empty without maps.
    pub(super) sample_ticks: Vec<(String, f64)>,
    pub(super) error_ticks: Vec<(String, f64)>,
    pub(super) problems: Vec<String>,
}

/// A whole image of the viewer: a method's or the reference.
pub(super) struct WholeImage {
    pub(super) name: String,
    pub(super) image: Embedded,
    /// The file at full resolution, if the embedded image is smaller; empty otherwise.
    pub(super) file: String,
}

/// The rectangle of a crop in the overview image, as CSS percentages.
pub(super) struct CropMark {
    pub(super) label: &'static str,
    pub(super) place: String,
}

pub(super) struct MethodTile {
    pub(super) method: String,
    pub(super) swatch: String,
    pub(super) ratio: Option<TableCell>,
    pub(super) baseline: bool,
    pub(super) crops: Vec<(Embedded, &'static str)>,
    pub(super) error_map: Option<Embedded>,
    pub(super) sample_map: Option<Embedded>,
    /// The files of the image and of its sample map, relative to the report.
    pub(super) files: Vec<(&'static str, String)>,
}

const CROP_LABELS: [&str; 2] = ["A: where methods differ most", "B: a typical part"];

impl Builder<'_> {
    pub(super) fn view(&self, scene: &SceneRecord, gallery: Gallery) -> SceneImages {
        let manifest = &self.recorded.manifest;
        let words = gallery.budget.map(|budget| budget.to_string()).unwrap_or_default();
        let percent = |part: u32, whole: u32| 100.0 * f64::from(part) / f64::from(whole.max(1));
        let mark = |(crop, label): (&[u32; 4], &&'static str)| {
            let [w, h] = scene.resolution;
            let [x, y, cw, ch] = [percent(crop[0], w), percent(crop[1], h), percent(crop[2], w), percent(crop[3], h)];
            CropMark { label: &label[..1], place: format!("left:{x:.2}%;top:{y:.2}%;width:{cw:.2}%;height:{ch:.2}%") }
        };
        let tile = |tile: super::gallery::MethodImages| {
            let method = &manifest.methods[tile.method];
            let row = self.summary.find(&scene.name, method, &words, "relmse ratio");
            MethodTile {
                method: self.names[tile.method].clone(),
                swatch: swatch(self.styles[tile.method]),
                ratio: row.map(|row| TableCell::ratio(Some(row))),
                baseline: *method == manifest.baseline,
                crops: tile.crops.into_iter().zip(CROP_LABELS).collect(),
                error_map: tile.error_map,
                sample_map: tile.sample_map,
                files: files(tile.files),
            }
        };
        let whole = |whole: super::gallery::Whole| WholeImage {
            name: whole.method.map_or_else(|| "reference".into(), |method| self.names[method].clone()),
            image: whole.image,
            file: whole.file.as_deref().map_or_else(String::new, link),
        };
        SceneImages {
            budget: gallery.budget.map(phrase).unwrap_or_default(),
            exposure: match gallery.exposure_stops {
                0.0 => "as rendered".into(),
                stops => format!("{stops:+} stops").replace('-', "−"),
            },
            marks: gallery.crops.iter().zip(&CROP_LABELS).map(mark).collect(),
            overview: gallery.overview,
            reference_crops: gallery.reference_crops,
            tiles: gallery.tiles.into_iter().map(tile).collect(),
            whole: gallery.whole.into_iter().map(whole).collect(),
            size: gallery.size,
            sample_ticks: gallery.most.map_or_else(Vec::new, sample_ticks),
            error_ticks: error_ticks(),
            problems: gallery.problems,
        }
    }
}

/// The links of a tile: the image and the sample map, if the study has them.
fn files([image, map]: [Option<String>; 2]) -> Vec<(&'static str, String)> {
    let named = [("EXR", image), ("sample map", map)];
    named.into_iter().filter_map(|(name, file)| Some((name, link(&file?)))).collect()
}
