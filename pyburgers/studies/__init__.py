"""Published studies, repeated."""
