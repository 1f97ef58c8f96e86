//! Shards: parts of one image, rendered by machines that do not communicate.

use crate::film::{Picked, Splats, keep_first};
use crate::snapshot::bytes::{Reader, Writer};
use crate::snapshot::film::{put_film, size, take_film};
use crate::snapshot::{Broken, check_head};
use crate::{
    BudgetLeft, Error, Feedback, Film, Frame, Limits, Needs, Plan, PointSet, Progress, Record, Retention, RoundRecord,
    Sampler, SamplerMemory, saturating_u32,
};

/// One machine's part of an image: every `of`-th row of the window, starting at row `index`.
///
/// Interleaved rows cost about the same in sum, so machines finish at about the same time. Each pixel belongs to one
/// machine, so the image that [`merge`] returns has the same bits as a render on one machine.
///
/// ```
/// # use dapple_core::{PointSet, SampleId};
/// # struct Centre;
/// # impl PointSet for Centre {
/// #     fn describe(&self) -> String { "centre".into() }
/// #     fn block(&self, _: SampleId, _: u32) -> [f32; 4] { [0.5; 4] }
/// #     fn capacity(&self) -> u64 { u64::MAX }
/// # }
/// # use dapple_core::{Draws, Estimate, Integrator, Worker};
/// # struct Ramp;
/// # impl Integrator for Ramp {
/// #     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
/// #         Estimate::new([draws.pixel()[0] as f32; 3])
/// #     }
/// # }
/// use dapple_core::samplers::Uniform;
/// use dapple_core::{Frame, Limits, Render, Shard, ShardFilm, Sharded, merge};
///
/// let frame = Frame::new(8, 6)?;
/// let limits = Limits::samples(4 * 8 * 6);
///
/// // On each machine, one of two shards; the bytes travel.
/// let machine = |index| -> Result<Vec<u8>, dapple_core::Error> {
///     let shard = Shard::new(index, 2)?;
///     let mut uniform = Uniform::new(Centre);
///     let mut sampler = Sharded::new(&mut uniform, shard, &limits)?;
///     let film = Render::new(frame, &limits).run(&mut Ramp, &mut sampler)?;
///     Ok(ShardFilm::new(shard, &film)?.to_bytes())
/// };
/// let parts = [ShardFilm::from_bytes(&machine(0)?)?, ShardFilm::from_bytes(&machine(1)?)?];
///
/// let whole = Render::new(frame, &limits).run(&mut Ramp, &mut Uniform::new(Centre))?;
/// assert_eq!(merge(&parts)?.image(), whole.image());
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    of: u32,
}

impl Shard {
    /// Shard number `index` of `of`, counted from 0.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfRange`] unless `index < of`.
    pub fn new(index: u32, of: u32) -> Result<Self, Error> {
        if index < of {
            return Ok(Self { index, of });
        }
        let allowed = "a number from 0 to below the number of shards";
        Err(Error::OutOfRange { name: "shard", value: format!("{index} of {of}"), allowed })
    }

    /// The shard's number, from 0.
    pub const fn index(&self) -> u32 {
        self.index
    }

    /// The number of shards of the image.
    pub const fn of(&self) -> u32 {
        self.of
    }

    /// Returns `true` if row `row` of the window, from 0, belongs to this shard.
    pub const fn owns(&self, row: usize) -> bool {
        row % self.of as usize == self.index as usize
    }

    fn pixels(&self, frame: &Frame) -> usize {
        let [width, height] = frame.size();
        width as usize * height.saturating_sub(self.index).div_ceil(self.of) as usize
    }

    /// The numbers of the shard's pixels.
    fn numbers(&self, frame: &Frame) -> Vec<u32> {
        let width = frame.size()[0];
        (0..frame.size()[1])
            .filter(|&row| self.owns(row as usize))
            .flat_map(|row| row * width..(row + 1) * width)
            .collect()
    }
}

impl std::fmt::Display for Shard {
    /// Formats as number and total, counted from 1: `1/4` is the first of four shards.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.of)
    }
}

