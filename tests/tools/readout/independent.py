"""Photographs for the tests by another way than the package's renderer: brute force.

Every pixel is the mean of many instants and sub-pixel places, looked up in a picture of the
target drawn once at rest. Nothing is shared with `corridor.tools.readout.render`.
"""

import cv2
import numpy as np

TEXTURE = 4000  # px, side of the picture of the target
EDGE = 0.45  # of its side: radius of the star, or of the rim's inner edge


def star_texture(sectors):
    """Black and white sectors.

    Turned a little: all middles of texels on a diagonal would fall to one side of an edge there,
    which moves the edge by a third of a texel.
    """
    y, x = np.mgrid[:TEXTURE, :TEXTURE] - (TEXTURE - 1) / 2
    angle = np.arctan2(y, x) - 0.1
    r = np.hypot(x, y)
    white = np.floor(angle / (2 * np.pi / sectors)) % 2 == 0
    light = np.where(white, 0.75, 0.06).astype(np.float32)
    light[r < 0.02 * TEXTURE] = 0.06
    light[r > EDGE * TEXTURE] = np.nan
    return light


def wheel_texture(spokes, crosses, seed=0):
    """Rim, hub, laced spokes in one plane, valve; drawn by OpenCV."""
    light = np.full((TEXTURE, TEXTURE), np.nan, np.float32)
    middle = (TEXTURE - 1) / 2

    def place(radius, angle):
        return middle + radius * TEXTURE * np.array([np.cos(angle), np.sin(angle)])

    def line(a, b, value, width):
        shift = 4
        cv2.line(
            light,
            tuple(int(round(v * 2**shift)) for v in a),
            tuple(int(round(v * 2**shift)) for v in b),
            value,
            width,
            cv2.LINE_8,
            shift,
        )

    for k in range(spokes):
        rim = 2 * np.pi * k / spokes
        lean = (1 if (k // 2) % 2 == 0 else -1) * crosses * 4 * np.pi / spokes
        line(place(0.035, rim + lean), place(EDGE, rim), 0.7, 13)
    line(place(0.38, 0.1), place(EDGE, 0.1), 0.5, 40)
    centre = (int(middle), int(middle))
    cv2.circle(light, centre, int(0.037 * TEXTURE), 0.1, -1)
    cv2.circle(light, centre, int((EDGE + 0.01) * TEXTURE), 0.6, int(0.02 * TEXTURE))
    cv2.circle(light, centre, int((EDGE + 0.03) * TEXTURE), 0.03, int(0.03 * TEXTURE))
    return light


def photograph(
    texture,
    size,
    scale,
    centre,
    turns_per_second=0.0,
    readout=0.03,
    exposure=0.0,
    direction="down",
    tilt=(0.0, 0.0),
    camera=None,
    phase_deg=0.0,
    noise=0.004,
    blur=0.7,
    background=0.3,
    instants=9,
    fine=3,
    seed=0,
):
    """8-bit sRGB picture of a texture turning (clockwise positive) about its middle.

    scale: pixels of the radius `EDGE`; tilt: slopes of the plane's depth along x and y.
    camera: f, cx, cy, k1; default: a pinhole of the focal length `width` before the centre.
    """
    width, height = size
    focal, *principal, k1 = camera or (1.0 * width, *centre, 0.0)
    far = np.linspace(0, 1.5, 300_001)

    def rays(x, y):
        """A long table of the lens, read backwards."""
        u, v = (x - principal[0]) / focal, (y - principal[1]) / focal
        r = np.hypot(u, v)
        grow = np.interp(r, far * (1 + k1 * far**2), far) / np.maximum(r, 1e-12)
        return np.stack([u * grow, v * grow], axis=-1)

    u0, v0 = rays(np.array([centre[0]]), np.array([centre[1]]))[0]
    total = np.zeros((height, width), np.float32)
    behind = background if np.ndim(background) else np.full((height, width), background, np.float32)
    places = (np.arange(fine) + 0.5) / fine - 0.5
    for dy in places:
        for dx in places:
            y, x = np.mgrid[:height, :width].astype(np.float64)
            ray = rays(x + dx, y + dy)
            # The plane z = 1 + a (X - u0) + b (Y - v0), met by the rays.
            depth = (1 - tilt[0] * u0 - tilt[1] * v0) / (
                1 - tilt[0] * ray[..., 0] - tilt[1] * ray[..., 1]
            )
            px = (focal / scale) * (depth * ray[..., 0] - u0).astype(np.float32)
            py = (focal / scale) * (depth * ray[..., 1] - v0).astype(np.float32)
            # Lengths in the plane itself, along and across the slope.
            slope = np.hypot(*tilt)
            if slope:
                ex, ey = tilt[0] / slope, tilt[1] / slope
                stretch = np.hypot(1, slope) - 1
                along = px * ex + py * ey
                px, py = px + ex * along * stretch, py + ey * along * stretch
            # Pixels are read with their row's middle time, as sensors do.
            rows, columns = np.mgrid[:height, :width]
            index, count = {
                "down": (rows, height),
                "up": (height - 1 - rows, height),
                "right": (columns, width),
                "left": (width - 1 - columns, width),
            }[direction]
            times = readout * (index / (count - 1) - 0.5)
            for k in range(instants if exposure else 1):
                late = exposure * ((k + 0.5) / instants - 0.5) if exposure else 0.0
                angle = np.radians(phase_deg) + 2 * np.pi * turns_per_second * (times + late)
                c, s = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
                u, v = px * c + py * s, py * c - px * s
                middle = (TEXTURE - 1) / 2
                seen = cv2.remap(
                    texture,
                    (middle + u * EDGE * TEXTURE).astype(np.float32),
                    (middle + v * EDGE * TEXTURE).astype(np.float32),
                    cv2.INTER_NEAREST,
                    borderValue=float("nan"),
                )
                total += np.where(np.isnan(seen), behind, seen)
    total /= fine * fine * (instants if exposure else 1)
    total = cv2.GaussianBlur(total, (0, 0), blur)
    random = np.random.default_rng(seed)
    return encoded(total + noise * random.standard_normal(total.shape))


def stripes(
    size,
    frequency,
    readout=0.03,
    exposure=0.0003,
    direction="down",
    duty=0.5,
    phase=0.0,
    light=0.8,
    noise=0.01,
    instants=400,
    seed=0,
):
    """8-bit sRGB picture of a lamp's glow that blinks; the light of a row by counting instants."""
    width, height = size
    count = height if direction in ("down", "up") else width
    times = readout * (np.arange(count) / (count - 1) - 0.5)
    if direction in ("up", "left"):
        times = times[::-1]
    late = exposure * ((np.arange(instants) + 0.5) / instants - 0.5)
    lit = ((frequency * (times[:, None] + late) + phase) % 1.0 < duty).mean(axis=1)
    y, x = np.mgrid[:height, :width]
    glow = np.exp(
        -((x - 0.4 * width) ** 2 + (y - 0.55 * height) ** 2) / (2 * (0.4 * max(size)) ** 2)
    )
    lit = lit[:, None] if direction in ("down", "up") else lit[None, :]
    random = np.random.default_rng(seed)
    total = 0.02 + 0.03 * x / width + light * glow * lit
    return encoded(total + noise * random.standard_normal(total.shape))


def encoded(light):
    """8-bit sRGB values of linear light (IEC 61966-2-1)."""
    light = np.clip(light, 0, 1)
    value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * value).astype(np.uint8)
