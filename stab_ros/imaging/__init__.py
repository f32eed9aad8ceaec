"""Camera and image geometry: lens models, warping, and the output window."""
