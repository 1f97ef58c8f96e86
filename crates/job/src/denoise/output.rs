//! Writing of a denoised image: as a copy of the first input with the image replaced, or as the image alone.

use super::input::Input;
use super::{DenoiseError, DenoiseSpec, DenoisedImage, DenoisedView};
use dapple_core::Filtered;
use dapple_scene::image::{
    Chromaticities, ExrEdit, Format, FoundLayer, Image, Plane, RewrittenExr, Window, encode_pfm, encode_png, write_file,
};
use std::path::Path;

/// A file that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenImage {
    /// One line that describes the file.
    pub about: String,
    /// Notices about data that the file lacks; one sentence each.
    pub notices: Vec<String>,
}

/// The channels of the first input that hold a view's image.
#[derive(Clone, Debug)]
pub(super) struct Target {
    part: usize,
    window: Window,
    display: Window,
    /// The names of the three colour channels, or of the single gray channel.
    channels: Vec<String>,
    /// The name and the values of the alpha channel, averaged over two files; `None` leaves the first input's alpha unchanged.
    alpha: Option<(String, Vec<f32>)>,
    /// `true` if some pixel is not opaque.
    transparent: bool,
    /// The name of the channel for the estimated error.
    error: String,
    pub(super) space: Chromaticities,
}

impl Target {
    /// Finds the channels of the image that was read from the layers `colors`.
    pub(super) fn of(inputs: &[Input], colors: &[FoundLayer], window: Window) -> Result<Self, DenoiseError> {
        let (first, image) = (&inputs[0], inputs[0].layers.shown_beside(&colors[0]));
        let about = &first.file.parts[image.part];
        let name = |channel: usize| about.channels[channel].name.clone();
        let mut indices = image.channels.clone();
        indices.dedup();
        let (mut alpha, mut transparent) = (None, false);
        if let Some(channel) = first.layers.alpha(&image) {
            let a = first.floats(image.part, channel, window)?;
            transparent = a.iter().any(|&a| a != 1.0);
            let other = inputs.get(1).map(|second| (second, second.layers.shown_beside(&colors[1])));
            let other = other.and_then(|(second, beside)| Some((second, beside.part, second.layers.alpha(&beside)?)));
            if let Some((second, part, other)) = other {
                let b = second.floats(part, other, window)?;
                alpha = Some((name(channel), a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect()));
            }
        }
        let error = first.layers.channel_beside(&image, about, "error", "Y");
        let channels = indices.into_iter().map(name).collect();
        let (display, space) = (about.display_window, about.color_space());
        Ok(Self { part: image.part, window, display, channels, alpha, transparent, error, space })
    }

    fn edit<'a>(&'a self, filtered: &'a Filtered) -> ExrEdit<'a> {
        let plane = |of: &dyn Fn(&[f32; 3]) -> f32| Plane::F32(filtered.radiance.iter().map(of).collect());
        let mut channels: Vec<(String, Plane<'a>)> = match &self.channels[..] {
            [grey] => vec![(grey.clone(), plane(&|pixel| (pixel[0] + pixel[1] + pixel[2]) / 3.0))],
            names => names.iter().enumerate().map(|(c, name)| (name.clone(), plane(&|pixel| pixel[c]))).collect(),
        };
        channels.extend(self.alpha.iter().map(|(name, values)| (name.clone(), values[..].into())));
        channels.extend(filtered.error.iter().map(|error| (self.error.clone(), error[..].into())));
        ExrEdit { part: self.part, window: self.window, channels }
    }
}

impl DenoisedImage {
    /// Writes the image to `path`. An EXR file is a copy of the first input, with all views denoised and an error layer added.
    /// PFM and PNG files hold only the first view, in Rec. 709. PNG is encoded as sRGB, at an `exposure` in stops.
    ///
    /// # Errors
    ///
    /// [`DenoiseError::Image`] for a file that cannot be written.
    pub fn write(&self, spec: &DenoiseSpec, path: &Path, exposure: f32) -> Result<WrittenImage, DenoiseError> {
        let mut notices = Vec::new();
        let (bytes, about) = match Format::from_path(path)? {
            Format::Exr => {
                let rewritten = self.exr(spec)?;
                notices.extend(rewritten.notices.iter().map(|notice| format!("{}: {notice}", path.display())));
                (rewritten.bytes, "the image, its estimated squared error, and everything else in the first input")
            }
            Format::Pfm => (encode_pfm(&self.rec709()?)?, "the image"),
            Format::Png => (encode_png(&self.rec709()?, exposure)?, "the image, sRGB"),
        };
        if Format::from_path(path)? != Format::Exr {
            notices.extend(self.left_out().into_iter().map(|notice| format!("{}: {notice}", path.display())));
        }
        write_file(path, &bytes)?;
        Ok(WrittenImage { about: format!("{}: {about}", path.display()), notices })
    }

    /// Notices about data that PFM and PNG files lack.
    fn left_out(&self) -> Vec<String> {
        let views = (self.views.len() > 1).then(|| format!("the file holds only view \"{}\"", self.views[0].view));
        let alpha = self.views[0].target.transparent.then(|| "the file has no alpha".to_owned());
        let Target { window, display, space, .. } = &self.views[0].target;
        let cut = (window != display)
            .then(|| format!("the file holds pixels {window}, not the whole display window {display}"));
        let is_space = space.is_same(Chromaticities::REC709) || space.convert_to_rec709(&mut []);
        let space = (!is_space).then(|| {
            format!(
                "its colours are not converted, because the input's chromaticities ({space}) define no colour space"
            )
        });
        views
            .into_iter()
            .chain(alpha)
            .chain(cut)
            .chain(space)
            .map(|what| format!("{what}; write an EXR file as well"))
            .collect()
    }

    /// The image of the first view, in Rec. 709.
    fn rec709(&self) -> Result<Image, DenoiseError> {
        let DenoisedView { filtered, target, .. } = &self.views[0];
        let mut image = Image::new(filtered.size, filtered.radiance.clone())?;
        if !target.space.is_same(Chromaticities::REC709) {
            target.space.convert_to_rec709(&mut image.pixels);
        }
        Ok(image)
    }

    fn exr(&self, spec: &DenoiseSpec) -> Result<RewrittenExr, DenoiseError> {
        let edits: Vec<ExrEdit<'_>> = self.views.iter().map(|view| view.target.edit(&view.filtered)).collect();
        let inputs: Vec<String> = spec.inputs.iter().map(|path| path.display().to_string()).collect();
        let found = self.views.iter().flat_map(|view| &view.found);
        let found: Vec<String> = found.map(|(kind, name)| format!("{}={name}", kind.name())).collect();
        let attributes = [
            ("dapple:version", env!("CARGO_PKG_VERSION").to_owned()),
            ("dapple:filter", self.filter.clone()),
            ("dapple:inputs", inputs.join("\n")),
            ("dapple:layers", found.join("\n")),
        ];
        let attributes: Vec<(String, String)> = attributes.map(|(key, value)| (key.to_owned(), value)).into();
        let mut rewritten = self.original.rewritten(&edits, &attributes)?;
        for Target { part, error, .. } in self.views.iter().map(|view| &view.target) {
            if self.original.parts[*part].channels.iter().any(|channel| channel.name == *error) {
                rewritten.notices.push(format!("channel \"{error}\" of the input is replaced by the estimated error"));
            }
        }
        Ok(rewritten)
    }
}
