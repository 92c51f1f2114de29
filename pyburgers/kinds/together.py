"""What tests that are fitted together share, and their priors, where nothing else is said."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.problem import TABLES, common_likelihood
from pyburgers.model.pooling import ALL, SEPARATE, Pooling, pooling_of
from pyburgers.model.priors import PriorSet, default_priors, load_priors, shipped_prior_files

WITH_TABLES: Mapping[str, str] = {"maxwell_modulus": "separate"}
"""Pooling of histories and tables where nothing else is said: a deformation test sees the apparatus
in E_M, a table the material alone."""

PRIORS_WITH_TABLES = "deformation_and_attenuation"
"""Folder of priors for both."""


def has_both(experiments: Sequence[Experiment]) -> bool:
    """Whether there are tables of attenuation and other tests."""
    return 0 < sum(one.protocol == TABLES for one in experiments) < len(experiments)


def pooling_for(
    experiments: Sequence[Experiment], options: Mapping[str, str] | None = None
) -> Pooling:
    """Return how tests are pooled where it is not said otherwise; one test shares with nobody."""
    if len(experiments) == 1:
        if options:
            raise InputError(
                f"pool: found it with the test {experiments[0].id} alone, expected several."
            )
        return SEPARATE
    options = options or {}
    if not has_both(experiments) or ALL in options:
        return pooling_of(options)
    defaults = dict(WITH_TABLES)
    # What is partially pooled elsewhere is separate where one test alone has it.
    if sum(one.protocol != TABLES for one in experiments) == 1:
        partial = pooling_of().spread_scales
        defaults |= dict.fromkeys(partial, "separate")
    return pooling_of({**defaults, **options})


def priors_for(
    experiments: Sequence[Experiment], path: Path | None, choices: Mapping[str, str]
) -> PriorSet:
    """Return the priors in a file, with chosen laws, or those that come with the package."""
    return default_priors_for(experiments) if path is None else load_priors(path, choices)


def default_priors_for(experiments: Sequence[Experiment]) -> PriorSet:
    """Return the priors that come with the package for some tests of a material."""
    material = experiments[0].material
    if has_both(experiments) and material in shipped_prior_files(PRIORS_WITH_TABLES):
        return default_priors(material, PRIORS_WITH_TABLES)
    return default_priors(material, common_likelihood(experiments).name)
