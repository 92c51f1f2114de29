"""Readers of files of flow codes, written from the codes' manuals: each gives the code's own rate.

A reader returns a function of the stress (second invariant, Pa), the strain rate that it is
compared with (1/s, for codes that take the viscosity at a rate) and the temperature (K).
"""

import io
import json
import re
from collections.abc import Callable

import numpy as np
import pandas as pd

Rate = Callable[[float, float, float], float]
YEAR = 365.25 * 86400.0


def _of_viscosity(viscosity: Callable[[float, float], float]) -> Rate:
    return lambda stress, rate, temperature: stress / (2 * viscosity(rate, temperature))


def aspect(text: str) -> Rate:
    """Parameter file: nested subsections with entries."""
    path, entries = [], dict[str, str]()
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["subsection"]:
            path.append(" ".join(words[1:]))
        elif words == ["end"]:
            path.pop()
        elif words:
            assert words[0] == "set"
            assert path == ["Material model", "Visco Plastic"]
            key, value = " ".join(words[1:]).split(" = ")
            entries[key] = value
    assert not path
    kind = entries["Viscous flow law"]
    gas = 8.3144621

    def number(key: str) -> float:
        return float(entries[key])

    assert number(f"Activation volumes for {kind} creep") == 0
    factor, energy = (
        number(f"{key} for {kind} creep") for key in ("Prefactors", "Activation energies")
    )
    if kind == "diffusion":
        grains = number("Grain size") ** number("Grain size exponents for diffusion creep")
        return _of_viscosity(lambda _, t: 0.5 / factor * np.exp(energy / (gas * t)) * grains)
    n = number("Stress exponents for dislocation creep")
    return _of_viscosity(
        lambda rate, t: (
            0.5 * factor ** (-1 / n) * np.exp(energy / (gas * t * n)) * rate ** ((1 - n) / n)
        )
    )


def underworld(text: str) -> Rate:
    """Register of viscous creep; units as in pint."""
    (record,) = json.loads(text).values()
    values = {}
    for key, one in record["coefficients"].items():
        unit, n = one["units"], record["coefficients"]["stressExponent"]["value"]
        known = {"None", "joule / mole", "meter ** 3 / mole", "meter"}
        assert unit in known or unit == f"1 / pascal ** {n!r} / second"
        values[key] = one["value"]
    n, p = values["stressExponent"], values["grainSizeExponent"]
    relative = values["grainSize"] / values["BurgersVectorLength"]
    factor, energy = values["preExponentialFactor"], values["activationEnergy"]
    assert values["activationVolume"] == 0

    def viscosity(rate: float, temperature: float) -> float:
        return float(
            0.5
            * factor ** (-1 / n)
            * rate ** ((1 - n) / n)
            * relative ** (p / n)
            * np.exp(energy / (8.3144621 * temperature * n))
        )

    return _of_viscosity(viscosity)


