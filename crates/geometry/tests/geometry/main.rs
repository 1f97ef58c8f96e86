//! Integration tests in one program, since each program that instantiates the trees takes long to compile.

mod exact;
mod instances;
mod leaving;
mod motion;
mod moving;
mod refused;
mod support;
mod thorough;
mod watertight;
