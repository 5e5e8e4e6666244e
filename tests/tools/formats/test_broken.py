"""Broken and odd files: one sentence with file and place, or the same block; never nonsense."""

import re
import shutil
import zipfile

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.interface import cli
from corridor.tools.formats import prove, read_project
from corridor.tools.formats.ground import read_gcp_list
from corridor.tools.formats.programs import metashape, nvm

from .fuzzing import run

# The place that the sentence must name, for each file of `broken` that must be refused.
REFUSED = {
    "colmap_truncated": "images.txt, line 15",
    "colmap_zero_quaternion": "images.txt, line 5: the quaternion has length zero",
    "colmap_unknown_camera": "images.txt, line 7: camera 99 is not in cameras.txt",
    "colmap_nan_point": "points3D.txt, line 5: Z = 'nan'",
    "colmap_truncated_binary": "images.bin ends at byte 15278, within image 10",
    "pix4d_decimal_comma.txt": "line 2: the pose = '717429,256810' has a decimal comma",
    "pix4d_missing_line.txt": "line 13",
    "bundler_wrong_header.out": "line 1: '# Bundle file v9'",
    "bundler_too_few_points.out": "point 545 of 600",
    "metashape_truncated.xml": "line 264: the XML is broken",
    "micmac_no_calibration": "Ori-Ground/AutoCal_Foc-28000_Cam-PENTAX_K5.xml",
    "nvm_truncated.nvm": "nvm_truncated.nvm, line 300",
    "bal_too_few_numbers.txt": "need 48 parameters, 45 are there",
}


@pytest.fixture(scope="module")
def broken(real_data):
    return real_data / "interchange" / "broken"


@pytest.mark.parametrize("name", REFUSED)
def test_broken_files_are_refused_naming_the_place(name, broken):
    with pytest.raises(InputError) as caught:
        read_project(broken / name)
    assert REFUSED[name] in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["colmap_bom_crlf", "colmap_quaternion_not_unit"])
def test_odd_but_whole_files_give_the_same_block(name, broken):
    """Byte order mark, mixed line ends; a quaternion of length 2.5, which is told."""
    one = read_project(broken / name)
    two = read_project(broken.parent / "colmap_made" / "text")
    pose = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    assert (
        np.abs(one.block.images[pose].to_numpy() - two.block.images[pose].to_numpy()).max() < 1e-9
    )
    assert one.block.tie_points[["x", "y"]].equals(two.block.tie_points[["x", "y"]])
    assert bool(one.warnings) == (name == "colmap_quaternion_not_unit")


def test_a_camera_that_was_not_oriented_is_dropped_and_the_others_keep_their_numbers(broken):
    project = read_project(broken / "bundler_unregistered_camera.out")
    assert list(project.block.images["image"]) == ["camera 0", "camera 2", "camera 3", "camera 4"]
    assert any("1 cameras were not oriented (first: number 1)" in note for note in project.notes)
    assert prove(project).verdict == "proved"


def test_a_chunk_without_transform_is_not_called_metres(broken, tmp_path):
    """The file has lost its component's transform; without the chunk's too nothing places it."""
    text = (broken / "metashape_no_chunk_transform.xml").read_text(encoding="utf-8")
    chunk = text.index("    <transform>\n      <rotation")
    bare = tmp_path / "bare.xml"
    bare.write_text(text[:chunk] + text[text.index("    <reference>GEOGCS") :], encoding="utf-8")
    project = read_project(bare)
    assert not project.placed
    assert "not metres" in project.block.description
    assert "local_frame" not in project.block.extra
    assert any("they are not metres" in note for note in project.notes)
    # With the chunk's transform alone it is as well placed as with the component's.
    whole = read_project(broken / "metashape_no_chunk_transform.xml")
    other = read_project(broken.parent / "metashape_forest").block.images.set_index("image")["x"]
    found = whole.block.images.set_index("image")["x"]
    assert np.nanmax(np.abs(found - other[found.index])) < 1e-6


def with_tracks(broken, tmp_path, tracks):
    home = tmp_path / "opensfm"
    shutil.copytree(broken.parent / "opensfm_berlin", home)
    (home / "tracks.csv").chmod(0o644)
    (home / "tracks.csv").unlink()
    shutil.copy(broken / tracks, home / "tracks.csv")
    return home


def test_tracks_with_mixed_line_ends_are_read(broken, tmp_path):
    """The first 399 track lines of opensfm_berlin, every third with CR LF."""
    home = with_tracks(broken, tmp_path, "opensfm_tracks_mixed_ends.csv")
    project = read_project(home)
    whole = read_project(broken.parent / "opensfm_berlin").block.tie_points
    found = project.block.tie_points
    assert 380 < len(found) <= 399
    assert found["x"].isin(whole["x"]).all()
    assert any("fewer than two images" in sentence for sentence in project.warnings)


def test_tracks_without_their_version_line_are_refused(broken, tmp_path):
    """Never shift columns: 11 columns where version 0 has 8."""
    with pytest.raises(InputError, match="11 columns where such a file has 8"):
        read_project(with_tracks(broken, tmp_path, "opensfm_tracks_no_header.csv"))


@pytest.mark.parametrize(
    "name, told",
    [
        ("gcp_list_no_crs.txt", "line 1: '609925.8180680283"),
        ("gcp_list_decimal_comma.txt", "line 2: '609925,8180680283' has a decimal"),
    ],
)
def test_broken_lists_of_ground_points_are_refused(name, told, broken):
    with pytest.raises(InputError) as caught:
        read_gcp_list(broken / name)
    assert told in str(caught.value)


