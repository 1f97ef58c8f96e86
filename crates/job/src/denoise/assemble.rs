//! The buffers of an image from the layers of one or two files.

use super::features::Feature;
use super::layers::{Found, Layers, floats};
use super::{DenoiseError, DenoiseSpec, LayerKind};
use dapple_denoise::{ClusterRegression, Denoise, SampleBuffers, Variance, denoise, denoise_whole};
use dapple_scene::image::{Channels, Plane, read_attributes, read_channels, read_integers};
use std::path::{Path, PathBuf};

/// The number of samples per pixel that is assumed where none is known.
const ASSUMED_SPP: u32 = 16;

type Colours = Vec<[f32; 3]>;

/// One file with its channels.
pub(super) struct Input {
    path: PathBuf,
    pub(super) file: Channels,
    pub(super) layers: Layers,
    /// Samples per pixel by the header.
    spp: Option<u32>,
}

/// The samples in one file.
struct Set {
    mean: Colours,
    variance: Option<Colours>,
    /// The variance is that of the mean.
    of_mean: bool,
    count: Vec<u32>,
}

/// All buffers of an image.
pub(super) struct Assembled {
    size: [u32; 2],
    sets: Vec<Set>,
    normal: Feature<[f32; 3]>,
    albedo: Feature<[f32; 3]>,
    position: Feature<[f32; 3]>,
    depth: Feature<f32>,
    emission: Feature<[f32; 3]>,
    coverage: Feature<f32>,
    ids: Option<Vec<u32>>,
    pub(super) found: Vec<(LayerKind, String)>,
    pub(super) notices: Vec<String>,
}

impl Assembled {
    /// Reads the files of `spec`.
    pub(super) fn read(spec: &DenoiseSpec) -> Result<Self, DenoiseError> {
        if spec.inputs.is_empty() || spec.inputs.len() > 2 {
            return Err(DenoiseError::Files { count: spec.inputs.len() });
        }
        let inputs = spec.inputs.iter().map(|path| Input::read(path)).collect::<Result<Vec<_>, _>>()?;
        let size = inputs[0].file.size;
        if let [a, b] = &inputs[..]
            && a.file.size != b.file.size
        {
            let paths = Box::new([a.path.clone(), b.path.clone()]);
            return Err(DenoiseError::Sizes { paths, sizes: [size, b.file.size] });
        }
        let mut reader = Reader { spec, inputs: &inputs, found: Vec::new(), notices: Vec::new() };
        let sets = (0..inputs.len()).map(|k| reader.set(k)).collect::<Result<Vec<_>, _>>()?;
        let counts: Vec<&[u32]> = sets.iter().map(|set| &set.count[..]).collect();
        let normal = reader.feature(LayerKind::Normal, &counts)?;
        let albedo = reader.feature(LayerKind::Albedo, &counts)?;
        let position = reader.feature(LayerKind::Position, &counts)?;
        let depth = reader.scalar(LayerKind::Depth, &counts)?;
        let emission = reader.feature(LayerKind::Emission, &counts)?;
        let coverage = reader.scalar(LayerKind::Coverage, &counts)?;
        let ids = reader.ids()?;
        reader.missing(&[
            (LayerKind::Normal, normal.is_some()),
            (LayerKind::Albedo, albedo.is_some()),
            (LayerKind::Position, position.is_some() || depth.is_some()),
        ]);
        let Reader { mut found, notices, .. } = reader;
        found.sort();
        Ok(Self { size, sets, normal, albedo, position, depth, emission, coverage, ids, found, notices })
    }

    /// The image for the denoiser.
    pub(super) fn image(&self) -> Denoise<'_> {
        let mut image = match &self.sets[..] {
            [a, b, ..] => denoise(self.size, &a.buffers(), &b.buffers()),
            sets => denoise_whole(self.size, &sets[0].buffers()),
        };
        if let Some((mean, variance)) = &self.normal {
            image = match variance {
                Some(variance) => image.noisy_normal(mean, Variance::OfMean(variance)),
                None => image.normal(mean),
            };
        }
        if let Some((mean, variance)) = &self.albedo {
            image = match variance {
                Some(variance) => image.noisy_albedo(mean, Variance::OfMean(variance)),
                None => image.albedo(mean),
            };
        }
        if let Some((mean, variance)) = &self.position {
            image = match variance {
                Some(variance) => image.noisy_position(mean, Variance::OfMean(variance)),
                None => image.position(mean),
            };
        }
        if let Some((mean, variance)) = &self.depth {
            image = match variance {
                Some(variance) => image.noisy_depth(mean, Variance::OfMean(variance)),
                None => image.depth(mean),
            };
        }
        if let Some((share, _)) = &self.coverage {
            image = image.coverage(share);
        }
        if let Some((emission, _)) = &self.emission {
            image = image.emission(emission);
        }
        match &self.ids {
            Some(ids) => image.ids(ids),
            None => image,
        }
    }

    /// The description of the default filter.
    pub(super) fn default_filter(&self) -> String {
        use dapple_core::Filter as _;
        let plain = ClusterRegression::new();
        match self.ids {
            Some(_) => plain.with_clusters(std::sync::Arc::new(|_| None), "ids").describe(),
            None => plain.describe(),
        }
    }
}

