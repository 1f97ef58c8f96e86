//! Direct and indirect lighting, filtered one by one.

use crate::support::{HALVES, Noise, film, grey, mean, squared_error, wall};
use dapple_core::{Estimate, Film, Filter, Filtered, FirstHit, Needs};
use dapple_denoise::{ClusterRegression, ClusterRegressionOptions, Layers};

fn with(options: ClusterRegressionOptions) -> ClusterRegression {
    ClusterRegression::with_options(options).unwrap()
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

/// A plain wall with direct light of little noise, and indirect lighting of much noise and the mean 0.5. `reports` scales the indirect
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

/// Running means of indirect lighting are rounded, so that a trace is left where all light is indirect. If it counted as direct light,
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
