//! External filters: their input, their output, and the errors when they fail.
#![cfg(unix)]

use crate::support::{Place, in_process};
use dapple_scene::image::{Image, encode_pfm, read_channels, write_file};
use dapple_study::{External, Method, Run, StudyError};

impl Place {
    /// A shell script as an external filter, started in this folder with the two images as arguments.
    fn script(&self, name: &str, text: &str) -> External {
        std::fs::write(self.path(name), text).expect("the script");
        let mut external = External::new(name, &["sh", name, "{input}", "{output}", "{threads}"]);
        external.folder = self.path("");
        external
    }

    /// The runs of uniform sampling without a filter and with each of `external`.
    fn filtered(&self, external: &[External], folder: &str) -> Result<Vec<Run>, StudyError> {
        let methods = external.iter().map(|e| Method::new("uniform", "sobol", &e.name)).collect::<Vec<_>>();
        let mut settings = self.plan(&["spp=4", "seeds=[1]", "time_of=0", "threads=1"]).settings;
        (settings.samplers, settings.methods, settings.external) = (None, methods, external.to_vec());
        let mut study = self.open(settings.resolve()?, folder)?;
        study.run(&mut in_process(), &mut ())?;
        Ok(study.runs().to_vec())
    }

    fn message_of(&self, text: &str, folder: &str) -> String {
        let external = [self.script("program", text)];
        self.filtered(&external, folder).expect_err("refused").to_string()
    }
}

#[test]
fn the_output_of_an_external_filter_is_measured() {
    let place = Place::new();
    let black = Image::filled([8, 8], [0.0; 3]).unwrap();
    write_file(&place.path("black.pfm"), &encode_pfm(&black).unwrap()).unwrap();
    let runs = place
        .filtered(&[place.script("copy", r#"cp "$1" "$2""#), place.script("black", r#"cp black.pfm "$2""#)], "study")
        .unwrap();
    let [none, copy, black] = &runs[..] else { panic!("{}", runs.len()) };
    assert_eq!(copy.errors, none.errors, "the copy of the unfiltered image is the unfiltered image");
    // The control.
    assert!(
        black.errors.get("mean_ratio") == 0.0 && black.errors.get("mse") > 2.0 * none.errors.get("mse"),
        "{:?}",
        black.errors
    );
    assert!(copy.seconds.filter > 0.0 && none.cpu_s.is_none() && copy.cpu_s.is_none());
    assert!((copy.render_s - copy.seconds.trace - copy.seconds.plan - copy.seconds.filter).abs() < 1e-9);
}

#[test]
fn the_input_of_an_external_filter_has_features() {
    let place = Place::new();
    let script = r#"cp "$1" seen.exr; cp "$1" "$2"; echo "threads $3" > threads; echo '{"seconds": 0.125}'"#;
    let runs = place.filtered(&[place.script("look", script)], "study").unwrap();
    assert_eq!(runs[1].seconds.filter, 0.125, "it reported its time");
    assert!(runs[1].render_s > 0.125);
    assert_eq!(place.text("threads"), "threads 1\n");
    let seen = read_channels(&std::fs::read(place.path("seen.exr")).unwrap(), "seen.exr").unwrap();
    let at = |name: &str| match seen.plane(name) {
        Some(dapple_scene::image::Plane::F32(values)) => values[8 * 6 + 4],
        other => panic!("{name}: {other:?}"),
    };
    // The floor reflects half of the light, upwards.
    let found = ["albedo.R", "albedo.G", "albedo.B", "normal.X", "normal.Y", "normal.Z", "coverage.Y"].map(at);
    assert_eq!(found.map(|v| (v * 1000.0).round() / 1000.0), [0.5, 0.5, 0.5, 0.0, 1.0, 0.0, 1.0]);
    assert!(at("depth.Y") > 1.0 && at("R") > 0.0);
}

#[test]
fn an_external_filter_is_part_of_the_request_to_a_process() {
    let place = Place::new();
    let external = place.script("copy", r#"cp "$1" "$2""#);
    let json = r#"{"name":"copy","command":["sh","copy","{input}","{output}","{threads}"],"folder":"#;
    assert!(serde_json::to_string(&external).unwrap().starts_with(json));
}

#[test]
fn failures_of_an_external_filter_are_explained() {
    let place = Place::new();
    let small = Image::filled([8, 7], [1.0; 3]).unwrap();
    write_file(&place.path("small.pfm"), &encode_pfm(&small).unwrap()).unwrap();
    let mut bad = Image::filled([8, 8], [1.0; 3]).unwrap();
    bad.pixels[8 * 2 + 5][1] = f32::NAN;
    write_file(&place.path("bad.pfm"), &encode_pfm(&bad).unwrap()).unwrap();
    let cases = [
        (
            "echo 'no weights' >&2; exit 3",
            "the filter \"program\" (sh program {input} {output} {threads}) ended with exit status: 3: no weights",
        ),
        ("true", "wrote no image; write it to the path given as {output}"),
        ("echo hello > \"$2\"", "wrote an image that cannot be read: {output}"),
        ("cp small.pfm \"$2\"", "wrote an image of 8x7 pixels; write 8x8"),
        ("cp bad.pfm \"$2\"", "wrote 1 pixels that are NaN or infinite, the first at column 5, row 2"),
        (r#"cp "$1" "$2"; echo '{"seconds": -1}'"#, "reports -1 seconds"),
    ];
    for (number, (script, message)) in cases.into_iter().enumerate() {
        let found = place.message_of(script, &format!("study-{number}"));
        assert!(
            found.contains(message) && found.starts_with("tiny, uniform/sobol/program, seed 1"),
            "{script}: {found}"
        );
    }
    let nobody = External::new("p", &["/nonesuch/program", "{input}", "{output}"]);
    let found = place.filtered(&[nobody], "nobody").expect_err("refused").to_string();
    assert!(found.contains("cannot be started: "), "{found}");
}

#[test]
fn a_changed_external_filter_is_another_study() {
    let place = Place::new();
    let [copy, other] = [place.script("copy", r#"cp "$1" "$2""#), place.script("copy", r#"cp "$1" "$2""#)];
    place.filtered(&[copy], "study").unwrap();
    let mut moved = other.clone();
    moved.folder = place.path(".");
    assert!(place.filtered(&[moved], "study").is_ok(), "the working folder does not matter");
    let mut changed = other;
    changed.command.push("-v".into());
    let found = place.filtered(&[changed], "study");
    let found = found.expect_err("refused").to_string();
    assert!(found.contains("this folder holds another study") && found.contains("external: "), "{found}");
}
