//! The bytes of a render's state: sections are found again, and damage is refused.

use crate::common::{Field, Independent, Keeper, bits, everything, frame, learner, mix, snapshot, uniform};
use crate::recorder::reds;
use dapple_adaptive::Adaptive;
use dapple_core::container::{Fault, append, begin, sections};
use dapple_core::{Error, Film, Limits, Needs, Render, Snapshot};
use proptest::prelude::*;

/// The state within the second round of a render that learns, and at its end.
fn states() -> [Vec<u8>; 2] {
    let (limits, mut keeper) = (limits(), Keeper::default());
    let render = Render::new(frame(7, 5), &limits).needs(everything().with_splats());
    render.monitor(&mut keeper).run(&mut learner(), &mut sampler()).unwrap();
    [keeper.slices[1].clone(), keeper.end]
}

fn limits() -> Limits {
    Limits::samples(200)
}

fn sampler() -> Adaptive<Independent> {
    Adaptive::variance(Independent::new(5))
}

/// Resumes a state if it can be read.
fn resume(bytes: &[u8]) -> Result<Film, Error> {
    let (snapshot, limits) = (Snapshot::from_bytes(bytes)?, limits());
    let render = Render::new(*snapshot.film().frame(), &limits).needs(everything().with_splats());
    render.resume(snapshot, &mut learner(), &mut sampler())
}

fn contained(parts: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = begin(0);
    parts.iter().for_each(|(name, section)| append(&mut bytes, name, section));
    bytes
}

fn parts(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    sections(bytes).unwrap().iter().map(|(name, part)| ((*name).to_owned(), part.to_vec())).collect()
}

/// The reason why bytes are no state.
fn fault(bytes: &[u8]) -> &'static str {
    match Snapshot::from_bytes(bytes) {
        Err(Error::BadSnapshot { what }) => what,
        other => panic!("{:?}", other.map(|_| ())),
    }
}

proptest! {
    #[test]
    fn sections_are_found_in_order_whatever_they_hold(
        parts: Vec<(String, Vec<u8>)>,
        cut: prop::sample::Index,
        bit: prop::sample::Index,
    ) {
        let bytes = contained(&parts);
        let found = sections(&bytes).unwrap();
        prop_assert!(found.iter().map(|(name, part)| (*name, *part)).eq(parts.iter().map(|(n, p)| (n.as_str(), &p[..]))));
        // A shorter one has fewer sections, or is refused.
        let cut = cut.index(bytes.len());
        match sections(&bytes[..cut]) {
            Ok(fewer) => prop_assert!(fewer.len() < found.len() && found.starts_with(&fewer)),
            Err(fault) => prop_assert_eq!(fault, Fault::Short),
        }
        let mut damaged = bytes.clone();
        let bit = bit.index(8 * bytes.len());
        damaged[bit / 8] ^= 1 << (bit % 8);
        let expected: &[Fault] = match bit / 8 {
            0..8 => &[Fault::Foreign],
            8..12 => &[Fault::Version],
            _ => &[Fault::Short, Fault::Checksum],
        };
        prop_assert!(sections(&damaged).is_err_and(|fault| expected.contains(&fault)));
    }
}

#[test]
fn unknown_sections_are_kept_beside_a_state() {
    for state in states() {
        let known = parts(&state);
        let added = ("a scene of the host's".to_owned(), vec![7; 99]);
        for at in 0..=known.len() {
            let mut parts = known.clone();
            parts.insert(at, added.clone());
            let bytes = contained(&parts);
            assert_eq!(snapshot(&bytes), snapshot(&state));
            assert_eq!(sections(&bytes).unwrap()[at], (added.0.as_str(), &added.1[..]));
        }
        assert!(bits(&resume(&state).unwrap()) == bits(&resume(&contained(&known)).unwrap()));
    }
}

#[test]
fn a_state_cut_short_or_with_any_bit_changed_is_refused_x03() {
    for state in states() {
        for length in 0..state.len() {
            let fault = fault(&state[..length]);
            assert!(fault == Fault::Short.text() || fault == "they hold no state of a render", "{length}: {fault}");
        }
        assert_eq!(fault(&[&state[..], &[0]].concat()), Fault::Short.text());
        assert!(fault(&[&state[..8], &[0; 4], &state[12..]].concat()).contains("another version"));
        for k in 0..state.len() {
            let mut bytes = state.clone();
            bytes[k] ^= 1 << (k % 8);
            let expected: &[Fault] = match k {
                0..8 => &[Fault::Foreign],
                8..12 => &[Fault::Version],
                _ => &[Fault::Short, Fault::Checksum],
            };
            let fault = fault(&bytes);
            assert!(expected.iter().any(|one| one.text() == fault), "byte {k}: {fault}");
        }
    }
}

/// An error, or a render that ends.
#[test]
fn damage_with_right_checksums_does_no_harm_x03() {
    for state in states() {
        let (parts, mut refused) = (parts(&state), 0);
        for k in 0..3000_u64 {
            let mut parts = parts.clone();
            let part = &mut parts[mix(k) as usize % 2].1;
            let bit = mix(k + 7777) as usize % (8 * part.len());
            match k % 4 {
                0 => part.truncate(bit / 8),
                _ => part[bit / 8] ^= 1 << (bit % 8),
            }
            refused += usize::from(resume(&contained(&parts)).is_err());
        }
        assert!((1000..3000).contains(&refused), "{refused}");
    }
}

/// Bytes that promise more first hits, recorders or pixels than they hold. Without a check, memory of up to 17 GB is made.
#[test]
fn no_memory_is_made_for_statistics_that_are_not_there() {
    let film = |needs, recorders| {
        let mut keeper = Keeper::default();
        let limits = Limits::spp(1.0);
        let render = Render::new(frame(256, 256), &limits).needs(needs).recorders(recorders).monitor(&mut keeper);
        render.run(&mut Field(|_, _| [0.0; 3]), &mut uniform(1)).unwrap();
        parts(&keeper.end)
    };
    let (none, plain) = (Needs::none(), film(Needs::none(), vec![]));
    assert!(Snapshot::from_bytes(&contained(&plain)).is_ok());
    // The first byte in which films differ is the number.
    let place = |needs, recorders| {
        let with = film(needs, recorders);
        (0..).find(|&at| plain[1].1[at] != with[1].1[at]).unwrap()
    };
    // The number of pixels, and a sample in each.
    let counts = plain[1].1.windows(7).position(|bytes| bytes == [0x80, 0x80, 4, 1, 1, 1, 1]).unwrap();
    let (names, pixels) = ([&[0x80, 0x20][..], &[0; 4096]].concat(), [&[0xff; 9][..], &[1]].concat());
    for (at, length, lie, reason) in [
        (place(none.with_first_hits(1), vec![]), 1, vec![0xff], "of another number of pixels"),
        (place(none, vec![reds(3)]), 1, names, "of another number of pixels"),
        (counts, 3, pixels, "they end too early"),
    ] {
        let mut parts = plain.clone();
        parts[1].1.splice(at..at + length, lie);
        let fault = fault(&contained(&parts));
        assert!(fault.contains(reason), "{fault}");
    }
}
