use super::*;

fn message_of(text: &str) -> String {
    match Plan::parse(text, Path::new("some/plan.toml"), &[]) {
        Ok(_) => String::new(),
        Err(e) => e.to_string(),
    }
}

#[test]
fn plans_may_have_a_byte_order_mark_any_line_ends_and_latin_1() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("plan.toml");
    for end in ["\n", "\r\n", "\r"] {
        let text = |seeds: &str| ["# caf\u{e9}", "spp = [", "8]", seeds, ""].join(end);
        let latin = text("seeds = 3").chars().map(|c| c as u8).collect::<Vec<u8>>();
        for bytes in [format!("\u{feff}{}", text("seeds = 3")).into_bytes(), latin] {
            std::fs::write(&path, bytes).expect("a plan");
            assert_eq!(Plan::read(Some(&path), &[]).expect("a plan").seeds.len(), 3, "{end:?}");
        }
        std::fs::write(&path, text("seeds = [1, 1]")).expect("a plan");
        let found = Plan::read(Some(&path), &[]).expect_err("twice").to_string();
        assert!(found.contains("plan.toml:4: seeds: a seed is given twice"), "{end:?}: {found}");
    }
    std::fs::write(&path, b"\xff\xfes\0").expect("a plan");
    let found = Plan::read(Some(&path), &[]).expect_err("UTF-16").to_string();
    assert!(found.contains("plan.toml") && found.contains("this text is in UTF-16; save it as UTF-8"), "{found}");
}

#[test]
fn errors_name_file_line_and_key() {
    let cases = [
        ("spp = [8, \"a\"]", "some/plan.toml:1: invalid type: string \"a\", expected u64"),
        ("# a\n\nspp = [\n  8,\n  8,\n]\n", "some/plan.toml:3: spp: a number of samples is given twice"),
        ("spp = [0]", ":1: spp: 0 is out of range; use 1 to"),
        ("spp = []", ":1: spp: the list is empty"),
        ("ssp = [8]", ":1: unknown field `ssp`, expected one of `scenes`, `only`, `samplers`"),
        ("spp = [8", ":1: "),
        (
            "samplers = [\n  \"uniform\",\n  \"nonesuch\",\n]",
            ":3: samplers: there is no sampler \"nonesuch\"; choose among variance, ",
        ),
        ("filters = [\"nonesuch\"]", ":1: filters: there is no filter \"nonesuch\"; choose among none, "),
        ("points = [\"nonesuch\"]", ":1: points: there is no point set \"nonesuch\"; choose among sobol, "),
        ("samplers = [\"mitchell:nonesuch=2\"]", ":1: samplers: mitchell: there is no parameter \"nonesuch\""),
        ("methods = [\"uniform\",\n \"variance/nonesuch\"]", ":2: points: there is no point set"),
        ("methods = [\"a/b/c/d\"]", ":1: \"a/b/c/d\" is not a method; write SAMPLER/POINTS/FILTER"),
        ("samplers = [\"uniform\", \"uniform\"]", "\"uniform/sobol/cluster-regression\" is given twice"),
        ("seeds = \"x\"", ":1: a number of seeds, or"),
        ("seeds = [1, 1]", ":1: seeds: a seed is given twice"),
        ("seeds = 0", ":1: seeds: the list is empty"),
        ("resolution = \"12\"", ":1: \"12\" is not a resolution; write WIDTHxHEIGHT"),
        ("resolution = [0, 4]", ":1: resolution: "),
        ("time_of = 7", ":1: time_of: 7 is not one of spp (4, 8, 16, 32)"),
        ("reference_spp = 1", ":1: reference_spp: 1 is out of range; use 2"),
        ("baseline = \"nonesuch\"", ":1: baseline: there is no sampler"),
        ("scenes = [{ name = \"a\" }]", ":1: text, or a table"),
        ("threads = -1", ":1: invalid value"),
        ("seeds = 100001", ":1: 100001 seeds are too many; use at most 100000"),
        ("scenes = [{ source = \"teapot\", lights = \"nonesuch\" }]", ":1: text, or a table"),
        ("scenes = [{ source = \"teapot\", resolution = \"0x4\" }]", ":1: scenes: an image of 0x4 pixels is empty"),
        ("[[external]]\nname = \"a/b\"\ncommand = \"p {input} {output}\"", ":2: external: \"a/b\": not a valid name"),
        ("[[external]]\nname = \"nlm\"\ncommand = \"p {input} {output}\"", ":2: external: \"nlm\": a built-in filter"),
        (
            "[[external]]\nname = \"a\"\ncommand = \"p {input}\"",
            "external: \"a\": the command lacks {input} or {output}",
        ),
        (
            "[[external]]\nname = \"a\"\ncommand = \"{input} {output}\"",
            "external: \"a\": the command lacks {input} or {output}",
        ),
        ("filters = [\"a\"]", "filters: there is no filter \"a\""),
    ];
    for (text, message) in cases {
        assert!(message_of(text).contains(message), "{text}: {}", message_of(text));
    }
    // The control: an empty plan is right.
    assert_eq!(message_of(""), "");
}

