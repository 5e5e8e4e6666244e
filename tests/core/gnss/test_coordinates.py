"""The local frame and the conversion to a grid against closed formulas."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Local, Track, convert, geographic_positions, to_local
from corridor.core.gnss.coordinates import loosely_known

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
CULOZ = (45.83, 5.78)
PLACE = Local(*CULOZ, 230.0)


def geocentric(lon, lat, height):
    """The textbook formula (Heiskanen and Moritz 1967, eq. 5-3)."""
    lon, lat = np.radians(lon), np.radians(lat)
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    return np.stack(
        [
            (n + height) * np.cos(lat) * np.cos(lon),
            (n + height) * np.cos(lat) * np.sin(lon),
            (n * (1 - E2) + height) * np.sin(lat),
        ],
        axis=-1,
    )


def somewhere(count=20):
    draw = np.random.default_rng(1)
    spread = draw.uniform(-1, 1, (count, 3)) * [0.02, 0.01, 150]
    return np.array([CULOZ[1], CULOZ[0], 300.0]) + spread


def track(points, crs="EPSG:4979", **more):
    table = pd.DataFrame(points, columns=["x", "y", "z"])
    table.insert(0, "time_s", np.arange(len(points), dtype=float))
    return Track(table.assign(**more), None, None, crs, Path("t.pos"))


def test_the_local_frame_is_the_textbooks():
    points = somewhere()
    origin = geocentric(PLACE.lon_deg, PLACE.lat_deg, PLACE.height)
    expected = (geocentric(*points.T) - origin) @ PLACE.rotation().T
    assert np.abs(PLACE.from_geographic(points) - expected).max() < 1e-8


def test_axes_point_east_north_and_up():
    east, north, up = PLACE.from_geographic(
        [[5.781, 45.83, 230], [5.78, 45.831, 230], [5.78, 45.83, 240]]
    )
    assert np.argmax(np.abs(east)) == 0 and east[0] == pytest.approx(77.7, abs=0.1)
    assert np.argmax(np.abs(north)) == 1 and north[1] == pytest.approx(111.15, abs=0.1)
    assert up == pytest.approx([0, 0, 10], abs=1e-8)


@pytest.mark.parametrize("crs", ["EPSG:4979", "EPSG:4978", "EPSG:2154", "EPSG:32631"])
def test_there_and_back_to_any_crs(crs):
    local = PLACE.from_geographic(somewhere())
    assert np.abs(PLACE.from_crs(PLACE.to_crs(local, crs), crs) - local).max() < 1e-6


def test_the_origin_of_a_track_is_its_middle_on_round_numbers():
    points = np.array([[5.7, 45.8, 250.0], [5.80011, 45.9, 320.0], [5.75, 45.81, 300.0]])
    assert Local.about(track(points)).origin == (45.85, 5.7501, 0.0)


def test_a_track_over_the_180th_meridian_has_its_middle_there():
    points = np.array([[179.9, -17.0, 50.0], [-179.8, -17.2, 60.0]])
    assert Local.about(track(points)).origin == (-17.1, -179.95, 0.0)


def test_every_kind_of_track_ends_in_the_same_metres():
    points = somewhere()
    local = to_local(track(points), PLACE)
    assert local.crs is None and local.origin == PLACE.origin
    for crs in ("EPSG:4978", "EPSG:2154"):
        other = to_local(track(convert(points, "EPSG:4979", crs), crs), PLACE)
        assert np.abs(other.positions() - local.positions()).max() < 1e-6
    again = to_local(to_local(local, Local(45.9, 5.9, 0.0)), PLACE)
    assert np.abs(again.positions() - local.positions()).max() < 1e-7
    assert np.abs(geographic_positions(local) - points).max() < 1e-8


def test_covariances_and_velocities_of_a_geocentric_track_are_turned():
    """Made up along east, north, up, put into geocentric axes by hand."""
    point = np.array([[5.78, 45.83, 230.0]])
    enu = np.diag([0.01, 0.02, 0.05]) ** 2
    enu[0, 1] = enu[1, 0] = -5e-5
    turn = PLACE.rotation()
    full = turn.T @ enu @ turn
    velocity = turn.T @ [3.0, -4.0, 0.5]
    deviation = np.sqrt(np.diag(full))
    given = track(
        geocentric(*point.T), "EPSG:4978",
        **dict(zip(["sx", "sy", "sz"], deviation, strict=True)),
        rho_xy=full[0, 1] / deviation[0] / deviation[1],
        rho_yz=full[1, 2] / deviation[1] / deviation[2],
        rho_xz=full[2, 0] / deviation[2] / deviation[0],
        **dict(zip(["vx", "vy", "vz"], velocity, strict=True)),
    )  # fmt: skip
    row = to_local(given, PLACE).table.iloc[0]
    assert row[["sx", "sy", "sz"]].tolist() == pytest.approx([0.01, 0.02, 0.05])
    rho = row[["rho_xy", "rho_yz", "rho_xz"]].tolist()
    assert rho == pytest.approx([-5e-5 / 0.01 / 0.02, 0, 0], abs=1e-9)
    assert row[["vx", "vy", "vz"]].tolist() == pytest.approx([3.0, -4.0, 0.5])


def test_a_local_track_without_a_place_stays_as_it_is_and_has_no_latitude():
    nowhere = replace(track(somewhere()), crs=None)
    assert to_local(nowhere) is nowhere and PLACE.to_local(nowhere) is nowhere
    with pytest.raises(InputError, match=r"t.pos is in local metres without a place"):
        geographic_positions(nowhere)


@pytest.mark.parametrize("crs", ["EPSG:2154+5720", "EPSG:5698"])
def test_a_height_system_whose_geoid_is_missing_is_refused_not_ignored(crs, monkeypatch):
    import pyproj

    if pyproj.network.is_network_enabled():
        pytest.skip("PROJ may fetch the geoid here")
    try:
        found = convert(somewhere(), "EPSG:4979", crs)
    except InputError as error:
        assert ".tif, which is not installed: `pyproj sync --file" in str(error)
    else:  # the geoid is installed: it lies about 50 m above the ellipsoid
        assert np.abs(found[:, 2] - somewhere()[:, 2]).min() > 40


def test_heights_without_any_way_to_the_ellipsoid_are_named():
    with pytest.raises(InputError, match="no way between the heights of EPSG:25832.5783 and the"):
        convert(np.array([[467124.4, 5428660.0, 110.0]]), "EPSG:25832+5783", "EPSG:4979")


@pytest.mark.parametrize(
    ("crs", "place", "known"),
    [("EPSG:31256", (16.3, 48.2), "1.5 m"), ("EPSG:6539", (-74.0, 40.7), "2 m"),
     ("EPSG:25832", (8.55, 49.0), ""), ("EPSG:32632", (8.55, 49.0), ""),
     ("EPSG:25832+7837", (8.55, 49.0), ""), ("EPSG:4326", (8.55, 49.0), "")],
)  # fmt: skip
def test_datums_that_are_joined_to_metres_are_told(crs, place, known):
    """Accuracies of EPSG: MGI to WGS 84 (3), NAD83(2011) to WGS 84 (1)."""
    told = loosely_known(*place, crs, "EPSG:4979")
    assert f"{crs} and WGS 84 to {known} only" in told if known else told == ""


# A country's datum, the place where it is asked, and the grid of that place (proj.db of PROJ 9).
GRIDS = {
    "NAD27 in Colorado": ("EPSG:26713", "EPSG:26913", (-105, 39.75), "us_noaa_nadcon5_nad27"),
    "NAD27 in Alberta": ("EPSG:4267", "EPSG:4269", (-112, 56), "ca_"),
    "ED50 in Spain": ("EPSG:23030", "EPSG:25830", (-4, 40), "es_ign_SPED2ETV2"),
    "DHDN": ("EPSG:31467", "EPSG:25832", (9, 48.7), "de_"),
    "Tokyo": ("EPSG:30169", "EPSG:2451", (139.7, 35.6), "tky2jgd.gsb of the survey authority"),
    "JGD2000 before the earthquake": (
        "EPSG:2452", "EPSG:6678", (141.5, 38.4), "touhokutaiheiyouoki2011.gsb of the survey",
    ),
    "AGD66": ("EPSG:20255", "EPSG:28355", (147, -38), "au_icsm_A66_National"),
    "NZGD49": ("EPSG:27200", "EPSG:2193", (175, -40), "nz_linz_nzgd2kgrid0005"),
}  # fmt: skip


@pytest.mark.parametrize(("crs", "other", "place", "grid"), GRIDS.values(), ids=GRIDS)
def test_the_grid_that_joins_two_datums_is_that_of_the_place(crs, other, place, grid):
    told = loosely_known(*place, crs, other)
    assert f"between {crs} and {other} to" in told and grid in told


@pytest.mark.parametrize("place", [(3, 48.7), (19, 52)])
def test_no_grid_of_another_country_is_named(place):
    """ED50 in France and Poland has none; Spain's was named."""
    assert "es_ign" not in loosely_known(*place, "EPSG:23031", "EPSG:25831")


