"""Which fits of the same data predict better, point by point and test by test."""
