"""What held-out data say, on adjustments made up for the purpose."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from corridor.diagnosis.verification import held_out


def fit(tie, check, points=8):
    """An adjustment of 400 held-out residuals of this size, px, and check points, m.

    The check points are all off by as much, in one direction, and known to 3 cm an axis.
    """
    rng = np.random.default_rng(1)
    residual = tie * rng.standard_normal((400, 2))
    names = [f"P{k}" for k in range(points)]
    block = SimpleNamespace(
        ground=pd.DataFrame({"point": names}),
        ground_sigma=lambda: np.zeros((points, 3)),
    )
    checks = pd.DataFrame({"point": names}).assign(
        **dict.fromkeys(("dx", "dy", "dz"), check / np.sqrt(3)),
        **dict.fromkeys(("s_dx", "s_dy", "s_dz"), 0.03),
    )
    return SimpleNamespace(
        system=SimpleNamespace(
            block=block, images=SimpleNamespace(names=["A"]),
            points=SimpleNamespace(names=np.arange(400).astype(str)),
            image_rows=SimpleNamespace(image=np.zeros(400, dtype=int), point=np.arange(400)),
            residuals=lambda: SimpleNamespace(pixels=residual),
        ),
        check_points=checks, check_rms=SimpleNamespace(d3=check), block=block,
    )  # fmt: skip


ROWS = pd.MultiIndex.from_product([["A"], np.arange(400).astype(str)])


@pytest.mark.parametrize(
    ("tie", "check", "points", "stays"),
    [(0.30, 0.010, 8, True), (0.34, 0.010, 8, False), (0.30, 0.040, 8, False),
     (0.30, 0.040, 2, True), (0.30, 0.011, 8, True)],
    ids=["ties better", "ties worse", "check points worse", "too few to tell", "as good"],
)  # fmt: skip
def test_a_correction_stays_only_if_unseen_data_improve(tie, check, points, stays):
    without = fit(0.32, 0.010, points)
    assert held_out.improves(without, fit(tie, check, points), ROWS) == stays


@pytest.mark.parametrize(
    ("tie", "called"), [(0.30, False), (0.32, False), (0.33, False), (0.35, True)]
)
def test_ties_are_predicted_worse_from_a_twentieth_on(tie, called):
    assert held_out.worse(fit(0.32, 0.010), fit(tie, 0.010), ROWS) == called


def test_check_points_decide_before_ties_do():
    """A rival that halves the check-point error is taken, though ties speak 1 % against it."""
    second, rivals = fit(0.300, 0.02), {"datum": fit(0.303, 0.01), "drift": fit(0.290, 0.03)}
    best, share = held_out.preferred(second, rivals, ROWS, 0.8)
    assert best == "datum"
    assert share["datum"] == {"check": pytest.approx(0.5), "tie": pytest.approx(1.01)}


@pytest.mark.parametrize(
    ("tie", "proved", "taken"), [(0.29, True, True), (0.2999, False, False), (0.31, True, False)]
)
def test_ties_decide_where_check_points_are_too_few(tie, proved, taken, monkeypatch):
    """Where they are predicted better, and strip by strip by more than chance."""
    told = SimpleNamespace(proved=proved)
    monkeypatch.setattr(held_out.Prediction, "of_folds", lambda *_: told)
    second, rivals = fit(0.3, 0.02, points=0), {"other": fit(tie, 0.02, points=0)}
    best, share = held_out.preferred(second, rivals, ROWS, 0.8)
    assert best == ("other" if taken else None)
    assert share["other"] == {"tie": pytest.approx(tie / 0.3)}


def test_look_alikes_that_predict_alike_change_nothing():
    second = fit(0.3, 0.02, points=0)
    assert held_out.preferred(second, {"other": fit(0.3, 0.02, points=0)}, ROWS, 0.8)[0] is None
