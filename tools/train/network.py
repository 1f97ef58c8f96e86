"""The network, as in crates/denoise/src/network.rs: a U-Net of isotropic convolutions, whose features weight averages over pixels."""

import ctypes
import subprocess
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import nn

from features import INPUTS

CHANNELS = (16, 32, 48, 64)
DISTANCES = (2, 8, 32, 16, 4, 1)
FEATURES = 8
LEVELS = len(DISTANCES) + 1
# Outputs for the blend: weights of the film's averages (alternately over albedo and with it), of the image's averages and of the image; and the image's fraction.
BLEND = 3 * LEVELS + 2
# The kind of each of the 3x3 weights: centre, edge or corner.
PLACES = torch.tensor([2, 1, 2, 1, 0, 1, 2, 1, 2])


def library():
    """The averages in C++, compiled beside this file on first use."""
    source = Path(__file__).with_name("gather.cpp")
    built = source.with_suffix(".so")
    if not built.exists() or built.stat().st_mtime < source.stat().st_mtime:
        subprocess.run(["g++", "-O3", "-march=native", "-ffast-math", "-fopenmp", "-shared", "-fPIC", source, "-o", built], check=True)
    return ctypes.CDLL(str(built))


LIBRARY = library()


def call(function, tensors, numbers):
    function(*(ctypes.c_void_p(t.data_ptr()) for t in tensors), *(ctypes.c_int(n) for n in numbers))


class Gather(torch.autograd.Function):
    """Sums over the eight pixels at a distance, weighted by the similarity of their features, and over the pixel itself."""

    @staticmethod
    def forward(context, values, features, own, distance):
        values, features, own = values.contiguous(), features.contiguous(), own.contiguous()
        sums = torch.empty_like(values)
        b, n, h, w = values.shape
        call(LIBRARY.forward, (values, features, own, sums), (b, n, features.shape[1], h, w, distance))
        context.save_for_backward(values, features, own)
        context.distance = distance
        return sums

    @staticmethod
    def backward(context, gradient):
        inputs = context.saved_tensors
        values, features, _ = inputs
        outputs = [torch.empty_like(t) for t in inputs]
        b, n, h, w = values.shape
        call(LIBRARY.backward, (*inputs, gradient.contiguous(), *outputs), (b, n, features.shape[1], h, w, context.distance))
        return (*outputs, None)


class Isotropic(nn.Module):
    """A convolution of 3x3 pixels with weights for the centre, the edges and the corners."""

    def __init__(self, inputs, outputs):
        super().__init__()
        self.w = nn.Parameter(torch.randn(outputs, inputs, 3) * (2 / (inputs * 9)) ** 0.5)
        self.b = nn.Parameter(torch.zeros(outputs))

    def forward(self, x):
        weights = self.w[:, :, PLACES].reshape(*self.w.shape[:2], 3, 3).contiguous(memory_format=torch.channels_last)
        return F.conv2d(x, weights, self.b, padding=1)


def pointwise(inputs, outputs, gain=1.0):
    layer = nn.Conv2d(inputs, outputs, 1)
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    layer.weight.data *= gain
    nn.init.zeros_(layer.bias)
    return layer


class Trunk(nn.Module):
    """The features of each pixel."""

    def __init__(self, outputs):
        super().__init__()
        c = CHANNELS
        pair = lambda inputs, outputs: nn.ModuleList([Isotropic(inputs, outputs), Isotropic(outputs, outputs)])
        self.i, self.i2 = pointwise(INPUTS, c[0]), Isotropic(c[0], c[0])
        self.d = nn.ModuleList([pair(c[k - 1], c[k]) for k in range(1, len(c))])
        self.u = nn.ModuleList([pair(c[k + 1] + c[k], c[k]) for k in range(len(c) - 1)])
        self.h = pointwise(c[0], outputs, 0.3)

    def forward(self, x):
        both = lambda pair, x: F.relu(pair[1](F.relu(pair[0](x))))
        levels = [F.relu(self.i2(F.relu(self.i(x))))]
        for pair in self.d:
            levels.append(both(pair, F.avg_pool2d(levels[-1], 2)))
        x = levels.pop()
        for pair in reversed(self.u):
            x = both(pair, torch.cat([F.interpolate(x, scale_factor=2, mode="nearest"), levels.pop()], 1))
        return self.h(x)


@torch.compile
def weighted(values, logs):
    """Values times the trust in the film or in the image, both trusts, and the weight of the pixel itself."""
    trust, own = torch.exp(logs[:, :2].clamp(-8, 6)), torch.exp(logs[:, 2:3].clamp(-6, 6))
    return torch.cat([values[:, :6] * trust[:, :1], trust[:, :1], values[:, 6:] * trust[:, 1:2], trust[:, 1:2]], 1), own


@torch.compile
def divided(sums):
    return torch.cat([sums[:, :6] / sums[:, 6:7], sums[:, 7:10] / sums[:, 10:11]], 1)


@torch.compile
def blended(logs, image, albedo, *levels):
    """The result, and the blend of the film's averages alone."""
    film = torch.softmax(logs[:, : 2 * LEVELS], 1)
    own = torch.softmax(logs[:, 2 * LEVELS : 3 * LEVELS + 1], 1)
    share = 0.02 + 0.96 * torch.sigmoid(logs[:, 3 * LEVELS + 1 :])
    of_film, of_image = 0, own[:, LEVELS:] * image
    for k, values in enumerate(levels):
        of_film = of_film + film[:, 2 * k : 2 * k + 1] * values[:, :3] * albedo + film[:, 2 * k + 1 : 2 * k + 2] * values[:, 3:6]
        of_image = of_image + own[:, k : k + 1] * values[:, 6:] * albedo
    return share * of_image + (1 - share) * of_film, of_film


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        self.t = Trunk(len(DISTANCES) * (FEATURES + 3) + BLEND)
        bias = self.t.h.bias.data[-BLEND:]
        bias[-1], bias[-2], bias[:2], bias[8:12] = 1.0, 2.0, -3.0, 1.0

    def forward(self, inputs, film, albedo, image):
        """The image, and the blend of the film's averages alone."""
        with torch.autocast("cpu", torch.bfloat16):
            outputs = self.t(inputs.to(memory_format=torch.channels_last))
        outputs = outputs.to(torch.float, memory_format=torch.contiguous_format)
        parts = outputs.split([FEATURES, 3] * len(DISTANCES) + [BLEND], 1)
        levels = [torch.cat([film / albedo, film, image / albedo], 1)]
        for k, distance in enumerate(DISTANCES):
            values, own = weighted(levels[-1], parts[2 * k + 1])
            levels.append(divided(Gather.apply(values, parts[2 * k], own, distance)))
        return blended(parts[-1], image, albedo, *levels)
