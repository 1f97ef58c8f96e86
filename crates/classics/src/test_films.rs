//! Films of known images with noise, for tests.

use dapple_core::{Film, Frame, Needs, mix};

/// A standard normal number by Box and Muller's method, a function of `key`.
pub(crate) fn normal(key: u64) -> f64 {
    let u = |key: u64| ((mix(key.wrapping_mul(0x9e37_79b9_7f4a_7c15)) >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let radius = libm::sqrt(-2.0 * libm::log(u(key.wrapping_mul(2) ^ 1)));
    radius * libm::cos(std::f64::consts::TAU * u(key.wrapping_mul(2)))
}

/// A grey film of `image(x, y)` with `spp` samples per pixel and normal noise of standard deviation `noise(x, y)`. The two
/// halves take turns if the film has halves.
pub(crate) fn noisy_film(
    size: [u32; 2],
    spp: u64,
    needs: Needs,
    seed: u64,
    image: impl Fn(u32, u32) -> f64,
    noise: impl Fn(u32, u32) -> f64,
) -> Film {
    let frame = Frame::new(size[0], size[1]).expect("a frame of the test");
    let mut film = Film::new(frame, needs);
    for i in 0..frame.pixels() {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        for sample in 0..spp {
            let key = mix(seed).wrapping_add(i as u64 * spp + sample);
            let value = (image(x, y) + noise(x, y) * normal(key)) as f32;
            film.push(i, if needs.halves { sample as usize % 2 } else { 0 }, [value; 3]);
        }
    }
    film
}
