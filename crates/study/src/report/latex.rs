//! The report's tables and curves for LaTeX, with the packages booktabs and pgfplots.

use super::comparison_table::{headline, lines};
use super::html::{Builder, phrase};
use super::log_log_chart::PlottedCurve;
use super::method_style::{MethodStyle, names, styles};
use super::table_cell::TableCell;
use crate::file_names::safe_file_name;
use crate::record::{RunBudget, SceneRecord};
use crate::recorded_study::RecordedStudy;
use crate::summary::{Summary, number};
use std::fmt::Write;

/// The line colours of methods, those of the page on white.
const COLOURS: [&str; 8] = ["3B4148", "0072B2", "D55E00", "007A59", "B5488E", "876600", "2A93D0", "6A3FB5"];
const MARKS: [&str; 8] = ["*", "square*", "triangle*", "diamond*", "o", "square", "triangle", "diamond"];
const DASHES: [&str; 5] = ["solid", "dashed", "dotted", "dashdotted", "densely dashed"];

/// Makes the LaTeX files: names in the folder `latex`, and contents.
pub(super) fn render(recorded: &RecordedStudy, summary: &Summary) -> Vec<(String, String)> {
    let methods = &recorded.manifest.methods;
    let (names, styles) = (names(methods), styles(methods));
    let builder = Builder { recorded, summary, names: &names, styles: &styles, budget: headline(recorded, summary) };
    let curves: Vec<(String, String)> = recorded
        .manifest
        .scenes
        .iter()
        .enumerate()
        .filter_map(|(i, scene)| {
            Some((format!("curves-{}-{}.tex", i + 1, ascii_name(&scene.name)), picture(&builder, scene)?))
        })
        .collect();
    let study = document(curves.iter().map(|(file, _)| file.as_str()));
    let tables = format!("{}{}", comparison(&builder), errors(&builder));
    [("tables.tex".to_owned(), tables), ("study.tex".to_owned(), study)].into_iter().chain(curves).collect()
}

/// The name of a scene in a file name that every TeX can read.
fn ascii_name(name: &str) -> String {
    safe_file_name(name).chars().map(|c| if c.is_ascii() { c } else { '-' }).collect()
}

/// A document with all tables and curves, for `pdflatex study.tex`.
fn document<'a>(curves: impl Iterator<Item = &'a str>) -> String {
    let mut text = String::from(
        "% Tables and curves of a study by Dapple: pdflatex study.tex\n\\documentclass{article}\n\\usepackage[utf8]{inputenc}\n\\usepackage[margin=15mm]{geometry}\n\\usepackage{booktabs,graphicx,pgfplots}\n\
         \\pgfplotsset{compat=1.16}\n\\begin{document}\n\\input{tables}\n",
    );
    curves.for_each(|file| {
        let _ =
            writeln!(text, "\\begin{{figure}}\\centering\\input{{{}}}\\end{{figure}}", file.trim_end_matches(".tex"));
    });
    text + "\\end{document}\n"
}

/// The comparison with the baseline as a table; empty without one.
fn comparison(builder: &Builder<'_>) -> String {
    let Some(budget) = builder.budget else { return String::new() };
    let base = baseline(builder);
    let rows = lines(builder.recorded, builder.summary, builder.names, &[budget]).into_iter().map(|line| {
        let verdict = format!("{}{}", line.class, if line.together { "*" } else { "" });
        let cells = line.cells[..5].iter().map(cell);
        [escape(&line.scene), escape(&line.method), verdict].into_iter().chain(cells).collect()
    });
    let caption = format!(
        "Error over that of {base} at {}; below 1 is better. Brackets: 95\\,\\% intervals over seeds, paired. *: holds for all \
         comparisons together.",
        escape(&phrase(budget))
    );
    let heads = ["Scene", "Method", "Verdict", "relMSE", "trimmed relMSE", "sRGB MSE", "FLIP", "Time"];
    table("comparison", &caption, &heads.map(str::to_owned), rows)
}

/// The relMSE of every method at every budget, scene by scene.
fn errors(builder: &Builder<'_>) -> String {
    let manifest = &builder.recorded.manifest;
    let budgets: Vec<RunBudget> = manifest.spp.iter().map(|&spp| RunBudget::Spp(spp)).collect();
    let mut text = String::new();
    for (i, scene) in manifest.scenes.iter().enumerate() {
        let rows = manifest.methods.iter().zip(builder.names).map(|(method, name)| {
            let find = |budget: &RunBudget| builder.summary.find(&scene.name, method, &budget.to_string(), "relmse");
            let cells = budgets.iter().map(|budget| cell(&TableCell::of(find(budget))));
            std::iter::once(escape(name)).chain(cells).collect()
        });
        let heads: Vec<String> =
            std::iter::once("Method".into()).chain(budgets.iter().map(RunBudget::to_string)).collect();
        let caption = format!("relMSE on {}: geometric means over seeds with 95\\,\\% intervals.", escape(&scene.name));
        text += &table(&format!("errors-{}", i + 1), &caption, &heads, rows);
    }
    text
}

fn baseline(builder: &Builder<'_>) -> String {
    let manifest = &builder.recorded.manifest;
    let at = manifest.methods.iter().position(|m| *m == manifest.baseline).unwrap_or(0);
    builder.names.get(at).map_or_else(String::new, |name| escape(name))
}

