//! The nodes of a glTF scene, with their places in the world.

use super::{Fault, named};
use ::gltf::scene::Transform;
use ::gltf::{Document, Node};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};

/// The deepest nesting of nodes.
const DEEPEST: usize = 256;

/// A node and its transform to world space.
pub(super) struct Placed<'a> {
    pub(super) node: Node<'a>,
    pub(super) to_world: DAffine3,
}

/// Returns the nodes of the default scene (else of the first, else all), parents before children.
pub(super) fn place(document: &Document) -> Result<Vec<Placed<'_>>, Fault> {
    let mut placed = Vec::new();
    let mut seen = vec![false; document.nodes().len()];
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let roots: Vec<Node<'_>> = match scene {
        Some(scene) => scene.nodes().collect(),
        None => {
            let mut child = vec![false; seen.len()];
            document
                .nodes()
                .flat_map(|node| node.children().map(|c| c.index()).collect::<Vec<_>>())
                .for_each(|c| child[c] = true);
            document.nodes().filter(|node| !child[node.index()]).collect()
        }
    };
    let mut open: Vec<(Node<'_>, DAffine3, usize)> =
        roots.into_iter().rev().map(|node| (node, DAffine3::IDENTITY, 0)).collect();
    while let Some((node, parent, depth)) = open.pop() {
        let name = || named("node", node.index(), node.name());
        if std::mem::replace(&mut seen[node.index()], true) {
            return Err(format!("{}: has two parents; export the file again", name()).into());
        }
        if depth > DEEPEST {
            return Err(
                format!("{}: more than {DEEPEST} nodes lie within each other; flatten the scene", name()).into()
            );
        }
        let to_world = parent * local(&node);
        if !to_world.is_finite() {
            return Err(format!("{}: its transform is not finite; export the file again", name()).into());
        }
        let children: Vec<_> = node.children().map(|child| (child, to_world, depth + 1)).collect();
        open.extend(children.into_iter().rev());
        placed.push(Placed { node, to_world });
    }
    Ok(placed)
}

fn local(node: &Node<'_>) -> DAffine3 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            DAffine3::from_mat4(DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from))))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let [scale, translation] = [scale, translation].map(|v| DVec3::from_array(v.map(f64::from)));
            let rotation = DQuat::from_array(rotation.map(f64::from));
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(scale, rotation, translation)
        }
    }
}

/// The transform without its scale and shear, for cameras and lights. The -z axis keeps its direction, and the y axis its
/// plane.
pub(super) fn rigid(to_world: DAffine3) -> Option<DAffine3> {
    let back = to_world.matrix3.z_axis.try_normalize()?;
    let right = to_world.matrix3.y_axis.cross(back).try_normalize()?;
    Some(DAffine3 { matrix3: DMat3::from_cols(right, back.cross(right), back), translation: to_world.translation })
}
