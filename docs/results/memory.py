#!/usr/bin/env python3
"""memory.py: prints the table of docs/results/memory.md: memory taken, a pixel's share of it, and the estimate over it.

Renders the bundled Cornell box with target/release/dapple (or DAPPLE), in a folder of its own; some four minutes.
"""
import os
import re
import subprocess
import tempfile
from pathlib import Path

DAPPLE = os.environ.get("DAPPLE") or Path(__file__).parents[2] / "target/release/dapple"
ROWS = """1024x1024 --filter none --sampler uniform --spp 1 -o a.pfm
2048x2048 --filter none --sampler uniform --spp 1 -o a.pfm
2048x2048 --filter none --sampler uniform --spp 2 -o a.exr
1024x1024 --filter none --spp 8 -o a.pfm
1024x1024 --filter none --spp 8 --sampler adaptive:policy=discard -o a.pfm
1024x1024 --filter none --spp 8 --sampler adaptive:policy=cross -o a.pfm
1024x1024 --filter none --spp 8 --sampler mitchell -o a.pfm
1024x1024 --filter none --spp 8 --sampler cluster-thesis -o a.pfm
1024x1024 --spp 2 --filter gaussian -o a.exr
1024x1024 --spp 2 --filter nlm -o a.exr
1024x1024 --spp 2 -o a.exr
1280x720 --spp 8 -o a.exr
1280x720 --spp 8 --maps maps -o a.exr
2560x1440 --spp 2 -o a.exr
3840x2160 --spp 1 -o a.exr
3840x2160 --spp 2 -o a.exr"""


def main():
    print("| `dapple render cornell --resolution` … | taken, MiB | bytes a pixel | expected / taken |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for row in ROWS.splitlines():
            command = [DAPPLE, "render", "cornell", "--resolution", *row.split()]
            said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
            taken, expected = (float(n) for n in re.search(r"memory: (\S+) MiB taken, (\S+) MiB", said).groups())
            width, height = map(int, row.split()[0].split("x"))
            print(f"| `{row}` | {taken:.0f} | {taken * 2**20 / width / height:.0f} | {expected / taken:.2f} |", flush=True)

if __name__ == "__main__":
    main()
