//! Vector and angle functions whose results are bitwise the same on every machine.

pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|x| x * s)
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn length(a: [f64; 3]) -> f64 {
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
/// Uses Taylor polynomials about the nearest quarter turn: the platform's functions differ in the last bit between
/// machines.
pub(super) fn sin_cos(turns: f64) -> [f64; 2] {
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
