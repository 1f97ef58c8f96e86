//! Shapes.

use super::directive::Directive;
use super::params::{Params, Type, Values};
use super::reader::Reader;
use super::tokens::shown;
use crate::ply::read_ply;
use crate::scene::{Geometry, MeshData, Shape, Source};
use glam::DVec3;
use std::sync::Arc;

impl Reader<'_> {
    /// Carries out `Shape`.
    pub(super) fn add_shape(&mut self, mut d: Directive<'_>) {
        self.shapes_met += 1;
        let mut params = self.params(&mut d, "shape");
        let geometry = match d.texts[0].as_str() {
            "trianglemesh" => triangle_mesh(&mut params, d.source.line),
            "plymesh" => self.ply_mesh(&mut params, &d.source),
            "sphere" => sphere(&mut params),
            "disk" => disk(&mut params),
            kind => {
                params.unsupported(d.source.line, format!("Shape {}", shown(kind)));
                params.ignore_rest();
                None
            }
        };
        refuse_alpha(&mut params);
        let good = params.finish(&mut self.log);
        if self.in_object() {
            return;
        }
        let geometry = match geometry {
            Some(geometry) if good => geometry,
            // Kept, empty, so that its material is checked too; the scene is refused anyway.
            _ if self.log.has_problems() => Geometry::Mesh(Arc::default()),
            _ => return,
        };
        let material = self.current_material(&d.source);
        let (to_world, reversed, emission) = (self.state.ctm, self.state.reversed, self.state.emission);
        self.scene.shapes.push(Shape { emission, reversed, ..Shape::new(geometry, to_world, material, d.source) });
    }

    fn ply_mesh(&mut self, params: &mut Params, source: &Source) -> Option<Geometry> {
        for name in ["displacement", "edgelength"] {
            if let Some(param) = params.take(name) {
                params.unsupported(param.line, format!("parameter {name} of {}", params.of().to_owned()));
            }
        }
        let Some((name, line)) = params.text("filename") else {
            if !params.is_bad() {
                params.problem(source.line, format!("{} lacks \"string filename\"", params.of().to_owned()));
            }
            return None;
        };
        let path = self.resolve(&name);
        if let Some(mesh) = self.meshes.get(&path) {
            return Some(Geometry::Mesh(mesh.clone()));
        }
        let source = Source { line, ..source.clone() };
        // The reason has been given where this fails.
        let Some(bytes) = self.load(&path, &source) else {
            params.fail();
            return None;
        };
        match read_ply(&bytes) {
            Ok(mesh) => {
                if let Some(what) = mesh.doubt {
                    params.notice(line, format!("{}: {what}", path.display()));
                }
                let mesh = Arc::new(mesh.data);
                self.meshes.insert(path, mesh.clone());
                Some(Geometry::Mesh(mesh))
            }
            Err(e) => {
                params.problem(line, format!("{}: {e}", path.display()));
                None
            }
        }
    }
}

fn triangle_mesh(params: &mut Params, line: u32) -> Option<Geometry> {
    let Some((points, _)) = params.numbers("P", &[Type::Point3], 3) else {
        if !params.is_bad() {
            params.problem(line, format!("{} lacks \"point3 P\"", params.of().to_owned()));
        }
        return None;
    };
    let positions: Vec<DVec3> = points.chunks_exact(3).map(DVec3::from_slice).collect();
    let normals = singles::<3>(params.numbers("N", &[Type::Normal], 3));
    // pbrt-v3 also calls them st, and both it and pbrt-v2 declare them float.
    let uv = if params.has("uv") { "uv" } else { "st" };
    let uvs = singles::<2>(params.numbers(uv, &[Type::Point2, Type::Float], 2));
    params.ignore(&["S", "faceIndices"]);
    let triangles = match params.numbers("indices", &[Type::Integer], 3) {
        Some((numbers, line)) => corners(params, &numbers, line, positions.len())?,
        None if params.is_bad() => return None,
        None if positions.len() == 3 => vec![[0, 1, 2]],
        None => {
            params.problem(line, format!("{} lacks \"integer indices\"", params.of().to_owned()));
            return None;
        }
    };
    let mesh = MeshData { positions, normals, uvs, triangles };
    match mesh.check() {
        Ok(()) => Some(Geometry::Mesh(Arc::new(mesh))),
        Err(fault) => {
            params.problem(line, format!("{}: {fault}", params.of().to_owned()));
            None
        }
    }
}

/// Corner numbers by threes.
fn corners(params: &mut Params, numbers: &[f64], line: u32, vertices: usize) -> Option<Vec<[u32; 3]>> {
    let mut triangles = Vec::with_capacity(numbers.len() / 3);
    for (i, corners) in numbers.chunks_exact(3).enumerate() {
        for &c in corners {
            if !(c.fract() == 0.0 && c >= 0.0 && c < vertices as f64 && c <= f64::from(u32::MAX)) {
                let what = format!(
                    "triangle {i} of {} has corner {c}: corners are whole numbers from 0 to {}",
                    params.of(),
                    vertices - 1
                );
                params.problem(line, what);
                return None;
            }
        }
        triangles.push([corners[0] as u32, corners[1] as u32, corners[2] as u32]);
    }
    Some(triangles)
}

/// Groups of `N` numbers in single precision.
fn singles<const N: usize>(numbers: Option<(Vec<f64>, u32)>) -> Vec<[f32; N]> {
    let (numbers, _) = numbers.unwrap_or_default();
    numbers.chunks_exact(N).map(|group| std::array::from_fn(|i| group[i] as f32)).collect()
}

fn sphere(params: &mut Params) -> Option<Geometry> {
    let radius = params.float("radius", 1.0, |v| v > 0.0, "above 0");
    let low = params.float("zmin", -radius, |_| true, "finite");
    let high = params.float("zmax", radius, |_| true, "finite");
    let sweep = params.float("phimax", 360.0, |_| true, "finite");
    if low.min(high) > -radius || low.max(high) < radius || sweep < 360.0 {
        params.unsupported_here("a partial sphere (zmin, zmax, phimax)");
        return None;
    }
    Some(Geometry::Sphere { radius })
}

fn disk(params: &mut Params) -> Option<Geometry> {
    let height = params.float("height", 0.0, |_| true, "finite");
    let radius = params.float("radius", 1.0, |v| v > 0.0, "above 0");
    let inner = |v: f64| v >= 0.0 && v < radius;
    let inner_radius = params.float("innerradius", 0.0, inner, "at least 0 and below radius");
    if params.float("phimax", 360.0, |_| true, "finite") < 360.0 {
        params.unsupported_here("a partial disk (phimax)");
        return None;
    }
    Some(Geometry::Disk { height, radius, inner_radius })
}

/// Cut-outs: only `float alpha 1`, which cuts nothing out, can be had.
fn refuse_alpha(params: &mut Params) {
    if let Some(param) = params.take("alpha") {
        let opaque = param.ty == Type::Float && matches!(&param.values, Values::Numbers(v) if v[..] == [1.0]);
        if !opaque {
            params.unsupported(param.line, format!("parameter alpha of {}", params.of().to_owned()));
        }
    }
}
