"""Figure of a flow law by source: a curve, another source, both."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from pyburgers.drawing.style import BLUE, GREEN, VERMILION, few_ticks, style
from pyburgers.model.display import axis_label, shown_quantity

FloatArray = npt.NDArray[np.float64]

SOURCE_COLOURS = (GREEN, BLUE, VERMILION)
SHOWN_SHARE = 0.995
"""Share of the draws of every source, by its ends, that a panel reaches to."""

BINS = 40

COMBINED_CAPTION = (
    "Distribution of each part of the flow law as the other source alone, the curve alone and both "
    "together have it. The last panel is the logarithm of the flow rate at the mean conditions of "
    "the other source, which it knows best."
)


def combined_flow_law(draws: Mapping[str, Mapping[str, FloatArray]]) -> Figure:
    """Draw the distributions of n, p, Q_M and the flow rate by source.

    Parameters
    ----------
    draws : mapping
        SI values by source and quantity; the last quantity is ln(flow rate s).
    """
    *parameters, log_rate = (name for name in next(iter(draws.values())) if name != "beta")
    with style():
        figure = Figure(figsize=(9.0, 2.8), layout="constrained")
        panels = figure.subplots(1, len(parameters) + 1)
        for axes, name in zip(panels, [*parameters, log_rate], strict=True):
            factor = 1.0 if name == log_rate else shown_quantity(name).display_factor
            shown = {source: values[name] * factor for source, values in draws.items()}
            low = min(float(np.quantile(v, 1 - SHOWN_SHARE)) for v in shown.values())
            high = max(float(np.quantile(v, SHOWN_SHARE)) for v in shown.values())
            for (source, values), colour in zip(shown.items(), SOURCE_COLOURS, strict=True):
                axes.hist(
                    values,
                    bins=BINS,
                    range=(low, high),
                    density=True,
                    histtype="step",
                    linewidth=1.4,
                    color=colour,
                    label=source,
                )
            axes.set_xlabel(
                "ln(flow rate · s)" if name == log_rate else axis_label(shown_quantity(name))
            )
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
            axes.xaxis.set_major_locator(few_ticks(4))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure
