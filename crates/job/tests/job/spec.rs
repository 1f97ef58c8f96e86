//! Descriptions of renders as files.

use dapple_job::{BudgetSpec, CropSpec, PixelFilterSpec, RenderSpec, SpecError};
use dapple_renderer::light::LightSelection;
use dapple_scene::Effect;

fn full() -> RenderSpec {
    RenderSpec {
        points: "halton".into(),
        light_selection: Some(LightSelection::Uniform),
        budget: BudgetSpec::Spp(0.1 + 0.2),
        min_spp: 0,
        max_spp: Some(99),
        resolution: Some([64, 48]),
        crop: CropSpec::Window([1, 2, 30, 40]),
        seed: u64::MAX,
        max_depth: Some(3),
        pixel_filter: PixelFilterSpec::Box,
        without: vec![Effect::Glossy, Effect::DepthOfField],
        allow_unsupported: true,
        part: Some("2/8".parse().expect("a part")),
        ..RenderSpec::new("scenes/a.pbrt").sampler("uniform").filter("gaussian").integrator("path")
    }
}

/// Files of version 1 are read by every Dapple of that version: this text never changes.
const VERSION_1: &str = r#"{"version":1,"scene":"scenes/a.pbrt","sampler":"uniform","points":"halton","filter":"gaussian","integrator":"path","light_selection":"uniform","budget":{"spp":0.30000000000000004},"min_spp":0,"max_spp":99,"resolution":[64,48],"crop":{"window":[1,2,30,40]},"seed":18446744073709551615,"max_depth":3,"pixel_filter":"box","without":["glossy","depth-of-field"],"allow_unsupported":true,"shard":"2/8"}"#;

#[test]
fn a_description_survives_its_json() {
    assert_eq!(full().to_json().expect("JSON"), VERSION_1);
    assert_eq!(RenderSpec::from_json(VERSION_1).expect("a description"), full());
    let pretty = full().to_json_pretty().expect("JSON");
    assert_eq!(RenderSpec::from_json(&pretty).expect("a description"), full());
    for budget in [BudgetSpec::Samples(7), BudgetSpec::Error(1e-3), BudgetSpec::Seconds(2.5)] {
        let spec = RenderSpec::new("teapot").budget(budget);
        assert_eq!(RenderSpec::from_json(&spec.to_json().expect("JSON")).expect("a description"), spec);
    }
}

#[test]
fn missing_fields_have_the_defaults() {
    let short = RenderSpec::from_json(r#"{"version": 1, "scene": "teapot"}"#).expect("a description");
    assert_eq!(short, RenderSpec::new("teapot"));
}

#[test]
fn another_version_is_refused_with_advice() {
    // Before any other fault.
    let error = RenderSpec::from_json(r#"{"version": 2, "film": 3}"#).expect_err("another version");
    assert!(matches!(error, SpecError::Version { found: 2 }));
    assert!(error.to_string().contains("use the version of Dapple that wrote it"), "{error}");
}

#[test]
fn unknown_fields_and_wrong_values_are_named() {
    let cases = [
        (r#"{"scene": "teapot"}"#, "missing field `version`"),
        (r#"{"version": 1, "scene": "teapot", "sampel": 1}"#, "unknown field `sampel`"),
        (r#"{"version": 1, "scene": "teapot", "without": ["fog"]}"#, "unknown effect \"fog\""),
        (r#"{"version": 1, "scene": "teapot", "light_selection": "best"}"#, "unknown variant `best`"),
        (r#"{"version": 1, "scene": "teapot", "shard": "3/2"}"#, "\"3/2\" is not a part"),
        (r#"{"version": 1, "scene": "teapot", "sampler": "nonesuch"}"#, "sampler: there is no sampler \"nonesuch\""),
        (
            r#"{"version": 1, "scene": "teapot", "integrator": "nonesuch"}"#,
            "there is no integrator \"nonesuch\"; choose among path, ambient-occlusion",
        ),
        (r#"{"version": 1, "scene": "teapot", "min_spp": 5, "max_spp": 2}"#, "min_spp: 5 is above"),
        (
            r#"{"version": 1, "scene": "teapot", "budget": {"spp": -1.0}}"#,
            "spp: -1 is not allowed; use a finite number above zero",
        ),
        (
            r#"{"version": 1, "scene": "teapot", "shard": "1/2", "light_selection": "learned"}"#,
            "cannot be rendered in parts",
        ),
        (r#"{"version": 1, "scene": "teapot", "shard": "1/2", "budget": {"seconds": 3.0}}"#, "a part needs"),
    ];
    for (json, expected) in cases {
        let error = RenderSpec::from_json(json).expect_err(json).to_string();
        assert!(error.contains(expected), "{json}: {error}");
    }
}
