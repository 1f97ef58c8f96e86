//! Files of pbrt-v2 and pbrt-v3.

use crate::reader_messages::{WORLD, pfm, read_with};
use dapple_scene::ReadError;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};
use dapple_scene::{
    Color, EnvironmentRadiance, LightKind, MaterialKind, PixelFilter, Scalar, Scene, SpotFalloff, TextureKind,
};
use glam::DVec3;

fn read(text: &str) -> Result<Scene, ReadError> {
    let image = pfm([2, 4], |i| [i as f32, 1.0, 0.0]);
    let files: &[(&str, &[u8])] = &[("s.pbrt", text.as_bytes()), ("p.pfm", &image)];
    read_scene_from(files, "s.pbrt", &ReadOptions::default())
}

const TAIL: &str = "LightSource \"infinite\"\nShape \"sphere\"\nWorldEnd\n";

/// A scene of pbrt-v2 (without, with what makes it one of pbrt-v3) and this text in its world, from line 4 on.
fn world(version: u32, text: &str) -> Scene {
    let mark = if version == 2 { "SurfaceIntegrator \"path\"" } else { "Integrator \"path\"" };
    let text = format!("{mark}\nCamera \"perspective\"\nWorldBegin\n{text}\n{TAIL}");
    read(&text).unwrap_or_else(|e| panic!("{text}: {e}"))
}

fn kind(version: u32, text: &str) -> MaterialKind {
    let scene = world(version, &format!("{text}\nShape \"disk\""));
    scene.materials[scene.shapes[0].material.0 as usize].kind.clone()
}

fn said(scene: &Scene) -> String {
    scene.notices.iter().map(|n| format!("{}: {}\n", n.source, n.message)).collect()
}

#[test]
fn defaults_of_older_versions() {
    for version in [2, 3] {
        let scene = world(version, "");
        assert_eq!(scene.film.resolution, [640, 480]);
        assert_eq!(scene.film.pixel_filter, PixelFilter::Box { radius: [0.5, 0.5] });
        assert!(said(&scene).starts_with(&format!(
            "s.pbrt: this file is of an older version and is read by the rules of pbrt-v{version}\n"
        )));
        // pbrt-v2's path tracer lights one vertex more.
        assert_eq!(scene.max_depth, Some(if version == 2 { 6 } else { 5 }));
    }
    let deep = |head: &str| read(&format!("{head}\nCamera \"perspective\"\nWorldBegin\n{TAIL}")).unwrap().max_depth;
    assert_eq!(deep("SurfaceIntegrator \"directlighting\" \"integer maxdepth\" 3"), Some(3));
    assert_eq!(deep("Renderer \"metropolis\""), Some(7));
    assert_eq!(deep("Integrator \"bdpt\" \"integer maxdepth\" 3"), Some(3));
    let bare = read(&format!("Camera \"perspective\"\nWorldBegin\n{TAIL}")).unwrap();
    assert!(said(&bare).contains("no SurfaceIntegrator is named"), "{}", said(&bare));
    let filter = "PixelFilter \"gaussian\" \"float xwidth\" 3 \"float alpha\" .5\n";
    let scene = read(&format!("{filter}Camera \"perspective\" \"float halffov\" 20\nWorldBegin\n{TAIL}")).unwrap();
    assert_eq!(scene.film.pixel_filter, PixelFilter::Gaussian { radius: [3.0, 2.0], sigma: 1.0 });
    assert_eq!(scene.camera.projection, dapple_scene::Projection::Perspective { fov: 40.0 });
}

