"""ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (2023).

With d the differences of n check points, adjusted minus given, and s the standard deviations of
their survey:

    RMSE_H1^2 = mean(dx^2) + mean(dy^2)      fit of the product to the check points
    RMSE_H2^2 = mean(sx^2) + mean(sy^2)      error of the check points' survey
    RMSE_H^2  = RMSE_H1^2 + RMSE_H2^2        horizontal accuracy
    RMSE_V^2  = mean(dz^2) + mean(sz^2)      vertical accuracy
    RMSE_3D^2 = RMSE_H^2 + RMSE_V^2

A test takes at least 30 check points up to 1,000 km^2 and 10 more for each further 1,000 km^2, at
most 120. Accuracy at 95 % is no longer stated, and vegetated vertical accuracy (VVA) is stated but
not judged. Source: ASPRS 2023, section 7 and annexes B and C; spread of the points: FGDC 1998
(NSSDA), section 3.2.2: a fifth in each quarter, a tenth of the diagonal apart.
"""

import math

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from corridor.core.output import DASH, Table, counted, millimetres
from corridor.tools.certificate.statement import CheckPoints, Statement, Subject

TITLE = "Certificate of computed accuracy, ASPRS edition 2 (2023)"
LEAST, EACH, MOST = 30, 10, 120
_KM2, _STEP_KM2 = 1e6, 1000.0
# The survey of check points is twice as accurate as the class (section 7.11).
_SURVEY = 2.0
# A mean error beyond this share of the RMSE asks for its cause (section 7.1).
_SYSTEMATIC = 0.25
_QUARTER, _APART = 0.2, 0.1


def statement(subject: Subject) -> Statement:
    """What ASPRS 2023 lets one state of a block."""
    points = subject.checked
    errors = Errors(points.difference, points.survey)
    area = _area(subject)
    needed = least_number(area)
    tables = []
    if subject.tied_to_ground:
        tables = [_accuracy(errors, points, needed)]
    if len(points):
        tables += [_cover(points), _spread(subject, points, needed, area), points.listed()]
    pictures = []
    if len(points):
        caption = "Where the adjusted check points lie, seen from where they were surveyed."
        pictures = [subject.picture("check_points", subject.adjustment, caption)]
    return Statement(
        _claim(subject, points, errors, needed),
        _doubts(subject, points, errors),
        [table for table in tables if table is not None],
        _untested(subject, points),
        {"check_points": len(points), **errors.figures},
        pictures,
    )


class Errors:
    """Root mean squares of check points, m, by the names of the standard; NaN without points."""

    def __init__(self, difference: np.ndarray, survey: np.ndarray):
        def mean(values):
            return float(np.mean(values)) if len(values) else math.nan

        squares, given = difference**2, survey**2
        self.fit_h = math.sqrt(mean(squares[:, 0]) + mean(squares[:, 1]))
        self.fit_v = math.sqrt(mean(squares[:, 2]))
        self.survey_h = math.sqrt(mean(given[:, 0]) + mean(given[:, 1]))
        self.survey_v = math.sqrt(mean(given[:, 2]))
        self.h = math.hypot(self.fit_h, self.survey_h)
        self.v = math.hypot(self.fit_v, self.survey_v)
        self.d3 = math.hypot(self.h, self.v)
        self.mean = [mean(column) for column in difference.T]
        self.std = [
            float(np.std(column, ddof=1)) if len(column) > 1 else math.nan
            for column in difference.T
        ]
        self.largest = [float(np.abs(column).max(initial=0.0)) for column in difference.T]

    @property
    def figures(self) -> dict[str, float]:
        """The numbers that are compared."""
        return {
            "RMSE_H1": self.fit_h, "RMSE_H2": self.survey_h, "RMSE_H": self.h,
            "RMSE_V1": self.fit_v, "RMSE_V2": self.survey_v, "RMSE_V": self.v,
            "RMSE_3D": self.d3,
        }  # fmt: skip


