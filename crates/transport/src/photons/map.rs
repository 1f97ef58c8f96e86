//! The radii of passes, and a spatial hash of photons.

use glam::{IVec3, Vec3};
use std::f32::consts::PI;

/// Returns the squared radius of a pass, divided by the squared radius of the first pass.
pub(super) fn shrunk(alpha: f64, pass: u32) -> f64 {
    (1..=pass).map(f64::from).fold(1.0, |square, i| square * (i + alpha) / (i + 1.0))
}

/// A photon: flux that arrived at a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    pub(super) position: Vec3,
    /// The unit direction from which the light came.
    pub(super) from: Vec3,
    /// The unit geometric normal of the surface.
    pub(super) normal: Vec3,
    pub(super) flux: Vec3,
    /// The number of scattering events before the arrival.
    pub(super) bounces: u32,
    /// True if all scattering events were specular.
    pub(super) is_caustic: bool,
}

/// The photons of one pass, for look-ups within a fixed radius.
#[derive(Clone, Debug, Default)]
pub(super) struct PhotonMap {
    /// The photons, sorted by bucket, then by order of emission, so that sums are always bit-identical.
    photons: Vec<Photon>,
    /// The index of each bucket's first photon, and the number of photons.
    starts: Vec<u32>,
    pub(super) radius: f32,
    /// The reciprocal of the product of a look-up's area and the number of emitted photons.
    pub(super) density: f32,
}

impl PhotonMap {
    /// Sorts the `arrived` photons into cells as wide as the look-up's disk. `emitted` is the number of photons emitted.
    pub(super) fn new(arrived: &[Photon], emitted: u32, radius: f32) -> Self {
        let buckets = arrived.len().next_power_of_two();
        let mut map = Self { photons: Vec::new(), starts: vec![0; buckets + 1], radius, density: 0.0 };
        map.density = (PI * radius * radius * emitted as f32).recip();
        let bucket_of: Vec<u32> = arrived.iter().map(|p| map.bucket(map.cell(p.position))).collect();
        bucket_of.iter().for_each(|bucket| map.starts[*bucket as usize + 1] += 1);
        (0..buckets).for_each(|i| map.starts[i + 1] += map.starts[i]);
        let mut next = map.starts.clone();
        let mut order = vec![0u32; arrived.len()];
        for (photon, &bucket) in (0..).zip(&bucket_of) {
            order[next[bucket as usize] as usize] = photon;
            next[bucket as usize] += 1;
        }
        map.photons = order.into_iter().map(|photon| arrived[photon as usize]).collect();
        map
    }

    fn cell(&self, position: Vec3) -> IVec3 {
        (position * (0.5 / self.radius)).floor().as_ivec3()
    }

    /// Returns the bucket of a cell by a hash [Teschner et al. 2003].
    fn bucket(&self, cell: IVec3) -> u32 {
        let hash = (cell.x as u32).wrapping_mul(73_856_093)
            ^ (cell.y as u32).wrapping_mul(19_349_663)
            ^ (cell.z as u32).wrapping_mul(83_492_791);
        hash & (self.starts.len() as u32 - 2)
    }

    /// Calls `visit` for each photon within the radius around a point.
    #[inline]
    pub(super) fn near(&self, position: Vec3, mut visit: impl FnMut(&Photon)) {
        if self.photons.is_empty() {
            return;
        }
        let reach = Vec3::splat(self.radius);
        let [low, high] = [self.cell(position - reach), self.cell(position + reach)];
        let (mut seen, mut count) = ([0u32; 8], 0);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let bucket = self.bucket(IVec3::new(x, y, z));
                    // Two cells may share a bucket. Rounding could yield a third cell along an axis.
                    if seen[..count].contains(&bucket) || count == seen.len() {
                        continue;
                    }
                    seen[count] = bucket;
                    count += 1;
                    let [start, end] = [0, 1].map(|i| self.starts[bucket as usize + i] as usize);
                    let is_near = |p: &&Photon| p.position.distance_squared(position) <= self.radius * self.radius;
                    self.photons[start..end].iter().filter(is_near).for_each(&mut visit);
                }
            }
        }
    }
}
