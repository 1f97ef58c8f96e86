//! The light of fireflies: single samples that would brighten all that lies around them.

use dapple_core::{Estimate, Film, Filter as _, Filtered, Frame, point_set::mix};
use dapple_denoise::{ClusterRegression, FireflyLight, SampleBuffers, denoise};

const SIZE: [u32; 2] = [96, 80];
const PIXELS: usize = 96 * 80;
const PLACE: usize = 40 * 96 + 48;

/// A random number in 0 to 1.
fn unit(i: u64) -> f32 {
    (mix(i) >> 40) as f32 / (1u32 << 24) as f32
}

/// Two halves of a grey image of 0.5 with noise.
fn halves() -> [Vec<[f32; 3]>; 2] {
    [0, 1].map(|half| (0..PIXELS).map(|i| [0.5 + 0.4 * (unit(2 * i as u64 + half) - 0.5); 3]).collect())
}

fn image(halves: &[Vec<[f32; 3]>; 2], light: FireflyLight) -> Filtered {
    let [a, b] = halves.each_ref().map(|half| SampleBuffers::new(half, 8));
    denoise(SIZE, &a, &b).fireflies(light).run().unwrap()
}

/// The mean of an image, and its largest difference from 0.5 outside a pixel.
fn figures(image: &Filtered, but: usize) -> [f32; 2] {
    let mean = image.radiance.iter().map(|c| f64::from(c[1])).sum::<f64>() / PIXELS as f64;
    let others = image.radiance.iter().enumerate().filter(|(i, _)| *i != but);
    [mean as f32, others.map(|(_, c)| (c[1] - 0.5).abs()).fold(0.0, f32::max)]
}

#[test]
fn the_light_of_a_firefly_stays_in_its_pixel_or_is_left_out() {
    let mut seen = halves();
    seen[0][PLACE] = [1e5; 3];
    let kept = image(&seen, FireflyLight::Keep);
    let [mean, apart] = figures(&kept, PLACE);
    let light = 0.5 + 0.5 * 1e5 / PIXELS as f32;
    assert!((mean / light - 1.0).abs() < 0.01 && apart < 0.1, "mean {mean} of {light}, {apart} elsewhere");
    assert!((kept.radiance[PLACE][1] - 5e4).abs() < 1.0, "{:?}", kept.radiance[PLACE]);
    assert!(kept.error.unwrap()[PLACE] > 1e9);
    assert!(kept.fireflies.pixels == 1 && !kept.fireflies.dropped, "{}", kept.fireflies);
    assert!((kept.fireflies.light - 5e4).abs() < 1.0, "{}", kept.fireflies);

    let dropped = image(&seen, FireflyLight::Drop);
    let [mean, apart] = figures(&dropped, PIXELS);
    assert!((mean - 0.5).abs() < 0.01 && apart < 0.2, "mean {mean}, {apart} from it");
    assert!(dropped.fireflies.dropped && dropped.fireflies.light == kept.fireflies.light);

    // The control: without care the light fills the image.
    let [mean, apart] = figures(&image(&seen, FireflyLight::Spread), PLACE);
    assert!((mean / light - 1.0).abs() < 0.1 && apart > 1.0, "mean {mean} of {light}, {apart} elsewhere");
}

#[test]
fn light_that_both_halves_or_many_pixels_have_seen_is_no_firefly() {
    let mut both = halves();
    both.iter_mut().for_each(|half| half[PLACE] = [1e5; 3]);
    for light in [FireflyLight::Keep, FireflyLight::Drop] {
        let image = image(&both, light);
        let [_, apart] = figures(&image, PLACE);
        assert!(image.fireflies.pixels == 0 && (image.radiance[PLACE][1] - 1e5).abs() < 1.0, "{}", image.fireflies);
        assert!(apart < 0.1, "{apart} beside a star");
    }
    // A reflection that one sample in 50 finds: each has less than 2 % of the light.
    let mut rare = halves();
    (0..PIXELS).filter(|i| unit(7 * *i as u64) < 0.02).for_each(|i| rare[i % 2][i] = [50.0; 3]);
    let [kept, spread] = [FireflyLight::Keep, FireflyLight::Spread].map(|light| image(&rare, light));
    assert_eq!(kept, spread);
}

#[test]
fn a_firefly_among_single_samples_stays_in_its_pixel() {
    let filter = ClusterRegression::new().without_features();
    let mut film = Film::new(Frame::new(SIZE[0], SIZE[1]).unwrap(), filter.needs());
    for i in 0..PIXELS {
        let value = if i == PLACE { 1e5 } else { 0.5 + 0.4 * (unit(i as u64) - 0.5) };
        film.push_estimate(i, i % 2, &Estimate::new([value; 3]));
    }
    let kept = filter.apply(&film).unwrap();
    let [mean, apart] = figures(&kept, PLACE);
    let light = 0.5 + 1e5 / PIXELS as f32;
    assert!((mean / light - 1.0).abs() < 0.01 && apart < 0.2, "mean {mean} of {light}, {apart} elsewhere");
    assert!((kept.radiance[PLACE][1] - 1e5).abs() < 1.0 && kept.fireflies.pixels == 1);
}

#[test]
fn many_fireflies_do_not_hide_each_other_and_negative_ones_are_as_bad() {
    let mut many = halves();
    let places: Vec<usize> = (0..30).map(|k| (k * 257 + 90) % PIXELS).collect();
    places.iter().enumerate().for_each(|(k, i)| many[k % 2][*i] = [if k % 3 == 0 { -3e3 } else { 2e3 }; 3]);
    let dropped = image(&many, FireflyLight::Drop);
    let apart = |image: &Filtered, i: usize| (image.radiance[i][1] - 0.5).abs();
    let most =
        |image: &Filtered| (0..PIXELS).filter(|i| !places.contains(i)).map(|i| apart(image, i)).fold(0.0, f32::max);
    assert!(most(&dropped) < 0.15 && dropped.fireflies.pixels == 30, "{} {}", most(&dropped), dropped.fireflies);
    let spread = image(&many, FireflyLight::Spread);
    assert!(most(&spread) > 0.5, "the control: {}", most(&spread));
}