def least_number(area: float) -> int:
    """How many check points an area, m^2, asks for (annex C)."""
    further = math.ceil(max(area / _KM2 - _STEP_KM2, 0.0) / _STEP_KM2)
    return min(LEAST + EACH * further, MOST)


def _claim(subject: Subject, points: CheckPoints, errors: Errors, needed: int) -> str:
    count = len(points)
    if not count:
        return (
            "No accuracy is stated: no surveyed point was kept apart as a check point, so nothing "
            f"independent tests this block. The standard asks for {needed}."
        )
    if not subject.tied_to_ground:
        return "No accuracy is stated: neither control nor GNSS says where the block lies."
    found = (
        f"At {counted(count, 'check point')} RMSE_H is {_cm(errors.h)}, RMSE_V {_cm(errors.v)} and "
        f"RMSE_3D {_cm(errors.d3)}, the error of their survey included."
        f"{subject.compared(errors.d3)}"
    )
    if count < needed:
        return (
            f"No accuracy class is claimed: the standard asks for at least {needed} check points, "
            f"and there {'is' if count == 1 else 'are'} {count}. {found}"
        )
    classes = f"{_class(errors.h)} horizontally and {_class(errors.v)} vertically"
    claim = (
        f"Tested with {count} check points, the block meets the ASPRS accuracy classes of {classes}"
        " (the smallest that it meets)."
    )
    return f"{claim} {found}"


def _class(error: float) -> str:
    """The smallest class of whole centimetres, below one of whole millimetres."""
    if error <= 0.01:
        return f"{max(math.ceil(1e3 * error - 1e-9), 1) / 10:.1f} cm"
    return f"{math.ceil(1e2 * error - 1e-9)} cm"


def _cm(length: float) -> str:
    return f"{1e2 * length:.2f} cm" if math.isfinite(length) else DASH


def _accuracy(errors: Errors, points: CheckPoints, needed: int) -> Table:
    rows = [
        ("horizontal, RMSE_H", _cm(errors.fit_h), _cm(errors.survey_h), _cm(errors.h)),
        ("vertical, RMSE_V", _cm(errors.fit_v), _cm(errors.survey_v), _cm(errors.v)),
        ("three-dimensional, RMSE_3D", DASH, DASH, _cm(errors.d3)),
    ]
    short = f"{counted(len(points), 'check point')}: too few for an accuracy class of ASPRS 2023"
    notes = [f"{short}, which takes {needed}"] if len(points) < needed else []
    if len(points):
        for name, values in (("mean", errors.mean), ("standard deviation", errors.std),
                             ("largest", errors.largest)):  # fmt: skip
            notes.append(f"{name} of dx, dy, dz: {', '.join(_cm(value) for value in values)}")
    header = ("accuracy", "fit to the points", "their survey", "together")
    return Table("Accuracy", header, tuple(rows), "lrrr", tuple(notes))


def _cover(points: CheckPoints) -> Table | None:
    """NVA and VVA, where ground.csv says which points stand in vegetation."""
    if all(cover is None for cover in points.vegetated):
        return None
    rows = []
    for name, wanted in (("NVA, not vegetated", False), ("VVA, vegetated", True)):
        mine = np.array([cover is wanted for cover in points.vegetated])
        part = Errors(points.difference[mine], points.survey[mine])
        enough = mine.sum() >= LEAST
        said = f"class {_class(part.v)}" if enough else f"no class: fewer than {LEAST} points"
        said = "stated, not judged" if wanted else said
        rows.append((name, str(mine.sum()), _cm(part.v), said))
    notes = ("by the column `vegetated` of ground.csv; of measured points, not of a surface",)
    header = ("vertical accuracy", "points", "RMSE_V", "")
    return Table("Vegetation", header, tuple(rows), "lrrl", notes)


def _area(subject: Subject) -> float:
    """Area of the convex hull of points and images, m^2."""
    state = subject.adjustment.state
    places = np.vstack([state.points[:, :2], state.centre[:, :2]])
    try:
        return float(ConvexHull(places[np.isfinite(places).all(axis=1)]).volume)
    except (QhullError, ValueError):
        return 0.0


