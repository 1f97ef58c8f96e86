//! Plots of point sets: points, spectra and discrepancies.

mod figure;

use crate::file_names::safe_file_name;
use dapple_core::{PointSet, SampleId};
use dapple_metrics::{
    MetricsError, SpectrumRing, image_spectrum, l2_star_discrepancy, point_spectrum, star_discrepancy,
};
use figure::{Curve, Figure, Scale};
use std::fmt::Write;

/// The numbers of points that are drawn.
pub const PLOTTED_COUNTS: [u64; 3] = [64, 256, 1024];

/// Side in pixels of the images whose spectra are plotted.
const IMAGE_SIDE: u32 = 128;
/// Streams over which the spectra of images are averaged.
const IMAGES: u32 = 4;
/// Points in a pixel for the spectrum of points, and its largest frequency in cycles per pixel's side.
const SPECTRUM_POINTS: u64 = 256;
const SPECTRUM_END: u32 = 32;
/// Pixels over which spectra and discrepancies of points are averaged, this far apart. Sets that couple pixels share less
/// at this distance.
const PIXELS: u32 = 16;
const SPACING: u32 = 1009;
/// The largest count of the discrepancies.
const LARGEST_COUNT: u64 = 1024;
/// The frequency in cycles per pixel below which [`PointPlots::low_frequency_power`] is averaged.
const LOW_FREQUENCY: f64 = 0.125;

/// The plots of a point set, as files and as two numbers.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PointPlots {
    /// Names and texts of the files: for each plot an SVG, and a CSV of the same name.
    pub files: Vec<(String, String)>,
    /// The mean power of dimension 2, below 1/8 cycle per pixel, in images of one sample per pixel. White noise has 1, blue
    /// noise less.
    pub low_frequency_power: f64,
    /// The root mean square L2 star discrepancy of 256 points of a pixel. Independent points have 0.0233.
    pub l2_star_discrepancy: f64,
}

/// Plots a point set: the first two dimensions of a pixel's points, radial power spectra, and discrepancies.
///
/// * `points-N`: the first 64, 256 and 1024 points of one pixel.
/// * `image-spectrum`: the spectrum over images of one sample per pixel, of dimensions 0, 2 and 4. Dapple's integrators use
///   dimension 0 for the place in the pixel, 2 for the lens, and 4 for light.
/// * `point-spectrum`: the spectrum over 256 points of one pixel, the mean of 16 pixels.
/// * `discrepancy`: the star discrepancy and the L2 star discrepancy against the number of points, over 16 pixels.
///
/// `make` makes the set for a number of samples per pixel. `name` is the head of the files' names; characters that do not
/// belong in file names become `-`.
///
/// # Errors
/// Those of `make`.
pub fn point_plots<P: PointSet, E>(name: &str, make: &dyn Fn(u64) -> Result<P, E>) -> Result<PointPlots, E> {
    let mut files = Vec::new();
    let head = safe_file_name(name);
    let mut add = |what: &str, figure: &Figure, table: String| {
        files.push((format!("{head}-{what}.svg"), figure.svg()));
        files.push((format!("{head}-{what}.csv"), table));
    };
    for count in PLOTTED_COUNTS {
        let points = first_points(&make(count)?, 0, count);
        add(&format!("points-{count}"), &scatter(name, &points), table("x,y", points.iter().map(|p| p.to_vec())));
    }
    let images = image_spectra(&make(1)?).unwrap_or_default();
    add(
        "image-spectrum",
        &image_figure(name, &images),
        spectra_table("frequency,dimension_0,dimension_2,dimension_4", &images),
    );
    let spectrum = [mean_point_spectrum(&make(SPECTRUM_POINTS)?)];
    add("point-spectrum", &points_figure(name, &spectrum[0]), spectra_table("frequency,power", &spectrum));
    let discrepancies = discrepancies(make)?;
    let rows = discrepancies.iter().map(|d| vec![d.count as f64, d.star, d.l2, d.random_l2()]);
    add("discrepancy", &discrepancy_figure(name, &discrepancies), table("samples,star,l2_star,l2_star_random", rows));
    let low = images.get(LENS).into_iter().flatten().filter(|ring| ring.frequency < LOW_FREQUENCY);
    let [power, count] =
        low.fold([0.0, 0.0], |[p, n], ring| [p + ring.power * ring.count as f64, n + ring.count as f64]);
    let l2 = discrepancies.iter().find(|d| d.count == 256).map_or(f64::NAN, |d| d.l2);
    Ok(PointPlots { files, low_frequency_power: power / count, l2_star_discrepancy: l2 })
}

/// The first two dimensions of the first `count` points of a pixel.
fn first_points(points: &dyn PointSet, pixel: u32, count: u64) -> Vec<[f64; 2]> {
    let place = [pixel % 4 * SPACING, pixel / 4 * SPACING];
    let point = |index| {
        let [x, y, ..] = points.block(SampleId::new(place, 0, index), 0).map(f64::from);
        [x, y]
    };
    (0..count).map(point).collect()
}

