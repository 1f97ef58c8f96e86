//! Images from films.

use crate::forward::forward;
use crate::{Error, Film, FilterMemory, Frame, ImagePlanes, Needs, Recorder};
use std::ops::Range;
use std::sync::Arc;

/// An image that a filter (denoiser) made from a film.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub struct Filtered {
    /// Width and height of the frame's rendered window, in pixels.
    pub size: [u32; 2],
    /// Linear RGB radiance, row by row from the top.
    pub radiance: Vec<[f32; 3]>,
    /// The estimated squared error of each pixel (mean over the channels), if the filter estimates one.
    pub error: Option<Vec<f32>>,
}

impl Filtered {
    /// An image of width and height `size` with these pixels, without error estimates.
    pub fn new(size: [u32; 2], radiance: Vec<[f32; 3]>) -> Self {
        Self { size, radiance, error: None }
    }

    /// Sets the estimated squared error of each pixel: a `Vec`, or an `Option` of one.
    #[must_use]
    pub fn with_error(self, error: impl Into<Option<Vec<f32>>>) -> Self {
        Self { error: error.into(), ..self }
    }
}

/// A filter (the denoiser; not the pixel filter): makes an image from a film, and optionally an error estimate per
/// pixel.
///
/// A filter works on per-pixel means, not on samples at positions, so that unequal sample counts do not move edges.
/// Implementations must pass `dapple_conformance::filter`.
///
/// ```
/// use dapple_core::{Error, Film, Filter, Filtered, Frame, Needs, Unfiltered};
///
/// /// Shows which share of the samples each pixel got.
/// struct Density;
///
/// impl Filter for Density {
///     fn name(&self) -> &str {
///         "density"
///     }
///
///     fn apply(&self, film: &Film) -> Result<Filtered, Error> {
///         let all = film.record().samples.max(1) as f32;
///         let radiance = film.counts().iter().map(|&n| [n as f32 / all; 3]).collect();
///         Ok(Filtered::new(film.frame().size(), radiance))
///     }
/// }
///
/// let mut film = Film::new(Frame::new(2, 1)?, Needs::none());
/// (0..3).for_each(|_| film.push(0, 0, [0.5; 3]));
/// film.push(1, 0, [0.25; 3]);
/// assert_eq!(Density.apply(&film)?.radiance, [[0.75; 3], [0.25; 3]]);
/// assert_eq!(Unfiltered.apply(&film)?.radiance, [[0.5; 3], [0.25; 3]]);
/// # Ok::<(), Error>(())
/// ```
pub trait Filter: Send + Sync {
    /// The filter's short name on the command line.
    fn name(&self) -> &str;

    /// The filter's name and every parameter, for headers and reports.
    fn describe(&self) -> String {
        self.name().to_owned()
    }

    /// The statistics that the filter reads from the film.
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// The recorders of statistics that this filter alone reads from the film.
    fn recorders(&self) -> Vec<Arc<dyn Recorder>> {
        Vec::new()
    }

    /// The memory in bytes that [`Filter::apply`] takes for a film of this frame that records `needs`. The default
    /// assumes a filter that holds only its image and an error per pixel.
    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let _ = needs;
        FilterMemory::new(frame, 0, ImagePlanes::RadianceAndError)
    }

    /// The number of times that [`Filter::apply`] goes through a film that records `needs` with `spp` samples per pixel. A time
    /// limit measures the filter on few samples and reserves its time in proportion.
    fn runs(&self, needs: &Needs, spp: f64) -> u32 {
        let _ = (needs, spp);
        1
    }

    /// Makes the filtered image. Pixels without samples are black.
    ///
    /// # Errors
    ///
    /// If the film lacks statistics that the filter reads.
    fn apply(&self, film: &Film) -> Result<Filtered, Error>;

    /// The number of rows above and below a row that its image reads; `None` (the default) if it reads the whole film.
    ///
    /// A filter with a reach implements [`Filter::apply_rows`], and [`apply_in_rows`] bounds its memory.
    fn reach(&self, frame: &Frame) -> Option<u32> {
        let _ = frame;
        None
    }

    /// The numbers that [`Filter::apply_rows`] takes from the whole film, such as its mean brightness.
    ///
    /// # Errors
    ///
    /// As [`Filter::apply`].
    fn survey(&self, film: &Film) -> Result<Vec<f64>, Error> {
        let _ = film;
        Ok(Vec::new())
    }

    /// Makes some rows of the image that [`Filter::apply`] makes of the whole film, with the same bits. `survey` is that of the
    /// whole film.
    ///
    /// # Errors
    ///
    /// As [`Filter::apply`]. [`Error::Mismatch`] for a filter without a reach.
    fn apply_rows(&self, rows: &FilmRows<'_>, survey: &[f64]) -> Result<Filtered, Error> {
        let _ = (rows, survey);
        let what = "it reads the whole film; apply it to the whole film";
        Err(Error::Mismatch { who: self.name().to_owned(), what: what.into() })
    }
}