impl Set {
    fn buffers(&self) -> SampleBuffers<'_> {
        let samples = SampleBuffers::new(&self.mean, &self.count);
        match &self.variance {
            Some(variance) if self.of_mean => samples.variance(Variance::OfMean(variance)),
            Some(variance) => samples.variance(Variance::OfSamples(variance)),
            None => samples,
        }
    }
}

impl Input {
    fn read(path: &Path) -> Result<Self, DenoiseError> {
        let open = |source| DenoiseError::Open { path: path.to_owned(), source };
        let bytes = std::fs::read(path).map_err(open)?;
        let name = path.display().to_string();
        if !bytes.starts_with(b"\x76\x2f\x31\x01") {
            return Err(DenoiseError::NotExr { path: path.to_owned() });
        }
        let file = read_channels(&bytes, &name)?;
        let layers = Layers::of(&file);
        // pbrt-v4 writes a number, Cycles a text `cycles.LAYER.samples`.
        let number = read_integers(&bytes, &name)?.into_iter().find(|(key, _)| key == "samplesPerPixel");
        let text = read_attributes(&bytes, &name)?;
        let text = text.iter().find(|(key, _)| key.starts_with("cycles.") && key.ends_with(".samples"));
        let spp = number.and_then(|(_, n)| u32::try_from(n).ok()).or_else(|| text?.1.parse().ok());
        Ok(Self { path: path.to_owned(), file, layers, spp: spp.filter(|n| *n > 0) })
    }

    pub(super) fn three(&self, channels: &[usize]) -> Colours {
        let [x, y, z] = [0, 1, 2].map(|c| floats(&self.file.channels[channels[c]].1));
        x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
    }

    pub(super) fn one(&self, layer: &Found) -> Vec<f32> {
        floats(&self.file.channels[layer.channels[0]].1)
    }
}

/// The search for layers in all files.
pub(super) struct Reader<'a> {
    spec: &'a DenoiseSpec,
    pub(super) inputs: &'a [Input],
    pub(super) found: Vec<(LayerKind, String)>,
    notices: Vec<String>,
}

