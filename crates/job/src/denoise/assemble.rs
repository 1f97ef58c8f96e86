//! Reading of one view's buffers (image, features and their variances) from the layers of one or two files.

use super::input::Input;
use super::{DenoiseError, DenoiseSpec, LayerKind};
use dapple_denoise::{Denoise, SampleBuffers, Variance, denoise, denoise_whole};
use dapple_scene::image::{FoundLayer, Plane, Window};

/// The number of samples per pixel that is assumed for files that do not state it.
const ASSUMED_SPP: u32 = 16;

type Colours = Vec<[f32; 3]>;

/// The image of one file, with its variance and sample counts.
struct Set {
    mean: Colours,
    /// The variance, and `true` for the variance of the mean, `false` for the variance of one sample.
    variance: Option<(Colours, bool)>,
    count: Vec<u32>,
}

/// All buffers of one view.
pub(super) struct Assembled {
    /// The pixels that all layers cover.
    pub(super) window: Window,
    sets: Vec<Set>,
    normal: Feature<[f32; 3]>,
    albedo: Feature<[f32; 3]>,
    position: Feature<[f32; 3]>,
    depth: Feature<f32>,
    emission: Feature<[f32; 3]>,
    coverage: Feature<[f32; 1]>,
    ids: Option<Vec<u32>>,
    pub(super) found: Vec<(LayerKind, String)>,
    pub(super) notices: Vec<String>,
}

impl Assembled {
    /// Reads all buffers of one view. `colors` holds the view's image layer in each file.
    pub(super) fn read(spec: &DenoiseSpec, inputs: &[Input], colors: &[FoundLayer]) -> Result<Self, DenoiseError> {
        let window = inputs[0].window(&colors[0]);
        let mut reader = Reader { spec, inputs, colors, window, found: Vec::new(), notices: Vec::new() };
        reader.cut()?;
        let sets = (0..inputs.len()).map(|k| reader.set(k)).collect::<Result<Vec<_>, _>>()?;
        if let ([a, b], [first, second]) = (&sets[..], inputs)
            && a.mean == b.mean
        {
            return Err(DenoiseError::Equal { paths: Box::new([first.path.clone(), second.path.clone()]) });
        }
        let counts: Vec<&[u32]> = sets.iter().map(|set| &set.count[..]).collect();
        let normal = reader.feature(LayerKind::Normal, &counts)?;
        let albedo = reader.feature(LayerKind::Albedo, &counts)?;
        let position = reader.feature(LayerKind::Position, &counts)?;
        let depth = reader.feature::<1>(LayerKind::Depth, &counts)?;
        let depth = depth.map(|(mean, variance)| (mean.into_flattened(), variance.map(Vec::into_flattened)));
        let emission = reader.feature(LayerKind::Emission, &counts)?;
        let coverage = reader.feature(LayerKind::Coverage, &counts)?;
        let ids = reader.ids()?;
        reader.missing(&[
            (LayerKind::Normal, normal.is_some()),
            (LayerKind::Albedo, albedo.is_some()),
            (LayerKind::Position, position.is_some() || depth.is_some()),
        ]);
        let Reader { mut found, notices, window, .. } = reader;
        found.sort();
        Ok(Self { window, sets, normal, albedo, position, depth, emission, coverage, ids, found, notices })
    }

    /// The buffers as the input of the denoiser.
    pub(super) fn image(&self) -> Denoise<'_> {
        let mut image = match &self.sets[..] {
            [a, b, ..] => denoise(self.window.size, &a.buffers(), &b.buffers()),
            sets => denoise_whole(self.window.size, &sets[0].buffers()),
        };
        image = added(image, &self.normal, Denoise::normal, Denoise::noisy_normal);
        image = added(image, &self.albedo, Denoise::albedo, Denoise::noisy_albedo);
        image = added(image, &self.position, Denoise::position, Denoise::noisy_position);
        image = added(image, &self.depth, Denoise::depth, Denoise::noisy_depth);
        image = self.coverage.iter().fold(image, |image, (share, _)| image.coverage(share.as_flattened()));
        image = self.emission.iter().fold(image, |image, (emission, _)| image.emission(emission));
        self.ids.iter().fold(image, |image, ids| image.ids(ids))
    }
}

