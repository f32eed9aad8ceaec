"""A rendered river with a physical camera and exact homographies: truth to measure against."""
