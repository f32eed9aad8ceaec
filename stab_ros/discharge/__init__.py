"""River discharge, with its uncertainty, from surface velocities and a cross-section."""
