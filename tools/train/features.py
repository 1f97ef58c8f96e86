"""The network's inputs from a film, as in crates/denoise/src/network/exposed_film.rs."""

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
INPUTS = 24


def logarithm(x):
    return np.log1p(8 * x) * 0.5


def features(film):
    """The network's inputs (height x width x 24), the film's mean, the divisors for its albedo, its filtered image, and the exposure."""
    c, v, n, a, m, z, k, f, e = (film[key].astype(np.float32) for key in "cvnamzkfe")
    c, f = np.maximum(c, 0), np.maximum(f, 0)
    grey = f @ LUMINANCE
    level = grey.mean()
    exposure = np.float32(0.18 / np.exp(np.log(np.clip(grey, 1e-3 * level + 1e-12, 50 * level + 1e-9)).mean()))
    c, f = c * exposure, f * exposure
    albedo = np.where(a.max(-1, keepdims=True) < 0.03, 1, np.maximum(a, 0.03)).astype(np.float32)
    is_known = v[..., 0] >= 0
    film_grey, image_grey = c @ LUMINANCE, f @ LUMINANCE
    noise = np.sqrt(np.maximum(v, 0) @ LUMINANCE / np.maximum(n, 1)) * exposure
    error = np.sqrt(np.maximum(e, 0)) * exposure
    share = lambda x: np.log(x / (image_grey + 0.02) + 1e-2) * 0.4
    apart = (film_grey - image_grey) / (image_grey + 0.02)
    depth = np.where(z > 0, np.log(np.maximum(z, 1e-6)), 0)
    middle = np.median(depth[z > 0]) if (z > 0).any() else 0
    depth = np.where(z > 0, np.clip(depth - middle, -3, 3), 3)
    single = (
        logarithm(film_grey),
        apart / (1 + np.abs(apart)),
        np.where(is_known, share(noise), 0),
        is_known,
        np.log2(np.maximum(n, 0.5)) * 0.25,
        depth * 0.5,
        k,
        share(error),
        logarithm(noise),
    )
    colours = (logarithm(np.minimum(c / albedo, 1e4)), logarithm(f / albedo), logarithm(f), a, m)
    inputs = np.concatenate([*colours, *(plane[..., None] for plane in single)], -1)
    return inputs.astype(np.float32), np.minimum(c, 1e4), albedo, f, exposure


def without_features(inputs, film):
    """The inputs without features. `film` is the film's mean colour."""
    inputs = inputs.copy()
    inputs[..., 0:3], inputs[..., 3:6] = logarithm(film), inputs[..., 6:9]
    inputs[..., 9:15], inputs[..., 20], inputs[..., 21] = 0, 1.5, 0
    return inputs
