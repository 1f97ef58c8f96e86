//! Direct and indirect light, filtered one by one.

use crate::support::Noise;
use dapple_core::{Estimate, Film, Filter, Filtered, FirstHit, Frame, Needs};
use dapple_denoise::{ClusterRegression, ClusterRegressionOptions, Layers};

const SIDE: u32 = 48;
const PLAIN: Needs = Needs::none().with_halves().with_variance().with_features();
const NEEDS: Needs = PLAIN.with_indirect();

fn filter(layers: Layers) -> ClusterRegression {
    ClusterRegression::with_options(ClusterRegressionOptions::default().layers(layers)).unwrap()
}

/// Direct light: bright left of a shadow's edge, which no feature tells of.
fn direct(x: u32) -> f32 {
    if x < 23 { 0.6 } else { 0.2 }
}

/// A plain wall with a shadow of little noise, and indirect light of much noise and the mean 0.5. `reports` scales the
/// indirect light that samples report.
fn film(spp: usize, reports: f32) -> Film {
    let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), NEEDS);
    let mut noise = Noise::new(7);
    for i in 0..film.frame().pixels() {
        let [x, y] = [i as u32 % SIDE, i as u32 / SIDE];
        let hit = FirstHit::new([x as f32, y as f32, 0.0], [0.0, 0.0, 1.0], 100.0).with_albedo([0.5; 3]);
        for k in 0..spp {
            let indirect = if noise.next() < 0.25 { 2.0 } else { 0.0 };
            let radiance = direct(x) * (0.95 + 0.1 * noise.next()) + indirect;
            let estimate = Estimate::new([radiance; 3]).with_indirect([reports * indirect; 3]);
            film.push_estimate(i, k & 1, &estimate.with_first_hit(hit));
        }
    }
    film
}

fn squared_error(image: &[[f32; 3]]) -> f64 {
    let of = |(i, pixel): (usize, &[f32; 3])| f64::from(pixel[0] - direct(i as u32 % SIDE) - 0.5).powi(2);
    image.iter().enumerate().map(of).sum::<f64>() / image.len() as f64
}

#[test]
fn two_layers_keep_a_shadow_under_noisy_indirect_light() {
    let film = film(16, 1.0);
    let [one, two] = [Layers::One, Layers::Two].map(|layers| filter(layers).apply(&film).unwrap());
    let [one_error, two_error] = [&one, &two].map(|image| squared_error(&image.radiance));
    assert!(two_error < 0.5 * one_error, "{two_error} with two layers, {one_error} with one");
    let mean = |image: &[[f32; 3]]| image.iter().map(|p| f64::from(p[0])).sum::<f64>() / image.len() as f64;
    let (got, wanted) = (mean(&two.radiance), mean(&film.image()));
    assert!((got / wanted - 1.0).abs() < 0.01, "{got} in the mean, not {wanted}");
    let predicted = |image: Filtered| image.error.unwrap().iter().map(|e| f64::from(*e)).sum::<f64>();
    let [one, two] = [one, two].map(predicted);
    assert!((0.5..2.0).contains(&(two / one)), "{two} predicted with two layers, {one} with one");
}

/// Detail of indirect light needs more evidence, so that less of the noise of one flat wall stays in the image.
#[test]
fn less_noise_of_indirect_light_counts_as_detail() {
    let errors = [0.0, 1.0].map(|reports| {
        let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), NEEDS);
        let mut noise = Noise::new(11);
        for i in 0..film.frame().pixels() {
            let hit = FirstHit::new([(i as u32 % SIDE) as f32, (i as u32 / SIDE) as f32, 0.0], [0.0, 0.0, 1.0], 100.0);
            for k in 0..16 {
                let light = if noise.next() < 0.25 { [2.0; 3] } else { [0.0; 3] };
                let estimate = Estimate::new(light).with_indirect(light.map(|value| reports * value));
                film.push_estimate(i, k & 1, &estimate.with_first_hit(hit.with_albedo([0.5; 3])));
            }
        }
        let image = filter(Layers::Two).apply(&film).unwrap().radiance;
        image.iter().map(|p| f64::from(p[0] - 0.5).powi(2)).sum::<f64>() / image.len() as f64
    });
    let [all, indirect] = errors;
    assert!(indirect < 0.6 * all, "{indirect} as indirect light, {all} as all light");
}

