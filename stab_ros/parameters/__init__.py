"""The parameters of engines and nodes by name, presets, parameter files, and the engines made from them."""