/// Block and coordinate of the dimensions whose images are plotted.
const IMAGE_DIMENSIONS: [(u32, usize); 3] = [(0, 0), (0, 2), (1, 0)];
/// The place of dimension 2 among them.
const LENS: usize = 1;

/// Spectra of images of [`IMAGE_DIMENSIONS`], the means over streams.
fn image_spectra(points: &dyn PointSet) -> Result<Vec<Vec<SpectrumRing>>, MetricsError> {
    let size = [IMAGE_SIDE; 2];
    let image = |(block, lane): (u32, usize), stream: u32| -> Vec<f64> {
        let pixels = (0..IMAGE_SIDE * IMAGE_SIDE).map(|p| [p % IMAGE_SIDE, p / IMAGE_SIDE]);
        pixels.map(|pixel| f64::from(points.block(SampleId::new(pixel, stream, 0), block)[lane])).collect()
    };
    let spectrum = |dimension| {
        let all: Result<Vec<_>, _> =
            (0..IMAGES).map(|stream| image_spectrum(size, &image(dimension, stream))).collect();
        all.map(|all| mean_spectrum(&all))
    };
    IMAGE_DIMENSIONS.into_iter().map(spectrum).collect()
}

fn mean_point_spectrum(points: &dyn PointSet) -> Vec<SpectrumRing> {
    let of = |pixel| point_spectrum(&first_points(points, pixel, SPECTRUM_POINTS), SPECTRUM_END);
    mean_spectrum(&(0..PIXELS).map(of).collect::<Vec<_>>())
}

/// The mean of spectra over the same rings.
fn mean_spectrum(all: &[Vec<SpectrumRing>]) -> Vec<SpectrumRing> {
    let mut mean = all.first().cloned().unwrap_or_default();
    for (k, ring) in mean.iter_mut().enumerate() {
        ring.power = all.iter().map(|spectrum| spectrum[k].power).sum::<f64>() / all.len() as f64;
    }
    mean
}

/// Discrepancies of a number of points.
struct Discrepancy {
    count: u64,
    /// The mean star discrepancy.
    star: f64,
    /// The root mean square L2 star discrepancy.
    l2: f64,
}

impl Discrepancy {
    /// The root mean square L2 star discrepancy of as many independent points.
    fn random_l2(&self) -> f64 {
        (5.0 / (36.0 * self.count as f64)).sqrt()
    }
}

/// Discrepancies at powers of two and at 1.5 times powers of two.
fn discrepancies<P: PointSet, E>(make: &dyn Fn(u64) -> Result<P, E>) -> Result<Vec<Discrepancy>, E> {
    let powers = (0..).map(|k| 1_u64 << k).take_while(|n| *n <= LARGEST_COUNT);
    let counts = powers.flat_map(|n| if n < 2 { vec![n] } else { vec![n, n / 2 * 3] }).filter(|n| *n <= LARGEST_COUNT);
    let at = |count| {
        let points = make(count)?;
        let pixels: Vec<_> = (0..PIXELS).map(|pixel| first_points(&points, pixel, count)).collect();
        let mean = |f: &dyn Fn(&[[f64; 2]]) -> f64| pixels.iter().map(|p| f(p)).sum::<f64>() / f64::from(PIXELS);
        let l2 = mean(&|p| l2_star_discrepancy(p).powi(2)).sqrt();
        Ok(Discrepancy { count, star: mean(&star_discrepancy), l2 })
    };
    counts.map(at).collect()
}

fn scatter(name: &str, points: &[[f64; 2]]) -> Figure {
    let (x, y) = (Scale::linear("dimension 0", [0.0, 1.0]), Scale::linear("dimension 1", [0.0, 1.0]));
    let title = format!("{name}: {} points of a pixel", points.len());
    Figure::new(title, x, y).with_dots(points.to_vec())
}

fn curve(label: &str, rings: &[SpectrumRing]) -> Curve {
    Curve::new(label, rings.iter().map(|ring| [ring.frequency, ring.power]).collect())
}

/// White noise, from the first to the last frequency.
fn white(rings: &[SpectrumRing]) -> Curve {
    let ends = rings.first().zip(rings.last()).map(|(a, b)| vec![[a.frequency, 1.0], [b.frequency, 1.0]]);
    Curve::new("white noise", ends.unwrap_or_default()).dashed()
}

/// The highest power, rounded up to halves, so that all of a spectrum is in the figure.
fn top<'a>(rings: impl Iterator<Item = &'a SpectrumRing>) -> f64 {
    let most = rings.map(|ring| ring.power).fold(1.5, f64::max);
    libm::ceil(2.0 * most) / 2.0
}

