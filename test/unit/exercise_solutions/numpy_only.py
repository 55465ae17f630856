"""numpy only; np.gradient; sheet's angle; threshold before the other filters; kwargs."""

from collections import namedtuple

import numpy as np

KP = namedtuple('KP', 'pt size angle response octave')


def gauss(v, w):
    s = w / 3.0
    x = np.arange(w) - w // 2
    k = np.exp(-(x**2) / (2 * s * s))
    k /= k.sum()
    r = w // 2
    p = np.pad(v, r, mode='reflect')
    p = np.apply_along_axis(lambda q: np.convolve(q, k, 'valid'), 1, p)
    return np.apply_along_axis(lambda q: np.convolve(q, k, 'valid'), 0, p)


class HarrisDetector:
    def __init__(self, **kw):
        self.p = {
            'window_size': 5,
            'threshold': 0.01,
            'fixed_number_of_points': False,
            'number_of_points': 100,
            'octaves': 1,
            'anms': False,
            'anms_points': 100,
        }
        self.p.update(kw)

    def detect(self, image, mask=None):
        p = self.p
        im = image.mean(axis=2) if image.ndim == 3 else image
        im = im.astype(np.float64)
        X = []
        for o in range(p['octaves']):
            if o:
                im = gauss(im, 5)[::2, ::2]
            gy, gx = np.gradient(im)
            A, B, C = [gauss(v, p['window_size']) for v in (gx * gx, gx * gy, gy * gy)]
            H = A * C - B**2 - 0.04 * (A + C) ** 2
            P = np.pad(H, 1, constant_values=-np.inf)
            nb = np.max(
                [P[i : i + H.shape[0], j : j + H.shape[1]] for i in range(3) for j in range(3) if (i, j) != (1, 1)],
                axis=0,
            )
            ok = (nb < H) & (H > 0)
            bx, by = gauss(gx, 9), gauss(gy, 9)
            for y, x in np.argwhere(ok):
                X.append(
                    KP(
                        (float(x) * 2**o, float(y) * 2**o),
                        float(p['window_size']) * 2**o,
                        float(np.rad2deg(np.arctan2(bx[y, x], by[y, x]))),
                        float(H[y, x]),
                        o,
                    )
                )
        if mask is not None:
            X = [k for k in X if mask[round(k.pt[1]), round(k.pt[0])] > 0]
        if not X:
            return ()
        top = max(k.response for k in X)
        X = [k for k in X if k.response > p['threshold'] * top]
        if p['anms']:
            pts = np.array([k.pt for k in X])
            f = np.array([k.response for k in X])
            d = ((pts[:, None] - pts[None]) ** 2).sum(-1).astype(float)
            d[~(f[:, None] < 0.9 * f[None])] = np.inf
            r = d.min(1)
            idx = sorted(range(len(X)), key=lambda i: (-r[i], -f[i]))[: p['anms_points']]
            return [X[i] for i in idx]
        if p['fixed_number_of_points']:
            return sorted(X, key=lambda k: -k.response)[: p['number_of_points']]
        return X
