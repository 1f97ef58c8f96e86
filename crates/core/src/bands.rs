//! Bands of rows, and their division among processes.

use std::ops::Range;

/// Rows of a band: the side of the blocks in which training data is summed, so that no sum crosses two bands.
pub(crate) const BAND: usize = 16;

/// The measured cost of a band: nanoseconds of one thread, and the samples that took them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct BandCost {
    pub(crate) nanoseconds: u64,
    pub(crate) samples: u64,
}

/// The owner of each band of 16 rows. It decides who traces a pixel, and no bit of the image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Deal {
    owners: Vec<u32>,
}

impl Deal {
    /// Deals the bands of `rows` rows in turn.
    pub(crate) fn in_turn(rows: usize, of: u32) -> Self {
        Self { owners: (0..bands(rows) as u32).map(|band| band % of.max(1)).collect() }
    }

    /// Deals bands by cost to processes with these numbers of threads: the dearest first, each to the process that
    /// would end it first [Graham 1969]. Equal costs are dealt in turn.
    pub(crate) fn by_cost(costs: &[u64], threads: &[u32]) -> Self {
        let mut order: Vec<usize> = (0..costs.len()).collect();
        order.sort_by_key(|&band| std::cmp::Reverse(costs[band]));
        let mut loads = vec![0_u128; threads.len()];
        let mut owners = vec![0; costs.len()];
        for band in order {
            // A band without a measured cost counts as a little work, so that such bands are spread as well.
            let cost = u128::from(costs[band].max(1));
            let end = |who: &usize| (loads[*who] + cost) * 1024 / u128::from(threads[*who].max(1));
            let who = (0..threads.len()).min_by_key(end).unwrap_or(0);
            loads[who] += cost;
            owners[band] = who as u32;
        }
        Self { owners }
    }

    /// Moves bands from the process that would end last to the one that would end first, or swaps two of them, while the last
    /// end comes at least 0.5 % earlier by it. Other bands keep their owners, whose rows need not be sent. A process that has
    /// `most` bands gets another one only for one of its own.
    pub(crate) fn rebalanced(mut self, costs: &[u64], threads: &[u32], most: impl Fn(usize) -> usize) -> Self {
        let cost = |band: usize| u128::from(costs[band].max(1)) * 1024;
        let end = |load: u128, who: usize| load / u128::from(threads[who].max(1));
        let mut loads = vec![0_u128; threads.len()];
        self.owners.iter().enumerate().for_each(|(band, &owner)| loads[owner as usize] += cost(band));
        for _ in 0..costs.len() {
            let ends = || (0..threads.len()).map(|who| end(loads[who], who)).zip(0..);
            let (Some((late, last)), Some((_, first))) = (ends().max(), ends().min()) else { break };
            // The later of both ends, if `gone` goes to the first and `come` comes back.
            let after = |(gone, come): &(usize, Option<usize>)| {
                let (gone, come) = (cost(*gone), come.map_or(0, cost));
                end(loads[last] - gone + come, last).max(end(loads[first] - come + gone, first))
            };
            let own: Vec<usize> = self.of(first as u32).collect();
            let alone = (own.len() < most(first)).then_some(None);
            let back: Vec<Option<usize>> = alone.into_iter().chain(own.into_iter().map(Some)).collect();
            let moves = self.of(last as u32).flat_map(|gone| back.iter().map(move |come| (gone, *come)));
            let Some((gone, come)) = moves.min_by_key(after).filter(|best| after(best) * 200 <= late * 199) else {
                break;
            };
            for (band, from, to) in std::iter::once((gone, last, first)).chain(come.map(|come| (come, first, last))) {
                loads[from] -= cost(band);
                loads[to] += cost(band);
                self.owners[band] = to as u32;
            }
        }
        self
    }

    /// The owner of each band.
    pub(crate) fn owners(&self) -> &[u32] {
        &self.owners
    }

    /// The runs of rows of `who` among `rows` rows, from the top.
    pub(crate) fn runs(&self, who: u32, rows: usize) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for band in self.of(who) {
            let of_band = band * BAND..((band + 1) * BAND).min(rows);
            match runs.last_mut() {
                Some(run) if run.end == of_band.start => run.end = of_band.end,
                _ => runs.push(of_band),
            }
        }
        runs
    }

    /// The rows of others that lie at most `halo` rows from those of `who`, from the top.
    pub(crate) fn halo(&self, who: u32, rows: usize, halo: usize) -> Vec<usize> {
        let near = |run: Range<usize>| run.start.saturating_sub(halo)..(run.end + halo).min(rows);
        let mut around: Vec<usize> = self.runs(who, rows).into_iter().flat_map(near).collect();
        around.retain(|&row| self.owner(row) != who);
        around.sort_unstable();
        around.dedup();
        around
    }

    /// The owner of a row of pixels.
    pub(crate) fn owner(&self, row: usize) -> u32 {
        self.owners.get(row / BAND).copied().unwrap_or(0)
    }

    /// The numbers of the bands of `who`.
    pub(crate) fn of(&self, who: u32) -> impl Iterator<Item = usize> + '_ {
        self.owners.iter().enumerate().filter(move |(_, owner)| **owner == who).map(|(band, _)| band)
    }
}

