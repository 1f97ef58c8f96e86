//! Triangulation of polygons in space.

use glam::{DVec2, DVec3};

/// Number of corners tried as the centre of a fan. It bounds the work for polygons of very many corners.
const HUBS_TRIED: usize = 16;
/// The largest number of corners of a polygon that is cut ear by ear, since ear clipping takes quadratic time.
const MOST_EARS: usize = 2048;

/// Cuts a polygon into triangles of the same winding and appends the triangles to `triangles`. If a corner that sees all
/// others is found, the triangles are the fan around it; else ears are cut off [Meisters 1975]. Needs at least three corners,
/// each below `positions.len()`.
///
/// # Errors
/// Returns a message for a polygon that crosses itself, or a concave one with very many corners.
pub(crate) fn triangulate(
    corners: &[u32],
    positions: &[DVec3],
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), &'static str> {
    if let &[a, b, c] = corners {
        triangles.push([a, b, c]);
        return Ok(());
    }
    if let Some(hub) = hub(corners, positions) {
        let corner = |i: usize| corners[(hub + i) % corners.len()];
        triangles.extend((1..corners.len() - 1).map(|i| [corner(0), corner(i), corner(i + 1)]));
        return Ok(());
    }
    if corners.len() > MOST_EARS {
        return Err("concave polygons of more than 2048 corners are not supported; triangulate the mesh");
    }
    let flat = flatten(corners, positions).ok_or("this polygon crosses itself; triangulate the mesh")?;
    let start = triangles.len();
    if Ears::new(&flat).cut(|ear| triangles.push(ear.map(|i| corners[i]))) {
        return Ok(());
    }
    triangles.truncate(start);
    Err("this polygon crosses itself; triangulate the mesh")
}

/// Returns a vector along the polygon's normal whose length is twice the polygon's area.
fn area(corners: &[u32], positions: &[DVec3]) -> DVec3 {
    let at = |i: usize| positions[corners[i] as usize];
    (1..corners.len() - 1).map(|i| (at(i) - at(0)).cross(at(i + 1) - at(0))).sum()
}

/// Returns the index of the first corner whose fan of triangles covers the polygon without folding back; `None` if none
/// of the corners tried does.
fn hub(corners: &[u32], positions: &[DVec3]) -> Option<usize> {
    let area = area(corners, positions);
    let at = |i: usize| positions[corners[i % corners.len()] as usize];
    let cross = |hub: usize, i: usize| (at(hub + i) - at(hub)).cross(at(hub + i + 1) - at(hub));
    (0..corners.len().min(HUBS_TRIED)).find(|&hub| (1..corners.len() - 1).all(|i| cross(hub, i).dot(area) >= 0.0))
}

/// Returns the corners projected to 2D along the axis nearest to the polygon's normal, counter-clockwise; `None` for
/// area 0.
fn flatten(corners: &[u32], positions: &[DVec3]) -> Option<Vec<DVec2>> {
    let normal = area(corners, positions);
    let size = normal.abs();
    if !(normal.is_finite() && size.max_element() > 0.0) {
        return None;
    }
    let axis = (0..3).find(|&i| size[i] == size.max_element())?;
    let (u, v) = if normal[axis] > 0.0 { ((axis + 1) % 3, (axis + 2) % 3) } else { ((axis + 2) % 3, (axis + 1) % 3) };
    let flat = corners.iter().map(|&c| positions[c as usize]);
    Some(flat.map(|p| DVec2::new(p[u], p[v])).collect())
}

/// Returns twice the area of the triangle of three points, negative if they are clockwise.
fn side(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// A polygon during ear clipping: a ring of the remaining corners, and a flag for each corner that is an ear.
struct Ears<'p> {
    points: &'p [DVec2],
    next: Vec<usize>,
    previous: Vec<usize>,
    is_ear: Vec<bool>,
}

impl<'p> Ears<'p> {
    fn new(points: &'p [DVec2]) -> Self {
        let n = points.len();
        let next = (0..n).map(|i| (i + 1) % n).collect();
        let previous = (0..n).map(|i| (i + n - 1) % n).collect();
        let mut ears = Self { points, next, previous, is_ear: vec![false; n] };
        (0..n).for_each(|i| ears.is_ear[i] = ears.can_be_cut(i));
        ears
    }

    /// Cuts ears until the whole polygon is cut, and calls `triangle` for each triangle. Returns false if no ear
    /// remains before that, or if triangles overlap.
    fn cut(mut self, mut triangle: impl FnMut([usize; 3])) -> bool {
        let mut left = self.points.len();
        let (mut at, mut waited) = (0, 0);
        while left > 3 {
            if !self.is_ear[at] {
                waited += 1;
                if waited > left {
                    return false;
                }
                at = self.next[at];
                continue;
            }
            let (before, after) = (self.previous[at], self.next[at]);
            triangle([before, at, after]);
            self.next[before] = after;
            self.previous[after] = before;
            left -= 1;
            waited = 0;
            // Cutting an ear changes the angles of its neighbours only.
            for corner in [before, after] {
                self.is_ear[corner] = self.can_be_cut(corner);
            }
            // Skips the neighbour: ears cut all around have better shapes than slivers from one corner.
            at = self.next[after];
        }
        let last = [self.previous[at], at, self.next[at]];
        triangle(last);
        // The signed areas of all triangles add up to the polygon's. If the last triangle is reversed, others overlap.
        let whole: f64 =
            (1..self.points.len() - 1).map(|i| side(self.points[0], self.points[i], self.points[i + 1])).sum();
        let [a, b, c] = last.map(|corner| self.points[corner]);
        side(a, b, c) >= -1e-9 * whole
    }

    /// Returns true if a corner is an ear: it does not turn right, and its triangle contains no other corner.
    fn can_be_cut(&self, corner: usize) -> bool {
        let (before, after) = (self.previous[corner], self.next[corner]);
        let [a, b, c] = [before, corner, after].map(|i| self.points[i]);
        let turn = side(a, b, c);
        if turn <= 0.0 {
            // A spike, or a corner on a straight line, has no area and may be cut.
            return turn == 0.0;
        }
        let mut other = self.next[after];
        while other != before {
            let p = self.points[other];
            // Corners may coincide where a seam joins a hole to the outline.
            let inside = side(a, b, p) >= 0.0 && side(b, c, p) >= 0.0 && side(c, a, p) >= 0.0;
            if inside && p != a && p != b && p != c {
                return false;
            }
            other = self.next[other];
        }
        true
    }
}
