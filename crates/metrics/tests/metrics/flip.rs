//! FLIP against the published implementation.

use crate::support::{SIZE, pixels, test_image};
use dapple_metrics::{MetricsError, PIXELS_PER_DEGREE, flip};

type Row = (&'static str, &'static str, f64, f64, [f32; 5]);

/// Image, reference, pixels per degree; mean and five values of flip-evaluator 1.7, printed by `oracle.py` in the folder
/// above.
#[rustfmt::skip]
#[allow(clippy::excessive_precision)]
const PUBLISHED: [Row; 16] = [
    ("noisy", "smooth", 67.0206, 0.06677873, [0.1652512, 0.1429910, 0.0309008, 0.0687471, 0.0843567]),
    ("noisy", "smooth", 25.0, 0.16628423, [0.2530181, 0.2728507, 0.1348298, 0.2535499, 0.1410517]),
    ("noisy", "smooth", 110.0, 0.04705977, [0.1537714, 0.1088384, 0.0249494, 0.0285760, 0.0361631]),
    ("brighter", "smooth", 67.0206, 0.12104248, [0.3164316, 0.1310824, 0.1147224, 0.1103604, 0.1106023]),
    ("shifted", "smooth", 67.0206, 0.07295792, [0.1300325, 0.0446518, 0.0452967, 0.0444423, 0.0477019]),
    ("noise", "smooth", 67.0206, 0.65291345, [0.9711384, 0.9712797, 0.4692587, 0.3594996, 0.4609948]),
    ("inverse", "checker", 67.0206, 0.56610078, [0.9672401, 0.9672434, 0.2711022, 0.9080998, 0.9080949]),
    ("inverse", "checker", 25.0, 0.96068269, [0.9673889, 0.9673859, 0.9551461, 0.9673854, 0.9673854]),
    ("inverse", "checker", 110.0, 0.27060863, [0.9586835, 0.9586818, 0.1123869, 0.3884054, 0.3884428]),
    ("firefly", "dark", 67.0206, 0.00381434, [0.0000000, 0.0000000, 0.7587424, 0.2937838, 0.0000000]),
    ("firefly", "dark", 25.0, 0.00128032, [0.0000000, 0.0000000, 0.9845597, 0.0072258, 0.0000000]),
    ("firefly", "dark", 110.0, 0.00590480, [0.0000000, 0.0000000, 0.5169851, 0.3498962, 0.0000000]),
    ("blue", "green", 67.0206, 1.00000000, [1.0000000, 1.0000000, 1.0000000, 1.0000000, 1.0000000]),
    ("white", "black", 67.0206, 0.96736503, [0.9673855, 0.9673855, 0.9673855, 0.9673855, 0.9673855]),
    ("black", "smooth", 67.0206, 0.97375983, [0.8046757, 0.9783945, 0.9719529, 0.9719436, 0.9750399]),
    ("smooth", "smooth", 67.0206, 0.00000000, [0.0000000, 0.0000000, 0.0000000, 0.0000000, 0.0000000]),
];

const PLACES: [[usize; 2]; 5] = [[0, 0], [63, 47], [40, 7], [41, 9], [21, 30]];

fn of(image: &str, reference: &str, pixels_per_degree: f64) -> dapple_metrics::Flip {
    let [image, reference] = [image, reference].map(test_image);
    let [image, reference] = [&image, &reference].map(|p| pixels(SIZE, p));
    flip(image, reference, pixels_per_degree).unwrap()
}

/// The tolerance between two f32 implementations. For nearly equal features, the square root turns a rounding of 1e-7
/// into 3e-4. The largest difference found is 9.3e-5 in a map and 5.7e-5 in a mean.
const TOLERANCE: f64 = 1e-4;

#[test]
fn means_and_maps_match_the_published_implementation() {
    assert!((PIXELS_PER_DEGREE - 67.0206).abs() < 1e-4, "the default is the published one");
    for (image, reference, pixels_per_degree, mean, values) in PUBLISHED {
        let found = of(image, reference, pixels_per_degree);
        let pair = format!("{image} against {reference} at {pixels_per_degree}");
        assert!((found.mean - mean).abs() < TOLERANCE, "{pair}: {} instead of {mean}", found.mean);
        for ([x, y], value) in PLACES.into_iter().zip(values) {
            let found = found.map[y * SIZE[0] as usize + x];
            assert!(f64::from(found - value).abs() < TOLERANCE, "{pair} at {x}, {y}: {found} instead of {value}");
        }
    }
}

