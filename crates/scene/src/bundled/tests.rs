use super::directions::{add, cross, dot, lat_long_direction, length, normalize, scale, sin_cos, sub};
use super::mesh::Mesh;
use super::{DEFAULT, cornell, files, names, plates, teapot, terrain};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

#[test]
#[allow(clippy::print_stderr)] // A skipped test has to say so.
fn committed_files_are_what_the_generator_makes() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    if !root.join("Cargo.lock").exists() {
        eprintln!("skipped: the crate is built alone, without examples/scenes beside it");
        return;
    }
    let scenes = root.join("examples/scenes");
    let mut total = 0;
    for name in names() {
        let bundle = files(name).unwrap();
        let folder = scenes.join(name);
        for (file, bytes) in &bundle.files {
            let committed = fs::read(folder.join(file)).unwrap_or_default();
            assert!(committed == *bytes, "{name}/{file} differs: cargo run --example generate_scenes");
            total += bytes.len();
        }
        assert_eq!(fs::read_dir(folder).unwrap().count(), bundle.files.len(), "{name} holds a file that nobody made");
    }
    assert!(total < 4_500_000, "{total} bytes are too many to commit");
}

#[test]
fn bundles_are_deterministic_and_known_by_name() {
    assert_eq!(names()[0], DEFAULT);
    for name in names() {
        let bundle = files(name).unwrap();
        assert_eq!(Some(&bundle), files(name).as_ref());
        assert_eq!(bundle.name, *name);
        assert_eq!(bundle.file(&bundle.main), Some(bundle.files[0].1.as_slice()));
    }
    assert_eq!(files("Teapot"), None);
    assert_eq!(files(""), None);
}

/// The words of a pbrt file: quoted strings (with their quotes), brackets, bare words.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    for line in text.lines() {
        // No string of ours holds a `#`.
        let line = line.split('#').next().unwrap();
        for (number, piece) in line.split('"').enumerate() {
            if number % 2 == 1 {
                words.push(format!("\"{piece}\""));
            } else {
                words.extend(piece.replace('[', " [ ").replace(']', " ] ").split_whitespace().map(str::to_owned));
            }
        }
        assert_eq!(line.matches('"').count() % 2, 0, "a string is left open: {line}");
    }
    words
}

#[test]
fn scene_files_are_pbrt_words_and_name_only_their_own_files() {
    const DIRECTIVES: [&str; 29] = [
        "Film",
        "PixelFilter",
        "Sampler",
        "Integrator",
        "Scale",
        "LookAt",
        "Camera",
        "WorldBegin",
        "LightSource",
        "Texture",
        "MakeNamedMaterial",
        "NamedMaterial",
        "Shape",
        "AttributeBegin",
        "AttributeEnd",
        "AreaLightSource",
        "ReverseOrientation",
        "Translate",
        "Rotate",
        "ActiveTransform",
        "All",
        "EndTime",
        "TransformTimes",
        "ObjectBegin",
        "ObjectEnd",
        "ObjectInstance",
        "MakeNamedMedium",
        "MediumInterface",
        "true",
    ];
    for name in names() {
        let bundle = files(name).unwrap();
        let text = std::str::from_utf8(&bundle.files[0].1).unwrap();
        assert!(
            text.starts_with("# ") && text.contains("\n# Made by the Dapple developers. Licence: MIT OR Apache-2.0.\n")
        );
        let words = words(text);
        let (mut depth, mut attributes, mut used) = (0i32, 0i32, vec![bundle.main.clone()]);
        for (i, word) in words.iter().enumerate() {
            match word.as_str() {
                "[" => depth += 1,
                "]" => depth -= 1,
                "AttributeBegin" => attributes += 1,
                "AttributeEnd" => attributes -= 1,
                "\"string filename\"" => used.push(words[i + 1].trim_matches('"').to_owned()),
                quoted if quoted.starts_with('"') => {}
                bare => assert!(
                    bare.parse::<f64>().is_ok_and(f64::is_finite) || bare == "false" || DIRECTIVES.contains(&bare),
                    "{name}: {bare}"
                ),
            }
            assert!((0..=1).contains(&depth) && attributes >= 0, "{name}: brackets");
        }
        assert_eq!((depth, attributes), (0, 0), "{name}");
        used.remove(1); // the film's own
        let mut made: Vec<_> = bundle.files.iter().map(|(file, _)| file.clone()).collect();
        used.sort();
        used.dedup();
        made.sort();
        assert_eq!(used, made, "{name}");
    }
}

