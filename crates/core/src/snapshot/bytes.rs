//! Encoding of numbers as little-endian bytes, without padding.

use super::Broken;

/// A number type with a fixed number of bytes.
pub(crate) trait Number: Copy {
    const SIZE: usize;
    /// Returns `false` for NaN and infinities.
    fn is_sound(&self) -> bool;
    fn take(from: &[u8]) -> Self;
    /// Writes as many numbers as the bytes hold.
    fn put_all(values: &[Self], to: &mut [u8]);
    /// Reads as many numbers as there are places.
    fn take_all(from: &[u8], to: &mut [Self]);
}

macro_rules! number {
    ($($kind:ty: $sound:expr),*) => {$(
        impl Number for $kind {
            const SIZE: usize = size_of::<$kind>();

            fn is_sound(&self) -> bool {
                let sound: fn(&$kind) -> bool = $sound;
                sound(self)
            }

            #[inline]
            fn take(from: &[u8]) -> Self {
                let mut bytes = [0; size_of::<$kind>()];
                bytes.copy_from_slice(from);
                Self::from_le_bytes(bytes)
            }

            fn put_all(values: &[Self], to: &mut [u8]) {
                let places = to.as_chunks_mut::<{ size_of::<$kind>() }>().0;
                places.iter_mut().zip(values).for_each(|(to, value)| *to = value.to_le_bytes());
            }

            fn take_all(from: &[u8], to: &mut [Self]) {
                let values = from.as_chunks::<{ size_of::<$kind>() }>().0;
                to.iter_mut().zip(values).for_each(|(to, bytes)| *to = Self::from_le_bytes(*bytes));
            }
        }
    )*};
}

number! {
    u8: |_| true, u16: |_| true, u32: |_| true, u64: |_| true, i128: |_| true,
    f32: |x| x.is_finite(), f64: |x| x.is_finite()
}

impl<T: Number, const N: usize> Number for [T; N] {
    const SIZE: usize = N * T::SIZE;

    fn is_sound(&self) -> bool {
        self.iter().all(T::is_sound)
    }

    #[inline]
    fn take(from: &[u8]) -> Self {
        std::array::from_fn(|i| T::take(&from[i * T::SIZE..(i + 1) * T::SIZE]))
    }

    fn put_all(values: &[Self], to: &mut [u8]) {
        T::put_all(values.as_flattened(), to);
    }

    fn take_all(from: &[u8], to: &mut [Self]) {
        T::take_all(from, to.as_flattened_mut());
    }
}

/// A growing buffer of encoded bytes.
pub(crate) struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    pub(crate) fn with_capacity(bytes: usize) -> Self {
        Self { bytes: Vec::with_capacity(bytes) }
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.bytes
    }

    pub(crate) fn number(&mut self, value: impl Number) {
        self.numbers(&[value]);
    }

    pub(crate) fn flag(&mut self, value: bool) {
        self.bytes.push(u8::from(value));
    }

    /// Writes numbers without a count, which the reader must know.
    pub(crate) fn numbers<T: Number>(&mut self, values: &[T]) {
        let start = self.bytes.len();
        self.bytes.resize(start + values.len() * T::SIZE, 0);
        T::put_all(values, &mut self.bytes[start..]);
    }

    /// Writes the count of numbers, then the numbers.
    pub(crate) fn list<T: Number>(&mut self, values: &[T]) {
        self.number(values.len() as u64);
        self.numbers(values);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.list(text.as_bytes());
    }
}

/// A cursor over encoded bytes. Never allocates more than the remaining bytes can fill.
pub(crate) struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    pub(crate) fn raw(&mut self, count: usize) -> Result<&'a [u8], Broken> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(Broken("they end too early"))?;
        self.rest = rest;
        Ok(taken)
    }

    /// Splits off a reader of the next `count` records of `each` bytes.
    pub(crate) fn part(&mut self, count: usize, each: usize) -> Result<Self, Broken> {
        let size = count.checked_mul(each).ok_or(Broken("they end too early"))?;
        Ok(Self::new(self.raw(size)?))
    }

    pub(crate) fn number<T: Number>(&mut self) -> Result<T, Broken> {
        Ok(T::take(self.raw(T::SIZE)?))
    }

    pub(crate) fn flag(&mut self) -> Result<bool, Broken> {
        match self.number::<u8>()? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(Broken("a flag is neither 0 nor 1")),
        }
    }

    pub(crate) fn numbers<T: Number>(&mut self, count: usize) -> Result<Vec<T>, Broken> {
        Ok(self.part(count, T::SIZE)?.rest.chunks_exact(T::SIZE).map(T::take).collect())
    }

    /// Reads as many numbers as there are places.
    pub(crate) fn fill<T: Number>(&mut self, to: &mut [T]) -> Result<(), Broken> {
        let from = self.part(to.len(), T::SIZE)?;
        T::take_all(from.rest, to);
        Ok(())
    }

    /// Refuses bytes that are too few for `count` records of at least `each` bytes.
    pub(crate) fn expect(&self, count: usize, each: usize) -> Result<(), Broken> {
        match count.checked_mul(each) {
            Some(size) if size <= self.rest.len() => Ok(()),
            _ => Err(Broken("they end too early")),
        }
    }

    /// Reads the count of the records that follow, and checks it against the bytes left; each record has at least
    /// `each` bytes.
    pub(crate) fn count(&mut self, each: usize) -> Result<usize, Broken> {
        let count = usize::try_from(self.number::<u64>()?).map_err(|_| Broken("they end too early"))?;
        match count.checked_mul(each) {
            Some(size) if size <= self.rest.len() => Ok(count),
            _ => Err(Broken("they end too early")),
        }
    }

    pub(crate) fn list<T: Number>(&mut self) -> Result<Vec<T>, Broken> {
        let count = self.count(T::SIZE)?;
        self.numbers(count)
    }

    pub(crate) fn text(&mut self) -> Result<String, Broken> {
        String::from_utf8(self.list()?).map_err(|_| Broken("a text is not UTF-8"))
    }
}
