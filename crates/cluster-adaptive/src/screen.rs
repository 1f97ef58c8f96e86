//! The area that a box covers on the film, in perspective.

/// The area, in pixels, that the box between the corners `bounds` covers on a film of `resolution` pixels. The
/// projection `world_to_clip` has the rows of a matrix that takes `[x, y, z, 1]` to clip space. A point with `w > 0`
/// lies in front of the eye, and is on the film if `x / w` and `y / w` are in `[-1, 1]`. The row of `z` is ignored: the
/// only near plane is the eye's own.
///
/// The part of the box in front of the eye is convex. Its image is thus the convex hull of its corners' images, clipped
/// to the film. The area is never negative and never more than the film. It is 0 for a box wholly behind the eye or
/// beside the film, and the whole film for one around the eye. A flat box seen edge-on has no area. For corners that
/// are not finite, or in the wrong order, the area is 0.
pub fn projected_box_area(bounds: &[[f32; 3]; 2], world_to_clip: &[[f32; 4]; 4], resolution: [u32; 2]) -> f64 {
    let film = f64::from(resolution[0]) * f64::from(resolution[1]);
    let [low, high] = bounds;
    if !(0..3).all(|a| low[a].is_finite() && high[a].is_finite() && low[a] <= high[a]) {
        return 0.0;
    }
    let corners: [[f64; 3]; 8] = std::array::from_fn(|corner| {
        let along = |axis: usize| f64::from(if corner >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let row = |r: &[f32; 4]| (0..3).map(|a| f64::from(r[a]) * along(a)).sum::<f64>() + f64::from(r[3]);
        [row(&world_to_clip[0]), row(&world_to_clip[1]), row(&world_to_clip[3])]
    });
    if corners.iter().flatten().any(|c| !c.is_finite()) {
        return 0.0;
    }
    let hull = hull(in_front(&corners));
    let share = area(&cut_to_film(hull)) / 4.0;
    (share * film).clamp(0.0, film)
}

/// The projections of the corners in front of the eye, and of the points where edges of the box enter that half space.
fn in_front(corners: &[[f64; 3]; 8]) -> Vec<[f64; 2]> {
    let far = corners.iter().fold(0.0, |m: f64, c| m.max(c[0].abs()).max(c[1].abs()).max(c[2].abs()));
    // Just in front of the eye: images there lie a billion films away, but at finite places.
    let near = far * 1e-9;
    let project = |c: [f64; 3]| [c[0] / c[2], c[1] / c[2]];
    let mut points: Vec<[f64; 2]> = corners.iter().filter(|c| c[2] > near).map(|&c| project(c)).collect();
    for (a, b) in (0..8).flat_map(|i| (0..3).map(move |axis| (i, i | 1 << axis))).filter(|(a, b)| a != b) {
        let (from, to) = (corners[a], corners[b]);
        if (from[2] > near) != (to[2] > near) {
            let t = (near - from[2]) / (to[2] - from[2]);
            let at = |k: usize| from[k] + t * (to[k] - from[k]);
            points.push([at(0) / near, at(1) / near]);
        }
    }
    points
}

/// The corners of the points' convex hull, counter-clockwise [Andrew 1979].
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return Vec::new();
    }
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut hull: Vec<[f64; 2]> = Vec::with_capacity(points.len() + 1);
    for pass in 0..2 {
        let start = hull.len();
        for &p in &points {
            while hull.len() >= start + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            hull.push(p);
        }
        // Each chain ends where the other begins.
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}

/// The part of a convex polygon that lies in `[-1, 1]^2`, the film in clip space [Sutherland and Hodgman 1974].
fn cut_to_film(mut polygon: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    for (axis, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let inside = |p: [f64; 2]| 1.0 - side * p[axis];
        let mut cut = Vec::with_capacity(polygon.len() + 1);
        for (i, &p) in polygon.iter().enumerate() {
            let q = polygon[(i + 1) % polygon.len()];
            let (a, b) = (inside(p), inside(q));
            if a >= 0.0 {
                cut.push(p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let t = a / (a - b);
                let mut crossing = [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])];
                crossing[axis] = side;
                cut.push(crossing);
            }
        }
        polygon = cut;
    }
    polygon
}

fn area(polygon: &[[f64; 2]]) -> f64 {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let sum: f64 = (0..polygon.len()).map(|i| cross(polygon[i], polygon[(i + 1) % polygon.len()])).sum();
    0.5 * sum.abs()
}
