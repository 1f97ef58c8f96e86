//! Films of rows that several processes hold.

use super::Film;
use crate::exchange::message::unreadable;
use crate::snapshot::Broken;
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::decode::{take_of_bank, take_of_film};
use crate::snapshot::film::check_pixels;
use crate::snapshot::planes::{BESIDE, OF_BANK, Plane, put_of_film, put_planes_of_bank};
use crate::{Error, Exchange, Needs, Sums};
use std::ops::Range;

/// The bytes of pixels that travel at once, about: a film does not stand beside its encoded bytes.
const AT_ONCE: usize = 1 << 24;

impl Film {
    /// A film of these rows of the window, from the processes that own them: kept samples, and the recorded statistics
    /// among `needs`, with the record. `None` for no rows.
    ///
    /// Every process of `exchange` calls it, each with the film that it rendered in bands
    /// ([`Render::in_bands`](crate::Render::in_bands)) and with rows of its choice.
    ///
    /// # Errors
    ///
    /// As [`Exchange::all_gather`], and if no process owns one of the rows.
    pub fn gather(
        &self,
        rows: Option<Range<u32>>,
        needs: &Needs,
        exchange: &mut dyn Exchange,
    ) -> Result<Option<Film>, Error> {
        self.gather_banks(rows, (needs, false), exchange)
    }

    /// As [`Film::gather`], with discarded samples if `discards`.
    pub(crate) fn gather_banks(
        &self,
        rows: Option<Range<u32>>,
        (needs, discards): (&Needs, bool),
        exchange: &mut dyn Exchange,
    ) -> Result<Option<Film>, Error> {
        let [width, height] = self.frame.size().map(|n| n as usize);
        let needs = both(&self.needs, needs);
        let frame = rows.clone().map(|rows| self.frame.rows(rows)).transpose();
        // A process whose rows are refused gets none, so that none of the others waits for it.
        let rows = rows.filter(|_| frame.is_ok());
        let (frame, refused) = frame.map_or_else(|e| (None, Some(e)), |frame| (frame, None));
        let mut to = Writer::with_capacity(8);
        to.number(rows.as_ref().map_or([0; 2], |rows| [rows.start, rows.end]));
        let wanted = exchange.all_gather(to.finish())?;
        let range = |(who, bytes): (usize, &Vec<u8>)| match Reader::new(bytes).number::<[u32; 2]>() {
            Ok([start, end]) => Ok(start as usize..(end as usize).min(height)),
            Err(e) => Err(unreadable(who, &e)),
        };
        let wanted = wanted.iter().enumerate().map(range).collect::<Result<Vec<_>, _>>()?;
        let mut whole = frame.map(|frame| Film { record: self.record.clone(), ..Self::new(frame, needs) });
        if let Some(film) = &mut whole {
            (film.combine, film.rejected) = (self.combine, self.rejected_in(&film.frame));
            (film.unreported, film.half_of) = (self.unreported, self.half_of);
            if discards && !self.discarded.is_empty() {
                film.open_discarded();
            }
        }
        let mut missing = rows.as_ref().map_or(0, |rows| rows.len());
        let first = rows.as_ref().map_or(0, |rows| rows.start as usize);
        if let (Some(film), Some(rows)) = (&mut whole, &rows) {
            // The own rows need no message.
            let own: Vec<_> = self.own_among(&(rows.start as usize..rows.end as usize)).collect();
            let place = |row: &u32| [*row as usize - first, self.held.place(*row as usize)];
            film.bring(self, &own.iter().map(place).collect::<Vec<_>>());
            missing -= own.len();
        }
        let me = exchange.share().index() as usize;
        let step = (AT_ONCE / (width * Self::bytes_per_pixel(&needs)).max(1)).max(1);
        let all = wanted.iter().map(|rows| rows.start).min().unwrap_or(0)
            ..wanted.iter().map(|rows| rows.end).max().unwrap_or(0);
        for top in all.clone().step_by(step) {
            let here = |rows: &Range<usize>| rows.start.max(top)..rows.end.min(top + step);
            let own = |(who, rows): (usize, &Range<usize>)| match who == me {
                true => Vec::new(),
                false => self.encoded(&here(rows), (&needs, discards)),
            };
            let sent = exchange.all_to_all(wanted.iter().enumerate().map(own).collect())?;
            let Some(film) = &mut whole else { continue };
            for (who, bytes) in sent.iter().enumerate() {
                missing -= film.place_rows(bytes, (first, missing)).map_err(|e| unreadable(who, &e))?;
            }
        }
        match (refused, missing) {
            (Some(refused), _) => Err(refused),
            (None, 0) => Ok(whole),
            (None, n) => Err(Error::Gone { what: format!("{n} rows are with no process") }),
        }
    }

