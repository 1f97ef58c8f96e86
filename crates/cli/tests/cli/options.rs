//! Options by other renderers' names, sizes in percent, layers, and what the program prints about itself.

use crate::common::Folder;
use dapple_scene::image::Plane;

#[test]
fn aliases_are_the_options_that_they_stand_for() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt -q --spp 4 --filter gaussian --threads 1 --output a.pfm");
    folder.done("render tiny.pbrt -q -s 4 --denoiser gaussian --nthreads 1 --outfile b.pfm");
    let json = folder.json("tiny.pbrt -s 4 --denoiser gaussian -t 1 -o c.pfm");
    assert!(folder.read("a.pfm") == folder.read("b.pfm") && folder.read("a.pfm") == folder.read("c.pfm"));
    assert_eq!((&json["threads"], &json["spp"]), (&1.into(), &4.0.into()));
    for (words, message) in
        [("-s x", "'--spp <MEAN>'"), ("-t 9999", "0..=1024"), ("-s 4 --time 1", "cannot be used with")]
    {
        folder.says(&format!("render tiny.pbrt {words}"), 2, &[message]);
    }
}

#[test]
fn names_of_other_renderers_lead_to_ours() {
    let folder = Folder::new();
    for (words, message) in [
        ("--sampler sobol", "use --points sobol (--sampler decides how many samples each pixel gets)"),
        ("--sampler zsobol:scramble=1", "use --points zsobol"),
        ("--sampler independent", "use --points random"),
        ("--sampler halton", "use --points halton"),
        ("--points pmj02bn", "the most similar to \"pmj02bn\" is pmj02"),
        ("--points uniform", "\"uniform\" decides how many samples each pixel gets; use --sampler uniform"),
        ("--integrator volpath", "use --integrator path"),
        ("--integrator mlt", "use --integrator metropolis"),
        ("--filter mitchell", "\"mitchell\" is a pixel filter"),
        ("--denoiser OpenImageDenoise", "the most similar to \"openimagedenoise\" is oidn"),
        ("--samples 64", "tip: use --spp N"),
        ("--gpu", "tip: Dapple renders on the CPU only"),
        ("--cropwindow=0,1,0,1", "tip: use --crop X0,Y0,X1,Y1"),
        ("--display-server localhost:14158", "tip: use --view tev"),
        ("--max-bounces 4", "tip: use --max-depth N"),
    ] {
        folder.says(&format!("render tiny.pbrt {words}"), 2, &[message]);
    }
    // A slip of the finger still leads to the nearest option.
    folder.says("render tiny.pbrt --filtr none", 2, &["tip: a similar argument exists: '--filter'"]);
}

#[test]
fn resolutions_may_be_percentages_of_the_scenes() {
    let folder = Folder::new();
    for (percent, size) in [("50%", [12, 8]), ("200%", [48, 32]), ("12.5%", [3, 2]), ("0.1%", [1, 1])] {
        let json = folder.json(&format!("tiny.pbrt --resolution {percent} --spp 1 -o a.pfm"));
        assert_eq!(json["resolution"], serde_json::json!(size), "{percent}");
    }
    let spec = folder.done("render tiny.pbrt --resolution 50% --spp 1 --print-spec");
    assert!(spec.contains("\"scale\": 0.5"), "{spec}");
    folder.write("spec.json", &spec);
    assert_eq!(folder.json("--spec spec.json -o a.pfm")["resolution"], serde_json::json!([12, 8]));
    for (old, new, message) in [
        ("\"scale\"", "\"resolution\": [4, 4], \"scale\"", "other.json: scale: a resolution is given as well"),
        ("\"version\": 1", "\"version\": 2", "error: other.json: the render's description has version 2"),
    ] {
        folder.write("other.json", spec.replace(old, new));
        folder.says("render --spec other.json", 1, &[message]);
    }
    for wrong in ["0%", "nan%", "inf%", "%"] {
        folder.says(&format!("render tiny.pbrt --resolution {wrong}"), 2, &["such as 50%"]);
    }
    folder.says("render tiny.pbrt --resolution 99999999999%", 1, &[]);
}

#[test]
fn layers_are_selected_and_stored_as_half_floats() {
    let folder = Folder::new();
    let channels = |name: &str| folder.exr(name).channels;
    let names = |name: &str| channels(name).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    folder.done("render tiny.pbrt --spp 4 -o all.exr");
    folder.done("render tiny.pbrt --spp 4 -o some.exr --layers Z,albedo,count --half");
    folder.done("render tiny.pbrt --spp 4 -o bare.exr --layers none");
    assert_eq!(names("some.exr"), ["B", "G", "R", "Z", "albedo.B", "albedo.G", "albedo.R", "count.Y"]);
    assert_eq!(names("bare.exr"), ["B", "G", "R"]);
    // Without a filter, features are recorded only because a layer requires them.
    folder.done("render tiny.pbrt --spp 4 --filter none --sampler uniform -o plain.exr --layers normal,depth");
    assert_eq!(names("plain.exr"), ["B", "G", "R", "depth.Y", "normal.X", "normal.Y", "normal.Z"]);
    // The same values, rounded to 16 bits where their range allows it.
    let (all, some) = (channels("all.exr"), channels("some.exr"));
    for (name, plane) in &some {
        let (_, exact) = all.iter().find(|(known, _)| known == name).expect("the channel");
        match (plane, exact) {
            (Plane::F16(half), Plane::F32(exact)) => {
                assert!(half.iter().zip(exact.iter()).all(|(h, e)| (h - e).abs() <= 1e-3 * e.abs() + 1e-7), "{name}");
            }
            (same, exact) => assert!(["count.Y", "Z"].contains(&name.as_str()) && same == exact, "{name}"),
        }
    }
    assert!(folder.read("some.exr").len() < folder.read("all.exr").len() / 2);
    for (words, status, message) in [
        ("--layers albdo -o a.exr", 2, "there is no layer \"albdo\"; choose among A, Z, unfiltered, variance, count, "),
        ("--layers none -o a.pfm", 2, "--layers concerns only layers of EXR files; add --output FILE.exr"),
        ("--half -o a.pfm", 2, "--half concerns only layers of EXR files"),
        ("--layers count --features -o a.exr", 2, "cannot be used with"),
        ("--filter none --layers unfiltered -o a.exr", 0, "no layer \"unfiltered\": the image itself is unfiltered"),
        ("--filter none --sampler uniform --layers cluster -o a.exr", 0, "neither sampler nor filter makes clusters"),
    ] {
        folder.says(&format!("render tiny.pbrt --spp 2 {words}"), status, &[message]);
    }
}

