//! A choice among lights that is learned while an image is traced.

use crate::World;
use crate::light::{Expected, Lights};
use dapple_core::{TrainingData, TrainingLog};
use dapple_light_selection::{LightCellOptions, LightCells};
use glam::Vec3;

/// The cells of a world, and how far they have learned.
#[derive(Debug)]
pub(super) struct Guide {
    cells: LightCells,
    /// What is expected of each light.
    lights: Vec<Expected>,
    /// Lessons to come.
    passes: u32,
    /// A mistake for a test to find: light met by chance is weighted as if nothing had been learned.
    #[cfg(test)]
    pub(super) forgets: bool,
}

/// Not a cell: lights are chosen as they are without one.
pub(super) const NO_CELL: u32 = u32::MAX;

/// Lessons until enough is known: of 1, 1, 2 and 4 samples a pixel where the rounds are long enough.
const LESSONS: u32 = 4;

impl Guide {
    /// Cells over a world's box that expect of each light what it would give if nothing were in between. `None` where no
    /// choice is to be learned.
    pub(super) fn new(world: &World) -> Option<Self> {
        let bounds = world.geometry.bounds().filter(|_| world.lights.is_choice_learned())?;
        let lights = world.lights.expected();
        let options = LightCellOptions::default();
        // A box that is none leaves the choice as it is.
        let cells = LightCells::new(bounds.map(|b| b.to_array()), lights.len(), &options, expected(&lights)).ok()??;
        Some(Self {
            cells,
            lights,
            passes: LESSONS,
            #[cfg(test)]
            forgets: false,
        })
    }

    /// The cell of a point, lit on the side of `normal`.
    #[inline(always)]
    pub(super) fn cell(&self, position: Vec3, normal: Vec3) -> u32 {
        self.cells.cell(position.to_array(), normal.to_array())
    }

    /// The light that `u` chooses in a cell, and its probability.
    #[inline(always)]
    pub(super) fn choose(&self, cell: u32, u: f32) -> (u32, f32) {
        self.cells.sample(cell, u)
    }

    /// The probability of a light in a cell, or where there is none.
    #[inline(always)]
    pub(super) fn pmf(&self, lights: &Lights, cell: u32, light: u32) -> f32 {
        #[cfg(test)]
        if self.forgets {
            return lights.pmf(light);
        }
        if cell == NO_CELL { lights.pmf(light) } else { self.cells.pmf(cell, light) }
    }

    /// Notes down what a light contributed in a cell.
    #[inline(always)]
    pub(super) fn note(&self, observed: &mut TrainingLog, cell: u32, light: u32, contribution: Vec3) {
        if self.passes > 0 {
            observed.note(self.cells.key(cell, light), contribution.element_sum() * (1.0 / 3.0));
        }
    }

    pub(super) fn is_learning(&self) -> bool {
        self.passes > 0
    }

    pub(super) fn learn(&mut self, pass: &TrainingData) {
        let notes = pass.entries().iter().map(|e| (e.key, e.count, e.sum_of_squares));
        self.cells.learn(notes, expected(&self.lights));
        self.passes = self.passes.saturating_sub(1);
    }
}

/// What cells expect of lights: about the irradiance in the middle of a voxel.
fn expected(lights: &[Expected]) -> impl Fn([f32; 3], f32, [f32; 3], usize) -> f32 + Sync {
    |middle, half, axis, light| Expected::irradiance(&lights[light], Vec3::from(middle), half, Vec3::from(axis))
}
