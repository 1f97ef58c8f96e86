//! Bands of rows, filtered by processes that exchange messages, against the image of one process.

use crate::among::Among;
use crate::cluster_regression::{ClusterRegression, ClusterRegressionOptions, Passes, reach};
use crate::scales::Scales;
use crate::{Bilateral, Gaussian, Layers, NlMeans, NlMeansOptions};
use dapple_core::{
    Band, Estimate, Exchange, Film, Filter, Filtered, FirstHit, Frame, Needs, SurfaceFeatures, exchange,
};
use std::sync::Arc;

/// Runs `task` on a thread per band.
fn together<T: Send>(bands: &[Band], task: impl Fn(&Band, &mut dyn Exchange) -> T + Sync) -> Vec<T> {
    std::thread::scope(|scope| {
        let start = |(band, mut exchange)| {
            let task = &task;
            scope.spawn(move || task(band, &mut exchange))
        };
        let threads: Vec<_> = bands.iter().zip(exchange::in_memory(bands.len() as u32)).map(start).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

const NEEDS: Needs = crate::parameters::RECORDED.with_indirect().with_first_hits(1);

/// A noisy film with edges, outliers, a lamp, unequal counts and pixels without samples.
fn film([width, height]: [u32; 2], seed: u64) -> Film {
    let mut film = Film::new(Frame::new(width, height).unwrap(), NEEDS);
    let mut state = seed.wrapping_mul(0xd134_2543_de82_ef95);
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
    };
    for pixel in 0..(width * height) as usize {
        let (x, y) = ((pixel as u32 % width) as f32, (pixel as u32 / width) as f32);
        // Of some rows, one half has no samples.
        let most = if (y / 50.0).fract() < 0.2 { 0.0 } else { 6.0 };
        let count = if next() < 0.01 { 0 } else { 1 + usize::from(most > 0.0) + (most * next() * next()) as usize };
        for sample in 0..count {
            let far = (0.02 * y).sin() + 0.1 * x;
            let tilt = if (y / 90.0).fract() < 0.5 { 0.6 } else { 0.8 };
            let albedo = [0.3 + 0.2 * (0.1 * x).sin(), 0.5, 0.6 + 0.05 * next()];
            let lamp = if x > 20.0 && (300.0..306.0).contains(&y) && next() < 0.7 { 2000.0 } else { 0.0 };
            let bright = if next() < 0.002 { 60.0 } else { 0.4 + next() };
            let place = [0.1 * x, 0.1 * y, far + 0.01 * next()];
            let (normal, depth) = ([0.0, tilt, (1.0f32 - tilt * tilt).sqrt()], 10.0 + far + 0.1 * next());
            let features = SurfaceFeatures::new(place, normal, depth).with_albedo(albedo);
            let hit = FirstHit::new(place, normal, depth).with_material((y / 60.0) as u32);
            let radiance = albedo.map(|a| a * bright + lamp);
            let estimate = Estimate::new(radiance).with_first_hit(Some(hit)).with_features(features);
            let indirect = albedo.map(|a| 0.3 * a * next());
            film.push_estimate(pixel, sample % 2, &estimate.with_emission([lamp; 3]).with_indirect(indirect));
        }
    }
    film
}

/// The bands between some rows.
fn bands(frame: &Frame, cuts: &[u32]) -> Vec<Band> {
    let ends = cuts.iter().copied().chain([frame.size()[1]]);
    [0].iter().chain(cuts).zip(ends).map(|(first, end)| Band::new(*frame, *first..end).unwrap()).collect()
}

fn bits(image: &Filtered) -> Vec<u32> {
    image.radiance.iter().flatten().chain(image.error.iter().flatten()).map(|value| value.to_bits()).collect()
}

/// The bits of the image whose bands these are, in the order of [`bits`].
fn bits_of_bands(images: &[Filtered]) -> Vec<u32> {
    let radiance = images.iter().flat_map(|image| &image.radiance).flatten();
    radiance.chain(images.iter().flat_map(|image| image.error.iter().flatten())).map(|v| v.to_bits()).collect()
}

/// The number of values in which the bands differ from the whole image, and the largest share of the film that one read.
fn differences(filter: &dyn Filter, film: &Film, cuts: &[u32]) -> (usize, f64) {
    let whole = bits(&filter.apply(film).unwrap());
    let frame = *film.frame();
    let read = |band: &Band| filter.rows_read(&frame, band.rows()).unwrap();
    let images = together(&bands(&frame, cuts), |band, exchange| {
        filter.apply_to_rows(&film.of_rows(read(band)).unwrap(), band, exchange).unwrap()
    });
    let share = bands(&frame, cuts).iter().map(|band| read(band).len()).max().unwrap() as f64;
    let parts = bits_of_bands(&images);
    assert_eq!(parts.len(), whole.len());
    (parts.iter().zip(&whole).filter(|(a, b)| a != b).count(), share / f64::from(frame.size()[1]))
}

fn regression(passes: Passes, scales: Scales) -> ClusterRegression {
    let options = ClusterRegressionOptions::default().passes(passes).scales(scales);
    let filter = ClusterRegression::with_options(options).unwrap();
    filter.with_clusters(Arc::new(|hit| Some(hit.material)), "")
}

/// Asserts that bands have the bits of the whole image. Returns the largest share of the film that a band read.
fn assert_same_bits(filter: &dyn Filter, size: [u32; 2], cuts: &[u32]) -> f64 {
    let (differ, share) = differences(filter, &film(size, 7), cuts);
    assert_eq!(differ, 0, "{} at {size:?} cut at {cuts:?}", filter.describe());
    share
}

#[test]
fn bands_of_three_passes_have_the_bits_of_the_whole_image() {
    // The middle bands read neither the top nor the bottom of the image.
    for (scales, cuts) in [(Scales::Fixed(0), &[300, 333, 560][..]), (Scales::Fixed(3), &[250, 400, 401])] {
        let share = assert_same_bits(&regression(Passes::Three, scales), [22, 800], cuts);
        assert!(share < 0.85, "{share}");
    }
    assert_same_bits(&regression(Passes::Three, Scales::Auto), [50, 97], &[16, 32, 48, 64, 80]);
    assert_same_bits(&regression(Passes::Three, Scales::Fixed(8)), [21, 130], &[1, 100]);
}

#[test]
fn bands_of_two_layers_have_the_bits_of_the_whole_image() {
    let options = ClusterRegressionOptions::default().layers(Layers::Two);
    for (passes, scales) in [(Passes::One, 0), (Passes::Three, 0), (Passes::Three, 2)] {
        let options = options.passes(passes).scales(Scales::Fixed(scales));
        let filter = ClusterRegression::with_options(options).unwrap();
        assert_same_bits(&filter, [22, 400], &[120, 250]);
    }
}

#[test]
fn bands_of_other_filters_have_the_bits_of_the_whole_image() {
    let filters: [Box<dyn Filter>; 6] = [
        Box::new(regression(Passes::Two, Scales::Auto)),
        Box::new(regression(Passes::One, Scales::Auto)),
        Box::new(Bilateral::default()),
        Box::new(NlMeans::default()),
        Box::new(NlMeans::with_options(NlMeansOptions::default().features(Some(1.0))).unwrap()),
        Box::new(Gaussian::default()),
    ];
    for filter in &filters {
        let share = assert_same_bits(filter, [34, 420], &[150, 187, 260]);
        assert!(share < 0.7, "{share} by {}", filter.describe());
        assert_same_bits(filter, [40, 50], &[16, 17, 49]);
    }
}

#[test]
fn all_processes_fail_if_one_has_another_film_or_the_bands_leave_rows_out() {
    let (filter, film) = (Bilateral::default(), film([8, 64], 1));
    let frame = *film.frame();
    let errors = |cuts: &[u32], wrong: Option<u32>| -> Vec<String> {
        let mut bands = bands(&frame, cuts);
        if wrong.is_none() {
            bands[1] = Band::new(frame, cuts[0] + 1..64).unwrap();
        }
        let apply = |band: &Band, exchange: &mut dyn Exchange| {
            let rows = filter.rows_read(&frame, band.rows()).unwrap();
            let rows = if wrong == Some(exchange.share().index()) { 0..8 } else { rows };
            filter.apply_to_rows(&film.of_rows(rows).unwrap(), band, exchange).unwrap_err().to_string()
        };
        together(&bands, apply)
    };
    let messages = errors(&[32], Some(1));
    assert!(messages[0].contains("process 1 failed") && messages[1].contains("rows_read"), "{messages:?}");
    assert!(errors(&[32], None).iter().all(|message| message.contains("leave out rows")));
}

/// The number of values in which two bands, cut at row `cut`, differ from the whole image if each reads `short` rows less
/// below than the filter's reach.
fn differences_of_short(filter: &ClusterRegression, film: &Film, cut: u32, short: usize) -> usize {
    let whole = bits(&filter.apply(film).unwrap());
    let frame = *film.frame();
    let reach = reach(&filter.options(), frame.size().map(|n| n as usize));
    let images = together(&bands(&frame, &[cut]), |band, exchange| {
        let rows = band.rows();
        let read = filter.rows_read(&frame, rows.clone()).unwrap().start..(rows.end + (reach - short) as u32);
        let film = film.of_rows(read.start..read.end.min(frame.size()[1])).unwrap();
        let mut among = Among::joined("control", band, exchange, Ok(())).unwrap();
        filter.run(&film, read.start as usize, &mut among).unwrap()
    });
    bits_of_bands(&images).iter().zip(&whole).filter(|(a, b)| a != b).count()
}

/// The reach is the sum of all radii. Much of it carries little weight, so that fewer rows happen to give the same bits: the
/// control reads as many less as were found to be missed.
#[test]
fn bands_differ_if_they_read_too_few_rows() {
    for (passes, scales, size, short) in [
        (Passes::One, 0, [24, 200], 13),
        (Passes::Two, 0, [24, 260], 17),
        (Passes::Three, 0, [24, 480], 40),
        (Passes::Three, 2, [24, 480], 40),
    ] {
        let (filter, film) = (regression(passes, Scales::Fixed(scales)), film(size, 3));
        assert_eq!(differences_of_short(&filter, &film, 90, 0), 0, "{passes:?} {scales}");
        let missed = differences_of_short(&filter, &film, 90, short);
        assert!(missed > 0, "{passes:?} {scales}: no value differs if {short} rows are not read");
    }
}
