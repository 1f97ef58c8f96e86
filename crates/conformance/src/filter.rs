//! Conformance tests of filters.

use crate::sampler::{Scene, frame, on_threads};
use crate::toys::{Independent, one_round};
use dapple_core::point_set::mix;
use dapple_core::{Error, Film, Filter, Filtered, Frame, Limits, Needs, Render, Sampler, plan::Retention};

/// Checks a filter that works on frames of any size, created by `make`.
///
/// Applies the filter to films of synthetic scenes on frames from 1x1 up. The films have uneven counts, pixels without
/// samples, and fireflies of 10^30 (whose square exceeds `f32`). The checks are:
///
/// * a constant image stays constant;
/// * radiance is finite; error estimates are not negative, and are finite if all pixels have samples;
/// * the image and the error map have the size of the frame;
/// * results are bit-identical for any number of threads;
/// * a film without the statistics that the filter needs is refused with
///   [`Error::NotRecorded`](dapple_core::Error::NotRecorded).
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn filter(make: impl Fn() -> Box<dyn Filter>) {
    filter_on_frames(|_| make());
}

/// Checks a learned filter as [`filter`] does, except that constant images may change by the relative `tolerance`.
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn filter_within(tolerance: f32, make: impl Fn() -> Box<dyn Filter>) {
    check(tolerance, &|_| make());
}

/// Checks filters as [`filter`] does, but `make` creates each filter for one frame. Use it for filters made for one frame,
/// for example from the cluster that each pixel sees.
///
/// # Panics
///
/// If a check fails; the message names the check.
pub fn filter_on_frames(make: impl Fn(&Frame) -> Box<dyn Filter>) {
    check(ROUNDING, &make);
}

/// The tolerated relative change of constant images, due to rounding of normalised `f32` weights.
const ROUNDING: f32 = 1e-5;

fn check(tolerance: f32, make: &dyn Fn(&Frame) -> Box<dyn Filter>) {
    let first = make(&frame([19, 18]));
    let (name, description) = (first.name(), first.describe());
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    assert!(!name.is_empty() && name.chars().all(plain), "the name {name:?} is not lower case with hyphens");
    assert!(description.starts_with(name), "the description {description:?} does not begin with the name {name:?}");
    let window = frame([40, 30]).crop(7, 3, 20, 8).expect("a window of the checks");
    for frame in [frame([1, 1]), frame([1, 7]), frame([7, 1]), frame([13, 35]), window] {
        let filter = make(&frame);
        for scene in Scene::ALL {
            for counts in [Counts::Sparse, Counts::Uneven] {
                finite_and_repeatable(&*filter, scene, counts, frame);
            }
        }
        keeps_constant(&*filter, frame, tolerance);
        refuses(&*filter, frame);
    }
}

/// The range of sample counts in a film. A hash of the pixel's index selects the count.
#[derive(Clone, Copy, Debug)]
enum Counts {
    /// 0 to 3 samples per pixel.
    Sparse,
    /// 2 to 40 samples per pixel.
    Uneven,
}

/// A sampler of one round whose counts are hashes of the pixels.
fn hashed(counts: Counts, pixels: usize) -> impl Sampler {
    let count = |hash: u64| match counts {
        Counts::Sparse => (hash % 4) as u32,
        Counts::Uneven => 2 + (hash % 39) as u32,
    };
    let mut counts: Vec<u32> = (1..=pixels as u64).map(|i| count(mix(i))).collect();
    // All counts may be 0 on a small frame.
    counts[0] = counts[0].max(u32::from(counts.iter().all(|n| *n == 0)));
    one_round(Independent::new(0), Retention::Keep, counts)
}

fn film(mut scene: Scene, counts: Counts, filter: Option<&dyn Filter>, frame: Frame) -> Film {
    let mut limits = Limits::samples(64 * frame.pixels() as u64);
    limits.min_spp = 0;
    let (needs, recorders) = filter.map_or((Needs::none(), Vec::new()), |filter| (filter.needs(), filter.recorders()));
    let render = Render::new(frame, &limits).needs(needs).recorders(recorders);
    render.run(&mut scene, &mut hashed(counts, frame.pixels())).expect("a film of the checks")
}

fn finite_and_repeatable(filter: &dyn Filter, scene: Scene, counts: Counts, frame: Frame) {
    let case = format!("{}, {scene:?}, {counts:?}, {:?}", filter.describe(), frame.size());
    let film = film(scene, counts, Some(filter), frame);
    let apply = |threads| on_threads(threads, || filter.apply(&film)).unwrap_or_else(|e| panic!("{case}: {e}"));
    let image = apply(1);
    assert_eq!(image.size, frame.size(), "{case}: wrong size");
    assert_eq!(image.radiance.len(), frame.pixels(), "{case}: wrong number of pixels");
    for (i, x) in image.radiance.iter().enumerate() {
        assert!(x.iter().all(|v| v.is_finite()), "{case}: pixel {i} is {x:?}");
    }
    if let Some(error) = &image.error {
        assert_eq!(error.len(), frame.pixels(), "{case}: wrong number of errors");
        assert!(error.iter().all(|e| *e >= 0.0), "{case}: an error is negative or NaN");
        // The error of a pixel without samples may be infinite, which means unknown.
        let is_known = |e: &f32| e.is_finite() || matches!(counts, Counts::Sparse);
        assert!(error.iter().all(is_known), "{case}: the error of a pixel with samples is infinite");
    }
    // The division of work among threads depends only on size and outliers; a single pixel is not divided.
    let threads: &[usize] = match scene {
        Scene::Noise if frame.pixels() > 1 => &[1, 2, 7],
        Scene::Firefly if frame.pixels() > 7 => &[3],
        _ => &[],
    };
    for &threads in threads {
        assert!(bits(&apply(threads)) == bits(&image), "{case}: {threads} threads give a different result");
    }
}

fn bits(image: &Filtered) -> Vec<u32> {
    let errors = image.error.iter().flatten();
    image.radiance.iter().flatten().chain(errors).map(|v| v.to_bits()).collect()
}

/// Checks that constant images stay constant to a relative `tolerance`.
fn keeps_constant(filter: &dyn Filter, frame: Frame, tolerance: f32) {
    for (scene, value) in [(Scene::Constant, 0.7f32), (Scene::Black, 0.0)] {
        let film = film(scene, Counts::Uneven, Some(filter), frame);
        let image = filter.apply(&film).unwrap_or_else(|e| panic!("{}: {e}", filter.describe()));
        for (i, x) in image.radiance.iter().enumerate() {
            for (x, share) in x.iter().zip([1.0, 0.5, 0.25]) {
                let wanted = value * share;
                let near = (x - wanted).abs() <= tolerance * wanted;
                assert!(near, "{}: pixel {i} of a constant {wanted} is {x}", filter.describe());
            }
        }
    }
}

fn refuses(filter: &dyn Filter, frame: Frame) {
    // Filters work without emission.
    let needs_nothing = filter.needs().and(Needs::none().with_emission()) == Needs::none().with_emission();
    if needs_nothing && filter.recorders().is_empty() {
        return;
    }
    let bare = film(Scene::Noise, Counts::Uneven, None, frame);
    let answer = filter.apply(&bare);
    let refused = matches!(answer, Err(Error::NotRecorded { .. }));
    assert!(refused, "{}: a film without the statistics in needs() is not refused", filter.describe());
}
