"""export.py STATE OUT: writes the trained weights with 16 bits each (the upper half of a float), layer by layer: for each output, the weights and the bias."""

import hashlib
import sys
from pathlib import Path

import torch

from network import CHANNELS

state, out = sys.argv[1:]
weights = torch.load(state)["average"]
parts = []


def put(name, kind):
    values, biases = (weights[f"t.{name}.{key}"] for key in kind)
    rows = torch.cat([values.reshape(values.shape[0], -1), biases[:, None]], 1)
    parts.append(rows.to(torch.bfloat16).view(torch.int16).numpy().astype("<i2").tobytes())


pointwise, isotropic = ("weight", "bias"), ("w", "b")
put("i", pointwise)
put("i2", isotropic)
for part, levels in (("d", range(len(CHANNELS) - 1)), ("u", reversed(range(len(CHANNELS) - 1)))):
    for level in levels:
        put(f"{part}.{level}.0", isotropic)
        put(f"{part}.{level}.1", isotropic)
put("h", pointwise)
data = b"".join(parts)
Path(out).write_bytes(data)
print(len(data), "bytes, SHA-256", hashlib.sha256(data).hexdigest())
