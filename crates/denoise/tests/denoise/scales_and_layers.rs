//! Coarse scales of `cluster-regression`: less noise of low frequency, the same edges, the same light. Direct and indirect light,
//! filtered one by one.

use crate::support::{HALVES, Noise, film, grey, mean, squared_error, wall};
use dapple_core::{Estimate, Film, Filter, Filtered, FirstHit, Needs, OptionValue as _, Options as _};
use dapple_denoise::{ClusterRegression, ClusterRegressionOptions, Layers, Scales};

fn with(options: ClusterRegressionOptions) -> ClusterRegression {
    ClusterRegression::with_options(options).unwrap()
}

fn scaled(scales: Scales, film: &Film) -> Vec<[f32; 3]> {
    with(ClusterRegressionOptions::default().scales(scales)).apply(film).unwrap().radiance
}

/// A film of two walls that meet in column `corner`, with `count` samples in a pixel and `value` for a random number.
fn walls(
    size: [u32; 2],
    seed: u64,
    corner: u32,
    count: impl Fn(u32, u32) -> usize,
    value: impl Fn(u32, u32, f32) -> f32,
) -> Film {
    film(size, HALVES, seed, count, |[x, y], _, noise| {
        let normal = if x < corner { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let hit = FirstHit::new([x as f32, y as f32, 0.0], normal, 100.0).with_albedo([0.5; 3]).with_footprint(1.0);
        grey(value(x, y, noise.next())).with_first_hit(hit.with_shading_normal(normal))
    })
}

/// Light of 20 that one sample in 20 finds.
fn rare(noise: f32) -> f32 {
    if noise < 0.05 { 20.0 } else { 0.0 }
}

/// Rare light on a plain wall. Windows of 41x41 pixels leave patches; means over 16x16 pixels show them.
#[test]
fn coarse_scales_take_patches_off_a_plain_wall() {
    let mut errors = [[0.0f64; 2]; 2];
    for seed in 1..=3 {
        let film = walls([256, 192], seed, 0, |_, _| 8, |_, _, noise| rare(noise));
        for (k, scales) in [Scales::Fixed(0), Scales::Fixed(3)].into_iter().enumerate() {
            let image = scaled(scales, &film);
            let level = mean(&image);
            let patch = |x: usize, y: usize| {
                let rows: Vec<_> =
                    (16 * y..16 * (y + 1)).flat_map(|row| &image[256 * row + 16 * x..][..16]).copied().collect();
                mean(&rows) - level
            };
            errors[0][k] += (0..12 * 16).map(|i| patch(i % 16, i / 16).powi(2)).sum::<f64>();
            errors[1][k] += squared_error(&image, |_| level as f32);
        }
    }
    for [without, with] in errors {
        assert!(with < 0.5 * without, "{with} with scales, {without} without");
    }
}

/// A bright noisy wall beside a dark one with a tenth of its light; they meet in an odd column.
#[test]
fn coarse_scales_leave_no_halo_at_a_corner() {
    let bright = |x: u32| if x < 101 { 1.0 } else { 0.1 };
    let mut off = 0.0f64;
    for seed in 1..=4 {
        let film = walls([192, 96], seed, 101, |_, _| 8, |x, _, noise| bright(x) * rare(noise));
        let image = scaled(Scales::Fixed(3), &film);
        let beside = (0..96).flat_map(|y| [101, 102].map(|x| f64::from(image[192 * y + x][0])));
        off += beside.map(|value| (value / 0.1 - 1.0).powi(2)).sum::<f64>() / (4.0 * 192.0);
    }
    assert!(off.sqrt() < 0.128, "{}", off.sqrt());
}

/// Bright stripes under noise that hides them, with three times the samples of dark ones. Weights by counts over wide
/// windows would make the image brighter.
#[test]
fn coarse_scales_keep_the_mean_if_counts_follow_light() {
    let bright = |x: u32| (x / 6).is_multiple_of(2);
    let count = |x: u32, _: u32| if bright(x) { 12 } else { 4 };
    let value = |x: u32, _: u32, noise: f32| if bright(x) { 1.4 * rare(noise) } else { rare(noise) };
    for seed in 1..=2 {
        let film = walls([192, 144], seed, 0, count, value);
        let ratio = mean(&scaled(Scales::Fixed(3), &film)) / mean(&film.image());
        assert!((ratio - 1.0).abs() < 0.015, "{ratio}");
    }
}

/// A texture that no feature shows stays at every number of scales, and at many samples an image stays what it is.
#[test]
fn coarse_scales_keep_what_both_halves_see() {
    let truth = |x: u32, y: u32| 1.0 + 0.5 * f32::from(u8::from((x / 5 + y / 7).is_multiple_of(2)));
    let film = walls([96, 80], 3, 0, |_, _| 64, |x, y, noise| truth(x, y) * (0.9 + 0.2 * noise));
    for scales in [1, 3, 8] {
        let error = squared_error(&scaled(Scales::Fixed(scales), &film), |i| truth(i as u32 % 96, i as u32 / 96));
        assert!(error < 2e-4, "{scales}: {error}");
    }
}

/// Pixels without samples, pixels with one half only, and images of one row or one pixel.
#[test]
fn coarse_scales_bridge_pixels_without_samples() {
    let count = |x: u32, y: u32| [0, 1, 8, 8][((x / 2 + y / 2) % 4) as usize];
    for size in [[70, 50], [33, 1], [1, 9], [1, 1]] {
        let image = scaled(Scales::Fixed(8), &walls(size, 5, 0, count, |_, _, noise| 0.5 + 0.5 * noise));
        assert!(image.iter().all(|pixel| (0.0..1.1).contains(&pixel[0])), "{size:?}");
        let near = |pixel: &&[f32; 3]| (pixel[0] - 0.75).abs() < 0.2;
        let share = image.iter().filter(near).count() as f32 / image.len() as f32;
        assert!(size != [70, 50] || share > 0.95, "{share}");
    }
}

#[test]
fn the_number_of_scales_is_auto_or_at_most_eight() {
    let parse = |text: &str| Scales::parse_as("scales", text, Some("auto, or 0 (none) to 8 scales"));
    assert_eq!((parse("auto").unwrap(), parse("3").unwrap()), (Scales::Auto, Scales::Fixed(3)));
    for text in ["many", "-1", "1.5", ""] {
        assert!(parse(text).unwrap_err().to_string().contains("auto, or 0 (none) to 8 scales"), "{text}");
    }
    let options = |scales| ClusterRegressionOptions::default().scales(scales);
    assert!(ClusterRegression::with_options(options(Scales::Fixed(9))).is_err());
    assert!(ClusterRegression::with_options(options(Scales::Fixed(Scales::MOST))).is_ok());
    assert!(options(Scales::Fixed(2)).describe().ends_with("scales=2,network=false"));
}

const SIDE: u32 = 48;
const LAYERED: Needs = HALVES.with_indirect();

fn layered(layers: Layers, film: &Film) -> Filtered {
    with(ClusterRegressionOptions::default().layers(layers)).apply(film).unwrap()
}

/// Direct light: bright left of a shadow's edge, which no feature tells of.
fn direct(x: u32) -> f32 {
    if x < 23 { 0.6 } else { 0.2 }
}

/// A plain wall with direct light of little noise, and indirect light of much noise and the mean 0.5. `reports` scales the indirect
/// light that samples report.
fn lit_wall((seed, spp): (u64, usize), reports: f32, direct: impl Fn(u32, &mut Noise) -> f32) -> Film {
    film(
        [SIDE; 2],
        LAYERED,
        seed,
        |_, _| spp,
        |place, _, noise| {
            let indirect = if noise.next() < 0.25 { 2.0 } else { 0.0 };
            grey(direct(place[0], noise) + indirect).with_indirect([reports * indirect; 3]).with_first_hit(wall(place))
        },
    )
}

/// The wall with the shadow.
fn shadowed(spp: usize, reports: f32) -> Film {
    lit_wall((7, spp), reports, |x, noise| direct(x) * (0.95 + 0.1 * noise.next()))
}

#[test]
fn two_layers_keep_a_shadow_under_noisy_indirect_light() {
    let film = shadowed(16, 1.0);
    let images = [Layers::One, Layers::Two].map(|layers| layered(layers, &film));
    let error = |image: &Filtered| squared_error(&image.radiance, |i| direct(i as u32 % SIDE) + 0.5);
    let [one, two] = images.each_ref().map(error);
    assert!(two < 0.5 * one, "{two} with two layers, {one} with one");
    let (got, wanted) = (mean(&images[1].radiance), mean(&film.image()));
    assert!((got / wanted - 1.0).abs() < 0.01, "{got} in the mean, not {wanted}");
    let predicted = |image: Filtered| image.error.unwrap().iter().map(|e| f64::from(*e)).sum::<f64>();
    let [one, two] = images.map(predicted);
    assert!((0.5..2.0).contains(&(two / one)), "{two} predicted with two layers, {one} with one");
}

/// Detail of indirect light needs more evidence, so that less of the noise of one flat wall stays in the image.
#[test]
fn less_noise_of_indirect_light_counts_as_detail() {
    let [all, indirect] = [0.0, 1.0].map(|reports| {
        squared_error(&layered(Layers::Two, &lit_wall((11, 16), reports, |_, _| 0.0)).radiance, |_| 0.5)
    });
    assert!(indirect < 0.6 * all, "{indirect} as indirect light, {all} as all light");
}

#[test]
fn layers_follow_the_number_of_samples_and_black_indirect_light_has_the_bits_of_one() {
    let image = |film: &Film, layers| layered(layers, film).radiance;
    for (spp, wanted) in [(1, Layers::One), (2, Layers::Two)] {
        let film = shadowed(spp, 1.0);
        assert!(image(&film, Layers::Auto) == image(&film, wanted), "{spp} spp");
        assert_ne!(image(&film, Layers::One), image(&film, Layers::Two));
        let runs = with(ClusterRegressionOptions::default()).runs(&LAYERED, spp as f64);
        assert_eq!(runs, if wanted == Layers::One { 1 } else { 2 });
    }
    let black = shadowed(16, 0.0);
    assert_eq!(image(&black, Layers::Two), image(&black, Layers::One));
    assert_eq!(with(ClusterRegressionOptions::default().layers(Layers::Two)).runs(&Needs::none(), 64.0), 1);
}

#[test]
fn a_film_without_indirect_light_is_filtered_in_one_layer() {
    let with = shadowed(2, 1.0);
    let without = film(
        [SIDE; 2],
        HALVES,
        0,
        |_, _| 2,
        |[x, y], k, _| {
            let i = (y * SIDE + x) as usize;
            let seen = with.features(i).unwrap();
            let hit = FirstHit::new(seen.position, seen.normal, seen.depth).with_albedo(seen.albedo);
            Estimate::new(with.half(k, i).unwrap().mean.map(|value| value as f32)).with_first_hit(hit)
        },
    );
    assert_eq!(layered(Layers::Two, &without).radiance, layered(Layers::One, &with).radiance);
}

/// Running means of indirect light are rounded, so that a trace is left where all light is indirect. If it counted as direct light,
/// a bright sample of direct light would be out of the range of the planes, and stay in its pixel.
#[test]
fn a_bright_sample_of_direct_light_is_spread_where_all_other_light_is_indirect() {
    const BRIGHT: f32 = 400.0;
    let at = (SIDE * SIDE / 2 + SIDE / 2) as usize;
    let film = film(
        [SIDE; 2],
        LAYERED,
        5,
        |_, _| 16,
        |place, k, noise| {
            let indirect = noise.next();
            let direct = if place == [SIDE / 2; 2] && k == 0 { BRIGHT } else { 0.0 };
            grey(indirect + direct).with_indirect([indirect; 3]).with_first_hit(wall(place))
        },
    );
    let image = layered(Layers::Two, &film).radiance;
    let own = film.mean(at)[0] as f32;
    assert!(own > 0.9 * BRIGHT / 16.0 && image[at][0] < 0.1 * own, "{own} before, {} after", image[at][0]);
    let (got, wanted) = (mean(&image), mean(&film.image()));
    assert!((got / wanted - 1.0).abs() < 0.01, "{got} in the mean, not {wanted}");
}
