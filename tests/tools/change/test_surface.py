"""M3C2 distances, volumes, and their standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from made import adjusted, flown, joint, middle

import corridor
from corridor.core.errors import InputError
from corridor.tools.change import (
    Settlement,
    Slide,
    make_cores,
    moved_ground,
    surface_change,
    volume,
)
from corridor.tools.change.explanation import gathered
from corridor.tools.change.registration import motions_at


def test_a_block_that_rises_as_a_whole_rises_everywhere(pair, cores):
    """By hand: every point 7 mm up moves the mean along an upright normal by 7 mm."""
    flat = make_cores(pair.before.xyz, pair.after.xyz, spacing=12.0, normal="vertical")
    at_rest = surface_change(pair, flat, sampled=False)
    epoch = pair.after.epoch
    epoch.xyz[:, 2] += 0.007
    try:
        risen = surface_change(pair, flat, sampled=False)
    finally:
        epoch.xyz[:, 2] -= 0.007
    np.testing.assert_allclose(risen.distance - at_rest.distance, 0.007, atol=1e-12)
    np.testing.assert_allclose(risen.sigma, at_rest.sigma, rtol=1e-9)


def test_the_distance_is_the_mean_along_the_normal(pair, surface):
    """Lague et al. 2013, written out for one core point."""
    cores, k = surface.cores, len(surface) // 2
    normal, centre = cores.normal[k], cores.xyz[k]
    away = pair.before.xyz - centre
    along = away @ normal
    aside = np.linalg.norm(away - np.outer(along, normal), axis=1)
    inside = (aside <= cores.radius) & (np.abs(along) <= cores.reach)
    assert surface.count[k, 0] == inside.sum()
    change = (pair.after.xyz - pair.before.xyz)[inside] @ normal
    assert surface.distance[k] == pytest.approx(change.mean(), abs=1e-12)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_fitted_surface_follows_a_slope_and_a_bend(pair, cores, degree):
    """Weights of a polynomial reproduce polynomials: a fit to any other points gives the same."""
    from corridor.tools.change.m3c2 import members

    found = members(pair.before, cores, degree)
    usable = np.flatnonzero(found.count > 8)
    sums = np.bincount(found.core, found.weight, minlength=len(cores))
    np.testing.assert_allclose(sums[usable], 1.0, atol=1e-9)


def test_sampling_is_the_roughness_over_the_number_of_points(pair, cores):
    """Lague's s / sqrt(n) of both dates where the ground is roughest, and more where a few points
    make it look smoother than around; a little less is the points' own noise."""
    apart = surface_change(pair, cores, sampled=True)
    lague = np.sqrt(np.sum(apart.roughness**2 / apart.count, axis=1))
    assert np.all(apart.sampling > 0.9 * lague)
    roughest = np.argmax(lague)
    assert apart.sampling[roughest] == pytest.approx(lague[roughest], rel=0.01)


def test_a_cell_is_no_surer_than_its_own_few_points(pair, cores):
    """That others hold many says nothing of how rough the ground is here."""
    few = surface_change(pair, cores, sampled=True)
    many = replace(few, count=few.count.copy())
    few.count[0], many.count[0] = 5, 50
    told = []
    for surface in (few, many):
        evidence = gathered(pair, None, surface, ())
        told.append(evidence.freedom[evidence.cells[:, [0]].nonzero()[0]][0])
    assert told[0] < 0.5 * told[1]


def test_neighbouring_cells_err_together(pair, cores):
    """The sigma of a volume is far above that of as many independent cells."""
    x, y = middle()
    polygon = np.array([[x - 15, y - 10], [x + 15, y - 10], [x + 15, y + 10], [x - 15, y + 10]])
    found = volume(pair, polygon, cores, sampled=False)
    assert found.area == pytest.approx(600.0, rel=0.15)
    assert found.sigma > 3 * found.independent


