"""Other ways to find a reference in a picture, as OpenCV has them, to compare with ours."""

from __future__ import annotations

import cv2
import numpy as np

METHODS = ("Lucas-Kanade", "ECC", "phase correlation", "Farneback", "DIS")
_AT_REST = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-6)


def find_with(
    method: str, reference: np.ndarray, picture: np.ndarray, nodes: np.ndarray, half: int = 32
) -> np.ndarray:
    """Shifts (n, 2) px of nodes (n, 2) from reference to picture (height, width) uint8.

    method: one of `METHODS`. half: of the windows, px; dense flows are averaged over them. NaN
    where the method gives none.
    """
    if method == "Lucas-Kanade":
        places = nodes.astype(np.float32)
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            reference, picture, places, None, winSize=(2 * half + 1,) * 2, maxLevel=2,
            criteria=_AT_REST,
        )  # fmt: skip
        return np.where(status == 1, found - places, np.nan).astype(float)
    if method in ("ECC", "phase correlation"):
        one = _ecc if method == "ECC" else _phase
        windows = [np.s_[y - half : y + half + 1, x - half : x + half + 1] for x, y in nodes]
        return np.array([one(reference[w], picture[w]) for w in windows])
    if method == "Farneback":
        flow = cv2.calcOpticalFlowFarneback(reference, picture, None, 0.5, 3, 31, 5, 7, 1.5, 0)
    elif method == "DIS":
        flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
            reference, picture, None
        )
    else:
        raise ValueError(f"no method {method!r}")
    mean = cv2.blur(flow, (2 * half + 1, 2 * half + 1))
    return mean[nodes[:, 1], nodes[:, 0]].astype(float)


def _ecc(reference, picture):
    warp = np.eye(2, 3, dtype=np.float32)
    try:
        _, warp = cv2.findTransformECC(
            reference, picture, warp, cv2.MOTION_TRANSLATION, _AT_REST, None, 1
        )
    except cv2.error:
        return np.nan, np.nan
    return float(warp[0, 2]), float(warp[1, 2])


def _phase(reference, picture):
    # Sizes that OpenCV pads, and odd ones, move its peak by parts of a pixel.
    size = min(reference.shape)
    while size % 2 or cv2.getOptimalDFTSize(size) != size:
        size -= 1
    part = np.s_[:size, :size]
    window = cv2.createHanningWindow((size, size), cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(
        reference[part].astype(np.float32), picture[part].astype(np.float32), window
    )
    return shift
