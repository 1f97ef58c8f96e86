//! Renders resumed from snapshots, and images made in shards.

use crate::common::{Field, Independent, everything, frame, mix, noise, on_threads, run};
use dapple_adaptive::Adaptive;
use dapple_conformance::bits;
use dapple_core::samplers::Uniform;
use dapple_core::{
    Block, Budget, Control, Draws, Error, Estimate, Film, FirstHit, Frame, Integrator, Limits, Monitor, Needs, Render,
    Sampler, Schedule, Shard, ShardFilm, Sharded, Snapshot, Status, TrainingData, Worker, merge,
};
use std::time::{Duration, Instant};

/// Learns while it wants_training, reports first hits, and now and then gives a bad sample.
#[derive(Default)]
pub(crate) struct Everything {
    pub(crate) learned: Vec<TrainingData>,
}

impl Integrator for Everything {
    fn estimate(&self, draws: &Draws<'_>, observed: &mut Worker) -> Estimate {
        let u = draws.block(Block::new(0));
        observed.note(u64::from(draws.pixel()[0] / 5), u[0]);
        let shift: f64 = self.learned.iter().flat_map(|o| o.entries()).map(|e| e.sum / e.count as f64).sum();
        let value = if u[3] < 0.01 { -1.0 } else { u[1] + shift as f32 };
        let first_hit = (u[2] > 0.2).then_some(
            FirstHit::new([u[0], u[1], u[2]], [0.0, 0.0, 1.0], u[0])
                .with_shading_normal([0.0, u[3], 1.0])
                .with_albedo([0.5, u[1], 0.25])
                .with_footprint(0.1)
                .with_material(3)
                .with_shape(5)
                .with_primitive(draws.pixel()[1]),
        );
        Estimate::new([value, u[2], 0.5]).with_first_hit(first_hit).with_cost(2 + draws.pixel()[0] % 3)
    }

    fn wants_training(&self) -> bool {
        self.learned.len() < 4
    }

    fn learn(&mut self, pass: &TrainingData) {
        self.learned.push(pass.clone());
    }
}

/// Keeps a snapshot of every slice, and of the end.
#[derive(Default)]
struct Keeper {
    slices: Vec<Vec<u8>>,
    end: Vec<u8>,
}

impl Monitor for Keeper {
    fn slice(&mut self, status: &Status<'_>) -> Control {
        self.slices.push(status.snapshot());
        Control::Continue
    }

    fn end(&mut self, status: &Status<'_>) {
        self.end = status.snapshot();
    }
}

fn uniform(seed: u64) -> Uniform<Independent> {
    Uniform::new(Independent::new(seed))
}

/// A render's film, and its snapshots.
fn kept(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
) -> (Film, Keeper) {
    let mut keeper = Keeper::default();
    let film = Render::new(frame, limits).needs(needs).monitor(&mut keeper).run(integrator, sampler).unwrap();
    (film, keeper)
}

fn go_on(
    bytes: &[u8],
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    needs: Needs,
    frame: Frame,
    limits: &Limits,
) -> Result<Film, Error> {
    Render::new(frame, limits).needs(needs).resume(Snapshot::from_bytes(bytes)?, integrator, sampler)
}

/// The pixels' statistics, without how they came about.
fn pixels(film: &Film) -> String {
    let one = |i| {
        let halves = (film.half(0, i), film.half(1, i), film.mean(i));
        format!(
            "{:?} {:?} {:?} {:?} {:?}",
            film.moments(i),
            halves,
            film.range(i),
            film.features(i),
            film.first_hits(i)
        )
    };
    (0..film.frame().pixels()).map(one).collect()
}

