//! Shapes of pbrt scenes.

use super::directive::Directive;
use super::params::{Params, Type};
use super::reader::Reader;
use super::subdivide::subdivide;
use super::tessellate::{Patches, Round};
use crate::model::read_ply;
use crate::{Emission, Geometry, MeshData, Scalar, Shape};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// The largest number of triangles in a scene made from shapes that are not triangle meshes: about 300 MB.
const MOST_MADE: usize = 1 << 22;
/// Bytes of memory for each triangle of a subdivision surface while it is made.
const MADE_BYTES: u64 = 75;

const SHAPES: [&str; 7] = ["trianglemesh", "plymesh", "sphere", "disk", "cylinder", "bilinearmesh", "loopsubdiv"];

impl Reader<'_> {
    /// Executes `Shape`: adds a shape with the current material, emission and media.
    pub(super) fn add_shape(&mut self, mut d: Directive<'_>) {
        self.shapes_met += 1;
        let mut params = self.params(&mut d, "shape");
        let line = d.source.line;
        let geometry = match d.texts[0].as_str() {
            "trianglemesh" => triangle_mesh(&mut params),
            "plymesh" => self.ply_mesh(&mut params),
            "sphere" => self.sphere(&mut params),
            "disk" => self.disk(&mut params),
            "cylinder" => self.cylinder(&mut params),
            "bilinearmesh" => self.bilinear_mesh(&mut params),
            "loopsubdiv" => self.loop_surface(&mut params),
            kind => {
                params.unsupported_type(line, "Shape", kind, &SHAPES);
                None
            }
        };
        if self.context.version.is_old() {
            // A parameter of pbrt-v3 that affects shadows only.
            params.refuse(&["shadowalpha"]);
        }
        let given = params.has("alpha");
        let alpha = params.scalar("alpha", 1.0, |v| (0.0..=1.0).contains(&v), "within 0..=1");
        let alpha = Some(alpha).filter(|a| given && *a != Scalar::Constant(1.0));
        let emission = geometry.as_ref().and_then(|g| self.emission(g, &mut params));
        let moves_to = self.state.ctm.moves_to();
        if moves_to.is_some() && self.object.is_some() {
            params.unsupported(line, "a shape that moves within an object (move the instance)");
        }
        let good = params.finish(&mut self.log);
        let geometry = match geometry {
            Some(geometry) if good => geometry,
            // An empty mesh, so that the material is checked too; the scene is refused anyway.
            _ if self.log.has_problems() => Geometry::Mesh(Arc::default()),
            _ => return,
        };
        let mut shape = Shape::new(geometry, self.state.ctm.start, crate::MaterialId(0), d.source);
        shape.moves_to = moves_to.filter(|_| self.object.is_none());
        (shape.alpha, shape.emission, shape.reversed) = (alpha, emission, self.state.reversed);
        self.keep_shape(shape);
    }

    /// Returns the emission of a shape under the current area light; `None` if there is no area light, or this shape does not
    /// support it.
    fn emission(&self, geometry: &Geometry, params: &mut Params) -> Option<Emission> {
        let light = self.state.emission?;
        let line = params.line();
        if self.object.is_some() {
            params.unsupported(line, "an area light in an object");
            return None;
        }
        if self.state.ctm.moves_to().is_some() {
            params.unsupported(line, "an area light that moves");
            return None;
        }
        if light.texture.is_some() && !matches!(geometry, Geometry::Mesh(_)) {
            params.unsupported(line, format!("an area light image on a {} (use a mesh)", geometry.name()));
            return None;
        }
        let Some(power) = light.power else {
            return Some(Emission { texture: light.texture, ..Emission::even(light.radiance, light.two_sided) });
        };
        let Some(area) = world_area(geometry, self.state.ctm.start) else {
            let what = "the area of a stretched sphere or disk is not computed; use L and scale instead of power";
            return params.fail(line, what);
        };
        if let Geometry::Mesh(mesh) = geometry
            && mesh.triangles.len() > 1
        {
            let what = "the whole mesh shares the light's power; pbrt-v4 gives each triangle the full power";
            params.notice(params.line(), what);
        }
        let sides = if light.two_sided { 2.0 } else { 1.0 };
        let radiance = light.radiance.map(|c| (f64::from(c) * power / (PI * area * sides)) as f32);
        if radiance.iter().any(|c| !c.is_finite()) {
            return params.fail(line, "the light's power is too large for the shape's area; lower it");
        }
        Some(Emission::even(radiance, light.two_sided))
    }

    fn ply_mesh(&mut self, params: &mut Params) -> Option<Geometry> {
        params.refuse(&["displacement", "edgelength"]);
        let (name, line) = params.needed_text("filename")?;
        let path = self.resolve(&name);
        if let Some(mesh) = self.meshes.get(&path) {
            return Some(Geometry::Mesh(mesh.clone()));
        }
        // `load` reports the reason of a failure.
        let Some(bytes) = self.load(&path, &params.at(line)) else {
            params.broken = true;
            return None;
        };
        match read_ply(&bytes) {
            Ok(mesh) => {
                if let Some(what) = mesh.doubt {
                    params.notice(line, format!("{}: {what}", path.display()));
                }
                // pbrt's materials ignore vertex colours.
                if !mesh.data.colors.is_empty() {
                    params.notice(line, "colours of a plymesh are left out, as in pbrt");
                }
                let mesh = Arc::new(MeshData { colors: Vec::new(), ..mesh.data });
                self.meshes.insert(path, mesh.clone());
                Some(Geometry::Mesh(mesh))
            }
            Err(e) => params.fail(line, format!("{}: {e}", path.display())),
        }
    }

    fn sphere(&mut self, params: &mut Params) -> Option<Geometry> {
        let radius = params.float("radius", 1.0, |v| v > 0.0, "above 0");
        let low = params.float("zmin", -radius, |_| true, "finite");
        let high = params.float("zmax", radius, |_| true, "finite");
        let sweep = sweep(params);
        let (low, high) = (low.min(high).clamp(-radius, radius), low.max(high).clamp(-radius, radius));
        if low <= -radius && high >= radius && sweep == 360.0 {
            return Some(Geometry::Sphere { radius });
        }
        self.round(Round::Sphere { radius, low, high, sweep }, params)
    }

    fn disk(&mut self, params: &mut Params) -> Option<Geometry> {
        let height = params.float("height", 0.0, |_| true, "finite");
        let radius = params.float("radius", 1.0, |v| v > 0.0, "above 0");
        let inner = |v: f64| v >= 0.0 && v < radius;
        let inner_radius = params.float("innerradius", 0.0, inner, "at least 0 and below radius");
        let sweep = sweep(params);
        if sweep == 360.0 {
            return Some(Geometry::Disk { height, radius, inner_radius });
        }
        self.round(Round::Disk { height, radius, inner_radius, sweep }, params)
    }

    fn cylinder(&mut self, params: &mut Params) -> Option<Geometry> {
        let radius = params.float("radius", 1.0, |v| v > 0.0, "above 0");
        let [a, b] = [("zmin", -1.0), ("zmax", 1.0)].map(|(name, z)| params.float(name, z, |_| true, "finite"));
        let sweep = sweep(params);
        if a == b {
            return params.fail(params.line(), format!("{} has no height; zmin and zmax must differ", params.of));
        }
        self.round(Round::Cylinder { radius, low: a.min(b), high: a.max(b), sweep }, params)
    }

    fn round(&mut self, shape: Round, params: &mut Params) -> Option<Geometry> {
        // A sphere has the most triangles of the round shapes.
        self.make_room(1 << 16, MOST_MADE, params)?;
        let mesh = shape.mesh();
        let what = format!("{} is made of {} triangles with smooth normals", params.of, mesh.triangles.len());
        params.notice(params.line(), what);
        self.made(mesh, params)
    }

    fn bilinear_mesh(&mut self, params: &mut Params) -> Option<Geometry> {
        params.refuse(&["emissionfilename"]);
        let (positions, normals, uvs) = vertices(params)?;
        params.ignore(&["faceIndices"]);
        let corners = indices(params, "patch", positions.len())?;
        // Checks the vertices' values, with the error messages of meshes.
        let whole = MeshData { positions, normals, uvs, triangles: vec![[0; 3]], ..MeshData::default() };
        check(&whole, params)?;
        let MeshData { positions, normals, uvs, .. } = whole;
        let most = corners.len().saturating_mul(8).saturating_add(1 << 19);
        self.make_room(most, MOST_MADE, params)?;
        let (mesh, curved) = Patches { positions, normals, uvs, corners }.mesh();
        if curved > 0 {
            let what = format!("{} has {curved} curved patches, made of triangles with smooth normals", params.of);
            params.notice(params.line(), what);
        }
        self.made(mesh, params)
    }

    fn loop_surface(&mut self, params: &mut Params) -> Option<Geometry> {
        let name = if params.has("nlevels") && self.context.version.is_old() { "nlevels" } else { "levels" };
        let levels = params.integer(name, 0, 20).unwrap_or(3) as u32;
        params.ignore(&["scheme"]);
        let positions = positions(params)?;
        let Some(line) = params.peek("indices").map(|p| p.line) else { return params.lacks(INDICES) };
        let faces = indices::<3>(params, "triangle", positions.len())?;
        let made = 1usize.checked_shl(2 * levels).and_then(|n| faces.len().checked_mul(n)).unwrap_or(usize::MAX);
        let room = self.memory.map(|bytes| usize::try_from(bytes / MADE_BYTES).unwrap_or(usize::MAX));
        self.make_room(made, room.map_or(MOST_MADE, |room| room.min(MOST_MADE)), params)?;
        match subdivide(positions, faces, levels) {
            Ok(mesh) => self.made(mesh, params),
            Err(unfit) => params.fail(line, format!("{}: {unfit}", params.of)),
        }
    }

    /// Returns `Some` if `more` new triangles keep the total within `most`; else reports a problem and returns `None`.
    fn make_room(&self, more: usize, most: usize, params: &mut Params) -> Option<()> {
        if self.triangles_made.saturating_add(more) <= most {
            return Some(());
        }
        let why = if most < MOST_MADE { " (memory limit)" } else { "" };
        let made = format!("would make {more} triangles, in addition to {} from other shapes", self.triangles_made);
        params.fail(params.line(), format!("{} {made}; at most {most} are allowed in total{why}", params.of))
    }

    fn made(&mut self, mesh: MeshData, params: &mut Params) -> Option<Geometry> {
        self.triangles_made += mesh.triangles.len();
        check(&mesh, params)?;
        Some(Geometry::Mesh(Arc::new(mesh)))
    }
}

