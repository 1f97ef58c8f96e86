//! Images without pixels, of one pixel and with invalid pixels, in every place of a scene file for an image. The result
//! is an error that names the file, or a finite image.

use crate::support::*;
use dapple_scene::pbrt::{ReadOptions, read_scene_from};

/// A PFM file of these pixels.
fn pfm(size: [u32; 2], value: impl Fn(u32) -> f32) -> Vec<u8> {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", size[0], size[1]).into_bytes();
    (0..3 * size[0] * size[1]).for_each(|i| bytes.extend(value(i).to_le_bytes()));
    bytes
}

/// Lines after `WorldBegin`, each with the image in another place.
const PLACES: [(&str, &str); 8] = [
    (
        "colour",
        "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"p.pfm\"\nMaterial \"diffuse\" \"texture reflectance\" \"t\"",
    ),
    (
        "roughness",
        "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"p.pfm\"\nMaterial \"conductor\" \"texture roughness\" \"t\"",
    ),
    (
        "bump",
        "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"p.pfm\"\nMaterial \"diffuse\" \"texture displacement\" \"t\"",
    ),
    ("normal map", "Material \"diffuse\" \"string normalmap\" \"p.pfm\""),
    (
        "amount",
        "Texture \"a\" \"float\" \"imagemap\" \"string filename\" \"p.pfm\"\nTexture \"t\" \"spectrum\" \"mix\" \"texture amount\" \"a\"\nMaterial \"diffuse\" \"texture reflectance\" \"t\"",
    ),
    ("alpha", "Texture \"t\" \"float\" \"imagemap\" \"string filename\" \"p.pfm\"\nMaterial \"diffuse\""),
    (
        "coat",
        "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"p.pfm\"\nMaterial \"coateddiffuse\" \"texture reflectance\" \"t\"",
    ),
    ("sky", "LightSource \"infinite\" \"string filename\" \"p.pfm\""),
];

fn outcome(place: &str, words: &str, image: &[u8]) -> Result<[f64; 3], String> {
    let alpha = if place == "alpha" { " \"texture alpha\" \"t\"" } else { "" };
    let scene = format!(
        "LookAt 0 2 4  0 0 0  0 1 0\nCamera \"perspective\"\nFilm \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 8\n\
         WorldBegin\nLightSource \"distant\" \"rgb L\" [ 1 1 1 ] \"point3 from\" [ 0 3 3 ]\n{words}\n\
         Shape \"sphere\"{alpha}\nShape \"bilinearmesh\" \"point3 P\" [ -2 -1 -2  2 -1 -2  -2 -1 2  2 -1 2 ] \
         \"point2 uv\" [ 0 0 1 0 0 1 1 1 ]{alpha}\n"
    );
    let files: &[(&str, &[u8])] = &[("s.pbrt", scene.as_bytes()), ("p.pfm", image)];
    let scene = read_scene_from(files, "s.pbrt", &ReadOptions::default()).map_err(|e| e.to_string())?;
    let film = crate::support::image(&scene, 16, 1);
    assert_eq!(film.record().rejected, 0, "{place}");
    let mean = mean(&film);
    assert!(mean.iter().all(|m| m.is_finite() && *m >= 0.0), "{place}: {mean:?}");
    Ok(mean)
}

#[test]
fn images_of_one_pixel_are_read_everywhere_i10() {
    for (place, words) in PLACES {
        for value in [0.0, 1e-38, 0.5, 1.0] {
            if let Err(e) = outcome(place, words, &pfm([1, 1], |_| value)) {
                panic!("{place}, {value}: {e}");
            }
        }
        for size in [[1, 9], [9, 1]] {
            // A sky is square or twice as wide as high.
            let found = outcome(place, words, &pfm(size, |i| (i % 5) as f32 * 0.2));
            assert!(
                found.is_ok() || found.is_err_and(|e| place == "sky" && e.contains("s.pbrt:6")),
                "{place} {size:?}"
            );
        }
    }
    // The image's content matters: a white one is brighter than a black one.
    let [black, white] = [0.0, 1.0].map(|v| outcome(PLACES[0].0, PLACES[0].1, &pfm([1, 1], |_| v)).expect("read")[0]);
    assert!(black == 0.0 && white > 0.01, "{black} {white}");
}

#[test]
fn images_without_pixels_are_refused_i10() {
    for (place, words) in PLACES {
        for size in ["0 0", "0 4", "4 0"] {
            let file = format!("PF\n{size}\n-1.0\n").into_bytes();
            let message = outcome(place, words, &file).expect_err(place);
            assert!(message.contains("s.pbrt:6") && message.contains("p.pfm"), "{place}: {message}");
            assert!(message.contains("both sides must be at least 1"), "{place}: {message}");
        }
        assert!(outcome(place, words, b"").expect_err(place).contains("p.pfm"), "{place}");
    }
}

#[test]
fn invalid_pixels_are_refused_i10() {
    for (place, words) in PLACES {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            // One channel of one pixel of four.
            let message = outcome(place, words, &pfm([2, 2], |i| if i == 4 { bad } else { 0.5 })).expect_err(place);
            assert!(message.contains("s.pbrt:6: p.pfm: the pixel in column 1 of row 1 is NaN"), "{place}: {message}");
        }
        let message = outcome(place, words, &pfm([2, 1], |_| f32::NAN)).expect_err(place);
        assert!(message.contains("and 1 more"), "{place}: {message}");
    }
}
