"""A block in which an effect is hidden, its twin without it, and what is true.

    hidden = generate(single("rolling_shutter"), seed=7)
    hidden.write(folder)        # folder/, folder_twin/ and folder.truth.json beside them

Nothing of the package's effects or projection is used: only its tables.
"""

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor import Block, Camera

from . import gnss
from .camera import calibration, make_lens
from .cases import CATALOGUE, NULLS, OUTSIDE, Case, null, single
from .ground import BORDER_PX, choose, plan, terrain
from .noise import Noise, of_gnss, of_ties
from .physics import EFFECTS
from .trajectory import fly, quaternion, rotation
from .unknown import UNKNOWN
from .world import Scene, World, antenna, photograph

CAMERA = "cam"
GYRO_S, GYRO_REACH_S = 0.005, 0.05  # of rates.csv: step, and how far round an exposure
_STREAMS = ("lens", "flight", "ground", "choice", "ties", "marks", "gnss", "survey", "motion",
            "start", "epochs")  # fmt: skip


@dataclass(frozen=True)
class Hidden:
    """block: with the effect. twin: same noise, without. truth: as JSON can hold it."""

    block: Block
    twin: Block
    truth: dict

    def write(self, folder, form="csv"):
        """Write FOLDER, FOLDER_twin and FOLDER.truth.json; returns the folder."""
        folder = Path(folder)
        self.block.write(folder, form)
        self.twin.write(folder.with_name(f"{folder.name}_twin"), form)
        text = json.dumps(self.truth, indent=1)
        folder.with_name(f"{folder.name}.truth.json").write_text(text + "\n", encoding="utf-8")
        return folder


def generate(case: Case, seed: int) -> Hidden:
    """The block of a case, its twin and the truth; the same for the same case and seed."""
    rng = streams(seed)
    scene = make_scene(case, rng)
    errors = draw(scene, case, rng)
    world, entries = World(), []
    for slug, amount in case.effects.items():
        options = dict(amount) if hasattr(amount, "items") else {"amplitude": amount}
        law = (EFFECTS | UNKNOWN)[slug]
        # A draw of its own by name: two effects together are the two alone.
        mine = np.random.default_rng([seed, *slug.encode()])
        entries += law(scene, world, options.pop("amplitude"), mine, **options)
    name = f"block_{seed:06d}"
    block, seen = write_down(scene, world, case, errors, name)
    twin, plain = write_down(scene, World(), case, errors, name)
    shift = {key: _rms(seen[key] - plain[key]) for key in seen}
    return Hidden(block, twin, _truth(scene, world, case, seed, entries, shift, errors))


def streams(seed: int) -> dict:
    """A generator of random numbers for each purpose, so that none disturbs another."""
    parts = np.random.SeedSequence(seed).spawn(len(_STREAMS))
    return {name: np.random.default_rng(part) for name, part in zip(_STREAMS, parts, strict=True)}


def make_scene(case, rng) -> Scene:
    """Flight, lens and ground of a case; rng: `streams`."""
    lens = make_lens(case.family, case.width, case.lines, case.f, case.texture_px, rng["lens"])
    stated, _ = calibration(lens)
    footprint = np.array([case.lines, case.width]) / case.f
    azimuth = np.radians(case.azimuth_deg)
    strips, length = plan(
        case.geometry, case.images, case.strips, case.height, footprint, case.forward, case.side,
        azimuth,
    )  # fmt: skip
    trajectory = fly(
        _sorties(strips, case), case.speed, case.air, case.pause_s, rng["flight"], case.beyond_s
    )
    count = len(trajectory.exposure)
    flights = [f"F{k + 1}" for k in range(case.flights)]
    images = np.array([f"{flights[f]}_{n + 1:04d}" for n, f in enumerate(trajectory.flight)])
    exposure = trajectory.exposure
    centre = trajectory.centre(exposure)
    arm = np.array([0.09, -0.06, -0.28]) + rng["flight"].normal(0, 0.03, (case.flights, 3))
    if case.arms == "fixed" or case.flights == 1:
        arm[:] = arm[0]
    along = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])

    heat, thermometer = warmth(case, trajectory)
    nothing = np.zeros(0, dtype=int)
    scene = Scene(
        trajectory, lens, images, flights, centre.mean(axis=0),
        (exposure.min() + exposure.max()) / 2, np.zeros((0, 3)), nothing, nothing,
        np.zeros((0, 3)), np.zeros(0), nothing, nothing, nothing, heat, thermometer, stated,
        along, length, arm, case.row_direction,
    )  # fmt: skip

    draw = rng["ground"]
    reach = centre @ np.stack([along, right], axis=1)
    # Obliques look half a height further than they stand.
    slack = 0.6 * footprint[::-1].max() * case.height + 0.6 * case.height * (
        case.geometry == "oblique"
    )
    low, high = reach.min(axis=0) - slack, reach.max(axis=0) + slack
    # Twice as many as an image should find, to choose from.
    density = 2 * case.observations / case.rays / (footprint.prod() * np.mean(centre[:, 2] ** 2))
    place = draw.uniform(low, high, (int(density * np.prod(high - low)) + 50, 2))
    position = place @ np.stack([along, right])
    position[:, 2] += terrain(*place.T, case.relief, draw)
    views = _views(scene, position)
    taken, point, image = choose(views, count, case.observations, case.rays, rng["choice"])

    number = case.control + case.check
    share = (np.arange(number) + 0.5) / max(number, 1)
    spot = np.stack(
        [
            (0.02 + 0.96 * share) * length + draw.normal(0, 0.01 * length, number),
            np.where(np.arange(number) % 2, -1, 1)
            * draw.uniform(0.12, 0.3, number) * footprint[1] * centre[:, 2].min(),
        ],
        axis=1,
    )  # fmt: skip
    ground = spot @ np.stack([along, right])
    ground[:, 2] += terrain(*spot.T, case.relief, np.random.default_rng(0))
    control = np.zeros(number, dtype=bool)
    control[np.round(np.linspace(0, number - 1, case.control)).astype(int)] = True
    mark, mark_image = np.nonzero(_views(scene, ground))
    names = np.array([f"G{n + 1:02d}" for n in range(number)], dtype=object)
    return replace(
        scene, position=position[taken], point=point, image=image, ground=ground,
        ground_name=names, control=control, mark=mark, mark_image=mark_image,
    )  # fmt: skip


