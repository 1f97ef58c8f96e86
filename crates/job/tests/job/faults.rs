//! Faults at every file operation, and damaged files.

use crate::fuzz_corpus::mix;
use dapple_core::container::{self, Fault as Broken};
use dapple_job::checkpoint::{Disk, Error, FileSystem, Identity, StateDamage, StateFile, StateKind, Store};
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

fn contents(body: impl AsRef<[u8]>) -> StateFile {
    let identity = Identity::new([("scene", "teapot"), ("seed", "7")]);
    let mut state = container::begin(0);
    container::append(&mut state, "body", body.as_ref());
    StateFile::new(StateKind::Checkpoint, identity, state)
}

/// Contents longer than a piece, so that a file takes several writes.
fn body(generation: u8) -> Vec<u8> {
    (0..(1_u32 << 20) + 99).map(|i| (i as u8).wrapping_mul(31) ^ generation).collect()
}

/// The failure of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// The call fails without an effect.
    Refused,
    /// The disk is full: a write stores half of its bytes, and other calls fail.
    Full,
    /// The process is killed after the call: all later calls fail.
    KilledAfter,
    /// The process is killed during the call: half of a write, or nothing, is done.
    KilledWithin,
}

/// A disk that fails at its `at`-th call.
struct Faulty {
    at: usize,
    fault: Fault,
    calls: Arc<AtomicUsize>,
    links: bool,
}

impl Faulty {
    /// `Ok(true)` if a call succeeds as usual, `Ok(false)` if it does half of its work.
    fn next(&self) -> io::Result<bool> {
        let call = self.calls.fetch_add(1, Ordering::Relaxed);
        let gone = || Err(io::Error::other("the process is gone"));
        match (call.cmp(&self.at), self.fault) {
            (std::cmp::Ordering::Less, _) => Ok(true),
            (std::cmp::Ordering::Equal, Fault::Refused) => Err(ErrorKind::PermissionDenied.into()),
            (std::cmp::Ordering::Equal, Fault::Full | Fault::KilledWithin) => Ok(false),
            (std::cmp::Ordering::Equal, Fault::KilledAfter) => Ok(true),
            (std::cmp::Ordering::Greater, Fault::KilledAfter | Fault::KilledWithin) => gone(),
            (std::cmp::Ordering::Greater, _) => Ok(true),
        }
    }

    fn whole<T>(&self, call: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
        if self.next()? { call() } else { Err(ErrorKind::StorageFull.into()) }
    }
}

impl FileSystem for Faulty {
    fn create(&self, path: &Path) -> io::Result<File> {
        self.whole(|| Disk.create(path))
    }

    fn write(&self, file: &mut File, bytes: &[u8]) -> io::Result<()> {
        if self.next()? {
            return Disk.write(file, bytes);
        }
        file.write_all(&bytes[..bytes.len() / 2])?;
        Err(ErrorKind::StorageFull.into())
    }

    fn sync(&self, file: &File) -> io::Result<()> {
        self.whole(|| Disk.sync(file))
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.whole(|| if self.links { Disk.link(from, to) } else { Err(ErrorKind::Unsupported.into()) })
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.whole(|| Disk.rename(from, to))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.whole(|| Disk.remove(path))
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        self.whole(|| Disk.sync_folder(folder))
    }
}

/// Saves the third of three generations with a fault. Returns the file read afterwards, the result of saving, and the number of
/// calls.
fn third(newest: &StateFile, at: usize, fault: Fault, links: bool) -> (StateFile, Result<(), Error>, usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.checkpoint");
    for generation in [1, 2] {
        Store::lock(&path).unwrap().save(&contents([generation])).unwrap();
    }
    let calls = Arc::new(AtomicUsize::new(0));
    let store = Store::lock_on(&path, Box::new(Faulty { at, fault, calls: calls.clone(), links })).unwrap();
    let outcome = store.save(newest);
    let calls = calls.load(Ordering::Relaxed);
    let found = Store::read(&path, StateKind::Checkpoint).unwrap().contents;
    drop(store);
    // The next process can write, whatever the fault left behind.
    let store = Store::lock(&path).unwrap();
    store.save(&contents([4])).unwrap();
    assert!(Store::read(&path, StateKind::Checkpoint).unwrap().contents == contents([4]));
    let left: Vec<PathBuf> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(left.len() <= 3, "{left:?}");
    (found, outcome, calls)
}

#[test]
fn a_fault_at_every_call_leaves_a_whole_file_x02() {
    let newest = contents(body(3));
    for links in [true, false] {
        let (found, outcome, calls) = third(&newest, usize::MAX, Fault::Refused, links);
        assert!(outcome.is_ok() && found == newest);
        assert!((8..14).contains(&calls), "{calls} calls");
        for at in 0..calls {
            for fault in [Fault::Refused, Fault::Full, Fault::KilledAfter, Fault::KilledWithin] {
                let (found, outcome, _) = third(&newest, at, fault, links);
                let case = format!("{fault:?} at call {at} of {calls}, links {links}: {outcome:?}");
                assert!(found == contents([2]) || found == newest, "{case}");
                match &outcome {
                    // Failed links are no error, since saving works without links.
                    Ok(()) => assert!(found == newest, "{case}"),
                    Err(e @ Error::Write { .. }) => {
                        let said = e.to_string();
                        let parts = ["a.checkpoint: cannot ", "an existing file of that name is not damaged"];
                        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
                        let last = said.contains("flush its folder");
                        assert_eq!(found == newest, last, "{case}");
                    }
                    Err(other) => panic!("{case}: {other}"),
                }
            }
        }
    }
}