/// The number of bands of `rows` rows.
pub(crate) fn bands(rows: usize) -> usize {
    rows.div_ceil(BAND)
}

/// The expected cost of each band, from the cost of its samples so far and the number to come. Bands without a measured
/// sample cost as much as the mean.
pub(crate) fn expected(measured: &[BandCost], to_come: &[u64]) -> Vec<u64> {
    let sum = |of: fn(&BandCost) -> u64| measured.iter().map(|cost| u128::from(of(cost))).sum::<u128>();
    let mean = (sum(|cost| cost.nanoseconds), sum(|cost| cost.samples));
    let one = |(cost, &samples): (&BandCost, &u64)| {
        let (nanoseconds, of) = match cost.samples {
            0 => mean,
            n => (u128::from(cost.nanoseconds), u128::from(n)),
        };
        (nanoseconds * u128::from(samples) / of.max(1)).min(u128::from(u64::MAX)) as u64
    };
    measured.iter().zip(to_come).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_dealt_in_turn_without_costs_and_evenly_with_them() {
        let turn = Deal::in_turn(100, 3);
        assert_eq!((0..100).step_by(16).map(|row| turn.owner(row)).collect::<Vec<_>>(), [0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(Deal::by_cost(&[0; 7], &[1; 3]), turn);
        // One band costs as much as all others: its owner gets nothing else.
        let deal = Deal::by_cost(&[1, 1, 6, 1, 1, 1, 1], &[1, 1]);
        assert_eq!(deal.of(deal.owner(2 * BAND)).collect::<Vec<_>>(), [2]);
        // A process with three times the threads gets three times the work.
        let deal = Deal::by_cost(&[5; 8], &[3, 1]);
        assert_eq!(deal.of(0).count(), 6);
    }

    #[test]
    fn rebalancing_moves_few_bands() {
        let any = |_| usize::MAX;
        let turn = Deal::in_turn(160, 2);
        assert_eq!(turn.clone().rebalanced(&[7; 10], &[1; 2], any), turn);
        // The first band costs as much as all of the others of its owner.
        let costs = [10, 2, 2, 2, 2, 2, 2, 2, 2, 2];
        let moved = turn.clone().rebalanced(&costs, &[1; 2], any);
        let load = |who| moved.of(who).map(|band| costs[band]).sum::<u64>();
        assert_eq!([load(0), load(1)], [14, 14]);
        assert_eq!(moved.owners().iter().zip(turn.owners()).filter(|(a, b)| a != b).count(), 2);
        // No band is small enough to move; two of different costs change places.
        let costs = [10, 9, 10, 9, 10, 9, 10, 9];
        let swapped = Deal::in_turn(128, 2).rebalanced(&costs, &[1; 2], any);
        let load = |who| swapped.of(who).map(|band| costs[band]).sum::<u64>();
        assert_eq!([load(0), load(1)], [38, 38]);
        // The second process has nothing left, and may have six bands of ten.
        let costs: [u64; 10] = std::array::from_fn(|band| if band % 2 == 0 { 5 } else { 0 });
        let full = Deal::in_turn(160, 2).rebalanced(&costs, &[1; 2], |_| 6);
        assert_eq!(full.of(1).count(), 6);
        let load = |who| full.of(who).map(|band| costs[band]).sum::<u64>();
        assert!(load(0).abs_diff(load(1)) <= 5);
    }

    #[test]
    fn halos_are_the_rows_of_others_around_the_own_ones() {
        let deal = Deal::in_turn(70, 3);
        assert_eq!(deal.runs(0, 70), [0..16, 48..64]);
        assert_eq!(deal.halo(0, 70, 2), [16, 17, 46, 47, 64, 65]);
        assert_eq!(deal.runs(1, 70), [16..32, 64..70]);
        assert_eq!(deal.halo(1, 70, 2), [14, 15, 32, 33, 62, 63]);
        // Halos of two bands meet.
        assert_eq!(deal.halo(0, 70, 40), (16..48).chain(64..70).collect::<Vec<_>>());
        assert_eq!(Deal::in_turn(70, 1).halo(0, 70, 2), [0; 0]);
    }

    #[test]
    fn more_processes_than_bands_leave_some_without_work() {
        let deal = Deal::by_cost(&[3, 2], &[1; 7]);
        assert_eq!((0..7).map(|who| deal.of(who).count()).sum::<usize>(), 2);
        assert!((0..7).all(|who| deal.of(who).count() <= 1));
    }

    #[test]
    fn expected_costs_follow_the_samples_to_come() {
        let cost = |nanoseconds, samples| BandCost { nanoseconds, samples };
        let measured = [cost(100, 10), cost(300, 10), cost(0, 0)];
        assert_eq!(expected(&measured, &[20, 5, 2]), [200, 150, 40]);
        assert_eq!(expected(&[cost(0, 0); 2], &[20, 5]), [0, 0]);
    }
}
