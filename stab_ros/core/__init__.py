"""Shared foundations: value types, geometry, regions, kernels, threads. No input or output, no logging, no clock."""
