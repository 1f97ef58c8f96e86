//! The host renderer: a path tracer of a room with three spheres. Of Dapple, it uses only the random number generator and
//! estimates.

use dapple::{Estimate, FirstHit, PathRecord, Rng};
use std::array::from_fn;
use std::f32::consts::{PI, TAU};

type V3 = [f32; 3];

/// Width and height of the image.
pub const SIZE: [u32; 2] = [240, 160];

/// The room, from corner to corner; its floor is at height 0.
const ROOM: [V3; 2] = [[-1.5, 0.0, -3.5], [1.5, 2.0, 1.5]];
/// The half widths and the radiance of the light, a rectangle in the ceiling.
const LAMP: ([f32; 2], V3) = ([0.35, 0.25], [17.0, 15.0, 12.0]);
/// Spheres: centre, radius, colour, and `true` for a mirror.
const SPHERES: [(V3, f32, V3, bool); 3] = [
    ([-0.6, 0.5, 0.4], 0.5, [0.9; 3], true),
    ([0.55, 0.4, -0.1], 0.4, [0.75, 0.45, 0.15], false),
    ([-0.05, 0.18, -0.7], 0.18, [0.2, 0.4, 0.75], false),
];
const EYE: V3 = [0.0, 1.0, -3.2];
/// The largest number of surfaces on a path.
const BOUNCES: u32 = 6;

fn add(a: V3, s: f32, b: V3) -> V3 {
    from_fn(|i| a[i] + s * b[i])
}

fn dot(a: V3, b: V3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: V3) -> V3 {
    a.map(|x| x / dot(a, a).sqrt())
}

/// A point of a surface.
struct Surface {
    t: f32,
    at: V3,
    normal: V3,
    colour: V3,
    is_mirror: bool,
    light: V3,
}

/// The nearest surface on a ray.
fn hit(from: V3, to: V3) -> Surface {
    let sphere = |&(centre, radius, colour, is_mirror): &(V3, f32, V3, bool)| {
        let away = add(from, -1.0, centre);
        let (half, rest) = (dot(away, to), dot(away, away) - radius * radius);
        let root = (half * half - rest).max(0.0).sqrt();
        let t = if -half - root > 1e-3 { -half - root } else { root - half };
        let at = add(from, t, to);
        let normal = add(at, -1.0, centre).map(|x| x / radius);
        (half * half > rest && t > 1e-3).then_some(Surface { t, at, normal, colour, is_mirror, light: [0.0; 3] })
    };
    SPHERES.iter().filter_map(sphere).fold(wall(from, to), |near, other| if other.t < near.t { other } else { near })
}

/// The wall, floor or ceiling that a ray from inside the room hits.
fn wall(from: V3, to: V3) -> Surface {
    let leaves: V3 = from_fn(|i| (ROOM[usize::from(to[i] > 0.0)][i] - from[i]) / to[i]);
    let axis = if leaves[0] < leaves[1].min(leaves[2]) { 0 } else { 1 + usize::from(leaves[2] < leaves[1]) };
    let (t, is_far) = (leaves[axis], to[axis] > 0.0);
    let at = add(from, t, to);
    let normal = from_fn(|i| if i == axis { -to[i].signum() } else { 0.0 });
    let tile = (at[0] * 2.5).floor() + (at[2] * 2.5).floor();
    let colour = match (axis, is_far) {
        (0, false) => [0.65, 0.12, 0.1],
        (0, true) => [0.14, 0.45, 0.12],
        (1, false) => [0.35 + 0.4 * tile.rem_euclid(2.0); 3],
        _ => [0.72, 0.7, 0.66],
    };
    let is_lamp = axis == 1 && is_far && at[0].abs() < LAMP.0[0] && at[2].abs() < LAMP.0[1];
    Surface { t, at, normal, colour, is_mirror: false, light: if is_lamp { LAMP.1 } else { [0.0; 3] } }
}

/// The fraction of the light's radiance that a matte surface reflects, estimated with a random point on the light.
fn reflected(surface: &Surface, [u, v]: [f32; 2]) -> f32 {
    let [width, depth] = LAMP.0.map(|half| 2.0 * half);
    let point = [(u - 0.5) * width, ROOM[1][1], (v - 0.5) * depth];
    let to = add(point, -1.0, surface.at);
    let (distance, to) = (dot(to, to).sqrt(), unit(to));
    let cosines = dot(surface.normal, to).max(0.0) * to[1].max(0.0);
    let is_free = cosines > 0.0 && hit(surface.at, to).t > distance - 1e-3;
    if is_free { cosines * width * depth / (PI * distance * distance) } else { 0.0 }
}

/// Traces one sample of a pixel.
pub(crate) fn sample(pixel: [u32; 2], rng: &mut Rng<'_>) -> Estimate {
    let place = rng.next_2d();
    let [x, y]: [f32; 2] = from_fn(|i| (pixel[i] as f32 + place[i] - 0.5 * SIZE[i] as f32) / SIZE[1] as f32);
    let (mut from, mut to) = (EYE, unit([x, -y, 1.1]));
    let (mut path, mut weight, mut sees_lamp) = (PathRecord::new(), [1.0; 3], true);
    for _ in 0..BOUNCES {
        let surface = hit(from, to);
        let [lamp, way] = [rng.next_2d(), rng.next_2d()];
        let roughness = if surface.is_mirror { 0.0 } else { 1.0 };
        let seen = FirstHit::new(surface.at, surface.normal, surface.t).with_albedo(surface.colour);
        path.surface(seen.with_roughness(roughness), weight);
        if sees_lamp {
            path.emits(weight, surface.light);
        }
        weight = from_fn(|c| weight[c] * surface.colour[c]);
        sees_lamp &= surface.is_mirror; // without caustics
        if surface.is_mirror {
            to = add(to, -2.0 * dot(to, surface.normal), surface.normal);
        } else {
            let part = reflected(&surface, lamp);
            path.receives(weight, LAMP.1.map(|light| part * light));
            let (height, (sin, cos)) = (1.0 - 2.0 * way[0], libm::sincosf(TAU * way[1]));
            let ring = (1.0 - height * height).sqrt();
            to = unit(add([ring * cos, ring * sin, height], 1.0001, surface.normal));
        }
        from = surface.at;
    }
    path.estimate()
}
