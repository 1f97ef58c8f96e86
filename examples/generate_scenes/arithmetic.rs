//! Vectors, angles and noise with bit-identical results on every machine.

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|x| x * s)
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Returns the unit vector along `a`, which must not be zero.
pub(crate) fn normalize(a: [f64; 3]) -> [f64; 3] {
    scale(a, 1.0 / length(a))
}

/// Returns 0 for `x` below `from`, 1 above `to`, and `t^2 (3 - 2 t)` between, where `t` rises linearly from 0 to 1.
pub(crate) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

pub(crate) fn mix<const N: usize>(a: [f64; N], b: [f64; N], t: f64) -> [f64; N] {
    std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t)
}

/// Returns the sine and the cosine of an angle of `turns` full turns, within 1e-12, for `turns` in `[0, 1]`.
///
/// Uses Taylor polynomials about the nearest quarter turn, because the platform's functions differ in the last bit between
/// machines.
pub(crate) fn sin_cos(turns: f64) -> [f64; 2] {
    let quarter = (4.0 * turns).round();
    let x = (turns - 0.25 * quarter) * (2.0 * std::f64::consts::PI);
    let square = x * x;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in (0..8).rev() {
        let k = f64::from(k);
        sine = 1.0 - square / ((2.0 * k + 2.0) * (2.0 * k + 3.0)) * sine;
        cosine = 1.0 - square / ((2.0 * k + 1.0) * (2.0 * k + 2.0)) * cosine;
    }
    let sine = x * sine;
    match quarter as u32 % 4 {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    }
}

/// Returns the unit direction (z up) through the centre of a pixel of a latitude-longitude image, laid out as in
/// `dapple_scene::EnvironmentRadiance::LatLong`.
pub(crate) fn lat_long_direction(column: usize, row: usize, width: usize, height: usize) -> [f64; 3] {
    let [sin_phi, cos_phi] = sin_cos((column as f64 + 0.5) / width as f64);
    let [sin_theta, cos_theta] = sin_cos(0.5 * (row as f64 + 0.5) / height as f64);
    [sin_theta * cos_phi, sin_theta * sin_phi, cos_theta]
}

/// Returns a 64-bit hash of `x`: the finaliser of [Steele et al. 2014], with the constants of Stafford's variant 13.
pub(crate) fn mix_bits(mut x: u64) -> u64 {
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
pub(crate) fn gradient_noise([x, y]: [f64; 2], seed: u64) -> f64 {
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
pub(crate) fn fbm(mut point: [f64; 2], seed: u64, octaves: u32) -> f64 {
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
pub(crate) fn ridged(mut point: [f64; 2], seed: u64, octaves: u32) -> f64 {
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
