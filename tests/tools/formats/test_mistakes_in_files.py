"""Usual mistakes, written into files of real projects: caught, and named, when they are read."""

import json
import re
import shutil

import pytest

from corridor.tools.formats import prove, read_project


def image_lines(change):
    """Change the lines of COLMAP's images.txt: `change(words, first)`, first: the pose's line."""

    def edit(home):
        first, out = True, []
        for line in (home / "images.txt").read_text().splitlines():
            if not line.startswith("#"):
                line = " ".join(change(line.split(" "), first))
                first = not first
            out.append(line)
        (home / "images.txt").write_text("\n".join(out) + "\n")

    return edit


def inverse_quaternion(words, first):
    if not first:
        return words
    return [*words[:2], *(repr(-float(word)) for word in words[2:5]), *words[5:]]


def half_a_pixel(words, first):
    return words if first else [
        repr(float(word) + 0.5) if k % 3 < 2 else word for k, word in enumerate(words)
    ]  # fmt: skip


def upwards(words, first):
    return words if first else [
        repr(2128 - float(word)) if k % 3 == 1 else word for k, word in enumerate(words)
    ]  # fmt: skip


def one_cameras_p1_and_p2(home):
    text = (home / "cameras.txt").read_text()
    pair = "0.00080000000000000004 -0.0011999999999999999"
    assert pair in text
    (home / "cameras.txt").write_text(text.replace(pair, " ".join(pair.split()[::-1])))


def opensfm_vectors(home):
    whole = json.loads((home / "reconstruction.json").read_text())
    for shot in whole[0]["shots"].values():
        shot["rotation"] = [-value for value in shot["rotation"]]
    (home / "reconstruction.json").write_text(json.dumps(whole))


def opensfm_p1_and_p2(home):
    whole = json.loads((home / "reconstruction.json").read_text())
    for camera in whole[0]["cameras"].values():
        camera["p1"], camera["p2"] = camera["p2"], camera["p1"]
    (home / "reconstruction.json").write_text(json.dumps(whole))


def micmac_matrices(home):
    for file in home.glob("Orientation*.xml"):
        text = file.read_text()
        rows = [row.split() for row in re.findall(r"<L[123]>(.*?)</L[123]>", text)]
        for k, column in enumerate(zip(*rows, strict=True), start=1):
            text = re.sub(rf"<L{k}>.*?</L{k}>", f"<L{k}>{' '.join(column)}</L{k}>", text)
        file.write_text(text)


def micmac_direction(home):
    for file in home.glob("AutoCal*.xml"):
        file.write_text(file.read_text().replace("DistM2C", "DistC2M"))


def pix4d_tangential(home):
    file = home / "p1_calibrated_camera_parameters.txt"
    rows = file.read_text().split("\n")
    swapped = [
        " ".join(row.split()[::-1]) if re.fullmatch(r"-?0\.\d+ -?0\.\d+", row.strip()) else row
        for row in rows
    ]
    assert swapped != rows
    file.write_text("\n".join(swapped))


def bundler_without_its_flip(home):
    file = home / "Balbianello.out"
    rows = file.read_text().split("\n")
    for k in range(5):
        for line in (4 + 5 * k, 5 + 5 * k):
            rows[line] = " ".join(repr(-float(word)) for word in rows[line].split())
        x, y, z = rows[6 + 5 * k].split()
        rows[6 + 5 * k] = f"{x} {-float(y)!r} {-float(z)!r}"
    file.write_text("\n".join(rows))


CASES = [
    ("colmap_sceaux", image_lines(inverse_quaternion), "a transposed rotation"),
    ("colmap_sceaux", image_lines(half_a_pixel), "half a pixel of origin"),
    ("colmap_sceaux", image_lines(upwards), "y upwards in the image"),
    ("colmap_made/text_before_rigs", one_cameras_p1_and_p2, "camera 4: p1 and p2 exchanged"),
    ("opensfm_berlin", opensfm_vectors, "a transposed rotation"),
    ("opensfm_made_brown", opensfm_p1_and_p2, "p1 and p2 exchanged"),
    ("micmac_saisies/Ori-Ground_mm3d", micmac_matrices, "a transposed rotation"),
    ("micmac_saisies/Ori-Ground_mm3d", micmac_direction, "the other direction of distortion"),
    ("pix4d_p1", pix4d_tangential, "p1 and p2 exchanged"),
    ("bundler_balbianello", bundler_without_its_flip, "y upwards in the camera frame"),
]


@pytest.mark.parametrize("name, mistake, named", CASES, ids=[f"{c[0]}, {c[2]}" for c in CASES])
def test_it_is_refused_and_named(name, mistake, named, real_data, tmp_path):
    home = tmp_path / "project"
    shutil.copytree(real_data / "interchange" / name, home)
    home.chmod(0o755)
    for file in home.iterdir():
        file.chmod(0o644)
    assert prove(read_project(home)).verdict == "proved"
    mistake(home)
    proof = prove(read_project(home))
    assert proof.verdict == "refused"
    assert proof.explained[0].startswith(named)