    /// The own ones of these rows, with the recorded statistics among `needs`, as bytes.
    fn encoded(&self, rows: &Range<usize>, (needs, discards): (&Needs, bool)) -> Vec<u8> {
        let own: Vec<u32> = self.own_among(rows).collect();
        if own.is_empty() {
            return Vec::new();
        }
        let width = self.frame.size()[0] as usize;
        let places = self.held.own_places(&(rows.start * width..rows.end * width));
        let mut to = Writer::with_capacity(64 + places.len() * Self::bytes_per_pixel(needs));
        to.list(&own);
        let wanted = |plane: Plane| plane.bytes(needs) > 0;
        for bank in self.kept.iter().chain(self.discarded.iter().filter(|_| discards)) {
            put_planes_of_bank(&mut to, bank, wanted, &places);
        }
        let beside = BESIDE.into_iter().filter(|plane| wanted(*plane));
        beside.for_each(|plane| put_of_film(&mut to, self, plane, Some(&places)));
        to.finish()
    }

    /// The own rows among `rows`.
    fn own_among(&self, rows: &Range<usize>) -> impl Iterator<Item = u32> + '_ {
        let rows = rows.clone();
        self.held.own().iter().copied().filter(move |row| rows.contains(&(*row as usize)))
    }

    /// Puts rows that [`Film::encoded`] wrote into this film, whose window begins at row `first`. Returns their number, at
    /// most `most`.
    fn place_rows(&mut self, bytes: &[u8], (first, most): (usize, usize)) -> Result<usize, Broken> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let mut from = Reader::new(bytes);
        let rows: Vec<u32> = from.list()?;
        let [width, height] = self.frame.size().map(|n| n as usize);
        let row = |row: &u32| (*row as usize).checked_sub(first).filter(|row| *row < height);
        let rows = rows.iter().map(row).collect::<Option<Vec<_>>>().filter(|rows| rows.len() <= most);
        let rows = rows.ok_or(Broken("rows are out of range"))?;
        let runs: Vec<_> =
            rows.chunk_by(|a, b| a + 1 == *b).map(|run| run[0] * width..(run[0] + run.len()) * width).collect();
        for bank in self.kept.iter_mut().chain(&mut self.discarded) {
            for plane in OF_BANK {
                if plane != Plane::Ahead || from.flag()? {
                    runs.iter().try_for_each(|run| take_of_bank(&mut from, bank, plane, run))?;
                }
            }
            runs.iter().try_for_each(|run| check_pixels(bank, run, u64::MAX >> 1).map(|_| ()))?;
        }
        for plane in BESIDE {
            runs.iter().try_for_each(|run| take_of_film(&mut from, self, plane, run))?;
        }
        if from.is_empty() { Ok(rows.len()) } else { Err(Broken("rows are of another size")) }
    }
}

/// The recorded statistics that are needed. Counts of first hits, channels and samples are those recorded; halves stay.
pub(crate) fn both(recorded: &Needs, needed: &Needs) -> Needs {
    // They are in one plane.
    let values = needed.channels > 0 || needed.indirect && recorded.indirect;
    Needs {
        variance: recorded.variance && needed.variance,
        extrema: recorded.extrema && needed.extrema,
        halves: recorded.halves,
        features: recorded.features && needed.features,
        feature_halves: recorded.feature_halves && needed.feature_halves,
        first_hits: if needed.first_hits > 0 { recorded.first_hits } else { 0 },
        cost: recorded.cost && needed.cost,
        emission: recorded.emission && needed.emission,
        indirect: recorded.indirect && values,
        splats: false,
        channels: if values { recorded.channels } else { 0 },
        sums: if needed.sums == Sums::NONE { Sums::NONE } else { recorded.sums },
        samples: if needed.samples > 0 { recorded.samples } else { 0 },
        trajectories: recorded.trajectories && needed.trajectories && needed.samples > 0,
    }
}