# A system, a place in it and what the sentence has to name.
REFUSED = {
    "OSGB36": ("EPSG:27700", (400000, 300000), "uk_os_OSTN15_NTv2_OSGBtoETRS.tif, which is not"),
    "NGF-IGN69": ("EPSG:2154+5720", (700000, 6600000), "fr_ign_"),
    "AHD": ("EPSG:28355+5711", (500000, 5800000), "au_ga_AUSGeoid09"),
    "CGVD28": ("EPSG:2950+5713", (300000, 5050000), "ca_nrc_HT2"),
    "CGVD2013": (
        "EPSG:2950+6647", (300000, 5050000),
        r"NAD83\(CSRS\)v6, with ca_nrc_CGG2013n83.tif: `pyproj sync --file ca_nrc_CGG2013n83`",
    ),
    # Its height system has a grid, of Slovakia.
    "EVRF2007 in Poland": ("EPSG:2180+5621", (500000, 500000), "EPSG:2180.5621 and the ellipsoid:"),
    "JGD2000 with heights": ("EPSG:2451+6694", (-10000, -40000), "no way between the heights"),
    "JGD2011 with heights": ("EPSG:6677+6695", (-10000, -40000), "jp_gsi_gsigeo2011"),
    "Pulkovo with heights": ("EPSG:28406+5705", (6500000, 6100000), "no way between the heights"),
    "NAVD88": ("EPSG:26913+5703", (500000, 4400000), "us_noaa_.* which are not installed"),
}  # fmt: skip