/// The control: the same faults expose a naive writer, which writes in place.
#[test]
fn writing_in_place_would_not_pass_x02() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.checkpoint");
    std::fs::write(&path, contents(body(2)).bytes()).unwrap();
    let faulty = Faulty { at: 1, fault: Fault::KilledWithin, calls: Arc::default(), links: true };
    let mut file = faulty.create(&path).unwrap();
    faulty.write(&mut file, contents(body(3)).bytes()).unwrap_err();
    assert!(matches!(Store::read(&path, StateKind::Checkpoint), Err(Error::Damaged { .. })));
}

#[test]
fn damage_is_found_and_the_previous_generation_used_x03() {
    let bytes = contents([1, 2, 3, 4, 5, 6, 7, 8, 9]).bytes().to_vec();
    let damage = |bytes: &[u8]| StateFile::from_bytes(bytes.to_vec()).unwrap_err();
    assert_eq!(StateFile::from_bytes(bytes.clone()).unwrap(), contents([1, 2, 3, 4, 5, 6, 7, 8, 9]));
    for bit in 0..8 * bytes.len() {
        let mut bytes = bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        damage(&bytes);
    }
    for length in 0..bytes.len() {
        assert_eq!(damage(&bytes[..length]), StateDamage::Container(Broken::Short), "{length}");
    }
    assert_eq!(damage(b"PK\x03\x04 something else"), StateDamage::Container(Broken::Foreign));
    let mut old = bytes.clone();
    old[8] = 0;
    assert_eq!(damage(&old), StateDamage::Container(Broken::Version));
    // 10^4 trials of one or several bit flips in a large file.
    let large = contents(body(1)).bytes().to_vec();
    for k in 0..10_000_u64 {
        let mut state = mix(k + 1);
        // Checking a whole large file is slow, so only some flips are tried on it.
        let small = k % 50 != 0;
        let mut flipped = if small { bytes.clone() } else { large.clone() };
        for _ in 0..=k % 3 {
            state = mix(state + 1);
            let bit = state as usize % (8 * flipped.len());
            flipped[bit / 8] ^= 1 << (bit % 8);
        }
        if flipped != if small { &bytes[..] } else { &large[..] } {
            damage(&flipped);
        }
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let store = Store::lock(&path).unwrap();
    store.save(&contents(body(1))).unwrap();
    store.save(&contents(body(2))).unwrap();
    let newest = std::fs::read(&path).unwrap();
    for broken in [&newest[..newest.len() / 2], &[], b"something else"] {
        std::fs::write(&path, broken).unwrap();
        let found = Store::read(&path, StateKind::Checkpoint).unwrap();
        assert!(found.contents == contents(body(1)));
        assert!(found.trouble.unwrap().to_string().contains("/a: the file is "));
    }
    std::fs::write(folder.path().join("a.previous"), b"dapple").unwrap();
    let said = Store::read(&path, StateKind::Checkpoint).unwrap_err().to_string();
    for part in ["a: the file is not a Dapple file; and ", "a.previous: the file is truncated"] {
        assert!(said.contains(part), "{said}");
    }
    let said = Store::read(&folder.path().join("b"), StateKind::Checkpoint).unwrap_err().to_string();
    assert!(said.ends_with("b: there is no such file; check the name of the checkpoint"), "{said}");
}

#[test]
fn nonsense_with_a_right_checksum_x03() {
    let mut bytes = contents([7; 30]).bytes().to_vec();
    container::append(&mut bytes, "header", b"{\"kind\":\"checkpoint\"}");
    assert_eq!(StateFile::from_bytes(bytes.clone()), Err(StateDamage::Nonsense));
    // Without a header at its end, a file is cut short.
    container::append(&mut bytes, "body", b"");
    assert_eq!(StateFile::from_bytes(bytes), Err(StateDamage::Container(Broken::Short)));
}

/// The container's checksum equals CRC-32 computed bit by bit, after IEEE 802.3.
#[test]
fn the_checksum_is_the_common_one_x03() {
    let step = |crc: u32, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
    let crc = |bytes: &[u8]| !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step));
    let mut bytes = container::begin(0);
    container::append(&mut bytes, "na", b"me");
    assert!(bytes.ends_with(&crc(b"name").to_le_bytes()));
}

#[test]
fn what_differs_is_listed_x04() {
    let here = Identity::new([("scene", "teapot"), ("seed", "4"), ("depth", "5")]);
    let there = Identity::new([("scene", "teapot"), ("seed", "3"), ("lens", "wide")]);
    let expected = ["seed: 3, not 4", "depth: none, not 5", "lens: wide, not none"];
    assert_eq!(here.differences(&there), expected);
    assert!(here.differences(&here).is_empty());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    Store::lock(&path).unwrap().save(&contents([])).unwrap();
    let said = Store::read(&path, StateKind::Rows).unwrap_err().to_string();
    assert!(said.contains("not of the kind needed here"), "{said}");
}

#[test]
fn two_writers_x08() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let first = Store::lock(&path).unwrap();
    let Err(refused) = Store::lock(&path) else { panic!("two writers") };
    assert!(refused.to_string().contains("another process is writing to this file"), "{refused}");
    drop(first);
    assert!(Store::lock(&path).is_ok());
    assert!(matches!(Store::lock(folder.path()), Err(Error::Write { .. })));
    assert!(matches!(Store::lock(&folder.path().join("missing/a")), Err(Error::Write { .. })));
}
