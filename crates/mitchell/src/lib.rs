//! Mitchell's contrast-adaptive sampler and pbrt-v2's variant of it.
