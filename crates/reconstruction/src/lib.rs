//! Filters from per-pixel statistics to a picture.
