"""Dates whose datum floats by metres and degrees, brought near each other."""

from dataclasses import replace

import numpy as np
import pytest
from made import adjusted, joint
from scipy.spatial.transform import Rotation

from corridor.core.geometry import Similarity
from corridor.tools.change import Joint, displacements
from corridor.tools.change.epoch import Epoch
from corridor.tools.change.registration import registered

TURN = Rotation.from_euler("xyz", [1.0, -1.0, 3.0], degrees=True).as_matrix()


def floating(cloud, scale, turn=TURN):
    """The cloud in another datum."""
    return replace(cloud, epoch=Epoch(cloud.epoch.adjustment, Similarity(scale, turn, [4, -3, 20])))


@pytest.mark.parametrize(("same_ties", "within"), [(True, 0.005), (False, 0.03)])
@pytest.mark.parametrize(("kind", "scale"), [("rigid", 1.0), ("similarity", 1.02)])
def test_a_date_that_floats_comes_back(kind, scale, same_ties, within):
    """To millimetres and centimetres: what the noise of both dates leaves open."""
    pair = joint(adjusted(10), adjusted(11), same_ties)
    back = registered(pair.before, floating(pair.after, scale), kind, same_ties)
    assert np.sqrt(np.mean((back.xyz - pair.after.xyz) ** 2)) < within


def test_covariances_turn_and_grow_with_the_points(pair):
    """A displacement in a datum that is turned by 3 degrees and twice as large."""
    names = list(pair.before.named)[:2]
    both = [floating(cloud, 2.0) for cloud in (pair.before, pair.after)]
    there = Joint(*both, common=()).covariance(displacements(*both, names))
    here = Joint(pair.before, pair.after, common=()).covariance(
        displacements(pair.before, pair.after, names)
    )
    turn = np.kron(np.eye(2), 2.0 * TURN)
    np.testing.assert_allclose(there, turn @ here @ turn.T, rtol=1e-6, atol=1e-9)
