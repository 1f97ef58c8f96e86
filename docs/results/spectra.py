#!/usr/bin/env python3
"""spectra.py IMAGE.SVG: one figure of the power spectra of point sets, and two numbers of each, from `dapple points NAME --csv N`.

Left and middle: images of one sample per pixel, of dimension 0 (the place in the pixel) and dimension 2 (the lens). Right: 256
points of one pixel. White noise and independent points have a power of 1. Prints for each set the mean power of dimension 2 below 1/8
cycle per pixel, and the L2 star discrepancy of 256 points, the mean of 16 pixels; independent points have 0.0233. Needs numpy, and the
program target/release/dapple (DAPPLE names another).
"""
import os
import subprocess
import sys

import numpy as np

COUPLED = ["sobol", "zsobol", "blue-noise", "blue-noise:keys=optimised", "pmj02", "diffused", "mitchell-1991"]
SINGLE = ["sobol", "random", "stratified", "lowdiscrepancy", "halton", "pmj02", "lattice"]
COLOURS = ["#000000", "#0072b2", "#e69f00", "#d55e00", "#009e73", "#cc79a7", "#56b4e9"]
WIDTH, HEIGHT, LEFT, TOP, GAP = 270, 200, 46, 24, 52


COUNT, SIDE = 256, 128


def points(name, count, size):
    """The points of an image from `dapple points`: an array of rows, columns, samples and dimensions."""
    command = [os.environ.get("DAPPLE", "target/release/dapple"), "points", name, "--csv", str(count), "--pixels", f"{size}x{size}"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    table = np.loadtxt(text.splitlines()[1:], delimiter=",")
    return table[:, 3:].reshape(size, size, count, 8)


def rings(frequency, power):
    """The mean power in rings one frequency wide."""
    ring = np.rint(frequency).astype(int)
    return [(k, float(power[ring == k].mean())) for k in range(1, ring.max() + 1) if (ring == k).any()]


def image_spectrum(name, dimension):
    """The radial power spectrum of a dimension, over an image of one sample per pixel; frequencies in cycles per pixel."""
    values = points(name, 1, SIDE)[:, :, 0, dimension]
    power = np.abs(np.fft.fft2(values - values.mean())) ** 2 / values.size / values.var()
    along = np.fft.fftfreq(SIDE) * SIDE
    found = rings(np.hypot(*np.meshgrid(along, along)), power)
    return [(k / SIDE, p) for k, p in found if k <= SIDE // 2]


def point_spectrum(places, end=32):
    """The radial power spectrum of points in the unit square, up to `end` cycles per side."""
    k = np.arange(-end, end + 1)
    x, y = (np.exp(-2j * np.pi * np.outer(k, places[:, axis])) for axis in (0, 1))
    power = np.abs(x @ y.T) ** 2 / len(places)
    return [(f, p) for f, p in rings(np.hypot(*np.meshgrid(k, k)), power) if f <= end]


def l2_star_discrepancy(places):
    """The root mean square error of boxes [0, x) x [0, y) (after Warnock 1972)."""
    n, rest = len(places), 1 - places
    pairs = np.minimum(rest[:, None, 0], rest[None, :, 0]) * np.minimum(rest[:, None, 1], rest[None, :, 1])
    return float(np.sqrt(1 / 9 - np.prod(1 - places**2, axis=1).sum() / (2 * n) + pairs.sum() / n**2))


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
        out.append(f'<text x="{x + 17}" y="{y}">{name.replace("blue-noise:keys=optimised", "keys=optimised")}</text>')
    return out


def main(path):
    size = LEFT + 3 * (WIDTH + GAP), TOP + HEIGHT + 82
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" font-family="sans-serif" font-size="11">']
    out.append(f'<rect width="{size[0]}" height="{size[1]}" fill="white"/>')
    for at, (dimension, title) in enumerate([(0, "Images, dimension 0 (place)"), (2, "Images, dimension 2 (lens)")]):
        curves = [image_spectrum(name, dimension) for name in COUPLED]
        out += panel(at, title, "cycles per pixel", curves, COUPLED, 0.5, 2.0)
    pixels = {name: points(name, COUNT, 4).reshape(16, COUNT, 8)[:, :, :2] for name in dict.fromkeys(COUPLED + SINGLE)}
    spectra = {name: [point_spectrum(places) for places in pixels[name]] for name in SINGLE}
    curves = [[(ring[0][0], np.mean([p for _, p in ring])) for ring in zip(*spectra[name])] for name in SINGLE]
    out += panel(2, "256 points of a pixel", "cycles per side of the pixel", curves, SINGLE, 32, 2.0)
    for name, places in pixels.items():
        low = np.mean([power for frequency, power in image_spectrum(name, 2) if frequency < 0.125])
        print(f"{name:<28}{low:>8.3f}{np.mean([l2_star_discrepancy(p) for p in places]):>9.4f}")
    with open(path, "w") as file:
        file.write("\n".join(out + ["</svg>"]) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
