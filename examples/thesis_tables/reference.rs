//! References, kept on disk.

use crate::Result;
use crate::measure::{Plan, errors};
use dapple::core::{Frame, Limits, Render};
use dapple::job::registry::{self, MethodInputs};
use dapple::renderer::{World, integrator};
use dapple::scene::image::{Encoding, Image, encode_pfm, read_image, write_file};
use dapple_scene::bundled::Bundle;
use std::path::Path;

/// A point set that no method of the tables uses (asides do, with other seeds), and two unused seeds.
pub(crate) const POINTS: &str = "sobol";
const SEEDS: [u64; 2] = [1001, 1002];

/// A reference image.
pub(crate) struct Reference {
    pub(crate) pixels: Vec<[f32; 3]>,
    /// The reference's own errors, one of each kind: a quarter of the squared difference of its two halves.
    pub(crate) own: [f64; 2],
}

/// Reads the halves from `cache`, or renders and stores them.
pub(crate) fn of(plan: &Plan, world: &World, bundle: &Bundle, cache: &Path) -> Result<Reference> {
    let [a, b] = SEEDS.map(|seed| half(plan, world, bundle, seed, cache));
    let (a, b) = (a?, b?);
    let pixels = a.iter().zip(&b).map(|(a, b)| [0, 1, 2].map(|c| (a[c] + b[c]) * 0.5)).collect();
    let own = errors(plan.side, &a, &b)?.map(|e| e / 4.0);
    Ok(Reference { pixels, own })
}

fn half(plan: &Plan, world: &World, bundle: &Bundle, seed: u64, cache: &Path) -> Result<Vec<[f32; 3]>> {
    let (side, spp) = (plan.side, plan.reference_spp / 2);
    let scene = format!("{}-{:016x}", plan.scene, hash(bundle));
    let path = cache.join(format!("{scene}-{side}x{side}-{POINTS}-{spp}spp-seed{seed}.pfm"));
    let name = path.display().to_string();
    if path.is_file() {
        eprintln!("reference: {name}");
        let image = read_image(&std::fs::read(&path)?, &name, Encoding::Auto)?;
        if image.size != [side; 2] {
            return Err(format!("{name} is {:?} pixels: delete it", image.size).into());
        }
        return Ok(image.pixels);
    }
    eprintln!("reference: rendering {name}");
    let points = registry::points(POINTS, registry::Setting { seed, spp: Some(spp) })?;
    let mut sampler = registry::sampler("uniform", points, &MethodInputs::default())?.sampler;
    let limits = Limits::samples(spp * u64::from(side * side));
    let frame = Frame::new(side, side)?;
    let film = Render::new(frame, &limits).run(&mut *integrator(world), &mut *sampler)?;
    let image = Image::new([side; 2], film.image())?;
    write_file(&path, &encode_pfm(&image)?)?;
    Ok(image.pixels)
}

/// A hash of the scene's files (FNV-1a), so that another scene of the same name has another reference.
fn hash(bundle: &Bundle) -> u64 {
    let bytes = bundle.files.iter().flat_map(|(_, bytes)| bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
