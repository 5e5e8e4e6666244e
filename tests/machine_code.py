"""Machine code that is compiled already, for programs whose tests are not about compiling it."""

import shutil
from pathlib import Path

import corridor


def copy_kept(into, but=()):
    """Copies what numba keeps beside the package's sources.

    into: function of the folder of the sources, which names the folder for it; but: words of files
    that are left out. Of changed sources it is not used: they are compiled as if nothing were kept.
    """
    for file in Path(corridor.__file__).parent.rglob("*.nb[ic]"):
        if not any(word in file.name for word in but):
            folder = into(file.parent.parent)
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, folder)
