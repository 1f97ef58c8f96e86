"""train.py FOLDER STATE [PIXELS]: trains the network on the films in FOLDER for PIXELS pixels (default 1.2e9); resumes from STATE if it exists.

The loss of a film is the race's: the squared difference in sRGB of means of 4x4 pixels, relative to that of the default's image. Beside it stand
the same of pixels (a tenth), that of the film's averages alone (0.3), the relative difference of means of 16x16 pixels to the unfiltered target,
which keeps the energy. Every sixteenth scene validates.
"""

import math
import queue
import sys
import threading
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

from features import features, without_features
from network import Network

CROP, BATCH, RATE = 128, 8, 2e-3
COLOURS = (0, 3, 6, 9)
# The index of the logarithm of the image's error, whose scale differs between versions of the estimate.
ERROR = 22


def srgb(x):
    x = x.clamp(0, 1)
    return torch.where(x < 0.0031308, 12.92 * x, 1.055 * x.clamp(min=0.0031308) ** (1 / 2.4) - 0.055)


def batched(planes):
    return [torch.from_numpy(np.ascontiguousarray(plane[None].astype(np.float32).transpose(0, 3, 1, 2))) for plane in planes]


def load(path):
    """A scene's films: inputs, mean, albedo, image, target, unfiltered target, error of the image, and samples per pixel."""
    try:
        planes = np.load(path)
    except (ValueError, OSError):
        return []
    target, raw = planes["r.f"], planes["r.c"]
    if not np.isfinite(target).all() or np.median(target) <= 1e-6:
        return []
    films = []
    for spp in (1, 2, 4, 8, 16):
        if f"a{spp}.c" not in planes:
            continue
        inputs, film, albedo, image, exposure = features({key: planes[f"a{spp}.{key}"] for key in "cvnamzkfe"})
        all = (inputs.astype(np.float16), film, albedo, image, target * exposure, np.minimum(raw * exposure, 1e4))
        image, target4 = (F.avg_pool2d(x, 4) for x in batched(all[3:5]))
        error = float(((srgb(image) - srgb(target4)) ** 2).mean())
        if 1e-8 < error < 0.05:
            films.append((*all, error, spp))
    return films


def batch(films, random):
    """Random crops (colours permuted, normals rotated, some without features), the errors of their films, and exposures."""
    crops = [[] for _ in range(6)]
    errors, exposures = [], []
    for _ in range(BATCH):
        film = films[random.integers(len(films))]
        height, width = film[0].shape[:2]
        y, x = random.integers(0, height - CROP + 1), random.integers(0, width - CROP + 1)
        order = random.permutation(3)
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0].astype(np.float32)
        inputs, *rest = (np.asarray(plane[y : y + CROP, x : x + CROP], np.float32) for plane in film[:6])
        rest = [plane[..., order] for plane in rest]
        groups = [inputs[..., first + order] for first in COLOURS]
        inputs[..., ERROR] -= random.uniform(0, 0.4)
        inputs = np.concatenate([*groups, inputs[..., 12:15] @ turn, inputs[..., 15:]], -1)
        if random.random() < 0.06:
            inputs, rest[1] = without_features(inputs, rest[0]), np.ones_like(rest[1])
        for to, plane in zip(crops, (inputs, *rest)):
            to.append(plane.transpose(2, 0, 1))
        errors.append(film[6])
        exposures.append(2 ** random.normal(0, 0.7))
    tensors = [torch.from_numpy(np.ascontiguousarray(np.stack(planes))) for planes in crops]
    return (*tensors, torch.tensor(errors, dtype=torch.float32), torch.tensor(exposures, dtype=torch.float32))


def losses(network, inputs, film, albedo, image, target, raw, error, exposure):
    """The losses of each film: on means of 4x4 pixels, on pixels, of energy, and of the film's blend alone."""
    result, of_film = network(inputs, film, albedo, image)
    exposure = exposure.view(-1, 1, 1, 1)
    mean = lambda x: x.mean((1, 2, 3))
    relative = lambda a, b: mean((srgb(a * exposure) - srgb(b * exposure)) ** 2) / error
    result4, target4 = F.avg_pool2d(result, 4), F.avg_pool2d(target, 4)
    raw16 = F.avg_pool2d(raw, 16)
    apart = (F.avg_pool2d(result4, 4) - raw16) / (raw16 + 0.05 * raw16.mean((1, 2, 3), keepdim=True) + 1e-3)
    energy = mean(F.huber_loss(apart, torch.zeros_like(apart), delta=0.1, reduction="none") * 2)
    return relative(result4, target4), relative(result, target), energy, relative(F.avg_pool2d(of_film, 4), target4)


def validate(network, films):
    """The geometric mean of the error relative to the default's image, and the energy lost, by samples per pixel."""
    found = {}
    with torch.no_grad():
        for film in films:
            height, width = (n // 16 * 16 for n in film[0].shape[:2])
            planes = batched(plane[:height, :width] for plane in film[:6])
            of4, _, energy, _ = losses(network, *planes, torch.tensor([film[6]]), torch.ones(1))
            found.setdefault(film[7], []).append((float(of4.log()), float(energy)))
    means = {spp: np.mean(all, 0) for spp, all in sorted(found.items())}
    return "  ".join(f"{spp} spp {np.exp(error):.3f} {energy:.4f}" for spp, (error, energy) in means.items())


def main(folder, state, pixels=1.2e9):
    torch.set_num_threads(2)
    paths = sorted(Path(folder).glob("*.npz"), key=lambda path: int(path.stem))
    check = [film for path in paths[::16] for film in load(path)]
    films = [film for k, path in enumerate(paths) if k % 16 for film in load(path)]
    print(f"{len(films)} films, {len(check)} to validate", flush=True)
    network = Network().to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, betas=(0.9, 0.99), weight_decay=1e-4)
    average = {key: value.clone() for key, value in network.state_dict().items()}
    step = 0
    if Path(state).exists():
        saved = torch.load(state)
        network.load_state_dict(saved["network"])
        optimizer.load_state_dict(saved["optimizer"])
        average, step = saved["average"], saved["step"]
    steps = int(float(pixels) / (BATCH * CROP * CROP))
    batches = queue.Queue(6)

    def feed():
        random = np.random.default_rng(step)
        while True:
            batches.put(batch(films, random))

    def save():
        current = {key: value.clone() for key, value in network.state_dict().items()}
        network.load_state_dict(average)
        print(f"{step * BATCH * CROP * CROP / 1e9:.3f} of {float(pixels) / 1e9:.3f} G pixels: {validate(network, check)}", flush=True)
        network.load_state_dict(current)
        torch.save(dict(network=current, optimizer=optimizer.state_dict(), average=average, step=step), state)

    threading.Thread(target=feed, daemon=True).start()
    last = time.time()
    while step < steps:
        for group in optimizer.param_groups:
            group["lr"] = RATE * min(1, (step + 1) / 200) * max(0.5 * (1 + math.cos(math.pi * step / steps)), 0.01)
        of4, of1, energy, of_film = losses(network, *batches.get())
        # Single crops with large errors count less.
        bounded = lambda x: 8 * torch.log1p(x / 8)
        loss = (bounded(of4) + 0.3 * bounded(of_film) + 0.1 * bounded(of1) + energy).mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        step += 1
        with torch.no_grad():
            for key, value in network.state_dict().items():
                average[key].lerp_(value, max(0.003, 1 / (step + 1)))
        if time.time() - last > 180:
            save()
            last = time.time()
    save()


if __name__ == "__main__":
    main(*sys.argv[1:])