def test_a_ground_point_without_height_is_not_at_height_0(tmp_path):
    file = tmp_path / "gcp_list.txt"
    file.write_text("EPSG:32632\n400000.1 5000000.2 1023.5 800.1 a.jpg G1\n")
    with pytest.raises(InputError, match=r"line 2: a point without height"):
        read_gcp_list(file)


@pytest.mark.parametrize("name", ["pix4d_decimal_comma.txt", "colmap_truncated", "nowhere"])
def test_the_command_ends_with_status_2_and_writes_nothing(name, broken, tmp_path, capsys):
    assert cli.main(["import", "auto", str(broken / name), "-o", str(tmp_path / "block")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("error: ") and "Traceback" not in "".join(said)
    assert not (tmp_path / "block").exists()


def test_tie_points_whose_rays_do_not_meet_are_told(tmp_path):
    """A blank within a number makes a pair with a weight, far outside the picture."""
    from .small_projects import write_all

    home = write_all(tmp_path)["micmac"]
    file = next(iter((home / "Homol").glob("Pastis*0000*/*")))
    first, rest = file.read_text().split("\n", 1)
    word, others = first.split(" ", 1)
    file.write_text(f"{word} 333228036 {others}\n{rest}")
    assert any("its rays do not meet" in s for s in read_project(home).warnings)


def test_two_images_of_one_name_are_numbered_and_told(tmp_path):
    from .small_projects import write_all

    home = write_all(tmp_path)["bundler"]
    first, _, *rest = (home / "list.txt").read_text().splitlines()
    (home / "list.txt").write_text("\n".join([first, first, *rest]) + "\n")
    project = read_project(home)
    assert list(project.block.images["image"][:2]) == [first, f"2/{first}"]
    assert any("1 names belong to several images" in told for told in project.warnings)


def test_an_image_whose_rotation_is_none_is_refused_naming_the_project(tmp_path):
    from .small_projects import write_all

    home = write_all(tmp_path)["bundler"]
    lines = (home / "bundle.out").read_text().splitlines()
    lines[3] = " ".join(str(0.5 * float(word)) for word in lines[3].split())
    (home / "bundle.out").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="the rotation of image 1 of") as refused:
        read_project(home)
    assert str(home) in str(refused.value)


def test_a_number_that_cannot_be_is_refused_naming_its_file(tmp_path):
    from .small_projects import write_all

    homes = write_all(tmp_path)
    bundle = homes["bundler"] / "bundle.out"
    lines = bundle.read_text().splitlines()
    # The last line is a point's list of views: their number, then camera, feature, x, y of each.
    words = lines[-1].split()
    words[3] = f"{1e6 * float(words[3]):.10g}"
    bundle.write_text("\n".join([*lines[:-1], " ".join(words)]) + "\n")
    with pytest.raises(InputError, match=rf"bundle.out: camera {words[1]} sees a point at"):
        read_project(homes["bundler"])
    marks = homes["metashape"] / "markers.xml"
    whole = marks.read_text()
    marks.write_text(whole.replace('<marker id="', '<marker nr="', 1))
    with pytest.raises(InputError, match=r"markers.xml: a marker has no id"):
        read_project(homes["metashape"])
    cameras = homes["opensfm"] / "reconstruction.json"
    cameras.write_text(re.sub(r'"width": *', r"\g<0>0.5", cameras.read_text(), count=1))
    with pytest.raises(InputError, match="opensfm.*is not a picture size"):
        read_project(homes["opensfm"])
    text = re.sub('sxyz="[^"]*"', 'sxyz="0.01/0.01/inf"', whole)
    assert "inf" in text
    marks.write_text(text)
    with pytest.raises(InputError, match="markers.xml: sxyz of <reference> = .* is infinite"):
        read_project(homes["metashape"])


def test_damaged_files_give_no_traceback_and_no_silent_block():
    """60 random damages of ten formats; `slow` has a thousand."""
    outcomes = run(60, seed=7)
    assert outcomes["silent"] == 0
    assert outcomes["refused"] > 20 and outcomes["told"] > 5


@pytest.mark.slow
def test_a_thousand_damaged_files():
    """More of them: python -m tests.interchange.fuzzing 10000."""
    outcomes = run(1000, seed=100)
    assert outcomes["silent"] == 0


def test_a_photoscan_project_that_grows_beyond_measure_is_refused(tmp_path):
    path = tmp_path / "bomb.psz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.xml", b" " * 80_000_000)
    assert path.stat().st_size < 100_000
    with pytest.raises(InputError, match=r"doc\.xml unpacks to more than 100 times its size"):
        metashape.read(path)


@pytest.mark.parametrize("word", ["1e308", "1e20", "-1e300"])
def test_a_pixel_beyond_all_pictures_is_refused_by_visualsfm(tmp_path, word):
    """Found by the fuzzer: the size of the pictures is guessed from where their pixels lie."""
    from .small_projects import write_all

    path = next(write_all(tmp_path)["nvm"].rglob("*.nvm"))
    lines = path.read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if len(line.split()) > 12)
    words = lines[row].split(" ")
    words[-2] = word
    lines[row] = " ".join(words)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError):
        nvm.read(path)
