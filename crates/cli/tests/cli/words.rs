//! Messages for wrong arguments and broken scenes, word for word, the time until they appear, and their colours.

#![allow(clippy::print_stderr, reason = "tests say when they skip")]

use crate::common::{Folder, TINY};
use dapple_job::registry::{FILTERS, NOT_BUILT, SAMPLERS};
use dapple_scene::bundled;
use std::time::{Duration, Instant};

/// `oidn` and `oidn-blend` need a feature of the build and a library; each is named before the scene is read.
#[test]
fn optional_filters_name_what_is_missing() {
    let folder = Folder::new();
    for filter in ["oidn", "oidn-blend:prefilter=false"] {
        let mut command = folder.command(&format!("render nonesuch.pbrt --filter {filter}"));
        let output = command.env("DAPPLE_OIDN", "/nonesuch/oidn.so").output().expect("the program starts");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        let expected = if cfg!(feature = "oidn") {
            "DAPPLE_OIDN = \"/nonesuch/oidn.so\" cannot be loaded: "
        } else {
            "is not in this program; build Dapple with the feature \"oidn\""
        };
        assert!(error.contains(expected), "{error}");
    }
    let listed = folder.done("filters");
    let of = listed.lines().find(|line| line.starts_with("oidn ")).expect("it is listed");
    assert_eq!(of.contains("feature \"oidn\""), !cfg!(feature = "oidn"), "{of}");
    // What `best` takes, and how to get more.
    let mut command = folder.command("filters");
    let output = command.env("DAPPLE_OIDN", "/nonesuch/oidn.so").output().expect("the program starts");
    let listed = String::from_utf8_lossy(&output.stdout).into_owned();
    let best = listed.split_once("\nbest ").expect("it is listed").1;
    let expected = if cfg!(feature = "oidn") {
        "cluster-regression on this machine; install Open Image Denoise 2 to blend both\n"
    } else {
        "cluster-regression in this build; build dapple with the feature \"oidn\" to blend it with Open Image Denoise\n"
    };
    assert!(best.trim_start().starts_with(expected), "{best}");
    assert_eq!(best.contains("`pip install pyoidn`"), cfg!(feature = "oidn"), "{best}");
    let mut command = folder.command("render room --filter best --resolution 8x8 --spp 2 -o best.exr");
    let output = command.env("DAPPLE_OIDN", "/nonesuch/oidn.so").output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("cluster-regression"), "{said}");
}