/// Takes the parameter `phimax`: the angle in degrees that a round shape covers, at most 360.
fn sweep(params: &mut Params) -> f64 {
    params.float("phimax", 360.0, |v| v > 0.0, "above 0").min(360.0)
}

/// Returns the area of a shape in world space; `None` for a sphere or disk that the transform does not scale uniformly.
fn world_area(geometry: &Geometry, to_world: DAffine3) -> Option<f64> {
    let even = || {
        let (axes, scale) = (to_world.matrix3, to_world.matrix3.x_axis.length());
        let wanted = DMat3::from_diagonal(DVec3::splat(scale * scale));
        (axes.transpose() * axes).abs_diff_eq(wanted, 2e-6 * scale * scale).then_some(scale * scale)
    };
    let area = match geometry {
        Geometry::Mesh(mesh) => {
            let corner = |i: u32| to_world.transform_point3(mesh.positions[i as usize]);
            let twice = |&[a, b, c]: &[u32; 3]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).length();
            mesh.triangles.iter().map(twice).sum::<f64>() / 2.0
        }
        Geometry::Sphere { radius } => 4.0 * PI * radius * radius * even()?,
        Geometry::Disk { radius, inner_radius, .. } => PI * (radius * radius - inner_radius * inner_radius) * even()?,
    };
    Some(area)
}

