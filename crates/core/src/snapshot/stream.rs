//! The snapshot of a render whose processes hold some rows each: its bytes go to a process in pieces, in their order.

use super::bytes::{Reader, Writer};
use super::planes::{BESIDE, OF_BANK, Plane, put_of_bank, put_of_film};
use super::{Broken, View};
use crate::exchange::message::unreadable;
use crate::film::Bank;
use crate::{Error, Exchange, Film};
use std::ops::Range;

/// The bytes of a plane's rows that travel at once, about; at least a row.
pub(crate) const AT_ONCE: usize = 1 << 22;

/// The message of a process before its rows.
struct Told {
    saves: bool,
    /// The number of samples that its own rows keep one by one.
    samples: u64,
    /// For each bank: samples were withdrawn.
    ahead: Vec<u8>,
}

/// Takes pieces of a snapshot, each with the length of all.
type Take<'t> = &'t mut dyn FnMut(&[u8], u64);

impl View<'_> {
    /// Gives the bytes of [`View::write`] of the whole film to the processes that pass `take`: some rows of a plane at a time.
    /// Every process calls it.
    pub(crate) fn stream(&self, exchange: &mut dyn Exchange, take: Option<Take<'_>>) -> Result<(), Error> {
        let film = self.film;
        if film.is_whole() {
            if let Some(take) = take {
                let bytes = self.write();
                take(&bytes, bytes.len() as u64);
            }
            return Ok(());
        }
        let banks: Vec<&Bank> = film.kept.iter().chain(&film.discarded).collect();
        let told = tell(film, &banks, take.is_some(), exchange)?;
        let savers: Vec<bool> = told.iter().map(|one| one.saves).collect();
        if !savers.contains(&true) {
            return Ok(());
        }
        let ahead = |bank: usize| told.iter().any(|one| one.ahead.get(bank) == Some(&1));
        let ahead: Vec<bool> = (0..banks.len()).map(ahead).collect();
        let samples = told.iter().map(|one| one.samples).sum();
        let (mut out, [head, end]) = (Out { take, written: 0, length: 0 }, self.around());
        out.length = length(film, &ahead, samples) + (head.len() + end.len()) as u64;
        out.put(&head);
        let each = |plane: Plane| {
            let bytes = plane.bytes(&film.needs);
            match plane {
                Plane::Samples | Plane::Trajectories => bytes * (samples as usize / film.frame.pixels() + 1),
                _ => bytes,
            }
        };
        let mut rows = Rows { film, savers: &savers, exchange };
        for (number, (bank, ahead)) in banks.iter().zip(ahead).enumerate() {
            if number == film.kept.len() {
                out.put(&[1]);
            }
            for plane in OF_BANK {
                if plane == Plane::Ahead {
                    out.put(&[u8::from(ahead)]);
                }
                if plane != Plane::Ahead || ahead {
                    rows.send(each(plane), &mut out, &|to, pixels| match bank.ahead.is_empty() {
                        true if plane == Plane::Ahead => pixels.for_each(|_| to.number(0_i64)),
                        _ => put_of_bank(to, bank, plane, &pixels),
                    })?;
                }
            }
        }
        if film.discarded.is_empty() {
            out.put(&[0]);
        }
        for plane in BESIDE {
            rows.send(each(plane), &mut out, &|to, pixels| put_of_film(to, film, plane, Some(&pixels)))?;
        }
        out.put(&end);
        match out.take.is_none() || out.written == out.length {
            true => Ok(()),
            false => Err(Broken("a snapshot is of another length").into()),
        }
    }
}

/// Exchanges what precedes the rows.
fn tell(film: &Film, banks: &[&Bank], saves: bool, exchange: &mut dyn Exchange) -> Result<Vec<Told>, Error> {
    let mut to = Writer::with_capacity(64);
    to.flag(saves);
    let width = film.frame.size()[0] as usize;
    let kept = |bank: &&Bank| -> u64 {
        let own = bank.samples.rows.iter().take(film.held.own().len() * width);
        own.map(|row| row.len() as u64).sum()
    };
    to.number(banks.iter().map(kept).sum::<u64>());
    to.list(&banks.iter().map(|bank| u8::from(!bank.ahead.is_empty())).collect::<Vec<_>>());
    let read = |bytes: &Vec<u8>| -> Result<Told, Broken> {
        let mut from = Reader::new(bytes);
        Ok(Told { saves: from.flag()?, samples: from.number()?, ahead: from.list()? })
    };
    let all = exchange.all_gather(to.finish())?;
    all.iter().enumerate().map(|(who, bytes)| read(bytes).map_err(|e| unreadable(who, &e))).collect()
}