/// A table as wide as the text at most; empty without rows.
fn table(label: &str, caption: &str, heads: &[String], rows: impl Iterator<Item = Vec<String>>) -> String {
    let rows: String = rows.map(|row| format!("{} \\\\\n", row.join(" & "))).collect();
    if rows.is_empty() {
        return String::new();
    }
    let columns = "l".repeat(heads.len());
    let heads = heads.iter().map(|head| escape(head)).collect::<Vec<_>>().join(" & ");
    format!(
        "% Needs \\usepackage{{booktabs,graphicx}}\n\\begin{{table}}\n\\centering\n\\caption{{{caption}}}\n\\label{{tab:{label}}}\n\
         \\resizebox{{\\ifdim\\width>\\linewidth\\linewidth\\else\\width\\fi}}{{!}}{{%\n\\begin{{tabular}}{{{columns}}}\n\\toprule\n\
         {heads} \\\\\n\\midrule\n{rows}\\bottomrule\n\\end{{tabular}}}}\n\\end{{table}}\n\n"
    )
}

/// A value with its interval and footnote sign.
fn cell(cell: &TableCell) -> String {
    let parts = [cell.text.as_str(), &cell.interval].into_iter().filter(|part| !part.is_empty());
    escape(&format!("{}{}", parts.collect::<Vec<_>>().join(" "), cell.mark))
}

/// The curves of error against time of a scene; `None` without points.
fn picture(builder: &Builder<'_>, scene: &SceneRecord) -> Option<String> {
    let curves = builder.named_curves(scene, "seconds");
    if curves.is_empty() {
        return None;
    }
    let mut text = String::from("% Needs \\usepackage{pgfplots}\n\\begin{tikzpicture}\n");
    for (i, colour) in COLOURS.iter().enumerate() {
        let _ = writeln!(text, "\\definecolor{{dapple{i}}}{{HTML}}{{{colour}}}");
    }
    let title = escape(&scene.name);
    let ticks = round_ticks(curves.iter().flat_map(|(_, curve)| curve.points.iter().map(|point| point.0)));
    let ticks = ticks.iter().map(|tick| number(*tick)).collect::<Vec<_>>().join(",");
    let _ = writeln!(
        text,
        "\\begin{{loglogaxis}}[title={{{title}}}, xlabel={{seconds for an image}}, ylabel={{relMSE}}, width=\\linewidth, \
         height=0.7\\linewidth,\n  xtick={{{ticks}}}, xticklabels={{{ticks}}}, legend columns=2, legend cell align=left,\n  \
         legend style={{font=\\footnotesize, at={{(0.5,-0.18)}}, anchor=north}}]"
    );
    curves.iter().for_each(|(name, curve)| plot(&mut text, name, curve));
    Some(text + "\\end{loglogaxis}\n\\end{tikzpicture}\n")
}

/// The numbers 1, 2 and 5 times powers of ten within the range of `values`, and the nearest one on each side.
fn round_ticks(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let [low, high] = values.fold([f64::INFINITY, 0.0_f64], |[low, high], v| [low.min(v), high.max(v)]);
    let decades = libm::floor(libm::log10(low)) as i32..=libm::floor(libm::log10(high)) as i32 + 1;
    let steps = |decade: i32| [1, 2, 5].map(|step| format!("{step}e{decade}").parse().unwrap_or(1.0));
    let ticks: Vec<f64> = decades.flat_map(steps).collect();
    let first = ticks.iter().rposition(|tick| *tick <= low).unwrap_or(0);
    let last = ticks.iter().position(|tick| *tick >= high).unwrap_or(ticks.len() - 1);
    ticks[first..=last].to_vec()
}

/// Adds a curve with its 95 % intervals as error bars.
fn plot(text: &mut String, name: &str, curve: &PlottedCurve) {
    let MethodStyle { colour, mark, dash } = curve.style;
    let [mark, dash] = [MARKS[mark % MARKS.len()], DASHES[dash % DASHES.len()]];
    let colour = colour % COLOURS.len();
    let _ = writeln!(
        text,
        "\\addplot[color=dapple{colour}, {dash}, mark={mark}, mark options={{solid}}, error bars/.cd, y dir=both, y explicit] \
         coordinates {{"
    );
    for &(x, y, interval) in &curve.points {
        let bars = interval.map_or_else(String::new, |[low, high]| {
            format!(" += (0,{}) -= (0,{})", number((high - y).max(0.0)), number((y - low).max(0.0)))
        });
        let _ = writeln!(text, "  ({},{}){bars}", number(x), number(y));
    }
    let _ = writeln!(text, "}};\n\\addlegendentry{{{}}}", escape(name));
}

/// Escapes the characters with a meaning in TeX, and writes those that fonts lack as commands.
fn escape(text: &str) -> String {
    let escaped = |c: char| match c {
        '&' | '%' | '$' | '#' | '_' | '{' | '}' => format!("\\{c}"),
        '\\' => "\\textbackslash{}".into(),
        '~' => "\\textasciitilde{}".into(),
        '^' => "\\textasciicircum{}".into(),
        '<' | '>' | '|' | '×' | '†' | '‡' | '§' | '¶' | '−' | '–' => symbol(c).into(),
        '\u{a0}' => "~".into(),
        c if c.is_control() => " ".into(),
        c => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

fn symbol(c: char) -> &'static str {
    match c {
        '<' => "\\textless{}",
        '>' => "\\textgreater{}",
        '|' => "\\textbar{}",
        '×' => "$\\times$",
        '†' => "\\textsuperscript{\\dag}",
        '‡' => "\\textsuperscript{\\ddag}",
        '§' => "\\textsuperscript{\\S}",
        '¶' => "\\textsuperscript{\\P}",
        '−' => "$-$",
        _ => "--",
    }
}