#[test]
fn old_materials() {
    let scene = world(3, "Material \"matte\" \"color Kd\" [.1 .2 .3] \"float sigma\" 20");
    assert_eq!(scene.materials[0].kind, MaterialKind::Diffuse { reflectance: Color::Constant([0.1, 0.2, 0.3]) });
    assert!(said(&scene).contains("s.pbrt:4: sigma of Material \"matte\" (Oren-Nayar) is read as 0 (Lambert)"));
    assert!(!said(&world(3, "Material \"matte\" \"float sigma\" 0")).contains("sigma"));
    let alpha = |version, text: &str| match kind(version, text) {
        MaterialKind::Plastic { roughness, .. }
        | MaterialKind::Substrate { roughness, .. }
        | MaterialKind::Conductor { roughness, .. }
        | MaterialKind::Dielectric { roughness, .. } => {
            assert!(!roughness.remap);
            roughness.constants().unwrap()
        }
        other => panic!("{other:?}"),
    };
    let near = |a: [f32; 2], b: [f32; 2]| (0..2).all(|i| (a[i] - b[i]).abs() < 2e-3);
    assert!(near(alpha(3, "Material \"plastic\""), [0.4618; 2]), "{:?}", alpha(3, "Material \"plastic\""));
    assert!(near(alpha(3, "Material \"plastic\" \"bool remaproughness\" \"false\""), [0.1; 2]));
    assert!(near(alpha(2, "Material \"plastic\""), [(2.0f32 / 12.0).sqrt(); 2]));
    assert!(near(
        alpha(2, "Material \"substrate\" \"float uroughness\" .5"),
        [(2.0f32 / 4.0).sqrt(), (2.0f32 / 12.0).sqrt()]
    ));
    assert!(near(alpha(2, "Material \"metal\" \"float roughness\" .001"), [(2.0f32 / 1002.0).sqrt(); 2]));
    assert!(near(alpha(3, "Material \"glass\""), [0.0; 2]));
    assert!(
        said(&world(2, "Material \"metal\" \"float roughness\" .001"))
            .contains("roughness 0.001 of Material \"metal\" (Blinn)")
    );
    assert!(matches!(kind(2, "Material \"glass\" \"float index\" 1.3"), MaterialKind::Dielectric { eta: 1.3, .. }));
    assert!(matches!(
        kind(2, "Material \"mirror\""),
        MaterialKind::Mirror { reflectance: Color::Constant([0.9, 0.9, 0.9]) }
    ));
    let mix = "MakeNamedMaterial \"a\" \"string type\" \"matte\"\nMakeNamedMaterial \"b\" \"string type\" \"mirror\"\nMaterial \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\" \"color amount\" [.25 .25 .25]";
    // The share there is that of the first.
    assert!(matches!(kind(3, mix), MaterialKind::Mix { amount: Scalar::Constant(0.75), .. }));
    for kind in ["uber", "translucent", "shinymetal", "disney"] {
        let text = format!("Film \"image\"\nCamera \"perspective\"\nWorldBegin\nMaterial \"{kind}\"\n{TAIL}");
        let expected =
            format!("s.pbrt:4: Material \"{kind}\" is not supported; remove it, or allow unsupported directives");
        assert_eq!(read(&text).unwrap_err().to_string(), expected);
    }
}

#[test]
fn old_textures_and_bumps() {
    let text = "Texture \"c\" \"color\" \"imagemap\" \"string filename\" \"p.pfm\" \"float vscale\" 2 \"float vdelta\" .25\nTexture \"f\" \"float\" \"imagemap\" \"string filename\" \"p.pfm\"\nTexture \"s\" \"float\" \"scale\" \"texture tex1\" \"f\" \"float tex2\" -.5\nMaterial \"matte\" \"texture Kd\" \"c\" \"texture bumpmap\" \"s\"";
    let shift = |version| {
        let scene = world(version, text);
        let TextureKind::Image { scale, shift, .. } = scene.textures[0].kind else { panic!() };
        let material = &scene.materials[0];
        let Some(Scalar::Texture(bump)) = material.bump else { panic!() };
        let TextureKind::Image { factor, image, .. } = &scene.textures[bump.0 as usize].kind else { panic!() };
        assert_eq!(*factor, -0.5);
        // Luminance, not the mean.
        assert!((image.pixels[0][0] - 0.71516).abs() < 1e-6);
        (scale, shift)
    };
    // pbrt-v2's first row of an image is at v = 0.
    assert_eq!(shift(2), ([1.0, -2.0], [0.0, 0.75]));
    assert_eq!(shift(3), ([1.0, 2.0], [0.0, 0.25]));
}

