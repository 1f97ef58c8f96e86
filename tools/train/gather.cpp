// Sums of the values Z of the eight pixels at distance d, if they lie in the image, weighted by exp(-|F_p - F_q|^2), and of the pixel
// itself with the weight C; and their gradients. Planes: b images, nz values, nf features, h rows, w <= 1024 columns.

#include <cmath>

static const int COLUMNS = 1024;

template <class Row> static void rows(int b, int h, Row row) {
#pragma omp parallel for collapse(2) schedule(static)
    for (int i = 0; i < b; i++)
        for (int y = 0; y < h; y++) row(i, y);
}

// Calls f with the offset of each neighbour of row y, and its columns from x0 to x1.
template <class Side> static void sides(int y, int h, int w, int d, Side side) {
    for (int dy = -d; dy <= d; dy += d)
        for (int dx = -d; dx <= d; dx += d)
            if ((dy || dx) && y + dy >= 0 && y + dy < h) side(dy * w + dx, dx < 0 ? -dx : 0, dx > 0 ? w - dx : w);
}

// The similarity of the pixels of a row to the pixels at offset o.
static inline void likeness(const float *f, long n, int nf, int o, int x0, int x1, float *k) {
    for (int x = x0; x < x1; x++) k[x] = 0;
    for (int q = 0; q < nf; q++) {
        const float *p = f + q * n;
        for (int x = x0; x < x1; x++) {
            float e = p[x] - p[x + o];
            k[x] += e * e;
        }
    }
    for (int x = x0; x < x1; x++) k[x] = expf(-k[x]);
}

extern "C" void forward(const float *Z, const float *F, const float *C, float *S, int b, int nz, int nf, int h, int w, int d) {
    long n = (long)h * w;
    rows(b, h, [&](int i, int y) {
        long r = (long)y * w;
        const float *z = Z + i * nz * n + r, *f = F + i * nf * n + r, *c = C + i * n + r;
        float *s = S + i * nz * n + r, k[COLUMNS];
        for (int q = 0; q < nz; q++)
            for (int x = 0; x < w; x++) s[q * n + x] = c[x] * z[q * n + x];
        sides(y, h, w, d, [&](int o, int x0, int x1) {
            likeness(f, n, nf, o, x0, x1, k);
            for (int q = 0; q < nz; q++) {
                const float *p = z + q * n;
                float *t = s + q * n;
                for (int x = x0; x < x1; x++) t[x] += k[x] * p[x + o];
            }
        });
    });
}

extern "C" void backward(const float *Z, const float *F, const float *C, const float *G, float *DZ, float *DF, float *DC, int b, int nz, int nf,
                         int h, int w, int d) {
    long n = (long)h * w;
    rows(b, h, [&](int i, int y) {
        long r = (long)y * w;
        const float *z = Z + i * nz * n + r, *f = F + i * nf * n + r, *c = C + i * n + r, *g = G + i * nz * n + r;
        float *dz = DZ + i * nz * n + r, *df = DF + i * nf * n + r, *dc = DC + i * n + r, k[COLUMNS], u[COLUMNS];
        for (int x = 0; x < w; x++) dc[x] = 0;
        for (int q = 0; q < nz; q++)
            for (int x = 0; x < w; x++) {
                dz[q * n + x] = c[x] * g[q * n + x];
                dc[x] += g[q * n + x] * z[q * n + x];
            }
        for (int q = 0; q < nf; q++)
            for (int x = 0; x < w; x++) df[q * n + x] = 0;
        sides(y, h, w, d, [&](int o, int x0, int x1) {
            likeness(f, n, nf, o, x0, x1, k);
            for (int x = x0; x < x1; x++) u[x] = 0;
            for (int q = 0; q < nz; q++) {
                const float *p = z + q * n, *a = g + q * n;
                float *t = dz + q * n;
                for (int x = x0; x < x1; x++) {
                    t[x] += k[x] * a[x + o];
                    u[x] += a[x] * p[x + o] + a[x + o] * p[x];
                }
            }
            for (int x = x0; x < x1; x++) u[x] *= -2 * k[x];
            for (int q = 0; q < nf; q++) {
                const float *p = f + q * n;
                float *t = df + q * n;
                for (int x = x0; x < x1; x++) t[x] += u[x] * (p[x] - p[x + o]);
            }
        });
    });
}
