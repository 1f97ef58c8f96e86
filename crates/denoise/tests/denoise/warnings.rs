//! Buffers that hosts exchange, and images without a fault.

use crate::support::{HALVES, Noise, film, rendered, wall};
use dapple_core::point_set::mix;
use dapple_core::{Estimate, Film, FirstHit, Frame};
use dapple_denoise::{Denoise, SampleBuffers, Variance, Warning, denoise, denoise_whole, warnings_of};

const SIZE: [u32; 2] = [96, 64];
const PIXELS: usize = 96 * 64;
const SAMPLES: u32 = 16;

/// The buffers of a floor of tiles under a lamp, with shadows, and of noise that grows with the light.
struct Buffers {
    means: [Vec<[f32; 3]>; 2],
    /// The variance of a sample.
    variance: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
    albedo: Vec<[f32; 3]>,
}

/// About a normal number with variance 1: the sum of twelve even ones.
fn noise(i: usize, k: u64) -> f32 {
    (0..12).map(|j| (mix(mix(i as u64) ^ (16 * k + j)) >> 40) as f32 / (1u64 << 24) as f32).sum::<f32>() - 6.0
}

fn buffers(seed: u64) -> Buffers {
    let tile = |x: usize, y: usize| if (x / 8 + y / 8).is_multiple_of(2) { 0.25 } else { 0.75 };
    let mut made = Buffers { means: [vec![], vec![]], variance: vec![], normal: vec![], albedo: vec![] };
    for i in 0..PIXELS {
        let (x, y) = (i % 96, i / 96);
        let (albedo, shadow) = (tile(x, y), if x > 3 * y / 2 { 1.0 } else { 0.3 });
        let light = albedo * shadow * (0.5 + y as f32 / 64.0);
        let deviation = 0.4 * light;
        let mean = |half: u64| light + deviation * noise(i, seed + half) / (SAMPLES as f32 / 2.0).sqrt();
        made.means[0].push([mean(0); 3]);
        made.means[1].push([mean(1); 3]);
        made.variance.push([deviation * deviation; 3]);
        made.albedo.push([albedo, 0.8 * albedo, 0.5 * albedo]);
        let tilt = (x as f32 * 0.13).sin();
        made.normal.push([tilt, (1.0 - tilt * tilt).max(0.0).sqrt(), 0.0]);
    }
    made
}

impl Buffers {
    fn whole(&self) -> Vec<[f32; 3]> {
        self.means[0].iter().zip(&self.means[1]).map(|(a, b)| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]))).collect()
    }
}

fn found(image: Denoise<'_>) -> Vec<Warning> {
    let found = image.warnings().unwrap();
    // A strict image is refused for the first of them, and only then.
    let refused = image.strict().run().err().map(|error| error.to_string());
    assert_eq!(refused, found.first().map(|warning| format!("the buffers: {warning}")));
    found
}

fn scaled(values: &[[f32; 3]], by: f32) -> Vec<[f32; 3]> {
    values.iter().map(|v| v.map(|x| x * by)).collect()
}

/// Of images without a fault: 40 images, of which none is warned of.
#[test]
fn right_buffers_have_no_warnings() {
    for seed in 0..20 {
        let made = buffers(100 * seed);
        let [a, b] = made.means.each_ref().map(|mean| SampleBuffers::new(mean, SAMPLES / 2));
        assert_eq!(found(denoise(SIZE, &a, &b).normal(&made.normal).albedo(&made.albedo)), []);
        let (mean, of_mean) = (made.whole(), scaled(&made.variance, 1.0 / SAMPLES as f32));
        let all = SampleBuffers::new(&mean, SAMPLES).variance(Variance::OfMean(&of_mean));
        assert_eq!(found(denoise_whole(SIZE, &all)), []);
    }
}

