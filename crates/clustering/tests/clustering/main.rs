//! Integration tests in one program, so that shared code is linked and instantiated once.

mod first_fit;
mod hard_cases;
mod soups;
mod support;
mod thesis;
