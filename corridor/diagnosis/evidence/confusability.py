"""Which effects a flight cannot tell apart, whatever is hidden in it.

Two effects are alike where, after poses, points and camera have absorbed what they can, the one
explains what the other does. That is the flight's doing: M holds it, no measurement is needed.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.groups import Group


def confusability(evidence: Evidence, slugs: Iterable[str] | None = None) -> pd.DataFrame:
    """Share of what one effect does (row) that another alone would explain (column), 0 to 1.

    Of an effect of several parameters, all as large as their prior; of an effect of single control
    points, the point that imitates or is imitated best. slugs: which effects; default: all named
    ones that this block shows at all. Effects with values for each image stay out: they imitate
    nearly everything, and pay for it in evidence.
    """
    groups = [
        g
        for g in evidence.groups
        if not g.generic and g.own is None and (slugs is None or g.slug in slugs)
    ]
    seen = [
        g for g in groups if np.trace(evidence.block(g)[0]) > SETTINGS.blind_information * len(g)
    ]
    names = list(dict.fromkeys(g.slug for g in seen))
    table = pd.DataFrame(np.eye(len(names)), index=names, columns=names)
    for b in seen:
        own = evidence.block(b)[0]
        factor = np.linalg.inv(own + np.eye(len(b)) / SETTINGS.prior_of_adjusted**2)
        for a in seen:
            if a.slug != b.slug:
                share = _share(evidence, a, b, factor)
                table.loc[a.slug, b.slug] = max(table.loc[a.slug, b.slug], share)
    return table


def _share(evidence: Evidence, a: Group, b: Group, factor: np.ndarray) -> float:
    between = evidence.across(b, a)
    explained = np.einsum("ij,ik,kj->", between, factor, between, optimize=True)
    return float(np.clip(explained / np.trace(evidence.block(a)[0]), 0.0, 1.0))
