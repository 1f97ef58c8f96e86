//! Materials ready to shade.

use super::*;
use crate::image::Picture;
use crate::scene::{Texture, TextureId, TextureKind, Wrap};
use std::sync::Arc;

fn surface(kind: MaterialKind) -> Result<Surface, String> {
    let made = Surface::new(&Material::new("m", kind, Source::default()));
    made.map_err(|e| e.to_string())
}

fn diffuse(rgb: [f32; 3]) -> MaterialKind {
    MaterialKind::Diffuse { reflectance: Color::Constant(rgb) }
}

fn metal(alpha: f32) -> MaterialKind {
    let fresnel = ConductorFresnel::EtaK { eta: [0.2; 3], k: [3.0; 3] };
    MaterialKind::Conductor { fresnel, roughness: Roughness::constant(alpha, alpha, false) }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    for bad in [-0.1, f32::NAN, f32::INFINITY] {
        assert!(surface(diffuse([0.5, bad, 0.5])).is_err_and(|e| e.contains("material \"m\"")), "{bad}");
        assert!(surface(metal(bad)).is_err(), "{bad}");
    }
    assert!(surface(metal(11.0)).is_err());
    assert!(surface(metal(0.0)).is_ok_and(|s| !s.several_lobes && !s.anisotropic));
    assert!(surface(diffuse([0.0; 3])).is_ok_and(|s| s.black));
}

#[test]
fn reflectances_lie_between_0_and_1() {
    let pixels = vec![[-0.5, 2.0, f32::NAN]];
    let picture = Arc::new(Picture::new([1, 1], pixels).expect("one pixel"));
    let kind = TextureKind::Image {
        picture,
        scale: [1.0; 2],
        shift: [0.0; 2],
        factor: 1.0,
        invert: false,
        wrap: Wrap::Repeat,
    };
    let textures = Textures::new(&[Texture { name: String::new(), kind, source: Source::default() }]);
    let color = Color::Texture(TextureId(0));
    let coated = MaterialKind::CoatedDiffuse {
        reflectance: color,
        roughness: Roughness::constant(0.0, 0.0, false),
        eta: 1.5,
        thickness: 0.01,
        albedo: Color::Constant([0.0; 3]),
        g: 0.0,
        max_depth: 10,
        samples: 1,
    };
    let roughness = Roughness::constant(0.3, 0.3, false);
    let tinted = MaterialKind::Conductor { fresnel: ConductorFresnel::Reflectance(color), roughness };
    for kind in [MaterialKind::Diffuse { reflectance: color }, coated, tinted] {
        let surface = surface(kind.clone()).unwrap_or_else(|e| panic!("{e}"));
        assert!(surface.textured);
        let bsdf = surface.bsdf(&textures, [0.5, 0.5]);
        let up = Vec3::new(0.0, 0.6, 0.8);
        let f = bsdf.evaluate(up, up).to_array();
        assert!(f.iter().all(|x| *x >= 0.0 && x.is_finite()), "{kind:?}: {f:?}");
        let albedo = bsdf.albedo().to_array();
        assert!(albedo.iter().all(|a| (0.0..=1.0).contains(a)), "{kind:?}: {albedo:?}");
    }
}
