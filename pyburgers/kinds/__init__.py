"""Kinds of test: what a test holds, how its files are read, what its Stan program wants."""
