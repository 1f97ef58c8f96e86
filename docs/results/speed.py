#!/usr/bin/env python3
"""speed.py: prints the tables of docs/results/speed.md that compare rates with what is required.

Renders, traces, builds and clusters one after the other; needs an idle machine for some 15 minutes, 14 GiB for the largest trees,
and Embree 3 (Debian's libembree-dev) for the comparison of rays. Scenes of others are looked for in DAPPLE_SCENES (else
../shared/scenes), the peers' Cornell box in DAPPLE_PEERS (else ../shared/peers), a Python with Mitsuba 3 and numpy in
PEERS/venv (PEERS as in the peers' setup.sh). What is not there is left out with a message.
Arguments choose parts: cornell, scenes, rays, clusters, large; all without any.
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
MITSUBA = Path(os.environ.get("PEERS", ".peers")).absolute() / "venv/bin/python"
LLVM = os.environ.get("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM-19.so")
ROUNDS = 5
# M paths a CPU second of Mitsuba's scalar mode on the machine to which the rates of pbrt-v4 are compared.
USUAL = 0.728
# Thousands of samples a CPU second of pbrt-v4, measured once; samples per pixel; the required and the desired ratio.
OTHERS = {
    "cornell-box": (162, 8, 7, 8),
    "teapot": (203, 8, 5, 8),
    "coffee": (115, 4, 8, 8),
    "dining-room": (129, 4, 4, 8),
    "staircase2": (75, 4, 6, 8),
}
# The required and the desired figure: M paths a CPU second, and over Mitsuba's vectorised mode; single rays over Embree robust;
# M triangles built a second by one thread and by two; time for twice the triangles; M triangles clustered a CPU second.
CORNELL, OVER_LLVM, RAYS, BUILDING, LARGE, CLUSTERING = (1.5, 1.8), ("", 1.57), (1, 1.2), [(2.5, 3), (5, 6)], (2.3, 2.1), (15, 30)


class Missing(Exception):
    """A part that cannot be measured, with the reason."""


def run(*command, **more):
    """Runs a command and returns what it prints."""
    done = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, text=True, env={**os.environ, **more})
    if done.returncode:
        raise Missing(f"`{' '.join(str(c) for c in command)}` failed")
    return done.stdout


def render(scene, *options):
    out = run("target/release/dapple", "render", scene, "--sampler", "uniform", "--filter", "none", "--json", *options)
    return json.loads(out.strip().splitlines()[-1])


def spread(numbers, digits):
    low, middle, high = min(numbers), statistics.median(numbers), max(numbers)
    return f"{middle:.{digits}f} ({low:.{digits}f}, {high:.{digits}f})"


def met(value, required):
    return "met" if value >= required else f"missed by {100 * (1 - value / required):.0f} %"


def table(*rows):
    rows = [[str(cell) for cell in row] for row in rows]
    print("\n".join("| " + " | ".join(row) + " |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]]) + "\n", flush=True)


def cells(page):
    """The rows of all tables of a page, without their heads."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line.startswith("|")]
    return [row for row, below in zip(rows, rows[1:] + [[""]]) if not (row[0] + below[0]).count("---")]


def python_of_peers(folder):
    """A Python that has numpy, which the peers' scene needs: Mitsuba's, this one, or one made in the folder."""
    for python in (MITSUBA, sys.executable):
        try:
            run(python, "-c", "import importlib.util, sys; sys.exit(not importlib.util.find_spec('numpy'))")
            return python
        except (Missing, FileNotFoundError):
            pass
    run(sys.executable, "-m", "venv", folder / "venv")
    run(folder / "venv/bin/pip", "install", "-q", "numpy")
    return folder / "venv/bin/python"


def mitsuba(folder, variant):
    """M paths a CPU second of Mitsuba in the same box, with its start and its scene left out."""
    options = ["--variant", variant, "--res", 128, "--spp", 64, "--threads", 1]
    out = run(MITSUBA, PEERS / "mi_run.py", "cornell", folder / "mitsuba.npy", *options, DRJIT_LIBLLVM_PATH=LLVM)
    return 128 * 128 * 64 / json.loads(out.strip().splitlines()[-1])["cpu"] * 1e-6


def cornell(folder):
    if not (PEERS / "peerscenes.py").exists():
        raise Missing(f"{PEERS} is not here, so no Cornell box of the peers")
    run(python_of_peers(folder), PEERS / "peerscenes.py", folder, "cornell")
    box, out = folder / "cornell.pbrt", ["-o", folder / "o.pfm"]
    theirs = {"scalar_rgb": [], "llvm_ad_rgb": []}
    if not MITSUBA.exists():
        print(f"{MITSUBA} is not here, so nothing beside Mitsuba\n")
        theirs = {}
    ours, two_over_one = [], []
    for _ in range(ROUNDS):
        line = render(box, "--resolution", "128x128", "--spp", 64, "--threads", 1, *out)
        ours.append(line["samples"] / line["cpu"] * 1e-6)
        for variant, rates in theirs.items():
            rates.append(mitsuba(folder, variant))
        one, two = (render(box, "--resolution", "256x256", "--spp", 64, "--threads", n, *out)["render_s"] for n in (1, 2))
        two_over_one.append(one / two)
    rate = statistics.median(ours)
    rows = [["work", "median (least, most)", "required", "goal", "required is"]]
    rows.append(["Cornell box of the peers, M paths a CPU second", spread(ours, 3), *CORNELL, met(rate, CORNELL[0])])
    for variant, rates in theirs.items():
        ratio = f"{rate / statistics.median(rates):.2f}"
        rows.append([f"Mitsuba {variant}, M paths a CPU second", spread(rates, 3), "", "", ""])
        rows.append([f"Dapple over Mitsuba {variant}", ratio, *(OVER_LLVM if "llvm" in variant else ("", "")), ""])
    rows.append(["two threads over one", spread(two_over_one, 3), 1.95, "", met(statistics.median(two_over_one), 1.95)])
    table(*rows)


