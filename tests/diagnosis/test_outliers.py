"""Wrong matches that are more than wrong matches, on residuals drawn for the purpose."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.diagnosis.generator import single
from benchmarks.diagnosis.generator.generate import generate
from corridor.core.adjustment import ImageRows
from corridor.diagnosis.anomalies.wrong_matches import broken_picture, outlier_clusters
from corridor.diagnosis.diagnosing import diagnose

IMAGES, EACH, SIZE = 60, 120, np.array([5120, 3840])
SIGMA = 0.3


def drawn(seed, wrong=0.05, pane=None, larger=None, car=0, astray=0):
    """An adjustment with residuals alone: 60 images of 120 points, five rays each.

    A strip: x of a point hardly changes from image to image, y by a fifth of the picture.
    wrong: share of wrong matches, or a function of x, y (px) and image that gives it. pane: (x at
    its rim, shift in px): the rays of a point that are fewer on their side of the rim are off.
    larger: factor on the noise by x. car: points on one, seen moved in the second of two images.
    astray: points that two images match wrongly alike, at one line, beside 8 pairs with one each.
    """
    rng = np.random.default_rng(seed)
    points = IMAGES * EACH // 5
    first = rng.integers(0, IMAGES - 4, points)
    image = (first[:, None] + np.arange(5)).ravel()
    x = np.repeat(rng.uniform(60, SIZE[0] - 60, points), 5) + rng.normal(0, 25, 5 * points)
    y = SIZE[1] * (np.tile(np.arange(5), points) + np.repeat(rng.uniform(0, 1, points), 5)) / 5
    place = np.column_stack([np.clip(x, 0, SIZE[0] - 1), np.clip(y, 0, SIZE[1] - 1)])
    n = len(place)
    residual = SIGMA * rng.standard_normal((n, 2)) * np.sqrt(0.8)
    if larger:
        residual *= larger(place[:, 0])[:, None]
    share = wrong(*place.T, image) if callable(wrong) else wrong
    gross = rng.random(n) < share
    way, length = rng.uniform(0, 2 * np.pi, n), rng.uniform(3, 30, n)
    residual[gross] += (length * [np.cos(way), np.sin(way)]).T[gross]
    if pane:
        beyond = (place[:, 0] > pane[0]).reshape(-1, 5)
        few = beyond == (beyond.sum(axis=1) < 3)[:, None]
        sign = np.where(beyond, 1.0, -1.0) * (few & ~few.all(axis=1)[:, None])
        residual[:, 0] += pane[1] * sign.ravel()
    for k in range(car):
        place[5 * k : 5 * k + 5] = rng.uniform([2400, 1800], [2420, 1820])
        place[5 * k : 5 * k + 5, 0] += np.arange(5)
        image[5 * k : 5 * k + 5] = np.arange(5)
        residual[5 * k + 2 : 5 * k + 5, 0] += 3.0
    for k in range(astray + 8 if astray else 0):
        pair = 10 if k < astray else 10 + 5 * (k - astray + 1)
        place[5 * k : 5 * k + 5] = rng.uniform([100, 1995], [5000, 1998])
        place[5 * k + 1, 1] += 10
        place[5 * k + 2 : 5 * k + 5, 1] += [700, 1000, 1300]
        image[5 * k : 5 * k + 2] = pair, pair + 1
        residual[5 * k + 1, 1] += 4.0 if k < astray or k % 2 else 0.0
    images = SimpleNamespace(
        size=np.tile(SIZE, (IMAGES, 1)), time=100 + 2.0 * np.arange(IMAGES),
        names=[f"I{k:02d}" for k in range(IMAGES)], camera=np.zeros(IMAGES, int),
        flight=np.zeros(IMAGES, int), flight_names=["F1"],
    )  # fmt: skip
    rows = ImageRows(
        image, np.arange(n) // 5, np.ones(n, bool), np.arange(n), place + residual,
        np.full(n, SIGMA),
    )  # fmt: skip
    residuals = SimpleNamespace(pixels=residual)
    system = SimpleNamespace(images=images, image_rows=rows, residuals=lambda: residuals)
    return SimpleNamespace(system=system)


class TestABrokenPicture:
    @pytest.mark.parametrize("rim", [1800.0, 3300.0])
    def test_is_told_with_its_line_and_its_shift(self, rim):
        """4 sigma: within the reach of what counts as a match that is wrong."""
        one = broken_picture(drawn(1, pane=(rim, 1.5)))
        low, _, high, _ = one.location["image"]
        # The smaller side is the one that is covered, to the density of points across the rim.
        assert (low, high) == (
            (0.0, pytest.approx(rim, abs=15))
            if rim < 2560
            else (pytest.approx(rim, abs=15), 5119.0)
        )
        # Some 15 differences, each of 0.4 px.
        shift = float(re.search(r"jump by x = (\S+),", one.where)[1])
        assert shift == pytest.approx(1.5, abs=0.4)
        assert one.kind == "unknown"

    @pytest.mark.slow
    def test_wrong_matches_all_over_the_picture_break_nothing(self):
        """200 blocks with 5 % wrong matches at the level 0.1 %: 2 and more once in fifty times."""
        assert sum(bool(broken_picture(drawn(seed))) for seed in range(200)) <= 1

    def test_noise_that_is_larger_on_one_side_breaks_nothing(self):
        for seed in range(20):
            assert broken_picture(drawn(seed, larger=lambda x: 1 + 2 * (x > 4000))) is None

    def test_a_car_is_no_pane(self):
        """Forty points jump alike across one line, all in the same images."""
        assert broken_picture(drawn(3, wrong=0.01, car=40)) is None

    def test_two_images_that_go_wrong_alike_are_no_pane(self):
        """Eight points of one pair, and one in every other of eight more: as matching does it."""
        assert sum(bool(broken_picture(drawn(k, wrong=0.01, astray=8))) for k in range(20)) == 0


class TestACrowd:
    def test_of_wrong_matches_in_the_picture_is_told_with_its_place(self):
        def drop(x, y, image):
            return np.where((np.abs(x - 1500) < 350) & (np.abs(y - 2400) < 350), 0.3, 0.02)

        (alarm,) = outlier_clusters(drawn(1, wrong=drop))
        left, top, right, bottom = alarm["location"]["image"]
        assert left < 1500 < right and top < 2400 < bottom and right - left < 1300
        assert alarm["quantity"] == "wrong matches" and alarm["ratio"] > 3
        assert "wrong matches crowd between x = " in alarm["where"]

    def test_of_wrong_matches_in_some_images_is_told_with_its_time(self):
        def blurred(x, y, image):
            return np.where((image >= 30) & (image < 34), 0.3, 0.02)

        (alarm,) = outlier_clusters(drawn(2, wrong=blurred))
        assert alarm["location"]["flight"] == "F1"
        assert alarm["location"]["time_s"] == pytest.approx(163, abs=4)

    def test_wrong_matches_all_over_the_block_are_none(self):
        """200 blocks, two kinds of places at the level 0.1 %: 3 and more once in a hundred."""
        assert sum(bool(outlier_clusters(drawn(seed))) for seed in range(200)) <= 2

    def test_images_that_are_all_a_little_better_or_worse_are_none(self):
        """The share of wrong matches of an image varies by half of itself."""
        rate = np.random.default_rng(0).gamma(4.0, 0.05 / 4.0, (50, IMAGES))
        found = [
            outlier_clusters(drawn(k, wrong=lambda x, y, i, k=k: rate[k][i])) for k in range(50)
        ]
        assert sum(map(bool, found)) <= 1


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(4, id="on the outer side"),
        pytest.param(2_304_029, id="on the inner side", marks=pytest.mark.slow),
    ],
)
def test_a_pane_that_few_points_cross_is_told_at_its_rim_and_not_without_it(seed):
    """Some sixty of 6,000 observations are of points on its rim.

    Where it covers the outer side of the strips, no shape that is fitted to all of them sees it.
    """
    hidden = generate(single("window", 1.0, images=40, observations=150), seed)
    (one,) = diagnose(hidden.block).unknown
    assert one["group"] == "image_steps"
    low, _, high, _ = one["location"]["image"]
    start, _, end, _ = hidden.truth["effects"][0]["where"]["image"]
    # The lines that are tried are 10 px apart.
    assert (low, high) == pytest.approx((start, end), abs=30)
    assert diagnose(hidden.twin).unknown == []
