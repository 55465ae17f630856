"""Loops, normalised to 0..1, own objects, -180..180 angles, strict maxima 5x5, no raising of anything."""

import math


class Pt:
    def __init__(self, pt, size, angle, response, octave):
        self.pt = pt
        self.size = size
        self.angle = angle
        self.response = response
        self.octave = octave


class HarrisDetector:
    def __init__(
        self,
        window_size=5,
        threshold=0.01,
        fixed_number_of_points=False,
        number_of_points=100,
        octaves=1,
        ANMS=False,
        ANMS_points=50,
    ):
        self.w = window_size
        self.t = threshold
        self.f = fixed_number_of_points
        self.n = number_of_points
        self.o = octaves
        self.anms = ANMS
        self.ap = ANMS_points

    def detect(self, image, mask=None):
        import numpy as np

        g = image.astype(float)
        if g.ndim == 3:
            g = 0.114 * g[:, :, 0] + 0.587 * g[:, :, 1] + 0.299 * g[:, :, 2]
        g = g / 255.0
        out = []
        for o in range(self.o):
            if o:
                k = np.array([1, 4, 6, 4, 1]) / 16.0
                p = np.pad(g, 2, mode='edge')
                t = sum(k[i] * p[:, i : i + g.shape[1]] for i in range(5))
                t = sum(k[i] * t[i : i + g.shape[0]] for i in range(5))
                g = t[::2, ::2]
            H, W = g.shape
            G = g.tolist()
            ix = [[0.0] * W for _ in range(H)]
            iy = [[0.0] * W for _ in range(H)]
            for y in range(1, H - 1):
                for x in range(1, W - 1):
                    ix[y][x] = (G[y][x + 1] - G[y][x - 1]) / 2
                    iy[y][x] = (G[y + 1][x] - G[y - 1][x]) / 2
            ix = np.array(ix)
            iy = np.array(iy)
            r = self.w // 2
            R = np.zeros((H, W))
            A = ix * ix
            B = ix * iy
            C = iy * iy

            def s(M):
                P = np.pad(M, r)
                return sum(P[i : i + H, j : j + W] for i in range(self.w) for j in range(self.w))

            a, b, c = s(A), s(B), s(C)
            R = (a * c - b * b) - 0.04 * (a + c) ** 2
            for y in range(2, H - 2):
                for x in range(2, W - 2):
                    v = R[y, x]
                    if v > 0 and v >= R[y - 2 : y + 3, x - 2 : x + 3].max():
                        px, py = x * 2**o, y * 2**o
                        if mask is not None and mask[py, px] == 0:
                            continue
                        gx = ix[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4].sum()
                        gy = iy[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4].sum()
                        out.append(Pt((px, py), self.w * 2**o, math.degrees(math.atan2(gy, gx)), v, o))
        if not out:
            return []
        out.sort(key=lambda p: p.response, reverse=True)
        m = out[0].response
        if self.anms:
            rad = []
            for i, p in enumerate(out):
                d = float('inf')
                for q in out:
                    if p.response < 0.9 * q.response:
                        d = min(d, (p.pt[0] - q.pt[0]) ** 2 + (p.pt[1] - q.pt[1]) ** 2)
                rad.append((d, i))
            rad.sort(key=lambda t: -t[0])
            return [out[i] for _, i in rad[: self.ap]]
        if self.f:
            return out[: self.n]
        return [p for p in out if p.response > self.t * m]
