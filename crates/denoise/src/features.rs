//! The features of each pixel as planes: normal, albedo, depth and position.

use crate::graph::{Graph, Reach, all};
use crate::inputs::level;
use crate::planes::{Colours, Plane, box_mean, map_to_one, per_pixel, planes_of, quantile, sum_pixels};
use dapple_core::Film;

/// The number of feature channels: shading normal (3), albedo (3), logarithm of depth (1).
pub(crate) const FEATURES: usize = 7;

/// The variance assumed for an unknown value, in units of the squared level (the image's mean brightness).
pub(crate) const UNKNOWN: f32 = 1e6;

/// The features of the first non-specular surface that each pixel shows. A miss has a zero normal, an albedo of 1 and a large
/// depth.
#[derive(Clone, Copy)]
pub(crate) struct Features {
    /// The mean normal (3 planes), albedo (3) and logarithm of depth (1).
    pub(crate) mean: [Plane; FEATURES],
    /// The variances of the mean normal, of the mean albedo (each summed over its channels) and of the mean logarithm
    /// of depth.
    pub(crate) variance: [Plane; 3],
    /// The variance of the mean position, summed over its coordinates.
    pub(crate) scatter: Plane,
    /// The smallest change of log depth per pixel among 3x3 pixels.
    pub(crate) slope: Plane,
    /// The mean position, relative to the mean over the image.
    pub(crate) position: Colours,
    /// One over the width of 24 pixels at the pixel's depth.
    pub(crate) scale: Plane,
}

/// The depth of a miss (twice the largest depth) and the mean of all positions.
fn extent(film: &Film) -> (f32, [f64; 3]) {
    let size = film.frame().size().map(|n| n as usize);
    let hit = |i: usize| film.features(i).filter(|f| f.hits > 0);
    let depth = |i: usize| hit(i).map_or(0.5, |f| f.depth.clamp(1e-18, 1e18));
    let deepest = (0..film.frame().pixels()).map(depth).fold(0.5, f32::max);
    // In f64, because positions may lie far from the origin.
    let [x, y, z, count] = sum_pixels(size, |i| match hit(i).map(|f| f.position.map(f64::from)) {
        Some([x, y, z]) => [x, y, z, 1.0],
        None => [0.0; 4],
    });
    (2.0 * deepest, [x, y, z].map(|sum| sum / f64::max(count, 1.0)))
}

impl Features {
    /// Reads the features of a film. If `read` is `false`, every pixel is a miss.
    pub(crate) fn new<'a>(graph: &Graph<'a>, film: &'a Film, read: bool) -> Self {
        let far = extent(film);
        let [nx, ny, nz, r, g, b, depth, x, y, z, vn, va, vd, scatter, distance] = planes(graph, film, far, read);
        let unit = 24.0 * pixel_angle(film, far, read);
        let scale = map_to_one(graph, [distance], move |[distance]| 1.0 / (unit * distance.max(1e-18)));
        let slope = slopes(graph, depth);
        let (mean, variance, position) = ([nx, ny, nz, r, g, b, depth], [vn, va, vd], [x, y, z]);
        Self { mean, variance, scatter, slope, position, scale }
    }

    /// The red, green and blue of the albedo.
    pub(crate) fn albedo(&self) -> Colours {
        let [_, _, _, red, green, blue, _] = self.mean;
        [red, green, blue]
    }
}

/// The features of one pixel, or one plane for each: the means of normal (3), albedo (3), log depth and position (3), the
/// variances of normal, albedo, log depth and position, and the depth.
type Each<T> = [T; 15];

/// The planes of a film's features. `far` and `middle` are the results of [`extent`].
fn planes<'a>(graph: &Graph<'a>, film: &'a Film, (far, middle): (f32, [f64; 3]), read: bool) -> Each<Plane> {
    let size = graph.size;
    let miss = (!read || !film.needs().features).then(|| {
        let [nx, ny, nz, r, g, b, depth, x, y, z] = miss(far);
        [nx, ny, nz, r, g, b, depth, x, y, z, 0.0, 0.0, 0.0, 0.0, far]
    });
    let lamps = if miss.is_none() { beside_lamps(graph, film) } else { None };
    graph.rows(all(lamps, Reach::rows(FILLED)), move |rows, y, mut to: Each<&mut [f32]>| {
        let is_beside_lamp = |i: usize| lamps.is_some_and(|lamps| rows.row(lamps, i / size[0])[i % size[0]] > 0.0);
        let of = |i: usize| miss.or_else(|| feature(film, i, (far, middle), is_beside_lamp(i)));
        for x in 0..size[0] {
            let i = y * size[0] + x;
            let values = of(i).or_else(|| from_neighbours(of, size, i)).unwrap_or_default();
            to.iter_mut().zip(values).for_each(|(plane, value)| plane[x] = value);
        }
    })
}

