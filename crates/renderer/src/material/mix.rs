//! Selection of one material of a mix.

use super::{Kind, MaterialError, Surface};
use crate::texture::{TexturePoint, Textures};
use dapple_scene::{Material, MaterialKind, Scalar};

/// The largest depth of nested mixes.
const DEEPEST: u32 = 16;

/// Returns the surface of material `index` at a point, and its index. For a mix, returns the surface and index of one of the
/// mixed materials.
///
/// The random number `choice` in `[0, 1)` selects a material with the mix's amounts at the point as probabilities.
/// Nested mixes reuse the rescaled remainder of `choice`.
///
/// The materials must have passed [`check_mixes`] without an error.
#[inline]
pub(crate) fn resolve<'w>(
    surfaces: &'w [Surface],
    index: u32,
    textures: &Textures,
    point: TexturePoint,
    choice: f32,
) -> (&'w Surface, u32) {
    let (mut index, mut choice) = (index, choice);
    let mut surface = &surfaces[index as usize];
    for _ in 0..DEEPEST {
        let Kind::Mix { materials, amount } = &surface.kind else { break };
        let amount = share_of_second(textures, *amount, point);
        let second = choice < amount;
        let (rest, share) = if second { (choice, amount) } else { (choice - amount, 1.0 - amount) };
        choice = (rest / share).min(1.0 - 0.5 * f32::EPSILON);
        index = materials[usize::from(second)];
        surface = &surfaces[index as usize];
    }
    (surface, index)
}

/// Returns the probability with which [`resolve`] returns a surface that shadow rays pass. `point` is called only for mixes.
pub(crate) fn passed_share(
    surfaces: &[Surface],
    index: u32,
    textures: &Textures,
    point: impl FnOnce() -> TexturePoint,
) -> f32 {
    let surface = &surfaces[index as usize];
    if surface.mixes {
        share_within(surfaces, index, textures, point(), DEEPEST)
    } else {
        f32::from(surface.interface || surface.unlit)
    }
}

fn share_within(surfaces: &[Surface], index: u32, textures: &Textures, point: TexturePoint, depth: u32) -> f32 {
    let surface = &surfaces[index as usize];
    let Kind::Mix { materials, amount } = &surface.kind else { return f32::from(surface.interface || surface.unlit) };
    if depth == 0 {
        return 0.0;
    }
    let amount = share_of_second(textures, *amount, point);
    let [first, second] = materials.map(|part| share_within(surfaces, part, textures, point, depth - 1));
    first + amount * (second - first)
}

#[inline]
#[expect(clippy::manual_clamp, reason = "NaN counts as 0, which `clamp` would let through")]
fn share_of_second(textures: &Textures, amount: Scalar, point: TexturePoint) -> f32 {
    textures.look_up_scalar(amount, point).max(0.0).min(1.0)
}

/// Returns the errors of all mixes: missing materials, mixes that contain themselves, and nesting that is too deep.
pub(crate) fn check_mixes(materials: &[Material]) -> Vec<MaterialError> {
    let mut wrong = Vec::new();
    let parts: Vec<Vec<usize>> = materials
        .iter()
        .map(|material| {
            let MaterialKind::Mix { materials: parts, .. } = &material.kind else { return Vec::new() };
            let parts = parts.map(|part| part.0 as usize);
            for part in parts.iter().filter(|&&part| part >= materials.len()) {
                wrong.push(MaterialError::new(material, format!("mixed material {part} does not exist; define it")));
            }
            parts.into_iter().filter(|&part| part < materials.len()).collect()
        })
        .collect();
    // Depth-first search with an explicit stack. `levels` holds the depth of nesting below each material once it is
    // known.
    let mut levels: Vec<Option<u32>> = vec![None; materials.len()];
    let mut within = vec![false; materials.len()];
    for start in 0..materials.len() {
        let mut path = vec![(start, 0)];
        while let Some((at, next)) = path.last_mut() {
            let at = *at;
            if levels[at].is_some() {
                path.pop();
                continue;
            }
            within[at] = true;
            let Some(&part) = parts[at].get(*next) else {
                let below = parts[at].iter().filter_map(|&part| levels[part]).max();
                let level = below.map_or(0, |below| below + 1);
                if level == DEEPEST + 1 {
                    wrong.push(MaterialError::new(
                        &materials[at],
                        format!("mixes are nested more than {DEEPEST} deep; nest fewer mixes"),
                    ));
                }
                levels[at] = Some(level);
                within[at] = false;
                path.pop();
                continue;
            };
            *next += 1;
            if within[part] {
                let circle = path.iter().skip_while(|(on, _)| *on != part).map(|(on, _)| *on);
                let names: Vec<String> = circle.map(|on| format!("\"{}\"", materials[on].name)).collect();
                let what = format!("the mix contains itself through {}; remove one of these mixes", names.join(", "));
                wrong.push(MaterialError::new(&materials[part], what));
            } else {
                path.push((part, 0));
            }
        }
    }
    wrong
}
