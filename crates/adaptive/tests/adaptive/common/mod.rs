//! Integrators and samplers for the tests.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

use dapple_adaptive::{AdaptiveOptions, PilotPolicy};
use dapple_core::{
    Block, Draws, Error, Estimate, Feedback, Film, Frame, Integrator, Limits, Needs, Plan, PointSet, Progress, Render,
    Sampler, Worker,
};
use dapple_low_discrepancy::Random;

/// Grey or coloured radiance.
pub trait Radiance {
    fn rgb(self) -> [f32; 3];
}

impl Radiance for f32 {
    fn rgb(self) -> [f32; 3] {
        [self; 3]
    }
}

impl Radiance for [f32; 3] {
    fn rgb(self) -> [f32; 3] {
        self
    }
}

/// An integrator from a closure of the pixel and four numbers.
pub struct Field<F>(pub F);

impl<R: Radiance, F: Fn([u32; 2], [f32; 4]) -> R + Sync> Integrator for Field<F> {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let radiance = (self.0)(draws.pixel(), draws.block(Block::new(0))).rgb();
        Estimate::new(radiance)
    }
}

/// A sampler from a closure of the round and the samples so far.
pub struct Planned<F> {
    pub points: Random,
    pub needs: Needs,
    pub plan: F,
}

impl<F: FnMut(&Feedback<'_>, &mut Plan) -> Progress + Send> Sampler for Planned<F> {
    fn name(&self) -> &str {
        "planned"
    }

    fn needs(&self) -> Needs {
        self.needs
    }

    fn points(&self) -> &dyn PointSet {
        &self.points
    }

    fn next_round(&mut self, seen: &Feedback<'_>, plan: &mut Plan) -> Result<Progress, Error> {
        Ok((self.plan)(seen, plan))
    }
}

/// Options for images that are compared without a denoiser. Kept samples decide, which all pools and rounds allow.
pub fn options() -> AdaptiveOptions {
    AdaptiveOptions::default().policy(PilotPolicy::Keep).epsilon(0.01)
}

pub fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).unwrap()
}

pub fn run(
    integrator: &mut dyn Integrator,
    sampler: &mut dyn Sampler,
    frame: Frame,
    limits: &Limits,
) -> Result<Film, Error> {
    Render::new(frame, limits).run(integrator, sampler)
}

pub fn sum(counts: &[u32]) -> u64 {
    counts.iter().map(|&n| u64::from(n)).sum()
}