#[test]
fn a_render_resumed_on_other_threads_in_other_slices_is_the_same_x05() {
    // Large enough that slices of a training pass have some rows only.
    let frame = frame(90, 70);
    let mut limits = Limits::new(Budget::Recorded(vec![6300, 30_000, 30_000, 70_001]));
    let (film, keeper) = kept(&mut Everything::default(), &mut uniform(5), everything(), frame, &limits);
    let whole = bits(&film);
    assert!(film.record().rejected > 100 && film.record().rounds.len() == 3);
    let within = |bytes: &&Vec<u8>| !Snapshot::from_bytes(bytes).unwrap().film().record().samples.is_multiple_of(6300);
    assert!(keeper.slices.iter().filter(within).count() > 2, "slices go by rows");
    for (i, bytes) in keeper.slices.iter().chain([&keeper.end]).enumerate() {
        let (tile_rows, slice_spp, shuffle) = [(1, 0, 0), (16, 1, 5), (33, 7, 0), (7, 0, 9)][i % 4];
        limits.schedule = Schedule::default().with_tile_rows(tile_rows).with_slice_spp(slice_spp).with_shuffle(shuffle);
        let mut integrator = Everything::default();
        let film = on_threads(1 + i % 4, || {
            go_on(bytes, &mut integrator, &mut uniform(5), everything(), frame, &limits).unwrap()
        });
        assert!(bits(&film) == whole, "slice {i}");
        assert_eq!(integrator.learned.len(), 4);
    }
    // Negative control: an integrator without its training gives another image.
    struct Forgetful(Everything);
    impl Integrator for Forgetful {
        fn estimate(&self, draws: &Draws<'_>, observed: &mut Worker) -> Estimate {
            self.0.estimate(draws, observed)
        }
    }
    let last = keeper.slices.iter().rev().nth(1).unwrap();
    let film = go_on(last, &mut Forgetful(Everything::default()), &mut uniform(5), everything(), frame, &limits);
    assert!(bits(&film.unwrap()) != whole);
}

#[test]
fn a_snapshot_continues_with_a_larger_budget_x06() {
    let (frame, needs) = (frame(9, 8), everything());
    let draw = |limits: &Limits| kept(&mut Field(noise), &mut uniform(5), needs, frame, limits);
    for (first, all) in [(64 * 72, 128 * 72), (64 * 72 + 5, 128 * 72 + 61), (72, 73), (100, 130)] {
        let (first, mut all) = (Limits::samples(first), Limits::samples(all));
        let (at_once, _) = draw(&all);
        let (_, keeper) = draw(&first);
        all.schedule.slice_spp = 5;
        for bytes in keeper.slices.iter().chain([&keeper.end]) {
            let later = go_on(bytes, &mut Field(noise), &mut uniform(5), needs, frame, &all).unwrap();
            assert!(pixels(&later) == pixels(&at_once));
        }
        // A budget below the samples so far is refused, not ignored.
        let fewer = Limits::samples(71 + 1);
        let answer = go_on(&keeper.end, &mut Field(noise), &mut uniform(5), needs, frame, &fewer);
        match first.budget == fewer.budget {
            true => assert!(pixels(&answer.unwrap()).len() > 1),
            false => assert!(matches!(answer, Err(Error::OtherRender { .. }))),
        }
    }
}

#[test]
fn a_snapshot_of_another_render_is_refused_x04() {
    let limits = Limits::samples(40 * 72);
    let (_, keeper) = kept(&mut Field(noise), &mut uniform(5), Needs::none(), frame(9, 8), &limits);
    let bytes = &keeper.slices[0];
    let refused = |sampler: &mut dyn Sampler, needs, frame, limits: &Limits| match go_on(
        bytes,
        &mut Field(noise),
        sampler,
        needs,
        frame,
        limits,
    ) {
        Err(e @ Error::OtherRender { .. }) => e.to_string(),
        other => panic!("{other:?}"),
    };
    let none = Needs::none();
    let message = refused(&mut uniform(6), none, frame(9, 8), &limits);
    assert!(message.contains("the point set was independent:seed=5, not independent:seed=6"), "{message}");
    let message = refused(&mut Adaptive::variance(Independent::new(5)), none, frame(9, 8), &limits);
    assert!(
        message.contains("the sampler was uniform, not variance:") && message.contains("the sample variance was not"),
        "{message}"
    );
    let message = refused(&mut uniform(5), none, frame(8, 9), &limits);
    assert!(message.contains("9x8 pixels at 0,0 of 9x8, not 8x9 pixels"), "{message}");
    let message = refused(&mut uniform(5), none.with_halves(), frame(9, 8), &limits);
    assert!(message.contains("was one sequence, not two halves"), "{message}");
    let message = refused(&mut uniform(5), none, frame(9, 8), &limits.clone().with_min_spp(3));
    assert!(message.contains("was 1 to 4294967295, not 3 to 4294967295"), "{message}");
    let message = refused(&mut uniform(5), none, frame(9, 8), &Limits::new(Budget::Recorded(vec![72, 2880])));
    assert!(message.contains("not those of the record"), "{message}");
    // Positive control.
    assert!(go_on(bytes, &mut Field(noise), &mut uniform(5), none, frame(9, 8), &limits).is_ok());
}

