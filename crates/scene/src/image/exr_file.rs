//! OpenEXR files: their parts, the planes of their channels, and the image that they show.

use super::layers::{FoundLayer, Layers, NoImage, Purpose};
use super::openexr::{Fault, Plane, check_size, floats, read_lines, read_planes, with_reader};
use super::read::{ALPHA_BYTES, File, ImageFile, LayerQuery, OPENEXR, PIXEL_BYTES};
use super::{Chromaticities, Encoding, Image, ImageError, Window};
use ::exr::error::Error as ExrError;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{AttributeValue, Compression, LevelMode, SampleType, Text};
use ::exr::meta::header::Header;
use std::borrow::Cow;
use std::cell::OnceCell;

/// A channel of an OpenEXR file: its name and the type of its values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrChannel {
    /// The name in the file, such as `albedo.R`.
    pub name: String,
    /// The type of the values: `half`, `float` or `uint`.
    pub values: &'static str,
}

/// The header of one part of an OpenEXR file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrPart {
    /// The name of the part; may be empty in a file of one part.
    pub name: String,
    /// The view that all channels belong to, if the part states one.
    pub view: Option<String>,
    /// The views that the header lists, the default one first; empty without a list.
    pub views: Vec<String>,
    /// The data window: the pixels stored in the part.
    pub data_window: Window,
    /// The display window: the pixels shown on a display.
    pub display_window: Window,
    /// Width of a pixel divided by its height.
    pub pixel_aspect: f32,
    /// The colour space, if the header names one; else it is Rec. 709.
    pub chromaticities: Option<Chromaticities>,
    /// The compression of the values, such as `zip block`.
    pub compression: String,
    /// The width and height of tiles in pixels; `None` for scan lines.
    pub tiles: Option<[usize; 2]>,
    /// True if the part also holds smaller versions of its image (mip or rip maps).
    pub levels: bool,
    /// All channels, sorted by name.
    pub channels: Vec<ExrChannel>,
}

impl ExrPart {
    fn of(header: &Header) -> Self {
        let (own, shared) = (&header.own_attributes, &header.shared_attributes);
        let texts = |texts: &[Text]| texts.iter().map(Text::to_string).collect();
        let channel = |channel: &::exr::meta::attribute::ChannelDescription| ExrChannel {
            name: channel.name.to_string(),
            values: match channel.sample_type {
                SampleType::F16 => "half",
                SampleType::F32 => "float",
                SampleType::U32 => "uint",
            },
        };
        let compression = header.compression.to_string();
        let tiles = match header.blocks {
            BlockDescription::Tiles(tiles) => Some(tiles),
            BlockDescription::ScanLines => None,
        };
        Self {
            name: own.layer_name.as_ref().map_or_else(String::new, Text::to_string),
            view: own.view_name.as_ref().map(Text::to_string),
            views: own.multi_view_names.as_ref().map_or_else(Vec::new, |names| texts(names)),
            data_window: window(own.layer_position, header.layer_size),
            display_window: window(shared.display_window.position, shared.display_window.size),
            pixel_aspect: shared.pixel_aspect,
            chromaticities: shared.chromaticities.map(|c| Chromaticities {
                red: [c.red.0, c.red.1],
                green: [c.green.0, c.green.1],
                blue: [c.blue.0, c.blue.1],
                white: [c.white.0, c.white.1],
            }),
            compression: compression.strip_suffix(" compression").unwrap_or(&compression).to_owned(),
            tiles: tiles.map(|tiles| [tiles.tile_size.0, tiles.tile_size.1]),
            levels: tiles.is_some_and(|tiles| tiles.level_mode != LevelMode::Singular),
            channels: header.channels.list.iter().map(channel).collect(),
        }
    }

    /// Returns the colour space of the part.
    pub fn color_space(&self) -> Chromaticities {
        self.chromaticities.unwrap_or(Chromaticities::REC709)
    }
}

fn window(origin: ::exr::math::Vec2<i32>, size: ::exr::math::Vec2<usize>) -> Window {
    Window { origin: [origin.0, origin.1], size: [size.0 as u32, size.1 as u32] }
}

