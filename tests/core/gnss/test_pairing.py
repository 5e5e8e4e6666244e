"""Events of a receiver and photographs: which belongs to which, by the rhythm of their times."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Exposures
from corridor.core.gnss.pairing import paired


def flown(strips=5, each=14, seed=0):
    """Moments of exposure, s: 4 s apart within strips, and some time for the turns."""
    rng = np.random.default_rng(seed)
    start = np.cumsum(4.0 * each + rng.uniform(5, 9, strips))
    moments = (start[:, None] + 4.0 * np.arange(each)).ravel()
    return moments + rng.normal(0, 0.02, len(moments))


def series(tmp_path, events, photos, coarse=False):
    """Events, and photographs by a camera's clock an hour off that is printed in whole seconds."""
    names = [f"DSC_{(9970 + k) % 10000:04d}.JPG" for k in range(len(photos))]
    number = pd.array(np.arange(len(events)) + 1, dtype="Int64")
    table = pd.DataFrame({"number": number, "time_s": events})
    counted = Exposures(table, "2024-06-24", "GPST", None, tmp_path / "a_events.pos", counted=True)
    time = np.floor(photos + 3600.3) if coarse else photos + 3600.3
    taken = Exposures(
        pd.DataFrame({"image": names, "time_s": time}).sort_values("image"),
        "2024-06-24", None, None, tmp_path, resolution_s=1.0 if coarse else None,
    )  # fmt: skip
    return counted, taken, names


@pytest.mark.parametrize("coarse", [False, True])
@pytest.mark.parametrize(
    ("missed", "deleted"), [([], []), ([10], []), ([], [40]), ([10], [40]), ([0, 1, 2], [69])]
)
def test_missed_events_and_deleted_photographs_are_found(tmp_path, coarse, missed, deleted):
    moments = flown()
    rows = np.delete(np.arange(70), deleted)
    counted, taken, names = series(tmp_path, np.delete(moments, missed), moments[rows], coarse)
    found = counted.named(names, taken)
    left = [row for row in rows if row not in missed]
    # The counter of the camera begins again at 0000 in the middle of the flight.
    assert found.table["time_s"].tolist() == moments[left].tolist()
    assert list(found.table["image"]) == [names[list(rows).index(row)] for row in left]
    assert any("images have no event" in note for note in found.notes) == bool(missed)
    assert any("events have no image" in note for note in found.notes) == bool(deleted)


def test_another_flight_and_a_gap_in_an_even_series_are_refused(tmp_path):
    even = 4.0 * np.arange(60.0)
    counted, taken, names = series(tmp_path, np.delete(even, 30), even)
    with pytest.raises(InputError, match="59 events and there are 60 images, whose times"):
        counted.named(names, taken)
    counted, taken, names = series(tmp_path, flown(), flown(seed=1, each=13))
    with pytest.raises(InputError, match="belongs to another flight"):
        counted.named(names, taken)
    # As many of both, at one interval: as they stand.
    assert paired(even, even + 5.0, 0.25).tolist() == [[k, k] for k in range(60)]
    # Without times, in the order of the names, as many as there are.
    whole = replace(counted, table=counted.table.iloc[:60])
    assert list(whole.named(names[:60]).table["image"]) == sorted(names[:60])
