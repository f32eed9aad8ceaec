"""The evaluator: how still a stabilised stream stands, frame by frame."""
