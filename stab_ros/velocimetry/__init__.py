"""Surface velocities of water, each with its uncertainty, from frames whose place on the water plane is known."""
