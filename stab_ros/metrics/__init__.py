"""Measures of stabilization accuracy: RMSD and displacement, RMSE of homologous points, residual velocity fields.

One file per measure: arrays in, numbers out.
"""
