"""The tracker: one frame in, its homography to the reference out."""
