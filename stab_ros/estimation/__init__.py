"""Fitting: homographies of every model from correspondences, with their covariance."""
