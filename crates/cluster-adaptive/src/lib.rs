//! Sample counts per pixel from the projected sizes of clusters.