/// A sampler that restricts another sampler's plans to the rows of one shard.
///
/// Each machine plans the whole image as if all samples had been traced, but traces only the rows of its shard. The
/// inner sampler must be [a priori](Sampler::a_priori) and the budget a number of samples, so that all machines make
/// the same plan. For an example see [`Shard`].
pub struct Sharded<'a> {
    inner: &'a mut dyn Sampler,
    shard: Shard,
    /// A film of the whole image that holds sample counts but no sample values, for the inner sampler.
    ghost: Option<Film>,
    /// The budgets passed to the inner sampler so far, one per plan of the whole image.
    shown: Vec<BudgetLeft>,
}

impl<'a> Sharded<'a> {
    /// Restricts the plans of `inner` within `limits` to the rows of `shard`.
    ///
    /// # Errors
    ///
    /// [`Error::NoShards`] for a sampler whose counts depend on samples, and for a limit of time or error.
    pub fn new(inner: &'a mut dyn Sampler, shard: Shard, limits: &Limits) -> Result<Self, Error> {
        let refuse = |who: String, why| Err(Error::NoShards { who, why });
        if !inner.a_priori() {
            let why = "it reads samples that other machines have; take a sampler with fixed counts";
            return refuse(format!("sampler \"{}\"", inner.name()), why);
        }
        if !limits.budget.is_of_samples() {
            let why = "every machine must know the number of samples in advance; give a number of samples";
            return refuse("a limit of time or error".into(), why);
        }
        Ok(Self { inner, shard, ghost: None, shown: Vec::new() })
    }

    /// Returns the inner sampler's next plan for the whole image; `None` if it plans no more rounds.
    fn plan_whole(&mut self, frame: &Frame, halves: bool, budget: BudgetLeft) -> Result<Option<Plan>, Error> {
        let needs = self.inner.needs();
        let needs = if halves { needs.with_halves() } else { needs };
        let ghost = self.ghost.get_or_insert_with(|| Film::new(*frame, needs));
        let budget = BudgetLeft { spent: ghost.record.samples, ..budget };
        let mut plan = Plan::empty(frame.pixels());
        let round = self.shown.len() as u32;
        if self.inner.next_round(&Feedback { round, film: ghost, budget }, &mut plan)? == Progress::Done {
            return Ok(None);
        }
        self.shown.push(budget);
        let broken = |what: &str| Err(Error::BadPlan { sampler: self.inner.describe(), what: what.into() });
        let lengths = |counts: &Vec<u32>| counts.len() == frame.pixels();
        if plan.withdraw.is_some() {
            return broken("an a-priori plan withdraws samples");
        }
        if !lengths(&plan.counts) || !plan.second_half.as_ref().is_none_or(lengths) {
            return broken("its length is not the number of pixels");
        }
        if plan.second_half.is_some() && !halves {
            return broken("it has a second half, but needs() has no halves");
        }
        if plan.total() == 0 || plan.total() > budget.left() {
            return broken("it has no samples, or more than are left");
        }
        count(ghost, &plan);
        Ok(Some(plan))
    }
}

/// Adds the samples of a plan to the ghost film, which holds the counts of the whole image and no sample values.
fn count(ghost: &mut Film, plan: &Plan) {
    if plan.retention == Retention::Discard {
        ghost.open_discarded();
    }
    ghost.combine = plan.combine;
    ghost.record.samples += plan.total();
    let banks = if plan.retention == Retention::Keep { &mut ghost.kept } else { &mut ghost.discarded };
    for (i, &n) in plan.counts.iter().enumerate() {
        let n = u64::from(n);
        match (&mut banks[..], &plan.second_half) {
            ([whole], _) => whole.counts[i] += n,
            ([first, second], Some(others)) => {
                first.counts[i] += n;
                second.counts[i] += u64::from(others[i]);
            }
            ([first, second], None) => {
                // As in the render loop: to the half with fewer samples, until both are level.
                let (a, b) = (first.counts[i], second.counts[i]);
                first.counts[i] = (a + b + n).div_ceil(2).clamp(a, a + n);
                second.counts[i] = a + b + n - first.counts[i];
            }
            _ => {}
        }
    }
}

