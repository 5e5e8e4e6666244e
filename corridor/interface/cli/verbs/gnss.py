"""Find where the antenna was at each exposure, and how well that is known.

examples:
  corridor gnss data_synthetic/dike_track.csv --images data_synthetic/dike -o out/gnss.csv
      the track that comes with the shipped block
  corridor gnss BLOCK/track.csv --images BLOCK -o BLOCK/gnss.csv
      track and images of one block: one clock, one frame
  corridor gnss rover.pos --images flight_Timestamp.MRK --photos PHOTOS -o out/gnss.csv
      RTKLIB's solution and DJI's time marks; photographs are named by their numbers
  corridor gnss rover.pos --images BLOCK --images-system GPST -o BLOCK/gnss.csv
      images.csv does not say which clock it shows; the block's crs and offset are used
  corridor gnss grafnav.txt --images flight_Timestamp.MRK --method parabola -o out/parabola.csv
      as other programs do it, for comparison

TRACK: RTKLIB or CSRS-PPP .pos, GrafNav text, POSPac text or SBET (with attitudes), MicMac XML or
text, track.csv of a block. IMAGES: a block, its images.csv, a DJI .MRK, RTKLIB's NAME_events.pos,
MicMac's image times, or a folder of photographs (EXIF). The table (image, x, y, z, sx, sy, sz:
antenna, m; rho_xy, rho_xz, rho_yz: correlations, where the track states co-deviations) and a
picture beside it appear together or not at all. Positions whose sigma is above --max-sigma are
refused and named.
"""

import argparse
import warnings
from pathlib import Path

from corridor.core.command.options import announce_compilation, flag, number, option, warn, wrote

# Positions that poses contradict by more are those of another place: they are not written.
_FAR_M = 1000.0
OPTIONS = {
    "track": option("file with the antenna's track", "TRACK", Path),
    "--images": option("when the images were taken", "IMAGES", Path, required=True),
    "--output": option("table to write, a .csv", "GNSS", required=True),
    "--attitudes": option(
        "table to write too, beside GNSS: the attitudes of a track that states them (POSPac)",
        "ATTITUDES",
        Path,
    ),
    "--method": option(
        "smoother (default): Kalman smoother with a sigma that holds between epochs and "
        "in turns; the others are curves through the epochs, for comparison",
        choices=("smoother", "parabola", "spline", "pchip", "linear"),
        default="smoother",
    ),
    "--max-sigma": option(
        "refuse positions whose sigma is above this in one axis, metres (default 0.1: "
        "beside positions of 2 cm it has a twenty-fifth of their weight, and can only mislead)",
        "M",
        number("is not a length in metres above 0", above=0.0),
    ),
    "--slow-share": option(
        "share of the stated variance that neighbouring epochs have in common, 0 to below "
        "1 (default: what the track shows)",
        "SHARE",
        number("is not a share from 0 to below 1", least=0.0, below=1.0),
    ),
    "--no-velocities": flag(
        "leave the track's velocities aside (they may be differences of its positions)"
    ),
    "--photos": option(
        "folder of the photographs, to name the exposures of a .MRK by their numbers"
    ),
    "--crs": option(
        "coordinates of the table, as EPSG:2154 (default: the block's, else local metres)"
    ),
    "--track-system": {},
    "--images-system": {},
}


def run(options: argparse.Namespace) -> None:
    """Read, interpolate, write table and picture, print what came of it."""
    from corridor.core import gnss
    from corridor.core.errors import InputError
    from corridor.core.photographs import photographs_in
    from corridor.interface import figures

    track = gnss.read_track(options.track)
    if options.crs is not None and track.crs is None and track.origin is None:
        raise InputError(
            f"{options.track} is in local metres without a place on the earth, so it cannot be "
            f"converted to {options.crs}: leave --crs out"
        )
    exposures = gnss.read_exposures(options.images)
    if options.photos is not None:
        photographs = photographs_in(options.photos)
        taken = None
        if exposures.counted:
            try:
                taken = gnss.read_exposures(options.photos)
            except InputError as error:
                warn([f"Events are given to images in the order of their names, for {error}."])
        exposures = exposures.named(gnss.names_in(options.photos, photographs), taken)
    crs, offset, about = gnss.frame_of_block(options.images)
    if options.crs is not None and options.crs != crs:
        crs, offset, about = options.crs, (0.0, 0.0, 0.0), None
    announce_compilation("ten seconds")
    found = gnss.antenna(
        track,
        exposures,
        method=options.method,
        max_sigma=gnss.MAX_SIGMA_M if options.max_sigma is None else options.max_sigma,
        slow_share=options.slow_share,
        velocities=not options.no_velocities,
        crs=crs,
        offset=offset,
        about=about,
        track_system=options.track_system,
        exposures_system=options.images_system,
    )
    told, away = _doubt(options.images, found)
    if away > _FAR_M:
        print(found)
        raise InputError(f"{told} Nothing was written.")
    written = found.save(options.output, figures.antenna(found), options.attitudes)
    print(found)
    warn([told] if told else [])
    wrote(*written)


def _doubt(images, found):
    """What poses in images.csv say against the positions found, and how far they lie, m."""
    import numpy as np
    import pandas as pd

    from corridor.core.block import Layout, read_columns
    from corridor.core.errors import CorridorWarning, InputError
    from corridor.core.preparation import (
        position_difference,
        position_disagreement,
        position_outliers,
    )

    path = images / "images.csv" if images.is_dir() else images
    if path.suffix.lower() != ".csv" or not path.is_file():
        return "", 0.0
    with warnings.catch_warnings():  # told when the images were read
        warnings.simplefilter("ignore", CorridorWarning)
        try:
            table = read_columns(path, Layout((), ("image", "x", "y", "z")))
        except InputError:  # times in another format
            return "", 0.0
    if not {"image", "x", "y", "z"} <= set(table):
        return "", 0.0
    posed = table.drop_duplicates("image").set_index("image").reindex(found.gnss["image"])
    known = posed[["x", "y", "z"]].apply(pd.to_numeric, errors="coerce").to_numpy(float)
    given = found.gnss[["x", "y", "z"]].to_numpy(float)
    names = ("the track", np.asarray(given), str(path.name), known)
    told = (
        position_difference(*names)
        or position_disagreement(*names)
        or position_outliers(*names[1:], list(found.gnss["image"]))
    )
    away = np.linalg.norm((names[1] - known)[:, :2], axis=1)
    known = np.isfinite(away)
    return told, float(np.median(away[known])) if told and known.any() else 0.0
