//! Integration tests in one program, since each program that instantiates the trees takes long to compile.

mod exact;
mod instances;
mod leaving;
mod motion;
mod support;
mod watertight;
