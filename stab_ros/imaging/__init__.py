"""The camera and the picture: lens models, warping, and what part of the reference is shown."""
