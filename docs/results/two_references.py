"""Compares images with two noisy references, whose noise is independent: `mean((x - r1) (x - r2))` of sRGB values from 0 to 1.

    two_references.py R1.pfm R2.pfm A.pfm B.pfm ...

Prints the error of A, and those of the others over it: by pixels, and of means of 4x4 and 8x8 pixels. The third column is the mean
difference from the references: noise of a reference makes its sRGB values darker, and less so in means.
"""

import sys

import numpy

from pfm import read


def srgb(image, side):
    height, width, _ = (length // side * side for length in image.shape)
    image = image[:height, :width].reshape(height // side, side, width // side, side, 3).mean((1, 3)).clip(0, 1)
    return numpy.where(image <= 0.0031308, 12.92 * image, 1.055 * image ** (1 / 2.4) - 0.055)


def main():
    paths = sys.argv[1:]
    images = [read(path) for path in paths]
    for side in (1, 4, 8):
        first, second, *others = (srgb(image, side) for image in images)
        base = None
        for path, image in zip(paths[2:], others):
            errors = [image - reference for reference in (first, second)]
            error = (errors[0] * errors[1]).mean()
            base = base or error
            print(f"{side}x{side} {path}: {error:.3e} {error / base:.3f} {numpy.mean(errors):+.4f}")


main()
