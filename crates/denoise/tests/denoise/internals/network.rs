//! The network on top of the filtered image.

use crate::network::improve;
use dapple_core::point_set::mix;
use dapple_core::{Estimate, Film, Filtered, FirstHit, Frame, Needs};

const NEEDS: Needs = Needs::none().with_variance().with_halves().with_features().with_emission();

/// A number in 0 to 1 by a hash.
fn noise(i: usize, k: usize) -> f32 {
    (mix((i * 31 + k) as u64) >> 40) as f32 / (1u64 << 24) as f32
}

/// The red of a pixel.
fn truth([x, y]: [usize; 2]) -> f32 {
    let surface = if x < 20 { 0.2 } else { 0.7 };
    surface * if (x / 6 + y / 6) % 2 == 0 { 0.5 } else { 1.0 }
}

/// A noisy film with edges of albedo and normal, and a smoother image of it, whose pixel `[x, y]` shows what `place` maps it to.
fn noisy(size: [usize; 2], place: impl Fn([usize; 2]) -> [usize; 2]) -> (Film, Filtered) {
    let mut film = Film::new(Frame::new(size[0] as u32, size[1] as u32).unwrap(), NEEDS);
    let mut image = Vec::new();
    for pixel in 0..size[0] * size[1] {
        let [x, y] = place([pixel % size[0], pixel / size[0]]);
        let i = 1000 * y + x;
        let truth = truth([x, y]);
        let normal = if y < 14 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let hit = FirstHit::new([x as f32, y as f32, 0.0], [0.0, 0.0, 1.0], 5.0 + noise(i, 9))
            .with_shading_normal(normal)
            .with_albedo([truth, 0.5, 0.4])
            .with_footprint(1.0);
        for k in 0..4 {
            let colour = [truth, 0.5 * truth, 0.4].map(|c| 2.0 * c * noise(i, k));
            film.push_estimate(pixel, k % 2, &Estimate::new(colour).with_first_hit(Some(hit)));
        }
        image.push([truth, 0.5 * truth, 0.4].map(|c| c * (0.8 + 0.4 * noise(i, 5))));
    }
    let error = image.iter().map(|[r, ..]| 0.01 * r).collect::<Vec<f32>>();
    (film, Filtered::new(size.map(|n| n as u32), image).with_error(error))
}

fn improved((film, image): (Film, Filtered)) -> Filtered {
    let hit = |i: usize| film.features(i).filter(|f| f.hits > 0);
    let of = |c: usize| (0..film.frame().pixels()).map(|i| hit(i).map_or(1.0, |f| f.albedo[c])).collect();
    improve(&film, image, [0, 1, 2].map(of), true)
}

/// Sums over the whole image, of which the exposure is made, are in another order; that is all.
#[test]
fn the_image_of_a_mirrored_or_transposed_film_is_mirrored_or_transposed() {
    // Padded by 0, 2 and 2 columns, and by 0, 3 and 1 rows, on either side.
    for [w, h] in [[40, 32], [36, 26], [44, 30]] {
        let plain = improved(noisy([w, h], |place| place));
        let apart = plain
            .radiance
            .iter()
            .zip(&noisy([w, h], |place| place).1.radiance)
            .any(|(a, b)| (a[0] - b[0]).abs() > 1e-3);
        assert!(apart, "the control: the network does nothing");
        let mirrored = improved(noisy([w, h], |[x, y]| [w - 1 - x, y]));
        let transposed = improved(noisy([h, w], |[x, y]| [y, x]));
        for i in 0..w * h {
            let [x, y] = [i % w, i / w];
            for other in [mirrored.radiance[y * w + w - 1 - x], transposed.radiance[x * h + y]] {
                let close = (0..3).all(|c| (other[c] - plain.radiance[i][c]).abs() < 1e-4 * plain.radiance[i][c]);
                assert!(close, "[{x}, {y}] of {w}x{h}: {other:?}, not {:?}", plain.radiance[i]);
            }
        }
    }
}

/// Powers of two change no other digit of any number but logarithms'.
#[test]
fn the_image_of_another_exposure_is_the_same() {
    let scaled = |scale: f32| {
        let (film, mut image) = noisy([40, 24], |place| place);
        let mut other = Film::new(*film.frame(), NEEDS);
        for i in 0..40 * 24 {
            for half in 0..2 {
                let mean = film.half(half, i).unwrap().mean.map(|v| v as f32 * scale);
                (0..2).for_each(|_| other.push(i, half, mean));
            }
        }
        image.radiance.iter_mut().flatten().for_each(|v| *v *= scale);
        image.error.iter_mut().flatten().for_each(|v| *v *= scale * scale);
        improved((other, image)).radiance
    };
    let (plain, bright) = (scaled(1.0), scaled(1024.0));
    for (a, b) in plain.iter().zip(&bright) {
        assert!((0..3).all(|c| (b[c] / 1024.0 - a[c]).abs() < 1e-3 * a[c]), "{a:?} {b:?}");
    }
}

/// Weights in another order, or none, would do worse than the image itself, whose error is the control.
#[test]
fn the_network_takes_most_of_the_noise_of_an_image_away() {
    let size = [64, 48];
    let (film, image) = noisy(size, |place| place);
    let error = |image: &Filtered| -> f64 {
        let of = |(i, [red, ..]): (usize, &[f32; 3])| f64::from(red - truth([i % size[0], i / size[0]])).powi(2);
        image.radiance.iter().enumerate().map(of).sum()
    };
    let before = error(&image);
    let after = error(&improved((film, image)));
    assert!(before > 0.1 && after < 0.5 * before, "{after} after {before}");
}

/// A lamp seen directly covers every second pixel of a square partly, which the image has right. Without their emission, as the control,
/// the network smooths these pixels.
#[test]
fn lamps_stay_as_the_image_has_them() {
    const SIDE: usize = 40;
    let lit = |i: usize| {
        (i % SIDE + i / SIDE).is_multiple_of(2) && (15..25).contains(&(i % SIDE)) && (15..25).contains(&(i / SIDE))
    };
    let worst = |emits: bool| {
        let mut film = Film::new(Frame::new(SIDE as u32, SIDE as u32).unwrap(), NEEDS);
        for (i, k) in (0..SIDE * SIDE).flat_map(|i| (0..4).map(move |k| (i, k))) {
            let lamp = if lit(i) { 8.0 } else { 0.0 };
            let seen = Estimate::new([lamp + 0.2 * noise(i, k); 3]);
            film.push_estimate(i, k % 2, &if emits { seen.with_emission([lamp; 3]) } else { seen });
        }
        let wanted = |i: usize| if lit(i) { 8.1 } else { 0.1 };
        let image = (0..SIDE * SIDE).map(|i| [wanted(i); 3]).collect();
        let image = Filtered::new([SIDE as u32; 2], image).with_error(vec![1e-3; SIDE * SIDE]);
        let after = improved((film, image)).radiance;
        (0..SIDE * SIDE).filter(|i| lit(*i)).map(|i| (after[i][0] / wanted(i) - 1.0).abs()).fold(0.0, f32::max)
    };
    let [with, without] = [true, false].map(worst);
    assert!(with < 0.02 && without > 0.04, "{with}, {without} without emission");
}
