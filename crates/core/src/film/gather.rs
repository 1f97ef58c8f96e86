//! Films of rows that several processes hold.

use super::{Bank, Film, Picked, SamplePlane, SumPlane};
use crate::exchange::message::unreadable;
use crate::snapshot::Broken;
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::film::{check_bank, take_bank, take_beside};
use crate::snapshot::planes::{put_bank, put_beside};
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
        let first = rows.map_or(0, |rows| rows.start as usize);
        let step = (AT_ONCE / (width * Self::bytes_per_pixel(&needs)).max(1)).max(1);
        let all = wanted.iter().map(|rows| rows.start).min().unwrap_or(0)
            ..wanted.iter().map(|rows| rows.end).max().unwrap_or(0);
        for top in all.clone().step_by(step) {
            let here = |rows: &Range<usize>| rows.start.max(top)..rows.end.min(top + step);
            let own = |rows: &Range<usize>| self.encoded(&here(rows), (&needs, discards));
            let sent = exchange.all_to_all(wanted.iter().map(own).collect())?;
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
        let own: Vec<u32> = self.held.own().iter().copied().filter(|row| rows.contains(&(*row as usize))).collect();
        if own.is_empty() {
            return Vec::new();
        }
        let width = self.frame.size()[0];
        let numbers: Vec<u32> = own.iter().flat_map(|row| row * width..(row + 1) * width).collect();
        let mut part = self.pick(Picked(&numbers), None);
        if !discards {
            part.discarded.clear();
        }
        part.keep_only(needs);
        let mut to = Writer::with_capacity(64 + numbers.len() * Self::bytes_per_pixel(needs));
        to.list(&own);
        part.kept.iter().chain(&part.discarded).for_each(|bank| put_bank(&mut to, bank));
        put_beside(&mut to, &part);
        to.finish()
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
        let numbers: Vec<u32> =
            rows.iter().flat_map(|row| row * width..(row + 1) * width).map(|pixel| pixel as u32).collect();
        let mut part = Film::without_planes(self.frame, self.needs);
        let mut banks = |count: usize| -> Result<Vec<Bank>, Broken> {
            let mut one = || {
                let bank = take_bank(&mut from, numbers.len(), &self.needs)?;
                check_bank(&bank, u64::MAX >> 1)?;
                Ok(bank)
            };
            (0..count).map(|_| one()).collect()
        };
        (part.kept, part.discarded) = (banks(self.kept.len())?, banks(self.discarded.len())?);
        take_beside(&mut from, &mut part, numbers.len())?;
        match from.is_empty() && self.place(Picked(&numbers), part) {
            true => Ok(rows.len()),
            false => Err(Broken("rows are of another size")),
        }
    }

    /// Drops all statistics but `needs`.
    fn keep_only(&mut self, needs: &Needs) {
        for bank in self.kept.iter_mut().chain(&mut self.discarded) {
            if !needs.variance {
                (bank.m2, bank.channels_m2) = (Vec::new(), Vec::new());
            }
            if !needs.extrema {
                bank.ranges = Vec::new();
            }
            if !needs.emission {
                bank.emission = Vec::new();
            }
            if needs.channels == 0 {
                (bank.channels, bank.channels_m2) = (Vec::new(), Vec::new());
            }
            if needs.sums == Sums::NONE {
                bank.sums = SumPlane::default();
            }
            if needs.samples == 0 {
                bank.samples = SamplePlane::default();
            } else if !needs.trajectories {
                bank.samples.trajectories = Vec::new();
            }
        }
        if !needs.features {
            self.features = Vec::new();
        }
        if needs.feature_planes() == 0 {
            self.half_features = Vec::new();
        }
        if needs.first_hits == 0 {
            self.first_hits = Vec::new();
        }
        if !needs.cost {
            self.costs = Vec::new();
        }
        self.needs = *needs;
    }
}

/// The recorded statistics that are needed. Counts of first hits, channels and samples are those recorded; halves stay.
pub(crate) fn both(recorded: &Needs, needed: &Needs) -> Needs {
    Needs {
        variance: recorded.variance && needed.variance,
        extrema: recorded.extrema && needed.extrema,
        halves: recorded.halves,
        features: recorded.features && needed.features,
        feature_halves: recorded.feature_halves && needed.feature_halves,
        first_hits: if needed.first_hits > 0 { recorded.first_hits } else { 0 },
        cost: recorded.cost && needed.cost,
        emission: recorded.emission && needed.emission,
        splats: false,
        channels: if needed.channels > 0 { recorded.channels } else { 0 },
        sums: if needed.sums == Sums::NONE { Sums::NONE } else { recorded.sums },
        samples: if needed.samples > 0 { recorded.samples } else { 0 },
        trajectories: recorded.trajectories && needed.trajectories && needed.samples > 0,
    }
}
