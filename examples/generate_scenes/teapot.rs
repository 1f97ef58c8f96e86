//! Newell's teapot in gold on a tiled floor, in a studio.

use super::Assets;
use super::arithmetic::{add, cross, dot, mix, normalize, scale, smoothstep, sub};
use super::files::{Mesh, lat_long_pfm, tga};

/// Number of quadrilaterals along each side of a Bezier patch. The teapot's 32 patches of 2 x 12 x 12 triangles make
/// about 9000 triangles.
const STEPS: usize = 12;

/// One control point of a profile, `[r, l, z]`: radius, the off-axis coordinate of the two middle control points of a
/// quarter turn, and height.
type Ring = [f64; 3];

/// The profile of the lid, which is rotated about the z axis: cubic Bezier pieces that share end points. With the radius to the
/// right and the height up, the outside is to the left of the profile's direction.
///
/// Newell's table [Newell 1975; Crow 1987] gives each quarter turn of a piece as 4 x 4 points `(r, 0), (r, l), (l, r), (0, r)`
/// at four heights. `LID` and `BODY` are that table without its repetitions. `l / r` is 0.56 everywhere except at the knob
/// (0.45 / 0.8).
const LID: [Ring; 7] = [
    [0.0, 0.0, 3.15],
    [0.8, 0.45, 3.15],
    [0.0, 0.0, 2.85],
    [0.2, 0.112, 2.7],
    [0.4, 0.224, 2.55],
    [1.3, 0.728, 2.55],
    [1.3, 0.728, 2.4],
];

/// The profile of the body, as in `LID`: rim, upper body, lower body, and the bottom (not part of Newell's original).
const BODY: [Ring; 13] = [
    [1.4, 0.784, 2.4],
    [1.3375, 0.749, 2.53125],
    [1.4375, 0.805, 2.53125],
    [1.5, 0.84, 2.4],
    [1.75, 0.98, 1.875],
    [2.0, 1.12, 1.35],
    [2.0, 1.12, 0.9],
    [2.0, 1.12, 0.45],
    [1.5, 0.84, 0.225],
    [1.5, 0.84, 0.15],
    [1.5, 0.84, 0.075],
    [1.425, 0.798, 0.0],
    [0.0, 0.0, 0.0],
];

/// One cross-section of control points of a tube (handle or spout): two points in the plane y = 0, given by x and z,
/// and one half width. The tube is symmetric in y.
struct Section {
    first: [f64; 2],
    second: [f64; 2],
    half_width: f64,
}

const fn section(first: [f64; 2], second: [f64; 2], half_width: f64) -> Section {
    Section { first, second, half_width }
}

const HANDLE: [Section; 7] = [
    section([-1.6, 2.025], [-1.5, 2.25], 0.3),
    section([-2.3, 2.025], [-2.5, 2.25], 0.3),
    section([-2.7, 2.025], [-3.0, 2.25], 0.3),
    section([-2.7, 1.8], [-3.0, 1.8], 0.3),
    section([-2.7, 1.575], [-3.0, 1.35], 0.3),
    section([-2.5, 1.125], [-2.65, 0.9375], 0.3),
    section([-2.0, 0.9], [-1.9, 0.6], 0.3),
];

const SPOUT: [Section; 7] = [
    section([1.7, 1.425], [1.7, 0.6], 0.66),
    section([2.6, 1.425], [3.1, 0.825], 0.66),
    section([2.3, 2.1], [2.4, 2.025], 0.25),
    section([2.7, 2.4], [3.3, 2.4], 0.25),
    section([2.8, 2.475], [3.525, 2.49375], 0.25),
    section([2.9, 2.475], [3.45, 2.5125], 0.15),
    section([2.8, 2.4], [3.2, 2.4], 0.15),
];

/// The 4 x 4 control points of a bicubic Bezier patch, indexed `[row][column]`.
type Patch = [[[f64; 3]; 4]; 4];

/// The patches of one part of the teapot, indexed `[piece][column]`. The columns of a piece close to a ring.
type Part = Vec<Vec<Patch>>;

