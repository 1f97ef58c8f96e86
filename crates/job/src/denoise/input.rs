//! An input file, and the choice of the images to denoise.

use super::{DenoiseError, DenoiseSpec, LayerKind};
use dapple_core::options::nearest_name;
use dapple_scene::image::{ExrFile, FoundLayer, Layers, NoImage, Purpose, Window};
use std::path::{Path, PathBuf};

/// One file with its layers.
pub(super) struct Input {
    pub(super) path: PathBuf,
    pub(super) file: ExrFile<'static>,
    pub(super) layers: Layers,
}

impl Input {
    pub(super) fn read(path: &Path) -> Result<Self, DenoiseError> {
        let open = |source| DenoiseError::Open { path: path.to_owned(), source };
        let bytes = std::fs::read(path).map_err(open)?;
        if !bytes.starts_with(b"\x76\x2f\x31\x01") {
            return Err(DenoiseError::NotExr { path: path.to_owned() });
        }
        let file = ExrFile::open(bytes, &path.display().to_string())?;
        let layers = Layers::of(&file.parts);
        Ok(Self { path: path.to_owned(), file, layers })
    }

    /// The number of samples per pixel of `image`, as stated in the file's header.
    pub(super) fn spp(&self, image: &FoundLayer) -> Option<u32> {
        let parts = [image.part].into_iter().chain(0..self.file.parts.len());
        let attributes = parts.map(|part| (self.file.integers(part), self.file.texts(part)));
        // pbrt-v4 writes a number, Cycles a text `cycles.LAYER.samples`.
        let spp = attributes.into_iter().find_map(|(numbers, texts)| {
            let number = numbers.iter().find(|(key, _)| key == "samplesPerPixel");
            let view_layer = image.name.split('.').next().unwrap_or_default();
            let own = format!("cycles.{view_layer}.samples");
            let of_cycles = |(key, _): &&(String, String)| key.starts_with("cycles.") && key.ends_with(".samples");
            let text = texts.iter().find(|(key, _)| *key == own).or_else(|| texts.iter().find(of_cycles));
            number.and_then(|(_, n)| u32::try_from(*n).ok()).or_else(|| text?.1.parse().ok())
        });
        spp.filter(|n| *n > 0)
    }

    /// The data window of a layer.
    pub(super) fn window(&self, layer: &FoundLayer) -> Window {
        self.file.parts[layer.part].data_window
    }

    /// The values of a channel in a window.
    pub(super) fn floats(&self, part: usize, channel: usize, window: Window) -> Result<Vec<f32>, DenoiseError> {
        let values = self.file.planes(part)?[channel].floats();
        Ok(self.file.parts[part].data_window.cut(&values, window))
    }

    /// The error about a layer that lacks the channels of its kind.
    pub(super) fn wrong_channels(&self, kind: LayerKind, name: &str) -> DenoiseError {
        let letters = self.layers.letters(name);
        DenoiseError::LayerChannels { path: self.path.clone(), kind, name: name.to_owned(), letters }
    }

    /// Finds the layer that the caller names.
    pub(super) fn given(&self, kind: LayerKind, name: &str) -> Result<FoundLayer, DenoiseError> {
        if let Some(found) = self.layers.given(kind, name) {
            return Ok(found);
        }
        if !self.layers.letters(name).is_empty() {
            return Err(self.wrong_channels(kind, name));
        }
        let (path, name) = (self.path.clone(), name.to_owned());
        let layers = self.layers.names();
        let near = nearest_name(&name, layers.iter().map(String::as_str)).map(str::to_owned);
        Err(DenoiseError::NoLayer { path, kind, name, near, layers })
    }
}

/// The images to denoise.
pub(super) struct Images {
    /// The layer of each view in each file; all files hold all of these views.
    pub(super) views: Vec<Vec<FoundLayer>>,
    pub(super) notices: Vec<String>,
}

