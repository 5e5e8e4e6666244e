"""What chapter 2 makes of the flights over the dike."""

import numpy as np
import pandas as pd
import pytest
from kit import arms


def test_the_table_holds_what_is_planned():
    table = arms.read()
    assert set(arms.PLANNED) == set(table[arms.COLUMNS].itertuples(index=False, name=None))
    # No verdict from one draw.
    assert table.groupby(arms.COLUMNS[:3]).size().min() >= 8


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


@pytest.mark.slow
def test_a_draw_made_again_is_the_one_in_the_table():
    stored = arms.read().set_index(arms.COLUMNS).loc["s1", 0.3, 1.0, 5]
    for name, value in arms.draw("s1", 0.3, 1.0, 5).items():
        assert stored[name] == pytest.approx(value, abs=0.02), name
