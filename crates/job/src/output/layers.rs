//! The layers of an EXR file.

use dapple_core::{Features, Film, Filtered};
use dapple_scene::image::{Layer, Plane};

/// The names of the layers besides the image, in the order of [`layers`].
pub const LAYERS: [&str; 9] =
    ["unfiltered", "variance", "count", "error", "cluster", "albedo", "normal", "depth", "coverage"];

/// The layers whose values 16-bit floats hold with three digits, the image first. The range of the others is larger.
const HALF: [&str; 5] = ["", "unfiltered", "albedo", "normal", "coverage"];

/// Stores colours, normals and coverage as 16-bit floats.
pub(super) fn halve(layers: &mut [Layer<'_>]) {
    for layer in layers.iter_mut().filter(|layer| HALF.contains(&layer.name.as_str())) {
        for (_, plane) in &mut layer.channels {
            if let Plane::F32(values) = plane {
                *plane = Plane::F16(std::mem::take(values));
            }
        }
    }
}

/// Returns every EXR layer for which the film has statistics, the image first:
///
/// | layer | channels | contents |
/// |---|---|---|
/// | (main) | R G B | the image, linear radiance |
/// | `unfiltered` | R G B | the mean of each pixel's own samples, where a filter changed it |
/// | `variance` | R G B | sample variance (of one sample, not of the mean); NaN below two samples |
/// | `count` | Y, integers | samples per pixel |
/// | `error` | Y | predicted squared error of the image, mean over the channels, if the filter knows it |
/// | `cluster` | Y, integers | the cluster that each pixel's first sample met, 4294967295 where it met nothing |
/// | `albedo` | R G B | mean albedo of the first rough surfaces, black where nothing is hit |
/// | `normal` | X Y Z | their mean shading normal in the file's world space, 0 where nothing is hit |
/// | `depth` | Y | mean length of the paths to them in the file's units, infinite where nothing is hit |
/// | `coverage` | Y | share of the samples that hit a surface; the three layers above are means over these |
///
/// The first rough surface is seen through mirrors, glass and smooth coats, as denoisers expect
/// ([`SurfaceFeatures`](dapple_core::SurfaceFeatures)). The sky in a mirror has the normal 0 and the mirror's depth.
///
/// `unit` is the integrator's unit of length, measured in the file's: `1 / world.space().scale()`. `clusters` come from
/// [`cluster_ids`](super::cluster_ids).
pub fn layers(film: &Film, filtered: &Filtered, unit: f64, clusters: Option<Vec<u32>>) -> Vec<Layer<'static>> {
    let mut layers = vec![rgb("", &filtered.radiance)];
    let means = film.image();
    if means != filtered.radiance {
        layers.push(rgb("unfiltered", &means));
    }
    if film.needs().variance {
        let variance = |i: usize| {
            let moments = film.moments(i);
            match moments.count {
                0 | 1 => [f32::NAN; 3],
                n => moments.m2.map(|m| (m / (n - 1) as f64) as f32),
            }
        };
        let variances: Vec<[f32; 3]> = (0..film.frame().pixels()).map(variance).collect();
        layers.push(rgb("variance", &variances));
    }
    let counts: Vec<u32> = film.counts().into_iter().map(|n| u32::try_from(n).unwrap_or(u32::MAX)).collect();
    layers.push(one("count", counts.into()));
    if let Some(error) = &filtered.error {
        layers.push(one("error", error.clone().into()));
    }
    if let Some(clusters) = clusters {
        layers.push(one("cluster", clusters.into()));
    }
    let channel = |of: &dyn Fn(&Features) -> f32| of_features(film, of).map(Plane::from);
    let three = |of: fn(&Features) -> [f32; 3]| {
        Some([channel(&|f| of(f)[0])?, channel(&|f| of(f)[1])?, channel(&|f| of(f)[2])?])
    };
    if let (Some([r, g, b]), Some([x, y, z])) = (three(|f| f.albedo), three(|f| f.normal)) {
        layers.push(Layer { name: "albedo".into(), channels: vec![("R", r), ("G", g), ("B", b)] });
        layers.push(Layer { name: "normal".into(), channels: vec![("X", x), ("Y", y), ("Z", z)] });
    }
    layers.extend(channel(&|f| depth(f, unit)).map(|depth| one("depth", depth)));
    layers.extend(channel(&coverage).map(|coverage| one("coverage", coverage)));
    layers
}

