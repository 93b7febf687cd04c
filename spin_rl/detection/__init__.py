"""Finding objects: detectors of images and of simulated worlds, and points in the base frame from pixels."""