/// Adds a feature, if present, and its variance, if known, to `image`.
fn added<'a, T>(
    image: Denoise<'a>,
    feature: &'a Feature<T>,
    plain: fn(Denoise<'a>, &'a [T]) -> Denoise<'a>,
    noisy: fn(Denoise<'a>, &'a [T], Variance<'a, T>) -> Denoise<'a>,
) -> Denoise<'a> {
    match feature {
        None => image,
        Some((mean, None)) => plain(image, mean),
        Some((mean, Some(variance))) => noisy(image, mean, Variance::OfMean(variance)),
    }
}

impl Set {
    fn buffers(&self) -> SampleBuffers<'_> {
        let samples = SampleBuffers::new(&self.mean, &self.count);
        match &self.variance {
            Some((variance, true)) => samples.variance(Variance::OfMean(variance)),
            Some((variance, false)) => samples.variance(Variance::OfSamples(variance)),
            None => samples,
        }
    }
}

/// The name of an image for messages, with its view.
fn in_view(image: &FoundLayer) -> String {
    let view = if image.view.is_empty() { String::new() } else { format!(" of view \"{}\"", image.view) };
    format!("\"{}\"{view}", image.shown())
}

/// The values of `N` planes, interleaved by pixel.
fn interleaved<const N: usize>(planes: &[Vec<f32>]) -> Vec<[f32; N]> {
    (0..planes[0].len()).map(|pixel| std::array::from_fn(|c| planes[c][pixel])).collect()
}

/// The reader of one view's layers in all files.
struct Reader<'a> {
    spec: &'a DenoiseSpec,
    inputs: &'a [Input],
    /// The view's image layer in each file.
    colors: &'a [FoundLayer],
    window: Window,
    found: Vec<(LayerKind, String)>,
    notices: Vec<String>,
}

