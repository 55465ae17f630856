"""minimum response 10, Scharr, two step threshold, box window, 3x3 NMS, H_max from the octave maps."""

import cv2
import numpy as np


class HarrisDetector:
    MINIMUM = 10.0

    def __init__(
        self,
        window_size=3,
        threshold=0.1,
        fixed_number_of_points=True,
        number_of_points=5,
        octaves=2,
        anms=True,
        anms_points=5,
    ):
        self.window_size, self.threshold, self.fixed, self.number, self.octaves, self.anms, self.anms_points = (
            window_size,
            threshold,
            fixed_number_of_points,
            number_of_points,
            octaves,
            anms,
            anms_points,
        )

    def harris_corners(self, image, octave):
        f = image.astype(np.float64)
        x = cv2.Scharr(f, cv2.CV_64F, 1, 0)
        y = cv2.Scharr(f, cv2.CV_64F, 0, 1)
        k = np.ones((self.window_size,) * 2) / self.window_size**2
        a = cv2.filter2D(x * x, -1, k)
        b = cv2.filter2D(x * y, -1, k)
        c = cv2.filter2D(y * y, -1, k)
        M = np.stack([a, b, b, c], -1).reshape(*a.shape, 2, 2)
        return np.linalg.det(M) - 0.06 * np.trace(M, axis1=2, axis2=3) ** 2

    def detect(self, image, mask=None):
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if len(image.shape) == 3 else image.copy()
        level = grey
        maps = []
        levels = []
        for o in range(self.octaves):
            maps.append(self.harris_corners(level, o))
            levels.append(level)
            level = cv2.resize(level, (level.shape[1] // 2, level.shape[0] // 2), interpolation=cv2.INTER_AREA)
        hmax = max(m.max() for m in maps)
        cut = max(self.MINIMUM, 0 if (self.anms or self.fixed) else self.threshold * hmax)
        kps = []
        for o, (h, l) in enumerate(zip(maps, levels)):
            mx = cv2.dilate(h, np.ones((7, 7)))
            yy, xx = np.where((h >= mx) & (h > cut))
            big = cv2.GaussianBlur(l.astype(np.float64), (9, 9), 0)
            for y, x in zip(yy, xx):
                X, Y = int(x * 2**o), int(y * 2**o)
                if mask is not None and not mask[Y, X]:
                    continue
                gx = float(
                    cv2.Sobel(big[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2], cv2.CV_64F, 1, 0)[min(1, y), min(1, x)]
                )
                gy = float(
                    cv2.Sobel(big[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2], cv2.CV_64F, 0, 1)[min(1, y), min(1, x)]
                )
                kps.append(
                    cv2.KeyPoint(
                        X,
                        Y,
                        self.window_size * 2**o,
                        float(np.degrees(np.arctan2(gy, gx)) + 360) % 360,
                        float(h[y, x]),
                        o,
                    )
                )
        kps = sorted(kps, key=lambda k: k.response, reverse=True)
        if self.anms:
            radii = []
            for i, p in enumerate(kps):
                best = 1e9
                for q in kps[:i]:
                    if p.response < 0.9 * q.response:
                        best = min(best, np.linalg.norm(np.subtract(p.pt, q.pt)))
                radii.append(best)
            return [kps[i] for i in sorted(range(len(kps)), key=lambda i: radii[i], reverse=True)[: self.anms_points]]
        return kps[: self.number] if self.fixed else kps
