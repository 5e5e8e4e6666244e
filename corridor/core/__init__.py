"""The small core: block, camera, geometry, effects, GNSS, preparation, adjustment, simulation."""

__version__ = "0.1.0"