#[test]
fn other_displays_and_other_images_do_not_match() {
    for (image, reference, pixels_per_degree, mean, _) in PUBLISHED {
        // Images of one colour, or with no likeness, look the same at every distance.
        if ["noisy", "shifted", "firefly"].contains(&image) {
            let found = of(image, reference, 0.97 * pixels_per_degree).mean;
            assert!((found - mean).abs() > 0.001 * mean, "{image}: {found} is {mean}");
        }
        if image == "noisy" {
            assert!((of("brighter", reference, pixels_per_degree).mean - mean).abs() > TOLERANCE);
        }
    }
}

#[test]
fn flip_is_symmetric() {
    for (a, b) in [("noisy", "smooth"), ("firefly", "dark"), ("noise", "checker")] {
        let [ab, ba] = [of(a, b, PIXELS_PER_DEGREE), of(b, a, PIXELS_PER_DEGREE)];
        assert_eq!(ab, ba);
        assert!(ab.map.iter().all(|v| (0.0..=1.0).contains(v)));
    }
    let same = of("noise", "noise", PIXELS_PER_DEGREE);
    assert!(same.mean == 0.0 && same.map.iter().all(|&v| v == 0.0));
}

/// No other pair of corners of the cube of colours is as unlike as green and blue.
#[test]
fn the_largest_distance_lies_between_green_and_blue() {
    let corner = |i: u32| [[0, 1, 2].map(|c| (i >> c & 1) as f32)];
    for (i, j) in (0..64).map(|k| (k / 8, k % 8)) {
        let [a, b] = [corner(i), corner(j)];
        let found = flip(pixels([1, 1], &a), pixels([1, 1], &b), PIXELS_PER_DEGREE).unwrap().mean;
        let is_largest = i | j == 0b110 && i & j == 0 && i != 0 && j != 0;
        assert_eq!(found > 1.0 - 2e-5, is_largest, "{i:03b} and {j:03b}: {found}");
    }
}

#[test]
fn images_may_be_smaller_than_the_kernels() {
    for size in [[1, 1], [1, 9], [9, 1], [2, 3]] {
        let count = (size[0] * size[1]) as usize;
        let [black, white] = [vec![[0.0; 3]; count], vec![[1.0; 3]; count]];
        let [black, white] = [&black, &white].map(|p| pixels(size, p));
        for pixels_per_degree in [1.0, PIXELS_PER_DEGREE, 1000.0] {
            let found = flip(white, black, pixels_per_degree).unwrap();
            assert_eq!(found.map.len(), count);
            assert!(found.map.iter().all(|v| (v - 0.967_385).abs() < 1e-5), "{size:?} {found:?}");
            assert_eq!(flip(white, white, pixels_per_degree).unwrap().mean, 0.0);
        }
    }
}

#[test]
fn values_out_of_gamut_are_clamped_and_nan_is_black() {
    let pixels = |values: &'static [[f32; 3]; 4]| pixels([2, 2], values);
    let reference = pixels(&[[0.5; 3], [1.0, 0.0, 0.0], [0.0; 3], [1.0; 3]]);
    let image = flip(pixels(&[[f32::NAN; 3], [0.0; 3], [0.0; 3], [1.0; 3]]), reference, 67.0).unwrap();
    let clamped = pixels(&[[f32::INFINITY; 3], [-1e30, f32::NEG_INFINITY, -0.0], [0.0; 3], [f32::MAX; 3]]);
    assert_eq!(flip(clamped, reference, 67.0).unwrap(), image);
    assert!(image.mean > 0.1);
}

#[test]
fn sizes_references_and_displays_out_of_range_are_refused() {
    let values = vec![[0.0; 3]; 6];
    let [wide, high] = [[3, 2], [2, 3]].map(|size| pixels(size, &values));
    assert!(matches!(flip(wide, high, 67.0), Err(MetricsError::Sizes { .. })));
    let nan = vec![[f32::NAN; 3]; 6];
    let nan = pixels([3, 2], &nan);
    assert!(matches!(flip(wide, nan, 67.0), Err(MetricsError::NonFiniteReference { pixel: [0, 0], .. })));
    for value in [0.0, 0.99, -67.0, f64::NAN, f64::INFINITY, 1000.1] {
        let error = flip(wide, wide, value).unwrap_err();
        assert!(
            matches!(error, MetricsError::PixelsPerDegree { .. }) && error.to_string().contains("67 is usual"),
            "{error}"
        );
    }
}
