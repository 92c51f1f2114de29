"""Figures of a fit of one test, drawn into axes that the caller may have made."""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.drawing.panels import (
    FittedCurve,
    draw_curve,
    draw_data,
    draw_marks,
    draw_residuals,
    figure_of,
)
from pyburgers.drawing.style import BLUE, VERMILION, style
from pyburgers.drawing.view import view_of
from pyburgers.kinds.experiment import A_TEST, Experiment
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.model.display import axis_label, shown_quantity
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import SOME_PRIORS, PriorSet
from pyburgers.posterior.labelled_draws import free_parameters

PRIORS_IN_A_ROW = 4


def plot(experiment: Experiment, ax: Axes | None = None) -> Axes:
    """Draw the readings of a test along its clock, in display units.

    Parameters
    ----------
    experiment : Experiment
        A test with readings.
    ax : Axes, optional
        Axes to draw into; without them new ones.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    InputError
        If the test has no readings.

    Examples
    --------
    >>> axes = pyburgers.plot(test)
    """
    require_type("experiment", experiment, Experiment, A_TEST)
    if not experiment.n_points:
        raise InputError(f"{experiment.id}: found no readings to draw, expected some.")
    curve, axes = view_of(experiment).read(experiment), ax or _new_axes()
    with style():
        draw_data(axes, curve.position, curve.data, curve.error, "readings")
        draw_marks(axes, curve)
        axes.set(xscale=curve.scale, yscale=curve.scale, xlabel=curve.position_label)
    return axes


def plot_priors(priors: PriorSet) -> Figure:
    """Draw the density of every free parameter's prior, in display units.

    Parameters
    ----------
    priors : PriorSet
        The priors. Shares of the largest stress are left out: they have no unit yet.

    Returns
    -------
    Figure
        A panel for each parameter.

    Examples
    --------
    >>> figure = pyburgers.plot_priors(pyburgers.priors("ice").resolved(2e6))
    """
    require_type("priors", priors, PriorSet, SOME_PRIORS)
    shown = [priors[name] for name in priors.free if not priors[name].relative_to_max_stress]
    rows = -(-len(shown) // PRIORS_IN_A_ROW)
    with figure_of(9.0, 0.6 + 1.9 * rows, priors.title) as figure:
        for number, prior in enumerate(shown, start=1):
            axes = figure.add_subplot(rows, PRIORS_IN_A_ROW, number)
            quantity = shown_quantity(prior.parameter)
            ends = prior.distribution().ppf([0.001, 0.999]) * quantity.display_factor
            _draw_density(axes, prior, *ends)
            axes.set_xlabel(axis_label(quantity))
            axes.set_yticks([])
    return figure


def _draw_density(axes: Axes, prior: Prior, low: float, high: float) -> None:
    """Draw the density of a prior between two values in its display unit."""
    factor = shown_quantity(prior.parameter).display_factor
    values = np.linspace(low, high, 200)
    density = prior.distribution().pdf(values / factor) / factor
    axes.plot(values, density, color=VERMILION, label="prior")


@dataclass(frozen=True)
class FitPlots:
    """What ``fit.plot`` draws of a test, into given axes or new ones, which are returned."""

    fit: FittedTest

    def curve(self, ax: Axes | None = None) -> Axes:
        """Draw readings, retrodictions and the predictive band along the clock of the test."""
        curve, axes = self._curve(), ax or _new_axes()
        with style():
            draw_curve(axes, curve)
            axes.set_xlabel(curve.position_label)
            axes.legend(loc="best")
        return axes

    def stress_strain(self, ax: Axes | None = None) -> Axes:
        """Draw the stress-strain curve of a test at constant rate; refuse any other test."""
        experiment = self.fit.experiment
        if likelihood_of(experiment).clock.name != "strain":
            raise InputError(
                f"{experiment.id}: found a test of protocol {experiment.protocol!r}, expected one "
                "along strain; plot.curve draws any."
            )
        return self.curve(ax)

    def residuals(self, ax: Axes | None = None) -> Axes:
        """Draw readings minus the predictive median, with the 90 % band of the noise."""
        curve, axes = self._curve(), ax or _new_axes()
        with style():
            draw_residuals(axes, curve)
        return axes

    def posterior(self, name: str, ax: Axes | None = None) -> Axes:
        """Draw the draws of a sampled quantity, in its display unit, with its prior's density."""
        sampled = free_parameters(self.fit.posterior)
        if name not in sampled:
            raise InputError(f"{name!r} was not sampled, {nearest(name, sampled)}")
        quantity, axes = shown_quantity(name), ax or _new_axes()
        draws = self.fit.posterior["posterior"][name].to_numpy().ravel()
        factor = quantity.display_factor
        with style():
            axes.hist(draws * factor, bins=40, density=True, color=BLUE, alpha=0.6, label="draws")
            prior = self.fit.priors.priors.get(name)
            if prior is not None:
                _draw_density(axes, prior, *axes.get_xlim())
            axes.set_xlabel(axis_label(quantity))
            axes.set_ylabel("density")
            axes.legend(loc="best")
        return axes

    def _curve(self) -> FittedCurve:
        return view_of(self.fit.experiment).curve(self.fit)


def _new_axes() -> Axes:
    _, axes = plt.subplots(layout="constrained")
    return axes