def speed_of_machine(folder):
    """The rate of Mitsuba's scalar mode over its usual one; None without Mitsuba."""
    if not (MITSUBA.exists() and (PEERS / "peerscenes.py").exists()):
        print(f"{MITSUBA} or {PEERS} is not here, so this machine's speed is unknown\n")
        return None
    run(MITSUBA, PEERS / "peerscenes.py", folder, "cornell")
    return statistics.median(mitsuba(folder, "scalar_rgb") for _ in range(ROUNDS)) / USUAL


def scenes(folder):
    speed = speed_of_machine(folder)
    print(f"pbrt-v4 was measured elsewhere; its rates are multiplied by this machine's speed, {speed or 1:.2f}\n")
    rows = [["scene", "thousands of samples a CPU second", "pbrt-v4", "times pbrt-v4's", "required", "goal", "required is"]]
    for name, (theirs, spp, required, goal) in OTHERS.items():
        file = SCENES / name / "scene-v4.pbrt"
        if not file.exists():
            print(f"{file} is not here\n")
            continue
        options = ["--spp", spp, "--threads", 1, "--resolution", "320x240", "-o", folder / "o.pfm"]
        lines = [render(file, *options) for _ in range(ROUNDS)]
        rates = [line["samples"] / line["cpu"] * 1e-3 for line in lines]
        theirs *= speed or 1
        ratio = statistics.median(rates) / theirs
        verdict = met(ratio, required) if speed else "unknown"
        rows.append([name, spread(rates, 0), f"{theirs:.0f}", f"{ratio:.2f}", required, goal, verdict])
    table(*rows)


def rays(_):
    page = run("cargo", "run", "--quiet", "--release", "-p", "dapple-geometry", "--example", "beside_embree", "--", "--full")
    print(page, flush=True)
    traced = [["scene and rays", "over Embree robust", "required", "goal", "required is"]]
    built = [["scene and threads", "M triangles a second", "required", "goal", "required is"]]
    for row in cells(page):
        if len(row) == 8 and row[5] != "–":
            traced.append([f"{row[0]}, {row[1]}", row[5], *RAYS, met(float(row[5]), RAYS[0])])
        elif len(row) == 6 and "36" not in row[0]:
            for threads, cell, figures in zip(("one thread", "two threads"), row[2:4], BUILDING):
                built.append([f"{row[0]}, {threads}", cell, *figures, met(float(cell.split()[0]), figures[0])])
    table(*traced)
    table(*built)


def large(_):
    test = ["-p", "dapple-geometry", "--test", "geometry", "building_takes_linear_time_and_memory"]
    # The test fails where a field takes too long; its lines come all the same.
    command = ["cargo", "test", "--quiet", "--release", *test, "--", "--ignored", "--nocapture"]
    out = subprocess.run(command, stdout=subprocess.PIPE, text=True).stdout
    found = re.findall(r"(.+): ([\d.]+) s, twice as many triangles ([\d.]+) s, ([\d.]+) times", out)
    if not found:
        raise Missing("the test of large fields printed no times")
    rows = [[name, half, whole, times, *LARGE, met(LARGE[0] / float(times), 1)] for name, half, whole, times in found]
    table(["field", "s", "s for twice as many triangles", "times", "required", "goal", "required is"], *rows)


def clusters(_):
    run("cargo", "bench", "--quiet", "-p", "dapple-benches", "--bench", "cluster", "--", "default", RAYON_NUM_THREADS="1")
    rows = [["terrain of 1 M triangles", "M triangles a CPU second", "required", "goal", "required is"]]
    for name in ("hills", "crags"):
        sample = json.loads(Path(f"target/criterion/{name}/default/new/sample.json").read_text())
        seconds = [time / rounds * 1e-9 for time, rounds in zip(sample["times"], sample["iters"])]
        rates = [2 * 708 * 708 / s * 1e-6 for s in seconds]
        rows.append([name, spread(rates, 1), *CLUSTERING, met(statistics.median(rates), CLUSTERING[0])])
    table(*rows)


def main():
    parts = {"cornell": cornell, "scenes": scenes, "rays": rays, "clusters": clusters, "large": large}
    chosen = sys.argv[1:] or list(parts)
    if unknown := [name for name in chosen if name not in parts]:
        sys.exit(f"no part is called {unknown[0]}; known: {', '.join(parts)}")
    run("cargo", "build", "--quiet", "--release", "-p", "dapple-cli")
    missing = []
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            print(f"{name}…", file=sys.stderr, flush=True)
            try:
                parts[name](Path(folder))
            except (Missing, OSError, ValueError) as problem:
                missing.append(name)
                print(f"{name} is left out: {problem}\n", flush=True)
    if missing:
        sys.exit(f"left out: {', '.join(missing)}")

if __name__ == "__main__":
    main()
