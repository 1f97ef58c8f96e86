//! A snapshot that is read in pieces: one process has the bytes, and each process gets the rows that it holds.

use super::bytes::{Reader, Writer};
use super::decode::{bytes_beside, kept, least_of_bank, take_of_bank, take_of_film};
use super::film::{check_banks, check_counts, take_film_end, take_film_head};
use super::planes::{BESIDE, OF_BANK, Plane};
use super::stream::AT_ONCE;
use super::{Broken, Head, Snapshot};
use crate::exchange::agree;
use crate::film::{Bank, HeldRows};
use crate::{Error, Exchange, Film, Frame};
use std::io::Read;
use std::ops::Range;

/// The bytes of a snapshot, and how many are left.
pub(crate) struct Source<'s> {
    bytes: &'s mut dyn Read,
    left: u64,
    /// Bytes that were read too early: those after the head.
    ahead: Vec<u8>,
}

/// Reads pixels into their places in the planes.
type Take<'t> = &'t mut dyn FnMut(&mut Reader<'_>, &Range<usize>) -> Result<(), Broken>;

/// More bytes than precede the planes of any film.
const MOST_OF_HEAD: usize = 1 << 26;

impl<'s> Source<'s> {
    pub(crate) fn new((bytes, length): (&'s mut dyn Read, u64)) -> Self {
        Self { bytes, left: length, ahead: Vec::new() }
    }

    /// The number of bytes that are left.
    fn left(&self) -> u64 {
        self.left + self.ahead.len() as u64
    }

    /// Appends the next `count` bytes.
    fn read(&mut self, to: &mut Vec<u8>, count: u64) -> Result<(), Broken> {
        if count > self.left() {
            return Err(Broken("they end too early"));
        }
        let begun = (self.ahead.len() as u64).min(count);
        to.extend(self.ahead.drain(..begun as usize));
        let count = count - begun;
        to.reserve(count.min(AT_ONCE as u64) as usize);
        let read = (&mut self.bytes).take(count).read_to_end(to).map_err(|_| Broken("they cannot be read"))?;
        self.left -= read as u64;
        if read as u64 == count { Ok(()) } else { Err(Broken("they end too early")) }
    }

    /// The bytes that precede the planes.
    fn head(&mut self) -> Result<Vec<u8>, Broken> {
        let mut bytes = Vec::new();
        loop {
            let more = self.left.min(bytes.len().max(1 << 12) as u64);
            self.read(&mut bytes, more)?;
            let mut from = Reader::new(&bytes);
            match take_head(&mut from) {
                Ok((_, film)) => {
                    self.ahead = bytes.split_off(bytes.len() - from.left());
                    return self.check_length(&film).map(|()| bytes);
                }
                Err(broken) if self.left == 0 || bytes.len() > MOST_OF_HEAD => return Err(broken),
                Err(_) => {}
            }
        }
    }

    /// Refuses planes that are longer than the bytes that are left, before memory is made for them.
    fn check_length(&self, film: &Film) -> Result<(), Broken> {
        let each = (halves(film) * least_of_bank(&film.needs) + bytes_beside(&film.needs)) as u64;
        match (film.frame.pixels() as u64).checked_mul(each) {
            Some(length) if length <= self.left() => Ok(()),
            _ => Err(Broken("they end too early")),
        }
    }

    /// The next rows of a plane from row `top`, of `length` bytes each: about 4 MiB, at least a row.
    fn rows(&mut self, top: usize, bottom: usize, length: &dyn Fn(usize) -> u64) -> Result<Vec<Vec<u8>>, Broken> {
        let (mut rows, mut read) = (Vec::new(), 0);
        for row in top..bottom {
            let length = length(row);
            if read > 0 && read + length > AT_ONCE as u64 {
                break;
            }
            let mut bytes = Vec::new();
            self.read(&mut bytes, length)?;
            rows.push(bytes);
            read += length.max(1);
        }
        Ok(rows)
    }
}

fn take_head(from: &mut Reader<'_>) -> Result<(Head, Film), Broken> {
    Ok((Head::take(from)?, take_film_head(from)?))
}

/// The number of banks of kept samples.
fn halves(film: &Film) -> usize {
    if film.needs.halves { 2 } else { 1 }
}

impl Snapshot {
    /// Reads the snapshot that one process has, in pieces. Each process gets its runs of rows among those that `rows` returns;
    /// or all rows, if it returns `None`. Every process of `exchange` calls it.
    pub(crate) fn read_rows<'e>(
        source: Option<Source<'_>>,
        rows: impl FnOnce(&Film) -> Option<Vec<Vec<Range<usize>>>>,
        exchange: Option<&'e mut (dyn Exchange + 'e)>,
    ) -> Result<Self, Error> {
        let mut pieces = Pieces { source, exchange, rows: None, broken: None };
        let (head, mut film) = pieces.head()?;
        pieces.rows = rows(&film);
        if let Some(rows) = &pieces.rows {
            film.held = HeldRows::some(&film.frame, &rows[pieces.me()], &[]);
        }
        film.kept = pieces.banks(&film)?;
        film.discarded = if pieces.flag()? { pieces.banks(&film)? } else { Vec::new() };
        let frame = film.frame;
        let pixels = film.held.pixels(&frame);
        film.clear_beside(pixels);
        for (plane, each) in BESIDE.map(|plane| (plane, plane.bytes(&film.needs))).into_iter().filter(|of| of.1 > 0) {
            pieces.plane(&frame, &|_| bytes_of_row(&frame, each), &mut |_| {}, &mut |from, pixels| {
                take_of_film(from, &mut film, plane, pixels)
            })?;
        }
        let end = pieces.end()?;
        let mut from = Reader::new(&end);
        take_film_end(&mut from, &mut film)?;
        pieces.check(&film)?;
        Ok(Self::take_end(&mut from, head, film)?)
    }
}

