//! The filters `oidn` and `oidn-blend`.

use crate::images::{Inputs, padded};
use crate::library::{Images, MEMORY_LIMIT_MB};
use crate::{Library, RunError};
use dapple_core::filter::{FilterMemory, ImagePlanes};
use dapple_core::options::Options as _;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs};
use std::ffi::CStr;

dapple_core::options! {
    /// The parameters of [`Oidn`].
    pub struct OidnOptions {
        /// true: denoise albedo and normals first; false: use them as they are.
        pub prefilter: bool = true;
    }
}

/// Intel Open Image Denoise on the mean of each pixel's samples, guided by albedo and normals of first non-specular surfaces.
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

    /// Runs OIDN on one image, or on colour guided by albedo and normals.
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
/// (measured with OIDN 2.5.1: about 700 bytes per pixel up to its limit, and 64 MiB of code and weights).
fn memory(frame: &Frame) -> u64 {
    const PLANES: u64 = 4 * 12;
    const WORKING: u64 = 700;
    const LOADED: u64 = 64 << 20;
    let [width, height] = padded(frame.size().map(|n| n as usize)).map(|n| n as u64);
    let pixels = width.saturating_mul(height);
    let library = pixels.saturating_mul(WORKING).min(MEMORY_LIMIT_MB << 20);
    pixels.saturating_mul(PLANES).saturating_add(library + LOADED)
}

/// The plain mean of the images of [`Oidn`] and of another filter.
///
/// Filters of different kinds have different errors. On nine scenes at 1 to 8 adaptive samples per pixel, the mean of OIDN and
/// `cluster-regression` has less sRGB MSE of means of 4x4 pixels than either (docs/results/tables/race-480x270.csv).
/// Above about 64 samples per pixel, the other filter alone may be better in fine detail.
///
/// There is no error estimate, since the error of OIDN's image is unknown.
pub struct OidnBlend<F> {
    oidn: Oidn,
    other: F,
}

impl<F: Filter> OidnBlend<F> {
    /// The mean of the images of `oidn` and `other`.
    pub const fn new(oidn: Oidn, other: F) -> Self {
        Self { oidn, other }
    }
}

impl<F: Filter> Filter for OidnBlend<F> {
    fn name(&self) -> &str {
        "oidn-blend"
    }

    /// The filter's name, the parameters of OIDN, and those of the other filter.
    fn describe(&self) -> String {
        let parameters = [self.oidn.describe(), self.other.describe()];
        let parameters: Vec<&str> = parameters.iter().filter_map(|d| d.split_once(':')).map(|d| d.1).collect();
        format!("oidn-blend:{}", parameters.join(","))
    }

    fn needs(&self) -> Needs {
        self.oidn.needs().and(self.other.needs())
    }

    /// The filters run one after the other. The image of the first stays in memory while the second runs.
    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let [oidn, other] = [self.oidn.memory(frame, needs), self.other.memory(frame, needs)];
        let planes = FilterMemory::new(frame, 0, ImagePlanes::Radiance);
        planes.at_least(other.applying).at_least(planes.image.saturating_add(oidn.applying))
    }

    fn runs(&self, needs: &Needs, spp: f64) -> u32 {
        self.other.runs(needs, spp)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        film.require(self.name(), &self.needs())?;
        let Filtered { size, radiance: mut mean, .. } = self.other.apply(film)?;
        let oidn = self.oidn.apply(film)?;
        for (mean, oidn) in mean.iter_mut().zip(&oidn.radiance) {
            // Halves first: a sum may exceed the largest float.
            *mean = [0, 1, 2].map(|c| 0.5 * mean[c] + 0.5 * oidn[c]);
        }
        Ok(Filtered::new(size, mean))
    }
}