/// The smallest brightness of a light source, in units of the image's level.
const LAMP: f32 = 8.0;

/// A plane that is above 0 in pixels with a light source, background and a surface that fills its pixel all within two pixels;
/// 0 in all others. `None` without background.
fn beside_lamps<'a>(graph: &Graph<'a>, film: &'a Film) -> Option<Plane> {
    let hits = |i: usize| film.features(i).map_or([0, 0], |f| [f.hits, f.samples]);
    if (0..film.frame().pixels()).all(|i| hits(i)[0] > 0) {
        return None;
    }
    let grey = |i: usize| (film.moments(i).mean.iter().sum::<f64>() / 3.0) as f32;
    let least = LAMP * level(&per_pixel(film.frame().pixels(), grey), graph.size);
    let holds = planes_of(graph, move |i| {
        let [hits, samples] = hits(i);
        [hits == 0, hits == samples, grey(i) > least].map(|holds| if holds { 1.0 } else { 0.0 })
    });
    let near = holds.map(|plane| box_mean(graph, plane, 2));
    Some(map_to_one(graph, near, |[background, surface, lamp]| lamp * background * surface))
}

/// The feature means of a pixel that shows no surface, at the depth `far`.
fn miss(far: f32) -> [f32; 10] {
    [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, ln(far), 0.0, 0.0, 0.0]
}

/// The features of pixel `i`, with its misses blended in and positions relative to `middle`; `None` without samples.
///
/// Blending makes the depth rise over several pixels from a surface to the background, like a slope that joins both. Beside a
/// sharp edge of a light, the light would then leak into the background, so depth and position stay those of the surface there.
fn feature(film: &Film, i: usize, (far, middle): (f32, [f64; 3]), is_beside_lamp: bool) -> Option<Each<f32>> {
    let f = film.features(i).filter(|f| f.samples > 0)?;
    let share = f.hits as f32 / f.samples as f32;
    let depth = if f.hits > 0 { f.depth.clamp(1e-18, far) } else { far };
    let [nx, ny, nz] = f.normal;
    let [r, g, b] = f.albedo;
    let position: [f32; 3] = std::array::from_fn(|k| (f64::from(f.position[k]) - middle[k]) as f32);
    let hit = [nx, ny, nz, r, g, b, ln(depth), position[0], position[1], position[2]];
    let miss = miss(far);
    let share = |k: usize| if is_beside_lamp && k >= 6 { 1.0 } else { share };
    let mean: [f32; 10] =
        std::array::from_fn(|k| if f.hits > 0 { miss[k] + share(k) * (hit[k] - miss[k]) } else { miss[k] });
    let [normal, albedo, places, depths] = f.variance.unwrap_or_default();
    // Summed over the channels from `first` to below `end`.
    let spread = |[first, end]: [usize; 2], within: f32| {
        let gap = |k: usize| if f.hits > 0 { (hit[k] - miss[k]) * (hit[k] - miss[k]) } else { 0.0 };
        let (share, gaps) = (share(first), (first..end).map(gap).sum::<f32>());
        (share * within + share * (1.0 - share) * gaps) / f.samples as f32
    };
    let spreads = [spread([0, 3], normal), spread([3, 6], albedo), spread([6, 7], depths / (depth * depth))];
    let [vn, va, vd] = spreads.map(|v| v.min(UNKNOWN));
    // Bounds that valid normals and albedos never reach; positions keep finite squares.
    let bounded = |k: usize| if k < 6 { mean[k].clamp(-16.0, 16.0) } else { mean[k].clamp(-1e18, 1e18) };
    let scatter = spread([7, 10], places).min(1e30);
    Some(std::array::from_fn(|k| if k < 10 { bounded(k) } else { [vn, va, vd, scatter, depth][k - 10] }))
}