#[test]
fn bytes_that_are_not_a_snapshot_are_refused_x03() {
    let limits = Limits::new(Budget::Recorded(vec![100, 200]));
    let mut sampler = Adaptive::variance(Independent::new(5));
    let (_, keeper) = kept(&mut Everything::default(), &mut sampler, everything(), frame(7, 5), &limits);
    let part = ShardFilm::new(
        Shard::new(0, 1).unwrap(),
        &run(&mut Field(noise), &mut uniform(1), everything(), frame(7, 5), &limits).unwrap(),
    )
    .unwrap();
    for bytes in [&keeper.slices[1], &keeper.end, &part.to_bytes()] {
        let read =
            |bytes: &[u8]| Snapshot::from_bytes(bytes).map(drop).or_else(|_| ShardFilm::from_bytes(bytes).map(drop));
        read(bytes).unwrap();
        for length in 0..bytes.len() {
            assert!(matches!(read(&bytes[..length]), Err(Error::BadSnapshot { .. })), "{length} bytes");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert!(read(&longer).is_err());
        let mut old = bytes.clone();
        old[8] ^= 1;
        assert!(
            Snapshot::from_bytes(&old).unwrap_err().to_string().contains("another version")
                || ShardFilm::from_bytes(&old).unwrap_err().to_string().contains("another version")
        );
        // Damage that a checksum would find must do no harm without one: an error, or a render that ends.
        for k in 0..3000_u64 {
            let mut bytes = bytes.clone();
            let bit = mix(k) as usize % (8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
            if let Ok(snapshot) = Snapshot::from_bytes(&bytes) {
                let frame = *snapshot.film().frame();
                let mut sampler = Adaptive::variance(Independent::new(5));
                let _ = Render::new(frame, &limits).needs(everything()).resume(
                    snapshot,
                    &mut Everything::default(),
                    &mut sampler,
                );
            }
            if let Ok(part) = ShardFilm::from_bytes(&bytes) {
                let _ = merge(&[part]);
            }
        }
    }
}

#[test]
fn shards_make_the_image_of_one_machine_x07() {
    for (size, of, needs, total) in
        [([23, 17], 3, everything(), 33 * 391 + 7), ([5, 4], 4, Needs::none(), 1000), ([1, 1], 1, everything(), 8)]
    {
        let (frame, limits) = (frame(size[0], size[1]), Limits::samples(total));
        let field = || Field(|p: [u32; 2], u: [f32; 4]| if u[3] < 0.05 { [f32::NAN; 3] } else { noise(p, u) });
        let whole = run(&mut field(), &mut uniform(5), needs, frame, &limits).unwrap();
        let part = |index: u32| {
            let shard = Shard::new(index, of).unwrap();
            let mut inner = uniform(5);
            let mut sampler = Sharded::new(&mut inner, shard, &limits).unwrap();
            let (film, keeper) = kept(&mut field(), &mut sampler, needs, frame, &limits);
            // An interrupted machine resumes.
            let mut inner = uniform(5);
            let mut sampler = Sharded::new(&mut inner, shard, &limits).unwrap();
            let resumed = go_on(&keeper.slices[0], &mut field(), &mut sampler, needs, frame, &limits).unwrap();
            assert!(bits(&resumed) == bits(&film));
            let bytes = ShardFilm::new(shard, &film).unwrap().to_bytes();
            ShardFilm::from_bytes(&bytes).unwrap()
        };
        let mut parts: Vec<ShardFilm> = (0..of).map(part).collect();
        parts.rotate_left(1);
        assert!(bits(&merge(&parts).unwrap()) == bits(&whole), "{size:?}");
    }
}

#[test]
fn shards_that_do_not_make_an_image_are_refused_x07() {
    let limits = Limits::samples(8 * 12);
    let part = |index, of, size: [u32; 2], needs, limits: &Limits| {
        let mut inner = uniform(5);
        let shard = Shard::new(index, of).unwrap();
        let mut sampler = Sharded::new(&mut inner, shard, limits).unwrap();
        let film = run(&mut Field(noise), &mut sampler, needs, frame(size[0], size[1]), limits).unwrap();
        ShardFilm::new(shard, &film).unwrap()
    };
    let none = Needs::none();
    let of = |index| part(index, 3, [3, 4], none, &limits);
    let cases = [
        (vec![], "the list is empty"),
        (vec![of(0), of(2)], "missing shards: 2/3"),
        (vec![of(2)], "missing shards: 1/3, 2/3"),
        (vec![of(0), of(1), of(2), of(1)], "shard 2/3 is given twice"),
        (
            vec![of(0), part(1, 2, [3, 4], none, &limits), of(2)],
            "shard 2/2 does not belong to shard 1/3: it is of another number of shards",
        ),
        (vec![of(0), part(1, 3, [4, 3], none, &limits), of(2)], "of another window"),
        (vec![of(0), part(1, 3, [3, 4], none.with_variance(), &limits), of(2)], "it records other statistics"),
        (vec![of(0), part(1, 3, [3, 4], none, &Limits::samples(97)), of(2)], "it has another budget"),
    ];
    for (parts, expected) in cases {
        let message = merge(&parts).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    assert!(merge(&[of(2), of(0), of(1)]).is_ok());
    // A sampler that reads samples, a limit of time, an interrupted shard.
    let shard = Shard::new(0, 2).unwrap();
    let refused = |sampler: &mut dyn Sampler, limits: &Limits| {
        Sharded::new(sampler, shard, limits).map(drop).unwrap_err().to_string()
    };
    assert!(
        refused(&mut Adaptive::variance(Independent::new(5)), &limits).contains("sampler \"variance\" cannot be split")
    );
    assert!(refused(&mut uniform(5), &Limits::seconds(1.0)).contains("must know the number of samples"));
    let mut stop = |_: &Status<'_>| Control::Stop;
    let mut slices = Limits::samples(8 * 12);
    slices.schedule.slice_spp = 1;
    let film = Render::new(frame(3, 4), &slices).monitor(&mut stop).run(&mut Field(noise), &mut uniform(5)).unwrap();
    assert!(ShardFilm::new(shard, &film).unwrap_err().to_string().contains("was interrupted"));
    assert!(Shard::new(2, 2).is_err() && Shard::new(0, 0).is_err());
}

/// Takes its time: a millisecond a sample, so that one of every pixel takes seconds.
struct Slow;

impl Integrator for Slow {
    fn estimate(&self, _: &Draws<'_>, _: &mut Worker) -> Estimate {
        std::thread::sleep(Duration::from_millis(1));
        Estimate::new([1.0; 3])
    }
}

#[test]
fn a_slow_image_is_stopped_within_a_pass_x08() {
    let start = Instant::now();
    let (mut last, mut longest) = (start, Duration::ZERO);
    let mut monitor = |_: &Status<'_>| {
        longest = longest.max(last.elapsed());
        last = Instant::now();
        if start.elapsed().as_secs_f64() > 2.0 { Control::Stop } else { Control::Continue }
    };
    // One sample of every pixel takes 10 s on two threads.
    let film = on_threads(2, || {
        Render::new(frame(200, 100), &Limits::samples(20_000))
            .monitor(&mut monitor)
            .run(&mut Slow, &mut uniform(1))
            .unwrap()
    });
    assert!(film.record().interrupted && film.record().samples > 200);
    assert!(longest < Duration::from_secs(2), "{longest:?}");
}

/// A crop that learns from the training passes of the whole image has the whole image's bits.
#[test]
fn a_crop_learns_from_the_whole_images_training_passes() {
    let whole = frame(40, 35);
    let window = whole.crop(7, 18, 29, 33).unwrap();
    for (spp, passes) in [(3, 3), (13, 4)] {
        let limits = Limits::spp(f64::from(spp));
        let film = Render::new(whole, &limits).run(&mut Everything::default(), &mut Uniform::new(Independent::new(3)));
        let film = film.unwrap();
        let train = |limits: &Limits| {
            Render::new(whole, limits)
                .train(&mut Everything::default(), &mut Uniform::new(Independent::new(3)))
                .unwrap()
        };
        let training = train(&limits).expect("no monitor stops it");
        assert_eq!(training.len(), passes);
        let crop = |training: Vec<TrainingData>| {
            let mut sampler = Uniform::new(Independent::new(3));
            Render::new(window, &limits).learn_from(training).run(&mut Everything::default(), &mut sampler).unwrap()
        };
        let cut = |film: &Film| -> Vec<[f32; 3]> {
            let row = |y: usize| film.image()[y * 40 + 7..y * 40 + 29].to_vec();
            (18..33).flat_map(row).collect()
        };
        assert_eq!(crop(training).image(), cut(&film), "{spp}");
        assert_ne!(crop(Vec::new()).image(), cut(&film), "a crop learns something else by itself");
    }
    // A stop leaves no passes.
    let mut stop = |_: &Status<'_>| Control::Stop;
    let limits = Limits::spp(4.0);
    let render = Render::new(whole, &limits).monitor(&mut stop);
    let stopped = render.train(&mut Everything::default(), &mut Uniform::new(Independent::new(3)));
    assert_eq!(stopped.unwrap(), None);
}
