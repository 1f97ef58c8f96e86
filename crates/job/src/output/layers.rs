//! The layers of an EXR file.

use dapple_core::{Film, Filtered, Needs, film::Features};
use dapple_scene::image::{Layer, Plane};

/// A layer of EXR files besides the image.
pub(super) struct LayerEntry {
    /// The layer's name, of lower-case letters.
    pub(super) name: &'static str,
    /// The names of the layer's channels.
    channels: &'static [&'static str],
    /// `true` if 16-bit floats can hold the layer's values to three digits; the values of other layers are too large.
    half: bool,
    /// Adds the statistics from which the layer is made.
    pub(super) needs: fn(Needs) -> Needs,
    /// The files for which the film must record these statistics.
    pub(super) asked: Asked,
    /// One plane per channel; `None` if the film lacks the statistics.
    planes: MakePlanes,
}

type MakePlanes = for<'a> fn(&Shown<'a>) -> Option<Vec<Plane<'a>>>;

impl LayerEntry {
    /// A layer that no film records extra statistics for.
    const fn of(
        name: &'static str,
        channels: &'static [&'static str],
        needs: fn(Needs) -> Needs,
        planes: MakePlanes,
    ) -> Self {
        Self { name, channels, half: false, needs, asked: Asked::Never, planes }
    }

    /// A layer of features.
    const fn of_features(
        name: &'static str,
        channels: &'static [&'static str],
        half: bool,
        planes: MakePlanes,
    ) -> Self {
        Self { name, channels, half, needs: Needs::with_features, asked: Asked::Named, planes }
    }
}

/// The files for which a film must record the statistics of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// Files with all layers, and files whose list of layers names this one.
    Always,
    /// Files whose list of layers names this one.
    Named,
    /// No file: the layer is written only if the sampler or the filter needs the same statistics.
    Never,
}

/// The data from which layers are made.
struct Shown<'a> {
    film: &'a Film,
    filtered: &'a Filtered,
    /// The integrator's unit of length, in the scene file's units.
    unit: f64,
    clusters: Option<Vec<u32>>,
}

impl<'a> Shown<'a> {
    /// A plane with the value `of(i)` in pixel `i`, computed while the file is written.
    fn each(&self, of: impl Fn(usize) -> f32 + Send + Sync + 'a) -> Plane<'a> {
        Plane::each(self.film.frame().pixels(), of)
    }

    /// Three planes with the three values `of(i)` in pixel `i`.
    fn rgb(&self, of: impl Fn(usize) -> [f32; 3] + Send + Sync + Copy + 'a) -> Vec<Plane<'a>> {
        (0..3).map(|c| self.each(move |i| of(i)[c])).collect()
    }

    /// One plane of features for each function in `of`; `None` if the film has no features.
    fn features(&self, of: &[fn(&Features, f64) -> f32]) -> Option<Vec<Plane<'a>>> {
        let unit = self.unit;
        of.iter().map(|&of| plane_of_features(self.film, move |_, f| of(f, unit))).collect()
    }
}

/// The layers besides the image, in the order of [`layers`].
pub(super) const LAYERS: &[LayerEntry] = &[
    LayerEntry {
        half: true,
        ..LayerEntry::of("unfiltered", RGB, NOTHING, |shown| {
            let film = shown.film;
            let mean = |i| film.mean(i).map(|x| x as f32);
            let differs = shown.filtered.radiance.iter().enumerate().any(|(i, filtered)| *filtered != mean(i));
            differs.then(|| shown.rgb(move |i| film.mean(i).map(|x| x as f32)))
        })
    },
    LayerEntry { asked: Asked::Always, ..LayerEntry::of("variance", RGB, Needs::with_variance, variance) },
    LayerEntry::of("count", &["Y"], NOTHING, |shown| {
        let count = |n| u32::try_from(n).unwrap_or(u32::MAX);
        Some(vec![shown.film.counts().into_iter().map(count).collect::<Vec<u32>>().into()])
    }),
    LayerEntry::of("error", &["Y"], Needs::with_halves, |shown| {
        shown.filtered.error.as_deref().map(|error| vec![error.into()])
    }),
    // It is not known here if the render has clusters.
    LayerEntry::of("cluster", &["Y"], Needs::with_surfaces, |shown| {
        shown.clusters.clone().map(|clusters| vec![clusters.into()])
    }),
    LayerEntry::of_features("albedo", RGB, true, |shown| {
        shown.features(&[|f, _| f.albedo[0], |f, _| f.albedo[1], |f, _| f.albedo[2]])
    }),
    LayerEntry::of_features("normal", &["X", "Y", "Z"], true, |shown| {
        shown.features(&[|f, _| f.normal[0], |f, _| f.normal[1], |f, _| f.normal[2]])
    }),
    LayerEntry::of_features("depth", &["Y"], false, |shown| shown.features(&[depth])),
    LayerEntry::of_features("coverage", &["Y"], true, |shown| shown.features(&[|f, _| coverage(f)])),
];

const RGB: &[&str] = &["R", "G", "B"];
/// The statistics of layers that every film can fill: none besides the film's own.
const NOTHING: fn(Needs) -> Needs = |needs| needs;

/// The image's own channels that are made from features. Lists of layers may contain their names.
pub(super) const OF_IMAGE: [&str; 2] = ["A", "Z"];

/// All names that [`OutputFiles::layers`](super::OutputFiles::layers) may contain.
pub fn layer_names() -> impl Iterator<Item = &'static str> {
    OF_IMAGE.into_iter().chain(LAYERS.iter().map(|layer| layer.name))
}