/// The bytes of all planes, and of the flags between them.
fn length(film: &Film, ahead: &[bool], samples: u64) -> u64 {
    let pixels = film.frame.pixels() as u64;
    let bytes = |plane: Plane| plane.bytes(&film.needs) as u64;
    let of_bank = |ahead: &bool| {
        let of = |plane: Plane| match plane {
            Plane::Samples | Plane::Trajectories => 0,
            Plane::Ahead => 1 + if *ahead { pixels * bytes(plane) } else { 0 },
            _ => pixels * bytes(plane),
        };
        OF_BANK.into_iter().map(of).sum::<u64>()
    };
    let beside: u64 = BESIDE.into_iter().map(|plane| pixels * bytes(plane)).sum();
    let one_by_one = samples * (bytes(Plane::Samples) + bytes(Plane::Trajectories));
    1 + ahead.iter().map(of_bank).sum::<u64>() + beside + one_by_one
}

/// The receiver of the bytes, if this process saves.
struct Out<'t> {
    take: Option<Take<'t>>,
    written: u64,
    length: u64,
}

impl Out<'_> {
    fn put(&mut self, bytes: &[u8]) {
        if let Some(take) = self.take.as_mut().filter(|_| !bytes.is_empty()) {
            self.written += bytes.len() as u64;
            take(bytes, self.length);
        }
    }
}

/// The rows of a film, each with one process.
struct Rows<'a> {
    film: &'a Film,
    savers: &'a [bool],
    exchange: &'a mut dyn Exchange,
}

impl Rows<'_> {
    /// Sends the own rows of a plane with about `each` bytes per pixel, and passes everyone's on from the top.
    fn send(&mut self, each: usize, out: &mut Out<'_>, put: &dyn Fn(&mut Writer, Range<usize>)) -> Result<(), Error> {
        let [width, height] = self.film.frame.size().map(|n| n as usize);
        if each == 0 {
            return Ok(());
        }
        let step = (AT_ONCE / (width * each).max(1)).max(1);
        for top in (0..height).step_by(step) {
            let rows = top..(top + step).min(height);
            let mine = self.encoded(&rows, put);
            let to_each = self.savers.iter().map(|saves| if *saves { mine.clone() } else { Vec::new() }).collect();
            let sent = self.exchange.all_to_all(to_each)?;
            if out.take.is_some() {
                let mut parts = vec![None; rows.len()];
                for (who, bytes) in sent.iter().enumerate() {
                    place(bytes, top, &mut parts).map_err(|e| unreadable(who, &e))?;
                }
                for part in parts {
                    out.put(part.ok_or(Broken("a row is with no process"))?);
                }
            }
        }
        Ok(())
    }

    /// The own ones of these rows, after a table of their numbers and lengths.
    fn encoded(&self, rows: &Range<usize>, put: &dyn Fn(&mut Writer, Range<usize>)) -> Vec<u8> {
        let (held, width) = (&self.film.held, self.film.frame.size()[0] as usize);
        let (mut table, mut bytes) = (Vec::new(), Writer::with_capacity(0));
        for &row in held.own().iter().filter(|row| rows.contains(&(**row as usize))) {
            let (first, before) = (held.at(row as usize * width), bytes.length());
            put(&mut bytes, first..first + width);
            table.push([u64::from(row), (bytes.length() - before) as u64]);
        }
        let mut to = Writer::with_capacity(8 + 16 * table.len() + bytes.length());
        to.list(&table);
        to.raw(&bytes.finish());
        to.finish()
    }
}

/// Finds the rows, from row `top`, in the bytes that a process sent.
fn place<'b>(bytes: &'b [u8], top: usize, parts: &mut [Option<&'b [u8]>]) -> Result<(), Broken> {
    let mut from = Reader::new(bytes);
    for [row, length] in from.list::<[u64; 2]>()? {
        let out_of_range = Broken("rows are out of range");
        let place = usize::try_from(row).ok().and_then(|row| row.checked_sub(top)).and_then(|at| parts.get_mut(at));
        *place.ok_or(out_of_range)? = Some(from.raw(usize::try_from(length).unwrap_or(usize::MAX))?);
    }
    Ok(())
}
