"""scenes.py SEED FOLDER: a random scene as pbrt-v4 text, FOLDER/s.pbrt, with its textures and sky.

Rooms with lamps, rooms with an opening to a sky, fields below a sky, and objects on a floor below lamps. Surfaces are matte, coated, metal, glass
or thin; textures and skies are formulas. Seeds from 3000 on give plain scenes: few large objects, few textures, narrow views.
Seeds from 4000 on give plain scenes with calm light (large lamps, fewer textures) and a wide pixel filter.
"""

import os
import sys

import numpy as np
import OpenEXR
from PIL import Image

# The pixel filters of scenes with a wide pixel filter.
WIDE = [
    'PixelFilter "triangle" "float xradius" 1 "float yradius" 1',
    'PixelFilter "gaussian" "float xradius" 1.5 "float yradius" 1.5',
    'PixelFilter "box"',
]


def noise(r, n, oct=5, rough=0.5):
    """Periodic noise of n x n pixels, from 0 to 1."""
    y = np.zeros((n, n))
    for o in range(oct):
        k = 2 ** (o + 1)
        g = r.random((k + 1, k + 1))
        g[-1] = g[0]
        g[:, -1] = g[:, 0]
        t = np.linspace(0, k, n, endpoint=False)
        i = t.astype(int)
        f = t - i
        f = f * f * (3 - 2 * f)
        a = (
            g[i][:, i] * (1 - f)[:, None] * (1 - f)
            + g[i + 1][:, i] * f[:, None] * (1 - f)
            + g[i][:, i + 1] * (1 - f)[:, None] * f
            + g[i + 1][:, i + 1] * f[:, None] * f
        )
        y += a * rough**o
    return (y - y.min()) / (np.ptp(y) + 1e-9)


def col(r, lo=0.05, hi=0.9):
    """A random colour."""
    v = r.uniform(lo, hi)
    s = r.beta(1.2, 2.5)
    h = r.random() * 6
    c = np.clip([abs(h - 3) - 1, 2 - abs(h - 2), 2 - abs(h - 4)], 0, 1)
    return np.clip(v * (1 - s + s * np.array(c)), 0.01, 0.95)


