"""Tables of published rates and the flow laws fitted to them."""
