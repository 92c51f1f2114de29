"""Parameters of the flow laws of tables of rates: names, symbols, units."""

from pyburgers.model.parameters import Parameter

RATE_PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "mechanism_rate",
        r"\dot\epsilon_1",
        "rate at the reference conditions",
        "strain rate",
        "1e-6/s",
    ),
    Parameter(
        "premelting_enthalpy",
        r"Q_+",
        "activation enthalpy above the premelting temperature",
        "molar energy",
        "kJ/mol",
    ),
    Parameter("rate_scatter", r"s_\epsilon", "scatter of ln(rate) between specimens"),
    Parameter("source_rate_spread", r"s_b", "spread of ln(rate) between sources"),
    Parameter(
        "source_temperature_spread",
        r"s_T",
        "spread of temperature errors between sources",
        "temperature",
        "K",
    ),
    Parameter("source_scatter_spread", r"s_s", "spread of ln(scatter) between sources"),
    Parameter("tertiary_enhancement", r"E", "steady rate over the least rate"),
)
"""What laws of tables of rates have beside the flow law's n, p and Q_M."""
