//! OpenEXR files of any parts, windows, views and colour spaces, for tests.

use ::exr::prelude as exr;
use dapple_scene::image::{Chromaticities, Window};

/// ACEScg (AP1).
pub(crate) const ACES: Chromaticities =
    Chromaticities { red: [0.713, 0.293], green: [0.165, 0.83], blue: [0.128, 0.044], white: [0.321_68, 0.337_67] };

/// A key code of film, seven numbers.
pub(crate) const KEY_CODE: [i32; 7] = [1, 2, 345_678, 1234, 40, 4, 64];

/// One part: its name (empty for none), view, window, and channels with their values.
#[derive(Clone)]
pub(crate) struct MadePart {
    pub(crate) name: String,
    pub(crate) view: Option<String>,
    pub(crate) window: Window,
    pub(crate) channels: Vec<(String, Vec<f32>)>,
}

/// A file to be made.
#[derive(Clone)]
pub(crate) struct Made {
    pub(crate) parts: Vec<MadePart>,
    pub(crate) display: Window,
    pub(crate) aspect: f32,
    pub(crate) views: Vec<String>,
    pub(crate) space: Option<Chromaticities>,
    pub(crate) half: bool,
    pub(crate) encoding: exr::Encoding,
}

impl Made {
    /// A file of these parts, displayed as the first part's window.
    pub(crate) fn of(parts: Vec<MadePart>) -> Self {
        let encoding = exr::Encoding {
            compression: exr::Compression::ZIP16,
            blocks: exr::Blocks::ScanLines,
            line_order: exr::LineOrder::Increasing,
        };
        let display = parts[0].window;
        Self { parts, display, aspect: 1.0, views: Vec::new(), space: None, half: false, encoding }
    }

    /// A part with these channels; `of` gives the value of a channel at a column and a row of the display.
    pub(crate) fn part(name: &str, window: Window, channels: &[&str], of: impl Fn(&str, i32, i32) -> f32) -> MadePart {
        let ([x0, y0], [w, h]) = (window.origin, window.size.map(|side| side as i32));
        let plane = |name: &str| {
            (y0..y0 + h).flat_map(|y| (x0..x0 + w).map(move |x| (x, y))).map(|(x, y)| of(name, x, y)).collect()
        };
        let channels = channels.iter().map(|name| ((*name).to_owned(), plane(name))).collect();
        MadePart { name: name.into(), view: None, window, channels }
    }

    /// The bytes of the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let text = |text: &String| exr::Text::from(text.as_str());
        let mut attributes = exr::ImageAttributes::new(exr::IntegerBounds {
            position: exr::Vec2(self.display.origin[0], self.display.origin[1]),
            size: exr::Vec2(self.display.size[0] as usize, self.display.size[1] as usize),
        });
        attributes.pixel_aspect = self.aspect;
        let point = |[x, y]: [f32; 2]| exr::Vec2(x, y);
        attributes.chromaticities = self.space.map(|space| ::exr::meta::attribute::Chromaticities {
            red: point(space.red),
            green: point(space.green),
            blue: point(space.blue),
            white: point(space.white),
        });
        let layers = self.parts.iter().map(|part| {
            let views: Vec<exr::Text> = self.views.iter().map(text).collect();
            let own = exr::LayerAttributes {
                layer_name: Some(&part.name).filter(|name| !name.is_empty()).map(text),
                view_name: part.view.as_ref().map(text),
                layer_position: exr::Vec2(part.window.origin[0], part.window.origin[1]),
                multi_view_names: Some(views).filter(|views| !views.is_empty()),
                owner: Some(exr::Text::from("somebody")),
                other: [
                    (exr::Text::from("shot"), exr::AttributeValue::I32(7)),
                    (
                        exr::Text::from("keyName"),
                        exr::AttributeValue::Custom {
                            kind: exr::Text::from("keycode"),
                            bytes: KEY_CODE.into_iter().flat_map(i32::to_le_bytes).collect(),
                        },
                    ),
                ]
                .into(),
                ..exr::LayerAttributes::default()
            };
            let channels = part.channels.iter().map(|(name, values)| {
                let samples = match self.half {
                    true => exr::FlatSamples::F16(values.iter().map(|v| exr::f16::from_f32(*v)).collect()),
                    false => exr::FlatSamples::F32(values.clone()),
                };
                exr::AnyChannel::new(name.as_str(), samples)
            });
            let size = (part.window.size[0] as usize, part.window.size[1] as usize);
            exr::Layer::new(size, own, self.encoding, exr::AnyChannels::sort(channels.collect()))
        });
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = exr::Image::from_layers(attributes, layers.collect::<exr::SmallVec<[_; 2]>>());
        exr::WritableImage::write(&image).non_parallel().to_buffered(&mut bytes).expect("encoded");
        // `exr` writes six of the seven numbers under the standard name.
        let mut bytes = bytes.into_inner();
        while let Some(at) = bytes.windows(8).position(|name| name == b"keyName\0") {
            bytes[at..at + 7].copy_from_slice(b"keyCode");
        }
        bytes
    }
}
