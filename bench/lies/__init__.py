"""The search for lies: random flights with known motion, and what the tracker says of them."""
