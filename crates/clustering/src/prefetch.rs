//! Requests for memory that is needed soon.

/// Requests cache lines, on processors for which safe Rust can.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prefetch {
    #[cfg(target_arch = "x86_64")]
    sse: Option<pulp::core_arch::x86::Sse>,
}

impl Default for Prefetch {
    fn default() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            sse: pulp::core_arch::x86::Sse::try_new(),
        }
    }
}

impl Prefetch {
    /// Requests the cache line of an array's element. An index past the end is harmless.
    #[inline(always)]
    pub(crate) fn request<T>(self, array: &[T], index: usize) {
        #[cfg(target_arch = "x86_64")]
        if let Some(sse) = self.sse {
            /// The first level of the cache.
            const NEAREST: i32 = 3;
            sse._mm_prefetch::<NEAREST>(array.as_ptr().wrapping_add(index).cast());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = (array, index);
    }
}
