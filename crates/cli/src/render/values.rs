//! Parsers of the values of options.

use crate::failure;
use clap::builder::{PathBufValueParser, PossibleValue, PossibleValuesParser, TypedValueParser};
use dapple_job::output::layer_names;
use dapple_job::{ErrorOf, MOST_SECONDS, PixelFilterSpec, registry};
use dapple_renderer::light::LightSelection;
use dapple_scene::image::Format;
use std::path::{Path, PathBuf};

type Parsed<T> = std::result::Result<T, String>;

/// A parser of names, each with its help and its value.
fn choice<T: Copy + Send + Sync + 'static>(
    all: [(&'static str, &'static str, T); 2],
) -> impl TypedValueParser<Value = T> {
    let names = all.map(|(name, help, _)| PossibleValue::new(name).help(help));
    let value =
        move |given: String| all.iter().find(|(name, ..)| *name == given).map_or(all[0].2, |(.., value)| *value);
    PossibleValuesParser::new(names).map(value)
}

/// The parser of `--pixel-filter`.
pub(crate) fn pixel_filter() -> impl TypedValueParser<Value = PixelFilterSpec> {
    let scene = ("scene", "The scene file's pixel filter", PixelFilterSpec::Scene);
    choice([scene, ("box", "A box one pixel wide", PixelFilterSpec::Box)])
}

/// The parser of `--error-of`, which selects the image that `--error` concerns.
pub(crate) fn error_of() -> impl TypedValueParser<Value = ErrorOf> {
    let filtered = ("filtered", "The filtered image", ErrorOf::Filtered);
    choice([filtered, ("unfiltered", "The image before the filter", ErrorOf::Unfiltered)])
}

pub(crate) fn light_selection(name: &str) -> Parsed<LightSelection> {
    name.parse().map_err(|e: dapple_renderer::light::UnknownLightSelection| e.to_string())
}

pub(crate) fn above_zero(text: &str) -> Parsed<f64> {
    let given = text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
    given.ok_or_else(|| "a finite number above zero is required".into())
}

pub(crate) fn seconds(text: &str) -> Parsed<f64> {
    let given = Some(above_zero(text)?).filter(|x| *x <= MOST_SECONDS);
    given.ok_or_else(|| format!("at most {MOST_SECONDS} seconds (a year) are allowed"))
}

pub(crate) fn stops(text: &str) -> Parsed<f32> {
    let given = text.parse().ok().filter(|x: &f32| x.is_finite());
    given.ok_or_else(|| "a finite number is required, 0 to leave the image as it is".into())
}

pub(crate) fn resolution(text: &str) -> Parsed<[u32; 2]> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let sides: [u32; 2] = sides.ok_or("WIDTHxHEIGHT in pixels is required, such as 640x360")?;
    dapple_core::Frame::new(sides[0], sides[1]).map_err(|e| e.to_string())?;
    Ok(sides)
}

/// The size of the full image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ImageSize {
    Pixels([u32; 2]),
    /// The scene's width and height times this factor.
    Scale(f64),
}

pub(crate) fn size_of_image(text: &str) -> Parsed<ImageSize> {
    match text.strip_suffix('%') {
        None => resolution(text).map(ImageSize::Pixels).map_err(|e| e.replace("640x360", "640x360 or 50%")),
        Some(percent) => above_zero(percent.trim())
            .map(|percent| ImageSize::Scale(percent / 100.0))
            .map_err(|_| "a percentage above zero is required, such as 50%".into()),
    }
}

/// A layer of EXR files by its name, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EachLayer(pub(crate) Option<&'static str>);

pub(crate) fn layer(text: &str) -> Parsed<EachLayer> {
    let known = layer_names().map(Some).chain([None]).find(|name| name.unwrap_or("none") == text.trim());
    let all = || layer_names().collect::<Vec<_>>().join(", ");
    known.map(EachLayer).ok_or_else(|| format!("there is no layer \"{text}\"; choose among {}, or none", all()))
}

pub(crate) fn crop(text: &str) -> Parsed<[u32; 4]> {
    let sides: Option<Vec<u32>> = text.split(',').map(|side| side.trim().parse().ok()).collect();
    match sides.as_deref() {
        Some(&[x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok([x0, y0, x1, y1]),
        Some([_, _, _, _]) => Err("the window is empty: X0 < X1 and Y0 < Y1 are required".into()),
        _ => Err("X0,Y0,X1,Y1 in pixels are required, such as 0,0,64,32".into()),
    }
}

pub(crate) fn output() -> impl TypedValueParser<Value = PathBuf> {
    let check = |path: PathBuf| {
        // Parts of images, and plans of images.
        if !["shard", "plan", "part"].iter().any(|kind| has_extension(&path, kind)) {
            Format::from_path(&path).map_err(|e| e.to_string())?;
        }
        Parsed::Ok(path)
    };
    PathBufValueParser::new().try_map(check)
}

pub(crate) fn preview() -> impl TypedValueParser<Value = PathBuf> {
    let check = |path: PathBuf| match Format::from_path(&path) {
        Ok(Format::Png) => Ok(path),
        _ => Err("a file name that ends in .png is required"),
    };
    PathBufValueParser::new().try_map(check)
}

/// Returns `true` for a file name with this extension, in lower or upper case.
pub(crate) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// Parses a memory size: bytes, or a number with a unit such as K, M or G (powers of 1024).
pub(crate) fn size(text: &str) -> Parsed<u64> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match text[number.len()..].to_ascii_uppercase().as_str() {
        "" | "B" => 1,
        "K" | "KB" | "KIB" => 1 << 10,
        "M" | "MB" | "MIB" => 1 << 20,
        "G" | "GB" | "GIB" => 1 << 30,
        "T" | "TB" | "TIB" => 1u64 << 40,
        _ => 0,
    };
    let number = above_zero(number).ok().filter(|_| unit > 0).map(|x| (x * unit as f64) as u64);
    number.ok_or_else(|| "a size above zero is required, such as 2G, 500M or 1000000 (1K is 1024 bytes)".into())
}

/// Checks the name of a sampler by making one, so that a wrong name is reported before the scene is read.
pub(crate) fn sampler(name: &str) -> Parsed<String> {
    registry::check_sampler(name).map(|()| name.to_owned()).map_err(|e| failure::sampler(name, &e))
}

pub(crate) fn points(name: &str) -> Parsed<String> {
    registry::check_points(name).map(|()| name.to_owned()).map_err(|e| failure::points(name, &e))
}

pub(crate) fn filter(name: &str) -> Parsed<String> {
    registry::check_filter(name).map(|()| name.to_owned()).map_err(|e| failure::filter(name, &e))
}

pub(crate) fn integrator(name: &str) -> Parsed<String> {
    let checked = dapple_job::check_integrator(name).map(|()| name.to_owned());
    checked.map_err(|e| failure::integrator(name, &e.to_string()))
}
