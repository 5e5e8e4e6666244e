"""The small core: block, camera, geometry, effects, GNSS, preparation, adjustment, simulation."""
