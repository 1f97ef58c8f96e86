//! The camera and its film.

use super::{MediumId, Source};
use glam::DAffine3;

/// A camera: pose, projection, lens and shutter.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The transform from camera space (x right, y up, z forward, as in pbrt) to world space. It may include a reflection.
    pub to_world: DAffine3,
    /// The camera-to-world transform at the end of the motion (see [`Scene::motion_times`](super::Scene::motion_times));
    /// `None` if the camera does not move.
    pub moves_to: Option<DAffine3>,
    /// The projection: perspective or orthographic.
    pub projection: Projection,
    /// Aspect ratio (width / height) of the view, unless `screen_window` is given; `None` takes it from the resolution.
    pub aspect: Option<f64>,
    /// The part of the screen plane in the image: x0, x1, y0, y1; -1 to 1 spans a perspective's `fov`. `None` uses `aspect`.
    pub screen_window: Option<[f64; 4]>,
    /// Radius of the lens in units of camera space, as in pbrt-v4; 0 is a pinhole.
    pub lens_radius: f64,
    /// Distance of the focal plane from the camera, in units of camera space.
    pub focal_distance: f64,
    /// The times at which the shutter opens and closes, in the unit of [`Scene::motion_times`](super::Scene::motion_times).
    pub shutter: [f64; 2],
    /// The medium around the camera; `None` is vacuum.
    pub medium: Option<MediumId>,
    /// File and line of the camera, for messages.
    pub source: Source,
}

/// The projection of a camera: perspective or orthographic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// A perspective projection: all rays of a pinhole camera start at one point.
    Perspective {
        /// Full angle of view along the shorter side of the image, in degrees.
        fov: f64,
    },
    /// An orthographic projection: parallel rays. The screen window is in units of camera space.
    Orthographic,
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            to_world: DAffine3::IDENTITY,
            moves_to: None,
            projection: Projection::Perspective { fov: 90.0 },
            aspect: None,
            screen_window: None,
            lens_radius: 0.0,
            focal_distance: 1e6,
            shutter: [0.0, 1.0],
            medium: None,
            source: Source::default(),
        }
    }
}

/// The film: resolution, crop window and pixel filter.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmSettings {
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Crop window in pixels: x0, y0, x1, y1, where x1 and y1 are exclusive; `None` for the whole image.
    pub crop: Option<[u32; 4]>,
    /// The pixel filter. It is importance-sampled, so that each sample belongs to one pixel.
    pub pixel_filter: PixelFilter,
    /// The file name that the scene suggests for its image, if any.
    pub file_name: Option<String>,
    /// The number of samples per pixel that the scene suggests, if any.
    pub spp: Option<u32>,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { resolution: [1280, 720], crop: None, pixel_filter: PixelFilter::default(), file_name: None, spp: None }
    }
}

/// A pixel filter, with radii in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PixelFilter {
    /// A box filter: constant within the radii.
    Box {
        /// Half width and half height of the filter, in pixels.
        radius: [f64; 2],
    },
    /// A triangle filter: a tent that falls linearly to 0 at the radii.
    Triangle {
        /// Half width and half height of the filter, in pixels.
        radius: [f64; 2],
    },
    /// A Gaussian filter: a Gaussian minus its value at the radius, so that it is 0 there.
    Gaussian {
        /// Half width and half height of the filter, in pixels.
        radius: [f64; 2],
        /// Standard deviation of the Gaussian, in pixels.
        sigma: f64,
    },
}

impl Default for PixelFilter {
    fn default() -> Self {
        Self::Box { radius: [0.5, 0.5] }
    }
}
