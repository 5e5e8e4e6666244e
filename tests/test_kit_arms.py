"""What chapter 2 makes of the flights over the dike."""

import numpy as np
import pandas as pd
from kit import arms


def test_no_verdict_is_from_one_draw():
    assert arms.TABLE.read().groupby(arms.COLUMNS[:3]).size().min() >= 8


def test_a_new_draw_is_as_rare_as_it_says():
    """Of 400 new draws a tenth lies where less than a tenth is said to: 40, give or take 6."""
    draw = np.random.default_rng(3)
    mixed = np.array([[3.0, 0.0], [-4.0, 1.0]])
    rare = 0
    for _ in range(400):
        *kept, new = draw.standard_normal((13, 2)) @ mixed.T
        kept = pd.DataFrame(kept, columns=["arm_0", "arm_1"])
        rare += arms.chance(kept, {"arm_0": new[0], "arm_1": new[1]}) < 0.1
    assert 40 - 3 * 6 < rare < 40 + 3 * 6
