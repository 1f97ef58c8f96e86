//! The clusters of a pixel's samples, and the overlap of the clusters of two pixels.

pub(crate) use dapple_core::BACKGROUND;

/// The largest number of samples per pixel whose clusters count.
pub(crate) const MOST_VOTES: usize = 8;

/// The cluster or clusters that a pixel belongs to.
pub(crate) trait Membership: Sync {
    /// The overlap of two pixels' clusters: 1 if both lie in the same cluster, 0 if they have no cluster in common.
    fn overlap(&self, other: &Self) -> f64;
}

/// The cluster of a pixel that belongs to only one.
impl Membership for u32 {
    #[inline]
    fn overlap(&self, other: &Self) -> f64 {
        if self == other { 1.0 } else { 0.0 }
    }
}

/// The clusters of a pixel's first samples (up to eight), with the number of samples in each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Votes {
    /// The clusters in ascending order. The first `len` entries are used.
    clusters: [u32; MOST_VOTES],
    counts: [u8; MOST_VOTES],
    len: u8,
    samples: u8,
}

impl Votes {
    /// Counts the samples in each cluster. `labels` are the clusters of a pixel's samples, of which the first eight
    /// count.
    pub(crate) fn count(labels: impl Iterator<Item = u32>) -> Self {
        let mut votes = [0; MOST_VOTES];
        let mut samples = 0;
        for (vote, label) in votes.iter_mut().zip(labels) {
            *vote = label;
            samples += 1;
        }
        let votes = &mut votes[..samples];
        votes.sort_unstable();
        let mut counted = Self { samples: samples as u8, ..Self::default() };
        for run in votes.chunk_by(|a, b| a == b) {
            let slot = usize::from(counted.len);
            (counted.clusters[slot], counted.counts[slot]) = (run[0], run.len() as u8);
            counted.len += 1;
        }
        counted
    }

    /// The overlap of two pixels with several clusters each; 1 if either pixel has no samples.
    #[inline(never)]
    fn merge(&self, other: &Self) -> f64 {
        // A pixel without samples matches every pixel.
        if self.samples == 0 || other.samples == 0 {
            return 1.0;
        }
        let (n, m) = (u32::from(self.samples), u32::from(other.samples));
        let (mut i, mut j, mut common) = (0, 0, 0);
        while i < usize::from(self.len) && j < usize::from(other.len) {
            match self.clusters[i].cmp(&other.clusters[j]) {
                std::cmp::Ordering::Less => i += 1,
                std::cmp::Ordering::Greater => j += 1,
                std::cmp::Ordering::Equal => {
                    common += (u32::from(self.counts[i]) * m).min(u32::from(other.counts[j]) * n);
                    i += 1;
                    j += 1;
                }
            }
        }
        f64::from(common) / f64::from(n * m)
    }
}

impl Membership for Votes {
    /// The sum over all clusters of the smaller share: the share of one pixel's samples in the cluster or of the
    /// other's.
    #[inline]
    fn overlap(&self, other: &Self) -> f64 {
        if self.len == 1 && other.len == 1 {
            return self.clusters[0].overlap(&other.clusters[0]);
        }
        self.merge(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn votes(labels: &[u32]) -> Votes {
        Votes::count(labels.iter().copied())
    }

    #[test]
    fn overlap_is_the_common_share() {
        let cases: [(&[u32], &[u32], f64); 9] = [
            (&[3], &[3], 1.0),
            (&[3], &[4], 0.0),
            (&[3, 3, 3], &[3], 1.0),
            (&[BACKGROUND], &[BACKGROUND, BACKGROUND], 1.0),
            (&[7, 3, 7, 3], &[3, 3], 0.5),
            (&[9, 1, 1, 1], &[1, 9, 9, 9], 0.5),
            (&[1, 2, 3, 4, 5, 6, 7, 8], &[8, 7, 6, 5, 4, 3, 2, 1], 1.0),
            (&[1, 2, 3, 4, 5, 6, 7, 8], &[0, 8, 9], 0.125),
            (&[], &[5, 6], 1.0),
        ];
        for (a, b, wanted) in cases {
            assert_eq!(votes(a).overlap(&votes(b)), wanted, "{a:?} {b:?}");
            assert_eq!(votes(b).overlap(&votes(a)), wanted, "{b:?} {a:?}");
        }
    }

    #[test]
    fn a_ninth_vote_is_not_counted() {
        assert_eq!(votes(&[2; 9]), votes(&[2; 8]));
    }
}