/// An OpenEXR file, whose channels are decoded at their first use.
#[derive(Clone, Debug)]
pub struct ExrFile<'a> {
    bytes: Cow<'a, [u8]>,
    name: String,
    pub(super) headers: Vec<Header>,
    /// The headers of all parts.
    pub parts: Vec<ExrPart>,
    planes: Vec<OnceCell<Vec<Plane<'static>>>>,
}

impl<'a> ExrFile<'a> {
    /// Reads the headers of a file. `name` appears in messages.
    ///
    /// # Errors
    /// The errors of [`read_image`](super::read_image) for a faulty header. [`ImageError::Unsupported`] for deep data or a
    /// channel of lower resolution.
    pub fn open(bytes: impl Into<Cow<'a, [u8]>>, name: &str) -> Result<Self, ImageError> {
        let bytes = bytes.into();
        let file = File { bytes: &bytes, name, format: OPENEXR };
        let headers = with_reader(&file, |open| Ok(open()?.headers().to_vec()))?;
        let parts: Vec<ExrPart> = headers.iter().map(ExrPart::of).collect();
        let planes = headers.iter().map(|_| OnceCell::new()).collect();
        Ok(Self { bytes, name: name.to_owned(), headers, parts, planes })
    }

    pub(super) fn file(&self) -> File<'_> {
        File { bytes: &self.bytes, name: &self.name, format: OPENEXR }
    }

    /// Returns the values of all channels of a part, in full precision and in the order of [`ExrPart::channels`].
    ///
    /// # Errors
    /// The errors of [`read_image`](super::read_image). Its memory limit applies to the channels of all parts together.
    ///
    /// # Panics
    /// If the file has no part of this index.
    pub fn planes(&self, part: usize) -> Result<&[Plane<'static>], ImageError> {
        if let Some(planes) = self.planes[part].get() {
            return Ok(planes);
        }
        let file = self.file();
        let count: usize = self.headers.iter().map(|header| header.channels.list.len()).sum();
        let planes = with_reader(&file, |open| {
            check_size(&file, &self.headers[part], 4 * count as u64)?;
            read_planes(&file, open()?, part)
        })?;
        Ok(self.planes[part].get_or_init(|| planes))
    }

    /// Frees the memory of decoded channels, which are decoded again at their next use.
    pub fn release(&mut self) {
        self.planes.iter_mut().for_each(|planes| drop(planes.take()));
    }

    /// Returns true if the channels of the layer `image` are 0 in every pixel.
    ///
    /// # Errors
    /// Those of [`read_image`](super::read_image).
    pub fn is_zero(&self, image: &FoundLayer) -> Result<bool, ImageError> {
        let file = self.file();
        let header = &self.headers[image.part];
        with_reader(&file, |open| {
            // The first value other than 0 ends the search.
            let found = read_lines(&file, open()?, image.part, |line, _| {
                let mut zero = true;
                if image.channels.contains(&line.location.channel) {
                    floats(header, line, |_, value| zero &= value == 0.0)?;
                }
                if zero { Ok(()) } else { Err(ExrError::Aborted) }
            });
            match found {
                Ok(()) => Ok(true),
                Err(Fault::Decoder(ExrError::Aborted)) => Ok(false),
                Err(fault) => Err(fault),
            }
        })
    }

    /// Returns the attributes of a part for which `pick` returns a value, sorted by name.
    fn attributes<T: Ord>(&self, part: usize, pick: impl Fn(AttributeValue) -> Option<T>) -> Vec<(String, T)> {
        let name = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
        let named = self.headers[part].all_named_attributes();
        let mut found: Vec<_> = named.filter_map(|(key, value)| Some((name(key), pick(value)?))).collect();
        found.sort();
        found
    }

    /// Returns the text attributes (name, value) of a part, sorted by name.
    pub fn texts(&self, part: usize) -> Vec<(String, String)> {
        self.attributes(part, |value| match value {
            AttributeValue::Text(value) => Some(String::from_utf8_lossy(value.as_slice()).into_owned()),
            _ => None,
        })
    }

    /// Returns the integer attributes (name, value) of a part, sorted by name.
    pub fn integers(&self, part: usize) -> Vec<(String, i32)> {
        self.attributes(part, |value| match value {
            AttributeValue::I32(value) => Some(value),
            _ => None,
        })
    }

    pub(super) fn compression(&self, part: usize) -> Compression {
        self.headers[part].compression
    }
}