#[test]
fn settings_are_refused_before_anything_is_rendered_i06() {
    let folder = Folder::new();
    // The words, and what the message must hold: the key and what is allowed.
    let cases = [
        ("--spp 0", 2, "'--spp <MEAN>': a finite number above zero is required"),
        ("--spp inf", 2, "'--spp <MEAN>': a finite number above zero is required"),
        ("--time nan", 2, "'--time <SECONDS>': a finite number above zero is required"),
        ("--error 0", 2, "'--error <RELMSE>': a finite number above zero is required"),
        ("--exposure NaN", 2, "'--exposure <STOPS>': a finite number is required"),
        ("--min-spp 5 --max-spp 2", 2, "--min-spp: 5 is above the maximum number of samples per pixel, 2"),
        ("--spp 2 --min-spp 3", 2, "--spp: 2 is below the minimum number of samples per pixel, 3"),
        ("--spp 4 --max-spp 3", 2, "--spp: 4 is above the maximum number of samples per pixel, 3"),
        ("--spp 1e12", 2, "is above the maximum number of samples per pixel, 4294967295"),
        ("--spp 4 --time 1", 2, "cannot be used with"),
        ("--error 1 --time 1", 2, "cannot be used with"),
        ("--max-spp 0", 2, "'--max-spp <N>'"),
        ("--threads 9999", 2, "0..=1024"),
        ("--resolution 0x4", 2, "both sides must be at least 1"),
        ("--resolution 4", 2, "such as 640x360"),
        ("--resolution 4x-4", 2, "such as 640x360"),
        ("--crop 4,4,4,8", 2, "X0 < X1 and Y0 < Y1"),
        ("--crop 1,2,3", 2, "X0,Y0,X1,Y1"),
        ("--crop 0,0,25,16", 1, "24x16 image"),
        ("--resolution 4000000000x1 --max-depth 1 --min-spp 0 --memory 8G", 1, "crops (--crop)"),
        ("--sampler nonesuch", 2, "there is no sampler \"nonesuch\"; choose among variance, "),
        ("--sampler variance:cup=3", 2, "Known parameters: pilot, radius"),
        ("--sampler variance:policy=maybe", 2, "use keep, discard, cross or neighbours"),
        ("--pixel-filter round", 2, "possible values: scene, box"),
        ("--without nonesuch", 2, "unknown effect \"nonesuch\"; choose among soft-shadows, several-lights, glossy, "),
        ("--without glossy", 1, "the scene does not use this effect; choose among soft-shadows, interreflection"),
        ("--without interreflection --without glossy", 1, "error: cannot leave out glossy: the scene does not use"),
        ("--without interreflection --max-depth 1", 1, "choose among soft-shadows\n"),
        ("-o a.jpg", 2, ".exr, .pfm or .png"),
        ("-o a.png -o a.png", 2, "given twice"),
        ("-o nowhere/a.png", 1, "create the directory first"),
    ];
    for (words, status, message) in cases {
        let start = Instant::now();
        let said = folder.says(&format!("render tiny.pbrt {words}"), status, &["error: ", message]);
        let took = start.elapsed();
        assert!(took < Duration::from_secs(1), "{words}: {took:?}");
        assert_eq!((said.out.as_str(), folder.names()), ("", vec![]), "{words}");
    }
    // The control: the same words without the fault are taken.
    folder.done("render tiny.pbrt --spp 2 --min-spp 0 --max-spp 64 --resolution 4x4 --crop 0,0,2,2 -o a.png");
}

#[test]
fn wrong_words_end_with_usage() {
    let folder = Folder::new();
    let samplers: Vec<&str> = SAMPLERS.iter().map(|entry| entry.name).collect();
    let unknown = format!(
        "error: invalid value 'nonesuch' for '--sampler <NAME[:key=value,…]>': there is no sampler \"nonesuch\"; choose among {}\n\nFor more information, try '--help'.\n",
        samplers.join(", ")
    );
    let golden = [
        ("render tiny.pbrt --sampler nonesuch", unknown.as_str()),
        (
            "render tiny.pbrt --min-spp 5 --max-spp 2",
            "error: --min-spp: 5 is above the maximum number of samples per pixel, 2; lower this number, or raise the maximum\n\n\
             Usage: dapple render [OPTIONS] [SCENE]\n\nFor more information, try '--help'.\n",
        ),
        (
            "rander",
            "error: unrecognized subcommand 'rander'\n\n  tip: a similar subcommand exists: 'render'\n\n\
             Usage: dapple <COMMAND>\n\nFor more information, try '--help'.\n",
        ),
    ];
    for (words, expected) in golden {
        let said = folder.run(words);
        assert_eq!((said.status, said.err.as_str(), said.out.as_str()), (Some(2), expected, ""), "{words}");
    }
    folder.says("", 2, &["Usage: dapple <COMMAND>"]);
}

