//! Markov chains over the random numbers of samples [Kelemen et al. 2002].
//!
//! A state holds the random numbers that one sample requested. A small step moves each number a little; a large step replaces
//! all. A longer path gets new numbers for its additional requests, and a shorter path drops the numbers that it no longer
//! requests. Such moves between states of different length preserve detailed balance, since the density of new numbers is 1
//! [Green 1995].

use crate::bdpt::OF_LIGHT;
use crate::walk::BELOW_ONE;
use dapple_core::point_set::{mix, streams};
use dapple_core::{Draws, Frame, PointSet, SampleId};
use dapple_renderer::blocks;
use glam::Vec3;
use std::sync::atomic::{AtomicU32, Ordering};

/// The smallest and the largest change of a number in a small step. Changes are log-uniform between them.
const MOVES: [f32; 2] = [1.0 / 1024.0, 1.0 / 64.0];

/// A contribution of a sample to a pixel of the window: the pixel's index, and the light. Its mean over all samples is the
/// image.
pub(super) type Deposit = (u32, Vec3);

/// The target function of the chains: the light of a sample as a function of its random numbers.
pub(super) trait Target: Sync {
    /// Adds the contributions of a sample to `found`, and returns the number of rays traced.
    fn evaluate(&self, draws: &Draws<'_>, found: &mut Vec<Deposit>) -> u32;
}

/// The groups of random numbers that a sample requested, in three lists: for the camera path, for the light path, and others.
type State = [Vec<[f32; 4]>; 3];

/// Returns the list of a [`State`] that contains group `block`, and the group's index in that list.
fn place_of(block: u32) -> (usize, u32) {
    const OTHERS: u32 = 2 * OF_LIGHT;
    match block {
        0..OF_LIGHT => (0, block),
        OF_LIGHT..OTHERS => (1, block - OF_LIGHT),
        // The only such group is the time.
        _ => (2, block & 0xff),
    }
}

/// The random numbers of a proposed sample, as a pure function of the current state and a key.
struct Proposal<'a> {
    current: &'a State,
    is_large: bool,
    key: u64,
    frame: &'a Frame,
    /// The number of groups requested from each list of the state.
    used: [AtomicU32; 3],
}

/// Returns a random number in `[0, 1)` for a key.
fn uniform(key: u64) -> f32 {
    (key >> 40) as f32 / (1 << 24) as f32
}

/// Returns a number moved by a small step, modulo 1.
fn moved(x: f32, u: f32) -> f32 {
    let (sign, u) = if u < 0.5 { (-1.0, 2.0 * u) } else { (1.0, 2.0 * u - 1.0) };
    let length = MOVES[1] * libm::expf(u * libm::logf(MOVES[0] / MOVES[1]));
    let x = x + sign * length;
    (x - x.floor()).clamp(0.0, BELOW_ONE)
}

impl Proposal<'_> {
    fn coordinates(&self, list: usize, index: u32) -> [f32; 4] {
        let key = mix(self.key ^ (list as u64) << 60 ^ u64::from(index) << 2);
        let numbers = [0, 1, 2, 3].map(|lane| uniform(mix(key.wrapping_add(lane))));
        match self.current[list].get(index as usize) {
            Some(current) if !self.is_large => std::array::from_fn(|lane| moved(current[lane], numbers[lane])),
            _ => numbers,
        }
    }

    /// Returns the pixel of the sample, and the position in the pixel.
    fn pixel(&self) -> ([u32; 2], [f32; 2]) {
        let [x, y, ..] = self.coordinates(0, blocks::CAMERA.number());
        let (origin, size) = (self.frame.origin(), self.frame.size());
        let along = |u: f32, axis: usize| {
            let place = u * size[axis] as f32;
            let pixel = (place as u32).min(size[axis] - 1);
            (origin[axis] + pixel, (place - pixel as f32).clamp(0.0, BELOW_ONE))
        };
        let [(column, u), (row, v)] = [along(x, 0), along(y, 1)];
        ([column, row], [u, v])
    }

    /// Returns the requested random numbers as a state.
    fn into_state(self) -> State {
        std::array::from_fn(|list| {
            let used = self.used[list].load(Ordering::Relaxed);
            (0..used).map(|index| self.coordinates(list, index)).collect()
        })
    }
}

