//! Seeded gradient noise and fractal sums of it, bitwise the same on every machine.

/// Returns a 64-bit hash of `x`: the finaliser of [Steele et al. 2014], with the constants of Stafford's variant 13.
fn mix_bits(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Returns the pseudo-random gradient at a lattice point, each component in [-1, 1).
fn gradient(x: i64, y: i64, seed: u64) -> [f64; 2] {
    let bits = mix_bits(mix_bits(mix_bits(seed).wrapping_add(x as u64)).wrapping_add(y as u64));
    [bits >> 32, bits & 0xffff_ffff].map(|half| half as f64 / 2_147_483_648.0 - 1.0)
}

/// Returns gradient noise [Perlin 2002] at a point: about -0.8 to 0.8, zero at lattice points.
pub(super) fn gradient_noise([x, y]: [f64; 2], seed: u64) -> f64 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (u, v) = (x - cell_x, y - cell_y);
    let corner = |i: i64, j: i64| {
        let [gx, gy] = gradient(cell_x as i64 + i, cell_y as i64 + j, seed);
        gx * (u - i as f64) + gy * (v - j as f64)
    };
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (s, t) = (fade(u), fade(v));
    let low = corner(0, 0) * (1.0 - s) + corner(1, 0) * s;
    let high = corner(0, 1) * (1.0 - s) + corner(1, 1) * s;
    low * (1.0 - t) + high * t
}

/// Returns the point at which to evaluate the next octave of noise: the given point scaled by 2 and rotated by the
/// angle of a 3-4-5 triangle. The rotation keeps the lattices of different octaves apart.
fn next_octave([x, y]: [f64; 2]) -> [f64; 2] {
    [2.0 * (0.8 * x - 0.6 * y), 2.0 * (0.6 * x + 0.8 * y)]
}

/// Returns fractional Brownian motion at a point: a sum of octaves of gradient noise, each with half the amplitude.
pub(super) fn fbm(mut point: [f64; 2], seed: u64, octaves: u32) -> f64 {
    let (mut sum, mut height) = (0.0, 1.0);
    for octave in 0..octaves {
        sum += height * gradient_noise(point, seed + u64::from(octave));
        height *= 0.5;
        point = next_octave(point);
    }
    sum
}

/// Returns ridged multifractal noise at a point (after Musgrave, in Ebert et al. 2003), 0 to about 2. It is a sum of
/// octaves of `(1 - |noise|)^2`. Each octave is weighted by the octave before, so that ridges are rough and valleys
/// smooth.
pub(super) fn ridged(mut point: [f64; 2], seed: u64, octaves: u32) -> f64 {
    let (mut sum, mut height, mut weight) = (0.0, 1.0, 1.0);
    for octave in 0..octaves {
        let ridge = 1.0 - (1.6 * gradient_noise(point, seed + u64::from(octave))).abs().min(1.0);
        let signal = ridge * ridge * weight;
        sum += height * signal;
        weight = (2.0 * signal).min(1.0);
        height *= 0.5;
        point = next_octave(point);
    }
    sum
}
