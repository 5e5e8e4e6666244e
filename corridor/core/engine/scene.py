"""What an engine is given and fills: a problem at a state, as arrays.

Every engine takes the same: what is measured, where cameras stand and how they move, what effects
say, and which unknown stands behind each derivative.
"""

from typing import Any, NamedTuple

import numpy as np

# Loss functions, by kind.
SQUARES, HUBER, CAUCHY = 0, 1, 2
# Shared unknowns stand in rows of whole panels of eight numbers.
PANEL = 8
# Interior parameters, and a column of zeros behind them.
INNER = 16
# A row that is not found after so many steps never is.
PASSES = 8


class Observations(NamedTuple):
    """start (points + 1,): where the rays of a point begin; of each ray image (n,), xy (n, 2) px
    and weight (n,) or (1,), the root of it. skewed (n, 3) or (0, 3): matrix 00 10 11 before
    residuals whose x and y are correlated, or not equally good."""

    start: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    weight: np.ndarray
    skewed: np.ndarray


class Cameras(NamedTuple):
    """Of each image: pose (m, 16), centre, rotation and `Images.row_of`; interior (m, 16), of which
    `radials` radial coefficients count, the last number that of the lens; fisheye: whether any lens
    is one; motion (m, degree + 1, 8), centre in the camera frame and
    turn, or (m, 0, 8) where no camera moves. turns: whether it, or its derivatives, turn any."""

    pose: np.ndarray
    interior: np.ndarray
    radials: int
    fisheye: bool
    motion: np.ndarray
    turns: bool


class Looked(NamedTuple):
    """What effects say of the rays of some points, the first of which is the ray `base`.

    shift (k, 2) px by effects on the image, or (k, 6) with the derivative of the shifted pixel by
    the one that is not; (0, 2) without. Of all rays, and moved on to what is found now:
    row (n,), the row that a moving camera reads it in, and modelled (n, 4), the pixel at which
    effects looked and its u, v; (0,) and (0, 4) where nothing needs them. Rows are looked for
    anew until they were missed by less than `near`, px.
    """

    base: int
    shift: np.ndarray
    row: np.ndarray
    modelled: np.ndarray
    near: float


class Derivatives(NamedTuple):
    """By the effects' parameters: of the interior (m, k, 16), of the image (rays, 2, k), of the
    motion (m, k, degree + 1, 8), of the ground control (c, 3, k). sight (rays, 2, 9): of effects
    on the image that see object points, by centre, turn and point; (0, 2, 9) without."""

    interior: np.ndarray
    image: np.ndarray
    motion: np.ndarray
    ground: np.ndarray
    sight: np.ndarray


class Columns(NamedTuple):
    """Number of the unknown behind each derivative: >= 0 shared, -1 held, <= -2 the image's own
    4 - number. source (m, wide): interior parameter behind each shared unknown, or 15; images of
    one camera (m,) have the same. slot (m, effects on camera, image, motion), ground (c, k);
    first, last (m,): of the shared unknowns that an image touches; low, high (m,): their panels;
    wide: how many there are, in whole panels; used: how many any ray touches. exposure (m,),
    rising: of each image, to whose unknowns the assembly adds; hung (m, 18) or (0, 18): A and M,
    row by row, with which an image moves by dC + A dr and M dr where its exposure moves by dC and
    dr."""

    source: np.ndarray
    camera: np.ndarray
    slot: np.ndarray
    ground: np.ndarray
    first: np.ndarray
    last: np.ndarray
    low: np.ndarray
    high: np.ndarray
    wide: int
    used: int
    exposure: np.ndarray
    hung: np.ndarray


class Control(NamedTuple):
    """row (points,) of a point in the next, or -1; weight W (c, 6), 1/m^2, root (c, 6), the lower
    triangle G of W = G'G, both 00 10 11 20 21 22; residual (c, 3), m."""

    row: np.ndarray
    weight: np.ndarray
    root: np.ndarray
    residual: np.ndarray


class Scene(NamedTuple):
    """A problem at a state, as far as its points first..last need it. points (n, 3) m, all; loss:
    its kind and width, on the length of an image residual in sigmas."""

    points: np.ndarray
    observations: Observations
    cameras: Cameras
    looked: Looked
    derivatives: Derivatives
    columns: Columns
    control: Control
    loss: tuple
    first: int
    last: int


