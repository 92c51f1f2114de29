"""Tables of published peak stresses and the flow law fitted to them."""
