//! Integration tests in one program, so that shared code is linked and instantiated once.

mod blurred;
mod bright_lamps;
mod buffers;
mod conformance;
mod consistency;
mod filters;
mod hard_cases;
mod lamp_edges;
mod layers;
mod lobes_and_tiles;
mod one_sample;
mod outside;
mod scales;
mod support;
