//! Pictures and picture files.

/// A picture in memory: linear RGB, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width and height.
    pub size: [u32; 2],
    /// `size[0] * size[1]` pixels.
    pub pixels: Vec<[f32; 3]>,
}
