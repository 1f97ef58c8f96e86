//! The planes of a film, each declared once. Allocation, cutting, checkpoints and bytes per pixel follow from the declaration.

use super::FeatureMoments;
use crate::{FirstHit, Frame, Needs};
use serde::{Deserialize, Serialize};

/// The settings that determine a film's planes, and the number of values per pixel in each plane.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    pub(crate) needs: Needs,
    /// The number of recorders.
    pub(crate) recorders: usize,
}

/// Declares a set of planes: the name, type, first value and number of values per pixel of each.
macro_rules! planes {
    ($(#[$about:meta])* $Planes:ident, $Rows:ident($layout:ident) {
        $($(#[$doc:meta])* $plane:ident: $Value:ty = $empty:expr, $each:expr;)*
    }) => {
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub(crate) struct $Planes {
            $($(#[$doc])* pub(crate) $plane: Vec<$Value>,)*
        }

        /// The same planes for a range of pixels, written by one task.
        #[derive(Default)]
        pub(crate) struct $Rows<'a> {
            $(pub(crate) $plane: &'a mut [$Value],)*
        }

        impl $Planes {
            /// Planes of pixels without samples.
            pub(crate) fn new(pixels: usize, $layout: &Layout) -> Self {
                Self { $($plane: vec![$empty; pixels * $each as usize],)* }
            }

            /// The bytes per pixel of all planes.
            pub(crate) fn bytes_per_pixel($layout: &Layout) -> usize {
                0 $(+ size_of::<$Value>() * $each as usize)*
            }

            /// Returns `true` if each plane has as many values as the pixels need, and no value is NaN or infinite.
            pub(crate) fn is_sound(&self, pixels: usize, $layout: &Layout) -> bool {
                true $(&& self.$plane.len() == pixels * $each as usize && self.$plane.iter().all(Sound::is_sound))*
            }

            /// The part of the planes inside a window.
            pub(crate) fn cut(&self, window: &Window) -> Self {
                Self { $($plane: window.cut(&self.$plane),)* }
            }

            /// Writes a part back.
            pub(crate) fn paste(&mut self, window: &Window, part: Self) {
                $(window.paste(&mut self.$plane, part.$plane);)*
            }

            #[allow(dead_code, reason = "kept and discarded samples alone change places")]
            /// Swaps the values of the marked pixels with those in `other`.
            pub(crate) fn exchange(&mut self, other: &mut Self, marked: &[bool]) {
                $(exchange(&mut self.$plane, &mut other.$plane, marked);)*
            }

            pub(crate) fn rows(&mut self) -> $Rows<'_> {
                $Rows { $($plane: &mut self.$plane,)* }
            }
        }

        impl<'a> $Rows<'a> {
            /// Splits off the first `first` of `pixels` pixels.
            pub(crate) fn split(self, first: usize, pixels: usize) -> (Self, Self) {
                $(let each = self.$plane.len() / pixels.max(1); let $plane = self.$plane.split_at_mut(first * each);)*
                (Self { $($plane: $plane.0,)* }, Self { $($plane: $plane.1,)* })
            }
        }
    };
}

planes! {
    /// Statistics of kept or of discarded samples, of one half or of all.
    Half, HalfRows(layout) {
        /// The number of samples, at most `u32::MAX`.
        counts: u32 = 0, 1;
        /// Mean radiance.
        means: [f64; 3] = [0.0; 3], 1;
        /// Mean emission of lights seen directly.
        emission: [f32; 3] = [0.0; 3], layout.needs.emission;
        /// Mean indirect lighting.
        indirect: [f32; 3] = [0.0; 3], layout.needs.indirect;
        /// The words of the recorders.
        words: Vec<u32> = Vec::new(), layout.recorders;
    }
}

planes! {
    /// Sums of squared deviations from the means of the halves, for kept or for discarded samples: one sum over both
    /// halves, or one per half with [`Needs::half_variance`].
    Spread, SpreadRows(layout) {
        /// Squared deviations of the radiance.
        m2: [f32; 3] = [0.0; 3], layout.needs.sums();
        /// Squared deviations of the indirect lighting.
        indirect_m2: [f32; 3] = [0.0; 3], if layout.needs.indirect { layout.needs.sums() } else { 0 };
    }
}

planes! {
    /// Statistics of all samples, kept or discarded, of both halves.
    Beside, BesideRows(layout) {
        /// Features of the first surfaces.
        features: FeatureMoments = FeatureMoments::default(), layout.needs.features;
        /// Features of each half's samples: two per pixel, or none.
        half_features: FeatureMoments = FeatureMoments::default(), if layout.needs.feature_halves && layout.needs.halves { 2 } else { 0 };
        /// Shape and primitive of the first sample's first hit, or [`NO_SURFACE`].
        surfaces: [u32; 2] = NO_SURFACE, layout.needs.surfaces;
        /// The first hits of the first samples.
        first_hits: Option<FirstHit> = None, layout.needs.first_hits;
        /// The number of rays traced.
        costs: u64 = 0, layout.needs.cost;
    }
}

/// The surface of a sample that missed or was not traced. No shape has this index.
pub(super) const NO_SURFACE: [u32; 2] = [u32::MAX; 2];

/// A value of a plane.
pub(crate) trait Sound {
    /// Returns `false` for values that are NaN or infinite.
    fn is_sound(&self) -> bool;
}

macro_rules! sound {
    ($($Value:ty: $sound:expr;)*) => {$(
        impl Sound for $Value {
            fn is_sound(&self) -> bool {
                let sound: fn(&Self) -> bool = $sound;
                sound(self)
            }
        }
    )*};
}

sound! {
    u32: |_| true;
    u64: |_| true;
    [u32; 2]: |_| true;
    Vec<u32>: |_| true;
    [f32; 3]: |values| values.iter().all(|x| x.is_finite());
    [f64; 3]: |values| values.iter().all(|x| x.is_finite());
    FeatureMoments: |_| true;
    Option<FirstHit>: |hit| hit.as_ref().is_none_or(FirstHit::is_finite);
}

/// A rectangle of a window, cut out of planes and pasted back.
pub(crate) struct Window {
    /// The index of the rectangle's first pixel.
    first: usize,
    /// Pixels per row of the window, and of the rectangle.
    strides: [usize; 2],
    rows: usize,
    /// The pixels of the whole window.
    pixels: usize,
}

impl Window {
    pub(crate) fn new(whole: &Frame, part: &Frame) -> Self {
        let [dx, dy] = [0, 1].map(|axis| (part.origin()[axis] - whole.origin()[axis]) as usize);
        let ([stride, _], [width, rows]) = (whole.size(), part.size());
        let (stride, width) = (stride as usize, width as usize);
        Self { first: dy * stride + dx, strides: [stride, width], rows: rows as usize, pixels: whole.pixels() }
    }

    /// The index ranges of the rectangle's rows in a plane with `each` values per pixel.
    pub(crate) fn runs(&self, each: usize) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let (first, [stride, width]) = (self.first, self.strides);
        (0..self.rows).map(move |row| (first + row * stride) * each..(first + row * stride + width) * each)
    }

    /// Copies the rectangle's values out of a plane.
    pub(crate) fn cut<T: Clone>(&self, plane: &[T]) -> Vec<T> {
        let each = plane.len() / self.pixels;
        let mut part = Vec::with_capacity(self.rows * self.strides[1] * each);
        self.runs(each).for_each(|run| part.extend_from_slice(&plane[run]));
        part
    }

    /// Moves the rectangle's values back into a plane.
    pub(crate) fn paste<T>(&self, plane: &mut [T], mut part: Vec<T>) {
        let each = plane.len() / self.pixels;
        let rows = part.chunks_exact_mut((self.strides[1] * each).max(1));
        self.runs(each).zip(rows).for_each(|(run, row)| plane[run].swap_with_slice(row));
    }
}

fn exchange<T>(one: &mut [T], other: &mut [T], marked: &[bool]) {
    let each = one.len() / marked.len().max(1);
    for i in (0..marked.len()).filter(|&i| marked[i]) {
        one[i * each..(i + 1) * each].swap_with_slice(&mut other[i * each..(i + 1) * each]);
    }
}

/// The mean of a pixel whose samples were all rejected: -0, which is never the mean of valid samples.
pub(super) const NONE_VALID: [f64; 3] = [-0.0; 3];

/// Returns `true` for [`NONE_VALID`]. Compares bits, since -0 equals 0.
pub(super) fn is_none_valid(mean: [f64; 3]) -> bool {
    mean.map(f64::to_bits) == NONE_VALID.map(f64::to_bits)
}
