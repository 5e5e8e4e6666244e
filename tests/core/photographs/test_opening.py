"""Pictures of strangers: by a camera's formats alone, and none too large to decode."""

import io
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import EpsImagePlugin, Image

import corridor
from corridor.core.errors import InputError
from corridor.core.photographs import FAULTS, fault, open_picture, read_metadata
from corridor.tools.formats import mapping
from corridor.tools.readout import photograph
from corridor.tools.thermal.series import read_picture

ROOT = Path(corridor.__file__).parents[2]
EPS = (
    b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 100 100\n%%EndComments\n"
    b"(ran) print\nshowpage\n%%EOF\n"
)
READERS = {
    "metadata": read_metadata,
    "readout": photograph.read,
    "thermal": read_picture,
}


def png_of(width, height):
    """A whole PNG of one grey, deflated: some kilobytes, whatever its size."""
    row = b"\0" + bytes(width)
    packer = zlib.compressobj(9)
    data = b"".join([*(packer.compress(row) for _ in range(height)), packer.flush()])
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", data), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


@pytest.fixture
def ghostscript(monkeypatch):
    """Calls of Ghostscript, which must not happen."""
    calls = []
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *a, **k: calls.append(a))
    return calls


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
@pytest.mark.parametrize("name", ["still.jpg", "still.png", "still.tif"])
def test_postscript_by_another_name_is_refused_and_never_run(reader, name, tmp_path, ghostscript):
    path = tmp_path / name
    path.write_bytes(EPS)
    with pytest.raises(InputError, match=rf"{re.escape(name)}.*JPEG, PNG"):
        reader(path)
    assert not ghostscript


@pytest.mark.parametrize("form", ["WEBP", "GIF", "BMP", "PCX", "PPM", "TGA", "ICO"])
@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_no_other_reader_of_pillow_is_used(reader, form, tmp_path):
    path = tmp_path / "still.png"
    Image.new("RGB", (200, 200)).save(path, format=form)
    with pytest.raises(InputError, match=r"still\.png"):
        reader(path)


@pytest.mark.parametrize("form", ["JPEG", "MPO", "PNG", "TIFF"])
@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_what_a_camera_writes_is_read(reader, form, tmp_path):
    path = tmp_path / "still.jpg"
    noise = np.random.default_rng(1).integers(0, 255, (200, 240, 3), dtype=np.uint8)
    Image.fromarray(noise).save(path, format=form)
    reader(path)


@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_a_picture_beyond_the_limit_is_refused_before_its_pixels_are_read(tmp_path, monkeypatch):
    path = tmp_path / "large.png"
    path.write_bytes(png_of(13_000, 12_500))
    monkeypatch.setattr(Image.Image, "load", lambda *_: pytest.fail("it was decoded"))
    for reader in READERS.values():
        with pytest.raises(InputError, match=r"large\.png.*13000 x 12500 pixels are more than"):
            reader(path)


def test_a_limit_of_ones_own(tmp_path):
    with pytest.raises(InputError, match=r"100 x 90 pixels are more than the 0\.005 million"):
        photograph.decode(png_of(100, 90), "a.png", most_pixels=5000)


def test_pictures_made_smaller_name_the_one_that_cannot_be_read(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(png_of(300, 200))
    facts = read_metadata(path)
    path.write_bytes(path.read_bytes()[:-40])
    cheaply = mapping.Cheaply(size=100)
    with pytest.raises(InputError, match=r"^a\.png cannot be read whole"):
        mapping._pictures(tmp_path, tmp_path / "work", ["a.png"], [facts], cheaply, print)


def test_a_fault_in_words_has_no_address_of_memory():
    with pytest.raises(FAULTS) as refused:
        open_picture(io.BytesIO(b"no picture"))
    assert "0x" in str(refused.value) and "0x" not in fault(refused.value)


def test_nobody_opens_pictures_in_another_way():
    """The one place is `photographs/opening.py`: a list of formats elsewhere would be forgotten."""
    for folder in ("corridor", "notebooks"):
        for file in (ROOT / folder).rglob("*.py"):
            if file.name != "opening.py":
                text = file.read_text(encoding="utf-8")
                assert not re.search(r"\bImage\.open\(|\bcv2\.(imread|imdecode)\(", text), file