/// Returns the patches of a profile rotated about the z axis: four quarter turns per cubic piece.
fn turned(profile: &[Ring]) -> Part {
    let quarter = |[r, l, z]: Ring, turn: usize| {
        [[r, 0.0, z], [r, l, z], [l, r, z], [0.0, r, z]].map(|[x, y, z]| match turn {
            0 => [x, y, z],
            1 => [-y, x, z],
            2 => [-x, -y, z],
            _ => [y, -x, z],
        })
    };
    pieces(profile.len())
        .map(|piece| (0..4).map(|turn| std::array::from_fn(|row| quarter(profile[piece + row], turn))).collect())
        .collect()
}

/// Returns the patches of a tube (handle or spout): two halves per cubic piece.
fn tube(sections: &[Section]) -> Part {
    let half = |section: &Section, side: f64| {
        let ([x0, z0], [x1, z1], w) = (section.first, section.second, section.half_width * side);
        let points = [[x0, 0.0, z0], [x0, w, z0], [x1, w, z1], [x1, 0.0, z1]];
        if side > 0.0 { points } else { [points[3], points[2], points[1], points[0]] }
    };
    pieces(sections.len())
        .map(|piece| {
            let patch = |side| std::array::from_fn(|row| half(&sections[piece + row], side));
            vec![patch(1.0), patch(-1.0)]
        })
        .collect()
}

/// Returns the index of the first control point of each cubic piece of a curve with `points` control points.
/// Neighbouring pieces share a point.
fn pieces(points: usize) -> impl Iterator<Item = usize> {
    (0..points - 1).step_by(3)
}

/// Returns the patches of the lid, the body, the handle and the spout.
fn parts() -> [Part; 4] {
    [turned(&LID), turned(&BODY), tube(&HANDLE), tube(&SPOUT)]
}

/// Returns the value and the derivative of a cubic Bezier curve at `t`, by de Casteljau's algorithm. The value is exact
/// at 0 and 1.
fn bezier(points: [[f64; 3]; 4], t: f64) -> ([f64; 3], [f64; 3]) {
    let between = |a: [f64; 3], b: [f64; 3]| mix(a, b, t);
    let [a, b, c] = [0, 1, 2].map(|i| between(points[i], points[i + 1]));
    let (d, e) = (between(a, b), between(b, c));
    (between(d, e), scale(sub(e, d), 3.0))
}

/// Returns a point of a patch, its derivative by `s` (from row to row) and its derivative by `t` (from column to
/// column).
fn patch_point(patch: &Patch, s: f64, t: f64) -> [[f64; 3]; 3] {
    let rows = patch.map(|row| bezier(row, t));
    let (point, along_s) = bezier(rows.map(|(value, _)| value), s);
    let (along_t, _) = bezier(rows.map(|(_, derivative)| derivative), s);
    [point, along_s, along_t]
}

/// Returns true if all control points of a row coincide, so that the patch ends in a tip.
fn is_point(row: &[[f64; 3]; 4]) -> bool {
    row.iter().all(|point| *point == row[0])
}

/// Adds a part to a mesh, each patch as `STEPS x STEPS` quadrilaterals. Neighbouring patches share vertices; a row of
/// vertices that coincide becomes one vertex.
fn add_part(mesh: &mut Mesh, part: &Part) {
    let around = part[0].len() * STEPS;
    let down = part.len() * STEPS;
    let mut above: Vec<u32> = Vec::new();
    for row in 0..=down {
        // A row between two pieces belongs to the second one; the last row belongs to the last piece.
        let piece = (row / STEPS).min(part.len() - 1);
        let s = (row - piece * STEPS) as f64 / STEPS as f64;
        let ring: Vec<_> = (0..around)
            .map(|column| patch_point(&part[piece][column / STEPS], s, (column % STEPS) as f64 / STEPS as f64))
            .collect();
        let patch = &part[piece][0];
        let at_tip = row == 0 && is_point(&patch[0]) || row == down && is_point(&patch[3]);
        let here: Vec<u32> = if at_tip {
            // Tangents around the ring vanish at a tip. The surface of revolution is horizontal there.
            let up = if row == 0 { 1.0 } else { -1.0 };
            vec![mesh.add(patch[if row == 0 { 0 } else { 3 }][0], [0.0, 0.0, up]); around]
        } else {
            ring.iter()
                .map(|[point, along_s, along_t]| mesh.add(*point, normalize(cross(*along_s, *along_t))))
                .collect()
        };
        if row > 0 {
            for column in 0..around {
                let next = (column + 1) % around;
                mesh.add_quad([above[column], here[column], here[next], above[next]]);
            }
        }
        above = here;
    }
}