/// Triangles that are finite, have area, and whose normals are unit vectors on the winding's side.
fn assert_sound(mesh: &Mesh, name: &str) {
    assert_eq!(mesh.positions.len(), mesh.normals.len());
    assert!(mesh.positions.iter().chain(&mesh.normals).flatten().all(|x| x.is_finite()), "{name}");
    for &triangle in &mesh.triangles {
        // As a reader will see it: in f32.
        let [a, b, c] = mesh.corners(triangle).map(|point| point.map(|x| f64::from(x as f32)));
        let normal = cross(sub(b, a), sub(c, a));
        let longest = [sub(b, a), sub(c, b), sub(a, c)].map(length).into_iter().fold(0.0, f64::max);
        assert!(0.5 * length(normal) > 1e-3 * longest * longest, "{name}: sliver {triangle:?}");
        for corner in triangle {
            let shading = mesh.normals[corner as usize];
            assert!((length(shading) - 1.0).abs() < 1e-12, "{name}: {shading:?}");
            assert!(dot(shading, normal) > 0.0, "{name}: normal against the winding at {triangle:?}");
        }
    }
}

/// Borders of a mesh: each directed edge without its opposite. No edge may have more than two triangles.
fn borders(mesh: &Mesh) -> BTreeMap<u32, u32> {
    let mut edges = BTreeMap::new();
    for triangle in &mesh.triangles {
        for side in 0..3 {
            let edge = (triangle[side], triangle[(side + 1) % 3]);
            assert_eq!(edges.insert(edge, ()), None, "two triangles run along {edge:?} in the same direction");
        }
    }
    let open = edges.keys().filter(|&&(a, b)| !edges.contains_key(&(b, a)));
    let mut next = BTreeMap::new();
    for &(a, b) in open {
        assert_eq!(next.insert(a, b), None, "borders touch at corner {a}");
    }
    next
}

/// The closed loops that borders form.
fn loops(mut next: BTreeMap<u32, u32>) -> Vec<Vec<u32>> {
    let mut loops = Vec::new();
    while let Some((&first, _)) = next.first_key_value() {
        let (mut ring, mut corner) = (Vec::new(), first);
        while let Some(following) = next.remove(&corner) {
            ring.push(corner);
            corner = following;
        }
        assert_eq!(corner, first, "a border that does not close");
        loops.push(ring);
    }
    loops
}

#[test]
fn teapot_has_newells_patches() {
    let patches: Vec<_> = teapot::parts().into_iter().flatten().flatten().collect();
    assert_eq!(patches.len(), 32);
    // The published table lists 306 points, of which some repeat others; without repetitions there are 290.
    let mut points: Vec<[u64; 3]> = Vec::new();
    for point in patches.iter().flatten().flatten() {
        let bits = point.map(|x| (x + 0.0).to_bits());
        if !points.contains(&bits) {
            points.push(bits);
        }
    }
    assert_eq!(points.len(), 290);
}

#[test]
fn teapot_is_sound_and_open_only_where_newell_left_it() {
    let mesh = teapot::mesh();
    assert_eq!(mesh.triangles.len(), 32 * 2 * 12 * 12 - 2 * 4 * 12);
    assert_sound(&mesh, "teapot");
    let loops = loops(borders(&mesh));
    let mut centres: Vec<[i64; 3]> = loops
        .iter()
        .map(|ring| {
            let sum = ring.iter().fold([0.0; 3], |sum, &corner| add(sum, mesh.positions[corner as usize]));
            scale(sum, 10.0 / ring.len() as f64).map(|x| x.round() as i64)
        })
        .collect();
    centres.sort();
    // In tenths: the handle's two ends and the spout's foot and mouth, the lid's edge and the rim's inner edge.
    assert_eq!(centres.len(), 6);
    assert_eq!(centres.iter().filter(|centre| **centre == [0, 0, 24]).count(), 2, "{centres:?}");
    assert!(centres[0][0] < -15 && centres[1][0] < -15, "{centres:?}");
    assert!(centres[4][0] > 15 && centres[5][0] > 15, "{centres:?}");
    // The ends that only the body's wall hides are inside it.
    for ring in loops.iter().filter(|ring| ring.len() == 24) {
        // The handle's foot touches the wall in Newell's data: a point of it is a point of the body.
        let inside = ring.iter().all(|&corner| {
            let [x, y, z] = mesh.positions[corner as usize];
            let excess = (x * x + y * y).sqrt() - body_radius(z);
            excess < 1e-9
        });
        let mouth = ring.iter().any(|&corner| mesh.positions[corner as usize][0] > 2.5);
        assert!(inside || mouth);
    }
}

/// The body's radius at a height, from its own control points (the profile at y = 0), by bisection.
fn body_radius(z: f64) -> f64 {
    let [_, body, _, _] = teapot::parts();
    let profile: Vec<_> = body.iter().map(|piece| [0, 1, 2, 3].map(|row| piece[0][row][0])).collect();
    let value = |points: &[[f64; 3]; 4], t: f64, axis: usize| {
        let s = 1.0 - t;
        let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        (0..4).map(|i| weights[i] * points[i][axis]).sum::<f64>()
    };
    let piece = profile[1..].iter().find(|points| points[3][2] <= z && z <= points[0][2]).unwrap();
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if value(piece, middle, 2) > z { low = middle } else { high = middle }
    }
    value(piece, low, 0)
}

