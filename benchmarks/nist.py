"""NIST's reference problems of nonlinear regression through the solver of adjustments.

The loop of Levenberg and Marquardt, its damping, its stop and the factorisation are those of every
adjustment; only what is assembled is a curve's in place of rays. Data and certified values:
National Institute of Standards and Technology, Statistical Reference Datasets (StRD), nonlinear
regression, in the public domain.
"""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from corridor.core.adjustment.matrix import Band, Bordered, Singular
from corridor.core.adjustment.model import EFFECT, Loss
from corridor.core.adjustment.solving import solve
from corridor.core.adjustment.unknowns import State, Unknown
from corridor.core.engine.interface import engine

FOLDER = Path(__file__).parent / "nist_strd"
exp = np.exp


def gauss(b, x):
    first = b[2] * exp(-((x - b[3]) ** 2) / b[4] ** 2)
    return b[0] * exp(-b[1] * x) + first + b[5] * exp(-((x - b[6]) ** 2) / b[7] ** 2)


def cubic(b, x):
    above = b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3
    return above / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def lanczos(b, x):
    return b[0] * exp(-b[1] * x) + b[2] * exp(-b[3] * x) + b[4] * exp(-b[5] * x)


def enso(b, x):
    turn = 2 * np.pi * x
    out = b[0] + b[1] * np.cos(turn / 12) + b[2] * np.sin(turn / 12)
    for at in (3, 6):
        out = out + b[at + 1] * np.cos(turn / b[at]) + b[at + 2] * np.sin(turn / b[at])
    return out


MODELS = {
    "Misra1a": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Chwirut1": lambda b, x: exp(-b[0] * x) / (b[1] + b[2] * x),
    "Chwirut2": lambda b, x: exp(-b[0] * x) / (b[1] + b[2] * x),
    "Lanczos1": lanczos,
    "Lanczos2": lanczos,
    "Lanczos3": lanczos,
    "Gauss1": gauss,
    "Gauss2": gauss,
    "Gauss3": gauss,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Hahn1": cubic,
    "Thurber": cubic,
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * exp(-b[2] * x[1]),
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * exp(-x * b[3]) + b[2] * exp(-x * b[4]),
    "ENSO": enso,
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "Rat42": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Eckerle4": lambda b, x: b[0] / b[1] * exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
}  # fmt: skip


def read(name):
    """Two starts (2, q), certified values and sigmas (q,), sum of squares, y (n,) and x."""
    text = (FOLDER / f"{name}.dat").read_text().splitlines()
    rows = [re.match(r"\s+b\d+\s*=\s*(.*)", line) for line in text]
    numbers = np.array([row[1].split() for row in rows if row], float)
    squares = next(float(line.split()[-1]) for line in text if line.startswith("Residual Sum"))
    first = max(k for k, line in enumerate(text) if line.startswith("Data:")) + 1
    data = np.array([line.split() for line in text[first:] if line.strip()], float).T
    y = np.log(data[0]) if name == "Nelson" else data[0]
    return numbers[:, :2].T, numbers[:, 2], numbers[:, 3], squares, y, np.squeeze(data[1:])


class Curve:
    """What `solve` asks of the equations, for y = f(b, x): all unknowns shared, beside one image
    that stands still."""

    has_image_effects = False
    loss = Loss()
    behind = 0
    modelled = assembled = None

    def __init__(self, model, start, y, x):
        self.model, self.y, self.x = model, y, x
        nothing = np.zeros((0, 3))
        state = State(
            np.zeros((1, 3)), np.eye(3)[None], nothing, np.zeros((0, 15)),
            {"curve": start[None].copy()}, nothing,
        )  # fmt: skip
        self.problem = SimpleNamespace(
            image_count=1, exposure_count=1, d=6, rig_image=(),
            unknown_count=len(start), shared_count=len(start), per_image_unknowns=[], start=state,
            unknowns=[Unknown(EFFECT, "curve", f"b{k}", at=(0, k)) for k in range(len(start))],
        )  # fmt: skip
        self.gradient, self.reference = np.zeros((1, 6)), np.ones((1, 6))

    def residuals(self, state):
        with np.errstate(all="ignore"):
            return self.y - self.model(state.effects["curve"][0], self.x)

    def jacobian(self, state):
        """By complex steps, exact to rounding."""
        b = state.effects["curve"][0]
        steps = 1e-30j * np.eye(len(b))
        with np.errstate(all="ignore"):
            return np.array([self.model(b + step, self.x).imag for step in steps]).T / 1e-30

    def assemble(self, state, damping, near=None, matrix=True):
        left, j = self.residuals(state), self.jacobian(state)
        self.cost = 0.5 * float(left @ left)
        self.cost = self.cost if np.isfinite(self.cost) and np.isfinite(j).all() else np.inf
        self.shared_gradient = j.T @ left
        if matrix:
            normal = j.T @ j
            self.shared_reference = np.diag(normal).copy()
            self.block = np.tril(normal + damping * np.diag(self.shared_reference))

    def factor(self):
        if not np.isfinite(self.block).all():
            raise Singular(shared=0)
        image = Band(1, 6, 1, 1, engine()(6, 1, False))
        image.add_diagonal(np.ones((1, 6)))
        cross = np.zeros((6, self.problem.unknown_count))
        return Bordered(image, cross, self.block, self.shared_reference, self.reference)

    def step_of_images(self, step):
        return step[None]

    def substitute(self, state, damping, step, shared):
        return state.points, 0.0, 0.0

    def cost_at(self, state, near=None):
        left = self.residuals(state)
        return 0.5 * float(left @ left), 0


def fitted(name: str, start: int):
    """Where the solver ends from a start, far (0) or near (1): values (q,), their sigmas (q,), sum
    of squares, and whether it converged. Raises Singular, AdjustmentFailed."""
    starts, _, _, _, y, x = read(name)
    curve = Curve(MODELS[name], starts[start], y, x)
    found = solve(curve, max_iterations=500, tolerance=1e-8)
    b, left = found.state.effects["curve"][0], curve.residuals(found.state)
    j = curve.jacobian(found.state)
    scale = np.linalg.norm(j, axis=0)
    inverse = np.linalg.pinv(j / scale)
    variance = np.diag(inverse @ inverse.T) * (left @ left) / (len(y) - len(b))
    return b, np.sqrt(variance) / scale, float(left @ left), found.converged
