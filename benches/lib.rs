//! Benches of all crates: `cargo bench -p dapple-benches --bench NAME`.
