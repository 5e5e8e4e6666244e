"""A folder of photographs becomes a block in one command, and goes on where it stopped."""

import cv2
import numpy as np
import pytest
from PIL import Image

import corridor
from corridor.core.gnss import Local
from corridor.interface import cli

pytest.importorskip("pycolmap", reason="the extra `images` (pycolmap) is not installed")

WIDTH, HEIGHT, F = 480, 360, 420.0
PLACE = Local(47.5, 8.7, 0.0)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Twelve pictures of hilly ground from 40 m, in three strips, with their positions in EXIF."""
    rng = np.random.default_rng(4)
    folder = tmp_path_factory.mktemp("photos") / "field"
    folder.mkdir()
    size, cell = 1400, 0.08
    texture = sum(
        cv2.resize(rng.uniform(0, 1, (size // s + 2,) * 2).astype(np.float32), (size, size),
                   interpolation=cv2.INTER_CUBIC) * np.sqrt(s)
        for s in (2, 4, 8, 16, 32, 64)
    )  # fmt: skip
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)

    def height(x, y):
        return 3 * np.sin(x / 7) * np.cos(y / 9) + 2 * np.sin(0.4 * x + 0.3 * y)

    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(u - 239.5) / F, -(v - 179.5) / F, -np.ones_like(u, float)], -1)
    centres = []
    for k in range(12):
        centre = np.array([45 + 9.0 * (k % 4), 40 + 13.0 * (k // 4), 40 + rng.normal(0, 1)])
        turned, _ = cv2.Rodrigues(rng.normal(0, 0.04, 3))
        ray = rays @ turned.T
        z = np.zeros(u.shape)
        for _ in range(12):
            at = centre + ray * ((z - centre[2]) / ray[..., 2])[..., None]
            z = height(at[..., 0], at[..., 1])
        picture = cv2.remap(texture, (at[..., 0] / cell).astype(np.float32),
                            (at[..., 1] / cell).astype(np.float32), cv2.INTER_LINEAR)  # fmt: skip
        lon, lat, up = PLACE.to_geographic(centre[None])[0]
        exif = Image.Exif()
        exif[271], exif[272] = "DJI", "made"
        exif.get_ifd(0x8769)[41989] = 31  # mm of 35 mm film: 421 px
        exif.get_ifd(0x8769)[36867] = f"2024:06:24 10:20:{2 * k:02d}"
        gps = exif.get_ifd(0x8825)
        for n, value, letter in ((1, lat, "N"), (3, lon, "E")):
            minutes = 60 * (value % 1)
            gps[n], gps[n + 1] = letter, (float(int(value)), float(int(minutes)),
                                          round(60 * (minutes % 1), 5))  # fmt: skip
        gps[5], gps[6] = b"\0", float(up)
        Image.fromarray(picture.astype(np.uint8)).convert("RGB").save(
            folder / f"IMG_{k:04d}.jpg", quality=95, exif=exif
        )
        centres.append(centre)
    return folder, np.array(centres)


@pytest.fixture(scope="module")
def imported(photographs, tmp_path_factory):
    folder, _ = photographs
    output = tmp_path_factory.mktemp("out") / "block"
    assert cli.main(["import", "photos", str(folder), "-o", str(output)]) == 0
    return output


@pytest.mark.slow
def test_twelve_pictures_become_a_block_that_adjusts(imported, photographs):
    block = corridor.read(imported)
    assert len(block.images) == 12 and len(block.gnss) == 12
    adjustment = corridor.adjust(block, camera="f,k1")
    assert adjustment.converged
    tie = adjustment.statistics["tie"]
    assert tie["count"] > 500 and tie["rms"] < 1.0


@pytest.mark.slow
def test_the_block_is_where_the_photographs_were_taken(imported, photographs):
    """Positions in EXIF are rounded to a millimetre; the pictures are 10 cm a pixel."""
    block = corridor.read(imported)
    local = block.extra["local_frame"]
    place = Local(local["lat_deg"], local["lon_deg"], local["height"])
    _, true = photographs
    order = [int(name[4:8]) for name in block.images["image"]]
    mine = PLACE.from_geographic(place.to_geographic(block.images[["x", "y", "z"]].to_numpy(float)))
    assert np.abs(mine - true[order]).max() < 0.5
    assert np.ptp(block.column("images", "time_s")) == pytest.approx(22.0)


@pytest.mark.slow
def test_one_import_is_like_another(imported, photographs, tmp_path):
    """Several threads started from another pair in one of three, and matched so in one of 15.

    Work that is gone on with (below) is compared as well.
    """
    for again in ("b", "c"):
        output = tmp_path / again
        assert cli.main(["import", "photos", str(photographs[0]), "-o", str(output)]) == 0
        same(corridor.read(output), corridor.read(imported))


def same(other, one):
    assert other.tie_points.equals(one.tie_points)
    assert np.array_equal(other.images["image"], one.images["image"])
    assert other.poses == pytest.approx(one.poses, abs=1e-9)


@pytest.mark.slow
def test_nothing_is_left_beside_the_block(imported):
    assert [entry.name for entry in imported.parent.iterdir()] == ["block"]


@pytest.mark.slow
def test_interrupted_work_is_kept_and_gone_on_with(imported, photographs, tmp_path, monkeypatch):
    from corridor.tools.formats import mapping

    folder, _ = photographs

    def stop(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(mapping, "_map", stop)
        assert cli.main(["import", "photos", str(folder), "-o", str(tmp_path / "block")]) == 130
    assert not (tmp_path / "block").exists()
    kept = mapping.workplace(tmp_path / "block")
    assert (kept / "database.db").is_file()

    import pycolmap

    with pycolmap.Database.open(kept / "database.db") as base:
        before = [base.read_keypoints(image.image_id).shape for image in base.read_all_images()]
    assert len(before) == 12 and min(shape[0] for shape in before) > 100
    assert cli.main(["import", "photos", str(folder), "-o", str(tmp_path / "block")]) == 0
    assert not kept.exists()
    again = corridor.read(tmp_path / "block")
    assert len(again.images) == 12
    same(again, corridor.read(imported))


@pytest.mark.slow
def test_a_start_from_positions_and_attitudes_ends_where_they_were_taken(
    photographs, tmp_path, monkeypatch
):
    """The pictures are tilted by up to 6 degrees where their metadata say straight down."""
    from dataclasses import replace

    from corridor.tools.formats import mapping
    from corridor.tools.formats.starting import can_start

    folder, true = photographs
    read = mapping.read_metadata
    monkeypatch.setattr(
        mapping, "read_metadata",
        lambda path: replace(read(path), yaw=0.0, pitch=-90.0, roll=0.0),
    )  # fmt: skip
    assert can_start([mapping.read_metadata(next(folder.iterdir()))])
    project = mapping.from_photographs(folder, tmp_path / "block", started=True)
    images = project.block.images.sort_values("image")
    found = images[["x", "y", "z"]].to_numpy(float)
    assert len(found) == 12
    assert np.abs((found - np.median(found, 0)) - (true - np.median(true, 0))).max() < 0.5
