"""What is compared between a measured block and its counterparts.

Each statistic is a short curve or map: means or sizes of residuals over one axis on which a
physical effect would draw its signature. Residuals are cut at four usual standard deviations, so
that a statistic tells of what many observations share and not of single wrong matches.

Poses absorb most of a missing effect, yet what they absorbed cannot be told from how the camera
really flew, unless something else saw it fly: their second differences are therefore compared
with those of the antenna.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from corridor.diagnosis.signatures import of_single_images, signatures
from corridor.effects import Images

# Residuals are cut at so many usual standard deviations.
CUT = 4.0
# Observations that a bin must have, and antenna positions.
FEWEST, FEWEST_EPOCHS = 30, 3
ROWS, TIMES, PLACES, SECTORS = 12, 12, 14, 8
COLUMNS = (8, 6)
COARSE = (6, 4)
# Check points from which on they are taken together along the corridor.
MANY_CHECKS = 40
COMPASS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")


@dataclass
class Fit:
    """One adjustment: its state and residuals, measured minus modelled, in the problem's order.

    pixels (n, 2) px, gnss (k, 3) m, control (c, 3) m; check (c, 3): adjusted minus given, m.
    """

    state: object
    pixels: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    check: np.ndarray


@dataclass(frozen=True, eq=False)
class Statistic:
    """One curve or map.

    name: what it is. kind: `tie`, `held_out`, `mark`, `gnss`, `control`, `check` or `signature`.
    axis: what it is drawn over, with unit. at: (values,) or, on a map, (values, 2). labels: names
    of the values where they are not numbers. shape: columns and rows of a map, and cells: which
    of them, row by row, the values are of.
    """

    name: str
    kind: str
    unit: str
    axis: str
    at: np.ndarray
    labels: tuple[str, ...] = ()
    shape: tuple[int, int] | None = None
    cells: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.at)


class Ruler:
    """Forms every statistic of a fit; the same bins for a block and all its counterparts.

    believed: the model, its problem and its own fit. Call it with a `Fit`: (values,) of all
    statistics end to end.
    """

    def __init__(self, believed):
        self.statistics: list[Statistic] = []
        self.missing: dict[str, str] = {}
        self.unseen: tuple[str, ...] = ()
        self._parts: list[Callable[[_Seen], np.ndarray]] = []
        self.believed = believed
        self._images: Images = believed.problem.images.with_poses(
            believed.fit.state.centre, believed.fit.state.rotation
        )
        p = believed.problem
        if believed.is_tie.any():
            self._ties()
        if (~believed.is_tie).any():
            self._marks()
        if len(p.gnss_image):
            self._gnss()
        if len(p.control_rows):
            self._ground("control", p.control_rows, "control", lambda seen: seen.fit.control)
        if len(believed.check_rows):
            self._ground("check", believed.check_rows, "check", lambda seen: seen.fit.check)
        self._signatures()

    def __call__(self, fit: Fit) -> np.ndarray:
        seen = _Seen(fit, self)
        return np.concatenate([part(seen) for part in self._parts])

    @property
    def lengths(self) -> list[int]:
        """Values of each statistic."""
        return [len(one) for one in self.statistics]

    def _add(self, statistic: Statistic, part: Callable[[_Seen], np.ndarray]) -> None:
        if len(statistic):
            self.statistics.append(statistic)
            self._parts.append(part)

    def _signatures(self) -> None:
        found = signatures(self.believed)
        if found is not None:
            b, self.unseen = self.believed, found.absorbed
            self._add(
                Statistic(
                    "signatures of the physical effects", "signature", "stated deviations",
                    "effect", np.arange(len(found.names), dtype=float), found.names,
                ),
                lambda seen: found.strengths(seen.pixels(b), seen.fit.gnss, seen.fit.control),
            )  # fmt: skip
        single = of_single_images(self.believed)
        if single:
            names = tuple(name for name, *_ in single)
            forms = [self._single(pixels, gnss) for _, pixels, gnss in single]
            self._add(
                Statistic(
                    "signatures in single images", "signature", "stated deviations", "effect",
                    np.arange(len(names), dtype=float), names,
                ),
                lambda seen: np.array([form(seen) for form in forms]),
            )  # fmt: skip

    def _single(self, pixels: np.ndarray, gnss: np.ndarray) -> Callable[[_Seen], float]:
        """RMS over the images of what residuals share with a signature, in stated deviations."""
        b, p = self.believed, self.believed.problem
        count = p.image_count
        heavy = pixels * p.weight[:, None] ** 2
        antenna = gnss * p.gnss_weight
        square = np.bincount(p.img, (heavy * pixels).sum(axis=1), count)
        square += np.bincount(p.gnss_image, (antenna * gnss).sum(axis=1), count)
        touched = square > 1e-6 * square.max()
        in_pixels, in_antenna = bool(np.any(pixels)), bool(np.any(gnss))

        def form(seen: _Seen) -> float:
            share = np.zeros(count)
            if in_pixels:
                share += np.bincount(p.img, (heavy * seen.pixels(b)).sum(axis=1), count)
            if in_antenna:
                share += np.bincount(p.gnss_image, (antenna * seen.gnss).sum(axis=1), count)
            return float(np.sqrt(np.mean(share[touched] ** 2 / square[touched])))

        return form

    # --- tie points --------------------------------------------------------------------------

    def _ties(self) -> None:
        b, p, images = self.believed, self.believed.problem, self._images
        state, used = b.fit.state, b.is_tie & ~b.held_out
        self.used, self.held = np.flatnonzero(used), np.flatnonzero(b.held_out)
        length = np.hypot(*b.fit.pixels[used].T) / b.sigma[used]
        usual = float(np.median(length)) / np.sqrt(2 * np.log(2))
        self.limit = CUT * max(usual, 1e-9) * b.sigma
        image = p.img[used]
        point = np.repeat(np.arange(len(p.ptr) - 1), np.diff(p.ptr))[used]
        half = (images.size[image] - 1) / 2
        xy = p.xy[used]
        centred = xy - half
        self.across = centred / half.max(axis=1, keepdims=True)
        weight = np.median(b.sigma[used]) ** 2 / b.sigma[used] ** 2
        self.weight = weight
        self.square = weight * (self.across**2).sum(axis=1)

        whole = images.size[image]
        grid = _Grid(xy / whole, COLUMNS, weight, images.size.max(axis=0))
        what = "place in the image (px)"
        for k, axis in enumerate("xy"):
            self._add(
                grid.statistic(f"tie {axis} by image position", "tie", "px", what),
                lambda seen, k=k: grid.mean(seen.ties[:, k]),
            )
        self._add(
            grid.statistic("tie size by image position", "tie", "px", what),
            lambda seen: grid.size(seen.tie_square),
        )
        row = p.images.row_of[image]
        pixel = np.where(row[:, 0] == 1, xy[:, 1], xy[:, 0])
        fraction = row[:, 1] * pixel + row[:, 2]
        rows = _Curve.even(fraction, ROWS, weight)
        what = "row, as read (fraction of the picture)"
        for k, axis in enumerate("xy"):
            self._mean(f"tie {axis} by row", what, rows, k)
        self._size("tie size by row", what, rows)

        velocity = images.velocity
        moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
        if moving.any():
            in_camera = np.einsum("nij,nj->ni", images.rotation, np.nan_to_num(velocity))[:, :2]
            speed = np.maximum(np.hypot(*in_camera.T), 1e-9)
            self.flow = np.where(moving[:, None], in_camera / speed[:, None], 0.0)[image]
            rows = _Curve.even(np.where(moving[image], fraction, np.nan), ROWS, weight)
            for part in ("along", "across"):
                self._add(
                    rows.statistic(f"tie {part} the velocity by row", "tie", "px", what),
                    lambda seen, part=part, rows=rows: rows.mean(seen.flowing[part]),
                )
            sectors = _Curve.sectors(velocity, moving, image, weight)
            if len(sectors.at) > 1:
                for name in ("along", "across"):
                    self._add(
                        sectors.statistic(
                            f"tie {name} the velocity by its direction", "tie", "px",
                            "direction of the velocity",
                        ),
                        lambda seen, name=name: sectors.mean(seen.flowing[name]),
                    )  # fmt: skip
                self._outward_and_size(
                    "direction of the velocity", sectors, "direction of the velocity"
                )
        else:
            self.flow = None
            self.missing["tie residuals by velocity"] = "images.vx, images.vy, images.vz"

        depth = np.einsum(
            "ni,ni->n", images.rotation[image, 2], state.points[point] - images.centre[image]
        )
        origin, axes = _corridor(images.centre)
        place = (state.points[point][:, :2] - origin) @ axes.T
        flights = images.flight[image].astype(float)
        regressors = {"time": images.time[image], "temperature": images.temperature[image]}
        for name, values, unit, column in (
            ("time", images.time[image], "s", "images.time_s"),
            ("temperature", images.temperature[image], "°C", "images.temperature_c"),
            ("depth", depth, "m", ""),
        ):
            if not np.isfinite(values).any() or np.nanmax(values) <= np.nanmin(values):
                if column:
                    self.missing[f"tie residuals by {name}"] = column
                continue
            curve = _Curve.equal(values, TIMES, weight)
            self._outward_and_size(f"{name} ({unit})", curve, name)
        regressors["depth"] = depth
        along = _Curve.even(place[:, 0], PLACES, weight)
        self._outward_and_size("along the corridor (m)", along, "place along the corridor")
        if len(images.flight_names) > 1:
            names = tuple(images.flight_names)
            curve = _Curve.codes(flights, weight, names)
            self._outward_and_size("flight", curve, "flight")
        ground = _Grid.of_places(place, weight)
        self._add(
            ground.statistic("tie size by place on the ground", "tie", "px", "ground (m)"),
            lambda seen: ground.size(seen.tie_square),
        )
        self._add(
            ground.statistic("tie outward by place on the ground", "tie", "px", "ground (m)"),
            lambda seen: ground.ratio(seen.outward, self.square),
        )

        if self.flow is not None:
            regressors["velocity x"] = np.where(moving, in_camera[:, 0], np.nan)[image]
            regressors["velocity y"] = np.where(moving, in_camera[:, 1], np.nan)[image]
        for name, values in regressors.items():
            known = np.isfinite(values)
            spread = float(np.std(values[known])) if known.any() else 0.0
            middle = float(np.mean(values[known])) if known.any() else 0.0
            if spread <= 1e-3 * max(abs(middle), 1e-9):
                continue
            g = np.where(known, (values - middle) / spread, 0.0)
            cells = _Grid(xy / whole, COARSE, weight * g**2, images.size.max(axis=0), known)
            for k, axis in enumerate("xy"):
                self._add(
                    cells.statistic(
                        f"tie {axis} by image position, growing with {name}", "tie", "px",
                        "place in the image (px)",
                    ),
                    lambda seen, k=k, g=g, cells=cells: cells.slope(seen.ties[:, k], weight * g),
                )  # fmt: skip
        self._held_out()

    def _held_out(self) -> None:
        b, p = self.believed, self.believed.problem
        if len(self.held) < FEWEST:
            self.missing["held-out tie observations"] = "tie points in four images or more"
            return
        image = p.img[self.held]
        weight = np.median(b.sigma[self.held]) ** 2 / b.sigma[self.held] ** 2
        size = self._images.size
        grid = _Grid(p.xy[self.held] / size[image], (4, 3), weight, size.max(axis=0))
        what = "place in the image (px)"
        for k, axis in enumerate("xy"):
            self._add(
                grid.statistic(f"held-out tie {axis} by image position", "held_out", "px", what),
                lambda seen, k=k: grid.mean(seen.held[:, k]),
            )
        all_of_them = _Curve(np.zeros(len(image), np.int64), np.zeros(1), weight, ("all together",))
        self._add(
            all_of_them.statistic("held-out tie size", "held_out", "px", ""),
            lambda seen: all_of_them.size((seen.held**2).sum(axis=1) / 2),
        )

    def _mean(self, name: str, axis: str, curve: _Curve, k: int) -> None:
        self._add(
            curve.statistic(name, "tie", "px", axis), lambda seen: curve.mean(seen.ties[:, k])
        )

    def _size(self, name: str, axis: str, curve: _Curve) -> None:
        self._add(
            curve.statistic(name, "tie", "px", axis), lambda seen: curve.size(seen.tie_square)
        )

    def _outward_and_size(self, axis: str, curve: _Curve, name: str) -> None:
        """Scale of the picture, px at the end of its long side, and the size of residuals."""
        if len(curve.at) < 2:
            return
        self._add(
            curve.statistic(f"tie outward by {name}", "tie", "px", axis),
            lambda seen: curve.ratio(seen.outward, self.square),
        )
        self._size(f"tie size by {name}", axis, curve)

    # --- marks -------------------------------------------------------------------------------

    def _marks(self) -> None:
        b, p = self.believed, self.believed.problem
        rows = np.flatnonzero(~b.is_tie)
        self.marks = rows
        usual = max(float(np.median(np.hypot(*b.fit.pixels[rows].T) / b.sigma[rows])), 1e-9)
        self.mark_limit = CUT * usual / np.sqrt(2 * np.log(2)) * b.sigma[rows]
        point = np.repeat(np.arange(len(p.ptr) - 1), np.diff(p.ptr))[rows]
        names, code = np.unique(point, return_inverse=True)
        if len(names) <= MANY_CHECKS:
            curve = _Curve.codes(
                code.astype(float), np.ones(len(rows)), tuple(map(str, p.point_names[names])), 2
            )
            self._add(
                curve.statistic("mark size by point", "mark", "px", "ground point"),
                lambda seen: curve.size((seen.marks**2).sum(axis=1) / 2),
            )
        size = self._images.size
        image = p.img[rows]
        grid = _Grid(
            p.xy[rows] / size[image], (3, 2), np.ones(len(rows)), size.max(axis=0), least=8
        )
        for k, axis in enumerate("xy"):
            self._add(
                grid.statistic(
                    f"mark {axis} by image position", "mark", "px", "place in the image (px)"
                ),
                lambda seen, k=k: grid.mean(seen.marks[:, k]),
            )

    # --- antenna -----------------------------------------------------------------------------

    def _gnss(self) -> None:
        p, images, series = self.believed.problem, self._images, self.believed.series
        image = p.gnss_image
        one = np.ones(len(image))
        self.gnss_limit = CUT * np.maximum(
            1.4826 * np.median(np.abs(self.believed.fit.gnss), axis=0), 1e-9
        )
        flights = tuple(images.flight_names)
        flight = images.flight[image]
        time = np.full(len(image), np.nan)
        part = np.full(len(image), -1)
        first = 0
        for s in series:
            time[s.rows] = s.time
            count = max(1, min(8, len(s.rows) // 4))
            part[s.rows] = first + np.arange(len(s.rows)) * count // len(s.rows)
            first += count
        timed = bool(np.isfinite(images.time[image]).all())
        if not timed:
            self.missing["GNSS residuals by time"] = "images.time_s"
        by_time = _Curve.of(part, time, one, FEWEST_EPOCHS)
        origin, axes = _corridor(images.centre)
        along = (images.centre[image][:, :2] - origin) @ axes[0]
        by_place = _Curve.even(along, 10, one, FEWEST_EPOCHS)
        by_flight = _Curve.codes(flight.astype(float), one, flights, FEWEST_EPOCHS)
        for k, axis in enumerate("xyz"):
            what = "time (s)" if timed else "epoch"
            self._antenna(f"GNSS {axis} by time", what, by_time, lambda seen, k=k: seen.gnss[:, k])
            self._antenna(
                f"GNSS {axis} along the corridor", "along the corridor (m)", by_place,
                lambda seen, k=k: seen.gnss[:, k],
            )  # fmt: skip
            self._antenna(
                f"GNSS {axis} by flight", "flight", by_flight, lambda seen, k=k: seen.gnss[:, k]
            )
            self._antenna(
                f"GNSS {'right down forward'.split()[k]} of the camera by flight", "flight",
                by_flight, lambda seen, k=k: seen.gnss_in_camera[:, k],
            )  # fmt: skip
            self._spectrum(k, axis)
        away = images.centre[image] - images.centre.mean(axis=0)
        spread = away.std(axis=0)
        wide = np.flatnonzero(spread > 1e-3)
        self._add(
            Statistic(
                "GNSS growing with the place", "gnss", "m", "axis, per standard deviation of it",
                wide.astype(float), tuple("xyz"[k] for k in wide),
            ),
            lambda seen: np.array(
                [seen.gnss[:, k] @ away[:, k] / (away[:, k] @ away[:, k]) for k in wide]
            )
            * spread[wide],
        )  # fmt: skip
        height = images.centre[image][:, 2]
        if np.ptp(height) > 0.05 * max(abs(float(np.mean(height - images.ground))), 1.0):
            by_height = _Curve.equal(height, 6, one, FEWEST_EPOCHS)
            self._antenna("GNSS z by height", "height (m)", by_height, lambda seen: seen.gnss[:, 2])
        velocity = images.velocity
        moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
        if not moving[image].any():
            self.missing["GNSS residuals by velocity"] = "images.vx, images.vy, images.vz"
            return
        v = np.where(moving[image][:, None], np.nan_to_num(velocity[image]), 0.0)
        direction = v[:, :2] / np.maximum(np.hypot(*v[:, :2].T), 1e-9)[:, None]
        left = np.column_stack([-direction[:, 1], direction[:, 0]])
        sectors = _Curve.sectors(velocity, moving, image, one, FEWEST_EPOCHS)
        for name, frame in (("along", direction), ("across", left)):
            self._antenna(
                f"GNSS {name} the velocity by its direction", "direction of the velocity", sectors,
                lambda seen, frame=frame: np.einsum("ni,ni->n", seen.gnss[:, :2], frame),
            )  # fmt: skip
        self._antenna(
            "GNSS z by direction of the velocity", "direction of the velocity", sectors,
            lambda seen: seen.gnss[:, 2],
        )  # fmt: skip
        square = float((v**2).sum())
        self._add(
            Statistic(
                "GNSS delay: along the velocity, per speed", "gnss", "s", "",
                np.zeros(1), ("all together",),
            ),
            lambda seen: np.array([(seen.gnss * v).sum() / square]),
        )  # fmt: skip

    def _antenna(self, name: str, axis: str, curve: _Curve, of: Callable) -> None:
        self._add(curve.statistic(name, "gnss", "m", axis), lambda seen: curve.mean(of(seen)))

    def _spectrum(self, k: int, axis: str) -> None:
        """Power by frequency, all flights together, and second differences by flight."""
        series = [s for s in self.believed.series if len(s.rows) >= 16]
        if not series:
            return
        edges = np.array([0.0, 0.03, 0.06, 0.12, 0.25, 0.51])
        frequency = [np.fft.rfftfreq(len(s.rows))[1:] for s in series]
        band = np.clip(np.searchsorted(edges, np.concatenate(frequency)) - 1, 0, len(edges) - 2)
        count = np.bincount(band, minlength=len(edges) - 1)
        full = count > 0
        middle = np.bincount(band, np.concatenate(frequency), len(edges) - 1)[full] / count[full]

        def power(seen: _Seen) -> np.ndarray:
            found = []
            for s in series:
                v = seen.gnss[s.rows, k]
                found.append(np.abs(np.fft.rfft(v - v.mean())[1:]) ** 2 / len(v))
            sums = np.bincount(band, np.concatenate(found), len(edges) - 1)[full]
            return np.log10(np.maximum(sums / count[full], 1e-30))

        self._add(
            Statistic(
                f"GNSS {axis} spectrum", "gnss", "log10 m²", "frequency (cycles per image)", middle
            ),
            power,
        )
        names = tuple(self._images.flight_names[s.flight] for s in series)
        self._add(
            Statistic(
                f"second differences of the poses against GNSS {axis}", "gnss", "m", "flight",
                np.arange(len(series), dtype=float), names,
            ),
            lambda seen: np.array(
                [np.sqrt(np.mean(np.diff(seen.gnss[s.rows, k], 2) ** 2)) for s in series]
            ),
        )  # fmt: skip

    # --- ground points -----------------------------------------------------------------------

    def _ground(self, kind: str, rows: np.ndarray, name: str, of: Callable) -> None:
        ground = self.believed.problem.block.ground
        names = tuple(map(str, ground["point"].iloc[rows]))
        if len(rows) <= MANY_CHECKS:
            for k, axis in enumerate("xyz"):
                self._add(
                    Statistic(
                        f"{name} {axis} by point", kind, "m", f"{name} point",
                        np.arange(len(rows), dtype=float), names,
                    ),
                    lambda seen, k=k: of(seen)[:, k],
                )  # fmt: skip
        else:
            origin, axes = _corridor(self._images.centre)
            at = (ground[["x", "y"]].to_numpy(float)[rows] - origin) @ axes[0]
            curve = _Curve.even(at, PLACES, np.ones(len(rows)), 3)
            for k, axis in enumerate("xyz"):
                self._add(
                    curve.statistic(
                        f"{name} {axis} along the corridor", kind, "m", "along the corridor (m)"
                    ),
                    lambda seen, k=k: curve.mean(of(seen)[:, k]),
                )
        if kind == "check":
            self._add(
                Statistic(
                    "check-point error, RMS", kind, "m", "axis", np.arange(3.0), tuple("xyz")
                ),
                lambda seen: np.sqrt(np.mean(of(seen) ** 2, axis=0)),
            )


class _Seen:
    """The residuals of one fit, cut and turned as the statistics need them."""

    def __init__(self, fit: Fit, ruler: Ruler):
        self.fit, self._ruler, b = fit, ruler, ruler.believed
        self._pixels = None
        if b.is_tie.any():
            limit = ruler.limit[:, None]
            self.ties = np.clip(fit.pixels[ruler.used], -limit[ruler.used], limit[ruler.used])
            self.held = np.clip(fit.pixels[ruler.held], -limit[ruler.held], limit[ruler.held])
            self.tie_square = (self.ties**2).sum(axis=1) / 2
            self.outward = ruler.weight * np.einsum("ni,ni->n", self.ties, ruler.across)
            if ruler.flow is not None:
                x, y = ruler.flow.T
                self.flowing = {
                    "along": self.ties[:, 0] * x + self.ties[:, 1] * y,
                    "across": self.ties[:, 1] * x - self.ties[:, 0] * y,
                }
        if (~b.is_tie).any():
            limit = ruler.mark_limit[:, None]
            self.marks = np.clip(fit.pixels[ruler.marks], -limit, limit)
        if len(fit.gnss):
            self.gnss = np.clip(fit.gnss, -ruler.gnss_limit, ruler.gnss_limit)
            rotation = ruler._images.rotation[b.problem.gnss_image]
            self.gnss_in_camera = np.einsum("nij,nj->ni", rotation, self.gnss)

    def pixels(self, b) -> np.ndarray:
        """Residuals (n, 2) of all image observations, cut; zero where held out."""
        if self._pixels is not None:
            return self._pixels
        self._pixels = out = np.zeros_like(self.fit.pixels)
        if b.is_tie.any():
            out[self._ruler.used] = self.ties
        if (~b.is_tie).any():
            out[self._ruler.marks] = self.marks
        return out


class _Curve:
    """Bins along one axis. code: (n,) bin of each row, -1 for none; at: (bins,)."""

    def __init__(self, code, at, weight, labels=()):
        self.rows = np.flatnonzero(code >= 0)
        # All rows in order is the usual case and needs no copies.
        self.all = len(self.rows) == len(code)
        self.code, self.at, self.labels = code[self.rows], at, tuple(labels)
        self.weight = weight[self.rows]
        self.total = np.bincount(self.code, self.weight, len(at))

    @classmethod
    def of(cls, code, values, weight, least=FEWEST, labels=()):
        """Bins with at least so many rows, each at the mean of its values."""
        code = np.where(np.isfinite(values), code, -1)
        count = np.bincount(code[code >= 0], minlength=code.max(initial=-1) + 1)
        full = np.flatnonzero(count >= least)
        renumber = np.full(len(count) + 1, -1)
        renumber[full] = np.arange(len(full))
        sums = np.bincount(code[code >= 0], values[code >= 0], len(count))
        kept = tuple(labels[k] for k in full) if labels else ()
        return cls(renumber[code], sums[full] / count[full], weight, kept)

    @classmethod
    def even(cls, values, bins, weight, least=FEWEST):
        """Bins of one width, between the first and the last per cent."""
        low, high = np.nanpercentile(values, [1, 99])
        share = (np.nan_to_num(values, nan=low) - low) / max(high - low, 1e-12)
        code = np.clip((share * bins).astype(int), 0, bins - 1)
        return cls.of(code, values, weight, least)

    @classmethod
    def equal(cls, values, bins, weight, least=FEWEST):
        """Bins of one count; few different values are bins of their own."""
        known = np.isfinite(values)
        different = np.unique(values[known])
        if len(different) <= bins:
            code = np.searchsorted(different, np.nan_to_num(values))
            return cls.of(np.minimum(code, len(different) - 1), values, weight, least)
        edges = np.unique(np.quantile(values[known], np.linspace(0, 1, bins + 1)[1:-1]))
        return cls.of(np.searchsorted(edges, values), values, weight, least)

    @classmethod
    def codes(cls, code, weight, labels, least=FEWEST):
        """One bin for each name."""
        return cls.of(code.astype(int), code, weight, least, labels)

    @classmethod
    def sectors(cls, velocity, moving, image, weight, least=FEWEST):
        """Eight directions of the velocity of each row's image, from east anticlockwise."""
        angle = np.arctan2(velocity[:, 1], velocity[:, 0])
        sector = np.where(moving, np.round(np.nan_to_num(angle) / (np.pi / 4)) % SECTORS, np.nan)
        code = np.nan_to_num(sector[image]).astype(int)
        return cls.of(code, sector[image], weight, least, COMPASS)

    def _sum(self, values):
        return np.bincount(self.code, values if self.all else values[self.rows], len(self.at))

    def mean(self, values):
        """Weighted mean of each bin."""
        mine = values if self.all else values[self.rows]
        return np.bincount(self.code, self.weight * mine, len(self.at)) / self.total

    def size(self, squares):
        """Root of the weighted mean square of each bin."""
        return np.sqrt(self.mean(squares))

    def ratio(self, numerator, denominator):
        """Sum over sum of each bin."""
        return self._sum(numerator) / np.maximum(self._sum(denominator), 1e-12)

    def statistic(self, name, kind, unit, axis) -> Statistic:
        """What the values of this curve are."""
        return Statistic(name, kind, unit, axis, self.at, self.labels)