@pytest.mark.parametrize("kind", ["translation", "rigid"])
def test_a_volume_is_laid_together_like_its_surface(pair, cores, kind):
    """Half a metre higher as a whole, or turned a little, it is the same where the datum is what
    stands still: the motion of the surface goes on into a polygon that lies to the side."""
    x, y = middle()
    polygon = np.array([[x + 10, y - 8], [x + 30, y - 8], [x + 30, y + 12], [x + 10, y + 12]])

    def laid():
        surface = surface_change(pair, cores, sampled=False, datum="stable", kind=kind)
        return volume(pair, polygon, cores, sampled=False, registration=surface.registration)

    at_rest, epoch = laid(), pair.after.epoch
    column, size = (2, 0.5) if kind == "translation" else (4, np.radians(0.05))
    motion = size * motions_at(epoch.xyz, kind)[:, :, column]
    epoch.xyz[:] += motion
    try:
        risen = laid()
        plain = volume(pair, polygon, cores, sampled=False)
    finally:
        epoch.xyz[:] -= motion
    assert risen.value == pytest.approx(at_rest.value, abs=1e-3)
    if kind == "translation":
        assert plain.value == pytest.approx(0.5 * plain.area, rel=0.05)


def test_what_stands_still_tells_errors_that_nobody_knows(pair, cores):
    """Ground that waves by 0.1 m where the sigmas say millimetres: laid on what stands still, they
    are multiplied, and next to nothing is significant; a datum as stated calls most of it moved."""
    epoch = pair.after.epoch
    wave = 0.1 * np.sin(epoch.xyz[:, 0] / 7.0)
    epoch.xyz[:, 2] += wave
    try:
        options = {"sampled": False, "kind": "rigid"}
        laid = surface_change(pair, cores, datum="stable", **options)
        stated = surface_change(pair, cores, **options)
    finally:
        epoch.xyz[:, 2] -= wave
    assert laid.registration.scale > 2.0 and stated.moved.mean() > 0.5 and laid.moved.mean() < 0.05
    assert np.median(np.abs(laid.distance / laid.sigma)) == pytest.approx(0.6745, abs=0.01)


def test_a_radius_without_points_is_refused(pair, cores):
    with pytest.raises(InputError, match="no core point has 5 tie points within 0.1 m"):
        surface_change(pair, replace(cores, radius=0.1), sampled=False)


def test_a_slide_is_found_where_it_is():
    centre = middle()
    moved = corridor.adjust(flown(10, Slide(centre, 14.0, (0.0, 0.0, -0.05))))
    pair = joint(adjusted(10), moved)
    cores = make_cores(pair.before.xyz, pair.after.xyz, spacing=6.0)
    found = surface_change(pair, cores, sampled=False)
    away = np.linalg.norm(found.cores.xyz[:, :2] - centre, axis=1)
    inside = away < 14.0 - found.cores.radius
    assert inside.sum() >= 2
    z = (found.distance[inside] * found.cores.normal[inside, 2] + 0.05) / found.total[inside]
    # Same noise at both dates: only what the motion does to the geometry is left.
    assert np.abs(z).max() < 1.0
    assert np.abs(found.distance[away > 14.0 + found.cores.radius]).max() < 0.005


def test_ground_that_does_not_move_moves_no_image_point():
    block = flown(10)
    same = moved_ground(block, lambda xyz: np.zeros_like(xyz))
    np.testing.assert_array_equal(same.tie_points[["x", "y"]], block.tie_points[["x", "y"]])


def test_ground_may_move_more_than_once():
    """A table may hold its coordinates as one array, which pandas shows and does not give."""
    block = flown(10)

    def up(xyz):
        return np.broadcast_to([0.0, 0.0, 0.01], xyz.shape)

    twice = moved_ground(moved_ground(block, up), up)
    np.testing.assert_allclose(twice.points["z"] - block.points["z"], 0.02, atol=1e-12)


def test_a_bowl_is_as_deep_as_it_says():
    bowl = Settlement((0.0, 0.0), 10.0, 0.02, edge=0.5)
    moved = bowl(np.array([[0.0, 0, 0], [4.9, 0, 0], [7.5, 0, 0], [10.0, 0, 0]]))
    np.testing.assert_allclose(moved[:, 2], [-0.02, -0.02, -0.01, 0.0], atol=1e-12)
