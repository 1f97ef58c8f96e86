"""Reads PFM images for the scripts of this folder."""

import numpy


def read(path):
    """Rows of RGB pixels, the lowest row first."""
    with open(path, "rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return numpy.frombuffer(file.read(), order).reshape(height, width, 3).astype(float)
