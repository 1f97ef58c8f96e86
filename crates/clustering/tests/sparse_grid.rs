//! Memory of a sparse grid, in its own process so that the peak is that of this test.

#[path = "clustering/support.rs"]
mod support;

use dapple_clustering::{ClusterParams, Error, Insertion};
use support::soup;

/// The peak memory of this process in KiB.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
#[allow(clippy::print_stderr)]
fn a_sparse_grid_takes_memory_for_occupied_voxels_only_k06() {
    let mesh = soup(10, 0.01, 6);
    let mesh = mesh.map(|p| p.map(|x| x.clamp(0.0, 0.95)));
    // Makes the box a cube.
    let mut mesh = mesh;
    mesh.add([[0.0; 3], [0.0; 3], [1.0; 3]]);
    mesh.materials.push(0);
    let params = ClusterParams { k: 1e6, clamp: 2000, ..ClusterParams::default() };
    let clusters = mesh.cluster(&params).unwrap();
    assert_eq!(clusters.report().requested(), 8_000_000_000);
    assert_eq!((clusters.len(), clusters.report().occupied), (11, 11));
    let finest = mesh.cluster(&ClusterParams { clamp: 1 << 20, ..params }).unwrap();
    assert_eq!((finest.report().requested(), finest.len()), (1 << 60, 11));
    // Boxes that fill the grid would make 8e9 entries: an error.
    let boxes = mesh.cluster(&ClusterParams { insertion: Insertion::BoundingBox, ..params });
    assert!(matches!(boxes, Err(Error::TooManyEntries { entries, .. }) if entries >= 8_000_000_000), "{boxes:?}");
    match peak() {
        Some(peak) => assert!(peak < 64 << 10, "{peak} KiB"),
        None => eprintln!("skipped: no /proc/self/status to read the peak of memory from"),
    }
}
