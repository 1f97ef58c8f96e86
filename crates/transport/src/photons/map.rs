//! The radii of passes, and photons by place.

use glam::{IVec3, Vec3};
use std::f32::consts::PI;

/// The squared radius of a pass, over that of the first.
pub(super) fn shrunk(alpha: f64, pass: u32) -> f64 {
    (1..=pass).map(f64::from).fold(1.0, |square, i| square * (i + alpha) / (i + 1.0))
}

/// Light that arrived at a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    pub(super) position: Vec3,
    /// The unit direction that the light came from.
    pub(super) from: Vec3,
    /// The unit geometric normal of the surface.
    pub(super) normal: Vec3,
    pub(super) flux: Vec3,
    /// The number of scattering events on the way.
    pub(super) bounces: u32,
    /// True if all of them were specular.
    pub(super) is_caustic: bool,
}

/// The photons of one pass, for look-ups within a fixed radius.
#[derive(Clone, Debug, Default)]
pub(super) struct PhotonMap {
    /// Sorted by bucket, then in the order of emission, so that sums have the same bits every time.
    photons: Vec<Photon>,
    /// The index of each bucket's first photon, and the number of photons.
    starts: Vec<u32>,
    pub(super) radius: f32,
    /// 1 over the area of a look-up times the number of emitted photons.
    pub(super) density: f32,
}

impl PhotonMap {
    /// Sorts the photons that arrived of `emitted` ones. Cells are as wide as the look-up's disk.
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

    /// The hash of a cell [Teschner et al. 2003].
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
                    // Two cells may share a bucket. Rounding could make three cells of two.
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