impl Reader<'_> {
    /// Finds a layer of file `k`, by the caller's name or by known names.
    fn search(&self, k: usize, kind: LayerKind) -> Result<Option<FoundLayer>, DenoiseError> {
        let (input, color) = (&self.inputs[k], &self.colors[k]);
        let given = self.spec.layers.iter().find(|(own, _)| *own == kind);
        match given {
            _ if kind == LayerKind::Color => Ok(Some(color.clone())),
            Some((_, name)) => Ok(input.layers.in_view(&input.given(kind, name)?, &color.view)),
            None => Ok(input.layers.guide(kind, color)),
        }
    }

    /// Finds a layer as [`search`](Self::search) does, and lists it in `found`.
    fn find(&mut self, k: usize, kind: LayerKind) -> Result<Option<FoundLayer>, DenoiseError> {
        let found = self.search(k, kind)?;
        if let Some(found) = &found {
            let entry = (kind, found.shown());
            if !self.found.contains(&entry) {
                self.found.push(entry);
            }
        }
        Ok(found)
    }

    /// Crops the window to the pixels that all layers cover. Adds a notice if that removes pixels.
    fn cut(&mut self) -> Result<(), DenoiseError> {
        let inputs = self.inputs;
        let image = self.window;
        let mut cut = Vec::new();
        // The first kind is the image. Layers that only one of the files has are ignored.
        for kind in LayerKind::all() {
            let layers = (0..inputs.len()).map(|k| self.search(k, kind)).collect::<Result<Option<Vec<_>>, _>>()?;
            for (input, layer) in inputs.iter().zip(layers.iter().flatten()) {
                let window = input.window(layer);
                let apart = || DenoiseError::Windows {
                    paths: Box::new([inputs[0].path.clone(), input.path.clone()]),
                    layers: Box::new([self.colors[0].shown(), layer.shown()]),
                    windows: Box::new([image, window]),
                };
                self.window = self.window.common(window).ok_or_else(apart)?;
                let entry = format!("{} of {} {window}", layer.shown(), input.path.display());
                if window != image && !cut.contains(&entry) {
                    cut.push(entry);
                }
            }
        }
        if !cut.is_empty() {
            let first = format!("{} of {} has pixels {image}", self.colors[0].shown(), inputs[0].path.display());
            self.note(format!(
                "{first}, {}; only the common pixels are denoised, and the output is cropped to them: {}",
                cut.join(", "),
                self.window
            ));
        }
        Ok(())
    }

    /// The values of `N` channels of file `k`, interleaved by pixel.
    fn pixels<const N: usize>(&self, k: usize, layer: &FoundLayer) -> Result<Vec<[f32; N]>, DenoiseError> {
        let planes = layer.channels.iter().map(|&channel| self.inputs[k].floats(layer.part, channel, self.window));
        Ok(interleaved(&planes.collect::<Result<Vec<_>, _>>()?))
    }

    /// The image of file `k`, with its variance and sample counts.
    fn set(&mut self, k: usize) -> Result<Set, DenoiseError> {
        let input = &self.inputs[k];
        let (path, names) = (input.path.clone(), input.layers.names());
        let color = self.colors[k].clone();
        self.find(k, LayerKind::Color)?;
        let mut mean: Colours = self.pixels(k, &color)?;
        let count = self.counts(k, mean.len())?;
        let variance = self.variance(k, &mean, count.is_some())?;
        if variance.is_none() && self.inputs.len() == 1 {
            return Err(match input.layers.unusable(LayerKind::Variance) {
                Some(name) => input.wrong_channels(LayerKind::Variance, name),
                None => DenoiseError::NoVariance { path, image: in_view(&color), layers: names },
            });
        }
        let mut count = count.unwrap_or_else(|| {
            self.note(format!(
                "the files do not state the number of samples per pixel; {ASSUMED_SPP} is assumed (--spp N sets it)"
            ));
            vec![ASSUMED_SPP; mean.len()]
        });
        let mut broken = 0;
        for (mean, count) in mean.iter_mut().zip(&mut count) {
            if mean.iter().any(|v| !v.is_finite()) {
                (*mean, *count) = ([0.0; 3], 0);
                broken += 1;
            }
        }
        self.broken(&format!("{}: ", path.display()), broken, "pixels", "they are filled from their neighbours");
        Ok(Set { mean, variance, count })
    }

    /// The number of samples of each pixel in file `k`; `None` if unknown.
    fn counts(&mut self, k: usize, pixels: usize) -> Result<Option<Vec<u32>>, DenoiseError> {
        let known = self.spec.spp.or(self.inputs[k].spp(&self.colors[k]));
        let Some(layer) = self.find(k, LayerKind::Count)? else { return Ok(known.map(|spp| vec![spp; pixels])) };
        let counts: Vec<[f32; 1]> = self.pixels(k, &layer)?;
        let counts = counts.as_flattened();
        // Cycles writes fractions of the largest count.
        let most = counts.iter().copied().fold(0.0, f32::max);
        let shares = most <= 1.0 && (known.is_some() || counts.iter().any(|n| n.fract() > 0.0));
        let unit = if shares { known.unwrap_or(ASSUMED_SPP) as f32 } else { 1.0 };
        if shares && known.is_none() {
            let name = &layer.name;
            self.note(format!(
                "layer \"{name}\" holds fractions of an unknown number of samples; {ASSUMED_SPP} is assumed (--spp N sets it)"
            ));
        }
        let number = |&n: &f32| if n > 0.0 { (n * unit).round().max(1.0) as u32 } else { 0 };
        Ok(Some(counts.iter().map(number).collect()))
    }

    /// The variance in file `k`, and `true` for the variance of the mean. `counted` is `true` if the number of samples is
    /// known.
    fn variance(&mut self, k: usize, mean: &Colours, counted: bool) -> Result<Option<(Colours, bool)>, DenoiseError> {
        let input = &self.inputs[k];
        let mut kinds = [LayerKind::MeanVariance, LayerKind::Variance, LayerKind::SecondMoment];
        // Layers named by the caller come first.
        kinds.sort_by_key(|kind| !self.spec.layers.iter().any(|(given, _)| given == kind));
        let layer = kinds.iter().find_map(|&kind| self.find(k, kind).transpose()).transpose()?;
        let Some(layer) = layer else { return Ok(None) };
        let (mut variance, of_mean) = match layer.kind {
            LayerKind::SecondMoment => (self.variance_by_squares(k, &layer, mean)?, false),
            LayerKind::MeanVariance => (self.pixels(k, &layer)?, true),
            _ => (self.pixels(k, &layer)?, self.spec.variance_of_mean),
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
                // A standard deviation as large as the colour, as a rare bright sample has.
                *variance = mean.map(|v| if v.is_finite() { v * v } else { 0.0 });
                unknown += 1;
            }
        }
        self.broken(&format!("layer \"{name}\": "), unknown, "variances", "they are replaced by the squared colour");
        Ok(Some((variance, of_mean)))
    }

    /// The object ids in the first file.
    fn ids(&mut self) -> Result<Option<Vec<u32>>, DenoiseError> {
        let Some(layer) = self.find(0, LayerKind::Id)? else { return Ok(None) };
        let own = self.inputs[0].window(&layer);
        Ok(Some(match &self.inputs[0].file.planes(layer.part)?[layer.channels[0]] {
            Plane::U32(ids) => own.cut(ids, self.window),
            // Cryptomatte and others store ids as floats; equal bits mean equal ids.
            ids => own.cut(&ids.floats(), self.window).iter().map(|id| id.to_bits()).collect(),
        }))
    }

    /// Adds a notice about `count` NaN or infinite values and their replacement, unless `count` is 0.
    fn broken(&mut self, place: &str, count: usize, what: &str, instead: &str) {
        if count > 0 {
            self.note(format!("{place}NaN or infinite {what}: {count}; {instead}"));
        }
    }

    fn missing(&mut self, kinds: &[(LayerKind, bool)]) {
        let names: Vec<&str> = kinds.iter().filter(|(_, known)| !known).map(|(kind, _)| kind.name()).collect();
        if !names.is_empty() {
            let hint = "choose a layer with --layer KIND=NAME to improve the result";
            self.note(format!("no layer was found for {}; {hint}", names.join(" or ")));
        }
    }

    fn note(&mut self, notice: String) {
        if !self.notices.contains(&notice) {
            self.notices.push(notice);
        }
    }
}

