"""Fits: the rooms below in order, and what a finished run says."""