/// The natural logarithm of a positive normal number, with the same bits on every machine (the standard library's may
/// differ). Its error is at most 2 units in the last place of `max(1, |ln x|)`.
///
/// `x = 2^e m` with `m` in about 0.7 .. 1.4, and `ln m = 2 artanh((m - 1) / (m + 1))`. The series ends after the ninth
/// power; the remainder is below 1e-9.
pub(crate) fn ln(x: f32) -> f32 {
    /// The bits of the square root of 1/2, the smallest mantissa.
    const LEAST: u32 = 0x3f35_04f3;
    let exponent = (x.to_bits().wrapping_sub(LEAST) as i32) >> 23;
    let m = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let series = 2.0 * s * (1.0 + q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0)))));
    exponent as f32 * std::f32::consts::LN_2 + series
}

/// The radius in pixels within which neighbours provide unknown features.
const FILLED: usize = 2;

/// The mean of the known features among 5x5 pixels around pixel `i`; `None` if none are known.
fn from_neighbours(known: impl Fn(usize) -> Option<Each<f32>>, size: [usize; 2], i: usize) -> Option<Each<f32>> {
    let [width, height] = size;
    let (x, y, reach) = (i % width, i / width, FILLED);
    let (mut sum, mut count) = ([0.0; 15], 0.0f32);
    for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
        for f in (x.saturating_sub(reach)..(x + reach + 1).min(width)).filter_map(|x| known(row * width + x)) {
            sum.iter_mut().zip(f).for_each(|(sum, value)| *sum += value);
            count += 1.0;
        }
    }
    // Variances are summed, not averaged, since neighbours differ.
    let mean = |k: usize| if (10..14).contains(&k) { sum[k] } else { sum[k] / count };
    (count > 0.0).then(|| std::array::from_fn(mean))
}

/// The approximate width of a pixel at distance 1: the lower quartile of the steps between neighbouring positions.
fn pixel_angle(film: &Film, extent: (f32, [f64; 3]), read: bool) -> f32 {
    let graph = Graph::new(film.frame().size().map(|n| n as usize));
    let [_, _, _, _, _, _, _, x, y, z, _, _, _, _, depth] = planes(&graph, film, extent, read);
    let mut steps = Vec::with_capacity(film.frame().pixels());
    graph.run(&[x, y, z, depth], |rows, range| {
        for row in range {
            let (position, depth) = ([x, y, z].map(|plane| rows.row(plane, row)), rows.row(depth, row));
            let step = |i: usize| {
                let apart = position.iter().map(|p| (p[i + 1] - p[i]).powi(2)).sum::<f32>().sqrt();
                (apart > 0.0).then(|| apart / depth[i])
            };
            steps.extend((0..depth.len() - 1).filter_map(step));
        }
    });
    quantile(steps, 4).map_or(1e-3, |quarter| quarter.clamp(1e-9, 1e9))
}

/// The smallest change of the log `depth` per pixel among 3x3 pixels.
pub(crate) fn slopes(graph: &Graph<'_>, depth: Plane) -> Plane {
    let change = around(graph, depth, |[above, own, below], [left, x, right]| {
        0.5 * (own[right] - own[left]).abs().max((below[x] - above[x]).abs())
    });
    around(graph, change, |rows, columns| {
        let least = columns.map(|x| rows[0][x].min(rows[1][x]).min(rows[2][x]));
        least[0].min(least[1]).min(least[2])
    })
}

/// A plane computed by `of` from 3x3 pixels. `of` gets the rows above, at and below a pixel, and the columns left of, at and
/// right of it. Beyond the frame, the border repeats.
fn around<'a>(graph: &Graph<'a>, plane: Plane, of: impl Fn([&[f32]; 3], [usize; 3]) -> f32 + Sync + 'a) -> Plane {
    let [width, height] = graph.size;
    let near = |k: usize, end: usize| [k.saturating_sub(1), k, (k + 1).min(end - 1)];
    let [all] = graph.rows(all([plane], Reach::rows(1)), move |rows, y, [to]: [&mut [f32]; 1]| {
        let rows = near(y, height).map(|y| rows.row(plane, y));
        to.iter_mut().enumerate().for_each(|(x, value)| *value = of(rows, near(x, width)));
    });
    all
}
