//! A job specification of OpenCue, after its document type `cjsl-1.12`.

use super::Job;
use super::files::{Files, quoted};
use super::stages::Stages;
use crate::Result;

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let name = job.plain_name().replace('-', "_");
    let parts = format!("1-{}", job.options.parts);
    // Layers in their order, each with its frames and the arguments of stage.sh.
    let layers: Vec<(String, &str, String)> = match job.stages {
        Stages::One => {
            vec![("render".into(), &parts, "render #IFRAME#".into()), ("merge".into(), "1-1", "merge".into())]
        }
        Stages::Several { .. } => {
            let mut layers = vec![("start".to_owned(), "1-1", "current".to_owned())];
            for number in 0..job.stages.most()? {
                layers.push((format!("render_{number}"), &*parts, format!("render #IFRAME# {number}")));
                layers.push((format!("plan_{number}"), "1-1", format!("plan {number}")));
            }
            layers.push(("merge".into(), "1-1", "merge".into()));
            layers
        }
    };
    let described: String =
        layers.iter().map(|(layer, range, arguments)| layer_of(job, layer, range, arguments)).collect();
    let depends: String = layers.windows(2).map(|pair| depend(&name, &pair[1].0, &pair[0].0)).collect();
    let (show, retries) = (&job.options.show, job.options.tries - 1);
    let text = format!(
        r#"<?xml version="1.0"?>
<!DOCTYPE spec PUBLIC "SPI Cue Specification Language" "http://localhost:8080/spcue/dtd/cjsl-1.12.dtd">
<spec>
  <facility>local</facility>
  <show>{show}</show>
  <shot>render</shot>
  <user>dapple</user>
  <job name="{name}">
    <paused>False</paused>
    <maxretries>{retries}</maxretries>
    <autoeat>False</autoeat>
    <layers>
{described}    </layers>
  </job>
  <depends>
{depends}  </depends>
</spec>
"#
    );
    files.add("job.xml", &text)?;
    Ok(format!("opencue.api.launchSpecAndWait(open('{}/job.xml').read()) in Python", job.folder))
}

fn layer_of(job: &Job<'_>, name: &str, range: &str, arguments: &str) -> String {
    let kind = if name.starts_with("render") { "Render" } else { "Util" };
    let command = escaped(&format!("sh {}/stage.sh {arguments}", quoted(&job.folder)));
    let cores = if job.threads > 0 { format!("\n        <cores>{}</cores>", job.threads) } else { String::new() };
    let gibibytes = |bytes: u64| format!("\n        <memory>{}g</memory>", bytes.div_ceil(1 << 30));
    let memory = job.memory.map_or_else(String::new, gibibytes);
    format!(
        r#"      <layer name="{name}" type="{kind}">
        <cmd>{command}</cmd>
        <range>{range}</range>
        <chunk>1</chunk>{cores}{memory}
        <services><service>shell</service></services>
      </layer>
"#
    )
}

/// The dependency of a layer on all frames of another.
fn depend(job: &str, layer: &str, on: &str) -> String {
    format!(
        r#"    <depend type="LAYER_ON_LAYER">
      <depjob>{job}</depjob>
      <deplayer>{layer}</deplayer>
      <onjob>{job}</onjob>
      <onlayer>{on}</onlayer>
    </depend>
"#
    )
}

/// Text between the tags of XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