def texture(r, path):
    """Writes a texture: clouds, squares, stripes, tiles, a poster, lines of writing, or wood."""
    n = 256
    k = r.integers(7)
    a, b, c = col(r), col(r), col(r)
    u, v = np.meshgrid(np.arange(n) / n, np.arange(n) / n)
    if k == 0:
        m = noise(r, n, 6, r.uniform(0.4, 0.8))
        im = a * m[..., None] + b * (1 - m[..., None])
    elif k == 1:
        q = r.integers(2, 40)
        m = ((u * q).astype(int) + (v * q).astype(int)) % 2
        im = np.where(m[..., None], a, b)
    elif k == 2:
        q = r.integers(3, 60)
        w = r.uniform(0.2, 0.8)
        m = ((u * q + r.choice([0, 1]) * 0.3 * noise(r, n)) % 1) < w
        im = np.where(m[..., None], a, b)
    elif k == 3:  # tiles with joints
        q = r.integers(2, 16)
        g = r.uniform(0.03, 0.12)
        off = (v * q).astype(int) % 2 * 0.5 * r.integers(2)
        m = (((u * q + off) % 1) < g) | (((v * q) % 1) < g)
        t = r.random((q + 1, q + 1))[(v * q).astype(int), (u * q + off).astype(int) % (q + 1)][..., None]
        im = np.where(m[..., None], b, a * (0.6 + 0.4 * t))
    elif k == 4:  # a poster of rectangles and discs
        im = np.ones((n, n, 3)) * a
        for _ in range(r.integers(5, 60)):
            x, y, s, t = r.random(4)
            s, t = s * 0.4, t * 0.4
            q = col(r)
            m = ((u - x) ** 2 + (v - y) ** 2 < s * s * 0.3) if r.random() < 0.4 else (abs(u - x) < s) & (abs(v - y) < t * 0.5)
            im = np.where(m[..., None], q, im)
    elif k == 5:  # lines of writing
        im = np.ones((n, n, 3)) * 0.85
        q = 24
        for i in range(2, q - 2):
            x = 0.08
            while x < 0.9:
                w = r.uniform(0.01, 0.08)
                m = (abs(v * q - i - 0.4) < 0.22) & (u > x) & (u < x + w) & (r.random((n, n)) < 0.7)
                im[m] = b * 0.3
                x += w + 0.02
    else:  # wood
        q = r.uniform(4, 30)
        m = np.sin((u + 0.15 * noise(r, n, 4)) * q * 6.28 + 3 * noise(r, n, 3)) * 0.5 + 0.5
        im = a * m[..., None] + a * 0.5 * (1 - m[..., None])
    Image.fromarray((np.clip(im, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)).save(path)


class Scene:
    """A scene under construction, statement by statement; `s.r` is the random number generator, `s.o` the lines."""

    def __init__(s, seed, dir):
        s.plain = seed >= 3000
        s.calm = seed >= 4000
        s.r = np.random.default_rng(seed)
        s.dir = dir
        s.o = []
        s.t = 0
        os.makedirs(dir, exist_ok=True)

    def w(s, *a):
        """Adds a line."""
        s.o.append(" ".join(str(x) for x in a))

    def v(s, a):
        """Formats numbers in brackets."""
        return "[ " + " ".join("%.5g" % x for x in np.ravel(a)) + " ]"

    def material(s, kinds=None):
        """Sets a random material; `kinds` are the probabilities of its kinds."""
        r = s.r
        k = r.choice(["diffuse", "coat", "metal", "glass", "trans"], p=kinds or [0.55, 0.2, 0.15, 0.07, 0.03])
        refl = f'"rgb reflectance" {s.v(col(r))}'
        if k in ("diffuse", "coat") and r.random() < (0.1 if s.calm else 0.2 if s.plain else 0.5):
            s.t += 1
            p = f"t{s.t}.png"
            texture(r, f"{s.dir}/{p}")
            q = r.choice([1, 1, 2, 4, 8])
            s.w(f'Texture "t{s.t}" "spectrum" "imagemap" "string filename" "{p}" "float uscale" {q} "float vscale" {q}')
            refl = f'"texture reflectance" "t{s.t}"'
        ro = r.choice([0.02, 0.1, 0.2, 0.4]) * r.uniform(0.5, 1.5) if r.random() < 0.8 else 0
        if k == "diffuse":
            s.w(f'Material "diffuse" {refl}')
        elif k == "coat":
            s.w(f'Material "coateddiffuse" {refl} "float roughness" {ro:.4g}')
        elif k == "metal":
            s.w(f'Material "conductor" "rgb reflectance" {s.v(col(r, .4, .95))} "float roughness" {ro:.4g}')
        elif k == "glass":
            s.w(f'Material "dielectric" "float eta" {r.uniform(1.2, 1.7):.3g} "float roughness" {ro * (r.random() < .25):.4g}')
        else:
            s.w(f'Material "diffusetransmission" "rgb reflectance" {s.v(col(r) * .5)} "rgb transmittance" {s.v(col(r) * .5)}')

    def mesh(s, P, I, N=None, uv=None):
        """Adds triangles."""
        s.w(
            'Shape "trianglemesh" "integer indices" [',
            " ".join(map(str, np.ravel(I))),
            '] "point3 P"',
            s.v(P),
            *(['"normal N"', s.v(N)] if N is not None else []),
            *(['"point2 uv"', s.v(uv)] if uv is not None else []),
        )

    def quad(s, a, b, c, d, q=1):
        """Adds a square whose texture repeats q times."""
        s.mesh([a, b, c, d], [0, 1, 2, 0, 2, 3], uv=[[0, 0], [q, 0], [q, q], [0, q]])

    def box(s, c, h, ang=0):
        """Adds a box: centre, half of the size, and rotation about the vertical axis."""
        c, h = np.array(c), np.array(h)
        ca, sa = np.cos(ang), np.sin(ang)
        R = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
        for ax in range(3):
            for sg in (-1, 1):
                u, v = np.eye(3)[(ax + 1) % 3], np.eye(3)[(ax + 2) % 3]
                n = np.eye(3)[ax] * sg
                u = u * sg
                s.quad(*[c + R @ (h * (n + i * u + j * v)) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])

    def grid(s, f, nu, nv):
        """Adds the surface f(u, v) with smooth normals."""
        u, v = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1))
        P = f(u, v)
        k = np.arange((nu + 1) * (nv + 1)).reshape(nv + 1, nu + 1)
        I = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[:-1, :-1], k[1:, 1:], k[1:, :-1]], -1)
        du = np.gradient(P, axis=1)
        dv = np.gradient(P, axis=0)
        N = np.cross(du, dv)
        L = np.linalg.norm(N, axis=-1, keepdims=True)
        N = np.where(L > 1e-12, N / np.maximum(L, 1e-12), [0, 0, 1])
        s.mesh(P, I, N, np.stack([u, v], -1))

    def vase(s, c, h):
        """Adds a body of revolution."""
        r = s.r
        k = r.random(6) * 0.6 + 0.15
        n = 32

        def f(u, v):
            rad = h * 0.6 * np.interp(v, np.linspace(0, 1, 6), k)
            a = -u * 2 * np.pi
            return np.stack([c[0] + rad * np.cos(a), c[1] + rad * np.sin(a), c[2] + h * v], -1)

        s.grid(f, 40, n)

    def blob(s, c, h):
        """Adds a bumpy ball."""
        r = s.r
        A = r.normal(size=(4, 3)) * 2.5
        ph = r.random(4) * 6
        am = r.uniform(0.0, 0.12, 4)

        def f(u, v):
            a, b = -u * 2 * np.pi, v * np.pi
            d = np.stack([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), -np.cos(b)], -1)
            q = 1 + sum(m * np.sin(d @ w * 1.7 + p) for m, w, p in zip(am, A, ph))
            return np.array(c) + h * d * q[..., None]

        s.grid(f, 40, 24)

    def blades(s, c, h, n):
        """Adds a tuft of n blades of grass."""
        r = s.r
        P = []
        I = []
        for i in range(n):
            b = np.array(c) + np.append(r.normal(size=2) * h * 0.4, 0)
            t = np.append(r.normal(size=2) * 0.5, 1) * h * r.uniform(0.4, 1.2)
            q = np.append(r.normal(size=2), 0)
            q *= h * 0.025 / np.linalg.norm(q)
            P += [b - q, b + q, b + t]
            I += [3 * i, 3 * i + 1, 3 * i + 2]
        s.mesh(P, I)

    def thing(s, x, y, z, h):
        """Adds a random object of size h standing at a point; few objects move."""
        r = s.r
        s.w("AttributeBegin")
        s.material()
        k = r.integers(9)
        a = r.random() * 6.28
        if r.random() < 0.015:
            s.w("ActiveTransform EndTime")
            s.w("Translate", *("%.4g" % q for q in r.normal(size=3) * h * [0.5, 0.5, 0.1]))
            s.w("ActiveTransform All")
        if k == 0:
            s.w(f"Translate {x:.4g} {y:.4g} {z + h:.4g}")
            s.w(f'Shape "sphere" "float radius" {h:.4g}')
        elif k in (1, 2):
            q = r.uniform(0.3, 1, 3) * h
            s.box((x, y, z + q[2]), q, a)
        elif k == 3:
            s.vase((x, y, z), 2 * h)
        elif k == 4:
            s.blob((x, y, z + h), h)
        elif k == 5:
            s.blades((x, y, z), 2 * h, int(r.integers(20, 300)))
        elif k == 6:  # a row of books or slats
            n = r.integers(4, 20)
            t = h * 2 / n
            for i in range(n):
                if r.random() < 0.3:
                    s.material([1, 0, 0, 0, 0])
                q = h * r.uniform(0.6, 1)
                s.box((x + (i - n / 2) * t * np.cos(a), y + (i - n / 2) * t * np.sin(a), z + q), (t * r.uniform(0.2, 0.49), h * 0.4, q), a)
        elif k == 7:  # a table
            t = h * 0.08
            s.box((x, y, z + h), (h, h * 0.7, t), a)
            ca, sa = np.cos(a), np.sin(a)
            for i in (-1, 1):
                for j in (-1, 1):
                    dx, dy = i * h * 0.85, j * h * 0.55
                    s.box((x + ca * dx - sa * dy, y + sa * dx + ca * dy, z + h * 0.5), (t, t, h * 0.5), a)
            for _ in range(r.integers(0, 4)):
                s.w("AttributeEnd")
                s.thing(x + r.uniform(-0.5, 0.5) * h, y + r.uniform(-0.4, 0.4) * h, z + h + t, h * r.uniform(0.1, 0.3))
                s.w("AttributeBegin")
        else:  # cloth
            p = r.random(4) * 6
            s.grid(
                lambda u, v: np.stack(
                    [
                        x + (u - 0.5) * 2 * h,
                        y + (v - 0.5) * 2 * h,
                        z + h * 0.5 + h * 0.2 * (np.sin(u * 7 + p[0]) * np.sin(v * 6 + p[1]) + 0.5 * np.sin(u * 17 + v * 13 + p[2])),
                    ],
                    -1,
                ),
                30,
                30,
            )
        s.w("AttributeEnd")

    def lamp(s, c, n, size, power):
        """Adds a light of this power around c: a rectangle facing n, or a sphere."""
        n = np.array(n, float)
        n /= np.linalg.norm(n)
        t = np.cross(n, [1, 0, 0] if abs(n[0]) < 0.8 else [0, 1, 0])
        t /= np.linalg.norm(t)
        b = np.cross(n, t)
        c = np.array(c)
        asp = s.r.uniform(0.3, 1)
        e = power / (np.pi * 4 * size * size * asp)
        w = s.r.uniform(0.7, 1, 3)
        w /= w.max()
        s.w("AttributeBegin")
        s.w('Material "diffuse" "rgb reflectance" [ 0 0 0 ]')
        s.w(f'AreaLightSource "diffuse" "rgb L" {s.v(e * w)}')
        k = s.r.random()
        if k < 0.25:
            s.w(f"Translate {c[0]:.4g} {c[1]:.4g} {c[2]:.4g}")
            s.w(f'Shape "sphere" "float radius" {size * .6:.4g}')
        else:
            s.quad(
                c - t * size - b * size * asp, c + t * size - b * size * asp, c + t * size + b * size * asp, c - t * size + b * size * asp
            )
        s.w("AttributeEnd")

    def sky(s, scale):
        """Adds an environment map: a gradient, up to two suns, and clouds."""
        r = s.r
        n = 128
        p = f"{s.dir}/sky.exr"
        y, x = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, (np.arange(n) + 0.5) / n * 2 - 1, indexing="ij")  # equal-area octahedral map
        u, v = x, y
        d = 1 - (abs(u) + abs(v))
        rr = 1 - abs(d)
        ph = np.where(rr == 0, 0, ((abs(v) - abs(u)) / np.maximum(rr, 1e-9) + 1) * np.pi / 4)
        z = np.sign(d) * (1 - rr * rr)
        f = rr * np.sqrt(2 - rr * rr)
        D = np.stack([np.copysign(np.cos(ph), u) * f, np.copysign(np.sin(ph), v) * f, z], -1)
        a, b, g = col(r, 0.3, 1), col(r, 0.5, 1), col(r, 0.05, 0.4)
        h = np.clip(D[..., 2:], 0, 1) ** 0.5
        im = np.where(D[..., 2:] > 0, a * h + b * (1 - h), g)
        for _ in range(r.integers(0, 3)):
            sd = r.normal(size=3)
            sd[2] = abs(sd[2]) * 0.7 + 0.1
            sd /= np.linalg.norm(sd)
            k = 10 ** r.uniform(0.5, 3.3)
            im = im + col(r, 0.7, 1) * np.exp(k * (D @ sd - 1))[..., None] * k * r.uniform(0.1, 0.6)
        if r.random() < 0.5:
            im = im * (0.5 + noise(r, n)[..., None])
        with OpenEXR.File(
            {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": np.ascontiguousarray(im * scale, np.float32)}
        ) as f:
            f.write(p)
        s.w("AttributeBegin")
        s.w('LightSource "infinite" "string filename" "sky.exr"')
        s.w("AttributeEnd")

    def make(s):
        """Writes the whole scene."""
        r = s.r
        kind = r.choice(["room", "window", "field", "studio"], p=[0.35, 0.25, 0.2, 0.2])
        W, D, H = r.uniform(3, 8), r.uniform(3, 8), r.uniform(2.4, 4)
        if kind in ("room", "window"):
            c = (r.uniform(-0.35, 0.35) * W, -0.47 * D, r.uniform(0.8, 1.9))
            t = (r.uniform(-0.25, 0.25) * W, r.uniform(0, 0.45) * D, r.uniform(0.3, 1.4))
        else:
            a = r.uniform(2, 9)
            c = (r.uniform(-2, 2), -a, r.uniform(0.4, 4))
            t = (r.uniform(-0.7, 0.7), r.uniform(-0.5, 1), r.uniform(0.1, 1))
        s.w(f"Scale {r.choice([-1, 1])} 1 1")
        s.w("LookAt", *("%.4g" % x for x in (*c, *t)), "0 0 1")
        fov = r.uniform(16, 44) if s.plain else r.uniform(20, 56)
        lens = (
            f' "float lensradius" {r.uniform(.005, .06):.4g} "float focaldistance" {np.linalg.norm(np.subtract(c, t)) * r.uniform(.6, 1.3):.4g}'
            if r.random() < 0.2
            else ""
        )
        s.w(f'Camera "perspective" "float fov" {fov:.4g}{lens}')
        if s.calm:
            s.w(r.choice(WIDE, p=[0.6, 0.2, 0.2]))
        s.w('Film "rgb" "integer xresolution" 320 "integer yresolution" 208 "string filename" "x.exr"')
        s.w(f'Integrator "path" "integer maxdepth" {r.choice([3, 6, 10, 20])}')
        s.w("WorldBegin")
        if kind in ("room", "window"):
            x, y, z = W / 2, D / 2, H
            solid = [0.7, 0.2, 0.08, 0.0, 0.02]
            s.material(solid)
            s.quad((-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0), r.choice([1, 3, 6]))
            s.material([1, 0, 0, 0, 0])
            s.quad((-x, -y, z), (-x, y, z), (x, y, z), (x, -y, z))
            for q, (a, b) in enumerate((((-x, y), (x, y)), ((-x, -y), (-x, y)), ((x, y), (x, -y)), ((x, -y), (-x, -y)))):
                if r.random() < 0.7:
                    s.material(solid)
                a, b = np.array(a), np.array(b)
                P = lambda f, h: (*(a + f * (b - a)), h)
                k = r.choice([1, 2, 4])
                if kind == "window" and (q == 1 or r.random() < 0.15):  # an opening with bars
                    f0, f1 = np.sort(r.uniform(0.1, 0.9, 2))
                    f1 = max(f1, f0 + 0.08)
                    h0, h1 = r.uniform(0.0, 0.4) * z, r.uniform(0.6, 0.95) * z
                    s.quad(P(0, 0), P(1, 0), P(1, h0), P(0, h0), k)
                    s.quad(P(0, h1), P(1, h1), P(1, z), P(0, z), k)
                    s.quad(P(0, h0), P(f0, h0), P(f0, h1), P(0, h1), k)
                    s.quad(P(f1, h0), P(1, h0), P(1, h1), P(f1, h1), k)
                    n = r.integers(0, 6)
                    d = (b - a) / np.linalg.norm(b - a)
                    for i in range(n):
                        f = f0 + (f1 - f0) * (i + 0.5) / n
                        p = a + f * (b - a)
                        s.box((p[0], p[1], (h0 + h1) / 2), (0.025, 0.025, (h1 - h0) / 2), 0)
                    if r.random() < 0.3:
                        s.w("AttributeBegin")
                        s.w('Material "thindielectric"' if r.random() < 0.5 else 'Material "dielectric"')
                        s.quad(P(f0, h0), P(f1, h0), P(f1, h1), P(f0, h1))
                        s.w("AttributeEnd")
                else:
                    s.quad(P(0, 0), P(1, 0), P(1, z), P(0, z), k)
            if kind == "window":
                s.sky(r.uniform(1, 6))
            if kind == "room" or r.random() < 0.2:
                n = r.choice([1, 1, 2, 3, 6, 20])
                pw = r.uniform(15, 60) * W * D / 20
                for _ in range(n):
                    size = 10 ** r.uniform(-0.7 if s.calm else -1.7, -0.1)
                    if r.random() < 0.6:
                        s.lamp(
                            (r.uniform(-0.8, 0.8) * x, r.uniform(-0.8, 0.8) * y, z - r.uniform(0.01, 0.5)),
                            (r.normal() * 0.2, r.normal() * 0.2, -1 if r.random() < 0.85 else 1),
                            size,
                            pw / n,
                        )
                    else:
                        s.lamp(
                            (r.uniform(-0.8, 0.8) * x, r.uniform(-0.3, 0.8) * y, r.uniform(0.5, 0.9) * z),
                            r.normal(size=3),
                            size * 0.6,
                            pw / n,
                        )
            for _ in range(r.integers(1, 6) if s.plain else r.integers(3, 14)):
                h = r.uniform(0.3, 0.8) if s.plain else r.uniform(0.1, 0.7)
                s.thing(r.uniform(-0.85, 0.85) * x, r.uniform(-0.4, 0.9) * y, 0, h)
            for _ in range(r.integers(0, 2) if s.plain else r.integers(0, 5)):  # pictures and shelves on the far wall
                s.material([0.9, 0.1, 0, 0, 0])
                s.box(
                    (r.uniform(-0.8, 0.8) * x, y - 0.03, r.uniform(0.35, 0.8) * z),
                    (r.uniform(0.1, 0.6), 0.02 + 0.15 * (r.random() < 0.3), r.uniform(0.03, 0.5)),
                )
        else:
            s.material([0.7, 0.2, 0.1, 0, 0])
            L = 30
            if kind == "field" and r.random() < 0.5:
                p = r.random(6) * 6
                s.grid(
                    lambda u, v: np.stack(
                        [
                            (u - 0.5) * L,
                            (v - 0.5) * L,
                            0.12 * (np.sin(u * 40 + p[0]) * np.sin(v * 37 + p[1]) + np.sin(u * 90 + v * 60 + p[2]) * 0.5) - 0.15,
                        ],
                        -1,
                    ),
                    120,
                    120,
                )
            else:
                s.quad((-L, -L, 0), (L, -L, 0), (L, L, 0), (-L, L, 0), r.choice([4, 16, 40]))
            if kind == "field":
                s.sky(r.uniform(0.6, 2))
            else:
                n = r.choice([1, 1, 2, 3, 12])
                for _ in range(n):
                    d = r.normal(size=3)
                    d[2] = abs(d[2]) + 0.3
                    d *= r.uniform(2.5, 6) / np.linalg.norm(d)
                    s.lamp(d, -d + r.normal(size=3) * 0.3, 10 ** r.uniform(-0.5 if s.calm else -1.5, 0.2), r.uniform(60, 300) / n)
                if r.random() < 0.4:
                    s.w("AttributeBegin")
                    s.w(f'LightSource "infinite" "rgb L" {s.v(col(r, .02, .3))}')
                    s.w("AttributeEnd")
                if r.random() < 0.2:
                    s.w("AttributeBegin")
                    s.w(
                        f'LightSource "spot" "point3 from" [ {r.uniform(-3, 3):.3g} -2 5 ] "point3 to" [ 0 0 0 ] "float coneangle" {r.uniform(10, 35):.3g} "rgb I" {s.v(col(r, 20, 80) * 40)}'
                    )
                    s.w("AttributeEnd")
            for _ in range(r.integers(1, 6) if s.plain else r.integers(3, 22)):
                if s.plain:
                    s.thing(r.normal() * 1.2, r.normal() * 1.2 + 0.5, 0, r.uniform(0.3, 0.9))
                else:
                    s.thing(r.normal() * 1.8, r.normal() * 1.8 + 0.8, 0, r.uniform(0.08, 0.7))
            if r.random() < (0.1 if s.plain else 0.4):
                for _ in range(r.integers(5, 40)):
                    s.w("AttributeBegin")
                    s.material([0.9, 0.1, 0, 0, 0])
                    s.blades((r.normal() * 2.5, r.normal() * 2 + 0.8, 0), r.uniform(0.2, 0.8), 120)
                    s.w("AttributeEnd")
        open(f"{s.dir}/s.pbrt", "w").write("\n".join(s.o) + "\n")


if __name__ == "__main__":
    Scene(int(sys.argv[1]), sys.argv[2]).make()
