//! Jobs that `dapple farm` writes: their form, and what their commands make.

use crate::common::Folder;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// The default sampler and light selection, which learn from samples of the whole image, in several stages.
const RENDER: &str = "tiny.pbrt --spp 8 --parts 3 --image image.pfm --image image.png";

/// A folder with the job of a system, an `sbatch`, and a `sleep` that is short.
fn farm(system: &str, more: &str) -> Folder {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("bin")).expect("a folder");
    folder.write("bin/sbatch", SBATCH);
    folder.write("bin/sleep", "#!/bin/sh\nPATH=${PATH#*:}\nexec sleep 0.02\n");
    done(&folder, &["-c", "chmod +x bin/*"]);
    folder.done(&format!("farm {system} {RENDER} -o job {more}"));
    folder
}

fn json(folder: &Folder, name: &str) -> Value {
    serde_json::from_slice(&folder.read(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// A shell with this program in the variable DAPPLE, and `bin` first in the path.
fn command(folder: &Folder) -> Command {
    let path = std::env::var("PATH").unwrap_or_default();
    let mut command = Command::new("sh");
    command.current_dir(folder.path("")).env("DAPPLE", env!("CARGO_BIN_EXE_dapple"));
    command.env("PATH", format!("{}:{path}", folder.path("bin").display()));
    command
}

fn shell(folder: &Folder, words: &[&str]) -> Output {
    command(folder).args(words).output().expect("a shell")
}

fn done(folder: &Folder, words: &[&str]) -> String {
    let output = shell(folder, words);
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words:?}: {err}");
    String::from_utf8(output.stdout).expect("UTF-8") + &err
}

/// The image of one machine.
fn assert_same_image(folder: &Folder) {
    folder.done("render tiny.pbrt --spp 8 -o one.pfm -q");
    assert!(folder.read("one.pfm") == folder.read("job/image.pfm"), "the job's image has other bits");
}

fn is_shell(path: &Path) -> bool {
    Command::new("bash").arg("-n").arg(path).status().expect("bash").success()
}

/// An `sbatch` that runs what it is given at once, every task of an array in turn, and prints the number of the job.
/// It refuses a dependency on a job that failed or is not known.
const SBATCH: &str = include_str!("sbatch.sh");

#[test]
fn the_scripts_for_slurm_render_stage_by_stage_to_the_bits_of_one_machine() {
    let folder = farm("slurm", "");
    for script in ["stage.sh", "submit.sh", "render.sbatch", "plan.sbatch"] {
        assert!(is_shell(&folder.path("job").join(script)), "{script}");
    }
    done(&folder, &["job/submit.sh", "--partition=all"]);
    let log = folder.text("bin/log");
    assert!(log.contains("stages-3/1.plan: the next plan") && log.contains(": done; "), "{log}");
    assert_same_image(&folder);
    // Again, all is there: only the image is made.
    std::fs::remove_file(folder.path("job/image.pfm")).expect("the image");
    std::fs::remove_file(folder.path("bin/log")).expect("the log");
    done(&folder, &["job/submit.sh"]);
    assert!(!folder.path("bin/log").exists(), "something was submitted");
    assert_same_image(&folder);
}

#[test]
fn a_job_in_stages_goes_on_where_it_failed() {
    let folder = farm("slurm", "");
    done(&folder, &["job/stage.sh", "current"]);
    for part in ["1", "2", "3"] {
        done(&folder, &["job/stage.sh", "render", part]);
    }
    done(&folder, &["job/stage.sh", "plan"]);
    done(&folder, &["job/stage.sh", "render", "2"]);
    let early = shell(&folder, &["job/stage.sh", "plan"]);
    let err = String::from_utf8_lossy(&early.stderr).into_owned();
    assert!(!early.status.success() && err.contains("missing parts in stages-3/stage-1: 1 3;"), "{err}");
    let early = shell(&folder, &["job/stage.sh", "merge"]);
    assert!(!early.status.success() && !folder.path("job/image.pfm").exists());
    let out = done(&folder, &["job/submit.sh"]);
    assert!(out.contains("stage 1"), "{out}");
    let log = folder.text("bin/log");
    assert!(log.contains("part 2 of stage 1 is there already"), "{log}");
    assert_same_image(&folder);
}

#[test]
fn a_part_that_cannot_be_rendered_is_tried_again_and_nothing_is_merged() {
    let folder = farm("slurm", "--tries 2");
    folder.done("render tiny.pbrt --spp 8 -o 0.plan");
    std::fs::remove_file(folder.path("tiny.pbrt")).expect("the scene");
    done(&folder, &["-c", "mkdir job/stages-3 && cp 0.plan job/stages-3"]);
    let output = shell(&folder, &["job/submit.sh"]);
    let log = folder.text("bin/log");
    assert!(!output.status.success(), "the next stage was submitted after parts had failed");
    assert!(log.contains("failed 2 times: render 1") && log.contains("tiny.pbrt"), "{log}");
    assert!(!folder.path("job/image.pfm").exists());
}

/// Stages beyond the last one do nothing.
#[test]
fn templates_of_open_job_description_have_its_form_and_commands_that_run() {
    let folder = farm("openjd", "");
    let template = json(&folder, "job/job.template.json");
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    let parameter = &template["parameterDefinitions"][0];
    assert_eq!((&parameter["name"], &parameter["type"]), (&Value::from("Folder"), &Value::from("PATH")));
    assert_eq!(parameter["default"], ".", "relative to the template's folder");
    let steps = template["steps"].as_array().expect("steps");
    for pair in steps.windows(2) {
        assert_eq!(pair[1]["dependencies"][0]["dependsOn"], pair[0]["name"], "stages follow each other");
    }
    let at = folder.path("job");
    for step in steps {
        let is_one = step["parameterSpace"].is_null();
        assert!(is_one || step["parameterSpace"]["taskParameterDefinitions"][0]["range"] == "1-3");
        let action = &step["script"]["actions"]["onRun"];
        assert_eq!(action["command"], "sh");
        for part in 1..=if is_one { 1 } else { 3 } {
            let word = |word: &Value| {
                let text = word.as_str().expect("text").replace("{{Param.Folder}}", at.to_str().expect("a path"));
                text.replace("{{Task.Param.Part}}", &part.to_string())
            };
            let words: Vec<String> = action["args"].as_array().expect("arguments").iter().map(word).collect();
            done(&folder, &words.iter().map(String::as_str).collect::<Vec<_>>());
        }
    }
    assert_same_image(&folder);
}

#[test]
fn specifications_of_opencue_have_its_form_and_commands_that_run() {
    let folder = farm("opencue", "--show film_1");
    let text = folder.text("job/job.xml");
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(&text, options).expect("XML");
    let names = |node: roxmltree::Node<'_, '_>| -> Vec<String> {
        node.children().filter(|child| child.is_element()).map(|child| child.tag_name().name().to_owned()).collect()
    };
    let find = |name: &str| -> Vec<roxmltree::Node<'_, '_>> {
        document.descendants().filter(|node| node.has_tag_name(name)).collect()
    };
    // The order of elements is that of the document type.
    assert_eq!(names(document.root_element()), ["facility", "show", "shot", "user", "job", "depends"]);
    assert_eq!(names(find("job")[0]), ["paused", "maxretries", "autoeat", "layers"]);
    assert_eq!(names(find("depend")[0]), ["depjob", "deplayer", "onjob", "onlayer"]);
    let layers = find("layer");
    for (i, layer) in layers.iter().enumerate() {
        assert_eq!(names(*layer), ["cmd", "range", "chunk", "services"]);
        assert!(["Render", "Util", "Post"].contains(&layer.attribute("type").expect("a type")));
        if i > 0 {
            assert_eq!(find("deplayer")[i - 1].text(), layer.attribute("name"));
            assert_eq!(find("onlayer")[i - 1].text(), layers[i - 1].attribute("name"));
        }
        let (command, range) = (find("cmd")[i].text().expect("a command"), find("range")[i].text());
        let parts = if layer.attribute("type") == Some("Render") { 3 } else { 1 };
        assert_eq!(range, Some(&*format!("1-{parts}")));
        for part in 1..=parts {
            done(&folder, &["-c", &command.replace("#IFRAME#", &part.to_string())]);
        }
    }
    assert_same_image(&folder);
}

/// The pods of all parts run at once, and wait for each other's files.
#[test]
fn jobs_of_kubernetes_have_its_form_and_commands_that_run() {
    let folder = farm("k8s", "--container registry.example/dapple:1 --claim films --threads 2 --memory 1G");
    let list = json(&folder, "job/job.json");
    assert_eq!((&list["kind"], &list["apiVersion"]), (&Value::from("List"), &Value::from("v1")));
    let [job] = &list["items"].as_array().expect("items")[..] else { panic!("one job") };
    let (spec, pod) = (&job["spec"], &job["spec"]["template"]["spec"]);
    assert_eq!((&spec["completionMode"], &spec["completions"]), (&Value::from("Indexed"), &Value::from(3)));
    assert_eq!((&spec["parallelism"], &spec["backoffLimitPerIndex"]), (&Value::from(3), &Value::from(2)));
    assert_eq!(pod["restartPolicy"], "Never", "limits per index need it");
    assert_eq!(pod["volumes"][0]["persistentVolumeClaim"]["claimName"], "films");
    let container = &pod["containers"][0];
    assert_eq!(container["resources"]["requests"]["cpu"], "2");
    let environment = &container["env"][0];
    let start = |index: u32| {
        let words =
            container["command"].as_array().expect("a command").iter().skip(1).map(|word| word.as_str().expect("text"));
        let mut shell = command(&folder);
        shell.args(words);
        shell.env(environment["name"].as_str().expect("a name"), environment["value"].as_str().expect("a value"));
        shell.env("JOB_COMPLETION_INDEX", index.to_string()).spawn().expect("a shell")
    };
    let pods: Vec<_> = (0..3).map(start).collect();
    for mut pod in pods {
        assert!(pod.wait().expect("it ends").success());
    }
    assert_same_image(&folder);
}

#[test]
fn jobs_that_cannot_run_are_refused() {
    let folder = Folder::new();
    for (words, wrong) in [
        ("slurm tiny.pbrt --sampler uniform --time 5 -o job", "--spp"),
        ("slurm tiny.pbrt --sampler uniform --spp 4 --preview p.png -o job", "--preview"),
        ("slurm missing.pbrt --sampler uniform --spp 4 -o job", "no such file"),
        ("slurm tiny.pbrt --sampler uniform --spp 4", "--output"),
        ("cron tiny.pbrt --sampler uniform --spp 4 -o job", "slurm"),
        ("opencue tiny.pbrt --sampler uniform --spp 4 -o job --show a/b", "letters"),
    ] {
        let said = folder.run(&format!("farm {words}"));
        assert!(said.status != Some(0) && said.err.contains(wrong), "{words}: {}", said.err);
    }
    assert!(folder.names().is_empty(), "{:?}", folder.names());
    folder.says("farm openjd tiny.pbrt -o job", 1, &["--stages"]);
    folder.done("farm slurm tiny.pbrt --spp 4 -o job");
    folder.done("farm slurm tiny.pbrt --spp 4 --parts 5 -o job");
    folder.says("farm slurm tiny.pbrt --spp 8 -o job", 1, &["another render"]);
}
