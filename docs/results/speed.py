#!/usr/bin/env python3
"""speed.py: prints the tables of docs/results/speed.md that compare rates with what is required.

Renders, traces, builds and clusters one after the other; needs an idle machine, 14 GiB for the largest trees, and Embree 3 (Debian's
libembree-dev) for the comparison of rays. Scenes of others are looked for in DAPPLE_SCENES (else ../shared/scenes), the peers'
Cornell box in DAPPLE_PEERS (else ../shared/peers); what is not there is left out with a message.
Arguments choose parts: cornell, scenes, rays, large, clusters; all without any.
"""
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SCENES = Path(os.environ.get("DAPPLE_SCENES", "../shared/scenes")) / "pbrt-v4"
PEERS = Path(os.environ.get("DAPPLE_PEERS", "../shared/peers"))
ROUNDS = 5
# Thousands of samples a CPU second of pbrt-v4, measured once; samples per pixel; the required and the desired ratio.
OTHERS = {
    "cornell-box": (162, 8, 7, 8),
    "teapot": (203, 8, 5, 8),
    "coffee": (115, 4, 8, 8),
    "dining-room": (129, 4, 4, 8),
    "staircase2": (75, 4, 6, 8),
}
# M triangles a CPU second.
CLUSTERING = (15, 30)


def run(*command, **more):
    done = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, text=True, env={**os.environ, **more})
    return done.returncode, done.stdout


def render(scene, *options):
    code, out = run("target/release/dapple", "render", scene, "--sampler", "uniform", "--json", *options)
    if code:
        sys.exit(f"rendering {scene} failed")
    return json.loads(out.strip().splitlines()[-1])


def spread(numbers, digits):
    low, middle, high = min(numbers), statistics.median(numbers), max(numbers)
    return f"{middle:.{digits}f} ({low:.{digits}f}, {high:.{digits}f})"


def met(value, required):
    return "met" if value >= required else f"missed by {100 * (1 - value / required):.0f} %"


def table(*rows):
    rows = [[str(cell) for cell in row] for row in rows]
    print("\n".join("| " + " | ".join(row) + " |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]]) + "\n")


def numpy_python(folder):
    """A Python that has numpy, which the peers' scene needs: this one, or one made in the folder."""
    if run(sys.executable, "-c", "import importlib.util, sys; sys.exit(not importlib.util.find_spec('numpy'))")[0] == 0:
        return sys.executable
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    subprocess.run([folder / "venv/bin/pip", "install", "-q", "numpy"], check=True, stdout=sys.stderr)
    return folder / "venv/bin/python"


def cornell(folder):
    if not (PEERS / "peerscenes.py").exists():
        return print(f"{PEERS} is not here, so no Cornell box of the peers\n")
    subprocess.run([numpy_python(folder), PEERS / "peerscenes.py", folder, "cornell"], check=True, stdout=sys.stderr)
    box, out = folder / "cornell.pbrt", ["-o", folder / "o.pfm"]
    lines = [render(box, "--resolution", "128x128", "--spp", 64, "--threads", 1, *out) for _ in range(ROUNDS)]
    rates = [line["samples"] / line["cpu"] * 1e-6 for line in lines]
    rows = [["work", "median (least, most)", "required", "goal", "required is"]]
    rows.append(["Cornell box of the peers, M paths a CPU second", spread(rates, 3), 1.5, 1.8, met(statistics.median(rates), 1.5)])
    ratios = []
    for _ in range(ROUNDS):
        one, two = (render(box, "--resolution", "256x256", "--spp", 64, "--threads", n, *out)["render_s"] for n in (1, 2))
        ratios.append(one / two)
    rows.append(["two threads over one", spread(ratios, 3), 1.95, "", met(statistics.median(ratios), 1.95)])
    table(*rows)


def scenes(folder):
    rows = [["scene", "thousands of samples a CPU second", "pbrt-v4", "times pbrt-v4's", "required", "goal", "required is"]]
    for name, (theirs, spp, required, goal) in OTHERS.items():
        file = SCENES / name / "scene-v4.pbrt"
        if not file.exists():
            print(f"{file} is not here\n")
            continue
        options = ["--spp", spp, "--threads", 1, "--resolution", "320x240", "-o", folder / "o.pfm"]
        lines = [render(file, *options) for _ in range(ROUNDS)]
        rates = [line["samples"] / line["cpu"] * 1e-3 for line in lines]
        ratio = statistics.median(rates) / theirs
        rows.append([name, spread(rates, 0), theirs, f"{ratio:.2f}", required, goal, met(ratio, required)])
    table(*rows)


def rays(_):
    code, out = run("cargo", "run", "--quiet", "--release", "-p", "dapple-geometry", "--example", "beside_embree", "--", "--full")
    print(out if code == 0 else "beside_embree failed\n")
    print("Required of rays over Embree robust: 1.0, the goal is 1.2. Of building: 2.5 and 5; the goals are 3 and 6.\n")


def large(_):
    test = ["-p", "dapple-geometry", "--test", "geometry", "thorough::building_takes_linear_time_and_memory"]
    _, out = run("cargo", "test", "--quiet", "--release", *test, "--", "--ignored", "--nocapture")
    found = re.findall(r"(.+): ([\d.]+) s, twice as many triangles ([\d.]+) s, ([\d.]+) times", out)
    rows = [[name, half, whole, times, 2.3, 2.1, met(2.3 / float(times), 1)] for name, half, whole, times in found]
    table(["field", "s", "s for twice as many triangles", "times", "required", "goal", "required is"], *rows)


def clusters(_):
    run("cargo", "bench", "--quiet", "-p", "dapple-clustering", "--", "default", RAYON_NUM_THREADS="1")
    rows = [["terrain of 1 M triangles", "M triangles a CPU second", "required", "goal", "required is"]]
    for name in ("hills", "crags"):
        estimates = Path(f"target/criterion/{name}/default/new/estimates.json")
        nanoseconds = json.loads(estimates.read_text())["median"]["point_estimate"]
        rate = 2 * 708 * 708 / nanoseconds * 1e3
        rows.append([name, f"{rate:.1f}", *CLUSTERING, met(rate, CLUSTERING[0])])
    table(*rows)


def main():
    parts = {"cornell": cornell, "scenes": scenes, "rays": rays, "large": large, "clusters": clusters}
    chosen = sys.argv[1:] or list(parts)
    if unknown := [name for name in chosen if name not in parts]:
        sys.exit(f"no part is called {unknown[0]}; known: {', '.join(parts)}")
    subprocess.run(["cargo", "build", "--quiet", "--release", "-p", "dapple-cli"], check=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            parts[name](Path(folder))


main()
