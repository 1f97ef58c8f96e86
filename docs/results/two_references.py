"""Compares images with two noisy references, whose noise is independent: `mean((x - r1) (x - r2))` of sRGB values from 0 to 1.

    two_references.py R1.pfm R2.pfm A.pfm B.pfm ...

Prints the error of A, and those of the others over it: by pixels, and of means of 4x4 and 8x8 pixels. The third column is the mean
difference from the references: noise of a reference makes its sRGB values darker, and less so in means.
"""

import sys

import numpy


def read(path):
    with open(path, "rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return numpy.frombuffer(file.read(), order).reshape(height, width, 3).astype(float)


def srgb(image, side):
    height, width, _ = (length // side * side for length in image.shape)
    image = image[:height, :width].reshape(height // side, side, width // side, side, 3).mean((1, 3)).clip(0, 1)
    return numpy.where(image <= 0.0031308, 12.92 * image, 1.055 * image ** (1 / 2.4) - 0.055)


def main():
    first, second, *paths = sys.argv[1:]
    for side in (1, 4, 8):
        references = [srgb(read(path), side) for path in (first, second)]
        base = None
        for path in paths:
            errors = [srgb(read(path), side) - reference for reference in references]
            error = (errors[0] * errors[1]).mean()
            base = base or error
            print(f"{side}x{side} {path}: {error:.3e} {error / base:.3f} {numpy.mean(errors):+.4f}")


main()
