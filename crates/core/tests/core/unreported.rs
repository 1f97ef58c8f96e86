//! Samples that report neither a hit nor a miss: snapshots and shards keep their number.

use crate::common::{Independent, frame};
use dapple_core::samplers::Uniform;
use dapple_core::{Error, Film, Limits, Methods, Needs, Sampler, Session, Shard, ShardFilm, Sharded, Snapshot, merge};

const SPP: f64 = 4.0;

fn uniform() -> Uniform<Independent> {
    Uniform::new(Independent::new(2))
}

fn methods(sampler: &mut dyn Sampler) -> Methods<'_> {
    Methods::from(sampler).with_needs(Needs::none().with_features())
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
    let (frame, limits) = (frame(7, 5), Limits::spp(SPP));
    let (mut first, mut second) = (uniform(), uniform());
    let mut session = Session::new(frame, limits.clone(), methods(&mut first)).unwrap().with_tile_side(3);
    push(&mut session, false);
    let snapshot = Snapshot::from_bytes(&session.snapshot()).unwrap();
    assert!(is_refused(snapshot.film()), "the snapshot has lost the number");
    let mut session = Session::resume(frame, limits, methods(&mut second), snapshot).unwrap();
    push(&mut session, true);
    assert!(session.next_round().unwrap().is_none());
    let film = session.into_film();
    assert_eq!(film.record().samples, 4 * 35);
    assert!(is_refused(&film));
}

#[test]
fn a_merged_image_of_radiance_alone_is_refused_by_readers_of_features() {
    let (frame, limits) = (frame(7, 5), Limits::spp(SPP));
    let part = |index| {
        let (shard, mut inner) = (Shard::new(index, 2).unwrap(), uniform());
        let mut sharded = Sharded::new(&mut inner, shard, &limits).unwrap();
        let mut session = Session::new(frame, limits.clone(), methods(&mut sharded)).unwrap();
        push(&mut session, true);
        assert!(session.next_round().unwrap().is_none());
        let bytes = ShardFilm::new(shard, &session.into_film()).unwrap().to_bytes();
        ShardFilm::from_bytes(&bytes).unwrap()
    };
    let whole = merge(&[part(0), part(1)]).unwrap();
    assert_eq!(whole.record().samples, 4 * 35);
    assert!(is_refused(&whole));
}
