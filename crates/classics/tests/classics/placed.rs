//! Samples that a sampler places: the placed coordinates, all others the inner set's, through snapshots and for filters.

use crate::support::{Points, frame, random};
use dapple_classics::{Axis, Domain, FilmPoints, Placed, PlacedHandle, Role};
use dapple_core::point_set::{mix, streams};
use dapple_core::{Error, Frame, PointSet as _, SampleId};

fn domain() -> Domain {
    let axes = [(Role::Place, 0, 0), (Role::Place, 0, 1), (Role::Lens, 0, 3), (Role::Time, 9, 2)];
    Domain::new(axes.map(|(role, block, lane)| Axis::new(role, block, lane))).unwrap()
}

/// The coordinates of a sample that is placed.
fn hashed(id: SampleId) -> [f32; 4] {
    let name = u64::from(id.pixel[0]) | u64::from(id.pixel[1]) << 20 | id.index << 40 | u64::from(id.stream) << 60;
    [0, 1, 2, 3].map(|axis| (mix(mix(name) ^ axis) >> 40) as f32 / (1 << 24) as f32)
}

/// All samples of the first three rounds of a sampler, with the filters' view of them.
fn placed(frame: &Frame) -> (Placed<Points>, PlacedHandle) {
    let mut points = Placed::new(random(3), domain());
    let handle = points.handle();
    for (x, y, index) in (0..4).flat_map(|x| (0..3).flat_map(move |y| [0, 2, 3].map(|index| (x, y, index)))) {
        let id = SampleId::new([x + 7, y + 1], streams::HALVES[0], index);
        points.add(frame, id, &hashed(id)).unwrap();
    }
    (points, handle)
}

#[test]
fn only_the_placed_lanes_of_placed_samples_differ_from_the_inner_set() {
    let window = frame([20, 10]).crop(7, 1, 11, 4).unwrap();
    let (mut points, handle) = placed(&window);
    points.publish();
    let inner = random(3);
    let film = FilmPoints::new(inner.clone(), domain()).with_placed(Some(handle)).now();
    let mut changed = 0;
    for (x, y, stream) in (5..13).flat_map(|x| (0..6).flat_map(move |y| (0..6).map(move |s| (x, y, s)))) {
        for (index, block) in (0..6).flat_map(|index| [0, 1, 8, 9, 10].map(|block| (index, block))) {
            let id = SampleId::new([x, y], stream, index);
            let (found, plain) = (points.block(id, block), inner.block(id, block));
            assert!(found.iter().all(|u| (0.0..1.0).contains(u)), "{id:?}: {found:?}");
            assert_eq!(film.block(id, block), found, "a filter sees other points");
            let inside = (7..11).contains(&x) && (1..4).contains(&y) && stream == streams::HALVES[0];
            let expected = match (inside && [0, 2, 3].contains(&index), block) {
                (true, 0) => [hashed(id)[0], hashed(id)[1], plain[2], hashed(id)[2]],
                (true, 9) => [plain[0], plain[1], hashed(id)[3], plain[3]],
                _ => plain,
            };
            assert_eq!(found.map(f32::to_bits), expected.map(f32::to_bits), "{id:?}, block {block}");
            changed += u32::from(found != plain);
        }
    }
    assert_eq!(changed, 4 * 3 * 3 * 2);
    assert_eq!(points.describe(), format!("placed({})", random(3).describe()));
}

#[test]
fn coordinates_are_clamped_below_one() {
    let (frame, mut points) = (frame([1, 1]), Placed::new(random(1), domain()));
    let id = SampleId::new([0, 0], streams::WHOLE, 0);
    points.add(&frame, id, &[1.0, -0.5, f32::NAN, 7.0]).unwrap();
    let [u, v, _, lens] = points.block(id, 0);
    assert_eq!([u, v, lens], [1.0 - f32::EPSILON / 2.0, 0.0, 0.0]);
    assert!(points.block(id, 9)[2] < 1.0);
}

#[test]
fn samples_are_placed_once_in_order_and_within_the_frame() {
    let (frame, mut points) = (frame([2, 2]), Placed::new(random(1), domain()));
    let mut add = |pixel, stream, index, axes: usize| {
        points.add(&frame, SampleId::new(pixel, stream, index), &[0.5; 8][..axes]).is_ok()
    };
    let [whole, discarded] = [streams::WHOLE, streams::DISCARDED];
    for (pixel, stream, index, axes, fits) in [
        ([1, 1], whole, 3, 4, true),
        ([1, 1], whole, 3, 4, false),
        ([1, 1], whole, 0, 4, false),
        ([2, 1], whole, 0, 4, false),
        ([0, 0], discarded, 0, 4, false),
        ([0, 0], whole, 0, 3, false),
        ([1, 1], whole, 4, 4, true),
    ] {
        assert_eq!(add(pixel, stream, index, axes), fits, "{pixel:?}, {stream}, {index}, {axes}");
    }
}

#[test]
fn saved_samples_are_restored_and_damaged_bytes_refused() {
    let window = frame([20, 10]).crop(7, 1, 11, 4).unwrap();
    let (points, _) = placed(&window);
    let mut other = Placed::new(random(3), domain());
    let saved = points.save();
    other.restore(&saved).unwrap();
    let id = SampleId::new([8, 2], streams::HALVES[0], 2);
    assert_eq!((other.block(id, 0), other.save()), (points.block(id, 0), saved.clone()));
    for end in 1..saved.len() {
        assert!(matches!(other.restore(&saved[..end]), Err(Error::BadSnapshot { .. })), "{end} bytes");
    }
    let mut damaged = saved;
    damaged.push(0);
    assert!(matches!(other.restore(&damaged), Err(Error::BadSnapshot { .. })));
    other.restore(&[]).unwrap();
    assert_eq!(other.block(id, 0), random(3).block(id, 0));
}

#[test]
fn domains_have_two_coordinates_of_the_place_first_and_no_lane_twice() {
    let [u, v] = [0, 1].map(|lane| Axis::new(Role::Place, 0, lane));
    let lens = Axis::new(Role::Lens, 0, 2);
    assert!(Domain::new([u, v]).is_ok() && Domain::new([u, v, lens]).is_ok());
    let beyond = Axis::new(Role::Time, 0, 4);
    for wrong in [&[][..], &[u], &[u, lens], &[lens, u, v], &[u, v, lens, lens], &[u, v, v], &[u, v, beyond]] {
        assert!(Domain::new(wrong.iter().copied()).is_err(), "{wrong:?}");
    }
    assert_eq!(Domain::new([u, v]).unwrap().with_outside("glossy paths").outside(), Some("glossy paths"));
}