impl Sampler for Sharded<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn describe(&self) -> String {
        format!("{} shard {}", self.inner.describe(), self.shard)
    }

    fn a_priori(&self) -> bool {
        true
    }

    fn needs(&self) -> Needs {
        self.inner.needs()
    }

    fn points(&self) -> &dyn PointSet {
        self.inner.points()
    }

    fn memory(&self, frame: &Frame, needs: &Needs, limits: &Limits) -> SamplerMemory {
        // The film of the whole image holds counts; nothing else in it is ever written.
        let memory = self.inner.memory(frame, needs, limits);
        let ghost = frame.bytes(if needs.halves { 16 } else { 8 });
        SamplerMemory { state: memory.state.saturating_add(ghost), ..memory }
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        let (frame, halves) = (seen.frame(), seen.film.needs().halves);
        if self.ghost.is_none() {
            // Restored: repeat the plans so far.
            for budget in std::mem::take(&mut self.shown) {
                self.plan_whole(frame, halves, budget)?;
            }
        }
        let width = frame.size()[0] as usize;
        while let Some(mut whole) = self.plan_whole(frame, halves, seen.budget)? {
            for counts in [Some(&mut whole.counts), whole.second_half.as_mut()].into_iter().flatten() {
                let rows = counts.chunks_mut(width).enumerate();
                rows.filter(|(row, _)| !self.shard.owns(*row)).for_each(|(_, counts)| counts.fill(0));
            }
            if whole.total() > 0 {
                *plan = whole;
                return Ok(Progress::Trace);
            }
        }
        Ok(Progress::Done)
    }

    fn save(&self) -> Vec<u8> {
        let mut to = Writer::with_capacity(8 + 24 * self.shown.len());
        let shown = self.shown.iter().map(|b| [b.total, u64::from(b.min_spp), u64::from(b.max_spp)]);
        to.list(&shown.collect::<Vec<_>>());
        to.finish()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let shown: Vec<[u64; 3]> = Reader::new(saved).list()?;
        let budget = |[total, min, max]: [u64; 3]| BudgetLeft {
            spent: 0,
            total,
            min_spp: saturating_u32(min),
            max_spp: saturating_u32(max),
        };
        self.ghost = None;
        self.shown = shown.into_iter().map(budget).collect();
        Ok(())
    }
}

const MAGIC: &[u8; 8] = b"dapple-p";
const VERSION: u32 = 4;

/// The film of one shard: the statistics of its rows. For an example see [`Shard`].
#[derive(Clone, Debug, PartialEq)]
pub struct ShardFilm {
    shard: Shard,
    /// A film whose planes hold only the shard's pixels.
    film: Film,
}

impl ShardFilm {
    /// Extracts the rows of `shard` from a film that was rendered with [`Sharded`].
    ///
    /// # Errors
    ///
    /// [`Error::BadShards`] for a film of an interrupted render.
    pub fn new(shard: Shard, film: &Film) -> Result<Self, Error> {
        if film.record.interrupted {
            return Err(Error::BadShards { what: format!("shard {shard} was interrupted; resume it first") });
        }
        let film = Film {
            splats: film.splats.clone(),
            rejected: film.rejected.clone(),
            record: film.record.clone(),
            unreported: film.unreported,
            ..film.pick(Picked(&shard.numbers(&film.frame)), None)
        };
        Ok(Self { shard, film })
    }

    /// The shard: its index, and the number of shards.
    pub fn shard(&self) -> Shard {
        self.shard
    }

    /// The record of the render on the shard's machine.
    pub fn record(&self) -> &Record {
        &self.film.record
    }

    /// The shard as bytes for [`ShardFilm::from_bytes`], about as many as its film takes in memory.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut to = Writer::with_capacity(size(&self.film));
        to.raw(MAGIC);
        to.number(VERSION);
        to.number([self.shard.index, self.shard.of]);
        put_film(&mut to, &self.film);
        to.finish()
    }

    /// Reads the bytes of [`ShardFilm::to_bytes`]. Allocates at most a few times as many bytes as it reads, even for
    /// invalid bytes.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] for bytes of another kind or version, truncated or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let mut from = Reader::new(bytes);
        check_head(&mut from, MAGIC, VERSION)?;
        let [index, of] = from.number()?;
        let shard = Shard::new(index, of).map_err(|_| Broken("the number of a shard is out of range"))?;
        let film = take_film(&mut from, |frame| shard.pixels(frame))?;
        if !from.is_empty() {
            return Err(Broken("there are bytes after the end").into());
        }
        Ok(Self { shard, film })
    }
}

