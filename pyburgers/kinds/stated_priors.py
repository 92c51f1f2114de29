"""Priors that the files of tests state: of the apparatus and of errors of their conditions."""

from collections.abc import Sequence

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import CONDITION_KEYS, Experiment, Stated
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import Prior, fixed_prior


def stated_priors(experiment: Experiment) -> dict[str, Prior]:
    """Return priors of the test and its apparatus, by the parameter."""
    return {
        name: _normal(name, stated, "stated with the test")
        for name, stated in experiment.stated.items()
    }


def condition_priors(experiment: Experiment) -> tuple[Prior, ...]:
    """Return the priors of the errors of a test's conditions."""
    source = "stated in the file of the test"
    return tuple(
        _normal(one.parameter, Stated(0.0, one.sd), source) for one in experiment.uncertain
    )


def _normal(name: str, stated: Stated, source: str) -> Prior:
    """Return the normal prior of a stated number, cut at zero where it cannot be negative."""
    parameter = PARAMETER_BY_NAME[name]
    if stated.sd == 0:
        return fixed_prior(parameter, stated.value, source)
    numbers = {"location": stated.value, "scale": stated.sd}
    if name == "apparatus_compliance":
        numbers["lower"] = 0.0
    return Prior.of_family(name, "normal", numbers, unit=parameter.si_unit, source=source)


def check_conditions(experiments: Sequence[Experiment]) -> None:
    """Ask for the same uncertain conditions in all tests, and one error of one apparatus.

    Raise InputError if a test cannot have such an error, or lacks one that another has.
    """
    for experiment in experiments:
        for one in experiment.uncertain:
            if one.parameter not in experiment.may_be_uncertain:
                raise InputError(
                    f"{experiment.id}: key {CONDITION_KEYS[one.parameter][0]!r}: found {one.sd:g}, "
                    f"expected none because tests of the protocol {experiment.protocol} take it as "
                    "known."
                )
    for name, (sd_key, apparatus_key) in CONDITION_KEYS.items():
        stated = {
            test.id: one for test in experiments for one in test.uncertain if one.parameter == name
        }
        missing = [test.id for test in experiments if test.id not in stated]
        if stated and missing:
            raise InputError(
                f"{missing[0]}: key {sd_key!r} is missing, expected it because {min(stated)} of "
                "the same joint fit has it; a condition that is well known has a small one."
            )
        for test, one in stated.items():
            for other, again in stated.items():
                same = one.apparatus is not None and one.apparatus == again.apparatus
                if same and one.sd != again.sd:
                    raise InputError(
                        f"{test}: key {sd_key!r} is {one.sd:g}, in {other} it is {again.sd:g}, "
                        f"expected one number for the {apparatus_key} {one.apparatus!r}."
                    )
