"""All parameters by name, presets of them, and the engines they make."""
