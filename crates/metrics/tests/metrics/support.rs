//! Random numbers, and the same images as in `oracle.py`.

use dapple_metrics::Pixels;

/// Uniform numbers in [0, 1) by SplitMix64 [after Steele 2014].
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn image(&mut self, count: usize, value: impl Fn(f64) -> f64) -> Vec<[f32; 3]> {
        (0..count).map(|_| std::array::from_fn(|_| value(self.next()) as f32)).collect()
    }
}

pub(crate) fn pixels(size: [u32; 2], values: &[[f32; 3]]) -> Pixels<'_> {
    Pixels::new(size, values).unwrap()
}

pub(crate) const SIZE: [u32; 2] = [64, 48];

fn smooth(x: i32, y: i32, c: usize) -> i32 {
    [(3 * x + 20) % 256, (4 * y + 2 * x) % 256, (2 * x + y + 60) % 256][c]
}

fn noise(x: i32, y: i32, c: usize) -> i32 {
    (x * 73 + y * 151 + c as i32 * 199 + x * y * 7 + x * x * 11) % 256
}

fn value(name: &str, x: i32, y: i32, c: usize) -> i32 {
    match name {
        "smooth" => smooth(x, y, c),
        "noisy" => (smooth(x, y, c) + (noise(x, y, c) - 128).div_euclid(8)).clamp(0, 256),
        "brighter" => (smooth(x, y, c) + 10).min(256),
        "shifted" => smooth(x + 1, y, c),
        "noise" => noise(x, y, c),
        "checker" => 256 * ((x / 4 + y / 4) % 2),
        "inverse" => 256 - 256 * ((x / 4 + y / 4) % 2),
        "dark" => smooth(x, y, c) / 32,
        "firefly" if (x, y) == (40, 7) => 256,
        "firefly" => smooth(x, y, c) / 32,
        "green" => 256 * i32::from(c == 1),
        "blue" => 256 * i32::from(c == 2),
        "black" => 0,
        "white" => 256,
        _ => panic!("no image {name}"),
    }
}

/// Linear RGB in steps of 1/256.
pub(crate) fn test_image(name: &str) -> Vec<[f32; 3]> {
    let pixels = (0..SIZE[1] as i32).flat_map(|y| (0..SIZE[0] as i32).map(move |x| (x, y)));
    pixels.map(|(x, y)| std::array::from_fn(|c| value(name, x, y, c) as f32 / 256.0)).collect()
}