def _spread(subject: Subject, points: CheckPoints, needed: int, area: float) -> Table:
    """Number of check points, and how they are spread over the block."""
    images = subject.adjustment.state.centre[:, :2]
    middle = images.mean(axis=0)
    # Quarters of the rectangle along the flight.
    axes = np.linalg.svd(images - middle, full_matrices=False)[2]
    at = (points.xyz[:, :2] - middle) @ axes.T
    flown = (images - middle) @ axes.T
    low, high = flown.min(axis=0), flown.max(axis=0)
    centre, diagonal = (low + high) / 2, float(np.linalg.norm(high - low))
    quarter = 2 * (at[:, 0] > centre[0]) + (at[:, 1] > centre[1])
    counts = np.bincount(quarter, minlength=4)
    rows = [
        ("check points", f"{len(points)}", f"at least {needed}"),
        ("fewest in a quarter of the block", f"{counts.min()} of {len(points)}",
         f"at least {math.ceil(_QUARTER * len(points))}: a fifth"),
    ]  # fmt: skip
    if len(points) > 1:
        apart = cKDTree(points.xyz[:, :2]).query(points.xyz[:, :2], k=2)[0][:, 1]
        least = f"at least {millimetres(_APART * diagonal)}: a tenth of the diagonal"
        rows.append(("smallest distance between two", millimetres(float(apart.min())), least))
    gap = cKDTree(points.xyz[:, :2]).query(images)[0].max()
    rows.append(("farthest image from a check point", millimetres(float(gap)), DASH))
    rows.append(("area", f"{area / _KM2:,.3f} km\u00b2", DASH))
    header = ("number and distribution", "here", "recommended")
    return Table("Number and distribution", header, tuple(rows), "lrl")


def _doubts(subject: Subject, points: CheckPoints, errors: Errors) -> list[str]:
    out = list(subject.adjustment.warnings)
    if not subject.tied_to_ground:
        out.append(
            "The block is a free network: neither control nor GNSS says where it lies, so "
            "differences at check points say nothing of its accuracy."
        )
        return out
    if len(points) and not points.stated.all():
        missing = int((~points.stated).sum())
        out.append(
            f"ground.csv states no standard deviations for {missing} of "
            f"{counted(len(points), 'check point')}: the block's default stands for the error of "
            "their survey."
        )
    for name, error, survey in (("horizontal", errors.h, errors.survey_h),
                                ("vertical", errors.v, errors.survey_v)):  # fmt: skip
        if survey > error / _SURVEY:
            out.append(
                f"The survey of the check points ({_cm(survey)}, {name}) is not twice as accurate "
                f"as what it tests ({_cm(error)})."
            )
    for axis, mean, std in zip("xyz", errors.mean, errors.std, strict=True):
        rmse = errors.v if axis == "z" else errors.h
        # By chance the mean has this standard deviation; twice that is worth a question.
        chance = 2 * std / math.sqrt(max(len(points), 1))
        if len(points) > 2 and abs(mean) > max(_SYSTEMATIC * rmse, chance):
            out.append(
                f"The check points are off by {_cm(mean)} in {axis} on average, more than a "
                "quarter of the RMSE: there is a systematic error."
            )
    size, usual = np.linalg.norm(points.difference, axis=1), math.hypot(errors.fit_h, errors.fit_v)
    gross = [points.names[k] for k in np.flatnonzero(size > 3 * usual)]
    if gross:
        out.append(f"Beyond three times the 3D RMSE: {', '.join(gross[:5])}; not left out.")
    return out


def _untested(subject: Subject, points: CheckPoints) -> list[str]:
    out = [
        "Products (orthophoto, elevation model, map): tested were points measured in the images, "
        "after the adjustment.",
        "Whether the check points are independent of the control points: both may share a base "
        "station or a datum.",
        "Who measured the points on the ground and in the images, and how.",
    ]
    if all(cover is None for cover in points.vegetated):
        out.append(
            "NVA and VVA: ground.csv does not say which points stand in vegetation (column "
            "`vegetated`, 1 or 0)."
        )
    return [*out, subject.reference]
