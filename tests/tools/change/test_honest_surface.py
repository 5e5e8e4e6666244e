"""Surfaces of the same rough ground at other points: errors as large as stated, at every degree."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from corridor.tools.change import make_cores
from corridor.tools.change.epoch import Cloud
from corridor.tools.change.m3c2 import members, roughness, sampling

RADIUS = 4.0


def ground(xy):
    """A dike 4 m high, slopes 1 : 2, and waves of 1 to 3 m with heights of a centimetre."""
    waves = np.random.default_rng(7)
    size, turn = 2 * np.pi / waves.uniform(1.0, 3.0, 40), waves.uniform(0, 2 * np.pi, (2, 40))
    along = xy @ (size * np.array([np.cos(turn[0]), np.sin(turn[0])]))
    z = np.clip(8.0 - 0.5 * np.abs(xy[:, 1]), 0.0, 4.0)
    return z + 0.002 * np.sum(np.sin(along + turn[1]), axis=1)


def cloud(draw, count=1500):
    """Points without any error of their own."""
    xy = draw.uniform([0.0, -20.0], [150.0, 20.0], (count, 2))
    xyz = np.column_stack([xy, ground(xy)])
    own = np.zeros((count, 3, 3))
    epoch = SimpleNamespace(
        xyz=xyz,
        sigma0=1.0,
        adjustment=SimpleNamespace(sigma0=1.0),
        names=np.arange(count),
        own=lambda at: own[at],
    )
    return Cloud(epoch, np.arange(count), {})


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_errors_are_as_large_as_stated(degree):
    """Pairs of dates; 5 % beyond 1.96 sigmas would be right, and a root mean square of 1.

    So are the errors of means over 30 m of the dike, in which the bends of its edges cancel.
    """
    draw, z, means = np.random.default_rng(5), [], []
    for _ in range(6):
        pair = cloud(draw), cloud(draw)
        cores = make_cores(pair[0].xyz, pair[1].xyz, 0.5 * RADIUS, RADIUS)
        found = [members(one, cores, degree) for one in pair]
        kept = np.flatnonzero(np.min([one.count for one in found], axis=0) >= 9)
        cores = cores.only(kept)
        found = [members(one, cores, degree) for one in pair]
        rough, _ = roughness(pair, found, cores)
        uneven, error = sampling(pair, found, rough), found[1].mean - found[0].mean
        z.append(error / np.sqrt(np.sum(uneven.toarray() ** 2, axis=1)))
        part = (cores.xyz[:, 0] // 30.0).astype(int)
        mean = (part == np.arange(5)[:, None]) / np.bincount(part, minlength=5)[:5, None]
        means.append(mean @ error / np.sqrt(np.sum((mean @ uneven.toarray()) ** 2, axis=1)))
    z = np.concatenate(z)
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15
    assert np.mean(np.abs(z) > 1.96) < 0.09
    means = np.concatenate(means)
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], len(means)) / len(means))
    assert low < np.sqrt(np.mean(means**2)) < high
