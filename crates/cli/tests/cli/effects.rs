//! `dapple effects`, and `dapple render --without`.

use crate::common::{Folder, TINY};
use serde_json::Value;

#[test]
fn the_list_names_each_effect_with_its_object() {
    let folder = Folder::new();
    let list = folder.done("effects tiny.pbrt --list");
    let lines: Vec<&str> = list.lines().collect();
    assert_eq!(lines[0], "tiny: 2 effects, depth 5");
    assert!(lines[3].starts_with("soft-shadows") && lines[3].ends_with("tiny.pbrt:11: a sphere emits light"), "{list}");
    assert!(lines[4].starts_with("interreflection") && lines.len() == 5, "{list}");
    let json = folder.line("effects tiny.pbrt --list --json");
    let first = &json["effects"][0];
    assert!(first["effect"] == "soft-shadows" && first["line"] == 11 && first["objects"] == 1, "{json}");
    assert!(first["time_share"].is_null() && json["found_by_chance"].is_null() && json["seconds"].is_null());
    assert_eq!(folder.names(), Vec::<String>::new(), "nothing is written");
}

#[test]
fn the_ledger_has_a_row_for_each_effect() {
    let folder = Folder::new();
    let json = folder.line("effects tiny.pbrt --resolution 24x16 --spp 16 --seeds 6 --json");
    assert_eq!((json["spp"].as_u64(), json["seeds"].as_u64()), (Some(16), Some(6)));
    let effects = json["effects"].as_array().expect("effects");
    assert_eq!(effects.len(), 2);
    for effect in effects {
        for key in ["time_share", "time_ratio", "relmse", "radiance_lost"] {
            let figure = &effect[key];
            assert!(figure["value"].is_f64() && figure["noise"].as_f64().is_some_and(|n| n >= 0.0), "{key}: {effect}");
        }
    }
    // The lamp fills much of the image and goes; a floor alone scatters nothing twice but what the lamp's body does.
    let [shadows, depth] = [0, 1].map(|i: usize| effects[i]["radiance_lost"]["value"].as_f64().unwrap_or(f64::NAN));
    assert!(shadows > 0.1 && depth > 0.0 && depth < 0.1, "{json}");
    let table = folder.done("effects tiny.pbrt --resolution 8x8 --spp 1");
    assert!(table.contains("relMSE without it") && table.contains(" ±"), "{table}");
    for (words, message) in
        [("--seeds 3", "4..=64"), ("--list --spp 4", "cannot be used with"), ("--resolution 0x1", "at least 1")]
    {
        folder.says(&format!("effects tiny.pbrt {words}"), 2, &[message]);
    }
}

/// A closed sphere that shines inwards with 1 and reflects `rho`.
fn furnace(rho: f64, depth: &str) -> String {
    format!(
        "Camera \"perspective\"\nFilm \"rgb\" \"integer xresolution\" [ 16 ] \"integer yresolution\" [ 16 ]\n\
         Integrator \"path\" \"integer maxdepth\" [ {depth} ]\nWorldBegin\n\
         Material \"diffuse\" \"rgb reflectance\" [ {rho} {rho} {rho} ]\nReverseOrientation\n\
         AreaLightSource \"diffuse\" \"rgb L\" [ 1 1 1 ]\nShape \"sphere\" \"float radius\" [ 5 ]\n"
    )
}

/// In a furnace of albedo rho, paths of depth D miss rho^(D+1) of the radiance.
#[test]
fn what_the_depth_cuts_off_is_reported_l13() {
    let folder = Folder::new();
    for (rho, depth, share) in [(0.5_f64, 3, 0.0625), (0.8, 2, 0.512), (0.5, 0, 0.5)] {
        folder.write("furnace.pbrt", furnace(rho, &depth.to_string()));
        let json = folder.line("effects furnace.pbrt --spp 16 --seeds 8 --json");
        let figure = |key: &str, part: &str| json["beyond_depth"][key][part].as_f64().unwrap_or(f64::NAN);
        let (lost, noise) = (figure("radiance_lost", "value"), figure("radiance_lost", "noise"));
        // The half width of a 95 % interval by 7 degrees of freedom; three of it are one in 10^4.
        assert!((lost - share).abs() < 3.0 * noise && noise < 0.1 * share, "{rho}: {lost} +- {noise}, {share}");
        // The control: one bounce more or less is told apart.
        assert!([share * rho, share / rho].iter().all(|other| (lost - other).abs() > 3.0 * noise), "{lost} +- {noise}");
        assert!(figure("time_ratio", "value") > 0.0 && figure("relmse", "value") > 0.0, "{json}");
        let table = folder.done("effects furnace.pbrt --spp 1");
        assert!(table.contains(&format!("beyond depth {depth}: ")), "{table}");
    }
    // Where nothing scatters, no depth cuts: nothing is said.
    folder.write("furnace.pbrt", furnace(0.0, "1"));
    assert!(folder.line("effects furnace.pbrt --spp 1 --json")["beyond_depth"].is_null());
}

#[test]
fn what_is_left_out_is_said_three_times() {
    let folder = Folder::new();
    let words = "render tiny.pbrt --spp 4 --json -o a.exr --without interreflection --without soft-shadows";
    let lines = [
        "warning: soft-shadows is left out: each area light is an invisible point light of the same power; ",
        "warning: interreflection is left out: light scatters once; ",
        "tiny.pbrt:11 uses the effect (a sphere emits light)",
    ];
    let said = folder.says(words, 0, &lines);
    let json: Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!(json["without"], serde_json::json!(["soft-shadows", "interreflection"]));
    assert_eq!(json["effects"], serde_json::json!([]));
    let header = String::from_utf8_lossy(&folder.read("a.exr")).into_owned();
    assert!(header.contains("dapple:without") && header.contains("soft-shadows,interreflection"));
    // The control: without the word, nothing of it, and another image.
    let json = folder.json("tiny.pbrt --spp 4 -o b.exr");
    assert_eq!(json["without"], serde_json::json!([]));
    assert_ne!(folder.read("a.exr"), folder.read("b.exr"));
    // The light cannot go.
    let dark = TINY
        .replace("AreaLightSource \"diffuse\" \"rgb L\" [ 4 4 4 ]", "")
        .replace("WorldBegin", "WorldBegin\nLightSource \"infinite\" \"rgb L\" [ 1 1 1 ]");
    folder.write("sky.pbrt", dark);
    let last = "error: cannot leave out environment: no light remains without environment";
    folder.says("render sky.pbrt --spp 1 --without environment", 1, &[last]);
}