@pytest.mark.parametrize(("crs", "place", "said"), REFUSED.values(), ids=REFUSED)
def test_a_national_system_whose_grid_is_missing_is_refused_with_the_way_to_it(crs, place, said):
    try:
        found = convert(np.array([[*place, 100.0]]), crs, "EPSG:4979")
    except InputError as error:
        assert re.search(said, str(error)), error
        heights = "heights above the ellipsoid" in str(error) or "give them above" in str(error)
        assert heights == ("+" in crs)
    else:  # the grid is installed
        assert np.isfinite(found).all()


def test_an_unknown_crs_is_refused():
    with pytest.raises(InputError, match=r"'EPSG:99' is not a known coordinate system"):
        convert(somewhere(), "EPSG:4979", "EPSG:99")


def lambert_93_scale(lat_deg):
    """Snyder 1987, eqs. 14-15, 15-8, 15-9, 15-6 (with parallels 44 and 49), 15-10 on GRS 80."""
    f = 1 / 298.257222101
    e = np.sqrt(f * (2 - f))
    lat, one, two = np.radians([lat_deg, 44, 49])

    def m(x):
        return np.cos(x) / np.sqrt(1 - e**2 * np.sin(x) ** 2)

    def t(x):
        return np.tan(np.pi / 4 - x / 2) / ((1 - e * np.sin(x)) / (1 + e * np.sin(x))) ** (e / 2)

    n = np.log(m(one) / m(two)) / np.log(t(one) / t(two))
    return m(one) * (t(lat) / t(one)) ** n / m(lat)


@pytest.mark.parametrize("lat", [43.0, 44.0, 45.83, 49.0, 50.5])
def test_distances_in_lambert_93_have_snyders_scale(lat):
    """600 m east at the height of the ellipsoid; the curvature changes its length by 0.0002 mm."""
    ends = Local(lat, 5.78).to_crs(np.array([[-300.0, 0, 0], [300.0, 0, 0]]), "EPSG:2154")
    length = np.linalg.norm(np.diff(ends[:, :2], axis=0))
    assert length == pytest.approx(600 * lambert_93_scale(lat), abs=1e-5)
