//! Selection of the light that a path samples at a vertex.

use crate::World;
use crate::light::{Expectation, Lights, SelectedLight};
use dapple_core::Worker;
use dapple_core::integrator::{TrainingData, TrainingSum};
use dapple_light_selection::{LightCellOptions, LightCells};
use glam::Vec3;

/// A distribution over the lights of a world. It may depend on the position and be learned while rendering.
///
/// It is a type parameter of [`PathTracer`](super::PathTracer), so that fixed distributions carry no code for learned
/// ones. The default methods are those of [`FixedSelector`].
pub trait LightSelector: Sync {
    /// The key of the distribution that a point uses, such as a cell of space.
    type Place: Copy;
    /// The key for points without a distribution of their own, such as points inside media.
    const NOWHERE: Self::Place;

    /// Makes the selector for the light selection that is set in `world`.
    fn of(world: &World) -> Self;

    /// Returns the key of the distribution for a point lit from the side of `normal`.
    #[inline(always)]
    fn place(&self, _position: Vec3, _normal: Vec3) -> Self::Place {
        Self::NOWHERE
    }

    /// Selects a light from the distribution at `place` by a random number `u` in `[0, 1)`. Returns `None` if the scene has no
    /// light.
    #[inline(always)]
    fn select(&self, lights: &Lights, _place: Self::Place, u: f32) -> Option<SelectedLight> {
        lights.select(u)
    }

    /// Returns the probability with which [`select`](Self::select) returns `light` from the distribution at `place`.
    #[inline(always)]
    fn pmf(&self, lights: &Lights, _place: Self::Place, light: u32) -> f32 {
        lights.pmf(light)
    }

    /// Records the contribution of a selected light for learning. The default does nothing.
    #[inline(always)]
    fn record(&self, _training: &mut Worker, _place: Self::Place, _light: SelectedLight, _contribution: Vec3) {}

    /// Returns true while the selector needs training passes; see
    /// [`Integrator::wants_training`](dapple_core::Integrator::wants_training).
    fn wants_training(&self) -> bool {
        false
    }

    /// Returns the largest memory in bytes for learning, including training data. `pixels` is the number of pixels, and `notes`
    /// the largest number of lights recorded per sample.
    fn training_memory(&self, _pixels: u64, _notes: u64) -> u64 {
        0
    }

    /// Learns from the contributions recorded in one training pass; see
    /// [`Integrator::learn`](dapple_core::Integrator::learn).
    fn learn(&mut self, _pass: &TrainingData) {}
}

/// A selector with the same distribution everywhere: the distribution of [`Lights::select`].
#[derive(Clone, Copy, Debug)]
pub struct FixedSelector;

impl LightSelector for FixedSelector {
    type Place = ();
    const NOWHERE: () = ();

    fn of(_: &World) -> Self {
        Self
    }
}

/// A selector with one light distribution per cell of position and orientation, learned from the first samples of a render.
///
/// Behaves like [`FixedSelector`] unless the world is set to learned light selection and has several lights.
#[derive(Debug)]
pub struct LearnedSelector {
    cells: Option<LightCells>,
    /// The approximate contribution of each light, used before contributions are measured.
    expectations: Vec<Expectation>,
    passes_left: u32,
    /// Test switch that injects an error: light found by BSDF sampling is weighted with unlearned probabilities.
    #[cfg(test)]
    pub(super) forgets: bool,
}

/// The key for points outside all cells, which use the fixed distribution.
const NO_CELL: u32 = u32::MAX;

/// The number of training passes. They take 1, 1, 2 and 4 samples per pixel if rendering rounds are long enough.
const TRAINING_PASSES: u32 = 4;

impl LightSelector for LearnedSelector {
    type Place = u32;
    const NOWHERE: u32 = NO_CELL;

    fn of(world: &World) -> Self {
        let expectations = world.lights.expectations();
        let bounds = world.geometry.bounds().filter(|_| world.lights.is_selection_learned());
        let cells = bounds.and_then(|bounds| {
            let options = LightCellOptions::default();
            // If the bounds are invalid or there are too few or too many lights, the selection stays fixed.
            LightCells::new(bounds.map(|b| b.to_array()), expectations.len(), &options, first_guess(&expectations))
                .ok()
                .flatten()
        });
        Self {
            passes_left: if cells.is_some() { TRAINING_PASSES } else { 0 },
            cells,
            expectations,
            #[cfg(test)]
            forgets: false,
        }
    }

    #[inline(always)]
    fn place(&self, position: Vec3, normal: Vec3) -> u32 {
        self.cells.as_ref().map_or(NO_CELL, |cells| cells.cell(position.to_array(), normal.to_array()))
    }

    #[inline(always)]
    fn select(&self, lights: &Lights, cell: u32, u: f32) -> Option<SelectedLight> {
        match &self.cells {
            Some(cells) if cell != NO_CELL => {
                let (index, pmf) = cells.sample(cell, u);
                Some(SelectedLight { index, pmf })
            }
            _ => lights.select(u),
        }
    }

    #[inline(always)]
    fn pmf(&self, lights: &Lights, cell: u32, light: u32) -> f32 {
        #[cfg(test)]
        if self.forgets {
            return lights.pmf(light);
        }
        match &self.cells {
            Some(cells) if cell != NO_CELL => cells.pmf(cell, light),
            _ => lights.pmf(light),
        }
    }

    #[inline(always)]
    fn record(&self, training: &mut Worker, cell: u32, light: SelectedLight, contribution: Vec3) {
        if let Some(cells) = &self.cells
            && self.passes_left > 0
        {
            training.note(cells.key(cell, light.index), contribution.element_sum() * (1.0 / 3.0));
        }
    }

    fn wants_training(&self) -> bool {
        self.passes_left > 0
    }

    fn training_memory(&self, pixels: u64, notes: u64) -> u64 {
        let Some(cells) = &self.cells else { return 0 };
        let keys = (cells.cells() * cells.lights()) as u64;
        // Passes take 1, 1, 2, 4 samples per pixel.
        let in_pass = |pass: u32| pixels.saturating_mul(notes).saturating_mul(1 << pass.saturating_sub(1));
        let data = (0..TRAINING_PASSES).map(|pass| in_pass(pass).min(keys) * size_of::<TrainingSum>() as u64);
        let all = pixels.saturating_mul(notes).saturating_mul(1 << (TRAINING_PASSES - 1));
        data.sum::<u64>() + cells.memory(all)
    }

    fn learn(&mut self, pass: &TrainingData) {
        if let Some(cells) = &mut self.cells {
            let notes = pass.entries().iter().map(|e| (e.key, e.count, e.sum_of_squares));
            cells.learn(notes, first_guess(&self.expectations));
            self.passes_left = self.passes_left.saturating_sub(1);
        }
    }
}

/// Returns a function that estimates the irradiance from a light at the centre of a cell. Its arguments are the cell's centre,
/// half width and axis, and the light's index.
fn first_guess(lights: &[Expectation]) -> impl Fn([f32; 3], f32, [f32; 3], usize) -> f32 + Sync {
    |middle, half, axis, light| lights[light].irradiance(Vec3::from(middle), half, Vec3::from(axis))
}
