"""block.toml: the name, cameras, default sigmas, lever arms and offset of a block."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np

from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.core.textfile import is_number

FILE = "block.toml"
# An attitude: what the log of a drone misses (half a degree, as `misfit` has it).
SIGMA = {
    "tie_px": 1.0, "mark_px": 0.5, "gnss_m": (0.02, 0.02, 0.04), "control_m": (0.01,) * 3,
    "attitude_deg": (0.5,) * 3,
}  # fmt: skip
_TEXTS = ("name", "description", "source", "licence", "crs")


def read_settings(folder: Path) -> dict:
    """Arguments of `Block` that stand in block.toml.

    Raises InputError naming the row of the file.
    """
    path = folder / FILE
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{FILE} is not UTF-8; save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"{FILE} cannot be read: {error.strerror or error}") from error
    try:
        toml = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(_syntax(text, str(error))) from None
    where = _Where(text)

    settings: dict = {}
    if "name" not in toml:
        raise InputError(f'{FILE}: the block has no name; add a line name = "..." at the top')
    for key in _TEXTS:
        if key in toml:
            value = toml.pop(key)
            if not isinstance(value, str):
                raise InputError(f"{where('', key)}: {key} is not text; put it in quotes")
            settings[key] = value
    if "offset" in toml:
        settings["offset"] = np.array(_three(toml.pop("offset"), where("", "offset"), "offset"))
    settings["cameras"] = _cameras(_table(toml.pop("camera", {}), where, "camera"), where)
    settings["sigma"] = _sigma(_table(toml.pop("sigma", {}), where, "sigma"), where)
    arms = _table(toml.pop("lever_arm", {}), where, "lever_arm")
    fixed = arms.pop("fixed", False)
    if not isinstance(fixed, bool):
        raise InputError(
            f"{where('lever_arm', 'fixed')}: fixed is neither true nor false; "
            "write one of them without quotes"
        )
    if fixed and not arms:
        raise InputError(
            f"{where('lever_arm', 'fixed')}: fixed holds no lever arm; add default = [x, y, z]"
        )
    for key in (key for key, arm in arms.items() if "unit" in key and isinstance(arm, str)):
        told = "lever arms are in metres; write default = [x, y, z] so, and no unit"
        raise InputError(f"{where('lever_arm', key)}: {key} is no flight: {told}")
    settings["lever_arm"] = {
        flight: _three(arm, where("lever_arm", flight), flight) for flight, arm in arms.items()
    }
    settings["lever_arm_fixed"] = fixed
    settings["extra"] = toml
    return settings


def _syntax(text: str, message: str) -> str:
    found = re.search(r"\s*\(at (?:line (\d+), column \d+|end of document)\)$", message)
    row = found[1] if found and found[1] else str(text.count("\n") + 1)
    reason = message[: found.start()] if found else message
    return f"{FILE}, row {row}: {reason[:1].lower()}{reason[1:]}; correct the TOML there"


class _Where:
    """`block.toml, row 7` for a key of a table, its table where the key is not found."""

    def __init__(self, text: str):
        self.lines = text.splitlines()

    def __call__(self, table: str, key: str | None = None) -> str:
        current, row = "", None
        for number, line in enumerate(self.lines, start=1):
            header = re.match(r"\s*\[\s*(.*?)\s*\]\s*(#.*)?$", line)
            if header:
                current = header[1].replace('"', "").replace("'", "").replace(" ", "")
                if current == table.replace(" ", ""):
                    row = number
            elif key is not None and current == table.replace(" ", ""):
                if re.match(rf"""\s*["']?{re.escape(key)}["']?\s*=""", line):
                    row = number
                    break
        return f"{FILE}, row {row}" if row else FILE


def _table(value: object, where: _Where, key: str) -> dict:
    if not isinstance(value, dict):
        raise InputError(f"{where('', key)}: {key} is not a table; write it as [{key}]")
    return dict(value)


def _three(value: object, where: str, key: str) -> tuple[float, float, float]:
    if not (isinstance(value, list) and len(value) == 3 and all(map(is_number, value))):
        raise InputError(f"{where}: {key} is not three numbers; write {key} = [x, y, z] in metres")
    x, y, z = map(float, value)
    return x, y, z


def _cameras(cameras: dict, where: _Where) -> dict[str, Camera]:
    made = {}
    for name, table in cameras.items():
        if not isinstance(table, dict):
            raise InputError(
                f"{where('camera', name)}: camera.{name} is not a table; write each camera as "
                "[camera.NAME] with width, height and f"
            )
        try:
            made[name] = Camera.from_table(name, table)
        except InputError as error:
            raise InputError(f"{where(f'camera.{name}')}: {error}") from None
    return made


def _sigma(sigma: dict, where: _Where) -> dict:
    for key, value in sigma.items():
        spot = where("sigma", key)
        if key not in SIGMA:
            raise InputError(f"{spot}: [sigma] has no {key}; use {', '.join(SIGMA)}")
        single = key.endswith("_px")
        if not (is_number(value) or (not single and isinstance(value, list))):
            raise InputError(f"{spot}: {key} is not a number; write a positive number")
        if isinstance(value, list):
            value = _three(value, spot, key)
        if np.min(value) <= 0:
            raise InputError(f"{spot}: {key} is not positive; write a standard deviation above 0")
        sigma[key] = value
    return sigma


# --- writing ---------------------------------------------------------------------------------


def write_settings(block, folder: Path) -> None:
    """Write block.toml of a Block; reading it gives the same values bit for bit."""
    toml: dict = {"name": block.name}
    for key in ("description", "source", "licence", "crs"):
        if getattr(block, key):
            toml[key] = getattr(block, key)
    toml["offset"] = block.offset
    toml |= {key: value for key, value in block.extra.items() if not isinstance(value, dict)}
    toml["sigma"] = dict(block.sigma)
    if (
        not len(block.attitudes)
        and tuple(toml["sigma"].get("attitude_deg", ())) == SIGMA["attitude_deg"]
    ):
        del toml["sigma"]["attitude_deg"]
    if block.lever_arm:
        toml["lever_arm"] = dict(block.lever_arm)
        if block.lever_arm_fixed:
            toml["lever_arm"]["fixed"] = True
    toml["camera"] = {name: camera.to_table() for name, camera in block.cameras.items()}
    toml |= {key: value for key, value in block.extra.items() if isinstance(value, dict)}
    (folder / FILE).write_text("\n".join(_lines(toml, "")) + "\n", encoding="utf-8", newline="\n")


def _lines(table: dict, name: str):
    yield from (
        f"{_key(key)} = {_value(value, key)}"
        for key, value in table.items()
        if not isinstance(value, dict)
    )
    for key, value in table.items():
        if isinstance(value, dict):
            full = f"{name}.{_key(key)}" if name else _key(key)
            if not value or any(not isinstance(part, dict) for part in value.values()):
                yield f"\n[{full}]"
            yield from _lines(value, full)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _text(text: str) -> str:
    # JSON's escapes are TOML's, but for the one character that only TOML wants escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: object, key: str) -> str:
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(part, key) for part in value)}]"
    if isinstance(value, dict):
        inside = ", ".join(f"{_key(name)} = {_value(part, key)}" for name, part in value.items())
        return f"{{{inside}}}"
    if hasattr(value, "isoformat"):
        return value.isoformat()
    raise InputError(f"{FILE}: {key} is {value!r}, which TOML cannot hold; give text or numbers")
