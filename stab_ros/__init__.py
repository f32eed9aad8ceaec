"""Image stabilisation for river measurement from drones: every frame brought back to one reference frame."""

__version__ = "0.1.0"