fn bytes_of_row(frame: &Frame, each: usize) -> u64 {
    u64::from(frame.size()[0]) * each as u64
}

/// The pieces of a snapshot, on their way from the process that has it.
struct Pieces<'s, 'e> {
    source: Option<Source<'s>>,
    exchange: Option<&'e mut (dyn Exchange + 'e)>,
    /// The runs of rows of each process; `None` if each holds all.
    rows: Option<Vec<Vec<Range<usize>>>>,
    /// The fault of the rows that this process got. The others hear of it at the end.
    broken: Option<Broken>,
}

impl Pieces<'_, '_> {
    fn me(&self) -> usize {
        self.exchange.as_ref().map_or(0, |exchange| exchange.share().index() as usize)
    }

    /// Everyone's bytes; or the fault of this process, else those of others.
    fn all(&mut self, mine: Result<Vec<u8>, Broken>) -> Result<Vec<Vec<u8>>, Error> {
        let Some(exchange) = &mut self.exchange else { return Ok(vec![mine?]) };
        let fault = mine.as_ref().err().map(|Broken(what)| Error::BadSnapshot { what });
        let all = agree(&mut **exchange, mine.map_err(|Broken(what)| faulty(what)));
        fault.map_or(all, Err)
    }

    /// The bytes that the process with the snapshot reads of it.
    fn told(&mut self, read: impl FnOnce(&mut Source<'_>) -> Result<Vec<u8>, Broken>) -> Result<Vec<u8>, Error> {
        let mine = self.source.as_mut().map_or(Ok(Vec::new()), read);
        let all = self.all(mine)?;
        Ok(all.into_iter().find(|bytes| !bytes.is_empty()).unwrap_or_default())
    }

    fn head(&mut self) -> Result<(Head, Film), Error> {
        let bytes = self.told(|source| source.head())?;
        Ok(take_head(&mut Reader::new(&bytes))?)
    }

    fn flag(&mut self) -> Result<bool, Error> {
        let byte = self.told(|source| {
            let mut byte = Vec::new();
            source.read(&mut byte, 1).map(|()| byte)
        })?;
        Ok(Reader::new(&byte).flag()?)
    }

    /// The bytes after the planes, which all processes need.
    fn end(&mut self) -> Result<Vec<u8>, Error> {
        let mut end = Vec::new();
        loop {
            let piece = self.told(|source| {
                let mut piece = Vec::new();
                source.read(&mut piece, source.left().min(AT_ONCE as u64)).map(|()| piece)
            })?;
            if piece.is_empty() {
                return Ok(end);
            }
            end.extend(piece);
        }
    }

    fn banks(&mut self, film: &Film) -> Result<Vec<Bank>, Error> {
        (0..halves(film)).map(|_| self.bank(film)).collect()
    }

    fn bank(&mut self, film: &Film) -> Result<Bank, Error> {
        let (needs, frame) = (&film.needs, &film.frame);
        let mut bank = Bank::new(film.held.pixels(frame), needs);
        // The number of samples that each row keeps one by one, on the process that reads all counts.
        let mut of_rows: Vec<u64> = Vec::new();
        for plane in OF_BANK {
            if plane.bytes(needs) == 0 || plane == Plane::Ahead && !self.flag()? {
                continue;
            }
            let (each, before) = (plane.bytes(needs), std::mem::take(&mut of_rows));
            let length = |row: usize| match plane {
                Plane::Samples | Plane::Trajectories => {
                    before.get(row).map_or(0, |samples| samples.saturating_mul(each as u64))
                }
                _ => bytes_of_row(frame, each),
            };
            let mut look = |row: &[u8]| {
                if plane == Plane::Counts {
                    let counts = row.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes));
                    of_rows.push(counts.map(|count| kept(count, needs.samples) as u64).sum());
                }
            };
            self.plane(frame, &length, &mut look, &mut |from, pixels| take_of_bank(from, &mut bank, plane, pixels))?;
            if plane != Plane::Counts {
                of_rows = before;
            }
        }
        Ok(bank)
    }

    /// Passes a plane of rows with `length` bytes each: `look` sees every row on the process that has the snapshot, and `take`
    /// reads the rows of this process, some at a time.
    fn plane(
        &mut self,
        frame: &Frame,
        length: &dyn Fn(usize) -> u64,
        look: &mut dyn FnMut(&[u8]),
        take: Take<'_>,
    ) -> Result<(), Error> {
        let [width, height] = frame.size().map(|n| n as usize);
        let (mut top, mut place) = (0, 0);
        while top < height {
            let rows = self.source.as_mut().map(|source| source.rows(top, height, length));
            if let Some(Ok(rows)) = &rows {
                rows.iter().for_each(|row| look(row));
            }
            let bytes = self.send(top, rows)?;
            let mut from = Reader::new(&bytes);
            let bottom = from.number::<u32>()? as usize;
            if !(top + 1..=height).contains(&bottom) {
                return Err(Broken("rows are out of range").into());
            }
            let pixels = width * self.held(self.me(), top..bottom).iter().map(Range::len).sum::<usize>();
            if self.broken.is_none() {
                self.broken = take(&mut from, &(place..place + pixels)).err();
            }
            (top, place) = (bottom, place + pixels);
        }
        Ok(())
    }

    /// The rows of a process among `rows`, in runs.
    fn held(&self, who: usize, rows: Range<usize>) -> Vec<Range<usize>> {
        let Some(runs) = &self.rows else { return vec![rows] };
        let common = |run: &Range<usize>| run.start.max(rows.start)..run.end.min(rows.end);
        runs[who].iter().map(common).filter(|run| run.start < run.end).collect()
    }

    /// Sends rows from row `top` to the processes that hold them. Returns the end of the rows, and the bytes of those that this
    /// process holds.
    fn send(&mut self, top: usize, rows: Option<Result<Vec<Vec<u8>>, Broken>>) -> Result<Vec<u8>, Error> {
        let parts = match (&self.rows, &self.exchange) {
            (Some(_), Some(exchange)) => exchange.share().of() as usize,
            _ => 1,
        };
        let message = |who: usize| {
            let mut to = Writer::with_capacity(0);
            match &rows {
                None => {}
                Some(Err(Broken(what))) => {
                    to.flag(false);
                    to.text(&faulty(what));
                }
                Some(Ok(rows)) => {
                    to.flag(true);
                    to.number((top + rows.len()) as u32);
                    let own = self.held(who, top..top + rows.len()).into_iter().flatten();
                    own.for_each(|row| to.raw(&rows[row - top]));
                }
            }
            to.finish()
        };
        let mut to_each: Vec<Vec<u8>> = (0..parts).map(message).collect();
        let sent = match (&mut self.exchange, &self.rows) {
            (None, _) => to_each,
            (Some(exchange), None) => exchange.all_gather(to_each.remove(0))?,
            (Some(exchange), Some(_)) => exchange.all_to_all(to_each)?,
        };
        let mut bytes = sent.into_iter().find(|bytes| !bytes.is_empty()).unwrap_or_default();
        let mut from = Reader::new(&bytes);
        if from.flag()? {
            bytes.remove(0);
            return Ok(bytes);
        }
        match rows {
            Some(Err(Broken(what))) => Err(Error::BadSnapshot { what }),
            _ => Err(Error::Exchange { what: from.text()? }),
        }
    }

    /// Checks the rows of all processes.
    fn check(&mut self, film: &Film) -> Result<(), Error> {
        let own = self.broken.take().map_or_else(|| check_banks(film), Err);
        let all = self.all(own.map(|samples| samples.to_le_bytes().into()))?;
        let mut samples = 0_u64;
        for bytes in if self.rows.is_some() { &all[..] } else { &all[..1] } {
            let more = Reader::new(bytes).number()?;
            samples = samples.checked_add(more).ok_or(Broken("counts overflow"))?;
        }
        Ok(check_counts(film, samples)?)
    }
}

/// The message to other processes.
fn faulty(what: &str) -> String {
    format!("the snapshot cannot be used: {what}")
}