class _Grid(_Curve):
    """Cells of a map. share: (n, 2) in 0..1; size: what 1 means; shape: columns, rows."""

    def __init__(self, share, shape, weight, size, known=None, least=FEWEST, origin=(0.0, 0.0)):
        cell = np.clip((share * shape).astype(int), 0, np.array(shape) - 1)
        code = cell[:, 1] * shape[0] + cell[:, 0]
        if known is not None:
            code = np.where(known, code, -1)
        count = np.bincount(code[code >= 0], minlength=shape[0] * shape[1])
        full = np.flatnonzero(count >= least)
        renumber = np.full(len(count) + 1, -1)
        renumber[full] = np.arange(len(full))
        middle = np.column_stack([full % shape[0] + 0.5, full // shape[0] + 0.5]) / shape
        super().__init__(renumber[code], middle * size + np.asarray(origin), weight)
        self.shape, self.cells = tuple(shape), full

    @classmethod
    def of_places(cls, place, weight):
        """Cells on the ground along and across the corridor, about as long as wide."""
        low, high = np.percentile(place, [1, 99], axis=0)
        span = np.maximum(high - low, 1e-6)
        side = max(span[0] / 16, np.sqrt(np.prod(span) / 60))
        shape = tuple(int(n) for n in np.clip(np.round(span / side), 1, 40))
        return cls((place - low) / span, shape, weight, span, origin=low)

    def slope(self, values, weighted):
        """Slope of values on a regressor, of which `weighted` is weight times regressor."""
        mine = weighted * values
        return self._sum(mine) / self.total

    def statistic(self, name, kind, unit, axis) -> Statistic:
        """What the values of this map are."""
        return Statistic(name, kind, unit, axis, self.at, (), self.shape, self.cells)


def _corridor(centre: np.ndarray):
    """Origin (2,) and axes (2, 2), along and across, of the line of the camera centres."""
    middle = centre[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(centre[:, :2] - middle, full_matrices=False)
    first = axes[0] if axes[0][np.argmax(np.abs(axes[0]))] > 0 else -axes[0]
    frame = np.array([first, [-first[1], first[0]]])
    return middle + ((centre[:, :2] - middle) @ first).min() * first, frame
