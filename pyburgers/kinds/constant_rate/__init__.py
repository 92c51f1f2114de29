"""Tests at piecewise constant strain rate."""
