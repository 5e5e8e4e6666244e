"""Which image sees which point: against every point projected into every image."""

import numpy as np
import pytest

from corridor.core.camera import project, undistort
from corridor.core.simulation import Flight, Plan
from corridor.core.simulation.fly import fly
from corridor.core.simulation.views import Network, Views, matched, thin

BEND = ((0.0, 0.0), (0.0, 120.0), (90.0, 190.0))
PLANS = {
    "nadir": (Flight("a", 50.0, images=30),),
    "oblique at two heights": (
        Flight("a", (30.0, 70.0), strips=2, images=24, tilt_deg=35.0, look="alternating"),
    ),
    "looking sideways": (Flight("a", 40.0, images=24, tilt_deg=30.0, look="sideways"),),
    "far ahead, at an angle to the grid": (
        Flight("a", 50.0, images=30, tilt_deg=55.0, stations_m=(90.0, 200.0)),
    ),
    "two cameras": (
        Flight("a", 50.0, images=24),
        Flight("b", 80.0, "mavic2pro", images=24, tilt_deg=20.0, long_side="along"),
    ),
    "in heavy wind": (Flight("a", 50.0, images=30, attitude_jitter_deg=8.0),),
}
BORDER, LOW, HIGH = 10.0, -3.0, 4.0


@pytest.fixture(scope="module", params=PLANS, ids=str)
def seen(request):
    """A flight round a bend, its network, points all over the place, and who sees them."""
    flown = fly(Plan("p", PLANS[request.param], BEND, bend_radius_m=60.0), seed=1)
    network = Network(flown, LOW, HIGH, BORDER)
    draw = np.random.default_rng(2)
    points = draw.uniform((-250, -200, LOW), (350, 400, HIGH), (20_000, 3))
    return flown, network, points, network.look(points)


def unfolded(rays, pixels, interior):
    """Whether pixels lead back to their rays. Far outside, a polynomial folds points back in."""
    return np.abs(undistort(pixels, interior) - rays).max(axis=1) < 1e-6


def by_brute_force(flown, points):
    """(points, images): whether an image contains a point."""
    out = np.zeros((len(points), len(flown.centre)), dtype=bool)
    for i, (centre, rotation) in enumerate(zip(flown.centre, flown.rotation, strict=True)):
        camera = flown.cameras[flown.camera[i]]
        away = (points - centre) @ rotation.T
        ahead = np.flatnonzero(away[:, 2] > 0)
        pixels = project(points[ahead], centre, rotation, camera.interior)
        limit = [camera.width - 1 - BORDER, camera.height - 1 - BORDER]
        inside = ((pixels >= BORDER) & (pixels <= limit)).all(axis=1)
        ahead, pixels = ahead[inside], pixels[inside]
        ahead = ahead[unfolded(away[ahead, :2] / away[ahead, 2:], pixels, camera.interior)]
        out[ahead, i] = True
    return out


def test_a_point_is_seen_in_every_image_that_contains_it_and_in_no_other(seen):
    flown, _, points, views = seen
    expected = by_brute_force(flown, points)
    assert expected.any(axis=0).all()
    found = np.zeros_like(expected)
    found[views.point, views.image] = True
    assert np.array_equal(found, expected)
    # Each ray once, images ascending.
    assert len(views.image) == expected.sum()
    assert np.array_equal(np.nonzero(expected)[1], views.image)


def test_pixels_are_those_of_the_camera(seen):
    flown, network, points, views = seen
    pixels = network.pixels(points, views)
    interior = np.array([camera.interior for camera in flown.cameras])[flown.camera]
    expected = np.empty_like(pixels)
    for i in range(len(flown.centre)):
        mine = views.image == i
        expected[mine] = project(
            points[views.point[mine]], flown.centre[i], flown.rotation[i], interior[i]
        )
    # A dozen float64 operations on numbers up to 5472.
    assert np.abs(pixels - expected).max() < 1e-10


def test_views_of_some_points_are_their_rays_in_the_order_asked_for(seen):
    _, _, _, views = seen
    several = np.flatnonzero(views.multiplicity >= 2)
    unseen = np.flatnonzero(views.multiplicity == 0)
    chosen = np.array([several[5], several[0], unseen[0], several[5]])
    some = views.of(chosen)
    assert some.multiplicity.tolist() == views.multiplicity[chosen].tolist()
    for k, p in enumerate(chosen):
        mine = views.image[views.start[p] : views.start[p + 1]]
        assert some.image[some.start[k] : some.start[k + 1]].tolist() == mine.tolist()
    assert len(views.of(np.empty(0, dtype=np.int64)).image) == 0