#[test]
fn black_indirect_light_has_the_bits_of_one_layer() {
    let (film, reporting) = (film(16, 0.0), film(16, 1.0));
    let image = |film: &Film, layers| filter(layers).apply(film).unwrap().radiance;
    assert_eq!(image(&film, Layers::Two), image(&film, Layers::One));
    assert_ne!(image(&reporting, Layers::Two), image(&reporting, Layers::One));
}

#[test]
fn layers_follow_the_number_of_samples() {
    for (spp, wanted) in [(14, Layers::One), (16, Layers::Two)] {
        let film = film(spp, 1.0);
        let image = |layers| filter(layers).apply(&film).unwrap().radiance;
        assert!(image(Layers::Auto) == image(wanted), "{spp} spp");
        assert_eq!(filter(Layers::Auto).runs(&NEEDS, spp as f64), if wanted == Layers::One { 1 } else { 2 });
    }
    assert_eq!(filter(Layers::Two).runs(&Needs::none(), 64.0), 1);
}

#[test]
fn a_film_without_indirect_light_is_filtered_in_one_layer() {
    let (with, mut without) = (film(2, 1.0), Film::new(Frame::new(SIDE, SIDE).unwrap(), PLAIN));
    for i in 0..with.frame().pixels() {
        for half in 0..2 {
            let seen = with.features(i).unwrap();
            let hit = FirstHit::new(seen.position, seen.normal, seen.depth).with_albedo(seen.albedo);
            let radiance = with.half(half, i).unwrap().mean.map(|value| value as f32);
            without.push_estimate(i, half, &Estimate::new(radiance).with_first_hit(hit));
        }
    }
    let image = |film: &Film, layers| filter(layers).apply(film).unwrap().radiance;
    assert_eq!(image(&without, Layers::Two), image(&with, Layers::One));
}

/// Running means of indirect light are rounded, so that a trace is left where all light is indirect. If it counted as direct light,
/// a bright sample of direct light would be out of the range of the planes, and stay in its pixel.
#[test]
fn a_bright_sample_of_direct_light_is_spread_where_all_other_light_is_indirect() {
    const BRIGHT: f32 = 400.0;
    let at = (SIDE * SIDE / 2 + SIDE / 2) as usize;
    let mut film = Film::new(Frame::new(SIDE, SIDE).unwrap(), NEEDS);
    let mut noise = Noise::new(5);
    for i in 0..film.frame().pixels() {
        let hit = FirstHit::new([(i as u32 % SIDE) as f32, (i as u32 / SIDE) as f32, 0.0], [0.0, 0.0, 1.0], 100.0);
        for k in 0..16 {
            let indirect = noise.next();
            let direct = if i == at && k == 0 { BRIGHT } else { 0.0 };
            let estimate = Estimate::new([indirect + direct; 3]).with_indirect([indirect; 3]);
            film.push_estimate(i, k & 1, &estimate.with_first_hit(hit.with_albedo([0.5; 3])));
        }
    }
    let image = filter(Layers::Two).apply(&film).unwrap().radiance;
    let own = film.mean(at)[0] as f32;
    assert!(own > 0.9 * BRIGHT / 16.0 && image[at][0] < 0.1 * own, "{own} before, {} after", image[at][0]);
    let mean = |image: &[[f32; 3]]| image.iter().map(|p| f64::from(p[0])).sum::<f64>() / image.len() as f64;
    let (got, wanted) = (mean(&image), mean(&film.image()));
    assert!((got / wanted - 1.0).abs() < 0.01, "{got} in the mean, not {wanted}");
}
