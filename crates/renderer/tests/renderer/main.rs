//! The renderer's integration tests: one program, since linking and instantiating takes longer than compiling a test.
//!
//! Tests of time or memory, and the corpus of the fuzz targets, are separate programs.

mod bundled_closed_forms;
mod camera_rays;
mod determinism;
mod effects_called;
mod effects_without;
mod features;
mod furnace;
mod indirect;
mod l14_effects;
mod lens_and_shutter;
mod lights_cells;
mod lights_chi_square;
mod lights_choice;
mod lights_closed;
mod lights_emission;
mod lights_punctual;
mod lights_sides;
mod medium;
mod medium_absorbing;
mod models;
mod normals;
mod odd_images;
mod references_own;
mod references_pbrt;
mod scattering;
mod shading_bsdfs;
mod shading_coat;
mod shading_glass;
mod shading_glossy;
mod shading_metal_coat;
mod shading_warps;
mod statistics;
mod support;