impl PointSet for Proposal<'_> {
    fn describe(&self) -> String {
        "metropolis".into()
    }

    fn block(&self, _: SampleId, block: u32) -> [f32; 4] {
        let (list, index) = place_of(block);
        self.used[list].fetch_max(index + 1, Ordering::Relaxed);
        let found = self.coordinates(list, index);
        if block != blocks::CAMERA.number() {
            return found;
        }
        let (_, [u, v]) = self.pixel();
        [u, v, found[2], found[3]]
    }

    fn capacity(&self) -> u64 {
        u64::MAX
    }
}

/// A sample with its contributions.
#[derive(Default)]
struct Sample {
    state: State,
    light: Vec<Deposit>,
    /// The summed luminance of the contributions, to which the chains' density is proportional.
    brightness: f64,
    rays: u64,
}

/// The inputs of the chains of one image.
pub(super) struct Chains<'a> {
    pub(super) target: &'a dyn Target,
    pub(super) frame: &'a Frame,
    /// The key from which all random numbers are derived.
    pub(super) key: u64,
    /// The probability of a large step.
    pub(super) large: f32,
}

impl Chains<'_> {
    fn sample(&self, current: &State, is_large: bool, key: u64) -> Sample {
        let proposal = Proposal { current, is_large, key, frame: self.frame, used: Default::default() };
        let id = SampleId::new(proposal.pixel().0, streams::WHOLE, 0);
        let mut light = Vec::new();
        let rays = u64::from(self.target.evaluate(&Draws::new(&proposal, id), &mut light));
        let sum = light.iter().fold(Vec3::ZERO, |sum, (_, light)| sum + *light);
        let brightness = dapple_core::film::luminance(sum.to_array().map(f64::from));
        let brightness = if brightness.is_finite() && brightness > 0.0 { brightness } else { 0.0 };
        // The image position belongs to the state, even if the camera ray was not requested.
        proposal.used[0].fetch_max(1, Ordering::Relaxed);
        Sample { state: proposal.into_state(), light, brightness, rays }
    }

    /// Returns the brightness of independent sample number `i`, at which a chain may start, and the number of rays traced.
    pub(super) fn brightness_of_seed(&self, i: u64) -> (f64, u64) {
        let Sample { brightness, rays, .. } = self.seed(i);
        (brightness, rays)
    }

    fn seed(&self, i: u64) -> Sample {
        self.sample(&State::default(), true, mix(self.key ^ mix(2 * i)))
    }

    /// Runs chain number `chain` for `length` mutations, starting at independent sample number `start`. Returns the
    /// contributions of each state, divided by the state's brightness and weighted by its expected number of steps, and the
    /// number of rays.
    pub(super) fn run(&self, chain: u64, start: u64, length: u64) -> (Vec<Deposit>, u64) {
        let mut current = self.seed(start);
        let (mut found, mut rays, mut stay) = (Vec::new(), current.rays, 0.0);
        let mut deposit = |sample: &Sample, weight: f64| {
            let scale = (weight / sample.brightness) as f32;
            if weight > 0.0 && scale.is_finite() {
                found.extend(sample.light.iter().map(|(pixel, light)| (*pixel, *light * scale)));
            }
        };
        let key = mix(self.key ^ mix(2 * chain + 1));
        for step in 0..length {
            let key = mix(key ^ mix(step));
            let [choice, accepted] = [1, 2].map(|salt| uniform(mix(key.wrapping_add(salt << 32))));
            let next = self.sample(&current.state, choice < self.large, key);
            rays += next.rays;
            let acceptance = (next.brightness / current.brightness).min(1.0);
            stay += 1.0 - acceptance;
            if f64::from(accepted) < acceptance {
                deposit(&current, stay);
                (current, stay) = (next, acceptance);
            } else {
                deposit(&next, acceptance);
            }
        }
        deposit(&current, stay);
        (found, rays)
    }
}