#[test]
fn old_lights() {
    let scene = world(
        2,
        "LightSource \"infinite\" \"string mapname\" \"p.pfm\" \"color L\" [2 1 1] \"integer nsamples\" 4\nLightSource \"spot\" \"color I\" [4 4 4] \"color scale\" [1 2 3] \"point from\" [0 1 0]\nAreaLightSource \"area\" \"color L\" [3 3 3] \"integer nsamples\" 8",
    );
    let LightKind::Infinite { radiance: EnvironmentRadiance::LatLong { image, scale } } = &scene.lights[0].kind else {
        panic!()
    };
    assert_eq!((image.pixels[3], *scale), ([6.0, 1.0, 0.0], 1.0));
    let LightKind::Spot { intensity, falloff, .. } = scene.lights[1].kind else { panic!() };
    assert_eq!((intensity, falloff), ([4.0, 8.0, 12.0], SpotFalloff::Quartic));
    assert_eq!(scene.shapes[0].emission.unwrap().radiance, [3.0; 3]);
    assert!(!said(&scene).contains("nsamples"));
    // A temperature and a scale.
    let scene = world(3, "LightSource \"distant\" \"blackbody L\" [5000 2]");
    let LightKind::Distant { irradiance: [r, g, b] } = scene.lights[0].kind else { panic!() };
    assert!(r > g && g > b && r < 3.0 && b > 1.0, "{r} {g} {b}");
}

#[test]
fn transform_blocks_keep_the_rest() {
    let scene =
        world(3, "TransformBegin\nTranslate 1 2 3\nMaterial \"mirror\"\nShape \"disk\"\nTransformEnd\nShape \"disk\"");
    assert_eq!(scene.shapes[1].to_world.translation, DVec3::ZERO);
    assert_eq!(scene.shapes[0].material, scene.shapes[1].material);
    assert!(!said(&scene).contains("TransformBegin"));
}

#[test]
fn versions_by_their_words() {
    for (before, within, end, version) in [
        ("Film \"image\"", "Material \"matte\"", "WorldEnd", 2),
        ("Integrator \"path\"", "Material \"matte\" \"color Kd\" [1 1 1]", "", 3),
        ("Integrator \"path\"\nFilm \"rgb\"", "Material \"diffuse\"", "", 4),
        ("SurfaceIntegrator \"path\"", "", "", 2),
        ("", r#"MakeNamedMaterial "m" "string type" "uber""#, r#"MakeNamedMedium "x" "string type" "homogeneous""#, 3),
        // One mark of the newest version outweighs the older ones.
        ("Film \"rgb\"", "Material \"matte\"", "WorldEnd", 4),
        ("", "MakeNamedMaterial \"matte\" \"string type\" [\"diffuse\"]", "", 4),
        // The name of a material is no type.
        ("", "MakeNamedMaterial \"matte\" \"string type\" [\"none\"]", "", 4),
        ("", "", "", 4),
    ] {
        let text = format!("{before}\n{WORLD}LightSource \"point\"\nShape \"sphere\"\n{within}\n{end}\n");
        let options = ReadOptions { allow_unsupported: true, ..ReadOptions::default() };
        let said = said(&read_with(&text, &options).unwrap_or_else(|e| panic!("{text}: {e}")));
        let old = (2..4).find(|version| said.contains(&format!("the rules of pbrt-v{version}")));
        assert_eq!(old.unwrap_or(4), version, "{text}: {said}");
    }
}

#[test]
fn roughness_of_older_versions() {
    let alpha = |version: u32, roughness: f32| {
        let kind = kind(version, &format!("Material \"plastic\" \"float roughness\" {roughness}"));
        let MaterialKind::Plastic { roughness, .. } = kind else { panic!("{kind:?}") };
        roughness.constants().expect("constants")[0]
    };
    assert!((alpha(2, 0.001) - (2.0f32 / 1002.0).sqrt()).abs() < 1e-7);
    assert_eq!(alpha(2, 0.0), alpha(2, 1e-9));
    assert!((alpha(2, 1e30) - 1.0).abs() < 1e-7);
    // Worked out by hand at roughness 1 and 0.1.
    assert_eq!(alpha(3, 1.0), 1.62142);
    assert!((alpha(3, 0.1) - 0.4618).abs() < 2e-4, "{}", alpha(3, 0.1));
    assert_eq!(alpha(3, 0.0), alpha(3, 1e-3));
}
