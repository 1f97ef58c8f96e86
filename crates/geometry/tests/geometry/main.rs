//! Rays against shapes: one program, for each that instantiates the trees takes as long to compile as all do.

mod exact;
mod instances;
mod leaving;
mod motion;
mod moving;
mod refused;
mod support;
mod thorough;
mod watertight;
