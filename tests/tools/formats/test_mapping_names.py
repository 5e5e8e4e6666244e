"""Names with blanks, and focal lengths that no lens has, on their way through COLMAP."""

import sqlite3
from types import SimpleNamespace

import pytest

from corridor.tools.formats import mapping
from corridor.tools.formats.focal import of_a_lens

NAMES = ["Flug Süd 1/Bild 1.JPG", "Flug Süd 1/Bild 2.JPG", "plain.jpg"]


@pytest.fixture
def database(tmp_path):
    path = tmp_path / "database.db"
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE images (name TEXT)")
        base.executemany("INSERT INTO images VALUES (?)", [(name,) for name in NAMES])
    return path


def names_in(database):
    with sqlite3.connect(database) as base:
        return [name for (name,) in base.execute("SELECT name FROM images")]


@pytest.mark.parametrize("fails", [False, True])
def test_a_list_of_pairs_names_pictures_with_blanks(database, tmp_path, fails):
    """COLMAP takes each line apart at its blanks."""
    read = []

    def match_image_pairs(path, pairing_options, **_):
        listed = open(pairing_options.match_list_path, encoding="utf-8").read()
        read.extend(line.split(" ") for line in listed.splitlines())
        assert {name for pair in read for name in pair} <= set(names_in(path))
        if fails:
            raise KeyboardInterrupt

    made = SimpleNamespace(
        TwoViewGeometryOptions=lambda: SimpleNamespace(ransac=SimpleNamespace()),
        FeatureMatchingOptions=SimpleNamespace,
        ImportedPairingOptions=SimpleNamespace,
        match_image_pairs=match_image_pairs,
        Device=SimpleNamespace(cpu=0),
    )
    pairs = [(0, 1), (0, 2), (1, 2)]
    try:
        assert list(mapping._matches(made, database, tmp_path, NAMES, pairs)) == [3]
    except KeyboardInterrupt:
        assert fails
    assert [len(pair) for pair in read] == [2, 2, 2]
    assert names_in(database) == NAMES


@pytest.mark.parametrize(("focal", "kept"), [(72.0, False), (720.0, True)])
def test_a_focal_length_that_no_lens_has_is_not_taken_from_exif(tmp_path, focal, kept):
    """FocalPlaneResolution in the wrong unit: COLMAP reads EXIF itself."""
    pycolmap = pytest.importorskip("pycolmap")
    path = tmp_path / "database.db"
    with pycolmap.Database.open(path) as base:
        camera = pycolmap.Camera(
            model="RADIAL", width=900, height=600, params=[focal, 450, 300, 0, 0]
        )
        camera.has_prior_focal_length = True
        number = base.write_camera(camera)
        base.write_image(pycolmap.Image(name="a b.jpg", camera_id=number))
    mapping._let_go_of_exif(pycolmap, path, "a b.jpg")
    with pycolmap.Database.open(path) as base:
        camera = base.read_camera(number)
    assert camera.has_prior_focal_length == kept
    assert of_a_lens(camera.focal_length / 900) and (camera.focal_length == focal) == kept