/// Merges the films of all shards, in any order, into the film of the whole image.
///
/// The result has the bits of a render on one machine, except for the seconds, which are summed. For an example see
/// [`Shard`].
///
/// # Errors
///
/// [`Error::BadShards`] names the shards that are missing, duplicate, or of another image: another number of shards,
/// window, budget or set of statistics. The caller must ensure that all shards have the same scene and settings.
pub fn merge(parts: &[ShardFilm]) -> Result<Film, Error> {
    let parts = in_order(parts)?;
    let first = &parts[0].film;
    let films: Vec<&Film> = parts.iter().map(|part| &part.film).collect();
    let mut whole = Film::new(first.frame, first.needs);
    for part in &parts {
        if !whole.place(Picked(&part.shard.numbers(&first.frame)), part.film.clone()) {
            return Err(uneven());
        }
    }
    whole.combine = first.combine;
    whole.splats = Splats::sum(films.iter().map(|film| &film.splats));
    whole.rejected = films.iter().flat_map(|film| &film.rejected).copied().collect();
    keep_first(&mut whole.rejected);
    whole.record = add_up(&films)?;
    whole.unreported = films.iter().try_fold(0_u64, |sum, film| sum.checked_add(film.unreported)).ok_or_else(uneven)?;
    Ok(whole)
}

fn uneven() -> Error {
    Error::BadShards { what: "they do not hold the same statistics".into() }
}

/// Returns the shards sorted by number, after checking that each shard occurs exactly once.
fn in_order(parts: &[ShardFilm]) -> Result<Vec<&ShardFilm>, Error> {
    let refuse = |what: String| Err(Error::BadShards { what });
    let Some(first) = parts.first() else { return refuse("the list is empty".into()) };
    for part in parts {
        let (a, b) = (&first.film, &part.film);
        let what = [
            (first.shard.of == part.shard.of, "it is of another number of shards"),
            (a.frame == b.frame, "it is of another window"),
            (a.needs == b.needs, "it records other statistics"),
            (a.combine == b.combine, "it combines halves by another rule"),
            (a.record.budgets == b.record.budgets, "it has another budget"),
        ];
        if let Some((_, what)) = what.iter().find(|(same, _)| !same) {
            return refuse(format!("shard {} does not belong to shard {}: {what}", part.shard, first.shard));
        }
    }
    let mut sorted: Vec<&ShardFilm> = parts.iter().collect();
    sorted.sort_by_key(|part| part.shard.index);
    if let Some(twice) = sorted.windows(2).find(|pair| pair[0].shard == pair[1].shard) {
        return refuse(format!("shard {} is given twice", twice[0].shard));
    }
    let is_there = |index: &u32| sorted.binary_search_by_key(index, |part| part.shard.index).is_ok();
    let of = first.shard.of;
    let missing: Vec<String> =
        (0..of).filter(|index| !is_there(index)).take(10).map(|index| Shard { index, of }.to_string()).collect();
    match missing.len() {
        0 => Ok(sorted),
        10 => refuse(format!("missing shards: {}, and maybe more", missing.join(", "))),
        _ => refuse(format!("missing shards: {}", missing.join(", "))),
    }
}

fn add_up(parts: &[&Film]) -> Result<Record, Error> {
    let mut sum = Record { budgets: parts[0].record.budgets.clone(), ..Record::default() };
    for record in parts.iter().map(|film| &film.record) {
        let numbers = [
            (&mut sum.samples, record.samples),
            (&mut sum.rays, record.rays),
            (&mut sum.blocks, record.blocks),
            (&mut sum.prepare_rays, record.prepare_rays),
            (&mut sum.rejected, record.rejected),
        ];
        for (sum, more) in numbers {
            *sum = sum.checked_add(more).ok_or_else(uneven)?;
        }
        // Each machine prepares by itself.
        sum.passes = sum.passes.max(record.passes);
        sum.prepare_seconds += record.prepare_seconds;
        for (i, round) in record.rounds.iter().enumerate() {
            match sum.rounds.get_mut(i) {
                None => sum.rounds.push(*round),
                Some(all) => {
                    let RoundRecord { samples, plan_seconds, trace_seconds, kept: _ } = *round;
                    all.samples = all.samples.saturating_add(samples);
                    all.plan_seconds += plan_seconds;
                    all.trace_seconds += trace_seconds;
                }
            }
        }
    }
    Ok(sum)
}
