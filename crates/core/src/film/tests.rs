use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

#[test]
fn bytes_per_pixel_are_those_of_all_planes() {
    let none = Needs::none();
    let all = none
        .with_variance()
        .with_halves()
        .with_feature_halves()
        .with_first_hits(3)
        .with_cost()
        .with_emission()
        .with_indirect();
    let each = [none, none.with_variance(), none.with_halves(), none.with_features(), none.with_cost()];
    for needs in each.into_iter().chain([none.with_emission(), none.with_indirect(), all]) {
        let film = Film::new(Frame::new(37, 11).unwrap(), needs);
        let of = |planes: &Half| {
            let Half { counts, means, m2, emission, indirect, indirect_m2, words } = planes;
            let wide = 8 * counts.len() + 24 * (means.len() + m2.len()) + 24 * words.len();
            wide + 12 * (emission.len() + indirect.len() + indirect_m2.len())
        };
        let Beside { features, half_features, first_hits, costs } = &film.beside;
        let beside = size_of::<FeatureMoments>() * (features.len() + half_features.len())
            + size_of::<Option<FirstHit>>() * first_hits.len()
            + 8 * costs.len();
        let halves: usize = film.kept.iter().map(of).sum();
        assert_eq!(halves + beside, 37 * 11 * Film::bytes_per_pixel(&needs), "{needs:?}");
    }
    // The README promises these figures.
    assert_eq!([Film::bytes_per_pixel(&none), Film::bytes_per_pixel(&none.with_variance())], [32, 56]);
    assert_eq!(Film::bytes_per_pixel(&none.with_splats().with_halves()), 2 * (32 + 48));
}

/// `E (A - B)^2 = var A + var B`, divided by count, against the spread of the mean over 20,000 pixels. The relative
/// deviation of either is sqrt(2 / 20000) = 1 %; 6 of both together are 8 %.
#[test]
#[cfg_attr(miri, ignore = "statistics: too many samples for Miri")]
fn squared_error_is_that_of_the_combined_mean() {
    for (counts, combine) in [
        ([4, 4], Combine::ByCount),
        ([2, 9], Combine::ByCount),
        ([2, 9], Combine::Equally),
        ([3, 5], Combine::Fixed(0.2)),
    ] {
        let pixels = 20_000;
        let mut film = Film::new(Frame::new(pixels, 1).unwrap(), Needs::none().with_halves());
        film.combine = combine;
        let mut state = 1u64;
        for i in 0..pixels as usize {
            for (half, &n) in counts.iter().enumerate() {
                for _ in 0..n {
                    state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                    let u = (crate::mix(state) >> 40) as f32 / (1u64 << 24) as f32;
                    film.push(i, half, [u; 3]);
                }
            }
        }
        let average = |f: &dyn Fn(usize) -> f64| (0..pixels as usize).map(f).sum::<f64>() / f64::from(pixels);
        let (predicted, actual) =
            (average(&|i| film.squared_error(i).unwrap()[0]), average(&|i| (film.mean(i)[0] - 0.5).powi(2)));
        assert!((predicted / actual - 1.0).abs() < 0.08, "{counts:?}, {combine:?}: {predicted} for {actual}");
    }
}

/// Keeping three rows of means at a time gives the bits of the formula over the whole image, for any height.
#[test]
fn predicted_errors_are_those_of_the_whole_image() {
    let mut rng = Pcg64Mcg::seed_from_u64(2026);
    for [w, h] in [[1, 1], [5, 1], [1, 2], [1, 5], [2, 3], [7, 4], [6, 11]] {
        let mut film = Film::new(Frame::new(w as u32, h as u32).expect("not empty"), Needs::none().with_halves());
        for i in 0..w * h {
            (0..4).for_each(|k| film.push(i, k & 1, [rng.random::<f32>() * (i + 1) as f32; 3]));
        }
        let mut sum = 0.0;
        for i in 0..w * h {
            let (x, y) = (i % w, i / w);
            let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
            let count = (near(y, h).len() * near(x, w).len()) as f64;
            let mut level = [0.0; 3];
            for mean in near(y, h).flat_map(|y| near(x, w).map(move |x| y * w + x)).map(|k| film.mean(k)) {
                (0..3).for_each(|c| level[c] += mean[c] / count);
            }
            let error = film.squared_error(i).expect("halves");
            sum += (0..3).map(|c| error[c] / (level[c] * level[c] + 0.01)).sum::<f64>();
        }
        let whole = sum / (3 * w * h) as f64;
        assert_eq!(film.predicted_relmse().map(f64::to_bits), Some(whole.to_bits()), "{w}x{h}");
    }
}

/// One sample in ten carries all the light, so a pixel's own mean is large where its error is.
#[test]
#[cfg_attr(miri, ignore = "statistics: too many samples for Miri")]
fn a_predicted_error_is_not_hidden_by_the_error_itself() {
    const SIDE: u32 = 64;
    const SPP: usize = 16;
    let frame = Frame::new(SIDE, SIDE).expect("not empty");
    let mut film = Film::new(frame, Needs::none().with_halves());
    let mut rng = Pcg64Mcg::seed_from_u64(2016);
    for i in 0..frame.pixels() {
        for k in 0..SPP {
            let value = if rng.random::<f32>() < 0.1 { 10.0 } else { 0.0 };
            film.push(i, k & 1, [value; 3]);
        }
    }
    // Mean 1, variance 9.
    let truth = 9.0 / SPP as f64 / 1.01;
    // The variance of the level adds about 3 * 9 / 144 = 0.19 to the mean of its inverse square. The pixel is one of
    // the nine, which subtracts some.
    let ratio = film.predicted_relmse().expect("halves") / truth;
    assert!((0.9..1.2).contains(&ratio), "{ratio}");
    // Negative control: the pixel's own mean stands for the truth.
    let own: f64 = (0..frame.pixels())
        .map(|i| film.squared_error(i).expect("halves")[0] / (film.mean(i)[0] * film.mean(i)[0] + 0.01))
        .sum();
    let ratio = own / frame.pixels() as f64 / truth;
    assert!(!(0.9..1.2).contains(&ratio), "{ratio}");
}

#[test]
fn withdrawn_emission_leaves_the_image() {
    let mut film = Film::new(Frame::new(2, 1).unwrap(), Needs::none().with_emission());
    for (emission, withdraw) in [([1.0, 0.0, 3.0], false), ([4.0; 3], true), ([9.0; 3], false)] {
        (0..2).for_each(|pixel| film.push_with_emission(pixel, 0, [10.0; 3], emission));
        if withdraw {
            film.withdraw(&[true, false]);
        }
    }
    assert_eq!([film.emission(0, 0), film.emission(1, 0)], [Some([9.0; 3]); 2]);
    assert_eq!(film.discarded[0].emission, [[2.5, 2.0, 3.5], [0.0; 3]]);
    let kept = film.emission(0, 1).unwrap();
    assert!((kept[0] - 14.0 / 3.0).abs() < 1e-6 && (film.count(1), film.discarded(0).count) == (3, 2), "{kept:?}");
}
