"""From pixels to metres: the fit of a camera to control points, sensors, orientations and orthophotos."""