fn image_figure(name: &str, spectra: &[Vec<SpectrumRing>]) -> Figure {
    let y = Scale::linear("power, white noise = 1", [0.0, top(spectra.iter().flatten())]);
    let title = format!("{name}: images of one sample per pixel");
    let mut figure = Figure::new(title, Scale::linear("cycles per pixel", [0.0, 0.5]), y);
    for (label, rings) in ["dimension 0", "dimension 2", "dimension 4"].into_iter().zip(spectra) {
        figure = figure.with_curve(curve(label, rings));
    }
    figure.with_curve(white(spectra.first().map_or(&[], Vec::as_slice)))
}

fn points_figure(name: &str, rings: &[SpectrumRing]) -> Figure {
    let x = Scale::linear("cycles per side of the pixel", [0.0, f64::from(SPECTRUM_END)]);
    let title = format!("{name}: {SPECTRUM_POINTS} points of a pixel");
    let y = Scale::linear("power, independent points = 1", [0.0, top(rings.iter())]);
    Figure::new(title, x, y).with_curve(curve("points", rings)).with_curve(white(rings))
}

fn discrepancy_figure(name: &str, all: &[Discrepancy]) -> Figure {
    let largest = LARGEST_COUNT as f64;
    let (x, y) = (Scale::log("points", [1.0, largest]), Scale::log("discrepancy", [3e-4, 1.0]));
    let of = |f: &dyn Fn(&Discrepancy) -> f64| all.iter().map(|d| [d.count as f64, f(d)]).collect::<Vec<_>>();
    Figure::new(format!("{name}: discrepancy"), x, y)
        .with_curve(Curve::new("star discrepancy", of(&|d| d.star)))
        .with_curve(Curve::new("L2 star discrepancy", of(&|d| d.l2)))
        .with_curve(Curve::new("L2, independent points", of(&Discrepancy::random_l2)).dashed())
}

/// A CSV file with these columns.
fn table(header: &str, rows: impl Iterator<Item = Vec<f64>>) -> String {
    let mut text = format!("{header}\n");
    for row in rows {
        let cells: Vec<String> = row.iter().map(f64::to_string).collect();
        let _ = writeln!(text, "{}", cells.join(","));
    }
    text
}

/// The frequencies and powers of spectra over the same rings.
fn spectra_table(header: &str, spectra: &[Vec<SpectrumRing>]) -> String {
    let rings = spectra.first().map_or(&[][..], Vec::as_slice).iter().enumerate();
    let row = |(k, ring): (usize, &SpectrumRing)| {
        std::iter::once(ring.frequency).chain(spectra.iter().map(|spectrum| spectrum[k].power)).collect()
    };
    table(header, rings.map(row))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_job::registry::{self, AnyPoints, RegistryError, Setting};

    fn plots(name: &str) -> PointPlots {
        let make =
            |spp| -> Result<AnyPoints, RegistryError> { registry::points(name, Setting { seed: 1, spp: Some(spp) }) };
        point_plots(name, &make).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn spectra_tell_blue_from_white_noise() {
        for name in ["blue-noise", "pmj02", "zsobol", "mitchell-1991"] {
            let power = plots(name).low_frequency_power;
            assert!(power < 0.5, "{name}: {power:.3} of white noise");
        }
        // Negative controls: pixels that are independent. 4 x 400 frequencies: a standard error of 2.5 %.
        for name in ["random", "sobol", "lattice"] {
            let power = plots(name).low_frequency_power;
            assert!((power - 1.0).abs() < 0.12, "{name}: {power:.3} of white noise");
        }
    }

    #[test]
    fn discrepancies_tell_nets_from_independent_points() {
        // 16 pixels: the root mean square of independent points scatters by about an eighth.
        let random = plots("random").l2_star_discrepancy / (5.0_f64 / (36.0 * 256.0)).sqrt();
        assert!((random - 1.0).abs() < 0.5, "{random:.3}");
        for name in ["sobol", "zsobol", "lowdiscrepancy", "lattice"] {
            let found = plots(name).l2_star_discrepancy;
            assert!(found < 0.3 * 0.0233, "{name}: {found:.5}");
        }
    }

    #[test]
    fn each_plot_is_an_svg_with_a_table_beside_it() {
        let files = plots("blue-noise:of=stratified:strata=8").files;
        assert_eq!(files.len(), 12);
        for pair in files.chunks_exact(2) {
            let [(svg, drawn), (csv, numbers)] = pair else { unreachable!() };
            assert_eq!(svg.strip_suffix(".svg"), csv.strip_suffix(".csv"));
            assert!(svg.chars().all(|c| c.is_ascii_alphanumeric() || "-.".contains(c)), "{svg}");
            assert!(roxmltree::Document::parse(drawn).is_ok(), "{svg} is no XML");
            let columns = numbers.lines().next().map_or(0, |line| line.split(',').count());
            let sound = |line: &str| {
                line.split(',').filter(|cell| cell.parse::<f64>().is_ok_and(f64::is_finite)).count() == columns
            };
            assert!(numbers.lines().count() > 15 && numbers.lines().skip(1).all(sound), "{csv}: {numbers}");
        }
        let circles = files[0].1.matches("<circle").count();
        assert_eq!((circles, files[1].1.lines().count()), (64, 65));
    }
}