/// Computes one value per pixel from its features (albedo, normal and depth); `None` if the film has no features. Values are computed pixel by pixel, since a copy of all features would take more memory than most films.
pub(super) fn of_features<T>(film: &Film, of: impl Fn(&Features) -> T) -> Option<Vec<T>> {
    let pixels = film.frame().pixels();
    film.needs().features.then(|| {
        let mut all = Vec::with_capacity(pixels);
        all.extend((0..pixels).filter_map(|i| film.features(i)).map(|features| of(&features)));
        all
    })
}

/// The mean length of a pixel's paths to the first rough surface, in the file's units; infinite if no sample hit a surface.
pub(super) fn depth(features: &Features, unit: f64) -> f32 {
    if features.hits == 0 { f32::INFINITY } else { (f64::from(features.depth) * unit) as f32 }
}

/// The share of a pixel's samples that hit a surface; 0 without samples.
fn coverage(features: &Features) -> f32 {
    features.hits as f32 / features.samples.max(1) as f32
}

fn rgb(name: &str, pixels: &[[f32; 3]]) -> Layer<'static> {
    let channel = |c: usize| Plane::from(pixels.iter().map(|p| p[c]).collect::<Vec<f32>>());
    Layer { name: name.into(), channels: vec![("R", channel(0)), ("G", channel(1)), ("B", channel(2))] }
}

fn one(name: &str, plane: Plane<'static>) -> Layer<'static> {
    Layer { name: name.into(), channels: vec![("Y", plane)] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Filter, Frame, Needs, Unfiltered};

    fn names(layers: &[Layer<'_>]) -> Vec<String> {
        layers.iter().map(|l| l.name.clone()).collect()
    }

    #[test]
    fn a_film_fills_the_layers_that_it_holds() {
        let frame = Frame::new(2, 1).unwrap();
        let mut film = Film::new(frame, Needs::none());
        film.push(0, 0, [1.0, 2.0, 3.0]);
        let filtered = Unfiltered.apply(&film).unwrap();
        assert_eq!(names(&layers(&film, &filtered, 1.0, None)), ["", "count"]);

        let mut film = Film::new(frame, Needs::none().with_variance().with_halves().with_features());
        for (half, value) in [(0, 1.0), (1, 3.0)] {
            film.push(0, half, [value; 3]);
        }
        let filtered = Unfiltered.apply(&film).unwrap();
        let found = layers(&film, &filtered, 1.0, None);
        assert_eq!(names(&found), ["", "variance", "count", "error", "albedo", "normal", "depth", "coverage"]);
        let plane = |layer: usize| found[layer].channels[0].1.clone();
        assert_eq!(plane(0), vec![2.0_f32, 0.0].into());
        let Plane::F32(variance) = plane(1) else { panic!("floats") };
        assert!(variance[0] == 2.0 && variance[1].is_nan(), "{variance:?}");
        assert_eq!(plane(2), vec![2_u32, 0].into());
        // One squared error per half-difference: (1 - 3)^2 / 4.
        assert_eq!(plane(3), vec![1.0, f32::INFINITY].into());
        assert_eq!(plane(6), vec![f32::INFINITY; 2].into());
        assert_eq!(plane(7), vec![0.0_f32; 2].into());
    }

    #[test]
    fn what_a_filter_changed_is_kept_beside_it() {
        let mut film = Film::new(Frame::new(1, 1).unwrap(), Needs::none());
        film.push(0, 0, [1.0; 3]);
        let filtered = Filtered::new([1, 1], vec![[0.5; 3]]);
        let found = layers(&film, &filtered, 1.0, None);
        assert_eq!(names(&found), ["", "unfiltered", "count"]);
        assert_eq!(found[1].channels[0].1, vec![1.0_f32].into());
    }
}
