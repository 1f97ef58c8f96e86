#!/usr/bin/env python3
"""study_tables.py FOLDER [--latex] [--plots DIR]: tables and curves of a study, from its runs.jsonl.

Prints, as Markdown or as LaTeX (packages booktabs and graphicx):

* verdicts against the baseline, as summary.csv has them;
* effects of sampler and filter: a method's sampler alone, its filter alone, both, and their interaction, which is the ratio of both
  together to the product of the two; below 1 they reinforce each other;
* slopes of relMSE over samples and over seconds (independent samples have -1), and the seconds to reach an error over the baseline's,
  interpolated seed by seed; a dash where a seed does not reach it.

--plots writes SCENE.svg for each scene: relMSE against seconds, with logarithmic axes. Needs Python 3.10 and nothing else. Intervals
are 95 % over seeds (Student's t of logarithms, paired by seed).
"""
import csv
import json
import math
import sys
from collections import defaultdict
from pathlib import Path

T95 = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093,
       2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042]
COLOURS = ["#3b4148", "#0072b2", "#d55e00", "#007a59", "#b5488e", "#876600", "#2a93d0", "#6a3fb5"]
DASHES = ["none", "7 4", "2 3", "10 3 2 3", "14 4"]


def interval(values, log=True):
    """The (geometric) mean and its 95 % interval as text."""
    if not values or (log and min(values) <= 0):
        return "–"
    values = [math.log(v) for v in values] if log else values
    n, mean = len(values), sum(values) / len(values)
    back = math.exp if log else float
    number = lambda v: f"{v:.2f}" if 0.095 <= abs(v) < 9.995 else f"{v:.3g}"
    if n == 1:
        return number(back(mean))
    deviation = math.sqrt(sum((v - mean) ** 2 for v in values) / (n - 1))
    half = (T95[n - 2] if n <= 31 else 1.96 + 2.4 / (n - 1)) * deviation / math.sqrt(n)
    return f"{number(back(mean))} [{number(back(mean - half))}, {number(back(mean + half))}]"


def slope(points):
    """The slope of the line fitted to points on logarithmic axes; None without one."""
    if len(points) < 2 or min(min(p) for p in points) <= 0:
        return None
    xs, ys = zip(*[(math.log(x), math.log(y)) for x, y in points])
    mx, my = sum(xs) / len(xs), sum(ys) / len(ys)
    spread = sum((x - mx) ** 2 for x in xs)
    return sum((x - mx) * (y - my) for x, y in zip(xs, ys)) / spread if spread else None


def crossing(curve, level):
    """The seconds at which a curve of (seconds, error) first falls to the level; None if it does not cross it."""
    for (t0, e0), (t1, e1) in zip(curve, curve[1:]):
        if e0 >= level >= e1 > 0 and e0 > e1:
            share = math.log(e0 / level) / math.log(e0 / e1)
            return math.exp(math.log(t0) + share * math.log(t1 / t0))
    return None


