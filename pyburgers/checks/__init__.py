"""Checks with a verdict each, over labelled draws."""
