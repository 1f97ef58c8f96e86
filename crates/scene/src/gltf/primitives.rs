//! The meshes of a glTF file as shapes and instances.

use super::materials::Surface;
use super::nodes::Placed;
use super::{Fault, Reader, named};
use crate::model::no_uvs;
use crate::{Geometry, Instance, MeshData, Object, ObjectId, Shape, Source};
use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::material::AlphaMode;
use ::gltf::mesh::{Mode, Primitive, Semantic};
use ::gltf::{Accessor, Mesh, Node};
use glam::{DAffine3, DMat4, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A part of a mesh (primitive): triangles of one material.
#[derive(Clone)]
pub(super) struct Part {
    geometry: Arc<MeshData>,
    surface: Surface,
}

/// A pose of a mesh: the transforms of its skin's joints, and the weights of its morph targets.
type Pose<'a> = (&'a [DAffine3], &'a [f32]);

impl Reader<'_> {
    /// Adds the meshes of all nodes. A mesh that several nodes place becomes instances of one object, unless it emits light.
    pub(super) fn add_shapes(&mut self, placed: &[Placed<'_>]) -> Result<(), Fault> {
        let mut uses: BTreeMap<usize, usize> = BTreeMap::new();
        let meshes = placed.iter().filter_map(|p| p.node.mesh());
        meshes.for_each(|mesh| *uses.entry(mesh.index()).or_default() += 1);
        for Placed { node, to_world } in placed {
            let Some(mesh) = node.mesh() else { continue };
            if node.skin().is_some() || morphs(node, &mesh) {
                let joints = self.joints(node, placed)?;
                let weights = node.weights().or(mesh.weights()).unwrap_or(&[]).to_vec();
                let to_world = if joints.is_empty() { *to_world } else { DAffine3::IDENTITY };
                let parts = self.parts(&mesh, (&joints, &weights))?;
                self.place(parts, to_world);
                continue;
            }
            if to_world.matrix3.determinant() == 0.0 {
                self.warn(format!("{} has no extent; left out", named("node", node.index(), node.name())));
                continue;
            }
            if !self.meshes.contains_key(&mesh.index()) {
                let parts = self.parts(&mesh, Pose::default())?;
                self.meshes.insert(mesh.index(), parts);
            }
            let parts = self.meshes[&mesh.index()].clone();
            if uses[&mesh.index()] > 1 && parts.iter().all(|part| part.surface.emission.is_none()) {
                self.instance(&mesh, &parts, *to_world);
            } else {
                self.place(parts, *to_world);
            }
        }
        Ok(())
    }

    fn place(&mut self, parts: Vec<Part>, to_world: DAffine3) {
        let source = self.source;
        self.scene.shapes.extend(parts.into_iter().map(|part| part.shape(to_world, source)));
    }

    fn instance(&mut self, mesh: &Mesh<'_>, parts: &[Part], to_world: DAffine3) {
        if parts.is_empty() {
            return;
        }
        let (scene, source) = (&mut *self.scene, self.source);
        let object = *self.objects.entry(mesh.index()).or_insert_with(|| {
            let shapes = parts.iter().cloned().map(|part| part.shape(DAffine3::IDENTITY, source)).collect();
            let name = named("mesh", mesh.index(), mesh.name());
            scene.objects.push(Object { name, shapes, source: source.clone() });
            ObjectId(scene.objects.len() as u32 - 1)
        });
        scene.instances.push(Instance { object, to_world, moves_to: None, source: source.clone() });
    }

    /// The transforms of a skinned mesh's joints, from the mesh's space in its bind pose to world space; empty without a
    /// skin.
    fn joints(&self, node: &Node<'_>, placed: &[Placed<'_>]) -> Result<Vec<DAffine3>, Fault> {
        let Some(skin) = node.skin() else { return Ok(Vec::new()) };
        let bind = skin.inverse_bind_matrices().map(|accessor| self.buffers.floats::<16>(&accessor)).transpose()?;
        let bind: Vec<DAffine3> = bind.unwrap_or_default().into_iter().map(affine).collect();
        let world: BTreeMap<usize, DAffine3> = placed.iter().map(|p| (p.node.index(), p.to_world)).collect();
        let joint = |(k, joint): (usize, Node<'_>)| {
            let pose = world.get(&joint.index()).copied().unwrap_or(DAffine3::IDENTITY);
            pose * bind.get(k).copied().unwrap_or(DAffine3::IDENTITY)
        };
        Ok(skin.joints().enumerate().map(joint).collect())
    }

    /// Reads the parts of a mesh in a pose.
    fn parts(&mut self, mesh: &Mesh<'_>, pose: Pose<'_>) -> Result<Vec<Part>, Fault> {
        let mut parts = Vec::new();
        for primitive in mesh.primitives() {
            let name = format!("{}, part {}", named("mesh", mesh.index(), mesh.name()), primitive.index());
            if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
                self.warn(format!("{name} consists of points or lines; left out"));
                continue;
            }
            if primitive.get(&Semantic::Tangents).is_some() && primitive.material().normal_texture().is_some() {
                self.warn(format!("{name}: its tangents are left out; tangents follow from the texture coordinates"));
            }
            for (semantic, _) in primitive.attributes() {
                if let Semantic::Extras(name) = semantic {
                    self.warn(format!("vertex attribute \"_{name}\" is left out"));
                }
            }
            let colors = self.vertex_colors(&primitive, &name).map_err(|what| format!("{name}: {what}"))?;
            let surface = self.surface_of(&primitive.material(), !colors.is_empty())?;
            let data = self.mesh(&primitive, pose, surface.uv_set.unwrap_or(0));
            let mut data = data.map_err(|what| format!("{name}: {what}"))?;
            data.colors = colors;
            if data.triangles.is_empty() {
                continue;
            }
            if let Some(set) = surface.uv_set.filter(|_| data.uvs.is_empty()) {
                self.warn(format!("{name}: {}", no_uvs(&format!(" of set {set}"))));
            }
            if let Some(count) = data.mend_normals() {
                self.warn(format!("{name}: {count} normals are not finite; face normals are used instead"));
            }
            if let Some(count) = data.mend_colors() {
                self.warn(format!("{name}: {count} vertex colours are not finite; white is used instead"));
            }
            data.check().map_err(|e| format!("{name}: {e}"))?;
            parts.push(Part { geometry: Arc::new(data), surface });
        }
        Ok(parts)
    }

    fn mesh(&self, primitive: &Primitive<'_>, pose: Pose<'_>, uv_set: u32) -> Result<MeshData, String> {
        let (joints, weights) = pose;
        let Some(positions) = primitive.get(&Semantic::Positions) else { return Ok(MeshData::default()) };
        let vectors = |accessor: &Accessor<'_>| -> Result<Vec<DVec3>, String> {
            Ok(self.buffers.floats::<3>(accessor)?.into_iter().map(|v| DVec3::from_array(v.map(f64::from))).collect())
        };
        let mut positions = vectors(&positions)?;
        let normals = primitive.get(&Semantic::Normals).map(|accessor| vectors(&accessor)).transpose()?;
        let mut normals = normals.unwrap_or_default();
        for (target, &weight) in primitive.morph_targets().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            for (values, moved) in [(&mut positions, target.positions()), (&mut normals, target.normals())] {
                if let Some(accessor) = moved {
                    values.iter_mut().zip(vectors(&accessor)?).for_each(|(v, by)| *v += f64::from(weight) * by);
                }
            }
        }
        if !joints.is_empty() {
            self.bend(primitive, joints, [&mut positions, &mut normals])?;
        }
        let uvs = primitive.get(&Semantic::TexCoords(uv_set)).map(|accessor| self.buffers.floats::<2>(&accessor));
        // glTF's v runs from the top edge of an image, Dapple's from the bottom edge.
        let uvs = uvs.transpose()?.unwrap_or_default().into_iter().map(|[u, v]| [u, 1.0 - v]).collect();
        let indices = primitive.indices().map(|accessor| self.buffers.integers::<1>(&accessor)).transpose()?;
        let indices = indices.map_or_else(|| (0..positions.len() as u32).collect(), |i| i.into_flattened());
        let triangles = triangles(primitive.mode(), &indices);
        let normals = normals.into_iter().map(|n| n.as_vec3().to_array()).collect();
        Ok(MeshData { positions, normals, uvs, colors: Vec::new(), triangles })
    }

    /// The vertex colours of a part, linear RGB; empty without colours.
    fn vertex_colors(&mut self, primitive: &Primitive<'_>, name: &str) -> Result<Vec<[f32; 3]>, String> {
        if primitive.get(&Semantic::Colors(1)).is_some() {
            self.warn(format!("{name}: only the first set of vertex colours is used"));
        }
        let Some(accessor) = primitive.get(&Semantic::Colors(0)) else { return Ok(Vec::new()) };
        let colors: Vec<[f32; 4]> = match accessor.dimensions() {
            Dimensions::Vec3 => self.buffers.floats::<3>(&accessor)?.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect(),
            _ => self.buffers.floats::<4>(&accessor)?,
        };
        if primitive.material().alpha_mode() != AlphaMode::Opaque && colors.iter().any(|rgba| rgba[3] < 1.0) {
            self.warn(format!("{name}: the opacity of its vertex colours is left out"));
        }
        // Integers are normalized, even if the file does not mark them so.
        let scale = match accessor.data_type() {
            DataType::U8 if !accessor.normalized() => 255.0,
            DataType::U16 if !accessor.normalized() => 65_535.0,
            _ => 1.0,
        };
        Ok(colors.iter().map(|&[r, g, b, _]| [r, g, b].map(|c| if c < 0.0 { 0.0 } else { c / scale })).collect())
    }

    /// Applies a skin: each vertex moves with the weighted mean of its joints' transforms.
    fn bend(&self, primitive: &Primitive<'_>, joints: &[DAffine3], mesh: [&mut [DVec3]; 2]) -> Result<(), String> {
        let [positions, normals] = mesh;
        // Each set holds four joints per vertex.
        let mut sets = Vec::new();
        while let Some(indices) = primitive.get(&Semantic::Joints(sets.len() as u32))
            && let Some(weights) = primitive.get(&Semantic::Weights(sets.len() as u32))
        {
            sets.push((self.buffers.integers::<4>(&indices)?, self.buffers.floats::<4>(&weights)?));
        }
        if sets.is_empty() {
            return Ok(());
        }
        let bent = |k: usize| {
            let of_vertex = |(indices, weights): &(Vec<[u32; 4]>, Vec<[f32; 4]>)| {
                Some(indices.get(k)?.iter().copied().zip(*weights.get(k)?).collect::<Vec<_>>())
            };
            let joined: Vec<(u32, f32)> = sets.iter().filter_map(of_vertex).flatten().collect();
            let sum: f32 = joined.iter().map(|(_, weight)| weight).sum();
            let mut to_world = DAffine3::ZERO;
            for (joint, weight) in joined.into_iter().filter(|(_, w)| *w > 0.0) {
                let (share, joint) = (f64::from(weight / sum), joints.get(joint as usize)?);
                to_world.matrix3 += joint.matrix3 * share;
                to_world.translation += joint.translation * share;
            }
            (to_world != DAffine3::ZERO).then_some(to_world)
        };
        for (k, position) in positions.iter_mut().enumerate() {
            let Some(to_world) = bent(k) else { return Err("a vertex has no joint; export the file again".into()) };
            *position = to_world.transform_point3(*position);
            if let Some(normal) = normals.get_mut(k) {
                *normal = to_world.matrix3.inverse().transpose() * *normal;
            }
        }
        Ok(())
    }
}

impl Part {
    fn shape(self, to_world: DAffine3, source: &Source) -> Shape {
        let Surface { material, emission, alpha, media, .. } = self.surface;
        let shape = Shape::new(Geometry::Mesh(self.geometry), to_world, material, source.clone());
        Shape { emission, alpha, media, ..shape }
    }
}

/// True if a morph target moves the mesh of a node.
fn morphs(node: &Node<'_>, mesh: &Mesh<'_>) -> bool {
    node.weights().or(mesh.weights()).is_some_and(|weights| weights.iter().any(|w| *w != 0.0))
}

fn affine(columns: [f32; 16]) -> DAffine3 {
    DAffine3::from_mat4(DMat4::from_cols_array(&columns.map(f64::from)))
}

/// The triangles of a list, strip or fan.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    let windows = || indices.windows(3).enumerate();
    match mode {
        Mode::TriangleStrip => {
            windows().map(|(k, w)| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] }).collect()
        }
        // The first window is the fan's first triangle.
        Mode::TriangleFan => windows().map(|(_, w)| [indices[0], w[1], w[2]]).collect(),
        _ => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