def levels(errors):
    """At most three round errors within those of the baseline."""
    if len(errors) < 2 or min(errors) <= 0:
        return []
    decades = range(math.floor(math.log10(min(errors))), math.ceil(math.log10(max(errors))) + 1)
    inside = [step * 10.0**d for d in decades for step in (1, 2, 5) if min(errors) <= step * 10.0**d <= max(errors)][::-1]
    return inside if len(inside) <= 3 else [inside[i * (len(inside) - 1) // 2] for i in range(3)]


class Study:
    def __init__(self, folder):
        self.folder = Path(folder)
        self.settings = json.loads((self.folder / "study.json").read_text(encoding="utf-8"))
        key = lambda m: (m["sampler"], m["points"], m["filter"])
        self.methods = [key(m) for m in self.settings["methods"]]
        self.baseline = key(self.settings["baseline"])
        self.scenes = [scene["name"] for scene in self.settings["scenes"]]
        several = len({m[1] for m in self.methods}) > 1
        self.names = {m: m[0] + (f" / {m[1]}" if several else "") + (f" + {m[2]}" if m[2] != "none" else "") for m in self.methods}
        # By scene, method, and budget: the run of each seed.
        self.runs = defaultdict(dict)
        for line in (self.folder / "runs.jsonl").read_text(encoding="utf-8").splitlines():
            run = json.loads(line)
            self.runs[run["scene"], key(run["method"]), tuple(run["budget"].items())[0]][run["seed"]] = run
        timed = self.settings["time_of"]
        self.headline = ("time_of", timed) if timed else ("spp", max(self.settings["spp"]))
        self.at = f"equal time, that of {self.names[self.baseline]} with {timed} spp" if timed else f"{self.headline[1]} spp"

    def errors(self, scene, method):
        found = self.runs.get((scene, method, self.headline)) or {}
        return {seed: run["errors"]["relmse"] for seed, run in found.items()}

    def curves(self, scene, method, x):
        """Each seed's points of x and relMSE, over the budgets in samples per pixel."""
        found = defaultdict(list)
        for spp in sorted(self.settings["spp"]):
            for seed, run in self.runs.get((scene, method, ("spp", spp)), {}).items():
                found[seed].append((run[x], run["errors"]["relmse"]))
        return found

    def verdicts(self):
        with open(self.folder / "summary.csv", newline="", encoding="utf-8") as file:
            rows = {(r["scene"], (r["sampler"], r["points"], r["filter"]), r["budget"], r["metric"]): r for r in csv.DictReader(file)}
        budget = f"time of {self.headline[1]} spp" if self.headline[0] == "time_of" else f"{self.headline[1]} spp"
        metrics = ["relmse ratio", "relmse_trimmed ratio", "srgb8_mse ratio", "flip ratio", "seconds ratio"]
        number = lambda text: f"{float(text):.3g}" if text else "–"
        cell = lambda r: number(r["value"]) + (f" [{number(r['low'])}, {number(r['high'])}]" if r["low"] else "") + ("§" if "limited" in r["note"] else "")
        table = []
        for scene in self.scenes:
            for method in self.methods:
                found = [rows.get((scene, method, budget, metric)) for metric in metrics]
                if found[0]:
                    note = found[0]["note"]
                    verdict = note.split(";")[0] + (" *" if "holds for all" in note else "")
                    table.append([scene, self.names[method], verdict] + [cell(r) for r in found])
        won = [sum(row[2].startswith(word) for row in table) for word in ("win", "loss", "undecided")]
        title = f"At {self.at}, over {self.names[self.baseline]}: {won[0]} won, {won[1]} lost, {won[2]} undecided"
        return title, ["scene", "method", "verdict", "relMSE", "trimmed relMSE", "sRGB MSE", "FLIP", "time"], table

    def effects(self):
        base_sampler, _, base_filter = self.baseline
        table = []
        for scene in self.scenes:
            for sampler, points, filter in self.methods:
                corners = [(base_sampler, points, base_filter), (sampler, points, base_filter), (base_sampler, points, filter), (sampler, points, filter)]
                found = [self.errors(scene, corner) for corner in corners]
                seeds = sorted(set.intersection(*map(set, found)))
                if sampler == base_sampler or filter == base_filter or not seeds:
                    continue
                square = [[errors[seed] for errors in found] for seed in seeds]
                ratios = [(s / b, f / b, t / b, t * b / (s * f)) for b, s, f, t in square if min(b, s, f) > 0]
                table.append([scene, sampler, filter] + [interval([r[i] for r in ratios]) for i in range(4)])
        heads = ["scene", "sampler", "filter", "sampler alone", "filter alone", "both", "interaction"]
        return f"At {self.at}: relMSE by sampler and filter", heads, table

    def slopes(self, scene):
        base = self.curves(scene, self.baseline, "render_s")
        marks = levels([error for curve in base.values() for _, error in curve])
        table = []
        for method in self.methods:
            cells = []
            for x in ("spp", "render_s"):
                found = [slope(curve) for curve in self.curves(scene, method, x).values()]
                cells.append(interval(found, log=False) if found and None not in found else "–")
            own = self.curves(scene, method, "render_s")
            for level in marks:
                pairs = [(crossing(curve, level), crossing(base.get(seed, []), level)) for seed, curve in own.items()]
                cells.append("–" if any(None in pair for pair in pairs) else interval([a / b for a, b in pairs]))
            table.append([self.names[method]] + cells)
        over = [f"time to relMSE {level:g} over {self.names[self.baseline]}" for level in marks]
        return scene, ["method", "slope over spp", "slope over time"] + over, table

    def plot(self, scene):
        """The SVG of relMSE against seconds, one curve a method."""
        mean = lambda values: math.exp(sum(map(math.log, values)) / len(values))
        curves = {}
        for method in self.methods:
            by_budget = list(zip(*[c for c in self.curves(scene, method, "render_s").values() if all(e > 0 for _, e in c)]))
            curves[method] = [(mean([t for t, _ in p]), mean([e for _, e in p])) for p in by_budget]
        points = [p for curve in curves.values() for p in curve]
        if not points:
            return None
        ends = [(min(v), max(v) * 1.0001) for v in zip(*points)]
        place = lambda v, axis, start, size: start + size * math.log(v / ends[axis][0]) / math.log(ends[axis][1] / ends[axis][0])
        at = lambda p: f"{place(p[0], 0, 80, 380):.1f},{place(p[1], 1, 300, -270):.1f}"
        out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 350" font-family="sans-serif" font-size="13"><rect width="800" height="350" fill="white"/>']
        out.append(f'<text x="80" y="20" font-weight="bold">{escape(scene)}</text><rect x="80" y="30" width="380" height="270" fill="none" stroke="#888"/>')
        for axis, anchor in ((0, "middle"), (1, "end")):
            for value in [step * 10.0**d for d in range(-9, 9) for step in (1, 2, 5) if ends[axis][0] <= step * 10.0**d <= ends[axis][1]]:
                x, y = (place(value, 0, 80, 380), 318) if axis == 0 else (74, place(value, 1, 304, -270))
                out.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{value:g}</text>')
        out.append('<text x="270" y="340" text-anchor="middle">seconds for an image</text><text transform="rotate(-90 16 165)" x="16" y="165" text-anchor="middle">relMSE</text>')
        filters = sorted({m[2] for m in self.methods}, key=[m[2] for m in self.methods].index)
        samplers = sorted({m[:2] for m in self.methods}, key=[m[:2] for m in self.methods].index)
        for i, (method, curve) in enumerate(curves.items()):
            style = f'stroke="{COLOURS[samplers.index(method[:2]) % 8]}" stroke-width="2" stroke-dasharray="{DASHES[filters.index(method[2]) % 5]}"'
            out.append(f'<polyline points="{" ".join(map(at, curve))}" fill="none" {style}/><path d="M480 {38 + 20 * i}h34" {style}/>')
            out.append(f'<text x="520" y="{42 + 20 * i}">{escape(self.names[method])}</text>')
        return "\n".join(out) + "</svg>\n"


def escape(text):
    return text.replace("&", "&amp;").replace("<", "&lt;")


def markdown(title, heads, rows):
    lines = [f"\n**{title}**\n", "| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def latex(title, heads, rows):
    special = {c: "\\" + c for c in "&%$#_{}"} | {"\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "–": "--",
                                                  "<": "\\textless{}", ">": "\\textgreater{}", "|": "\\textbar{}", "§": "\\textsuperscript{\\S}"}
    plain = lambda cells: " & ".join("".join(special.get(c, c) for c in cell) for cell in cells) + " \\\\"
    return "\n".join(["\\begin{table}\\centering", f"\\caption{{{plain([title])[:-3]}}}", "\\resizebox{\\linewidth}{!}{%", f"\\begin{{tabular}}{{{'l' * len(heads)}}}", "\\toprule",
                      plain(heads), "\\midrule", *map(plain, rows), "\\bottomrule", "\\end{tabular}}", "\\end{table}\n"])


def main(folder, *options):
    study = Study(folder)
    write = latex if "--latex" in options else markdown
    for title, heads, rows in [study.verdicts(), study.effects()] + [study.slopes(scene) for scene in study.scenes]:
        if rows:
            print(write(title, heads, rows))
    if "--plots" in options:
        plots = Path(options[options.index("--plots") + 1])
        plots.mkdir(parents=True, exist_ok=True)
        for scene in study.scenes:
            if svg := study.plot(scene):
                (plots / f"{''.join(c if c.isalnum() or c in '-_.' else '-' for c in scene)}.svg").write_text(svg, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:]) if sys.argv[1:] else sys.exit(__doc__)
