//! Shrinkage towards a filtered image.

use crate::support::{Field, frame, image, noisy_film, random, squared_error as error};
use dapple_classics::{JamesStein, JamesSteinOptions, NoiseEstimate};
use dapple_conformance::toys;
use dapple_core::samplers::Uniform;
use dapple_core::{Error, Film, Filter as _, Filtered, Limits, Needs, Render};
use dapple_denoise::{Gaussian, NlMeans};

const NEEDS: Needs = Needs::none().with_half_variance();

/// The error of the noise is 1/2, that of both halves together. With a share `r` of a half's noise left, it is
/// `(1 - r)^2 b^2 + r^2 / 2` at a bias of `b`; and `r = b^2 / (b^2 + 1)` for many pixels.
#[test]
fn the_squared_error_is_below_that_of_the_noise_for_any_bias() {
    let film = noisy_film([64, 64], 32, NEEDS, 3, |_, _| 100.0, |_, _| 4.0);
    for (bias, expected) in [(0.0, 0.0), (0.5, 0.18), (1.0, 0.375), (3.0, 0.495), (30.0, 0.5)] {
        let image_of = move |film: &Film| Filtered::new(film.frame().size(), vec![[100.0 + bias; 3]; 64 * 64]);
        let biased = toys::ToyFilter { name: "biased", needs: Needs::none(), apply: image_of };
        let options = JamesSteinOptions::default().window(5).noise(NoiseEstimate::Samples);
        let found = error(&image(&JamesStein::with_options(biased, options).unwrap(), &film), |_| 100.0);
        assert!((found - expected).abs() < 0.03, "{bias}: {found}, not {expected}");
    }
}

fn render(spp: f64, seed: u64) -> Film {
    // A texture finer than the filter's kernel, under noise that is the same everywhere.
    let mut field = Field(|[x, y]: [u32; 2], u: [f32; 4]| {
        [if (x / 2 + y / 2).is_multiple_of(2) { 0.2 } else { 0.8 } + 0.4 * (u[0] - 0.5); 3]
    });
    let limits = Limits::spp(spp);
    Render::new(frame([48, 48]), &limits).needs(NEEDS).run(&mut field, &mut Uniform::new(random(seed))).unwrap()
}

fn squared_error(image: &[[f32; 3]]) -> f64 {
    error(image, |i| if (i % 48 / 2 + i / 48 / 2).is_multiple_of(2) { 0.2 } else { 0.8 })
}

#[test]
fn biased_filters_no_longer_flatten_images_of_many_samples() {
    let blur = Gaussian::default();
    for noise in [NoiseEstimate::Halves, NoiseEstimate::Samples] {
        let filter = JamesStein::with_options(blur.clone(), JamesSteinOptions::default().noise(noise)).unwrap();
        for (spp, limit) in [(4.0, 1.04), (16.0, 1.02), (64.0, 1.01), (512.0, 1.01)] {
            let film = render(spp, 99);
            let images = [image(&filter, &film), film.image(), image(&blur, &film)];
            let [shrunk, plain, blurred] = images.map(|image| squared_error(&image));
            // The control: the blur does not improve with more samples.
            assert!(shrunk < limit * plain && blurred > 0.04, "{shrunk} {plain} {blurred}");
        }
    }
}

#[test]
fn filters_that_need_halves_and_small_windows_are_refused() {
    assert!(matches!(JamesStein::new(NlMeans::default()), Err(Error::OutOfRange { name: "of", .. })));
    for window in [1, 2, 14, 65] {
        let options = JamesSteinOptions::default().window(window);
        assert!(JamesStein::with_options(Gaussian::default(), options).is_err(), "{window}");
    }
    let described = JamesStein::new(Gaussian::default()).unwrap().describe();
    assert_eq!(described, "james-stein:of=gaussian/alpha=0.5/radius=4,window=15,noise=halves");
}