class Storage(NamedTuple):
    """The matrix of the images, flat: entry (r, c) of the block (rows of image j, columns of image
    i <= j) lies `c stride + r` behind the block's first, of diagonal blocks the lower half.

    A band without neighbours: LAPACK's lower storage, leading dimension stride + 1. With them
    dense blocks, in the order of each image's sorted neighbours, itself first.
    """

    flat: np.ndarray
    stride: int
    neighbour_start: np.ndarray
    neighbour: np.ndarray

    def entries(self, row: np.ndarray, column: np.ndarray, d: int) -> np.ndarray:
        """Where entries of the lower half (row >= column) lie; images have `d` unknowns."""
        if not len(self.neighbour):
            return column * (self.stride + 1) + row - column
        m = len(self.neighbour_start) - 1
        block = np.repeat(np.arange(m), np.diff(self.neighbour_start)) * m + self.neighbour
        (j, r), (i, c) = np.divmod(row, d), np.divmod(column, d)
        return np.searchsorted(block, i * m + j) * d * d + c * d + r

    def symmetric(self, one: np.ndarray, other: np.ndarray, d: int) -> np.ndarray:
        """Entries between unknowns of images: one and other broadcast to what is returned."""
        return self.flat[self.entries(np.maximum(one, other), np.minimum(one, other), d)]


class Equations(NamedTuple):
    """Where the assembly adds to, all flat.

    Of images: storage, gradient and diagonal (m, d), cross (m, d, wide) to what is shared; of the
    shared: block (wide, wide, lower half), shared_gradient, shared_diagonal (wide,). Columns of
    images >= split go `extra` images later, so that pieces do not meet. matrix: whether more
    than the gradients is wanted.
    """

    storage: Storage
    gradient: np.ndarray
    diagonal: np.ndarray
    cross: np.ndarray
    block: np.ndarray
    shared_gradient: np.ndarray
    shared_diagonal: np.ndarray
    split: int
    extra: int
    matrix: bool


class Step(NamedTuple):
    """A step of the unknowns, and what it does to each image.

    poses (m d,) and two numbers behind, shared (wide,); interior (m, 16), image (m, k),
    motion (m, degree + 1, 8), or (m, 0, 8).
    """

    poses: np.ndarray
    shared: np.ndarray
    interior: np.ndarray
    image: np.ndarray
    motion: np.ndarray


class Inverse(NamedTuple):
    """Covariances of images and shared unknowns: entries between images that share a point, stored
    as the equations; poses_shared (n, q) and shared (q, q), flat."""

    near: Storage
    poses_shared: np.ndarray
    shared: np.ndarray
    q: int


class Asked(NamedTuple):
    """What is to be found. out (points, 6): lower halves, or (0, 6) for none. cross
    (k, 3, columns): with some of the shared unknowns, of the points whose number k in `number`
    (points,) is not -1."""

    number: np.ndarray
    columns: np.ndarray
    out: np.ndarray
    cross: np.ndarray


class Rays(NamedTuple):
    """Rays of the observations of some points, two rows an observation, as kernels make them.

    image (n,); start (points + 1,): where the rays of each point begin. own (2 n, d): by the
    image's unknowns; point (2 n, 3): by the point; shared (2 n, q): by what images share. root
    (points, 6): L^-1 of V = L L', as of `invert_cholesky`. row (points,): where points with a row
    of their own have it, else -1.
    """

    image: np.ndarray
    start: np.ndarray
    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    root: np.ndarray
    row: np.ndarray


class Passing(NamedTuple):
    """What sets of residuals meet on their way through the points; flat, `sets` numbers a row.

    sets: how many, in whole panels. heavy (numbered, 3, sets): weighted residuals of points with a
    row; moved, likewise: gets how far they go. unknowns (columns, sets): of the images, `shared`
    from that row on; with `taken` a step, which is taken away first; without, they get what is
    left, summed by the unknowns.
    """

    sets: int
    heavy: np.ndarray
    moved: np.ndarray
    unknowns: np.ndarray
    shared: int
    taken: bool

    def moves(self, k: int) -> np.ndarray:
        """How far (numbered, 3, k) points with a row of their own went, m."""
        return self.moved.reshape(-1, 3, self.sets)[..., :k]


def robust(loss: Any, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cost rho(s) of squares s (n,), and root of the weight rho'(s)."""
    k2 = loss.width**2
    if loss.kind == HUBER:
        length = np.sqrt(np.maximum(square, k2))
        cost = np.where(square > k2, 2.0 * loss.width * length - k2, square)
        return cost, np.sqrt(loss.width / length)
    if loss.kind == CAUCHY:
        return k2 * np.log1p(square / k2), 1.0 / np.sqrt(1.0 + square / k2)
    return square, np.ones_like(square)