impl Reader<'_> {
    /// Sample variances from second moments. For moments of X, Y and Z, all channels get the relative variance of Y.
    fn variance_by_squares(&self, k: usize, second: &FoundLayer, mean: &Colours) -> Result<Colours, DenoiseError> {
        let layers = &self.inputs[k].layers;
        let squares: Colours = self.pixels(k, second)?;
        if !layers.is_xyz(second) {
            let variance = |(m2, m): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (m2[c] - m[c] * m[c]).max(0.0));
            return Ok(squares.iter().zip(mean).map(variance).collect());
        }
        let first = layers.first_moment(second).map(|first| self.pixels(k, &first)).transpose()?;
        let first = first.unwrap_or_else(|| mean.clone());
        let variance = |((m2, m), rgb): ((&[f32; 3], &[f32; 3]), &[f32; 3])| {
            let relative = if m[1] > 0.0 { (m2[1] / (m[1] * m[1]) - 1.0).max(0.0) } else { 0.0 };
            rgb.map(|v| relative * v * v)
        };
        Ok(squares.iter().zip(&first).zip(mean).map(variance).collect())
    }

    /// The variance of the mean of each channel of a layer; `None` if file `k` lacks the layer's second moments.
    ///
    /// Differences within rounding error count as 0, since second moments of distant positions are large numbers.
    fn variances(&self, k: usize, layer: &FoundLayer, counts: &[u32]) -> Result<Option<Vec<Vec<f32>>>, DenoiseError> {
        let input = &self.inputs[k];
        let Some(squares) = input.layers.second_moment(layer) else { return Ok(None) };
        let planes = layer.channels.iter().zip(&squares.channels).map(|(&first, &second)| {
            let is_half = matches!(input.file.planes(squares.part)?[second], Plane::F16(_));
            let rounding = if is_half { 2e-3 } else { 5e-7 };
            let means = input.floats(layer.part, first, self.window)?;
            let values = means.into_iter().zip(input.floats(squares.part, second, self.window)?).zip(counts);
            let variance = values.map(|((mean, square), &count)| {
                let variance = (square - mean * mean - rounding * square) / count.saturating_sub(1).max(1) as f32;
                if variance.is_finite() { variance.max(0.0) } else { 0.0 }
            });
            Ok(variance.collect())
        });
        planes.collect::<Result<_, DenoiseError>>().map(Some)
    }
}