/// Stores colours, normals and coverage as 16-bit floats.
pub(super) fn halve(layers: &mut [Layer<'_>]) {
    let half = |name: &str| name.is_empty() || LAYERS.iter().any(|entry| entry.half && entry.name == name);
    for layer in layers.iter_mut().filter(|layer| half(&layer.name)) {
        // 16-bit floats would be too coarse for distances along the axis.
        for (_, plane) in layer.channels.iter_mut().filter(|(name, _)| *name != "Z" || !layer.name.is_empty()) {
            plane.halve();
        }
    }
}

/// The bytes per pixel of all layers, including the image, of a film with these statistics. `filtered` is `true` if a filter
/// made the image.
pub(super) fn bytes_per_pixel(needs: &Needs, filtered: bool) -> usize {
    let shown = |entry: &&LayerEntry| (entry.needs)(*needs) == *needs && (filtered || entry.name != "unfiltered");
    let besides: usize = LAYERS.iter().filter(shown).map(|entry| entry.channels.len()).sum();
    4 * (3 + besides + if needs.features { OF_IMAGE.len() } else { 0 })
}

/// Returns every EXR layer for which the film has statistics, the image first. Writing a file adds the channels A and Z:
///
/// | layer | channels | contents |
/// |---|---|---|
/// | (main) | R G B | the image, linear radiance |
/// | (main) | A | the value of `coverage`, for compositing; R G B include the background |
/// | (main) | Z | distance along the camera's axis, as Blender writes it; 1e10 without a hit |
/// | `unfiltered` | R G B | the mean of each pixel's own samples; only if a filter changed the image |
/// | `variance` | R G B | sample variance (of one sample, not of the mean); NaN below two samples |
/// | `count` | Y, integers | samples per pixel |
/// | `error` | Y | predicted squared error of the image, mean over the channels; only if the filter estimates it |
/// | `cluster` | Y, integers | the cluster that each pixel's first sample hit; 4294967295 without a hit |
/// | `albedo` | R G B | mean albedo of the first non-specular surfaces; black without a hit |
/// | `normal` | X Y Z | mean shading normal of the same surfaces in the file's world space; 0 without a hit |
/// | `depth` | Y | mean length of the paths to the same surfaces in the file's units; infinite without a hit |
/// | `coverage` | Y | fraction of samples that hit a surface |
///
/// Albedo, normal and depth are means over the samples that hit a surface. The first non-specular surface may lie behind
/// mirrors, glass and smooth coats, as denoisers expect ([`SurfaceFeatures`](dapple_core::SurfaceFeatures)). The sky in a
/// mirror has the normal 0 and the mirror's depth.
///
/// `unit` is the integrator's unit of length in the file's units: `1 / world.space().scale()`. `clusters` come from
/// [`cluster_ids`](super::cluster_ids).
pub fn layers<'a>(film: &'a Film, filtered: &'a Filtered, unit: f64, clusters: Option<Vec<u32>>) -> Vec<Layer<'a>> {
    let layer = |name: &str, channels: &[&'static str], planes: Vec<Plane<'a>>| Layer {
        name: name.into(),
        channels: channels.iter().copied().zip(planes).collect(),
    };
    let shown = Shown { film, filtered, unit, clusters };
    let mut layers = vec![layer("", RGB, shown.rgb(|i| filtered.radiance[i]))];
    layers.extend(LAYERS.iter().filter_map(|e| Some(layer(e.name, e.channels, (e.planes)(&shown)?))));
    layers
}

fn variance<'a>(shown: &Shown<'a>) -> Option<Vec<Plane<'a>>> {
    let film = shown.film;
    let variance = |i: usize| film.moments(i).variance().map_or([f32::NAN; 3], |v| v.map(|v| v as f32));
    film.needs().variance.then(|| shown.rgb(variance))
}

/// A plane with a value computed from each pixel's features (albedo, normal and depth); `None` if the film has none.
pub(super) fn plane_of_features<'a>(
    film: &'a Film,
    of: impl Fn(usize, &Features) -> f32 + Send + Sync + 'a,
) -> Option<Plane<'a>> {
    let of = move |i| film.features(i).map_or(0.0, |features| of(i, &features));
    film.needs().features.then(|| Plane::each(film.frame().pixels(), of))
}

/// The mean length of a pixel's paths to the first non-specular surface, in the file's units; infinite if no sample hit a
/// surface.
pub(super) fn depth(features: &Features, unit: f64) -> f32 {
    if features.hits == 0 { f32::INFINITY } else { (f64::from(features.depth) * unit) as f32 }
}

/// The fraction of a pixel's samples that hit a surface; 0 without samples.
pub(super) fn coverage(features: &Features) -> f32 {
    features.hits as f32 / features.samples.max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_core::{Filter, Frame, Unfiltered};

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
        let plane = |layer: usize| found[layer].channels[0].1.floats();
        assert_eq!(plane(0), vec![2.0_f32, 0.0]);
        let variance = plane(1);
        assert!(variance[0] == 2.0 && variance[1].is_nan(), "{variance:?}");
        assert_eq!(found[2].channels[0].1, vec![2_u32, 0].into());
        // One squared error per half-difference: (1 - 3)^2 / 4.
        assert_eq!(plane(3), vec![1.0, f32::INFINITY]);
        assert_eq!(plane(6), vec![f32::INFINITY; 2]);
        assert_eq!(plane(7), vec![0.0_f32; 2]);
    }

    #[test]
    fn what_a_filter_changed_is_kept_beside_it() {
        let mut film = Film::new(Frame::new(1, 1).unwrap(), Needs::none());
        film.push(0, 0, [1.0; 3]);
        let filtered = Filtered::new([1, 1], vec![[0.5; 3]]);
        let found = layers(&film, &filtered, 1.0, None);
        assert_eq!(names(&found), ["", "unfiltered", "count"]);
        assert_eq!(found[1].channels[0].1.floats(), vec![1.0_f32]);
    }
}