def _sorties(strips, case):
    if case.sortie == "all":
        return [[replace(s, images=-(-s.images // case.flights)) for s in strips]] * case.flights
    return [list(part) for part in np.array_split(np.array(strips, dtype=object), case.flights)]


def _views(scene, position):
    """Which points (n,) lie well inside which images (m,): bool (n, m)."""
    time = scene.trajectory.exposure
    centre, to_camera = scene.trajectory.centre(time), scene.trajectory.rotation(time)
    out = np.zeros((len(position), len(time)), dtype=bool)
    width, height = scene.size
    for n in range(len(time)):
        x, y, z = to_camera[n] @ (position - centre[n]).T
        near = np.flatnonzero((z > 1.0) & (np.abs(x) < 0.6 * z) & (np.abs(y) < 0.6 * z))
        a, b = scene.lens.bend(x[near] / z[near], y[near] / z[near])
        a = scene.lens.point[0] + scene.lens.f * a
        b = scene.lens.point[1] + scene.lens.f * b
        inside = (np.abs(2 * a - width) < width - 2 * BORDER_PX) & (
            np.abs(2 * b - height) < height - 2 * BORDER_PX
        )
        out[near[inside], n] = True
    return out


def warmth(case, trajectory, tau=400.0, lag=25.0, outside=18.0):
    """Degrees (m,) of the optics, and what the thermometer writes, at the exposures.

    Switched on at the beginning of each flight the camera tends to warmth_c above the air with the
    time constant tau, s, and back while it is off. The thermometer follows lag s late and is
    rounded to 0.3 degrees.
    """
    warm, read, off = 0.0, 0.0, 0.0
    heat, thermometer = np.empty(len(trajectory.exposure)), np.empty(len(trajectory.exposure))
    for k, (begin, end) in enumerate(trajectory.span):
        cool = np.exp(-(begin - off) / tau) if k else 0.0
        warm, read = warm * cool, warm * cool
        at = trajectory.flight == k
        # Both are sums of exponentials, so that the lag needs no steps in time.
        part = (warm - case.warmth_c) * tau / (tau - lag)

        def state(since, warm=warm, read=read, part=part):
            slow, fast = np.exp(-since / tau), np.exp(-since / lag)
            return (
                case.warmth_c + (warm - case.warmth_c) * slow,
                case.warmth_c + part * slow + (read - case.warmth_c - part) * fast,
            )

        heat[at], thermometer[at] = state(trajectory.exposure[at] - begin)
        (warm, read), off = state(end - begin), end
    return outside + heat, np.round(0.3 * np.round((outside + thermometer) / 0.3), 1)


def draw(scene, case, rng) -> dict:
    """All errors of measurement, once for block and twin."""
    noise, count = case.noise, len(scene.images)
    tie, wrong, sigma = of_ties(len(scene.point), noise, rng["ties"])
    motion, start = rng["motion"], rng["start"]
    out = {
        "tie": tie,
        "wrong": wrong,
        "sigma": sigma,
        "mark": noise.mark_px * rng["marks"].standard_normal((len(scene.mark), 2)),
        "survey": rng["survey"].standard_normal((len(scene.ground), 3)) * noise.control_m,
        "velocity": noise.velocity * motion.standard_normal((count, 3)),
        "gyro": np.radians(noise.gyro_deg_s) * motion.standard_normal((count, 3)),
        "rates": np.radians(noise.gyro_deg_s)
        * motion.standard_normal((count, 2 * round(GYRO_REACH_S / GYRO_S) + 1, 3)),
        "centre": case.start_error[0] * start.standard_normal((count, 3)),
        "attitude": np.radians(case.start_error[1]) * start.standard_normal((count, 3)),
        "points": case.start_error[2] * start.standard_normal((len(scene.position), 3)),
    }
    flight, exposure = scene.trajectory.flight, scene.trajectory.exposure
    if case.gnss in ("track", "interpolated"):
        time, of = gnss.epochs(scene, case.gaps, rng["epochs"])
        error = of_gnss(time, of, noise, rng["gnss"])
        out |= {"epoch": time, "epoch_flight": of, "track": error}
        out["gnss"] = gnss.between(time, error, of, exposure, flight)
    elif case.gnss == "exposures":
        out["gnss"] = of_gnss(exposure, flight, noise, rng["gnss"])
    return out


def write_down(scene, world, case, errors, name):
    """A Block as it was measured, and its observations without error."""
    trajectory, noise = scene.trajectory, case.noise
    seen = {
        "tie_px": photograph(scene, world, scene.position[scene.point], scene.image),
        "mark_px": photograph(scene, world, scene.ground[scene.mark], scene.mark_image),
        "control_m": scene.ground + world.survey,
    }
    exposure, flight = trajectory.exposure, trajectory.flight
    time = np.round(exposure - world.late, 9)
    stated = _stated(noise)
    tables = {}
    if case.gnss == "exposures":
        seen["gnss_m"] = antenna(scene, world, time, flight)
    elif case.gnss != "none":
        epoch, of = errors["epoch"], errors["epoch_flight"]
        right = gnss.track(scene, world, epoch, of, 0.0, stated["gnss_m"])
        tables["track"] = gnss.track(scene, world, epoch, of, errors["track"], stated["gnss_m"])
        seen["gnss_m"] = gnss.between(epoch, right[list("xyz")].to_numpy(), of, time, flight)
    if case.gnss in ("exposures", "interpolated"):
        position = seen["gnss_m"] + errors["gnss"]
        table = pd.DataFrame({"image": scene.images, **_xyz(position)})
        for axis, sigma in zip(("sx", "sy", "sz"), stated["gnss_m"], strict=True):
            table[axis] = sigma
        tables["gnss"] = table[np.isfinite(position).all(axis=1)].reset_index(drop=True)

    to_camera = trajectory.rotation(exposure)
    start = rotation(errors["attitude"]) @ to_camera
    images = {
        "image": scene.images, "camera": CAMERA, "flight": np.array(scene.flights)[flight],
        "strip": [f"S{k + 1}" for k in trajectory.strip], "time_s": time,
        "temperature_c": scene.thermometer, **_xyz(trajectory.centre(exposure) + errors["centre"]),
        **dict(zip(("qw", "qx", "qy", "qz"), quaternion(start).T, strict=True)),
        **_xyz(trajectory.velocity(time) + errors["velocity"], "v"),
    }  # fmt: skip
    if case.gyro == "images":
        images |= _xyz(trajectory.rate(time) + errors["gyro"], "w")
    if case.gyro == "rates":
        tables["rates"] = _rates(scene, time, errors["rates"])
    image_names, ties = pd.Index(scene.images), _names("T", len(scene.position))
    tables["images"] = pd.DataFrame(images)
    tables["tie_points"] = _observations(
        ties, scene.point, image_names, scene.image, seen["tie_px"] + errors["tie"]
    )
    if case.sigma_column and noise.tie_px:
        tables["tie_points"]["sigma"] = errors["sigma"]
    tables["marks"] = _observations(
        pd.Index(scene.ground_name), scene.mark, image_names, scene.mark_image,
        seen["mark_px"] + errors["mark"],
    )  # fmt: skip
    tables["points"] = pd.DataFrame({"point": ties, **_xyz(scene.position + errors["points"])})
    tables["ground"] = pd.DataFrame(
        {
            "point": scene.ground_name, **_xyz(seen["control_m"] + errors["survey"]),
            **dict(zip(("sx", "sy", "sz"), stated["control_m"], strict=True)),
            "role": np.where(scene.control, "control", "check"),
        }
    )  # fmt: skip
    if world.surveys is not None:
        tables["ground"]["group"] = world.surveys
    size = {"width": case.width, "height": case.lines, "row_direction": case.row_direction}
    lens = scene.stated | {"calibrated": True} if case.calibrated else {"f": case.f + 4.0}
    # Without antenna positions a lever arm has nothing to say.
    fixed = case.arms == "fixed" and case.gnss != "none"
    block = Block(
        name=name, cameras={CAMERA: Camera.from_table(CAMERA, size | lens)}, **tables,
        sigma=stated, lever_arm={"default": tuple(scene.arm[0].tolist())} if fixed else {},
        lever_arm_fixed=fixed,
    )  # fmt: skip
    return block, seen


def _stated(noise: Noise):
    """What a surveyor would state: the size of the noise, or something small without any."""
    gnss_m = np.hypot(noise.gnss_white_m, noise.gnss_coloured_m)
    return {
        "tie_px": noise.tie_px or 0.3,
        "mark_px": noise.mark_px or 0.3,
        "gnss_m": np.where(gnss_m > 0, gnss_m, [0.01, 0.01, 0.02]),
        "control_m": np.where(np.array(noise.control_m) > 0, noise.control_m, 0.002),
    }


def _rates(scene, time, error):
    """rates.csv: the gyroscope's epochs round every exposure, in order of time."""
    step = GYRO_S * (np.arange(error.shape[1]) - error.shape[1] // 2)
    when = time[:, None] + step
    rate = scene.trajectory.rate(when.ravel()) + error.reshape(-1, 3)
    flight = np.repeat(np.array(scene.flights)[scene.trajectory.flight], len(step))
    return pd.DataFrame({"time_s": when.ravel(), **_xyz(rate, "w"), "flight": flight})


def _observations(names, point, images, image, pixel):
    return pd.DataFrame(
        {
            "point": pd.Categorical.from_codes(point, categories=names),
            "image": pd.Categorical.from_codes(image, categories=images),
            "x": pixel[:, 0],
            "y": pixel[:, 1],
        }
    )


def _names(letter, count):
    return pd.Index([f"{letter}{n + 1:06d}" for n in range(count)])


def _xyz(values, letter=""):
    columns = np.ascontiguousarray(values.T)
    return {letter + axis: columns[k] for k, axis in enumerate("xyz")}


def _rms(values):
    values = values[np.isfinite(values).all(axis=1)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _truth(scene, world, case, seed, entries, shift, errors):
    """Everything that is true, for JSON.

    effects: see `physics`; outside: slugs that no catalogue names. moved: rms by which the effects
    move tie points and marks (px), antennas and given control (m). fraser_rest_px: what Fraser's
    ten parameters cannot describe of the lens.
    """
    trajectory = scene.trajectory
    exposure = trajectory.exposure

    def by_name(names, values, digits):
        return dict(zip(map(str, names), np.round(values, digits).tolist(), strict=True))

    settings = asdict(case) | {"effects": dict(case.effects)}
    return {
        "seed": seed,
        "case": json.loads(json.dumps(settings, default=lambda v: np.asarray(v).tolist())),
        "effects": entries,
        "outside": [entry["slug"] for entry in entries if entry["slug"] in UNKNOWN],
        "moved": shift,
        "wrong_matches": np.flatnonzero(errors["wrong"]).tolist(),
        "camera": scene.stated,
        "fraser_rest_px": calibration(scene.lens)[1],
        "readout_s": world.readout,
        "lever_arm": by_name(scene.flights, scene.arm + world.arm, 9),
        "heat_c": by_name(scene.images, scene.heat, 6),
        "centre": by_name(scene.images, trajectory.centre(exposure), 9),
        "quaternion": by_name(scene.images, quaternion(trajectory.rotation(exposure)), 12),
        "ground": by_name(scene.ground_name, scene.ground, 9),
        "points": by_name(_names("T", len(scene.position)), scene.position, 6),
    }


def main(arguments=None):
    """Command line: python -m benchmarks.diagnosis.generator.generate CASE SEED FOLDER."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.diagnosis.generator.generate",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    known = (*CATALOGUE, *OUTSIDE, *NULLS)
    parser.add_argument("case", choices=known, metavar="CASE", help=", ".join(known))
    parser.add_argument("seed", type=int, metavar="SEED")
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--factor", type=float, default=1.0, help="times the usual amplitude")
    parser.add_argument("--images", type=int)
    parser.add_argument("--geometry")
    given = parser.parse_args(arguments)
    changes = {k: v for k, v in vars(given).items() if k in ("images", "geometry") and v}
    if given.case in NULLS:
        case = null(given.case, **changes)
    else:
        case = single(given.case, given.factor, **changes)
    print(f"wrote {generate(case, given.seed).write(given.folder)}, its twin and its truth")


if __name__ == "__main__":
    main()