forward!(Filter for &T, Box<T>, Arc<T>; {
    ref name() -> &str;
    ref describe() -> String;
    ref needs() -> Needs;
    ref recorders() -> Vec<Arc<dyn Recorder>>;
    ref memory(frame: &Frame, needs: &Needs) -> FilterMemory;
    ref runs(needs: &Needs, spp: f64) -> u32;
    ref apply(film: &Film) -> Result<Filtered, Error>;
    ref reach(frame: &Frame) -> Option<u32>;
    ref survey(film: &Film) -> Result<Vec<f64>, Error>;
    ref apply_rows(rows: &FilmRows<'_>, survey: &[f64]) -> Result<Filtered, Error>;
});

/// The identity filter: each pixel is the mean of its own samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unfiltered;

impl Filter for Unfiltered {
    fn name(&self) -> &str {
        "none"
    }

    fn memory(&self, frame: &Frame, needs: &Needs) -> FilterMemory {
        let planes = if needs.halves { ImagePlanes::RadianceAndError } else { ImagePlanes::Radiance };
        FilterMemory::new(frame, 0, planes)
    }

    fn apply(&self, film: &Film) -> Result<Filtered, Error> {
        Ok(Filtered::new(film.frame().size(), film.image()).with_error(film.squared_errors()))
    }

    fn reach(&self, _: &Frame) -> Option<u32> {
        Some(0)
    }

    fn apply_rows(&self, rows: &FilmRows<'_>, _: &[f64]) -> Result<Filtered, Error> {
        Ok(rows.of(self.apply(rows.film)?))
    }
}

/// Some rows of a film, with those around them that a filter reads.
#[derive(Clone, Copy, Debug)]
pub struct FilmRows<'a> {
    /// The film of these rows and of those around them.
    pub film: &'a Film,
    /// The frame of the whole image.
    pub frame: &'a Frame,
    /// The first row whose image is made, and the one after the last, from the top of the whole image.
    pub rows: [u32; 2],
}

impl<'a> FilmRows<'a> {
    /// All rows of a film.
    pub fn whole(film: &'a Film) -> Self {
        Self { film, frame: film.frame(), rows: [0, film.frame().size()[1]] }
    }

    /// Calls `each` with a film's rows, `at_once` (at least 1) at a time, with `reach` rows around them. Returns its results.
    ///
    /// # Errors
    ///
    /// The first error of `each`.
    pub fn each<T>(
        film: &Film,
        reach: u32,
        at_once: u32,
        mut each: impl FnMut(&FilmRows<'_>) -> Result<T, Error>,
    ) -> Result<Vec<T>, Error> {
        let (frame, height) = (film.frame(), film.frame().size()[1]);
        let part = |first: u32| {
            let end = first.saturating_add(at_once.max(1)).min(height);
            let film = film.of_rows(first.saturating_sub(reach)..end.saturating_add(reach).min(height))?;
            each(&FilmRows { film: &film, frame, rows: [first, end] })
        };
        (0..height).step_by(at_once.max(1) as usize).map(part).collect()
    }

    /// The first row of the film in the whole image.
    pub fn top(&self) -> u32 {
        self.film.frame().origin()[1] - self.frame.origin()[1]
    }

    /// The rows whose image is made, as rows of the film.
    pub fn within(&self) -> Range<usize> {
        let [first, end] = self.rows.map(|row| (row - self.top()) as usize);
        first..end
    }

    /// The rows whose image is made, of an image of all rows of the film.
    pub fn of(&self, image: Filtered) -> Filtered {
        let (width, rows) = (image.size[0], self.within());
        let pixels = rows.start * width as usize..rows.end * width as usize;
        if pixels.len() == image.radiance.len() {
            return image;
        }
        let error = image.error.map(|error| error[pixels.clone()].to_vec());
        Filtered::new([width, rows.len() as u32], image.radiance[pixels].to_vec()).with_error(error)
    }
}

/// Filters a film by `at_once` rows at a time, so that the filter's memory does not grow with the height of the image. The image
/// has the bits of [`Filter::apply`]; a filter without a [reach](Filter::reach) is applied to the whole film.
///
/// # Errors
///
/// As [`Filter::apply`].
pub fn apply_in_rows(filter: &dyn Filter, film: &Film, at_once: u32) -> Result<Filtered, Error> {
    let Some(reach) = filter.reach(film.frame()) else { return filter.apply(film) };
    film.require(filter.name(), &filter.needs())?;
    let survey = filter.survey(film)?;
    let mut image = Filtered::new(film.frame().size(), Vec::with_capacity(film.frame().pixels()));
    FilmRows::each(film, reach, at_once, |rows| {
        let Filtered { radiance, error, .. } = filter.apply_rows(rows, &survey)?;
        image.radiance.extend(radiance);
        if let Some(error) = error {
            image.error.get_or_insert_default().extend(error);
        }
        Ok(())
    })?;
    Ok(image)
}
