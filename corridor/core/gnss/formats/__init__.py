"""Formats of tracks and image times, one a file; `corridor.core.gnss.reading` finds them."""