#[test]
fn noise_that_is_not_the_variance_is_told() {
    let (made, n) = (buffers(1), SAMPLES as f32);
    let (mean, sums) = (made.whole(), scaled(&made.whole(), n));
    let of_mean = scaled(&made.variance, 1.0 / n);
    let told = |mean: &[[f32; 3]], variance: Variance<'_>| {
        let all = SampleBuffers::new(mean, SAMPLES).variance(variance);
        let [warning] = found(denoise_whole(SIZE, &all)).try_into().unwrap();
        warning.to_string()
    };
    assert!(told(&mean, Variance::OfSamples(&of_mean)).contains("use Variance::OfMean"));
    assert!(told(&mean, Variance::OfMean(&made.variance)).contains("use Variance::OfSamples"));
    assert!(told(&sums, Variance::OfSamples(&made.variance)).contains("divide the means by the sample counts"));
    assert!(told(&mean, Variance::OfSamples(&[[0.0; 3]; PIXELS])).contains("all variances are 0"));
    // A wide pixel filter: the mean of 3x3 pixels.
    let near = |i: usize| {
        [0, 1, 2].map(|c| [97, 96, 95, 1].iter().fold(mean[i][c], |sum, k| sum + mean[i - k][c] + mean[i + k][c]) / 9.0)
    };
    let wide: Vec<_> = (0..PIXELS).map(|i| if (97..PIXELS - 97).contains(&i) { near(i) } else { mean[i] }).collect();
    assert!(told(&wide, Variance::OfSamples(&made.variance)).contains("wide pixel filter"));
}

#[test]
fn halves_that_share_samples_are_told() {
    let made = buffers(2);
    // The second half is nineteen parts of the first and one part of its own.
    let mixed: Vec<_> =
        made.means[0].iter().zip(&made.means[1]).map(|(a, b)| [0, 1, 2].map(|c| 0.95 * a[c] + 0.05 * b[c])).collect();
    let [a, b] = [&made.means[0], &mixed]
        .map(|m| SampleBuffers::new(m, SAMPLES / 2).variance(Variance::OfSamples(&made.variance)));
    assert!(matches!(found(denoise(SIZE, &a, &b))[..], [Warning::AlikeHalves { factor }] if factor < 0.01));
}

#[test]
fn exchanged_buffers_and_sizes_are_told() {
    let made = buffers(3);
    let [a, b] = made.means.each_ref().map(|mean| SampleBuffers::new(mean, SAMPLES / 2));
    assert_eq!(found(denoise(SIZE, &a, &b).normal(&made.albedo).albedo(&made.normal)), [Warning::ExchangedFeatures]);
    assert_eq!(found(denoise([64, 96], &a, &b).normal(&made.normal).albedo(&made.albedo)), [Warning::ExchangedSize]);
    assert_eq!(found(denoise([64, 96], &a, &b)), [Warning::ExchangedSize]);
    let bytes = scaled(&made.albedo, 255.0);
    assert!(matches!(found(denoise(SIZE, &a, &b).albedo(&bytes))[..], [Warning::Albedo { share: 1.0 }]));
    let long = scaled(&made.normal, 2.0);
    assert_eq!(found(denoise(SIZE, &a, &b).normal(&long)), [Warning::Normals]);
}

#[test]
fn pixels_that_are_nan_are_filled_and_huge_ones_reported() {
    let mut made = buffers(4);
    made.means[0][500] = [f32::NAN; 3];
    made.means[1][501] = [f32::INFINITY; 3];
    made.means[1][960] = [1e30; 3];
    let [a, b] = made.means.each_ref().map(|mean| SampleBuffers::new(mean, SAMPLES / 2));
    let image = denoise(SIZE, &a, &b);
    assert_eq!(image.warnings().unwrap(), [Warning::Filled { pixels: 2 }, Warning::Huge { pixel: [0, 10] }]);
    let radiance = image.run().unwrap().radiance;
    assert!(radiance.as_flattened().iter().all(|x| x.is_finite()));
    assert!(radiance[500..502].as_flattened().iter().all(|x| (0.02..2.0).contains(x)), "{:?}", &radiance[500..502]);
}

