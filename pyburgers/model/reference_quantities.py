"""Points of the flow law that are sampled in place of a parameter."""

from collections.abc import Mapping

from pyburgers.model.parameters import Parameter

REFERENCE_STRESS_QUANTITY = Parameter(
    "reference_stress", r"S_0", "reference stress", "stress", "MPa"
)
"""The stress at which undeformed material would flow at the first imposed rate by its power law
alone; it follows from the parameters and has no prior of its own."""

REFERENCE_FLOW_RATE_QUANTITY = Parameter(
    "reference_flow_rate", r"\dot\epsilon_0", "reference flow rate", "strain rate", "1e-6/s"
)
"""The rate at which undeformed material would flow at an observed stress (bias, or amplitude where
the bias is removed), likewise; it follows from the parameters and has no prior of its own."""

REFERENCE_QUANTITIES: Mapping[str, Parameter] = {
    q.name: q for q in (REFERENCE_STRESS_QUANTITY, REFERENCE_FLOW_RATE_QUANTITY)
}
"""Points of the flow law that are sampled, by their logarithms, in place of a parameter."""
