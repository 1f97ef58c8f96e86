//! The subcommand `dapple compare A REF`.

use crate::output::{tell, warn};
use crate::{Failure, Outcome, Result};
use dapple_metrics::{Better, Comparison, METRICS, Measurement, Metric, Pixels, WorstBlock};
use dapple_scene::files::{Disk, Files};
use dapple_scene::image::{Encoding, Image, ImageError, ImageFile, LayerQuery, Window, read_image_file};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Compare an image with its reference
///
/// Reads EXR (its main layer), PFM, Radiance HDR, PNG, JPEG and TGA. Integer values are decoded as sRGB; other colour
/// spaces are converted to Rec. 709. EXR pixels are aligned by data window; views of the same name are compared. Errors
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
    /// Layer of EXR files to compare, such as Front.Combined [default: the main one]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Print one line of JSON instead of a table
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &CompareArgs) -> Result<Outcome> {
    let layer = options.layer.as_deref();
    let image = read(&options.image, LayerQuery { layer, view: None })?;
    let view = Some(image.view.as_str()).filter(|view| !view.is_empty());
    let reference = read(&options.reference, LayerQuery { layer, view })?;
    let (image, reference) = paired(options, image, reference)?;
    let [x, r] = [pixels(&image)?, pixels(&reference)?];
    let found = Measurement::new(x, r, None).map_err(Failure::new)?;
    let value = |metric: &'static Metric| Ok((metric, (metric.of)(&found).map_err(Failure::new)?));
    let values = METRICS.iter().map(value).collect::<Result<Vec<(&Metric, f64)>>>()?;
    let found = found.comparison;
    if found.non_finite > 0 {
        let name = options.image.display();
        warn(format!("{name}: {} channel values are NaN or infinite; every metric counts them as 0", found.non_finite));
    }
    tell(if options.json { line(&values, &found) } else { table(&values, &found) })?;
    Ok(Outcome::Done)
}

fn pixels(image: &Image) -> Result<Pixels<'_>> {
    Pixels::new(image.size, &image.pixels).map_err(Failure::new)
}

fn read(path: &Path, wanted: LayerQuery<'_>) -> Result<ImageFile> {
    let name = path.display().to_string();
    let bytes = Disk
        .read(path)
        .map_err(|e| Failure::new(format!("{name}: cannot read the image: {e}; check the file name")))?;
    let file = read_image_file(&bytes, &name, Encoding::Auto, wanted).map_err(|error| match error {
        ImageError::Ambiguous { .. } => Failure::new(format!("{error}, or choose one with --layer NAME")),
        error => Failure::new(error),
    })?;
    file.notices.iter().for_each(|notice| warn(format!("{name}: {notice}")));
    Ok(file)
}

/// Checks that both images have the same view and the same display window, and crops them to their common pixels, with a
/// warning.
fn paired(options: &CompareArgs, image: ImageFile, reference: ImageFile) -> Result<(Image, Image)> {
    let [name, other_name] = [&options.image, &options.reference].map(|path| path.display());
    if image.view != reference.view && !image.view.is_empty() && !reference.view.is_empty() {
        let what = format!("{name} shows view \"{}\", but {other_name} shows view \"{}\"", image.view, reference.view);
        return Err(Failure::new(format!("{what}; compare images of the same view")));
    }
    let windows = [windows(&image, &reference), windows(&reference, &image)];
    let [(own, display), (other, other_display)] = windows;
    let displays_differ = display.size != other_display.size;
    // Images of different sizes are refused with the sizes.
    if own == other || (displays_differ && own.size != other.size) {
        return Ok((image.image, reference.image));
    }
    if displays_differ {
        let what = |own: Window, display: Window| format!("pixels {own} of display window {display}");
        let both = format!("{name} has {}, but {other_name} has {}", what(own, display), what(other, other_display));
        return Err(Failure::new(format!("{both}; save both with the same display window")));
    }
    let Some(common) = own.common(other) else {
        let what = format!("{name} (pixels {own}) and {other_name} (pixels {other}) have no pixel in common");
        return Err(Failure::new(format!("{what}; render both with the same data window")));
    };
    warn(format!("{name} has pixels {own}, {other_name} has {other}; only the common pixels {common} are compared"));
    let cut = |image: Image, window: Window| Image::new(common.size, window.cut(&image.pixels, common));
    Ok((cut(image.image, own).map_err(Failure::new)?, cut(reference.image, other).map_err(Failure::new)?))
}

/// The data window and the display window of an image. A file without windows gets the window of the other image that has the
/// file's size.
fn windows(image: &ImageFile, other: &ImageFile) -> (Window, Window) {
    let size = image.image.size;
    match (image.window, other.window) {
        (Some([data, display]), _) => (data, display),
        (None, Some([_, display])) if display.size == size => (display, display),
        (None, Some([data, display])) if data.size == size => (data, display),
        _ => (Window { origin: [0, 0], size }, Window { origin: [0, 0], size }),
    }
}

/// The printed line of JSON: the metrics by name, then the location of the errors.
fn line(values: &[(&Metric, f64)], c: &Comparison) -> String {
    let WorstBlock { position, size, rel_mse, .. } = c.worst_block;
    let mut line = json!({
        "channel_ratios": c.channel_ratios,
        "non_finite": c.non_finite,
        "worst_block": { "position": position, "size": size, "relmse": rel_mse },
    });
    values.iter().for_each(|(metric, value)| line[metric.name] = json!(value));
    line.to_string()
}

fn table(values: &[(&Metric, f64)], c: &Comparison) -> String {
    let metric = |(metric, value): &(&Metric, f64)| {
        let value = match metric.better {
            Better::Lower => figure(*value),
            Better::Higher => format!("{value:.2}"),
            Better::NearOne => format!("{value:.6}"),
        };
        [metric.label.to_owned(), value, metric.doc.to_owned()]
    };
    let WorstBlock { position: [x, y], size: [w, h], rel_mse, .. } = c.worst_block;
    let [r, g, b] = c.channel_ratios;
    let places = [
        ["worst block", &figure(rel_mse), &format!("relMSE of {w}x{h} pixels at column {x}, row {y}")],
        ["by channel", "", &format!("red {r:.6}, green {g:.6}, blue {b:.6}")],
    ];
    let rows = values.iter().map(metric).chain(places.map(|row| row.map(str::to_owned)));
    let row = |[name, value, about]: [String; 3]| format!("{name:<16}{value:<12}{about}").trim_end().to_owned();
    rows.map(row).collect::<Vec<_>>().join("\n")
}

/// Formats a number with five significant digits.
fn figure(x: f64) -> String {
    if x == 0.0 || (1e-4..1e5).contains(&x) { format!("{x:.*}", decimals(x)) } else { format!("{x:.4e}") }
}

fn decimals(x: f64) -> usize {
    if x == 0.0 { 0 } else { (4 - x.log10().floor() as i32).max(0) as usize }
}
