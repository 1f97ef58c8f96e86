//! Every set passes the conformance tests of the core for several seeds.

use dapple_conformance::point_set;
use dapple_low_discrepancy::{Halton, LowDiscrepancy, Random, Sobol, Stratified};

#[test]
fn random_conforms() {
    point_set(&Random::new(0));
    point_set(&Random::new(1));
}

#[test]
fn stratified_conforms() {
    point_set(&Stratified::new(0, 4).unwrap());
    point_set(&Stratified::new(1, 9).unwrap());
}

#[test]
fn halton_conforms() {
    point_set(&Halton::new(0));
}

#[test]
fn sobol_conforms() {
    point_set(&Sobol::new(0));
    point_set(&Sobol::new(1));
    point_set(&Sobol::new(u64::MAX));
}

#[test]
fn lowdiscrepancy_conforms() {
    point_set(&LowDiscrepancy::new(0, 16).unwrap());
    point_set(&LowDiscrepancy::new(1, 64).unwrap());
}
