//! Numbers on demand: the cursor over a sample's random numbers, and the generator traits.

use crate::common::{Independent, Points, frame, mix, uniform};
use dapple_core::point_set::streams;
use dapple_core::{Block, Draws, Limits, Needs, OwnedRng, PointSet, Rng, SampleId, Session};
use rand::RngExt;
use std::collections::HashSet;

/// Points of which dimension `d` of every sample is `d / 256`.
static DIMENSIONS: Points<fn(SampleId, u32) -> [f32; 4]> =
    Points(|_, block| [0, 1, 2, 3].map(|k| (4 * block + k) as f32 / 256.0));

fn dimension(value: f32) -> u32 {
    (value * 256.0) as u32
}

fn draws() -> Draws<'static> {
    Draws::new(&DIMENSIONS, SampleId::new([3, 5], streams::WHOLE, 12))
}

#[test]
fn pairs_are_aligned_with_the_point_sets_pairs() {
    let draws = draws();
    let mut rng = draws.rng();
    let mut taken = Vec::new();
    for step in [1, 2, 2, 1, 1, 2, 1, 2] {
        match step {
            1 => taken.push(rng.next_f32()),
            _ => taken.extend(rng.next_2d()),
        }
    }
    let dimensions: Vec<u32> = taken.into_iter().map(dimension).collect();
    assert_eq!(dimensions, [0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 13]);
    assert_eq!(draws.blocks_requested(), 4);
}

#[test]
fn cursors_of_one_sample_share_no_numbers() {
    let draws = draws();
    let (mut a, mut b) = (draws.rng(), draws.rng());
    let taken: Vec<u32> = (0..10).flat_map(|_| [a.next_f32(), b.next_f32()]).map(dimension).collect();
    assert_eq!(taken.iter().collect::<HashSet<_>>().len(), 20);
    // One that is made later goes on behind both.
    assert!(dimension(draws.rng().next_f32()) > *taken.iter().max().unwrap());
}

#[test]
fn a_skip_restores_the_order_behind_a_loop() {
    let after = |rejected: usize| {
        let draws = draws();
        let mut rng = draws.rng();
        (0..=rejected).for_each(|_| {
            rng.next_2d();
        });
        rng.skip_to(Block::new(8));
        dimension(rng.next_f32())
    };
    assert_eq!([0, 1, 5, 14].map(after), [32; 4]);
    // Beyond the block there is no way back.
    assert_eq!(after(40), 4 * 21 - 2);
}

#[test]
fn words_hold_the_numbers_of_the_point_set() {
    let points = Independent::new(4);
    for index in 0..200 {
        let draws = Draws::new(&points, SampleId::new([1, 2], 0, index));
        let [u, v, ..] = draws.block(Block::new(0));
        let mut rng = draws.rng();
        assert_eq!((rng.next_u32() >> 8) as f32 / (1 << 24) as f32, u);
        assert_eq!((rng.next_u64() >> 40) as f32 / (1 << 24) as f32, v);
    }
}

#[test]
fn low_bits_are_as_good_as_random() {
    // Each of the 64 bits is set in half of 4096 words, within 5 standard errors: a false alarm once in 30,000 runs of 64.
    let mut set = [0_i64; 40];
    for i in 0..4096 {
        let draws = Draws::new(&DIMENSIONS, SampleId::new([i % 64, i / 64], 0, mix(u64::from(i)) >> 50));
        let word = draws.rng().next_u64();
        (0..40).for_each(|bit| set[bit] += (word >> bit & 1) as i64);
    }
    assert!(set.iter().all(|n| (n - 2048).abs() < 5 * 32), "{set:?}");
}

#[test]
fn every_version_of_rand_gets_the_same_numbers() {
    let points = Independent::new(4);
    let draws = || Draws::new(&points, SampleId::new([7, 7], 1, 3));
    let [a, b, c, d] = draws().block(Block::new(0));
    let (new, old, oldest) = (draws(), draws(), draws());
    let floats: [f32; 4] = std::array::from_fn({
        let mut rng = new.rng();
        move |_| rng.random()
    });
    assert_eq!(floats, [a, b, c, d]);
    let words: Vec<u32> = {
        let mut rng = old.rng();
        (0..4).map(|_| rand_core_0_9::RngCore::next_u32(&mut rng)).collect()
    };
    let mut rng = oldest.rng();
    assert!(words.iter().all(|&word| word == rand_core_0_6::RngCore::next_u32(&mut rng)));
    assert_eq!(words.iter().map(|w| (w >> 8) as f32 / (1 << 24) as f32).collect::<Vec<_>>(), [a, b, c, d]);
    let bytes = |fill: &dyn Fn(&mut Rng<'_>, &mut [u8])| {
        let (draws, mut bytes) = (draws(), [0; 13]);
        fill(&mut draws.rng(), &mut bytes);
        bytes
    };
    assert_eq!(
        bytes(&|rng, b| rng.fill_bytes(b)),
        bytes(&|rng, b| rand_core_0_6::RngCore::try_fill_bytes(rng, b).unwrap())
    );
}

#[test]
fn sample_numbers_run_on_over_halves() {
    let numbers = |needs: Needs| {
        let methods = dapple_core::Methods::from(uniform(1)).with_needs(needs);
        let mut session = Session::new(frame(1, 1), Limits::spp(7.0), methods).unwrap();
        let mut numbers = Vec::new();
        while let Some(round) = session.next_round().unwrap() {
            let mut tile = round.whole();
            let [(_, of_host)] = tile.pixels().collect::<Vec<_>>().try_into().unwrap();
            let of_part = tile.samples().map(|s| s.sample_number()).collect::<Vec<_>>();
            assert_eq!(of_host.collect::<Vec<_>>(), of_part);
            numbers.extend(of_part);
            tile.samples().for_each(|s| tile.add(&s, [1.0; 3]));
            round.submit(tile).unwrap();
        }
        numbers
    };
    assert_eq!(numbers(Needs::none()), [0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(numbers(Needs::none().with_halves()), [0, 1, 2, 3, 4, 5, 6]);
}

#[test]
fn a_cursor_that_owns_its_sample_outlives_it() {
    struct Host<'a>(Option<OwnedRng<'a>>);
    let points = Independent::new(4);
    let wanted: Vec<f32> = {
        let sample = Draws::new(&points, SampleId::new([7, 7], 1, 3));
        let mut rng = sample.rng();
        (0..9).map(|_| rng.next_f32()).collect()
    };
    let mut host = Host(None);
    {
        let sample = Draws::new(&points, SampleId::new([7, 7], 1, 3));
        host.0 = Some(sample.into_rng());
    }
    let mut rng = host.0.unwrap();
    assert_eq!((0..9).map(|_| rng.next_f32()).collect::<Vec<_>>(), wanted);
}

#[test]
fn a_generator_that_borrows_nothing_has_the_numbers_of_its_sample() {
    fn is_free<T: Send + 'static>(value: T) -> T {
        value
    }
    let points: std::sync::Arc<dyn PointSet> = std::sync::Arc::new(Independent::new(3));
    let ids = [SampleId::new([3, 5], 0, 12), SampleId::new([4, 5], 1, 0)];
    let mut rng = is_free(Draws::shared(points.clone(), ids[1]).into_rng());
    rng.next_f32();
    for id in ids {
        rng.start(id);
        let draws = Draws::new(&points, id);
        let mut other = draws.rng();
        (0..9).for_each(|_| assert_eq!(rng.next_u64(), other.next_u64()));
    }
}