impl Images {
    /// Chooses an image of the first file, in all its views, and finds the same layers in the other file.
    pub(super) fn choose(spec: &DenoiseSpec, inputs: &[Input]) -> Result<Self, DenoiseError> {
        let given = spec.layers.iter().find(|(kind, _)| *kind == LayerKind::Color);
        let mut notices = Vec::new();
        let image = match given {
            Some((_, name)) => inputs[0].given(LayerKind::Color, name)?,
            None => chosen(&inputs[0], &mut notices)?,
        };
        let (mut views, missing) = inputs[0].layers.in_all_views(&image);
        let mut kept: Vec<String> = missing.iter().map(|view| format!("view \"{view}\"")).collect();
        if given.is_some() {
            kept.extend(views.drain(1..).map(|layer| format!("layer \"{}\"", layer.shown())));
        }
        let mut found = Vec::new();
        for layer in views {
            let mut in_files = vec![layer.clone()];
            for input in &inputs[1..] {
                let same = input.layers.same(&layer, &inputs[0].layers);
                match same {
                    Some(same) => in_files.push(same),
                    None if found.is_empty() && given.is_none() => in_files.push(chosen(input, &mut notices)?),
                    None if found.is_empty() => in_files.push(input.given(LayerKind::Color, &layer.name)?),
                    None => {}
                }
            }
            if in_files.len() == inputs.len() {
                found.push(in_files);
            } else {
                kept.push(format!("layer \"{}\"", layer.shown()));
            }
        }
        if !kept.is_empty() {
            notices.push(format!(
                "{}: {} is not denoised, since the other file has no such layer",
                inputs[0].path.display(),
                kept.join(", ")
            ));
        }
        found.iter().try_for_each(|layers| check(inputs, layers))?;
        notices.extend(found.first().and_then(|layers| lost_alpha(inputs, layers)));
        Ok(Self { views: found, notices })
    }
}

/// Chooses the image of a file by known names.
fn chosen(input: &Input, notices: &mut Vec<String>) -> Result<FoundLayer, DenoiseError> {
    let path = || input.path.clone();
    let choice = input.layers.image(Purpose::Denoising, |layer| input.file.is_zero(layer))?;
    let chosen = choice.map_err(|why| match why {
        NoImage::Ambiguous(layers) => DenoiseError::Ambiguous { path: path(), layers },
        NoImage::Missing => {
            let names = input.file.parts.iter().flat_map(|part| &part.channels);
            DenoiseError::NoImage { path: path(), channels: names.map(|channel| channel.name.clone()).collect() }
        }
    })?;
    let (name, shown) = (input.path.display(), chosen.layer.shown());
    let empty = |layer: &String| format!("{name}: layer \"{layer}\" is 0 everywhere; \"{shown}\" is denoised instead");
    notices.extend(chosen.empty.iter().map(empty));
    if !chosen.others.is_empty() {
        let others = chosen.others.join("\", \"");
        notices.push(format!(
            "{name}: \"{shown}\" is denoised, \"{others}\" is not; --layer color=NAME selects another image"
        ));
    }
    Ok(chosen.layer)
}

/// A notice if only the second file has alpha.
fn lost_alpha(inputs: &[Input], layers: &[FoundLayer]) -> Option<String> {
    let ([a, b], [in_a, in_b]) = (inputs, layers) else { return None };
    let has = |input: &Input, layer| input.layers.alpha(&input.layers.shown_beside(layer)).is_some();
    let (a_path, b_path) = (a.path.display(), b.path.display());
    let what =
        || format!("{b_path}: its alpha is dropped, since {a_path} has none; give {b_path} first to keep the alpha");
    (has(b, in_b) && !has(a, in_a)).then(what)
}

/// Checks that two files show the same view in the same size and colour space.
fn check(inputs: &[Input], layers: &[FoundLayer]) -> Result<(), DenoiseError> {
    let ([a, b], [in_a, in_b]) = (inputs, layers) else { return Ok(()) };
    let paths = || Box::new([a.path.clone(), b.path.clone()]);
    if in_a.view != in_b.view && !in_a.view.is_empty() && !in_b.view.is_empty() {
        return Err(DenoiseError::Views { paths: paths(), views: Box::new([in_a.view.clone(), in_b.view.clone()]) });
    }
    let parts = [&a.file.parts[in_a.part], &b.file.parts[in_b.part]];
    let sizes = parts.map(|part| part.display_window.size);
    if sizes[0] != sizes[1] && parts[0].data_window != parts[1].data_window {
        return Err(DenoiseError::Sizes { paths: paths(), sizes });
    }
    let spaces = parts.map(|part| part.color_space());
    if !spaces[0].is_same(spaces[1]) {
        return Err(DenoiseError::ColorSpaces { paths: paths(), spaces: Box::new(spaces) });
    }
    Ok(())
}