impl Reader<'_> {
    /// Finds a layer of file `k`, by the caller's name or by known names, and notes it.
    pub(super) fn find(&mut self, k: usize, kind: LayerKind) -> Result<Option<Found>, DenoiseError> {
        let input = &self.inputs[k];
        let given = self.spec.layers.iter().find(|(own, _)| *own == kind);
        let found = match given {
            Some((_, name)) => Some(input.layers.given(kind, name, &input.path)?),
            None => input.layers.find(kind),
        };
        if let Some(found) = &found {
            let entry = (kind, if found.name.is_empty() { "R, G, B".to_owned() } else { found.name.clone() });
            if !self.found.contains(&entry) {
                self.found.push(entry);
            }
        }
        Ok(found)
    }

    /// The samples in file `k`.
    fn set(&mut self, k: usize) -> Result<Set, DenoiseError> {
        let input = &self.inputs[k];
        let (path, names) = (input.path.clone(), input.layers.names());
        let Some(color) = self.find(k, LayerKind::Color)? else {
            return Err(DenoiseError::NoImage { path, layers: names });
        };
        let mut mean = input.three(&color.channels);
        let count = self.counts(k, mean.len())?;
        let spread = self.variance(k, &mean, count.is_some())?;
        if spread.is_none() && self.inputs.len() == 1 {
            return Err(DenoiseError::NoVariance { path, layers: names });
        }
        let (variance, of_mean) = spread.map_or((None, false), |(variance, of_mean)| (Some(variance), of_mean));
        let mut count = count.unwrap_or_else(|| {
            self.note(format!("the number of samples per pixel is not in the files; {ASSUMED_SPP} is assumed (--spp)"));
            vec![ASSUMED_SPP; mean.len()]
        });
        let mut broken = 0;
        for (mean, count) in mean.iter_mut().zip(&mut count) {
            if mean.iter().any(|v| !v.is_finite()) {
                (*mean, *count) = ([0.0; 3], 0);
                broken += 1;
            }
        }
        if broken > 0 {
            let path = path.display();
            self.note(format!("{path}: {broken} pixels are NaN or infinite; they are filled from their neighbours"));
        }
        Ok(Set { mean, variance, of_mean, count })
    }

    /// The number of samples of each pixel in file `k`, as far as it is known.
    fn counts(&mut self, k: usize, pixels: usize) -> Result<Option<Vec<u32>>, DenoiseError> {
        let known = self.spec.spp.or(self.inputs[k].spp);
        let Some(layer) = self.find(k, LayerKind::Count)? else { return Ok(known.map(|spp| vec![spp; pixels])) };
        let counts = self.inputs[k].one(&layer);
        // Cycles writes shares of the largest number.
        let most = counts.iter().copied().fold(0.0, f32::max);
        let shares = most <= 1.0 && (known.is_some() || counts.iter().any(|n| n.fract() > 0.0));
        let unit = if shares { known.unwrap_or(ASSUMED_SPP) as f32 } else { 1.0 };
        if shares && known.is_none() {
            let name = &layer.name;
            self.note(format!(
                "layer \"{name}\" holds shares of an unknown number of samples; {ASSUMED_SPP} is assumed (--spp)"
            ));
        }
        let number = |n: f32| if n > 0.0 { (n * unit).round().max(1.0) as u32 } else { 0 };
        Ok(Some(counts.into_iter().map(number).collect()))
    }

    /// The variance in file `k`, and true if it is that of the mean. `counted` is true if the number of samples is known.
    fn variance(&mut self, k: usize, mean: &Colours, counted: bool) -> Result<Option<(Colours, bool)>, DenoiseError> {
        let input = &self.inputs[k];
        let mut kinds = [LayerKind::MeanVariance, LayerKind::Variance, LayerKind::SecondMoment];
        // A layer that the caller names comes first.
        kinds.sort_by_key(|kind| !self.spec.layers.iter().any(|(given, _)| given == kind));
        let mut layer = None;
        for kind in kinds {
            layer = if layer.is_none() { self.find(k, kind)? } else { layer };
        }
        let Some(layer) = layer else { return Ok(None) };
        let (mut variance, of_mean) = match layer.kind {
            LayerKind::SecondMoment => (from_second_moments(input, &layer, mean), false),
            LayerKind::MeanVariance => (input.three(&layer.channels), true),
            _ => (input.three(&layer.channels), self.spec.variance_of_mean),
        };
        let name = layer.name;
        if !of_mean && !counted {
            if self.inputs.len() == 2 {
                return Ok(None);
            }
            return Err(DenoiseError::NoCount { path: input.path.clone(), layer: name });
        }
        let mut unknown = 0;
        for (variance, mean) in variance.iter_mut().zip(mean) {
            if variance.iter().any(|v| !v.is_finite()) {
                // A standard deviation as large as the colour: that of a rare bright sample.
                *variance = mean.map(|v| if v.is_finite() { v * v } else { 0.0 });
                unknown += 1;
            }
        }
        if unknown > 0 {
            self.note(format!(
                "layer \"{name}\": {unknown} variances are NaN or infinite; the squared colour stands for them"
            ));
        }
        Ok(Some((variance, of_mean)))
    }

    /// The ids in the first file.
    fn ids(&mut self) -> Result<Option<Vec<u32>>, DenoiseError> {
        let layer = self.find(0, LayerKind::Id)?;
        Ok(layer.map(|layer| match &self.inputs[0].file.channels[layer.channels[0]].1 {
            Plane::U32(ids) => ids.to_vec(),
            // Cryptomatte and other float ids: equal bits are equal ids.
            Plane::F32(ids) | Plane::F16(ids) => ids.iter().map(|id| id.to_bits()).collect(),
        }))
    }

    pub(super) fn broken(&mut self, kind: LayerKind, count: usize) {
        if count > 0 {
            self.note(format!("{count} values of the {} are NaN or infinite; 0 stands for them", kind.name()));
        }
    }

    fn missing(&mut self, kinds: &[(LayerKind, bool)]) {
        let names: Vec<&str> = kinds.iter().filter(|(_, known)| !known).map(|(kind, _)| kind.name()).collect();
        if names.is_empty() {
            return;
        }
        let hint = "a file with it is denoised better; --layer KIND=NAME names a layer";
        self.note(format!("no {} was found; {hint}", names.join(", no ")));
    }

    fn note(&mut self, notice: String) {
        if !self.notices.contains(&notice) {
            self.notices.push(notice);
        }
    }
}

/// Sample variances from second moments. Those of X, Y and Z give the relative variance of Y to all channels.
fn from_second_moments(input: &Input, second: &Found, mean: &Colours) -> Colours {
    let squares = input.three(&second.channels);
    if !input.layers.is_xyz(second) {
        let variance = |(m2, m): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (m2[c] - m[c] * m[c]).max(0.0));
        return squares.iter().zip(mean).map(variance).collect();
    }
    let first = input.layers.first_moment(second).map_or_else(|| mean.clone(), |channels| input.three(&channels));
    let variance = |((m2, m), rgb): ((&[f32; 3], &[f32; 3]), &[f32; 3])| {
        let relative = if m[1] > 0.0 { (m2[1] / (m[1] * m[1]) - 1.0).max(0.0) } else { 0.0 };
        rgb.map(|v| relative * v * v)
    };
    squares.iter().zip(&first).zip(mean).map(variance).collect()
}
