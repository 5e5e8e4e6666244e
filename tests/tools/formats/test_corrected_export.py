"""A corrected export is the same block to a program that knows no effects."""

from pathlib import Path

import numpy as np
import pytest

import corridor
from corridor.tools.formats import export_project, prove, read_adjusted, read_project

PLAN = Path(__file__).parents[3] / "data_synthetic" / "dike.toml"


@pytest.fixture(scope="module")
def adjusted():
    """Ten camera parameters, one lever arm a flight, a rolling shutter; no control, 11 checks."""
    flown = corridor.simulate(
        PLAN,
        {"rolling_shutter": {"readout": 0.03}, "affine_distortion": {"b1": 4e-4, "b2": -3e-4}},
        seed=5,
    )
    points = list(flown.ground["point"])
    return corridor.adjust(
        flown, camera="fraser10", effects=["rolling_shutter"], control=[], check=points
    )


@pytest.fixture(scope="module")
def exported(adjusted, tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    adjusted.save(folder / "result")
    block, effects = read_adjusted(folder / "result")
    export_project(block, "colmap", folder / "colmap", effects=effects, corrected=True)
    return folder / "colmap"


def test_the_result_of_an_adjustment_knows_its_effects(adjusted, exported):
    _, effects = read_adjusted(exported.parent / "result")
    assert effects["rolling_shutter"]["readout"] == pytest.approx(0.03, abs=0.002)
    arms = adjusted.lever_arm
    assert len(arms) == 2 and not arms["fixed"].any()


def test_residuals_stay_what_they_were(adjusted, exported):
    """What was taken out are effects and b1, b2; the noise of 0.4 px is left."""
    proof = prove(read_project(exported))
    lengths = [np.hypot(t["vx"], t["vy"]) for t in adjusted.residuals.values() if "vx" in t][:2]
    mine = np.sqrt(np.mean(np.concatenate(lengths) ** 2))
    theirs = np.sqrt(
        sum(found.count * found.rms**2 for found in proof.by_kind.values())
        / sum(found.count for found in proof.by_kind.values())
    )
    assert theirs == pytest.approx(mine, rel=0.01)


def test_pycolmap_finds_our_check_points_within_a_millimetre(adjusted, exported):
    """Poses, tie points and ground points free; camera and lever arms those of our adjustment."""
    pycolmap = pytest.importorskip("pycolmap", reason="the extra `images` is not installed")
    model = pycolmap.Reconstruction(str(exported))
    rng = np.random.default_rng(2)
    for point in model.points3D.values():  # it must find them, not be handed them
        point.xyz = point.xyz + rng.normal(0, 0.05, 3)
    block = adjusted.block
    names = {image.name: image for image in model.images.values()}
    rows = [line.split() for line in (exported / "reference.txt").read_text().splitlines()]
    sigma = dict(zip(block.gnss["image"], block.gnss_sigma(), strict=True))
    priors = []
    for number, (name, *place) in enumerate(rows, start=1):
        prior = pycolmap.PosePrior()
        prior.pose_prior_id = number
        prior.corr_data_id = names[name].data_id
        prior.position = np.array([float(word) for word in place])
        # COLMAP's pixels have one sigma of 1 px, ours of 0.4 px.
        prior.position_covariance = np.diag(sigma[name] ** 2) / 0.4**2
        prior.coordinate_system = pycolmap.PosePriorCoordinateSystem.CARTESIAN
        priors.append(prior)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = False
    options.refine_principal_point = options.print_summary = False
    options.ceres.solver_options.function_tolerance = 1e-14
    options.ceres.solver_options.gradient_tolerance = 1e-12
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.images:
        config.add_image(number)
    adjuster = pycolmap.create_pose_prior_bundle_adjuster(
        options, pycolmap.PosePriorBundleAdjustmentOptions(), config, priors, model
    )
    adjuster.solve()

    table = exported / "ground_points.csv"
    ids = [line.split(",")[:2] for line in table.read_text().splitlines()[2:]]
    given = block.ground.set_index("point")[["x", "y", "z"]]
    ours = adjusted.check_points.set_index("point")
    assert len(ours) == 11
    away = []
    for number, name in ids:
        theirs = model.points3D[int(number)].xyz - given.loc[name].to_numpy()
        away.append(theirs - ours.loc[name, ["dx", "dy", "dz"]].to_numpy(float))
    away = np.array(away)
    print(f"largest difference of {len(away)} check points: {1000 * np.abs(away).max():.3f} mm")
    assert np.abs(away).max() < 0.001


def test_without_correction_the_check_points_are_elsewhere(adjusted, exported):
    """The lossy export carries the shutter on: its residuals are visibly larger."""
    block, effects = read_adjusted(exported.parent / "result")
    folder = exported.parent / "lossy"
    export_project(block, "colmap", folder, effects=effects, lossy=True)
    assert prove(read_project(folder)).main.rms > 1.5 * prove(read_project(exported)).main.rms
