//! Files of denoised images.

use super::{DenoiseError, DenoiseSpec, DenoisedImage};
use crate::output::FileIdentity;
use dapple_scene::image::{Format, Image, Layer, check_writable, encode_exr, encode_pfm, encode_png, write_file};
use std::path::{Path, PathBuf};

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

impl DenoisedImage {
    /// Writes the image: EXR with an error layer, PFM, or PNG as sRGB with this exposure in stops. Returns a line about
    /// the file.
    ///
    /// # Errors
    ///
    /// [`DenoiseError::Image`] for a file that cannot be written.
    pub fn write(&self, spec: &DenoiseSpec, path: &Path, exposure: f32) -> Result<String, DenoiseError> {
        let image = Image::new(self.filtered.size, self.filtered.radiance.clone())?;
        let (bytes, about) = match Format::from_path(path)? {
            Format::Exr => (self.exr(spec, &image)?, "the image, with its estimated squared error"),
            Format::Pfm => (encode_pfm(&image)?, "the image"),
            Format::Png => (encode_png(&image, exposure)?, "the image, sRGB"),
        };
        write_file(path, &bytes)?;
        Ok(format!("{}: {about}", path.display()))
    }

    fn exr(&self, spec: &DenoiseSpec, image: &Image) -> Result<Vec<u8>, DenoiseError> {
        let mut layers = vec![Layer::of_image("", image)];
        if let Some(error) = &self.filtered.error {
            layers.push(Layer { name: "error".into(), channels: vec![("Y", error.clone().into())] });
        }
        let inputs: Vec<String> = spec.inputs.iter().map(|path| path.display().to_string()).collect();
        let found: Vec<String> = self.found.iter().map(|(kind, name)| format!("{}={name}", kind.name())).collect();
        let attributes = [
            ("dapple:version", env!("CARGO_PKG_VERSION").to_owned()),
            ("dapple:filter", self.filter.clone()),
            ("dapple:inputs", inputs.join("\n")),
            ("dapple:layers", found.join("\n")),
        ];
        let attributes: Vec<(String, String)> = attributes.map(|(key, value)| (key.to_owned(), value)).into();
        Ok(encode_exr(image.size, &layers, &attributes)?.bytes)
    }
}
