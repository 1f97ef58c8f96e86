//! Materials and textures of pbrt-v4: the descriptions that they make, and the errors of wrong ones.

use crate::snippets::*;
use dapple_scene::{Color, ConductorFresnel, MaterialKind, Scalar, TextureKind, Wrap};

#[test]
fn materials_of_the_fourth_version() {
    let MaterialKind::Dielectric { eta, roughness, .. } =
        kind("Material \"dielectric\" \"spectrum eta\" \"glass-BK7\" \"float uroughness\" .3")
    else {
        panic!()
    };
    assert_eq!((eta, roughness.constants(), roughness.remap), (1.5168, Some([0.3, 0.0]), true));
    assert!(matches!(kind("Material \"thindielectric\" \"float eta\" 1.3"), MaterialKind::ThinDielectric { eta: 1.3 }));
    let sampled = "Material \"dielectric\" \"spectrum eta\" [487.6 1 687.6 3]";
    assert!(matches!(kind(sampled), MaterialKind::Dielectric { eta: 2.0, .. }));
    let MaterialKind::Conductor { fresnel: ConductorFresnel::EtaK { eta, k }, .. } =
        kind("Material \"conductor\" \"spectrum eta\" \"metal-TiO2-eta\" \"spectrum k\" \"metal-MgO-k\"")
    else {
        panic!()
    };
    assert!(close(eta, [3.457, 2.802, 2.905], 1e-3) && k == [0.0; 3]);
    let MaterialKind::CoatedConductor { fresnel, roughness, coat } = kind(
        "Material \"coatedconductor\" \"float conductor.roughness\" .2 \"float interface.roughness\" .1 \"float interface.eta\" 1.4 \"spectrum conductor.eta\" \"metal-Au-eta\" \"integer maxdepth\" 7",
    ) else {
        panic!()
    };
    assert_eq!((roughness.constants(), coat.roughness.constants()), (Some([0.2; 2]), Some([0.1; 2])));
    assert_eq!((coat.eta, coat.max_depth, coat.samples), (1.4, 7, 1));
    // k is left at copper's.
    assert!(matches!(fresnel, ConductorFresnel::EtaK { eta, k } if eta[0] < 0.15 && k[0] < 3.92));
    let paper = "Material \"diffusetransmission\" \"rgb reflectance\" [.4 .4 .4] \"float scale\" .5";
    assert!(matches!(
        kind(paper),
        MaterialKind::DiffuseTransmission {
            reflectance: Color::Constant([0.2, 0.2, 0.2]),
            transmittance: Color::Constant([0.125, 0.125, 0.125])
        }
    ));
    let textured = "Texture \"t\" \"spectrum\" \"checkerboard\"\nMaterial \"diffusetransmission\" \"texture reflectance\" \"t\" \"float scale\" .5";
    let scene = world(textured);
    let scaled = scene.textures.iter().find(|texture| matches!(texture.kind, TextureKind::Product { .. }));
    let TextureKind::Product { factors } = scaled.expect("a scaled texture").kind else { unreachable!() };
    assert_eq!(factors[1], Color::Constant([0.5; 3]), "the scale goes into the texture");
    assert!(matches!(kind("Material \"interface\""), MaterialKind::Interface));
    for (text, expected) in [
        (
            "Material \"dielectric\" \"float eta\" 0",
            "s.pbrt:4: parameter eta of Material \"dielectric\" must be above 0, not 0",
        ),
        (
            "Material \"coatedconductor\" \"rgb reflectance\" [1 1 1] \"rgb conductor.k\" [1 1 1]",
            "s.pbrt:4: Material \"coatedconductor\" has both reflectance and conductor.k; remove one",
        ),
        (
            "Material \"diffusetransmission\" \"float scale\" 9",
            "s.pbrt:4: Material \"diffusetransmission\": reflectance and transmittance, scaled, must not be above 1",
        ),
        (
            "Material \"dielectric\" \"spectrum eta\" \"stdillum-A\"",
            "s.pbrt:4: spectrum \"stdillum-A\" as eta of Material \"dielectric\" is not supported; remove it, or allow unsupported directives",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn mixes_are_settled_at_the_end() {
    let text = "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .25\nNamedMaterial \"m\"\nShape \"disk\"\nMakeNamedMaterial \"b\" \"string type\" \"diffuse\"\nMakeNamedMaterial \"a\" \"string type\" \"interface\"";
    let scene = world(text);
    let MaterialKind::Mix { materials, amount } = scene.materials[0].kind else { panic!() };
    assert_eq!(
        (materials.map(|m| scene.materials[m.0 as usize].name.clone()), amount),
        (["a".into(), "b".into()], Scalar::Constant(0.25))
    );
    for (text, expected) in [
        (
            "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [\"m\" \"m\"]",
            "s.pbrt:4: material \"m\" mixes itself, or mixes more than 8 deep; name other materials",
        ),
        (
            "MakeNamedMaterial \"n\" \"string type\" \"mix\" \"string materials\" \"n\"",
            "s.pbrt:4: parameter materials of MakeNamedMaterial \"n\" takes 2 names, not 1",
        ),
        ("Material \"mix\"", "s.pbrt:4: Material \"mix\" lacks \"string materials\" with two names"),
        (
            "Material \"mix\" \"string materials\" [\"x\" \"y\"]",
            "s.pbrt:4: unknown material \"x\"; make it by MakeNamedMaterial\ns.pbrt:4: unknown material \"y\"; make it by MakeNamedMaterial",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn textures_of_numbers_and_colours() {
    let imagemap = "\"imagemap\" \"string filename\" \"wide.pfm\"";
    let text = format!(
        "Texture \"f\" \"float\" {imagemap} \"string wrap\" \"clamp\" \"bool invert\" true\nTexture \"c\" \"spectrum\" {imagemap} \"float uscale\" 3\nTexture \"b\" \"float\" \"checkerboard\" \"float tex1\" .25 \"texture tex2\" \"f\"\nTexture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"c\" \"rgb tex2\" [1 0 0] \"texture amount\" \"b\"\nTexture \"p\" \"spectrum\" \"scale\" \"texture tex\" \"m\" \"texture scale\" \"f\"\nTexture \"h\" \"float\" \"scale\" \"texture tex\" \"f\" \"float scale\" -2\nMaterial \"conductor\" \"texture roughness\" \"b\" \"texture reflectance\" \"p\" \"texture displacement\" \"h\"\nShape \"disk\" \"texture alpha\" \"f\"\nMaterial \"diffuse\" \"string normalmap\" \"square.pfm\"\nShape \"disk\" \"float alpha\" .5\nShape \"disk\" \"float alpha\" 1"
    );
    let scene = world(&text);
    let texture = |name: &str| {
        let found = scene.textures.iter().position(|t| t.name == name);
        found.unwrap_or_else(|| panic!("{name}: {:?}", scene.textures.iter().map(|t| &t.name).collect::<Vec<_>>()))
    };
    let id = |name: &str| dapple_scene::TextureId(texture(name) as u32);
    let TextureKind::Image { image, invert, wrap, .. } = &scene.textures[texture("f")].kind else { panic!() };
    // The mean of the channels; 4 is the first pixel of the lower row.
    assert_eq!((image.pixels[4], *invert, *wrap), ([4.75 / 3.0; 3], true, Wrap::Clamp));
    let TextureKind::Image { image, scale, .. } = &scene.textures[texture("c")].kind else { panic!() };
    assert_eq!((image.pixels[4], *scale), ([4.0, 0.5, 0.25], [3.0, 1.0]));
    let TextureKind::Checkerboard { colors, .. } = scene.textures[texture("b")].kind else { panic!() };
    assert_eq!(colors, [Color::Constant([0.25; 3]), Color::Texture(id("f"))]);
    let TextureKind::Mix { colors, amount } = scene.textures[texture("m")].kind else { panic!() };
    assert_eq!((colors[0], amount), (Color::Texture(id("c")), Scalar::Texture(id("b"))));
    let TextureKind::Product { factors } = scene.textures[texture("p")].kind else { panic!() };
    assert_eq!(factors, [Color::Texture(id("m")), Color::Texture(id("f"))]);
    // What is inverted cannot take a factor in.
    assert!(matches!(scene.textures[texture("h")].kind, TextureKind::Product { .. }));
    let material = &scene.materials[scene.shapes[0].material.0 as usize];
    let MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(r), roughness } = &material.kind else {
        panic!()
    };
    assert_eq!(
        (*r, roughness.u, material.bump),
        (Color::Texture(id("p")), Scalar::Texture(id("b")), Some(Scalar::Texture(id("h"))))
    );
    assert_eq!(scene.shapes[0].alpha, Some(Scalar::Texture(id("f"))));
    assert_eq!((scene.shapes[1].alpha, scene.shapes[2].alpha), (Some(Scalar::Constant(0.5)), None));
    assert!(scene.materials[scene.shapes[1].material.0 as usize].normal_map.is_some());

    let nest: String =
        (0..9).map(|i| format!("Texture \"t{}\" \"float\" \"mix\" \"texture tex1\" \"t{i}\"\n", i + 1)).collect();
    let nested = format!("Texture \"t0\" \"float\" {imagemap}\n{nest}");
    assert!(
        complaint(&nested).starts_with("s.pbrt:12: textures are nested too deep; at most 8"),
        "{}",
        complaint(&nested)
    );
    for (text, expected) in [
        (
            "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"wide.pfm\" \"string encoding\" \"gama 2\"",
            "s.pbrt:4: parameter encoding of Texture \"imagemap\" must be sRGB, linear, or gamma and a number above 0, not \"gama 2\"",
        ),
        (
            "Texture \"t\" \"float\" \"fbm\"\nMaterial \"conductor\" \"texture roughness\" \"t\"",
            "s.pbrt:5: a texture of class \"fbm\" as roughness of Material \"conductor\" is not supported; remove it, or allow unsupported directives",
        ),
        ("Shape \"disk\" \"float alpha\" 2", "s.pbrt:4: parameter alpha of Shape \"disk\" must be within 0..=1, not 2"),
        (
            "Shape \"disk\" \"texture alpha\" \"t\"",
            "s.pbrt:4: unknown texture \"t\"; make it by Texture above this line",
        ),
        ("Texture \"t\" \"color\" \"constant\"", "s.pbrt:4: a texture is of type spectrum or float, not \"color\""),
        (
            "Material \"diffuse\" \"string normalmap\" \"none.png\"",
            "s.pbrt:4: cannot read none.png: no such file; check the name and that the file is there",
        ),
    ] {
        assert_eq!(complaint(text), expected);
    }
}

/// An image as a texture: of numbers, then of colours.
fn image_of(file: &str) -> [Vec<[f32; 3]>; 2] {
    let image = format!("\"imagemap\" \"string filename\" \"{file}\" \"string encoding\" \"linear\"");
    let scene = world(&format!(
        "Texture \"n\" \"float\" {image}\nTexture \"c\" \"spectrum\" {image}\nMaterial \"diffuse\" \"texture reflectance\" \"c\"\nShape \"disk\" \"texture alpha\" \"n\""
    ));
    ["n", "c"].map(|name| {
        let texture = scene.textures.iter().find(|t| t.name == name).expect("it is used");
        let TextureKind::Image { image, .. } = &texture.kind else { panic!("{name} is an image") };
        image.pixels.clone()
    })
}

#[test]
fn numbers_are_opacity_where_an_image_has_any() {
    for file in ["leaf.png", "leaf.tga"] {
        let [numbers, colours] = image_of(file);
        // 51 of 255, and not the mean of the colours, 120 of 255.
        assert_eq!(numbers, [[0.2; 3], [1.0; 3]], "{file}");
        let expected = [60.0, 120.0, 180.0].map(|c: f32| c / 255.0);
        assert!(close(colours[0], expected, 1e-6), "{file}: {colours:?}");
    }
    // Opaque throughout, it is as if there were none.
    let [numbers, _] = image_of("opaque.png");
    assert!(close(numbers[0], [120.0 / 255.0; 3], 1e-6) && numbers[1] == [0.0; 3], "{numbers:?}");
}
