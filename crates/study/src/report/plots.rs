//! The charts of error against render time as SVG files.

use super::html::Builder;
use super::log_log_chart::{SIZE, swatch};
use super::method_style::{names, styles};
use crate::file_names::safe_file_name;
use crate::recorded_study::RecordedStudy;
use crate::summary::Summary;

/// Makes a file name and the text of an SVG for each scene. The SVG contains its own colours, for light and dark
/// backgrounds.
pub(super) fn plots(recorded: &RecordedStudy, summary: &Summary) -> Vec<(String, String)> {
    let methods = &recorded.manifest.methods;
    let (names, styles) = (names(methods), styles(methods));
    let builder = Builder { recorded, summary, names: &names, styles: &styles, budget: None };
    let plot = |scene: &crate::record::SceneRecord| {
        let chart = builder.over_seconds(scene)?;
        let legend = names.iter().zip(&styles).enumerate().map(|(i, (name, style))| entry(i, name, &swatch(*style)));
        Some((format!("{}.svg", safe_file_name(&scene.name)), whole(&scene.name, &chart, &legend.collect::<String>())))
    };
    recorded.manifest.scenes.iter().filter_map(plot).collect()
}

const HEAD: u32 = 30;
const LEGEND: u32 = 320;
const LINE: u32 = 24;

/// The SVG of a line in the legend.
fn entry(number: usize, name: &str, swatch: &str) -> String {
    let (x, y) = (SIZE.0 + 8, HEAD + 16 + LINE * number as u32);
    let swatch = placed(swatch, [x, y - 12], [34, 16]);
    format!("{swatch}<text x=\"{}\" y=\"{y}\">{}</text>", x + 42, escaped(name))
}

fn whole(title: &str, chart: &str, legend: &str) -> String {
    let (width, height) = (SIZE.0 + LEGEND, SIZE.1 + HEAD);
    let style = include_str!("../../templates/palette.css");
    let title = escaped(title);
    let chart = placed(chart, [0, HEAD], [SIZE.0, SIZE.1]);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         role=\"img\"><title>{title}: error against time</title><style>{style}\
         svg {{ background: var(--page); font: 14px sans-serif; }} text {{ fill: var(--ink); }}</style>\
         <text x=\"10\" y=\"20\" font-weight=\"bold\">{title}</text>{chart}{legend}</svg>\n"
    )
}

/// Places an SVG inside another one, in the given rectangle.
fn placed(svg: &str, [x, y]: [u32; 2], [width, height]: [u32; 2]) -> String {
    let size = format!(" width=\"{width}\" height=\"{height}\"");
    let (tag, rest) = svg.split_once('>').unwrap_or((svg, ""));
    let tag = tag.replacen(&size, "", 1).replacen("<svg", &format!("<svg x=\"{x}\" y=\"{y}\"{size}"), 1);
    format!("{tag}>{rest}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
