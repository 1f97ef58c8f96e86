//! Every set passes the conformance tests of the core for several seeds.

use dapple_conformance::point_set;
use dapple_low_discrepancy::{
    BlueNoise, BlueNoiseKeys, Diffused, Halton, Lattice, LowDiscrepancy, Mitchell1991, Pmj02, Random, Sobol,
    Stratified, ZSobol,
};

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

#[test]
fn zsobol_conforms() {
    point_set(&ZSobol::new(0, 1).unwrap());
    point_set(&ZSobol::new(1, 16).unwrap());
    point_set(&ZSobol::new(2, 32).unwrap());
}

#[test]
fn blue_noise_conforms() {
    point_set(&BlueNoise::new(0, Sobol::new(0)));
    point_set(&BlueNoise::new(1, Halton::new(1)));
    point_set(&BlueNoise::new(2, Stratified::new(2, 4).unwrap()));
}

#[test]
fn blue_noise_keys_conform() {
    point_set(&BlueNoiseKeys::new(0));
    point_set(&BlueNoiseKeys::new(u64::MAX));
}

#[test]
fn pmj02_conforms() {
    point_set(&Pmj02::new(0));
    point_set(&Pmj02::new(1).with_independent_pixels());
}

#[test]
fn lattice_conforms() {
    point_set(&Lattice::new(0));
    point_set(&Lattice::new(1));
}

#[test]
fn diffused_conforms() {
    point_set(&Diffused::new(0));
}

#[test]
fn mitchell_1991_conforms() {
    point_set(&Mitchell1991::new(0));
}
