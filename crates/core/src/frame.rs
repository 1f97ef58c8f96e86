//! The size of an image and its rendered window.

use crate::Error;
use serde::{Deserialize, Serialize};

/// An image's full resolution and its rendered window.
///
/// Pixels keep their coordinates in the full image, so a crop is bit-identical to that region of the full image.
///
/// ```
/// use dapple_core::Frame;
///
/// let window = Frame::new(1920, 1080)?.crop(960, 540, 1024, 604)?;
/// assert_eq!((window.size(), window.pixels()), ([64, 64], 4096));
/// assert_eq!(window.pixel(65), [961, 541]);
/// # Ok::<(), dapple_core::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "[[u32; 2]; 3]", into = "[[u32; 2]; 3]")]
pub struct Frame {
    resolution: [u32; 2],
    origin: [u32; 2],
    size: [u32; 2],
}

impl Frame {
    /// Makes the frame of a whole image of `width` x `height` pixels.
    ///
    /// # Errors
    ///
    /// [`Error::EmptyFrame`] if a side is 0, [`Error::FrameTooLarge`] for more than 2^32 - 1 pixels.
    pub fn new(width: u32, height: u32) -> Result<Self, Error> {
        if width == 0 || height == 0 {
            return Err(Error::EmptyFrame { resolution: [width, height] });
        }
        if u64::from(width) * u64::from(height) > u64::from(u32::MAX) {
            return Err(Error::FrameTooLarge { resolution: [width, height] });
        }
        Ok(Self { resolution: [width, height], origin: [0, 0], size: [width, height] })
    }

    /// Makes the frame of the window `x0 .. x1` x `y0 .. y1`, in pixels of the full image.
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] if the window is empty or reaches outside the full image.
    pub fn crop(self, x0: u32, y0: u32, x1: u32, y1: u32) -> Result<Self, Error> {
        if x0 >= x1 || y0 >= y1 || x1 > self.resolution[0] || y1 > self.resolution[1] {
            return Err(Error::BadCrop { crop: [x0, y0, x1, y1], resolution: self.resolution });
        }
        Ok(Self { origin: [x0, y0], size: [x1 - x0, y1 - y0], ..self })
    }

    /// Makes the frame of the window's rows `rows`, counted from the top of the window.
    ///
    /// # Errors
    ///
    /// [`Error::BadCrop`] if `rows` is empty or reaches outside the window.
    pub fn rows(self, rows: std::ops::Range<u32>) -> Result<Self, Error> {
        let ([x, y], [width, height]) = (self.origin, self.size);
        let [first, end] = [rows.start, rows.end].map(|row| y.saturating_add(row));
        if rows.end > height {
            return Err(Error::BadCrop { crop: [x, first, x + width, end], resolution: self.resolution });
        }
        self.crop(x, first, x + width, end)
    }

    /// Width and height of the full image.
    pub const fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// Column and row of the window's first pixel in the full image.
    pub const fn origin(&self) -> [u32; 2] {
        self.origin
    }

    /// Width and height of the window.
    pub const fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The number of pixels in the window.
    pub const fn pixels(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// The bytes of a plane with `per_pixel` bytes for each pixel of the window, at most `u64::MAX`.
    pub const fn bytes(&self, per_pixel: usize) -> u64 {
        (self.size[0] as u64 * self.size[1] as u64).saturating_mul(per_pixel as u64)
    }

    /// Column and row, in the full image, of pixel `i` of the window. Pixels are numbered row by row.
    pub const fn pixel(&self, i: usize) -> [u32; 2] {
        let w = self.size[0] as usize;
        [self.origin[0] + (i % w) as u32, self.origin[1] + (i / w) as u32]
    }
}

impl From<Frame> for [[u32; 2]; 3] {
    fn from(frame: Frame) -> Self {
        [frame.resolution, frame.origin, frame.size]
    }
}

impl TryFrom<[[u32; 2]; 3]> for Frame {
    type Error = Error;

    /// Makes a frame from resolution, origin and size.
    fn try_from([[width, height], [x, y], [columns, rows]]: [[u32; 2]; 3]) -> Result<Self, Error> {
        Self::new(width, height)?.crop(x, y, x.saturating_add(columns), y.saturating_add(rows))
    }
}