def test_rays_and_points_count_the_same():
    views = Views(np.array([0, 2, 2, 5]), np.array([0, 3, 1, 2, 3], dtype=np.int32))
    assert views.multiplicity.tolist() == [2, 0, 3]
    assert views.point.tolist() == [0, 0, 2, 2, 2]


def test_looking_in_several_goes_sees_the_same(seen, monkeypatch):
    _, network, points, views = seen
    monkeypatch.setattr("corridor.core.simulation.views._CHUNK", 7_777)
    shares = []
    again = network.look(points, shares.append)
    assert np.array_equal(again.start, views.start) and np.array_equal(again.image, views.image)
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) == 3


def test_no_points_are_seen_by_nobody(seen):
    views = seen[1].look(np.empty((0, 3)))
    assert views.multiplicity.tolist() == [] and len(views.image) == 0


# --- matching --------------------------------------------------------------------------------


def test_a_matcher_knows_a_point_again_only_from_near_its_reference(seen):
    """Every ray that is left agrees with one and the same ray of its point; none else does."""
    flown, _, points, views = seen
    away = flown.centre[views.image] - points[views.point]
    found = matched(views, away, 20.0, 1.3, np.random.default_rng(5))
    assert len(found.start) == len(views.start)
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    length = np.linalg.norm(away, axis=1)
    for p in np.flatnonzero(views.multiplicity > 1)[:300]:
        mine = slice(views.start[p], views.start[p + 1])
        near = (unit[mine] @ unit[mine].T >= np.cos(np.radians(20.0)) - 1e-9) & (
            np.abs(np.log(length[mine][:, None] / length[mine])) <= np.log(1.3) + 1e-9
        )
        left = found.image[found.start[p] : found.start[p + 1]].tolist()
        assert left in [views.image[mine][one].tolist() for one in near]


def test_a_matcher_without_limits_finds_every_ray(seen):
    flown, _, points, views = seen
    away = flown.centre[views.image] - points[views.point]
    found = matched(views, away, None, None, np.random.default_rng(5))
    assert np.array_equal(found.start, views.start) and np.array_equal(found.image, views.image)


# --- thinning --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dense():
    """Ten times the points that are wanted."""
    flown = fly(Plan("p", (Flight("a", 50.0, images=42, speed_m_s=3.0),)), seed=1)
    draw = np.random.default_rng(3)
    across, along = draw.uniform((-60, 0), (60, 200), (30_000, 2)).T
    points = np.column_stack([across, along, np.zeros(30_000)])
    return Network(flown, 0.0, 1.0, 10.0).look(points)


@pytest.mark.parametrize("target", [50, 215, 440])
def test_images_have_the_number_of_points_asked_for_on_average(dense, target):
    kept = thin(dense, 42, target, np.random.default_rng(0))
    # The last point of an image overshoots; a second pass takes that back.
    assert dense.multiplicity[kept].sum() / 42 == pytest.approx(target, rel=0.02)


def test_thinning_keeps_the_multiplicity(dense):
    """Thesis, section 5.6.4: fewer tie points, each with all its rays."""
    kept = thin(dense, 42, 440, np.random.default_rng(0))
    before = np.bincount(dense.multiplicity[dense.multiplicity >= 2], minlength=30)
    after = np.bincount(dense.multiplicity[kept], minlength=30)
    share = before / before.sum()
    # Four standard errors of a share, and 3 % for the rim, where few images see a point.
    limit = 4 * np.sqrt(share * (1 - share) / after.sum()) + 0.03
    assert np.all(np.abs(after / after.sum() - share) < limit)


def test_points_seen_once_are_dropped_and_each_is_kept_once(dense):
    kept = thin(dense, 42, 440, np.random.default_rng(0))
    assert dense.multiplicity[kept].min() >= 2
    assert np.all(np.diff(kept) > 0)


def test_asking_for_more_than_there_is_keeps_all_that_are_seen_twice(dense):
    kept = thin(dense, 42, 10**6, np.random.default_rng(0))
    assert kept.tolist() == np.flatnonzero(dense.multiplicity >= 2).tolist()


def test_a_point_folded_twice_by_the_distortion_is_not_seen():
    """Beyond 65 degrees off its axis the polynomial of the P1 brings far points in again."""
    flight = Flight(
        "a", (20.0, 120.0), "dji_p1", strips=2, images=12, tilt_deg=60.0, look="sideways"
    )
    flown = fly(Plan("p", (flight,), ((0.0, 0.0), (34.2, 94.0))), seed=1)
    draw = np.random.default_rng(2)
    points = draw.uniform((-1500, -1500, LOW), (1500, 1500, HIGH), (60_000, 3))
    views = Network(flown, LOW, HIGH, BORDER).look(points)
    assert by_brute_force(flown, points)[views.point, views.image].all()