#[test]
fn scenes_that_cannot_be_rendered_say_why() {
    let folder = Folder::new();
    let broken = TINY.replace("\"float fov\"", "\"float fog\"").replace("[ 0.5 0.5 0.5 ]", "[ 0.5 0.5 ]");
    folder.write("broken.pbrt", broken + "Shape \"teapotahedron\"\n");
    folder.write("empty.pbrt", "");
    let missing = format!(
        "error: missing.pbrt: no such file or bundled scene; the bundled scenes are {}\n",
        bundled::names().join(", ")
    );
    let golden = [
        ("missing.pbrt", missing.as_str()),
        (".", "error: .: cannot read .: not a regular file; check that it is a readable file\n"),
    ];
    // A name with a slip leads to the nearest scene.
    folder.says("render teapto", 1, &["; did you mean \"teapot\"? The bundled scenes are teapot, "]);
    for command in ["render", "info"] {
        for (scene, expected) in golden {
            let said = folder.run(&format!("{command} {scene}"));
            assert_eq!((said.status, said.err.as_str(), said.out.as_str()), (Some(1), expected, ""), "{scene}");
        }
        // All faults at once, each on a line with its place.
        let said = folder.says(&format!("{command} broken.pbrt"), 1, &[]);
        let lines: Vec<&str> = said.err.lines().filter(|l| l.starts_with("error: ")).collect();
        assert_eq!(said.err.lines().count(), lines.len(), "{}", said.err);
        for place in ["broken.pbrt:5: ", "broken.pbrt:13: "] {
            assert!(lines.iter().any(|l| l.starts_with(&format!("error: {place}"))), "{place}: {}", said.err);
        }
        assert_eq!(folder.run(&format!("{command} empty.pbrt")).status, Some(1));
    }
    let names: Vec<String> = folder.names();
    assert_eq!(names, ["broken.pbrt", "empty.pbrt"], "nothing was written");
}

#[test]
fn the_unsupported_is_refused_or_listed() {
    let folder = Folder::new();
    folder.write("odd.pbrt", TINY.to_owned() + "Shape \"cone\"\n");
    let refused = folder.says("render odd.pbrt --spp 1", 1, &[]);
    let err = &refused.err;
    assert!(err.starts_with("error: odd.pbrt:13: ") && err.ends_with(", or pass --allow-unsupported\n"), "{err}");
    let allowed = folder.says("render odd.pbrt --spp 1 --allow-unsupported -o odd.exr", 0, &[]);
    assert!(allowed.err.starts_with("warning: odd.pbrt:13: ") && allowed.err.contains("left out"), "{}", allowed.err);
}

/// The memory that `dapple info` predicts, against the render. The program itself may take a page more or less.
#[cfg(target_os = "linux")]
fn foreseen(folder: &Folder, info: &str) {
    let render = folder.done("render tiny.pbrt");
    let [foreseen, expected] =
        [(info, "a render with default options takes "), (&render, " taken, ")].map(|(said, before)| {
            let sum = said.split_once(before).map(|(_, rest)| rest.lines().next().unwrap_or_default()).expect("memory");
            sum.replace(" expected", "").split_once(", film ").expect("a film").1.to_owned()
        });
    assert_eq!(foreseen, expected);
}

#[test]
fn lists_and_info_are_for_reading() {
    let folder = Folder::new();
    for (list, names) in [("samplers", ["variance", "uniform"]), ("points", ["sobol", "random"])] {
        let out = folder.done(list);
        assert!(names.iter().all(|name| out.lines().any(|l| l.split(' ').next() == Some(name))), "{out}");
    }
    assert!(folder.done("samplers").lines().any(|l| l.starts_with("  cap=8 ")));
    assert!(folder.done("filters").starts_with("none "));
    let out = folder.done("info tiny.pbrt");
    for line in [
        "scene       tiny",
        "triangles   2",
        "shapes      2 (1 mesh, 1 sphere)",
        "lights      1 (1 area)",
        "effects     2",
        "  soft-shadows      a sphere emits light (tiny.pbrt:11)",
    ] {
        assert!(out.lines().any(|l| l == line), "{line}: {out}");
    }
    assert!(out.contains("\nmemory      a render with default options takes "), "{out}");
    // What is said of it beforehand is what the render says.
    #[cfg(target_os = "linux")]
    foreseen(&folder, &out);
    // The file's own units; the tree's boxes are a little wider than what they hold.
    assert!(out.contains("\nbounds      (-9.0"), "{out}");
    let scenes = bundled::names().join(", ");
    for command in ["render", "info"] {
        let help = folder.done(&format!("{command} --help")).replace(" (the default)", "").replace('\n', " ");
        assert!(help.contains(&scenes), "{help}");
    }
    let help = folder.done("render --help");
    // Help names every layer that the error lists.
    let wrong = folder.run("render tiny.pbrt --layers nonesuch").err;
    let layers =
        wrong.split_once("choose among ").and_then(|(_, rest)| rest.split_once(", or none")).expect("layers").0;
    let described =
        help.split_once("--layers <").and_then(|(_, rest)| rest.split_once("\n\n      --")).expect("--layers").0;
    let named: Vec<&str> = described.split(|c: char| !c.is_alphanumeric()).collect();
    assert!(layers.split(", ").all(|layer| named.contains(&layer)), "{layers}: {described}");
    assert!(help.contains("Examples:\n  dapple render\n"), "{help}");
    // Defaults of parameters are those that `dapple samplers` prints.
    let sampler =
        help.split_once("--sampler <").and_then(|(_, rest)| rest.split_once("\n\n      --")).expect("it is listed").0;
    assert!(!sampler.replace("epsilon=0.01", "").contains("0."), "{sampler}");
}

