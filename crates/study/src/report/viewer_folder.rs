//! The folder `viewer`: the images of each scene under the names of their methods, for tev and JERI.

use super::gallery::{budget, run};
use crate::file_names::{method_file_names, safe_file_name};
use crate::record::SceneRecord;
use crate::recorded_study::RecordedStudy;
use dapple_scene::image::{ImageError, write_file};
use serde_json::{Value, json};
use std::path::Path;

/// Places the images, and writes `data.js`, `data.json` and `index.html`.
pub(super) fn write(recorded: &RecordedStudy) -> Result<(), ImageError> {
    let folder = recorded.folder.join("viewer");
    let scenes: Vec<Value> =
        recorded.manifest.scenes.iter().map(|scene| of_scene(recorded, scene)).collect::<Result<_, _>>()?;
    // If this fails, writing the first file fails too, with a clear error.
    let _ = std::fs::create_dir_all(&folder);
    let data = json!({ "title": "study", "children": scenes });
    write_file(&folder.join("data.json"), format!("{data:#}\n").as_bytes())?;
    write_file(&folder.join("data.js"), format!("const data = {data:#};\n").as_bytes())?;
    write_file(&folder.join("index.html"), include_bytes!("../../templates/viewer.html"))
}

/// The images of a scene in JERI's form, and for each method the map of its symmetric relative error.
fn of_scene(recorded: &RecordedStudy, scene: &SceneRecord) -> Result<Value, ImageError> {
    let name = safe_file_name(&scene.name);
    let place = |file: &str, shown: &str| -> Result<Option<String>, ImageError> {
        let extension = Path::new(file).extension().and_then(|e| e.to_str()).unwrap_or("exr");
        let to = format!("{name}/{shown}.{extension}");
        Ok(place_image(&recorded.folder.join(file), &recorded.folder.join("viewer").join(&to))?.then_some(to))
    };
    let reference = place(&scene.reference.file, "reference")?;
    let (mut images, mut errors) = (Vec::new(), Vec::new());
    for (i, shown) in method_file_names(&recorded.manifest.methods).iter().enumerate() {
        let run = budget(recorded, scene).and_then(|budget| run(recorded, scene, i, budget));
        let Some(file) = run.and_then(|run| run.image.as_deref()) else { continue };
        let Some(image) = place(file, shown)? else { continue };
        if let Some(reference) = &reference {
            let map = json!({ "function": "SMAPE", "imageA": image, "imageB": reference });
            errors.push(json!({ "title": shown, "lossMap": map }));
        }
        images.push(json!({ "title": shown, "image": image }));
    }
    images.extend(reference.map(|file| json!({ "title": "reference", "image": file })));
    let children = [json!({ "title": "Images", "children": images }), json!({ "title": "SMAPE", "children": errors })];
    Ok(json!({ "title": scene.name, "children": children }))
}

/// Links or copies an image; returns `false` if it does not exist.
fn place_image(from: &Path, to: &Path) -> Result<bool, ImageError> {
    if !from.is_file() {
        return Ok(false);
    }
    let _ = to.parent().map(std::fs::create_dir_all);
    // An existing link is replaced: its image may be an older one.
    let _ = std::fs::remove_file(to);
    if std::fs::hard_link(from, to).is_ok() {
        return Ok(true);
    }
    match std::fs::read(from) {
        Ok(bytes) => write_file(to, &bytes).map(|()| true),
        Err(_) => Ok(false),
    }
}
