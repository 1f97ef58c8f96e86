"""Prints the constants of tests/metrics/flip.rs, compare.rs and statistics.rs and of tests/quantiles.tsv from published implementations.

python3 -m venv /tmp/oracle
/tmp/oracle/bin/pip install flip-evaluator==1.7 numpy==2.4.6 mpmath==1.3.0 scipy==1.17.1 scikit-image==0.26.0
/tmp/oracle/bin/python crates/metrics/tests/oracle.py
"""

import flip_evaluator
import mpmath
import numpy as np
from scipy import stats
from skimage import metrics

W, H = 64, 48
X, Y = np.meshgrid(np.arange(W), np.arange(H))


def image(value):
    """Linear RGB in steps of 1/256, the same as in tests/metrics/support.rs."""
    return np.stack([value(X, Y, c) for c in range(3)], axis=2).astype(np.float32) / np.float32(256)


def smooth(x, y, c):
    return [(3 * x + 20) % 256, (4 * y + 2 * x) % 256, (2 * x + y + 60) % 256][c]


def noise(x, y, c):
    return (x * 73 + y * 151 + c * 199 + x * y * 7 + x * x * 11) % 256


IMAGES = {
    "smooth": smooth,
    "noisy": lambda x, y, c: np.clip(smooth(x, y, c) + (noise(x, y, c) - 128) // 8, 0, 256),
    "brighter": lambda x, y, c: np.minimum(smooth(x, y, c) + 10, 256),
    "shifted": lambda x, y, c: smooth(x + 1, y, c),
    "noise": noise,
    "checker": lambda x, y, c: 256 * ((x // 4 + y // 4) % 2),
    "inverse": lambda x, y, c: 256 - 256 * ((x // 4 + y // 4) % 2),
    "dark": lambda x, y, c: smooth(x, y, c) // 32,
    "firefly": lambda x, y, c: np.where((x == 40) & (y == 7), 256, smooth(x, y, c) // 32),
    "green": lambda x, y, c: 256 * (c == 1) + 0 * x,
    "blue": lambda x, y, c: 256 * (c == 2) + 0 * x,
    "black": lambda x, y, c: 0 * x,
    "white": lambda x, y, c: 256 + 0 * x,
}
PAIRS = [
    ("noisy", "smooth"), ("brighter", "smooth"), ("shifted", "smooth"), ("noise", "smooth"), ("inverse", "checker"),
    ("firefly", "dark"), ("blue", "green"), ("white", "black"), ("black", "smooth"), ("smooth", "smooth"),
]
PIXELS = [(0, 0), (63, 47), (40, 7), (41, 9), (21, 30)]

print("// test, reference, pixels per degree, mean, values at", PIXELS)
for test, reference in PAIRS:
    for ppd in [67.0206, 25.0, 110.0] if test in ("noisy", "firefly", "inverse") else [67.0206]:
        a, b = image(IMAGES[test]), image(IMAGES[reference])
        error, mean, _ = flip_evaluator.evaluate(
            b, a, "LDR", inputsRGB=False, applyMagma=False, parameters={"ppd": ppd}
        )
        values = ", ".join(f"{error[y, x, 0]:.7f}" for x, y in PIXELS)
        print(f'("{test}", "{reference}", {ppd}, {mean:.8f}, [{values}]),')

print("// test, reference, MSE, PSNR and squared distance of sRGB, SMAPE")
for test, reference in PAIRS[:4]:
    a, b = (image(IMAGES[n]).astype(np.float64) for n in (test, reference))
    encode = lambda v: np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)
    mse = metrics.mean_squared_error(b, a)
    psnr = metrics.peak_signal_noise_ratio(encode(b), encode(a), data_range=1.0)
    display = metrics.mean_squared_error(encode(b), encode(a))
    both = np.abs(a) + np.abs(b)
    smape = np.mean(np.divide(2 * np.abs(a - b), both, out=np.zeros_like(a), where=both > 0))
    print(f'("{test}", "{reference}", [{mse:.15e}, {psnr:.12f}, {display:.15e}, {smape:.15e}]),')

print("probability", "degrees", "quantile", sep="\t")
mpmath.mp.dps = 40
for p in ["1e-300", "1e-12", "0.025", "0.3", "0.4999999999", "0.75", "0.995"]:
    for v in ["0.3", "1", "2.5", "7", "30", "39.9", "40.1", "1000", "99999", "100000", "1e9", "inf"]:
        # The f64 next to the decimal: the quantile of that number is expected.
        q = mpmath.mpf(float(p))
        low = min(q, 1 - q)
        if v == "inf":
            below = lambda u: mpmath.erfc(mpmath.exp(u) / mpmath.sqrt(2)) / 2
            start = stats.norm.isf(float(low))
        else:
            a = mpmath.mpf(float(v)) / 2

            def below(u):
                x = 2 * a / (2 * a + mpmath.exp(2 * u))
                return mpmath.betainc(a, mpmath.mpf(1) / 2, 0, x, regularized=True) / 2

            start = stats.t.isf(float(low), float(v))
        if not np.isfinite(start):
            print(f"// {p} {v}: {start}")
            continue
        try:
            guess = mpmath.log(start)
            root = mpmath.findroot(lambda u: mpmath.log(below(u)) - mpmath.log(low), (guess, guess + mpmath.mpf("1e-9")))
            t = mpmath.exp(root) * (1 if q > mpmath.mpf(1) / 2 else -1)
            print(p, v, mpmath.nstr(t, 17), sep="\t")
        except (ValueError, mpmath.NoConvergence) as e:
            print(f"// {p} {v}: {e}")

A = [3.1e-3, 2.7e-3, 4.4e-3, 3.9e-3, 2.2e-3, 3.3e-3, 2.9e-3, 5.1e-3]
B = [4.0e-3, 2.9e-3, 5.9e-3, 4.1e-3, 3.5e-3, 3.6e-3, 3.0e-3, 6.6e-3]
N = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0]


def student(values):
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), stats.sem(values))
    return f"[{np.mean(values):.15e}, {low:.15e}, {high:.15e}]"


print("// mean of A; geometric mean of A and ratio A/B as logarithms, 95 %")
for values in (np.array(A), np.log(A), np.log(np.array(A) / B)):
    print(student(values))
line = stats.linregress(np.log(N), np.log(A))
half = stats.t.ppf(0.975, len(N) - 2) * line.stderr
print("// slope of A over N, its ends, intercept")
print(f"[{line.slope:.15e}, {line.slope - half:.15e}, {line.slope + half:.15e}, {line.intercept:.15e}]")
print("// BCa interval of the mean of 40 skewed values, 2,000,000 resamples, three times")
C = [((k * 37) % 41 / 41) ** 3 for k in range(1, 41)]
for seed in range(3):
    found = stats.bootstrap((C,), np.mean, n_resamples=2000000, batch=20000, method="BCa", rng=seed).confidence_interval
    print(np.mean(C), found)
print("// percentile interval of the same", stats.bootstrap((C,), np.mean, n_resamples=2000000, batch=20000, method="percentile", rng=0).confidence_interval)