#[test]
fn the_readme_counts_the_methods_that_there_are() {
    let counted = format!("{} samplers and {} filters", SAMPLERS.len(), FILTERS.len() + NOT_BUILT.len());
    assert!(include_str!("../../../../README.md").contains(&counted), "{counted}");
}

/// The line of a kind, and the codes that colour it.
const COLOURS: [(&str, &str); 2] =
    [("error: ", "\x1b[1;31merror:\x1b[0m "), ("warning: ", "\x1b[1;33mwarning:\x1b[0m ")];

#[test]
fn errors_and_warnings_are_coloured_on_request() {
    let folder = Folder::new();
    folder.write("odd.pbrt", TINY.to_owned() + "Shape \"cone\"\n");
    let said = |words: &str, environment: &[(&str, &str)]| {
        let mut command = folder.command(words);
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        let output = command.envs(environment.iter().copied()).output().expect("the program starts");
        String::from_utf8(output.stderr).expect("UTF-8")
    };
    let cases = ["render odd.pbrt --spp 1", "render odd.pbrt --spp 1 --allow-unsupported -o odd.pfm"];
    for ((plain, coloured), words) in COLOURS.into_iter().zip(cases) {
        let forced = said(words, &[("CLICOLOR_FORCE", "1")]);
        assert!(forced.starts_with(coloured), "{forced:?}");
        for environment in
            [&[][..], &[("CLICOLOR_FORCE", "0")], &[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")], &[("NO_COLOR", "1")]]
        {
            let err = said(words, environment);
            assert!(err.starts_with(plain) && !err.contains('\x1b'), "{environment:?}: {err:?}");
        }
    }
}

/// A terminal of util-linux's `script`, whose bytes come back as output.
#[cfg(target_os = "linux")]
#[test]
fn a_terminal_gets_colours_and_a_bar() {
    let folder = Folder::new();
    folder.write("odd.pbrt", TINY.to_owned() + "Shape \"cone\"\n");
    let program = env!("CARGO_BIN_EXE_dapple");
    let on_terminal = |words: &str, terminal: &str| {
        let line = format!("stty cols 100 rows 30; exec {program} {words}");
        let mut command = std::process::Command::new("script");
        command.args(["-q", "-e", "-c", &line, "/dev/null"]).current_dir(folder.path(""));
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        let run = command.env("TERM", terminal).stdin(std::process::Stdio::null()).output();
        run.map(|output| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let words = "render odd.pbrt --time 0.3 --filter none --resolution 96x64 --allow-unsupported -o odd.pfm";
    let Ok(shown) = on_terminal(words, "xterm-256color") else {
        eprintln!("skipped: util-linux's script is not installed");
        return;
    };
    assert!(shown.contains(COLOURS[1].1) && shown.contains(" spp, "), "{shown:?}");
    let bare = on_terminal(words, "dumb").expect("as before");
    assert!(bare.contains("warning: ") && !bare.contains(COLOURS[1].1), "{bare:?}");
}
