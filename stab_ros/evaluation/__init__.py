"""Evaluation of a stabilised stream: the residual motion of every frame, and its statistics."""