def geoparams(text: str) -> Rate:
    """Julia record: numbers times units, which are SI here."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert lines[0] == "using GeoParams"
    grain_size = re.fullmatch(r"grain_size = (\S+)m  # .*", lines[1])
    first = 1 if grain_size is None else 2
    record = re.fullmatch(r"creep_law = (\w+)\(;", lines[first])
    assert record is not None
    assert lines[-1] == ")"
    fields = dict(line.strip().removesuffix(",").split(" = ", 1) for line in lines[first + 1 : -1])
    assert fields.pop("Apparatus") == "Invariant"
    json.loads(fields.pop("Name"))
    number = r"(-?[\d.]+(?:e[-+]?\d+)?)"
    units = {"n": "NoUnits", "p": "NoUnits", "E": "J / mol", "V": "m^3 / mol", "R": "J / mol / K"}
    values, power = {}, r"\((-?\d+)//(\d+)\)"
    for key, value in fields.items():
        unit = rf"Pa\^{power}(?: \* m\^{power})? / s" if key == "A" else re.escape(units[key])
        found = re.fullmatch(number + unit, value)
        assert found is not None, value
        values[key] = float(found[1])
        if key == "A":
            stress, grains = found.groups()[1:3], found.groups()[3:]
            assert np.isclose(int(stress[0]) / int(stress[1]), -values["n"], atol=1e-9)
            if values.get("p", 0.0):
                assert np.isclose(int(grains[0]) / int(grains[1]), -values["p"], atol=1e-9)
    assert record[1] == ("GrainBoundarySliding" if "p" in values else "DislocationCreep")
    assert ("p" in values) is (grain_size is not None)
    size = 1.0 if grain_size is None else float(grain_size[1]) ** values["p"]
    return lambda stress, _, t: (
        values["A"] * stress ** values["n"] * size * np.exp(-values["E"] / (values["R"] * t))
    )


def lamem(text: str) -> Rate:
    """Input file: a material."""
    inside = text.split("<MaterialStart>\n")[1].split("<MaterialEnd>")[0]
    entries = dict(line.split("#")[0].strip().split(" = ") for line in inside.splitlines())
    letter = "n" if "Bn" in entries else "d"
    n = float(entries["n"]) if letter == "n" else 1.0
    factor, energy, volume = (float(entries[key + letter]) for key in "BEV")
    assert volume == 0
    return lambda stress, _, t: factor * np.exp(-energy / (8.3144621 * t)) * stress**n


def pism(text: str) -> Rate:
    """File of options; the law "arr"."""
    options = dict(
        line[1:].split(" ") for line in text.splitlines() if line and not line.startswith("#")
    )
    for part in ("sia", "ssa"):
        assert options[f"stress_balance.{part}.flow_law"] == "arr"
        assert float(options[f"stress_balance.{part}.enhancement_factor"]) == 1
    n, other = (float(options[f"stress_balance.{part}.Glen_exponent"]) for part in ("sia", "ssa"))
    assert n == other
    factor, energy = (float(options[f"flow_law.Paterson_Budd.{key}_cold"]) for key in "AQ")

    def rate(stress: float, _: float, temperature: float) -> float:
        softness = factor * np.exp(-energy / (8.31441 * temperature))
        return float(softness * stress ** (n - 1) * stress)

    return rate


def elmer(text: str) -> Rate:
    """Lines of a material in MPa, m and a, degrees Celsius."""
    body = [line for line in text.splitlines() if not line.startswith("!")]
    entries = dict(line.strip().split(" = ") for line in body)
    assert entries.pop("Viscosity Model") == 'String "Glen"'
    value = {key: float(one.removeprefix("Real ")) for key, one in entries.items()}
    n = value["Glen Exponent"]

    def viscosity(rate: float, temperature: float) -> float:
        celsius = temperature - 273.15
        branch = 1 if celsius <= value["Limit Temperature"] else 2
        factor = value[f"Rate Factor {branch}"] * np.exp(
            -value[f"Activation Energy {branch}"] / (8.314 * (273.15 + celsius))
        )
        squared = (rate * YEAR) ** 2
        enhanced = value["Glen Enhancement Factor"] * factor
        in_mpa = 0.5 * enhanced ** (-1 / n) * squared ** ((1 / n - 1) / 2)
        return float(in_mpa * 1e6 * YEAR)

    return _of_viscosity(viscosity)


def icepack(text: str) -> Rate:
    """Table of fluidity and exponent at temperatures."""
    table = pd.read_csv(io.StringIO(text), comment="#")
    rows = {row[0]: row[1:] for row in table[["temperature_K", "fluidity", "n"]].to_numpy()}

    def rate(stress: float, _: float, temperature: float) -> float:
        fluidity, n = rows[temperature]
        return float(fluidity * (stress / 1e6) ** n / YEAR)

    return rate


READERS = {
    one.__name__: one for one in (aspect, elmer, geoparams, icepack, lamem, pism, underworld)
}