/// Plans mean the same in programs with and without the feature.
#[test]
fn an_external_filter_may_have_the_name_of_an_optional_filter() {
    for name in ["oidn", "oidn-blend"] {
        let text =
            format!("filters = [\"{name}\"]\n[[external]]\nname = \"{name}\"\ncommand = \"p {{input}} {{output}}\"");
        let plan = Plan::parse(&text, Path::new("plan.toml"), &[]).unwrap();
        assert_eq!((plan.settings.external[0].name.as_str(), plan.methods[1].filter.as_str()), (name, name));
    }
}

#[test]
fn a_file_gives_every_setting() {
    let text = r#"
        scenes = ["teapot", { source = "box.pbrt", name = "box", reference = "r.exr" }]
        samplers = ["variance", "mitchell:mode=budget"]
        filters = ["none"]
        methods = [{ sampler = "uniform", points = "halton" }, "variance/random/gaussian"]
        spp = [16, 8]
        seeds = [3, 5]
        resolution = "20x10"
        time_of = 16
    "#;
    let plan = Plan::parse(text, Path::new("some/plan.toml"), &[]).unwrap();
    let methods: Vec<String> = plan.methods.iter().map(Method::to_string).collect();
    let expected = [
        "uniform/sobol/none",
        "variance/sobol/none",
        "mitchell:mode=budget/sobol/none",
        "uniform/halton/none",
        "variance/random/gaussian",
    ];
    assert_eq!(methods, expected, "the baseline stands in front");
    assert_eq!((plan.spp.as_slice(), plan.seeds.as_slice()), (&[8, 16][..], &[3, 5][..]));
    assert_eq!((plan.settings.resolution, plan.time_of), (Some([20, 10]), Some(16)));
    assert_eq!(plan.scenes[0], "teapot".parse().unwrap());
    assert_eq!(plan.scenes[1].source, "some/box.pbrt");
    assert_eq!(plan.scenes[1].reference.as_deref(), Some(Path::new("some/r.exr")));
    assert_eq!(plan.runs(), 2 * 5 * 3 * 2);
}

fn with(text: &str, sets: &[&str]) -> Result<Plan, PlanError> {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Plan::parse(text, Path::new("some/plan.toml"), &sets)
}

#[test]
fn later_settings_replace_those_of_the_file() {
    let plan = with("spp = [2, 4]\nseeds = 3", &["spp=7", "quick=true"]).unwrap();
    assert_eq!((plan.spp, plan.seeds, plan.time_of, plan.side), (vec![7], vec![1, 2, 3], Some(7), 64));
    let sized = "lights = \"power\"\nscenes = [{ source = \"teapot\", resolution = [5, 6], light_choice = \"cells\" }]";
    let scene = &with(sized, &[]).unwrap().scenes[0];
    assert_eq!((scene.resolution, scene.lights), (Some([5, 6]), Some(LightSelection::Learned)));
    let plan = with(sized, &["resolution=7x8", "lights=learned"]).unwrap();
    assert_eq!((plan.scenes[0].resolution, plan.settings.resolution), (None, Some([7, 8])));
    assert_eq!((plan.scenes[0].lights, plan.settings.lights), (None, LightSelection::Learned));
    // Text, lists, tables and parts of tables; a plan that holds only with its replacements.
    let sets = [
        "samplers=[\"uniform\", \"mitchell:mode=budget,radius=2\"]",
        "filters=none",
        "methods=uniform/halton",
        "baseline.filter=gaussian",
        "scenes=[\"cornell\", { source = \"box.pbrt\", name = \"b\" }]",
        "spp=[4, 9]",
    ];
    let plan = with("time_of = 9\nbaseline = { sampler = \"uniform\" }", &sets).unwrap();
    let methods: Vec<String> = plan.methods.iter().map(Method::to_string).collect();
    let expected = [
        "uniform/sobol/gaussian",
        "uniform/sobol/none",
        "mitchell:mode=budget,radius=2/sobol/none",
        "uniform/halton/none",
    ];
    assert_eq!(methods, expected);
    assert_eq!(plan.scenes[1].source, "box.pbrt", "not relative to the file");
    let named = "scenes = [\"teapot\", { source = \"room\", name = \"r\" }]";
    assert_eq!(with(named, &["only=r"]).unwrap().scenes[0].source, "room");
}

#[test]
fn errors_of_replacements_name_the_replacement() {
    let cases = [
        ("spp", "--set spp: this is not a setting; write KEY=VALUE"),
        ("ssp=3", "--set ssp=3: unknown field `ssp`, expected one of"),
        ("spp=a", "--set spp=a: invalid type: string \"a\", expected u64"),
        ("spp=[2, 2]", "--set spp=[2, 2]: spp: a number of samples is given twice"),
        ("spp=[2", "write a TOML value"),
        ("seeds.a=3", "--set seeds.a=3: "),
        ("methods=uniform/nonesuch", "--set methods=uniform/nonesuch: points: there is no point set"),
        ("only=nonesuch", "no scene of the plan is called \"nonesuch\"; choose among teapot, terrain"),
        // The file's own setting no longer fits.
        ("spp=[1, 2]", "some/plan.toml:2: time_of: 8 is not one of spp (1, 2)"),
    ];
    for (set, message) in cases {
        let found = with("seeds = 2\ntime_of = 8", &[set]).unwrap_err().to_string();
        assert!(found.contains(message), "{set}: {found}");
    }
}
