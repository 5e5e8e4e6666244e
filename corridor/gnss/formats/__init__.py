"""Formats of tracks and image times, one a file; `corridor.gnss.reading` finds them."""
