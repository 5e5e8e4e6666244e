"""Whether results can be written for a GIS, told before the work."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

from corridor.errors import InputError

# Packages of the extra `gis`, and what they write.
_WRITERS = {"pyogrio": "a GeoPackage", "laspy": "LAS"}


def check_gis(crs: str | None, packages: Iterable[str] = tuple(_WRITERS)) -> None:
    """Raises InputError where a package of the extra `gis` is missing, or nobody knows the CRS.

    crs: of the block, as `EPSG:32647`; None for local metres.
    """
    for package in packages:
        if find_spec(package) is None:
            raise InputError(
                f"{_WRITERS[package]} needs {package}: pip install 'corridor[gis]', or take the "
                "CSV tables"
            )
    if crs is None:
        return
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        CRS.from_user_input(crs)
    except CRSError:
        raise InputError(
            f"block.toml: crs = {crs!r} is no system that is known; write it as EPSG:2154, or "
            "leave it out"
        ) from None
