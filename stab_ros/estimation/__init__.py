"""Robust estimation of a homography and its covariance from correspondences."""
