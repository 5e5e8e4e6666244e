"""Where tests find a browser."""

import os
import shutil
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def chromium():
    """Path of a Chromium: CORRIDOR_CHROMIUM, or what the system has."""
    named = os.environ.get("CORRIDOR_CHROMIUM")
    found = [named] if named else [shutil.which(name) for name in BROWSERS]
    return next((path for path in found if path and Path(path).exists()), None)
