"""The constitutive model as data: parameters, priors, laws of its parts, pooling between tests."""