#[test]
fn teapot_normals_point_outwards_and_seams_are_smooth() {
    let mesh = teapot::mesh();
    // Signed volume over each closed part would need caps; the body's wall is star-shaped about its middle instead.
    let mut wall = 0;
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let [x, y, z] = *position;
        if (0.3..1.8).contains(&z) && x.abs() < 1.4 && (x * x + y * y).sqrt() > 1.4 {
            assert!(dot(*normal, [x, y, 0.0]) > 0.0, "inwards at {position:?}");
            wall += 1;
        }
    }
    assert!(wall > 300, "{wall}");
    // Handle and spout, below the mouth's inside: away from their plane of symmetry.
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals).filter(|(p, _)| p[0].abs() > 2.1 && p[2] < 2.3) {
        assert!(position[1] * normal[1] >= -1e-9, "inwards at {position:?}");
    }
    let up = |z: f64| mesh.positions.iter().position(|p| *p == [0.0, 0.0, z]).map(|i| mesh.normals[i]);
    assert_eq!(up(3.15), Some([0.0, 0.0, 1.0]));
    assert_eq!(up(0.0), Some([0.0, 0.0, -1.0]));
    let angle = teapot::largest_seam_angle();
    assert!(angle < 1e-6, "normals jump by {angle}");
}

#[test]
fn terrain_is_sound_and_its_parts_fit_together() {
    let ground = terrain::ground();
    assert_sound(&ground, "ground");
    // No hole that can be seen: the ground ends at the rim of the grid or under water.
    for corner in borders(&ground).into_keys() {
        let [x, y, z] = ground.positions[corner as usize];
        assert!(z < 0.0 || terrain::is_rim([x, y]), "a hole at {x} {y} {z}");
    }
    let parts = terrain::covers();
    let triangles: usize = parts.iter().map(|(_, part)| part.triangles.len()).sum();
    assert_eq!(triangles, ground.triangles.len());
    assert!((triangles as f64 / f64::from(1 << 17) - 1.0).abs() < 0.01, "{triangles}");
    for (name, part) in &parts {
        assert!(part.positions.len() <= 1 << 16, "{name} needs wide indices");
        assert!(part.triangles.len() > 10_000, "{name} is hardly there");
        assert!(part.triangles.iter().all(|&triangle| part.face_normal(triangle)[2] > 0.0), "{name} faces down");
    }
}

#[test]
fn ply_files_hold_what_their_headers_say() {
    for name in names() {
        for (file, bytes) in files(name).unwrap().files.iter().filter(|(file, _)| file.ends_with(".ply")) {
            let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
            let header = std::str::from_utf8(&bytes[..end]).unwrap();
            let count = |element: &str| -> usize {
                let rest = header.split(element).nth(1).unwrap();
                rest.split_whitespace().next().unwrap().parse().unwrap()
            };
            let (corners, faces) = (count("element vertex "), count("element face "));
            assert!(header.contains("list uchar ushort"));
            assert_eq!(bytes.len() - end, 24 * corners + 7 * faces, "{name}/{file}");
            for face in bytes[end + 24 * corners..].chunks_exact(7) {
                assert_eq!(face[0], 3);
                for index in face[1..].chunks_exact(2) {
                    assert!(usize::from(u16::from_le_bytes([index[0], index[1]])) < corners);
                }
            }
        }
    }
}

#[test]
fn cornell_box_faces_its_inside_and_its_blocks_outwards() {
    let middle = [278.0, 273.0, 279.0];
    let mut faces = 0;
    for (name, [a, b, c, d]) in cornell::quads() {
        let normal = normalize(cross(sub(b, a), sub(c, a)));
        let other = normalize(cross(sub(c, a), sub(d, a)));
        // The measured left wall is not quite a plane.
        assert!(dot(normal, other) > 1.0 - 1e-4, "{name} is bent");
        let centre = scale(add(add(a, b), add(c, d)), 0.25);
        let wanted = match name {
            "short block" => sub(centre, [185.5, 82.5, 169.0]),
            "tall block" => sub(centre, [368.5, 165.0, 351.5]),
            _ => sub(middle, centre),
        };
        assert!(dot(normal, wanted) > 0.0, "{name} faces the wrong way");
        faces += 1;
    }
    assert_eq!(faces, 5 + 2 * 5 + 1);
}

#[test]
fn plates_face_up_and_stand_above_the_floor() {
    for [a, b, c, d] in plates::plates() {
        assert!(cross(sub(b, a), sub(c, a))[2] > 0.0);
        assert!([a, b, c, d].iter().all(|corner| corner[2] > 0.0));
    }
}

#[test]
fn sines_are_exact_enough_and_directions_follow_the_environments_convention() {
    for i in 0..=1000 {
        let turns = f64::from(i) / 1000.0;
        let [sine, cosine] = sin_cos(turns);
        let angle = turns * std::f64::consts::TAU;
        assert!((sine - angle.sin()).abs() < 1e-12 && (cosine - angle.cos()).abs() < 1e-12, "{turns}");
    }
    // Row 0 is on top, column 0 begins at +x and turns towards +y.
    let [x, y, z] = lat_long_direction(0, 0, 256, 128);
    assert!(z > 0.99 && x > 0.0 && y > 0.0 && y < 0.05 * x);
}
