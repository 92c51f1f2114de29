"""Tests at an oscillating strain rate."""
