//! Filters across processes: each makes the rows of a band.

use crate::{Error, Exchange, Film, Filter, Filtered, Frame, Needs};
use std::ops::Range;

/// Rows are given to bands in groups of this number: half a tile of the filters, so that two bands of 200 rows end together.
const GROUP: u32 = 8;

/// Some rows of an image whose other rows are with other processes.
///
/// ```
/// use dapple_core::{Band, Frame};
///
/// let frame = Frame::new(640, 100)?;
/// let rows = (0..3).filter_map(|k| Band::of(frame, k, 3)).map(|band| band.rows());
/// assert_eq!(rows.collect::<Vec<_>>(), [0..32, 32..72, 72..100]);
/// assert!(Band::of(frame, 0, 14).is_none(), "too many for groups of 8 rows");
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Band {
    frame: Frame,
    rows: Range<u32>,
}

impl Band {
    /// The rows `rows` of the window of `frame`, the frame of the whole image.
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] for no rows or rows beyond the window.
    pub fn new(frame: Frame, rows: Range<u32>) -> Result<Self, Error> {
        frame.rows(rows.clone())?;
        Ok(Self { frame, rows })
    }

    /// Band `index` of `of` bands of about equal height, from the top. `None` if there are too few rows for so many bands.
    pub fn of(frame: Frame, index: u32, of: u32) -> Option<Self> {
        let height = frame.size()[1];
        let groups = u64::from(height.div_ceil(GROUP));
        if index >= of || u64::from(of) > groups {
            return None;
        }
        // The nearest group: the last one may have fewer rows.
        let nearest = |k: u32| (2 * groups * u64::from(k) + u64::from(of)) / (2 * u64::from(of));
        let cut = |k: u32| (nearest(k) * u64::from(GROUP)).min(u64::from(height)) as u32;
        Some(Self { frame, rows: cut(index)..cut(index + 1) })
    }

    /// The frame of the whole image.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The band's rows in the window, from 0.
    pub fn rows(&self) -> Range<u32> {
        self.rows.clone()
    }
}

/// Filters the film of a render by several processes: each makes a band of rows. Returns film and image on process 0, `None`
/// on the others.
///
/// `film` is what [`Render`](crate::Render) returned, whole or [in bands](crate::Render::in_bands). Of a film in bands, each
/// process reads the rows of its band and those around it from their owners, and process 0 gets a film of the statistics
/// `shown` of those recorded. The image has the bits of [`Filter::apply`]. Process 0 alone runs a filter that reads whole films,
/// as any filter if there are more processes than groups of 8 rows.
///
/// # Errors
///
/// As [`Filter::apply_to_rows`] and [`Exchange::all_gather`].
pub fn apply_together(
    filter: &dyn Filter,
    film: Film,
    shown: &Needs,
    exchange: &mut dyn Exchange,
) -> Result<Option<(Film, Filtered)>, Error> {
    let (share, frame) = (exchange.share(), *film.frame());
    let (is_first, rows) = (share.index() == 0, 0..frame.size()[1]);
    let band = Band::of(frame, share.index(), share.of()).filter(|_| share.of() > 1);
    let read = band.as_ref().and_then(|band| filter.rows_read(&frame, band.rows()));
    let (Some(band), Some(read)) = (band, read) else {
        let film = if film.is_whole() {
            Some(film).filter(|_| is_first)
        } else {
            film.gather(is_first.then_some(rows), film.needs(), exchange)?
        };
        return film.map(|film| filter.apply(&film).map(|image| (film, image))).transpose();
    };
    let part =
        if film.is_whole() { Some(film.of_rows(read)?) } else { film.gather(Some(read), film.needs(), exchange)? };
    let Some(part) = part else { return Ok(None) };
    let own = to_bytes(&filter.apply_to_rows(&part, &band, exchange)?);
    drop(part);
    let bands = exchange.all_to_all(vec![own])?;
    let image = if is_first { Some(joined(frame.size(), bands)?) } else { None };
    let film = if film.is_whole() { Some(film) } else { film.gather(is_first.then_some(rows), shown, exchange)? };
    Ok(film.zip(image))
}

/// An image as bytes: pixels, then errors if there are any.
fn to_bytes(image: &Filtered) -> Vec<u8> {
    let values = image.radiance.iter().flatten().chain(image.error.iter().flatten());
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// The image of all bands from the top, of which each is bytes by [`to_bytes`].
fn joined(size: [u32; 2], bands: Vec<Vec<u8>>) -> Result<Filtered, Error> {
    let [width, height] = size.map(|n| n as usize);
    let (mut radiance, mut error) = (Vec::with_capacity(width * height), Vec::new());
    let of = bands.len() as u32;
    let frame = Frame::new(size[0], size[1])?;
    for (index, bytes) in bands.iter().enumerate() {
        let pixels = Band::of(frame, index as u32, of).map_or(0, |band| band.rows.len()) * width;
        let mut values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
        radiance.extend((0..pixels).filter_map(|_| Some([values.next()?, values.next()?, values.next()?])));
        error.extend(values);
    }
    if radiance.len() != width * height || (!error.is_empty() && error.len() != width * height) {
        let what = "a process sent a band of another size; start all with the same program";
        return Err(Error::Mismatch { who: "the filtered image".into(), what: what.into() });
    }
    Ok(Filtered::new(size, radiance).with_error((!error.is_empty()).then_some(error)))
}
