//! The thesis' own numbers.

/// The mean samples per pixel of all its tables.
pub(crate) const SPP: [u64; 4] = [8, 16, 32, 64];

/// Table 4-3: the fewest samples that a pixel gets.
pub(crate) const MIN: [f64; 4] = [6.0, 12.0, 24.0, 56.0];

/// Table 4-4: MSE of the teapot, Gaussian-filtered. Only the clusters had the cluster filter.
pub(crate) const FILTERED: [(&str, [f64; 4]); 3] = [
    ("LD, gaussian", [174.8, 132.5, 117.4, 109.8]),
    ("Mitchell, gaussian", [197.5, 192.7, 151.7, 139.9]),
    ("clusters, cluster filter", [153.3, 96.08, 69.75, 60.49]),
];

/// Table 4-5 as printed: reduction of the MSE against LD, in percent. Table 4-4 gives other numbers: see [`reduction`].
pub(crate) const REDUCTION: [(&str, [f64; 4]); 2] =
    [("Mitchell, gaussian", [-12.5, -49.2, -29.1, -26.3]), ("clusters, cluster filter", [12.6, 27.2, 40.6, 54.5])];

/// Reduction against LD in percent, computed from table 4-4.
pub(crate) fn reduction(row: usize) -> [f64; 4] {
    std::array::from_fn(|i| 100.0 * (1.0 - FILTERED[row].1[i] / FILTERED[0].1[i]))
}

/// Table 4-6: MSE unfiltered, of uniform random sampling and of clusters.
pub(crate) const UNFILTERED: [[f64; 4]; 2] = [[834.3, 337.6, 140.2, 50.6], [1124.0, 458.1, 204.2, 56.11]];

/// Scene, mean samples per pixel, and seconds of clustering, probing and tracing.
pub(crate) const TIMES: [(&str, f64, [f64; 3]); 4] = [
    ("terrain", 16.21, [2.0, 35.0, 43.0]),
    ("terrain", 58.0, [2.0, 35.0, 145.0]),
    ("teapot", 7.85, [0.5, 15.6, 20.0]),
    ("teapot", 57.45, [0.4, 15.0, 180.0]),
];

/// The column of a table for a mean count.
pub(crate) fn at(row: &[f64; 4], spp: u64) -> Option<f64> {
    SPP.iter().position(|&known| known == spp).map(|i| row[i])
}
