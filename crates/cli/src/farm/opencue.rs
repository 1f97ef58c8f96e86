//! A job specification of OpenCue, after its document type `cjsl-1.12`.

use super::Job;
use super::files::{Files, quoted};
use crate::Result;

pub(super) fn write(job: &Job<'_>, files: &mut Files) -> Result<String> {
    let (name, parts) = (job.plain_name().replace('-', "_"), job.options.parts);
    let layer = |layer: &str, kind: &str, range: &str, arguments: &str| {
        let command = escaped(&format!("sh {}/stage.sh {arguments}", quoted(&job.folder)));
        let cores = if job.threads > 0 { format!("\n        <cores>{}</cores>", job.threads) } else { String::new() };
        let memory = job.memory.map_or_else(String::new, |bytes| format!("\n        <memory>{}g</memory>", bytes.div_ceil(1 << 30)));
        format!(
            r#"      <layer name="{layer}" type="{kind}">
        <cmd>{command}</cmd>
        <range>{range}</range>
        <chunk>1</chunk>{cores}{memory}
        <services><service>shell</service></services>
      </layer>
"#
        )
    };
    let layers = layer("render", "Render", &format!("1-{parts}"), "render #IFRAME#") + &layer("merge", "Util", "1-1", "merge");
    let (show, retries) = (&job.options.show, job.options.tries - 1);
    files.add(
        "job.xml",
        &format!(
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
{layers}    </layers>
  </job>
  <depends>
    <depend type="LAYER_ON_LAYER">
      <depjob>{name}</depjob>
      <deplayer>merge</deplayer>
      <onjob>{name}</onjob>
      <onlayer>render</onlayer>
    </depend>
  </depends>
</spec>
"#
        ),
    )?;
    Ok(format!("opencue.api.launchSpecAndWait(open('{}/job.xml').read()) in Python", job.folder))
}

/// Text between the tags of XML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
