//! The filter `both`.

use crate::Oidn;
use dapple_core::{Error, Film, Filter, FilterMemory, Filtered, Frame, ImagePlanes, Needs};

/// The plain mean of the images of [`Oidn`] and of another filter.
///
/// Filters of different kinds make different errors. With `cluster-regression` on adaptive counts, the mean had less error
/// than either image on nine of ten measured images (docs/results/oidn.md). Above some 64 samples per pixel, the other
/// filter alone may be better where there is fine detail.
///
/// There is no estimate of the mean's error: that of OIDN's image is unknown.
pub struct Both<F> {
    oidn: Oidn,
    other: F,
}

impl<F: Filter> Both<F> {
    /// The mean of the images of `oidn` and `other`.
    pub const fn new(oidn: Oidn, other: F) -> Self {
        Self { oidn, other }
    }
}

impl<F: Filter> Filter for Both<F> {
    fn name(&self) -> &str {
        "both"
    }

    /// The name, the parameters of OIDN, then those of the other filter.
    fn describe(&self) -> String {
        let parameters = [self.oidn.describe(), self.other.describe()];
        let parameters: Vec<&str> = parameters.iter().filter_map(|d| d.split_once(':')).map(|d| d.1).collect();
        format!("both:{}", parameters.join(","))
    }

    fn needs(&self) -> Needs {
        self.oidn.needs().and(self.other.needs())
    }

    /// The filters run one after the other, so that the second runs beside the image of the first.
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
