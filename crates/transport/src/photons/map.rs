//! A photon map with one radius: photons sorted into the cells of a grid.

use glam::{IVec3, Vec3};
use std::f32::consts::PI;

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
    radius: f32,
    /// 1 over the area of a look-up times the number of emitted photons.
    density: f32,
}

impl PhotonMap {
    /// Sorts the photons that arrived of `emitted` ones. Cells are as wide as the look-up's disk.
    pub(super) fn new(arrived: &[Photon], emitted: u32, radius: f32) -> Self {
        let buckets = arrived.len().next_power_of_two();
        let mut map = Self { photons: Vec::new(), starts: vec![0; buckets + 1], radius, density: 0.0 };
        map.density = (PI * radius * radius * emitted as f32).recip();
        let bucket_of: Vec<u32> = arrived.iter().map(|p| map.bucket(map.cell(p.position))).collect();
        for &bucket in &bucket_of {
            map.starts[bucket as usize + 1] += 1;
        }
        for i in 0..buckets {
            map.starts[i + 1] += map.starts[i];
        }
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
                    for photon in &self.photons[start..end] {
                        if photon.position.distance_squared(position) <= self.radius * self.radius {
                            visit(photon);
                        }
                    }
                }
            }
        }
    }

    /// 1 over the area of a look-up times the number of emitted photons.
    pub(super) fn density(&self) -> f32 {
        self.density
    }

    pub(super) fn radius(&self) -> f32 {
        self.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photon(position: Vec3) -> Photon {
        let flux = Vec3::splat(1.0);
        Photon { position, from: Vec3::Z, normal: Vec3::Z, flux, bounces: 1, is_caustic: true }
    }

    #[test]
    fn a_look_up_finds_each_photon_within_the_radius_once() {
        // A Weyl sequence in the cube [-1, 1]^3.
        let place = |i: u32| {
            Vec3::new(0.754_877_7, 0.569_840_3, 0.321_927_4)
                .map(|a| 2.0 * (f64::from(i) * f64::from(a)).fract() as f32 - 1.0)
        };
        let photons: Vec<Photon> = (0..5000).map(|i| photon(place(i))).collect();
        for radius in [0.01, 0.1, 0.35, 3.0] {
            let map = PhotonMap::new(&photons, 5000, radius);
            for at in (0..200).map(|i| place(7 * i + 100_000)) {
                let mut found = 0;
                map.near(at, |_| found += 1);
                let expected = photons.iter().filter(|p| p.position.distance(at) <= radius).count();
                assert_eq!(found, expected, "around {at} within {radius}");
            }
        }
        PhotonMap::new(&[], 0, 1.0).near(Vec3::ZERO, |_| panic!("there are no photons"));
    }
}
