//! The filter `oidn`.

use crate::images::{Inputs, padded};
use crate::library::{Images, MEMORY_LIMIT_MB};
use crate::{Library, RunError};
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs, Options as _};
use std::ffi::CStr;

dapple_core::options! {
    /// The parameters of [`Oidn`].
    pub struct OidnOptions {
        /// Denoise albedo and normals first, each by a run of its own: true or false.
        pub prefilter: bool = true;
    }
}

/// Intel Open Image Denoise on the mean of each pixel's samples, guided by albedo and normals of first hits.
///
/// The crate's page describes inputs, guarantees and limits.
#[derive(Clone, Copy, Debug)]
pub struct Oidn {
    library: &'static Library,
    options: OidnOptions,
}

impl Oidn {
    /// The filter with these parameters, run by `library`.
    pub const fn new(library: &'static Library, options: OidnOptions) -> Self {
        Self { library, options }
    }

    /// Runs OIDN on one image, or on colour with its guides.
    fn run(&self, size: [usize; 2], inputs: &[(&'static CStr, &[f32])], hdr: bool) -> Result<Vec<f32>, RunError> {
        let mut output = vec![0.0; 3 * size[0] * size[1]];
        let clean = hdr && self.options.prefilter;
        let mut images = Images { size, inputs: inputs.to_vec(), output: &mut output, hdr, clean };
        self.library.denoise(&mut images, rayon::current_num_threads())?;
        match output.iter().filter(|v| !v.is_finite()).count() {
            0 => Ok(output),
            wrong => Err(RunError::NotFinite(wrong)),
        }
    }

    fn denoise(&self, inputs: &mut Inputs) -> Result<Vec<f32>, RunError> {
        if self.options.prefilter {
            inputs.albedo = self.run(inputs.size, &[(c"albedo", &inputs.albedo)], false)?;
            inputs.normal = self.run(inputs.size, &[(c"normal", &inputs.normal)], false)?;
        }
        let all: [(&CStr, &[f32]); 3] =
            [(c"color", &inputs.color), (c"albedo", &inputs.albedo), (c"normal", &inputs.normal)];
        self.run(inputs.size, &all, true)
    }
}

impl Filter for Oidn {
    fn name(&self) -> &str {
        "oidn"
    }

    fn describe(&self) -> String {
        format!("oidn:{}", self.options.describe())
    }

    fn needs(&self) -> Needs {
        Needs::none().with_features().with_emission()
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> FilterMemory {
        FilterMemory::new(frame, 0, ImagePlanes::Radiance).at_least(memory(frame))
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let Some(mut inputs) = Inputs::new(film) else {
            return Ok(Filtered::new(film.frame().size(), film.image()));
        };
        let output = self.denoise(&mut inputs).map_err(|e| Error::other(self.name(), e))?;
        Ok(inputs.image(film, &output))
    }
}

/// The peak in bytes while the library runs: planes of colour, albedo, normal and output, and the library's own memory
/// (measured with OIDN 2.5.1: some 700 bytes per pixel up to its limit, and 64 MiB of code and weights).
fn memory(frame: &Frame) -> u64 {
    const PLANES: u64 = 4 * 12;
    const WORKING: u64 = 700;
    const LOADED: u64 = 64 << 20;
    let [width, height] = padded(frame.size().map(|n| n as usize)).map(|n| n as u64);
    let pixels = width.saturating_mul(height);
    let library = pixels.saturating_mul(WORKING).min(MEMORY_LIMIT_MB << 20);
    pixels.saturating_mul(PLANES).saturating_add(library + LOADED)
}
