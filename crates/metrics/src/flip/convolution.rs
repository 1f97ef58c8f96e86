//! Separable convolution of image planes. Beyond the edge, the pixels of the edge are repeated.

/// A one-dimensional convolution kernel, with taps at the offsets `-radius..=radius`.
pub(super) struct Kernel {
    taps: Vec<f64>,
}

impl Kernel {
    pub(super) fn sample(radius: i32, value: impl Fn(i32) -> f64) -> Self {
        Self { taps: (-radius..=radius).map(value).collect() }
    }

    pub(super) fn sum(&self) -> f64 {
        self.taps.iter().sum()
    }

    pub(super) fn scale(&mut self, by: f64) {
        self.taps.iter_mut().for_each(|tap| *tap *= by);
    }

    /// Scales the kernel so that positive taps add up to 1 and negative ones to -1.
    pub(super) fn normalised(mut self) -> Self {
        let sum = |sign: f64| self.taps.iter().map(|tap| (tap * sign).max(0.0)).sum::<f64>();
        let [positive, negative] = [sum(1.0), sum(-1.0)];
        self.taps
            .iter_mut()
            .for_each(|tap| *tap /= if *tap > 0.0 { positive } else { negative.max(f64::MIN_POSITIVE) });
        self
    }

    fn radius(&self) -> usize {
        self.taps.len() / 2
    }

    /// The taps above 1e-12 of the largest one, with their offsets from the first tap. Smaller taps do not change an
    /// f32 sum.
    fn effective(&self) -> impl Iterator<Item = (usize, f32)> {
        let largest = self.taps.iter().fold(0.0, |m: f64, t| m.max(t.abs()));
        self.taps.iter().map(|&t| t as f32).enumerate().filter(move |(_, t)| f64::from(t.abs()) > 1e-12 * largest)
    }
}

/// One f32 value per pixel, row by row.
pub(super) struct Plane {
    pub(super) size: [usize; 2],
    pub(super) values: Vec<f32>,
}

impl Plane {
    /// Returns the plane convolved along its rows.
    pub(super) fn across(&self, kernel: &Kernel) -> Plane {
        let [width, radius] = [self.size[0], kernel.radius()];
        let mut values = vec![0.0; self.values.len()];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in self.values.chunks_exact(width).zip(values.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (first, tap) in kernel.effective() {
                add(out, &padded[first..first + width], tap);
            }
        }
        Plane { size: self.size, values }
    }

    /// Returns the plane convolved along its columns.
    pub(super) fn down(&self, kernel: &Kernel) -> Plane {
        let [width, height] = self.size;
        let mut values = vec![0.0; self.values.len()];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (offset, tap) in kernel.effective() {
                let from = (y + offset).saturating_sub(kernel.radius()).min(height - 1);
                add(out, &self.values[from * width..][..width], tap);
            }
        }
        Plane { size: self.size, values }
    }
}

fn add(out: &mut [f32], row: &[f32], tap: f32) {
    out.iter_mut().zip(row).for_each(|(out, v)| *out += tap * v);
}
