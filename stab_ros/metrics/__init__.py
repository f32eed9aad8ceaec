"""How still a stabilised picture stands: RMSD, displacement, RMSE of homologous points, velocity fields.

Each measure is one file, in the same inner ring as `core`: arrays in, numbers out.
"""