/// All channels of an OpenEXR file, read by [`read_channels`].
#[derive(Clone, Debug, PartialEq)]
pub struct Channels {
    /// Width and height of every channel, in pixels.
    pub size: [u32; 2],
    /// Full name (`R`, `albedo.R`) and values of each channel. Parts are in the file's order; the channels of a part
    /// are sorted by name.
    pub channels: Vec<(String, Plane<'static>)>,
}

impl Channels {
    /// Returns the values of the channel with this full name; `None` for an unknown name.
    pub fn plane(&self, name: &str) -> Option<&Plane<'static>> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, plane)| plane)
    }
}

/// Reads all channels of an OpenEXR file in full precision. In a file of several parts, the full name of a channel is
/// `PART.CHANNEL`.
///
/// # Errors
/// Those of [`read_image`](super::read_image), and [`ImageError::Unsupported`] if the parts differ in size.
pub fn read_channels(bytes: &[u8], file_name: &str) -> Result<Channels, ImageError> {
    let file = ExrFile::open(bytes, file_name)?;
    let size = file.parts[0].data_window.size;
    if file.parts.iter().any(|part| part.data_window.size != size) {
        return Err(file.file().unsupported("a set of parts of different sizes", "one file per part"));
    }
    let several = file.parts.len() > 1;
    (0..file.parts.len()).try_for_each(|part| file.planes(part).map(drop))?;
    let planes = file.planes.into_iter().map(|planes| planes.into_inner().unwrap_or_default());
    let channels = file.parts.iter().zip(planes).flat_map(|(part, planes)| {
        let name = |name: &String| if several { format!("{}.{name}", part.name) } else { name.clone() };
        let names: Vec<String> = part.channels.iter().map(|channel| name(&channel.name)).collect();
        names.into_iter().zip(planes)
    });
    Ok(Channels { size, channels: channels.collect() })
}

/// Reads the text attributes (name, value) in the header of an OpenEXR file's first part.
///
/// # Errors
/// The errors of [`read_image`](super::read_image) for a faulty header.
pub fn read_attributes(bytes: &[u8], file_name: &str) -> Result<Vec<(String, String)>, ImageError> {
    Ok(ExrFile::open(bytes, file_name)?.texts(0))
}

/// The channels to read as the image, by index within their part of the file.
struct MainChannels {
    part: usize,
    view: String,
    /// Indices of red, green and blue (`None` is 0 everywhere); three equal indices for a gray image.
    colors: [Option<usize>; 3],
    alpha: Option<usize>,
}

/// Reads the image of a file in the layer `wanted`.
pub(super) fn read(file: &File<'_>, wanted: LayerQuery<'_>, encoding: Encoding) -> Result<ImageFile, ImageError> {
    let exr = ExrFile::open(file.bytes, file.name)?;
    let (main, mut notices) = main_channels(&exr, wanted)?;
    let part = &exr.parts[main.part];
    let (header, window) = (&exr.headers[main.part], part.data_window);
    let alpha_bytes = if main.alpha.is_some() { ALPHA_BYTES } else { 0 };
    let (mut pixels, alpha) = with_reader(file, |open| {
        let reader = open()?;
        check_size(file, header, PIXEL_BYTES + alpha_bytes)?;
        let mut pixels = vec![[0.0; 3]; window.pixels()];
        let mut alpha = vec![0.0; if main.alpha.is_some() { window.pixels() } else { 0 }];
        read_lines(file, reader, main.part, |line, start| {
            let channel = line.location.channel;
            for (slot, _) in main.colors.iter().enumerate().filter(|(_, c)| **c == Some(channel)) {
                floats(header, line, |i, value| pixels[start + i][slot] = value)?;
            }
            if main.alpha == Some(channel) {
                floats(header, line, |i, value| alpha[start + i] = value)?;
            }
            Ok(())
        })?;
        Ok::<_, Fault>((pixels, alpha))
    })?;
    let space = part.color_space();
    let mut converted = false;
    if encoding != Encoding::Linear && !space.is_same(Chromaticities::REC709) {
        converted = space.convert_to_rec709(&mut pixels);
        if !converted {
            notices.push(space.unfit());
        }
    }
    let image = Image::new(window.size, pixels)?;
    let image = if main.alpha.is_some() { image.with_alpha(alpha)? } else { image };
    Ok(ImageFile { image, view: main.view, window: Some([window, part.display_window]), notices, converted })
}

