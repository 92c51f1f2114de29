"""Studies of many fits: the paper's, those of measured data, and a user's own campaign."""
