"""filter2D gradients scaled 1/8, float32, normalised response, half pixel octave geometry, BORDER_CONSTANT, resize."""

import cv2
import numpy as np


def make_detector(
    window_size=7,
    threshold=0.05,
    fixed_number_of_points=False,
    number_of_points=10,
    octaves=1,
    anms=False,
    anms_points=10,
):
    return D(window_size, threshold, fixed_number_of_points, number_of_points, octaves, anms, anms_points)


class D:
    def __init__(self, *a):
        self.a = a

    def detect(self, img, mask=None):
        w, t, f, n, o, an, ap = self.a
        g = img if img.ndim == 2 else cv2.cvtColor(img, cv2.COLOR_BGR2GRAY)
        g = g.astype(np.float32)
        S = np.float32([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
        res = []
        for i in range(o):
            gx = cv2.filter2D(g, cv2.CV_32F, S, borderType=cv2.BORDER_CONSTANT)
            gy = cv2.filter2D(g, cv2.CV_32F, S.T, borderType=cv2.BORDER_CONSTANT)
            sg = w / 6.0
            def W(v):
                return cv2.GaussianBlur(v, (w, w), sg)
            a, b, c = W(gx * gx), W(gx * gy), W(gy * gy)
            h = a * c - b * b - 0.05 * (a + c) ** 2
            dil = cv2.dilate(h, None)
            ys, xs = np.where((h == dil) & (h > 1e-9))
            G = cv2.GaussianBlur(g, (0, 0), 2)
            bx = cv2.Sobel(G, cv2.CV_32F, 1, 0)
            by = cv2.Sobel(G, cv2.CV_32F, 0, 1)
            ang = cv2.phase(bx, by, angleInDegrees=True)
            for x, y in zip(xs, ys):
                res.append([(x + 0.5) * 2**i - 0.5, (y + 0.5) * 2**i - 0.5, 10.0 * 2**i, ang[y, x], h[y, x], i])
            g = cv2.pyrDown(g)
        if mask is not None:
            res = [
                r for r in res if mask[min(mask.shape[0] - 1, int(r[1] + 0.5)), min(mask.shape[1] - 1, int(r[0] + 0.5))]
            ]
        if not res:
            return []
        R = np.array(res, float)
        R = R[np.argsort(-R[:, 4])]
        R[:, 4] /= R[0, 4]
        if an:
            rad = np.full(len(R), np.inf)
            for i in range(len(R)):
                s = R[R[:, 4] * 0.9 > R[i, 4]]
                if len(s):
                    rad[i] = np.linalg.norm(s[:, :2] - R[i, :2], axis=1).min()
            R = R[np.argsort(-rad, kind='stable')[:ap]]
        elif f:
            R = R[:n]
        else:
            R = R[R[:, 4] > t]
        return [cv2.KeyPoint(float(r[0]), float(r[1]), float(r[2]), float(r[3]), float(r[4]), int(r[5])) for r in R]
