//! Integration tests in one program, so that shared code is linked and instantiated once.

mod buffers;
mod conformance;
mod consistency;
mod filters;
mod fireflies;
mod hard_cases;
mod lamps;
mod layers;
mod support;
mod warnings;
