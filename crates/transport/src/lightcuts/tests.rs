//! Common cuts of clusters: the same light from fewer visited nodes.
#![allow(clippy::print_stderr, reason = "figures of a slow test")]

use super::common::grid;
use super::{CutLight, CutSum, LightcutOptions, Lit, Refinement, luminance};
use crate::patches::Division;
use crate::support::bundle;
use dapple_core::samplers::Uniform;
use dapple_core::{Draws, Estimate, Frame, Integrator, Limits, Options as _, Pass, Prepared, Prepares, Render, Worker};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{VertexLight, World};

/// Calls a function with the first pass of a render.
struct InPass<F>(F);

impl<F: FnMut(&Pass<'_>) + Sync> Integrator for InPass<F> {
    fn estimate(&self, _: &Draws<'_>, _: &mut Worker) -> Estimate {
        Estimate::new([0.0; 3])
    }

    fn prepares(&self) -> Prepares {
        Prepares::Once
    }

    fn prepare(&mut self, pass: &Pass<'_>) -> Prepared {
        (self.0)(pass);
        Prepared::default()
    }
}

fn prepared<'w>(world: &'w World, options: &str, pass: &Pass<'_>) -> CutLight<'w> {
    let options = LightcutOptions::parse(options).expect("options");
    let division = (options.clusters > 0).then(|| Division::new(world, options.clusters).expect("pieces"));
    let mut light = CutLight::new(world, options, division);
    light.prepare(pass);
    light
}

/// The cuts at points that no probe met, with their numbers of groups.
fn sized_cuts(light: &CutLight<'_>, frame: &Frame) -> Vec<(CutSum, usize)> {
    let mut made = Refinement::default();
    let cut = |pixel| {
        light.at_first_hit(pixel, |vertex| {
            let start = light.common.as_ref().map_or(&[][..], |common| common.at(light.world, vertex));
            let cut = light.cut(&Lit::new(vertex, 0), start, &mut made);
            (cut, made.members.len())
        })
    };
    grid(frame, 23).filter_map(cut).collect()
}

fn cuts(light: &CutLight<'_>, frame: &Frame) -> Vec<CutSum> {
    sized_cuts(light, frame).into_iter().map(|(cut, _)| cut).collect()
}

#[test]
fn common_cuts_leave_the_light_and_visit_fewer_nodes() {
    in_pass(compare);
}

/// Calls a function with the scene `many-lights` and the first pass of a render.
fn in_pass(call: fn(&World, &Pass<'_>)) {
    let world = bundle("many-lights", [96, 72]);
    let frame = Frame::new(96, 72).expect("a frame");
    let limits = Limits::samples(frame.pixels() as u64);
    let mut integrator = InPass(|pass: &Pass<'_>| call(&world, pass));
    Render::new(frame, &limits).run(&mut integrator, &mut Uniform::new(Sobol::new(1))).expect("a film");
}

/// The mean sizes of cuts and their errors on 10,000 emitters; see docs/results/transport.md.
#[test]
#[ignore = "a minute: cargo test --release -p dapple-transport --lib sizes_of_cuts -- --ignored --nocapture"]
fn sizes_of_cuts() {
    in_pass(|world, pass| {
        let exact = cuts(&prepared(world, "error=0,cut=100000", pass), &pass.frame);
        for options in ["error=0.02,cut=100000", "error=0.02", "error=0.05", "error=0.1", "error=0.02,clusters=1000"] {
            let light = prepared(world, options, pass);
            let found = sized_cuts(&light, &pass.frame);
            let of = |value: fn(&(CutSum, usize)) -> f64| found.iter().map(value).sum::<f64>() / found.len() as f64;
            let sizes = of(|(_, size)| *size as f64);
            let [rays, visited] = [of(|(cut, _)| f64::from(cut.rays)), of(|(cut, _)| f64::from(cut.visited))];
            let errors = found
                .iter()
                .zip(&exact)
                .map(|((a, _), b)| f64::from(luminance(a.light) / luminance(b.light) - 1.0).powi(2));
            let error = (errors.filter(|e| e.is_finite()).sum::<f64>() / found.len() as f64).sqrt();
            eprintln!(
                "{options}: {sizes:.0} groups, {rays:.0} rays, {visited:.0} nodes, {error:.4} of the light (rms)"
            );
        }
    });
}

fn compare(world: &World, pass: &Pass<'_>) {
    let frame = pass.frame;
    let plain = prepared(world, "cut=400", pass);
    let common = prepared(world, "cut=400,clusters=200", pass);
    let (one, other) = (cuts(&plain, &frame), cuts(&common, &frame));
    assert!(one.len() == other.len() && one.len() > 300, "{} points", one.len());
    let sum = |cuts: &[CutSum], of: fn(&CutSum) -> u32| cuts.iter().map(|cut| f64::from(of(cut))).sum::<f64>();
    let [visited, rays] =
        [|cut: &CutSum| cut.visited, |cut: &CutSum| cut.rays].map(|of| sum(&other, of) / sum(&one, of));
    let difference = |others: &[CutSum]| {
        let pairs = one.iter().zip(others).map(|(a, b)| (luminance(b.light) / luminance(a.light) - 1.0).abs());
        pairs.filter(|d| d.is_finite()).map(f64::from).sum::<f64>() / one.len() as f64
    };
    assert!(visited < 0.9, "{visited} of the nodes");
    assert!((0.9..1.1).contains(&rays), "{rays} of the rays");
    assert!(difference(&other) < 0.02, "a mean difference of {}", difference(&other));
    // Negative control: cuts of one group.
    let coarse = cuts(&prepared(world, "cut=1", pass), &frame);
    assert!(difference(&coarse) > 0.05, "the test sees nothing: {}", difference(&coarse));
}
