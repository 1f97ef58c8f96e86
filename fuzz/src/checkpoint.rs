//! The body of the fuzz target `checkpoint`. `crates/job/tests/fuzz_corpus.rs` runs it on the seeds.

use dapple_core::{ShardFilm, Snapshot, Stage, merge};
use dapple_job::checkpoint::Contents;

/// A file with a wrong and with the right checksum, a snapshot, a stage, a shard.
pub fn checkpoint(data: &[u8]) {
    let signed = [data, &crc32fast::hash(data).to_le_bytes()].concat();
    for bytes in [data.to_vec(), signed] {
        match Contents::from_bytes(bytes.clone()) {
            Ok(contents) => assert_eq!(contents.to_bytes().expect("short texts"), bytes),
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
    if let Ok(stage) = Stage::from_bytes(data) {
        assert_eq!(stage.to_bytes(), data);
    }
    if let Ok(part) = ShardFilm::from_bytes(data) {
        // Bytes without meaning may differ the first time.
        let bytes = part.to_bytes();
        assert_eq!(ShardFilm::from_bytes(&bytes).expect("what was written").to_bytes(), bytes);
        if let Ok(film) = merge(&[part]) {
            assert_eq!(film.counts().len(), film.frame().pixels());
        }
    }
}
