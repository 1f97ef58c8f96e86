//! Samples that report neither a hit nor a miss: snapshots keep their number.

use crate::common::{frame, uniform};
use dapple_core::{Error, Film, Limits, Methods, Needs, Session, Snapshot};

fn methods() -> Methods<'static> {
    Methods::from(uniform(2)).with_needs(Needs::none().with_features())
}

/// Adds radiance alone to the next tile of a session, or to all.
fn push(session: &mut Session<'_>, all: bool) {
    let round = session.next_round().unwrap().expect("a round");
    while let Some(mut tile) = round.next_tile() {
        for (pixel, count) in tile.counts() {
            (0..count).for_each(|_| tile.push(pixel, [0.5; 3]));
        }
        round.submit(tile).unwrap();
        if !all {
            break;
        }
    }
}

fn is_refused(film: &Film) -> bool {
    matches!(film.require("reader", &Needs::none().with_features()), Err(Error::NoneReported { .. }))
}

#[test]
fn a_resumed_session_of_radiance_alone_is_refused_by_readers_of_features() {
    let (frame, limits) = (frame(7, 5), Limits::spp(4.0));
    let mut session = Session::new(frame, limits.clone(), methods()).unwrap().with_tile_side(3);
    push(&mut session, false);
    let snapshot = Snapshot::from_bytes(&session.snapshot()).unwrap();
    assert!(is_refused(snapshot.film()), "the snapshot has lost the number");
    let mut session = Session::resume(frame, limits, methods(), snapshot).unwrap();
    push(&mut session, true);
    assert!(session.next_round().unwrap().is_none());
    let film = session.into_film();
    assert_eq!(film.record().samples, 4 * 35);
    assert!(is_refused(&film));
}
