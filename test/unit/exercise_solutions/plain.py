"""A solution as many write it: Sobel, a box window, cv2.KeyPoint; the one that mistakes are seeded into."""

import cv2
import numpy as np


class HarrisDetector:
    def __init__(
        self,
        window_size=5,
        threshold=0.01,
        fixed_number_of_points=False,
        number_of_points=500,
        octaves=1,
        anms=False,
        anms_points=500,
    ):
        self.__dict__.update({k: v for k, v in locals().items() if k != 'self'})

    def harris_corners(self, img, octave):
        img = img.astype(np.float32)
        ix = cv2.Sobel(img, cv2.CV_32F, 1, 0)
        iy = cv2.Sobel(img, cv2.CV_32F, 0, 1)
        w = self.window_size
        a, b, c = (cv2.blur(v, (w, w)) for v in (ix * ix, ix * iy, iy * iy))
        h = a * c - b * b - 0.04 * (a + c) ** 2
        bx = cv2.Sobel(img, cv2.CV_32F, 1, 0, ksize=7)
        by = cv2.Sobel(img, cv2.CV_32F, 0, 1, ksize=7)
        kp = []
        for y, x in np.argwhere((h > 0) & (h == cv2.dilate(h, np.ones((3, 3))))):
            angle = np.degrees(np.arctan2(by[y, x], bx[y, x]))
            pt = (x * 2**octave, y * 2**octave)
            kp.append(cv2.KeyPoint(float(pt[0]), float(pt[1]), float(w * 2**octave), float(angle % 360), float(h[y, x]),
                                   octave))
        return kp

    def detect(self, image, mask=None):
        if image.ndim == 3:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        kps = []
        for o in range(self.octaves):
            if o:
                image = cv2.pyrDown(image)
            kps += self.harris_corners(image, o)
        if mask is not None:
            kps = [k for k in kps if mask[min(int(k.pt[1]), mask.shape[0] - 1), min(int(k.pt[0]), mask.shape[1] - 1)]]
        if not kps:
            return []
        kps.sort(key=lambda k: -k.response)
        if self.anms:
            r = [np.inf] + [
                min(
                    [np.hypot(k.pt[0] - j.pt[0], k.pt[1] - j.pt[1]) for j in kps[:i] if k.response < 0.9 * j.response],
                    default=np.inf,
                )
                for i, k in enumerate(kps)
                if i
            ]
            o = np.argsort(-np.array(r), kind='stable')[: self.anms_points]
            return [kps[i] for i in o]
        if self.fixed_number_of_points:
            return kps[: self.number_of_points]
        return [k for k in kps if k.response > self.threshold * kps[0].response]