#[test]
fn points_are_printed() {
    let folder = Folder::new();
    let out = folder.done("points blue-noise:of=halton --csv 2 --pixels 3x2");
    let rows: Vec<Vec<f64>> =
        out.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect()).collect();
    assert_eq!((out.lines().next(), rows.len()), (Some("x,y,sample,d0,d1,d2,d3,d4,d5,d6,d7"), 3 * 2 * 2));
    assert_eq!(rows[11][..3], [2.0, 1.0, 1.0]);
    assert!(rows.iter().all(|row| row.len() == 11 && row[3..].iter().all(|v| (0.0..1.0).contains(v))), "{out}");
    folder.says("points blue-noise:of=zsobol --csv 1", 1, &["already distributes errors over pixels"]);
    assert!(folder.run("points --csv 1").err.contains("NAME"));
}

#[test]
fn a_method_is_described_by_name() {
    let folder = Folder::new();
    let out = folder.done("samplers mitchell");
    assert!(out.starts_with("mitchell: two sampling levels, chosen by the contrast of a pilot"), "{out}");
    for part in [
        "source: Mitchell, Generating Antialiased",
        "result of mitchell: sRGB MSE relative to ",
        "--sampler mitchell[:key=value,…]\n",
        "\n  red=0.4 ",
    ] {
        assert!(out.contains(part), "{part}: {out}");
    }
    for [alias, name] in [["cluster", "adaptive"], ["then", "sequence"]] {
        let out = folder.done(&format!("samplers {alias}"));
        assert!(out.starts_with(&format!("{name}: ")) && out.contains(&format!("\naliases: {alias}\n")), "{out}");
    }
    assert_eq!(folder.done("denoisers"), folder.done("filters"));
    assert!(folder.done("points random").contains("no parameters"));
    assert!(folder.done("filters cluster-regression").contains("source: Dapple, after Moon"));
    assert!(folder.done("integrators ambient-occlusion").contains("distance=inf"));
    folder.says("samplers sobol", 1, &["use --points sobol"]);
    folder.says("filters bilaterl", 1, &["did you mean \"bilateral\"?"]);
    // Names and parameters never touch their explanations.
    for list in ["samplers", "points", "filters", "integrators"] {
        let out = folder.done(list);
        let is_apart = |line: &str| line.trim_start().split_once(' ').is_some_and(|(_, rest)| rest.len() > 5);
        assert!(out.lines().all(is_apart), "{out}");
        assert!(!out.contains("neighboursUse"), "{out}");
    }
}

#[test]
fn completions_and_man_pages_follow_the_arguments() {
    let folder = Folder::new();
    for (shell, parts) in [
        ("bash", ["complete -F _dapple", "--preview"]),
        ("zsh", ["#compdef dapple", "--preview"]),
        ("fish", ["complete -c dapple", "-l preview"]),
    ] {
        let script = folder.done(&format!("completions {shell}"));
        assert!(parts.iter().all(|part| script.contains(part)), "{shell}");
    }
    assert!(folder.run("completions tcsh").err.contains("[possible values: bash"));
    let page = folder.done("man render");
    assert!(page.contains(".TH dapple-render 1") && page.contains("\\-\\-preview"), "{page}");
    assert!(folder.done("man").contains(".TH dapple 1"));
    folder.done("man -o man1");
    let pages = crate::common::names(&folder.path("man1"));
    assert!(pages.contains(&"dapple.1".to_owned()) && pages.contains(&"dapple-study.1".to_owned()), "{pages:?}");
    assert!(!pages.iter().any(|name| name.contains("study-run")), "{pages:?}");
    assert!(folder.run("man rendr").err.contains("there is no command \"rendr\"; choose among render, "));
}

#[test]
fn the_summary_has_four_lines_and_the_header_has_the_settings() {
    let folder = Folder::new();
    let out = folder.done("render tiny.pbrt --spp 4 -o a.exr");
    let lines: Vec<&str> = out.lines().collect();
    let [image, work, error, memory, file] = lines[..] else { panic!("four lines and the file: {out}") };
    assert!(image.starts_with("tiny, 24x16: 4.00 spp (") && work.starts_with("1536 samples, "), "{out}");
    assert!(error.starts_with("predicted relMSE ") && memory.starts_with("memory: "), "{out}");
    assert!(file.starts_with("a.exr: the image, with layers ") && !out.contains("adaptive:"), "{out}");
    // Silent, but for the line of JSON.
    assert_eq!(folder.done("render tiny.pbrt --spp 4 -o a.exr -q"), "");
    let line = folder.done("render tiny.pbrt --spp 4 -o a.exr -q --json");
    assert!(line.lines().count() == 1 && serde_json::from_str::<serde_json::Value>(&line).is_ok(), "{line}");
}
