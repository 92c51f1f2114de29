"""What a fit says of other experiments: attenuation, phase lag."""
