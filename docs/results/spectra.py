#!/usr/bin/env python3
"""spectra.py FOLDER IMAGE.SVG: one figure of the spectra that `dapple points --plot FOLDER` writes.

Left and middle: images of one sample per pixel, of dimension 0 (the place in the pixel) and dimension 2 (the lens). Right: 256
points of one pixel. White noise and independent points have a power of 1.
"""
import csv
import sys

COUPLED = ["sobol", "zsobol", "blue-noise", "blue-noise-keys-optimised", "pmj02", "diffused", "mitchell-1991"]
SINGLE = ["sobol", "random", "stratified", "lowdiscrepancy", "halton", "pmj02", "lattice"]
COLOURS = ["#000000", "#0072b2", "#e69f00", "#d55e00", "#009e73", "#cc79a7", "#56b4e9"]
WIDTH, HEIGHT, LEFT, TOP, GAP = 270, 200, 46, 24, 52


def read(folder, name, what, column):
    with open(f"{folder}/{name}-{what}.csv", newline="") as file:
        return [(float(line["frequency"]), float(line[column])) for line in csv.DictReader(file)]


def panel(at, title, axis, curves, names, end, most):
    x0 = LEFT + at * (WIDTH + GAP)
    place = lambda f, p: f"{x0 + WIDTH * f / end:.1f},{TOP + HEIGHT * (1 - min(p, most) / most):.1f}"
    out = [f'<text x="{x0}" y="{TOP - 8}" font-weight="bold">{title}</text>']
    out.append(f'<rect x="{x0}" y="{TOP}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#888"/>')
    for k in range(5):
        f, p = end * k / 4, most * k / 4
        x, y = x0 + WIDTH * k / 4, TOP + HEIGHT * (1 - k / 4)
        out.append(f'<text x="{x:.1f}" y="{TOP + HEIGHT + 14}" text-anchor="middle">{f:g}</text>')
        out.append(f'<text x="{x0 - 5}" y="{y + 4:.1f}" text-anchor="end">{p:g}</text>')
    out.append(f'<text x="{x0 + WIDTH / 2}" y="{TOP + HEIGHT + 29}" text-anchor="middle">{axis}</text>')
    white = place(0, 1).split(","), place(end, 1).split(",")
    out.append(f'<line x1="{white[0][0]}" y1="{white[0][1]}" x2="{white[1][0]}" y2="{white[1][1]}" stroke="#888" stroke-dasharray="4 3"/>')
    for colour, curve in zip(COLOURS, curves):
        points = " ".join(place(f, p) for f, p in curve if f <= end)
        out.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.4"/>')
    for k, name in enumerate(names):
        x, y = x0 + (k % 3) * 106, TOP + HEIGHT + 46 + 14 * (k // 3)
        out.append(f'<line x1="{x}" y1="{y - 4}" x2="{x + 14}" y2="{y - 4}" stroke="{COLOURS[k]}" stroke-width="2"/>')
        out.append(f'<text x="{x + 17}" y="{y}">{name.replace("blue-noise-keys-optimised", "keys=optimised")}</text>')
    return out


def main(folder, path):
    size = LEFT + 3 * (WIDTH + GAP), TOP + HEIGHT + 82
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" font-family="sans-serif" font-size="11">']
    out.append(f'<rect width="{size[0]}" height="{size[1]}" fill="white"/>')
    for at, (dimension, title) in enumerate([(0, "Images, dimension 0 (place)"), (2, "Images, dimension 2 (lens)")]):
        curves = [read(folder, name, "image-spectrum", f"dimension_{dimension}") for name in COUPLED]
        out += panel(at, title, "cycles per pixel", curves, COUPLED, 0.5, 2.0)
    curves = [read(folder, name, "point-spectrum", "power") for name in SINGLE]
    out += panel(2, "256 points of a pixel", "cycles per side of the pixel", curves, SINGLE, 32, 2.0)
    with open(path, "w") as file:
        file.write("\n".join(out + ["</svg>"]) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:3])
