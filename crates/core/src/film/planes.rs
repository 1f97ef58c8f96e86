//! The planes of a film, each declared once: needs, parts, checkpoints and bytes per pixel follow from the declaration.

use super::FeatureMoments;
use crate::snapshot::Broken;
use crate::snapshot::bytes::{Number, Reader, Writer};
use crate::{FirstHit, Frame, Needs, RgbMoments};

/// The statistics that decide which planes a film has, and how many values a pixel has in each.
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
        #[derive(Clone, Debug, Default, PartialEq)]
        pub(crate) struct $Planes {
            $($(#[$doc])* pub(crate) $plane: Vec<$Value>,)*
        }

        /// The same planes of some pixels, which one task writes.
        #[derive(Default)]
        pub(crate) struct $Rows<'a> {
            $(pub(crate) $plane: &'a mut [$Value],)*
        }

        impl $Planes {
            /// Planes of pixels without samples.
            pub(crate) fn new(pixels: usize, $layout: &Layout) -> Self {
                Self { $($plane: vec![$empty; pixels * $each as usize],)* }
            }

            /// The bytes of a pixel in all planes.
            pub(crate) fn bytes_per_pixel($layout: &Layout) -> usize {
                0 $(+ size_of::<$Value>() * $each as usize)*
            }

            /// The least bytes of a pixel in all planes of a checkpoint.
            pub(crate) fn least_bytes($layout: &Layout) -> usize {
                0 $(+ <$Value as Value>::LEAST * $each as usize)*
            }

            /// The part of the planes inside a window.
            pub(crate) fn cut(&self, window: &Window) -> Self {
                Self { $($plane: window.cut(&self.$plane),)* }
            }

            /// Puts a part back.
            pub(crate) fn paste(&mut self, window: &Window, part: Self) {
                $(window.paste(&mut self.$plane, part.$plane);)*
            }

            /// Writes all planes.
            pub(crate) fn put(&self, to: &mut Writer) {
                $(Value::put(&self.$plane, to);)*
            }

            /// Reads as many values as the planes have places.
            pub(crate) fn take(&mut self, from: &mut Reader<'_>) -> Result<(), Broken> {
                $(Value::take(from, &mut self.$plane)?;)*
                Ok(())
            }

            #[allow(dead_code, reason = "kept and discarded samples alone change places")]
            /// Exchanges the values of the marked pixels with those of other planes.
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
    Bank, BankRows(layout) {
        /// The number of samples.
        counts: u64 = 0, 1;
        /// Mean radiance.
        means: [f64; 3] = [0.0; 3], 1;
        /// Sums of squared deviations of the radiance.
        m2: [f64; 3] = [0.0; 3], layout.needs.variance;
        /// Mean emission of lights seen directly.
        emission: [f32; 3] = [0.0; 3], layout.needs.emission;
        /// Mean indirect light.
        indirect: [f32; 3] = [0.0; 3], layout.needs.indirect;
        /// Sums of squared deviations of the indirect light.
        indirect_m2: [f32; 3] = [0.0; 3], layout.needs.indirect && layout.needs.variance;
        /// The words of the recorders.
        words: Vec<u32> = Vec::new(), layout.recorders;
    }
}

planes! {
    /// Statistics of all samples, kept or discarded, of both halves.
    Beside, BesideRows(layout) {
        /// Features of the surfaces seen.
        features: FeatureMoments = FeatureMoments::default(), layout.needs.features;
        /// Features of each half's samples: two per pixel, or none.
        half_features: FeatureMoments = FeatureMoments::default(), if layout.needs.feature_halves && layout.needs.halves { 2 } else { 0 };
        /// The first hits of the first samples.
        first_hits: Option<FirstHit> = None, layout.needs.first_hits;
        /// The rays traced.
        costs: u64 = 0, layout.needs.cost;
    }
}

/// A value of a plane, as bytes of a checkpoint.
pub(crate) trait Value: Clone {
    /// The least bytes of a value.
    const LEAST: usize;
    fn put(values: &[Self], to: &mut Writer);
    /// Reads as many values as there are places.
    fn take(from: &mut Reader<'_>, to: &mut [Self]) -> Result<(), Broken>;
}

impl<T: Number> Value for T {
    const LEAST: usize = T::SIZE;

    fn put(values: &[Self], to: &mut Writer) {
        to.numbers(values);
    }

    fn take(from: &mut Reader<'_>, to: &mut [Self]) -> Result<(), Broken> {
        from.fill(to)?;
        if to.iter().all(Number::is_sound) { Ok(()) } else { Err(Broken("a statistic is NaN or infinite")) }
    }
}

impl Value for Vec<u32> {
    const LEAST: usize = 8;

    fn put(values: &[Self], to: &mut Writer) {
        values.iter().for_each(|words| to.list(words));
    }

    fn take(from: &mut Reader<'_>, to: &mut [Self]) -> Result<(), Broken> {
        to.iter_mut().try_for_each(|words| from.list().map(|read| *words = read))
    }
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

    /// The runs of a plane's values inside the rectangle, if the plane has `each` values per pixel.
    fn runs(&self, each: usize) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let (first, [stride, width]) = (self.first, self.strides);
        (0..self.rows).map(move |row| (first + row * stride) * each..(first + row * stride + width) * each)
    }

    /// Values of the rectangle.
    pub(crate) fn cut<T: Clone>(&self, plane: &[T]) -> Vec<T> {
        self.runs(plane.len() / self.pixels).flat_map(|run| &plane[run]).cloned().collect()
    }

    /// Moves values of the rectangle back.
    pub(crate) fn paste<T>(&self, plane: &mut [T], part: Vec<T>) {
        let each = plane.len() / self.pixels;
        let places = self.runs(each).flatten();
        places.zip(part).for_each(|(place, value)| plane[place] = value);
    }
}

fn exchange<T>(one: &mut [T], other: &mut [T], marked: &[bool]) {
    let each = one.len() / marked.len().max(1);
    for i in (0..marked.len()).filter(|&i| marked[i]) {
        one[i * each..(i + 1) * each].swap_with_slice(&mut other[i * each..(i + 1) * each]);
    }
}

impl Bank {
    /// Count, mean and sum of squared deviations of the samples of pixel `i`; deviations are NaN if they are not recorded.
    pub(super) fn moments(&self, i: usize) -> RgbMoments {
        RgbMoments { count: self.counts[i], mean: self.means[i], m2: self.m2.get(i).copied().unwrap_or([f64::NAN; 3]) }
    }
}
