"""Pictures of the thermal effect: they say what they show, with units, also of broken series."""

import numpy as np
from kit.wall import Course, simulated_maps

from corridor.interface import figures
from corridor.tools import thermal


def series():
    course = Course(np.linspace(0, 2000, 20), off_s=1000)
    return simulated_maps(course, thermal.simple_model(1280, 960, shift=((0.01, -0.02),)))


def labels(figure):
    return [label for a in figure.axes for label in (a.get_xlabel(), a.get_ylabel()) if label]


def test_maps_have_one_scale_a_row_and_units():
    figure = figures.deformation_maps(series())
    titled = [a for a in figure.axes if a.collections and a.get_title(loc="left")]
    meshes = [a.collections[0] for a in titled if a.get_title(loc="left") != "dx and dy"]
    named = {m.axes.get_title(loc="left"): m for m in meshes}
    upper = [m for name, m in named.items() if "less its mean" in name]
    lower = [m for name, m in named.items() if "null map" in name]
    for row in (upper, lower):
        ((low, high),) = {(m.norm.vmin, m.norm.vmax) for m in row}
        assert low == -high  # nothing moved is in the middle of the colours
    assert len(upper) == 2 and len(lower) == 2
    assert named["predicted sigma"].norm.vmin == 0
    assert all("px" in label for label in labels(figure))


def test_what_is_below_zero_is_hatched():
    maps = series()
    figure = figures.deformation_maps(maps)
    axes = next(a for a in figure.axes if a.get_title(loc="left").startswith("dx less"))
    below = [c for c in axes.collections if c.get_hatch()]
    values = maps.dx[np.argmax(np.hypot(maps.dx, maps.dy).mean(axis=1))]
    assert len(below) == 1
    assert len(below[0].get_paths()) == np.count_nonzero(values < values.mean())


def test_the_map_shown_is_the_one_that_moved_most():
    maps = series()
    figure = figures.deformation_maps(maps)
    hottest = maps.picture[np.argmax(np.hypot(maps.dx, maps.dy).mean(axis=1))]
    assert any(hottest in text.get_text() for text in figure.texts)


def test_nodes_that_are_not_valid_stay_white():
    maps = series()
    for name in ("dx", "dy", "sigma"):
        getattr(maps, name)[:, :50] = np.nan
    maps.valid[:, :50] = False
    figure = figures.deformation_maps(maps)
    shown = [a.collections[0] for a in figure.axes if a.get_title(loc="left").startswith("dx less")]
    assert np.ma.count_masked(np.ma.masked_invalid(shown[0].get_array())) == 50


def test_a_series_without_any_match_says_so():
    maps = series()
    maps.valid[:] = False
    assert "No picture" in figures.deformation_maps(maps).texts[-1].get_text()


def test_warming_and_cooling_have_two_colours():
    figure = figures.thermal_parameters(thermal.fit(series()))
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()][:2] == ["warming", "cooling"]
    axes = next(a for a in figure.axes if "scale" in a.get_ylabel())
    points = [line for line in axes.lines if line.get_linestyle() == "None"]
    assert len({line.get_color() for line in points}) == 2
    assert sum(len(line.get_xdata()) for line in points) == 19
    assert all("(" in label for label in labels(figure))


def test_two_cameras_are_shown_with_their_distance():
    from corridor.core.simulation import CAMLIGHT

    found = thermal.compare_cameras(CAMLIGHT, CAMLIGHT.with_values(f=5490.0))
    figure = figures.camera_difference(found)
    assert any(f"{found.mean:.4f} px" in text.get_text() for text in figure.texts)