fn main_channels(exr: &ExrFile<'_>, wanted: LayerQuery<'_>) -> Result<(MainChannels, Vec<String>), ImageError> {
    let layers = Layers::of(&exr.parts);
    let main = |layer: &FoundLayer| MainChannels {
        part: layer.part,
        view: layer.view.clone(),
        colors: [0, 1, 2].map(|c| layer.channels.get(c).copied()),
        alpha: layers.alpha(layer),
    };
    let in_view = |layer: FoundLayer| wanted.view.and_then(|view| layers.in_view(&layer, view)).unwrap_or(layer);
    if let Some(name) = wanted.layer {
        let layer = layers.given(super::LayerKind::Color, name);
        return layer.map(|layer| (main(&in_view(layer)), Vec::new())).ok_or_else(|| no_layer(exr, &layers, name));
    }
    // Luminance and chroma without a layer are an error, even if another layer is readable.
    let has = |name: &str| exr.parts.iter().any(|part| part.channels.iter().any(|channel| channel.name == name));
    if has("Y") && (has("RY") || has("BY")) && !has("R") {
        return Err(exr.file().unsupported("luminance and chroma", "RGB"));
    }
    match layers.image(Purpose::Showing, |layer| exr.is_zero(layer))? {
        Ok(chosen) => {
            let shown = chosen.layer.shown();
            let notice =
                |empty: &String| format!("layer \"{empty}\" is 0 everywhere; layer \"{shown}\" is read instead");
            let mut notices: Vec<String> = chosen.empty.iter().map(notice).collect();
            let layer = in_view(chosen.layer);
            let views = layers.in_all_views(&layer).0;
            if let [view, others @ ..] = &views[..]
                && !others.is_empty()
            {
                let others: Vec<&str> = others.iter().map(|other| other.view.as_str()).collect();
                notices.push(format!("view \"{}\" is read; not read: view \"{}\"", view.view, others.join("\", \"")));
            }
            Ok((main(&layer), notices))
        }
        Err(NoImage::Ambiguous(names)) => Err(ImageError::Ambiguous { file: exr.name.clone(), layers: names }),
        Err(NoImage::Missing) => partial(exr).map(|main| (main, Vec::new())),
    }
}

fn no_layer(exr: &ExrFile<'_>, layers: &Layers, name: &str) -> ImageError {
    let layers = layers.names().join(", ");
    ImageError::Unsupported(format!("{}: no layer \"{name}\" holds an image; choose among {layers}", exr.name))
}

/// The file's only channel as a gray image, or those of R, G and B that exist.
fn partial(exr: &ExrFile<'_>) -> Result<MainChannels, ImageError> {
    let view = |part: usize| exr.parts[part].view.clone().unwrap_or_default();
    if let [ExrPart { channels, .. }] = &exr.parts[..]
        && channels.len() == 1
    {
        return Ok(MainChannels { part: 0, view: view(0), colors: [Some(0); 3], alpha: None });
    }
    for (part, ExrPart { channels, .. }) in exr.parts.iter().enumerate() {
        let find = |letter: &str| channels.iter().position(|channel| channel.name.eq_ignore_ascii_case(letter));
        let colors = ["R", "G", "B"].map(find);
        if colors.iter().any(Option::is_some) {
            return Ok(MainChannels { part, view: view(part), colors, alpha: find("A") });
        }
    }
    let names = exr.parts.iter().flat_map(|part| part.channels.iter().map(|channel| channel.name.as_str()));
    let names: Vec<&str> = names.collect();
    let what = format!("an image without R, G and B or Y (its channels are {})", names.join(", "));
    Err(exr.file().unsupported(&what, "RGB"))
}
