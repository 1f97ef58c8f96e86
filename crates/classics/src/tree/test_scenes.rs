//! Functions of place, lens and time, as scenes for tests.

use crate::recorders::Singles;
use crate::{Axis, Domain, FilmPoints, PlacedHandle, Role};
use dapple_core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, PointSet, Render, Sampler, Worker};
use std::sync::Arc;

/// Radiance by the place in the image and by lens (two coordinates), time, and a coordinate outside the domain.
pub(crate) type Made = fn([f32; 2], [f32; 4]) -> f32;

struct Scene(Made);

impl Integrator for Scene {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let ([x, y], [u, v, ..]) = (draws.pixel().map(|n| n as f32), draws.block(Block::new(0)));
        Estimate::new([(self.0)([x + u, y + v], draws.block(Block::new(1))); 3])
    }
}

/// The place, and these axes: two of the lens, one of the time.
pub(crate) fn domain(roles: &[Role]) -> Domain {
    let place = [0, 1].map(|lane| Axis::new(Role::Place, 0, lane));
    let mut lens = 0;
    let rest = roles.iter().map(|&role| {
        let lane = if role == Role::Time { 2 } else { lens };
        lens += u8::from(role != Role::Time);
        Axis::new(role, 1, lane)
    });
    Domain::new(place.into_iter().chain(rest)).unwrap()
}

pub(crate) fn film_points(points: impl PointSet + 'static, roles: &[Role], placed: Option<PlacedHandle>) -> FilmPoints {
    FilmPoints::new(Arc::new(points), domain(roles)).with_placed(placed)
}

/// The film of a function, with all samples.
pub(crate) fn render(made: Made, sampler: &mut dyn Sampler, [width, height]: [u32; 2], spp: f64) -> Film {
    let frame = Frame::new(width, height).unwrap();
    Render::new(frame, &Limits::spp(spp)).recorders(Singles::ALL.list()).run(&mut Scene(made), sampler).unwrap()
}
