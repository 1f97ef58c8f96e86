//! The file `notebook.ipynb`: a Jupyter notebook that reads `runs.jsonl` with pandas and plots error against time.

use crate::recorded_study::RecordedStudy;
use serde_json::{Value, json};

const READ: &str = r#"import json
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

with open("study.json", encoding="utf-8") as file:
    study = json.load(file)
with open("runs.jsonl", encoding="utf-8") as file:
    runs = pd.json_normalize([json.loads(line) for line in file if line.strip()])
runs["name"] = runs["method.sampler"] + " / " + runs["method.points"] + " / " + runs["method.filter"]
runs[["scene", "name", "seed", "spp", "render_s", "cpu_s", "errors.relmse", "errors.flip"]].head()"#;

const PLOT: &str = r#"ERROR, TIME = "errors.relmse", "render_s"  # or "errors.flip", "cpu_s"
equal_spp = runs[runs["budget.spp"].notna()] if "budget.spp" in runs else runs.iloc[:0]
geometric = lambda values: np.exp(np.log(values[values > 0]).mean())
for scene, of_scene in equal_spp.groupby("scene", sort=False):
    figure, axes = plt.subplots(figsize=(7, 5))
    for name, of_method in of_scene.groupby("name", sort=False):
        curve = of_method.groupby("budget.spp").agg(time=(TIME, "median"), error=(ERROR, geometric))
        axes.loglog(curve["time"], curve["error"], marker="o", label=name)
    axes.set(title=scene, xlabel=TIME, ylabel=ERROR)
    axes.legend()
    axes.grid(which="both", alpha=0.3)
plt.show()"#;

const COMPARE: &str = r#"base = " / ".join(study["baseline"][key] for key in ("sampler", "points", "filter"))
wide = equal_spp.pivot_table(index=["scene", "budget.spp", "seed"], columns="name", values=ERROR)
ratios = np.log(wide.div(wide[base], axis=0))
np.exp(ratios.groupby(["scene", "budget.spp"]).mean())"#;

/// Makes the notebook. Its cells need pandas and matplotlib, and are run in the study's folder.
pub(super) fn render(recorded: &RecordedStudy) -> String {
    let cells = [
        text(
            "intro",
            &format!(
                "# Error against time\n\nA study of {} runs by Dapple {}.",
                recorded.runs.len(),
                recorded.manifest.version
            ),
        ),
        code("read", READ),
        text("plot-title", "Error against time at equal samples per pixel: geometric means over seeds."),
        code("plot", PLOT),
        text("compare-title", "Each method's error over the baseline's, paired by seed."),
        code("compare", COMPARE),
    ];
    let notebook = json!({
        "cells": cells,
        "metadata": {
            "kernelspec": { "display_name": "Python 3", "language": "python", "name": "python3" },
            "language_info": { "name": "python" },
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    });
    format!("{notebook:#}\n")
}

fn text(id: &str, source: &str) -> Value {
    json!({ "cell_type": "markdown", "id": id, "metadata": {}, "source": source })
}

fn code(id: &str, source: &str) -> Value {
    json!({ "cell_type": "code", "execution_count": null, "id": id, "metadata": {}, "outputs": [], "source": source })
}
