//! The body of the fuzz target `checkpoint`. `crates/job/tests/fuzz_corpus.rs` runs it on the seeds.

use dapple_core::render::TracedRows;
use dapple_core::{Snapshot, container};
use dapple_job::checkpoint::StateFile;

/// Parses `data` as a state file, a snapshot and traced rows, and as the header section of a file with a valid checksum.
pub fn checkpoint(data: &[u8]) {
    let mut signed = container::begin(0);
    container::append(&mut signed, "header", data);
    for bytes in [data.to_vec(), signed] {
        match StateFile::from_bytes(bytes.clone()) {
            Ok(file) => assert_eq!(file.bytes(), bytes),
            Err(damage) => assert!(!damage.to_string().is_empty()),
        }
    }
    match Snapshot::from_bytes(data) {
        Ok(snapshot) => {
            let film = snapshot.film();
            assert_eq!(film.counts().len(), film.image().len());
            let _ = (film.predicted_relmse(), film.squared_errors());
        }
        Err(e) => assert!(!e.to_string().is_empty()),
    }
    if let Err(e) = TracedRows::from_bytes(data) {
        assert!(!e.to_string().is_empty());
    }
}
