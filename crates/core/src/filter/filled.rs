//! Filling of pixels without valid samples.

use crate::{Error, Film, Filter, Filtered};
use std::collections::VecDeque;

/// Applies `filter` to `film`, and fills each pixel without valid samples from the nearest pixel that has some. Distance
/// is the number of steps along rows and columns. If no pixel has any, the image stays as the filter made it.
///
/// # Errors
///
/// The errors of [`Filter::apply`].
pub fn filled(filter: &dyn Filter, film: &Film) -> Result<Filtered, Error> {
    let valid = film.without_samples(|_, i| film.is_rejected(i));
    let film = valid.as_ref().unwrap_or(film);
    let mut image = filter.apply(film)?;
    let ([width, height], pixels) = (film.frame.size().map(|n| n as usize), film.frame.pixels());
    let mut has = (0..pixels).map(|i| film.count(i) > 0).collect::<Vec<_>>();
    let mut reached: VecDeque<usize> = (0..pixels).filter(|i| has[*i]).collect();
    if reached.len() == pixels {
        return Ok(image);
    }
    while let Some(i) = reached.pop_front() {
        let (x, y) = (i % width, i / width);
        let beside = [(x > 0, -1), (x + 1 < width, 1), (y > 0, -(width as isize)), (y + 1 < height, width as isize)];
        for j in beside.into_iter().filter(|(is_inside, _)| *is_inside).map(|(_, step)| i.wrapping_add_signed(step)) {
            if !std::mem::replace(&mut has[j], true) {
                image.radiance[j] = image.radiance[i];
                image.error.iter_mut().for_each(|error| error[j] = error[i]);
                reached.push_back(j);
            }
        }
    }
    Ok(image)
}