/// The mean of a feature, and the variance of that mean if it is known: from two files, or from second moments.
type Mean<T> = (Vec<T>, Option<Vec<T>>);
/// The mean of a feature over the files; `None` if they lack the feature.
type Feature<T> = Option<Mean<T>>;

/// The factor on variances that are estimated from the difference of two files. One squared difference usually underestimates
/// the variance: its median is 0.45 of its mean. The factor lowers the error on Mitsuba's images by 5 % and does not change the
/// error on the bundled scenes.
const TWO_FILES: f32 = 2.0;

impl Reader<'_> {
    /// Reads a feature of `N` channels. `counts` holds the samples per pixel of each file.
    fn feature<const N: usize>(
        &mut self,
        kind: LayerKind,
        counts: &[&[u32]],
    ) -> Result<Feature<[f32; N]>, DenoiseError> {
        let Some(layers) = self.in_all(kind)? else { return Ok(None) };
        let mean_of = |(k, (layer, counts)): (usize, (&FoundLayer, &&[u32]))| -> Result<Mean<[f32; N]>, DenoiseError> {
            let variance = self.variances(k, layer, counts)?.map(|planes| interleaved(&planes));
            Ok((self.pixels(k, layer)?, variance))
        };
        let each = layers.iter().zip(counts).enumerate().map(mean_of);
        let mut each: Vec<Mean<[f32; N]>> = each.collect::<Result<_, _>>()?;
        if let ([a, b], 1) = (&mut each[..], N) {
            // Where only one file has a hit, its depth is used for both.
            for (a, b) in a.0.as_flattened_mut().iter_mut().zip(b.0.as_flattened_mut()) {
                match (a.is_infinite(), b.is_infinite()) {
                    (true, false) => *a = *b,
                    (false, true) => *b = *a,
                    _ => {}
                }
            }
        }
        // An infinite depth means that no surface was hit.
        let is_wrong = |v: &f32| v.is_nan() || (kind != LayerKind::Depth && v.is_infinite());
        let mut broken = 0;
        for value in each.iter_mut().flat_map(|(mean, _)| mean).filter(|value| value.iter().any(is_wrong)) {
            *value = [0.0; N];
            broken += 1;
        }
        self.broken("", broken, &format!("values of the {}", kind.name()), "they are replaced by 0");
        if kind == LayerKind::Coverage {
            let shares = each.iter_mut().flat_map(|(mean, _)| mean.as_flattened_mut());
            shares.for_each(|share| *share = share.clamp(0.0, 1.0));
        }
        Ok(Some(averaged(each)))
    }

    /// The layer of this kind in each file; `None` unless all files have one.
    fn in_all(&mut self, kind: LayerKind) -> Result<Option<Vec<FoundLayer>>, DenoiseError> {
        let layers = (0..self.inputs.len()).map(|k| self.find(k, kind)).collect::<Result<Option<Vec<_>>, _>>()?;
        if layers.is_none() {
            self.found.retain(|(found, _)| *found != kind);
        }
        Ok(layers)
    }
}

/// Averages a feature over one or two files. The variance of the mean comes from second moments if the files have them, else
/// from the difference of the two files.
fn averaged<const N: usize>(mut each: Vec<Mean<[f32; N]>>) -> Mean<[f32; N]> {
    let (Some(b), a) = (each.pop(), each.pop()) else { return (Vec::new(), None) };
    let Some(a) = a else { return b };
    let of = |a: &[[f32; N]], b: &[[f32; N]], f: fn(f32, f32) -> f32| -> Vec<[f32; N]> {
        a.iter().zip(b).map(|(a, b)| std::array::from_fn(|c| f(a[c], b[c]))).collect()
    };
    let mean = of(&a.0, &b.0, |a, b| 0.5 * (a + b));
    let variance = match (&a.1, &b.1) {
        (Some(a), Some(b)) => of(a, b, |a, b| 0.25 * (a + b)),
        _ => of(&a.0, &b.0, |a, b| {
            let apart = a - b;
            if apart.is_finite() { TWO_FILES * 0.25 * apart * apart } else { 0.0 }
        }),
    };
    (mean, Some(variance))
}