fn triangle_mesh(params: &mut Params) -> Option<Geometry> {
    let (positions, normals, uvs) = vertices(params)?;
    params.ignore(&["S", "faceIndices"]);
    let triangles = indices(params, "triangle", positions.len())?;
    let mesh = MeshData { positions, normals, uvs, triangles, ..MeshData::default() };
    check(&mesh, params)?;
    Some(Geometry::Mesh(Arc::new(mesh)))
}

fn check(mesh: &MeshData, params: &mut Params) -> Option<()> {
    mesh.check().map_err(|fault| params.problem(params.line(), format!("{}: {fault}", params.of))).ok()
}

fn positions(params: &mut Params) -> Option<Vec<DVec3>> {
    let (points, _) = params.numbers("P", &[Type::Point3], 3).or_else(|| params.lacks("\"point3 P\""))?;
    Some(points.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// Positions, normals and texture coordinates of a mesh.
type Vertices = (Vec<DVec3>, Vec<[f32; 3]>, Vec<[f32; 2]>);

fn vertices(params: &mut Params) -> Option<Vertices> {
    let positions = positions(params)?;
    let normals = singles::<3>(params.numbers("N", &[Type::Normal], 3));
    // pbrt-v3 also names texture coordinates `st`; pbrt-v2 and v3 declare them float.
    let uv = if params.has("uv") { "uv" } else { "st" };
    let uvs = singles::<2>(params.numbers(uv, &[Type::Point2, Type::Float], 2));
    Some((positions, normals, uvs))
}

/// The declaration of vertex indices, for messages.
const INDICES: &str = "\"integer indices\"";

/// Takes the vertex indices in groups of `N`, each called `what` in messages. Exactly `N` vertices need no indices: they form
/// one group. `None`, with a reported problem, if indices are missing, or if one is not below `vertices`.
fn indices<const N: usize>(params: &mut Params, what: &str, vertices: usize) -> Option<Vec<[u32; N]>> {
    let Some((numbers, line)) = params.numbers("indices", &[Type::Integer], N) else {
        let all = std::array::from_fn(|i| i as u32);
        return if vertices == N && !params.is_bad() { Some(vec![all]) } else { params.lacks(INDICES) };
    };
    let end = (vertices as f64).min(f64::from(u32::MAX) + 1.0);
    if let Some(at) = numbers.iter().position(|c| c.fract() != 0.0 || !(0.0..end).contains(c)) {
        let (group, of, index, last) = (at / N, &params.of, numbers[at], vertices - 1);
        let what = format!("{what} {group} of {of} has vertex index {index}");
        return params.fail(line, what + &format!("; indices are whole numbers from 0 to {last}"));
    }
    Some(numbers.as_chunks::<N>().0.iter().map(|corners| corners.map(|c| c as u32)).collect())
}

/// Returns numbers in groups of `N`, in single precision; empty for `None`.
fn singles<const N: usize>(numbers: Option<(Vec<f64>, u32)>) -> Vec<[f32; N]> {
    let (numbers, _) = numbers.unwrap_or_default();
    numbers.chunks_exact(N).map(|group| std::array::from_fn(|i| group[i] as f32)).collect()
}
