//! Estimation of a filter's time before it is needed.

use crate::{Film, Filter, Frame, Needs};
use std::ops::Range;
use std::time::Instant;

/// The part of an image, as a fraction of its rows, on which a filter is timed.
const PART: u32 = 16;
/// The least number of pixels on which a filter is timed; smaller images are filtered whole. More would take a large part
/// of a short limit.
const LEAST: u32 = 1 << 12;

/// The rows of the window, in the middle of the image, on which a filter is timed.
pub(super) fn rows(frame: &Frame) -> Range<u32> {
    let [width, height] = frame.size();
    let rows = (height / PART).max(LEAST.div_ceil(width)).min(height);
    let top = (height - rows) / 2;
    top..top + rows
}

/// Estimates the wall seconds that a filter takes on an image of some height: the time that it takes on some rows, in
/// proportion to the pixels. 0 if the filter refuses them.
///
/// A quarter of the rows is filtered before, untimed: the first run may start threads or load a library.
pub(super) fn estimate(filter: &dyn Filter, part: &Film, height: u32) -> f64 {
    let rows = part.frame.size()[1];
    if part.of_rows(0..rows.div_ceil(4)).and_then(|quarter| filter.apply(&quarter)).is_err() {
        return 0.0;
    }
    let clock = Instant::now();
    let is_done = filter.apply(part).is_ok();
    let seconds = if is_done { clock.elapsed().as_secs_f64() } else { 0.0 };
    seconds * f64::from(height) / f64::from(rows)
}

/// The filter's time for a film with `more` times as many samples, relative to its time for `spp` samples per pixel.
pub(super) fn growth(filter: &dyn Filter, needs: &Needs, spp: f64, more: f64) -> f64 {
    let runs = |spp: f64| f64::from(filter.runs(needs, spp).max(1));
    runs(spp * more.max(1.0)) / runs(spp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Error, Filtered, Needs};
    use std::time::Duration;

    /// A filter that takes 50 ns per pixel, or refuses every film.
    struct Slow(bool);

    impl Filter for Slow {
        fn name(&self) -> &str {
            "slow"
        }

        fn runs(&self, _: &Needs, spp: f64) -> u32 {
            if spp < 16.0 { 1 } else { 3 }
        }

        fn apply(&self, film: &Film) -> Result<Filtered, Error> {
            if self.0 {
                return Err(Error::NotRecorded { who: "slow".into(), what: "anything" });
            }
            std::thread::sleep(Duration::from_nanos(50 * film.frame().pixels() as u64));
            Ok(Filtered::new(film.frame().size(), film.image()))
        }
    }

    #[test]
    fn a_filter_is_timed_on_a_part_of_the_image() {
        let frame = Frame::new(1024, 700).unwrap().crop(0, 100, 1024, 612).unwrap();
        let film = Film::new(frame, Needs::none());
        let part = film.of_rows(rows(&frame)).unwrap();
        let whole = 50e-9 * 1024.0 * 512.0;
        let estimated = estimate(&Slow(false), &part, 512);
        assert!((whole..5.0 * whole).contains(&estimated), "{estimated} for {whole}");
        assert_eq!(estimate(&Slow(true), &part, 512), 0.0);
    }

    #[test]
    fn a_filter_that_runs_more_often_on_more_samples_gets_more_time() {
        for (spp, more, wanted) in [(4.0, 3.9, 1.0), (4.0, 4.0, 3.0), (32.0, 4.0, 1.0), (16.0, 0.1, 1.0)] {
            assert_eq!(growth(&Slow(false), &Needs::none(), spp, more), wanted, "{spp} spp, {more} times as many");
        }
    }
}
