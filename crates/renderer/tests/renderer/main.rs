//! The renderer's integration tests: one program, since linking and instantiating takes longer than compiling a test.

mod bsdfs;
mod bundled_scenes;
mod camera;
mod coats;
mod densities;
mod determinism;
mod effects;
mod effects_without;
mod features;
mod files;
mod furnace;
mod lamps;
mod light_selection;
mod lights;
mod medium;
mod normals;
mod support;
mod textured_lights;
mod warps;
