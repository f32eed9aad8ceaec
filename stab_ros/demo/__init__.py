"""`make demo`: the recorded flight through the live nodes, and what came of it beside the known truth."""