/// The warnings about a film of 8 samples per pixel, whose samples `change` alters.
fn of_film(change: impl Fn([u32; 2], usize, Estimate) -> Estimate) -> Vec<Warning> {
    let sample = |[x, y]: [u32; 2], k: usize, noise: &mut Noise| {
        // Normals that vary, such as those of grass.
        let (sine, cosine) = (6.0 * noise.next()).sin_cos();
        let hit = wall([x, y]).with_shading_normal([sine, 0.0, cosine]);
        change([x, y], k, Estimate::new([noise.next(); 3]).with_first_hit(hit))
    };
    warnings_of(&film([40, 30], HALVES.with_emission(), 3, |_, _| 8, sample))
}

#[test]
fn samples_that_look_wrong_are_told() {
    let with = |change: fn(FirstHit) -> FirstHit| of_film(|_, _, e| e.with_first_hit(e.first_hit.map(change)));
    assert_eq!(with(|hit| hit), []);
    assert_eq!(with(|hit| FirstHit::new(hit.position, hit.shading_normal, 0.0)), [Warning::Depth { share: 1.0 }]);
    assert_eq!(
        with(|hit| FirstHit::new(hit.position, hit.shading_normal, -hit.depth)),
        [Warning::Depth { share: 1.0 }]
    );
    assert_eq!(with(|hit| hit.with_albedo([0.5, 1.5, 0.5])), [Warning::Albedo { share: 1.0 }]);
    for length in [0.9, 1.1] {
        let scaled = |hit: FirstHit| hit.with_shading_normal(hit.shading_normal.map(|x| x * length));
        assert_eq!(of_film(|_, _, e| e.with_first_hit(e.first_hit.map(scaled))), [Warning::Normals]);
    }
    let at = |pixel: [u32; 2], value: f32, e: Estimate| match pixel {
        [7, 9] => Estimate::new([value; 3]).with_first_hit(e.first_hit),
        _ => e,
    };
    assert_eq!(of_film(|pixel, _, e| at(pixel, f32::NAN, e)), [Warning::Filled { pixels: 1 }]);
    assert_eq!(of_film(|pixel, k, e| if k == 5 { at(pixel, 1e30, e) } else { e }), [Warning::Huge { pixel: [7, 9] }]);
    // A lamp is no fault.
    assert_eq!(
        of_film(|pixel, _, e| at(pixel, 1e5, e).with_emission([if pixel == [7, 9] { 1e5 } else { 0.0 }; 3])),
        []
    );
}

/// A generator seeded by pixel and by the sample's number in its half. Samples of two values are the hardest: halves are often equal by
/// chance.
#[test]
fn halves_of_the_same_samples_are_told() {
    let frame = Frame::new(40, 30).unwrap();
    let warned = |spp, seed, sees_half: bool, values: u64| {
        let film = rendered(frame, HALVES, (seed, spp), |draws| {
            let id = draws.id();
            let place = u64::from(id.pixel[0] + 40 * id.pixel[1]) << 20 | id.index << 4;
            let random = mix(mix(seed) ^ place ^ if sees_half { u64::from(id.stream) } else { 0 });
            let value = (random % values) as f32 / values as f32;
            Estimate::new([value * (1.0 + id.pixel[0] as f32); 3]).with_first_hit(wall(id.pixel))
        });
        warnings_of(&film)
    };
    for seed in 0..20 {
        for spp in [4, 8, 32, 64] {
            assert_eq!(warned(spp, seed, false, 1 << 20), [Warning::AlikeHalves { factor: 0.0 }], "{spp} spp");
            assert_eq!(warned(spp, seed, true, 1 << 20), []);
            assert_eq!(warned(spp, seed, true, 2), []);
        }
    }
}

#[test]
fn a_huge_pixel_of_a_crop_has_its_place_in_the_full_image() {
    let mut film = Film::new(Frame::new(64, 64).unwrap().crop(10, 20, 30, 40).unwrap(), dapple_core::Needs::none());
    (0..400).for_each(|i| film.push(i, 0, [if i == 62 { 1e9 } else { 0.1 }; 3]));
    assert_eq!(warnings_of(&film), [Warning::Huge { pixel: [12, 23] }]);
}
