//! Files from outside, through the reader.

use super::*;
use std::path::{Path, PathBuf};

/// A folder of `/work/shared` or beside the repository; `None` (with a line saying so) where there is none.
fn shared(variable: &str, name: &str) -> Option<PathBuf> {
    let beside = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(name);
    let folder = std::env::var_os(variable).map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: {} is not there; set {variable}", folder.display());
    None
}

fn read_file(path: &Path) -> Picture {
    let bytes = std::fs::read(path).unwrap();
    read_picture(&bytes, &path.display().to_string(), Encoding::Auto).unwrap()
}

fn mean(picture: &Picture) -> [f64; 3] {
    std::array::from_fn(|c| picture.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / picture.pixels.len() as f64)
}

#[test]
fn pictures_of_the_scenes_are_read() {
    let Some(scenes) = shared("DAPPLE_SCENES", "scenes") else { return };
    for (name, size) in
        [("pbrt-v4/dining-room/textures/Skydome.pfm", [512, 512]), ("pbrt-v4/teapot/textures/envmap.hdr", [1024, 512])]
    {
        let picture = read_file(&scenes.join(name));
        eprintln!("{name}: {:?} mean {:?} {:?}", picture.size, mean(&picture), size);
        assert_eq!(picture.non_finite(), None);
    }
    for name in [
        "env/spiaggia_di_mondello_1k.hdr",
        "env/venice_sunset_1k.hdr",
        "mitsuba/common/textures/museum.exr",
        "pbrt-v2/textures/grace_latlong.exr",
        "pbrt-v2/textures/lines.exr",
        "pbrt-v4/cornell-box/TungstenRender.exr",
        "pbrt-v4/veach-mis/TungstenRender.exr",
        "pbrt-v4/dining-room/textures/Teacup.tga",
        "pbrt-v4/dining-room/textures/Tiles.tga",
        "pbrt-v4/dining-room/textures/picture3.jpg",
        "pbrt-v4/staircase2/textures/Tiles.tga",
        "pbrt-v4/staircase2/textures/Wallpaper.tga",
        "pbrt-v4/staircase2/textures/wood5.jpg",
        "pbrt-v4/teapot/TungstenRender.png",
        "textures/brick.png",
        "textures/grass.png",
        "gltf/Suzanne/glTF/Suzanne_BaseColor.png",
    ] {
        let picture = read_file(&scenes.join(name));
        eprintln!("{name}: {:?} mean {:?} first {:?}", picture.size, mean(&picture), picture.pixels[0]);
    }
}

#[test]
fn reference_pictures_have_the_means_that_their_readme_lists() {
    let Some(folder) = shared("DAPPLE_REFERENCES", "references") else { return };
    for (name, size, expected) in [
        ("coffee", [256, 320], [0.1900, 0.1189, 0.0916]),
        ("coffee-rgb", [256, 320], [0.2077, 0.1183, 0.0931]),
        ("cornell-box-rgb", [320, 320], [0.1963, 0.1276, 0.0361]),
        ("veach-mis", [320, 180], [1.1036, 0.8927, 0.8339]),
    ] {
        let picture = read_file(&folder.join(format!("{name}.exr")));
        assert_eq!(picture.size, size);
        for (found, listed) in mean(&picture).into_iter().zip(expected) {
            assert!((found - listed).abs() < 0.6e-4, "{name}: {found} {listed}");
        }
    }
}