/// Returns the teapot's mesh: base at z = 0, spout towards +x, normals outwards.
///
/// Its borders are open as in Newell's data: the lid's edge and the rim's inner edge (a gap of 0.08 between them), both
/// ends of the handle and the foot of the spout (all inside the body), and the spout's mouth.
fn mesh() -> Mesh {
    let mut mesh = Mesh::default();
    for part in &parts() {
        add_part(&mut mesh, part);
    }
    mesh
}

/// A rectangular light far away: direction of its centre, half width and half height (as tangents of angles), and
/// radiance. `bar` is the half width of cross bars that make the light a window; 0 for none.
struct SoftBox {
    centre: [f64; 3],
    half: [f64; 2],
    radiance: [f64; 3],
    bar: f64,
}

const SOFT_BOXES: [SoftBox; 3] = [
    // The window: left of the camera, high.
    SoftBox { centre: [-0.75, -0.5, 0.62], half: [0.42, 0.5], radiance: [6.0, 5.7, 5.3], bar: 0.05 },
    // A strip light to the right, a little warmer.
    SoftBox { centre: [0.9, -0.25, 0.4], half: [0.14, 0.6], radiance: [3.6, 2.9, 2.2], bar: 0.0 },
    // From behind, cool.
    SoftBox { centre: [0.35, 0.9, 0.55], half: [0.5, 0.2], radiance: [1.2, 1.4, 1.8], bar: 0.0 },
];

/// Returns the fraction of a soft box that is visible in a direction, 0 to 1. Edges are softened over `EDGE`.
fn coverage(light: &SoftBox, direction: [f64; 3]) -> f64 {
    const EDGE: f64 = 0.03;
    let centre = normalize(light.centre);
    let depth = dot(direction, centre);
    if depth <= 0.0 {
        return 0.0;
    }
    let right = normalize(cross(centre, [0.0, 0.0, 1.0]));
    let up = cross(right, centre);
    let (x, y) = ((dot(direction, right) / depth).abs(), (dot(direction, up) / depth).abs());
    let inside = |x: f64, half: f64| 1.0 - smoothstep(half - EDGE, half + EDGE, x);
    let pane = if light.bar > 0.0 { smoothstep(light.bar - EDGE, light.bar + EDGE, x.min(y)) } else { 1.0 };
    inside(x, light.half[0]) * inside(y, light.half[1]) * pane
}

/// Returns the studio's radiance from a unit direction: walls, a dim ground below, and the soft boxes. The walls darken
/// upwards: `mix(horizon, zenith, z (2 - z))`.
fn studio(direction: [f64; 3]) -> [f64; 3] {
    let z = direction[2];
    let wall = if z >= 0.0 {
        mix([0.34, 0.33, 0.32], [0.10, 0.11, 0.13], z * (2.0 - z))
    } else {
        mix([0.34, 0.33, 0.32], [0.06, 0.055, 0.05], smoothstep(0.0, 0.2, -z))
    };
    SOFT_BOXES.iter().fold(wall, |sum, light| add(sum, scale(light.radiance, coverage(light, direction))))
}

/// Returns the sRGB colour of a texel of the floor image: 2 x 2 slate tiles of two shades with pale grout.
fn floor_tile(column: u16, row: u16) -> [u8; 3] {
    const TILE: u16 = 64;
    const JOINT: u16 = 2;
    let edge = |x: u16| x % TILE < JOINT || x % TILE >= TILE - JOINT;
    if edge(column) || edge(row) {
        [205, 198, 186]
    } else if (column / TILE + row / TILE).is_multiple_of(2) {
        [104, 116, 128]
    } else {
        [74, 86, 100]
    }
}

/// Returns the files beside the scene file.
pub(crate) fn assets() -> Assets {
    vec![
        ("teapot/teapot.ply".to_owned(), mesh().ply()),
        ("teapot/studio.pfm".to_owned(), lat_long_pfm(256, 128, studio)),
        ("teapot/tiles.tga".to_owned(), tga([128; 2], floor_tile)),
    ]
}
