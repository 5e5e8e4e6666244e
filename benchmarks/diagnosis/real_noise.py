"""Real blocks with a known effect put into their measurements: real noise, known truth.

    python -m benchmarks.diagnosis.real_noise FOLDER       writes NAME, NAME_twin, NAME.truth.json
    python -m benchmarks.diagnosis.real_noise FOLDER --blocks OTHERS      of the blocks laid there
    python -m benchmarks.diagnosis.real_rates FOLDER OUT   diagnoses them, and counts
    python -m benchmarks.diagnosis --blocks FOLDER -o OUT    the same beside twins and other methods

A measured block is adjusted once; at its adjusted poses, points and camera every measurement is
moved by what the effect does to it there, so residuals, outliers and the lens stay those of the
flight. The projection is written here once more, with numpy alone: nothing of the package's effects
or derivatives is used. Amplitudes are multiples of the standard deviation with which the block
itself could estimate the effect, bounded by what cameras and receivers do (`LARGEST`).

The blocks are those of ../shared/data, or of the folder that CORRIDOR_DATA names. Blocks of other
flights join by being laid in a folder of their own; `NAME.truth.json` beside one says what it is
known to have, and nothing of that kind is put in beside it.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from corridor import Adjustment, Block
from corridor.core.errors import CorridorError, InputError
from notebooks.kit.real import special_plot

DATA = Path(os.environ.get("CORRIDOR_DATA", Path(__file__).parents[3] / "shared" / "data"))
# What is still believed of a drone: beyond it, an amplitude tests nothing that happens.
LARGEST = {
    "rolling_shutter": 0.080,  # s, the slowest of 1,223 published readout times
    "clock_offset": 0.5,  # s
    "focal_drift": 0.052,  # px/s: 31 px in ten minutes, which is what such a flight can see
    "principal_point_drift": 0.052,  # px/s
    "gnss_drift": 1.7e-3,  # m/s: 1 m in ten minutes
    "lever_arm": 0.6,  # m
    "control_blunder": 2.0,  # m
    "thermal": 1.2,  # px/C at the end of the long side
}


@dataclass
class World:
    """What an effect changes, by image: px, m and s; the ground by the name of a point, m."""

    focal: np.ndarray
    principal: np.ndarray
    antenna: np.ndarray
    stretch: np.ndarray
    readout: float = 0.0
    ground: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """An adjusted real block as plain arrays, images in the order of images.csv.

    centre (m, 3) m; rotation (m, 3, 3) world to camera; velocity (m, 3) m/s and time (m,) s from
    the middle of the flight; temperature (m,) degrees from its middle, of optics that warm up.
    """

    block: Block
    names: list[str]
    centre: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    time: np.ndarray
    temperature: np.ndarray

    def world(self) -> World:
        """Nothing is changed."""
        count = len(self.names)
        return World(
            np.zeros(count), np.zeros((count, 2)), np.zeros((count, 3)), np.zeros((count, 3))
        )


def scene_of(adjustment: Adjustment) -> Scene:
    """The scene of an adjusted block; speeds by differences of its positions within a strip."""
    block = adjustment.block
    images = block.images
    if "time_s" not in images:
        raise InputError(f"{block.name} has no times (time_s), which drifts and speeds need")
    w, x, y, z = images[["qw", "qx", "qy", "qz"]].to_numpy(float).T
    rotation = np.moveaxis(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        ),
        2,
        0,
    )
    centre = images[["x", "y", "z"]].to_numpy(float)
    time = images["time_s"].to_numpy(float)
    if {"vx", "vy", "vz"} <= set(images):
        velocity = images[["vx", "vy", "vz"]].to_numpy(float)
    else:
        velocity = _velocities(centre, time, images.get("strip"))
    middle = (time.min() + time.max()) / 2
    # Optics of 40 degrees that approach it within eight minutes, as a camera after take-off.
    warm = 15.0 * (1.0 - np.exp(-(time - time.min()) / 480.0))
    return Scene(
        block, images["image"].astype(str).tolist(), centre, rotation,
        np.nan_to_num(velocity), time - middle, warm - (warm.min() + warm.max()) / 2,
    )  # fmt: skip


def _velocities(centre, time, strip) -> np.ndarray:
    strip = np.zeros(len(time)) if strip is None else pd.factorize(strip)[0]
    out = np.zeros_like(centre)
    for one in np.unique(strip):
        rows = np.flatnonzero(strip == one)
        rows = rows[np.argsort(time[rows])]
        if len(rows) > 2:
            out[rows] = np.gradient(centre[rows], time[rows], axis=0)
    return out


def observed(scene: Scene, table: str, world: World) -> np.ndarray:
    """Image points (rows, 2), px, of tie_points or marks in a world."""
    block = scene.block
    rows = getattr(block, table)
    image = pd.Index(scene.names).get_indexer(rows["image"].astype(str))
    known = block.points if table == "tie_points" else _ground(block)
    place = known.set_index(known["point"].astype(str))[["x", "y", "z"]]
    point = place.reindex(rows["point"].astype(str)).to_numpy(float)
    out = np.full((len(rows), 2), np.nan)
    for name, camera in block.cameras.items():
        mine = np.flatnonzero((block.images["camera"] == name).to_numpy()[image])
        out[mine] = _photograph(scene, world, camera, point[mine], image[mine])
    return out


def _ground(block: Block) -> pd.DataFrame:
    """Ground points as adjusted where they were, as surveyed where not."""
    both = pd.concat([block.points, block.ground])[["point", "x", "y", "z"]]
    return both.drop_duplicates("point")


def _photograph(scene, world, camera, point, image) -> np.ndarray:
    """Fraser's camera (1997) at the moment that the row of each point is read."""
    c = {key: camera[key] for key in ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2", "b1", "b2")}
    down = camera.row_direction in ("down", "up")
    sign = 1.0 if camera.row_direction in ("down", "right") else -1.0
    lines = camera.height if down else camera.width
    half = max(camera.width, camera.height) / 2
    late = np.zeros(len(point))
    for _ in range(4 if world.readout else 1):
        centre = scene.centre[image] + scene.velocity[image] * late[:, None]
        x, y, z = np.einsum("nij,nj->in", scene.rotation[image], point - centre)
        u, v = x / z, y / z
        r2 = u * u + v * v
        radial = 1 + r2 * (c["k1"] + r2 * (c["k2"] + r2 * c["k3"]))
        f = c["f"] + world.focal[image]
        px = u * radial + c["p1"] * (r2 + 2 * u * u) + 2 * c["p2"] * u * v
        px = c["cx"] + world.principal[image, 0] + f * (px + c["b1"] * u + c["b2"] * v)
        py = v * radial + c["p2"] * (r2 + 2 * v * v) + 2 * c["p1"] * u * v
        py = c["cy"] + world.principal[image, 1] + f * py
        p, q = (px - (camera.width - 1) / 2) / half, (py - (camera.height - 1) / 2) / half
        scale, right, lower = world.stretch[image].T
        px, py = px + scale * p + right, py + scale * q + lower
        late = world.readout * sign * ((py if down else px) / (lines - 1) - 0.5)
    return np.stack([px, py], axis=1)


# --- the effects -------------------------------------------------------------------------------

EFFECTS: dict[str, Callable] = {}


def effect(function):
    """Enter a function (scene, world, amplitude, rng) -> entries of the truth."""
    EFFECTS[function.__name__] = function
    return function


def _entry(slug, unit, values, **where) -> dict:
    parameters = [{"name": k, "value": float(v), "unit": unit} for k, v in values.items()]
    return {"slug": slug, **where, "parameters": parameters}


@effect
def rolling_shutter(scene, world, amplitude, rng):
    """amplitude: readout, s."""
    world.readout = amplitude
    return [_entry("rolling_shutter", "s", {"readout": amplitude})]


@effect
def clock_offset(scene, world, amplitude, rng):
    """The camera was exposed later than its stamp, when the antenna was not there yet. s."""
    world.antenna -= scene.velocity * amplitude
    return [_entry("clock_offset", "s", {"offset": amplitude})]


@effect
def focal_drift(scene, world, amplitude, rng):
    """amplitude: px/s."""
    world.focal += amplitude * scene.time
    return [_entry("focal_drift", "px/s", {"rate": amplitude})]


@effect
def principal_point_drift(scene, world, amplitude, rng):
    """amplitude: px/s, in a random direction."""
    way = rng.uniform(0, 2 * np.pi)
    rate = amplitude * np.array([np.cos(way), np.sin(way)])
    world.principal += scene.time[:, None] * rate
    return [_entry("principal_point_drift", "px/s", {"x_rate": rate[0], "y_rate": rate[1]})]


@effect
def gnss_drift(scene, world, amplitude, rng):
    """amplitude: m/s, along one axis."""
    rate = amplitude * np.eye(3)[rng.integers(3)]
    world.antenna += scene.time[:, None] * rate
    return [_entry("gnss_drift", "m/s", dict(zip("xyz", rate, strict=True)))]


@effect
def lever_arm(scene, world, amplitude, rng):
    """amplitude: m, in the plane of the sensor, to be added to the stated arm."""
    way = rng.uniform(0, 2 * np.pi)
    arm = amplitude * np.array([np.cos(way), np.sin(way), 0.0])
    world.antenna += np.einsum("nji,j->ni", scene.rotation, arm)
    return [_entry("lever_arm", "m", dict(zip("xyz", arm, strict=True)))]


@effect
def control_blunder(scene, world, amplitude, rng):
    """One control point is given too high or too low. amplitude: m."""
    return [_blunder(scene, world, rng.choice([-1.0, 1.0]) * amplitude, rng)]


@effect
def two_blunders(scene, world, amplitude, rng):
    """Two control points are given too low, and hide each other. amplitude: m."""
    return [_blunder(scene, world, -amplitude, rng) for _ in range(2)]


def _blunder(scene, world, size, rng) -> dict:
    ground = scene.block.ground
    free = [p for p in ground.loc[ground["role"] == "control", "point"] if p not in world.ground]
    point = str(rng.choice(sorted(free)))
    world.ground[point] = np.array([0.0, 0.0, size])
    return _entry("control_blunder", "m", {"x": 0.0, "y": 0.0, "z": size}, point=point)


@effect
def thermal(scene, world, amplitude, rng):
    """The image plane grows with the temperature. amplitude: px a degree at its long side's end."""
    world.stretch += amplitude * scene.temperature[:, None] * np.array([1.0, 0.3, 0.2])
    values = {"scale": amplitude, "cubic": 0.0, "x": 0.3 * amplitude, "y": 0.2 * amplitude}
    return [_entry("thermal", "px/C", values)]


# --- blocks ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """One block of the bench: a part of a survey, effects and their sizes in sigmas."""

    name: str
    part: str
    effects: dict[str, float]
    seed: int = 0


def sigma_of(scene: Scene, slug: str) -> float:
    """Standard deviation with which the untouched block could estimate an amplitude."""
    block = with_columns(scene)
    if slug in ("control_blunder", "two_blunders"):
        control = (block.ground["role"] == "control").to_numpy()
        if np.count_nonzero(control) < 4:
            raise InputError(f"{block.name} has fewer than four control points")
        return float(np.median(block.ground_sigma()[control, 2]))
    table = corridor.adjust(block, effects=[slug]).effects
    return float(table["sigma"].iloc[0])


def with_columns(scene: Scene) -> Block:
    """The block with the velocities and the temperatures that its effects go by."""
    block = scene.block.copy()
    velocity = dict(zip(("vx", "vy", "vz"), scene.velocity.T, strict=True))
    block.images = block.images.assign(temperature_c=25.0 + scene.temperature, **velocity)
    return block


def inject(block: Block, scene: Scene, effects: dict[str, float], seed: int) -> tuple[Block, dict]:
    """The measured block with effects of given amplitudes in it, and the truth."""
    world, entries = scene.world(), []
    for slug, amplitude in effects.items():
        rng = np.random.default_rng([seed, *slug.encode()])
        entries += EFFECTS[slug](scene, world, amplitude, rng)
    out, plain = block.copy(), scene.world()
    for table in ("tie_points", "marks"):
        rows = getattr(block, table)
        if len(rows):
            moved = observed(scene, table, world) - observed(scene, table, plain)
            if len(moved) < len(rows):  # the adjustment has left some out
                seen, every = (
                    pd.MultiIndex.from_frame(getattr(one, table)[["image", "point"]].astype(str))
                    for one in (scene.block, block)
                )
                moved = np.vstack([moved, [np.nan, np.nan]])[seen.get_indexer(every)]
            xy = rows[["x", "y"]].to_numpy(float) + np.nan_to_num(moved)
            setattr(out, table, rows.assign(x=xy[:, 0], y=xy[:, 1]))
    if len(block.gnss):
        at = pd.Index(scene.names).get_indexer(block.gnss["image"].astype(str))
        xyz = block.gnss[["x", "y", "z"]].to_numpy(float) + world.antenna[at]
        out.gnss = block.gnss.assign(x=xyz[:, 0], y=xyz[:, 1], z=xyz[:, 2])
    for point, shift in world.ground.items():
        row = out.ground["point"] == point
        out.ground.loc[row, ["x", "y", "z"]] += shift
    if "thermal" in effects:
        out.images = out.images.assign(temperature_c=25.0 + scene.temperature)
    if world.readout and not {"vx", "strip"} & set(out.images):
        # Differences across turns are no speeds that anybody could derive: they are stated.
        out.images = out.images.assign(
            **dict(zip(("vx", "vy", "vz"), scene.velocity.T, strict=True))
        )
    return out, {"seed": seed, "effects": entries}


def flight_of(part: str) -> str:
    """The flight of a part: what shares light, ground and lens."""
    known = {"special": "special_plot", "pair": "saraburi block", "f1": "saraburi 1"}
    return known.get(part.partition("_")[0], "saraburi 2")


def laid(folder: Path) -> dict[str, Callable[[], Block]]:
    """Blocks of other flights in a folder, by name."""
    blocks = sorted(one.parent for one in folder.glob("*/block.toml"))
    return {block.name: partial(corridor.read, block) for block in blocks}


def surveys() -> dict[str, Callable[[], Block]]:
    """The real blocks, whole and in parts of a few strips each, by name."""
    flight2 = DATA / "saraburi" / "flight2"

    pair = DATA / "saraburi" / "block"

    def strips(*names: str) -> Callable[[], Block]:
        return lambda: _of_strips(corridor.read(flight2), set(names))

    def first(*names: str) -> Callable[[], Block]:
        return lambda: _of_strips(_rightly_surveyed(), set(names))

    def every_second(folder: Path, first: int) -> Callable[[], Block]:
        return lambda: _every_second(corridor.read(folder), first)

    return {
        "flight2": lambda: corridor.read(flight2),
        "s10_s11_s12_s13": strips("S10", "S11", "S12", "S13"),
        "s11_s12_s13_s14": strips("S11", "S12", "S13", "S14"),
        "even": every_second(flight2, 0),
        "odd": every_second(flight2, 1),
        "even_s10_s11_s12": lambda: _every_second(strips("S10", "S11", "S12")(), 0),
        "odd_s12_s13_s14": lambda: _every_second(strips("S12", "S13", "S14")(), 1),
        "s10_s11_s12": strips("S10", "S11", "S12"),
        "s11_s12_s13": strips("S11", "S12", "S13"),
        "s12_s13_s14": strips("S12", "S13", "S14"),
        "s10_s11": strips("S10", "S11"),
        "s11_s12": strips("S11", "S12"),
        "s12_s13": strips("S12", "S13"),
        "s13_s14": strips("S13", "S14"),
        "f1_s01_s02": first("S01", "S02"),
        "f1_s03_s04": first("S03", "S04"),
        "f1_s05_s06": first("S05", "S06"),
        "f1_s07_s08": first("S07", "S08"),
        "pair": lambda: corridor.read(pair),
        "special": lambda: special_plot(DATA),
    }


def _rightly_surveyed() -> Block:
    """The whole survey without the two points that its README gives as wrong in height.

    Nothing is put into an untouched part, and nothing that is missing from its model may be there.
    """
    whole = corridor.read(DATA / "saraburi" / "whole")
    whole.ground.loc[whole.ground["point"].isin(["GCP22", "GCP26"]), "role"] = "unused"
    return whole


def _of_strips(block: Block, strips: set[str]) -> Block:
    """The images of some strips."""
    return _with_rays(block, block.images["strip"].isin(strips).to_numpy())


def _every_second(block: Block, first: int) -> Block:
    """Half of the images, every second one in the order of their times."""
    order = np.argsort(block.images["time_s"].to_numpy(float), kind="stable")
    chosen = np.zeros(len(order), dtype=bool)
    chosen[order[first::2]] = True
    return _with_rays(block, chosen)


def _with_rays(block: Block, chosen: np.ndarray) -> Block:
    """Some images (m,), with the points that two of them see at least."""
    images = block.images.loc[chosen, "image"].astype(str)
    part = block.select(images=images.tolist())
    rays = part.tie_points.groupby("point", observed=True)["image"].transform("size")
    part.tie_points = part.tie_points[rays > 1].reset_index(drop=True)
    part.tie_points["point"] = part.tie_points["point"].cat.remove_unused_categories()
    seen = part.marks.groupby("point", observed=True)["image"].size()
    single = part.ground["point"].astype(str).map(seen.to_dict()).fillna(0) < 2
    part.ground.loc[single, "role"] = "unused"
    if (part.ground["role"] == "control").sum() < 2:
        part.ground.loc[part.ground["role"] == "check", "role"] = "control"
    return part


PARTS = ("s10_s11_s12", "s11_s12_s13", "s12_s13_s14", "flight2")
SINGLES = ("rolling_shutter", "clock_offset", "focal_drift", "gnss_drift", "lever_arm", "thermal",
           "principal_point_drift")  # fmt: skip
# Sizes of singles, in sigmas; those beyond `LARGEST` are left out. A shutter of 50 has the 30 to
# 70 ms of cameras that are sold, a clock of 150 is 0.1 to 0.2 s late, as users' clocks are.
RATIOS = {"rolling_shutter": (10.0, 20.0, 50.0), "clock_offset": (10.0, 20.0, 50.0, 150.0)}


def cases(every: Iterable[str], parts: Iterable[str]) -> Iterator[Case]:
    """Untouched parts, all of them; of some singles of 10 sigmas and more, blunders, and pairs."""
    for part in every:
        yield Case(f"{part}_untouched", part, {})
    for n, part in enumerate(parts):
        for slug in SINGLES:
            for ratio in RATIOS.get(slug, (10.0, 20.0)):
                yield Case(f"{part}_{slug}_{ratio:.0f}", part, {slug: ratio}, 10 + n)
        for ratio in (6.0, 12.0):
            yield Case(f"{part}_control_blunder_{ratio:.0f}", part, {"control_blunder": ratio}, n)
        yield Case(f"{part}_two_blunders", part, {"two_blunders": 6.0}, n)
        both = {"rolling_shutter": 20.0, "control_blunder": 12.0}
        yield Case(f"{part}_shutter_and_blunder", part, both, n)


def write(folder: Path, short: bool = False, blocks: Path | None = None) -> list[str]:
    """Write every case with its twin and truth; names of those left out, and why.

    short: one part of the survey only, in a tenth of the time. blocks: a folder of other flights.
    """
    left, scenes, sigmas = [], {}, {}
    known = surveys() if blocks is None else laid(blocks)
    whole = [name for name in known if name != "special"]
    for case in cases(whole, known if blocks else PARTS[: 1 if short else None]):
        single = len(case.effects) == 1 and set(case.effects) <= set(SINGLES)
        if short and single and 20.0 not in case.effects.values():
            continue
        own = {} if blocks is None else _known(blocks, case.part)
        amounts = {}
        try:
            if case.part not in scenes:
                block = known[case.part]()
                scenes[case.part] = block, scene_of(corridor.adjust(block))
            block, scene = scenes[case.part]
            for slug, ratio in case.effects.items():
                if (case.part, slug) not in sigmas:
                    sigmas[case.part, slug] = sigma_of(scene, slug)
                amounts[slug] = ratio * sigmas[case.part, slug]
        except CorridorError as error:
            left.append(f"{case.name}: {error}")
            continue
        beyond = [slug for slug, size in amounts.items() if size > LARGEST.get(slug, np.inf)]
        there = [one["slug"] for one in own.get("effects", ()) if one["slug"] in amounts]
        if "rolling_shutter" in amounts and any(c.readout_s == 0 for c in block.cameras.values()):
            there.append("rolling_shutter")  # what is stated is no candidate
        if beyond or there:
            why = (
                "it has one, or is stated to have none"
                if there
                else f"would be {amounts[beyond[0]]:.3g}"
            )
            left.append(f"{case.name}: {(*there, *beyond)[0]}, {why}")
            continue
        made, truth = inject(block, scene, amounts, case.seed)
        made.write(folder / case.name)
        if amounts:
            # Both have the same columns, and so the same candidates.
            twin = block.copy()
            more = made.images.columns.difference(twin.images.columns)
            twin.images = twin.images.join(made.images[more])
            twin.write(folder / f"{case.name}_twin")
        content = {"flight": case.part if blocks else flight_of(case.part), "ratio": case.effects}
        content |= {**truth, "effects": [*own.get("effects", ()), *truth["effects"]]}
        text = json.dumps(content, indent=1)
        (folder / f"{case.name}.truth.json").write_text(text + "\n", encoding="utf-8")
    return left


def _known(blocks: Path, part: str) -> dict:
    """What a laid block is known to have."""
    file = blocks / f"{part}.truth.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def main(arguments: list[str] | None = None) -> None:
    """Write the blocks of the bench into a folder."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.real_noise")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--short", action="store_true", help="one part of the survey only")
    parser.add_argument("--blocks", type=Path, help="folder of other flights, in place of these")
    options = parser.parse_args(arguments)
    if options.blocks is None and not (DATA / "saraburi").is_dir():
        raise InputError(f"{DATA} holds no real blocks: let CORRIDOR_DATA name their folder")
    options.folder.mkdir(parents=True, exist_ok=True)
    for line in write(options.folder, options.short, options.blocks):
        print("left out,", line)


if __name__ == "__main__":
    main()
