//! Filters of one window: the steps that [`NlMeans`](crate::NlMeans) and [`Bilateral`](crate::Bilateral) have in common.

use crate::error_map::{ERROR, Errors, filtered};
use crate::inputs::{self, Globals, Inputs};
use crate::light::Light;
use crate::loops::sum;
use crate::parameters::Reads;
use crate::plane::Pair;
use dapple_core::{Error, Film, FilmRows, Filter, Filtered};

/// The rows that are surveyed at once.
const AT_ONCE: u32 = 128;

/// A filter that makes an image of each half by means over one window.
pub(crate) trait OneWindow: Filter {
    /// The statistics that the filter reads besides halves and variance.
    fn reads(&self) -> Reads;

    /// The rows of planes that [`OneWindow::pair`] reads above and below its own.
    fn radius(&self) -> usize;

    /// Filters both halves of a film's samples, and returns an image from each.
    fn pair(&self, inputs: &Inputs) -> Pair;

    /// The rows of a film that the image reads.
    fn rows_read(&self) -> u32 {
        // The error is smoothed, and weighted by means over 3x3 pixels.
        (inputs::REACH + self.radius() + ERROR + 1) as u32
    }

    /// Filters a film.
    fn image(&self, film: &Film) -> Filtered {
        let inputs = Inputs::new(Light::all(film), &self.reads());
        inputs.restored(Light::all(film), filtered(&inputs, &self.pair(&inputs), ERROR))
    }

    /// The globals of a film, then the least error of a pixel. The latter is a part of the mean error, so the film is filtered
    /// for it once.
    fn globals(&self, film: &Film) -> Result<Vec<f64>, Error> {
        film.require(self.name(), &self.needs())?;
        let globals = Globals::survey(film, &self.reads(), AT_ONCE)?;
        let rows = FilmRows::each(film, self.rows_read(), AT_ONCE, |rows| {
            let inputs = Inputs::of_rows(rows, &self.reads(), &globals);
            let errors = Errors::new(&inputs, &self.pair(&inputs), ERROR);
            let width = inputs.size[0];
            let row = |y: usize| sum((y * width..(y + 1) * width).map(|i| errors.counted(i)));
            Ok(rows.within().map(row).collect::<Vec<_>>())
        })?;
        let least = Errors::least(sum(rows.into_iter().flatten()));
        Ok(globals.numbers().into_iter().chain([f64::from(least)]).collect())
    }

    /// Filters rows of a film with these globals.
    fn image_of_rows(&self, rows: &FilmRows<'_>, globals: &[f64]) -> Result<Filtered, Error> {
        let Some((numbers, [least])) = globals.split_first_chunk() else {
            let what = "these are not the numbers of its survey; take them from `Filter::survey`";
            return Err(Error::Mismatch { who: self.name().to_owned(), what: what.into() });
        };
        let inputs = Inputs::of_rows(rows, &self.reads(), &Globals::from_numbers(*numbers));
        let pair = self.pair(&inputs);
        let image = Errors::new(&inputs, &pair, ERROR).image(&inputs, &pair, *least as f32);
        Ok(rows.of(inputs.restored(Light::all(rows.film), image)))
    }
}
