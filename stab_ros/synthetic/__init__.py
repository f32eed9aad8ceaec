"""Rendered river flights with a physical camera model and exact homographies: ground truth for tests and benchmarks."""
