// The model of docs/model.md for the page with sliders: tan(delta) of stress cycles in closed form, and
// a test at constant strain rate. Everything is SI. tests/site compares both with the library.
"use strict";

const GAS_CONSTANT = 8.314462618;

/** Stress at which undeformed material flows at a strain rate. */
function referenceStress(p, strainRate, temperature, grainSize) {
  const logRate = Math.log(strainRate) + p.grain_size_exponent * Math.log(grainSize)
    - p.activation_enthalpy * (p.beta - 1 / (GAS_CONSTANT * temperature));
  return Math.exp(logRate / p.stress_exponent);
}

/** beta with which the reference stress has a given value. */
function betaOfReferenceStress(p, stress, strainRate, temperature, grainSize) {
  const logRate = Math.log(strainRate) + p.grain_size_exponent * Math.log(grainSize)
    - p.stress_exponent * Math.log(stress);
  return logRate / p.activation_enthalpy + 1 / (GAS_CONSTANT * temperature);
}

/** ln of the rate of the dashpot at 1 Pa. */
function logRateAtOne(p, temperature, grainSize, fabricFactor) {
  return p.activation_enthalpy * (p.beta - 1 / (GAS_CONSTANT * temperature))
    - p.grain_size_exponent * Math.log(grainSize) - p.stress_exponent * Math.log(fabricFactor);
}

/** What the dashpot adds to the loss compliance of cycles, times the angular frequency. */
function fluidity(p, regime, temperature, grainSize, fabricFactor) {
  const { median, amplitude } = regime;
  const count = amplitude > median ? 1024 : 64;
  const peak = median + amplitude;
  let sum = 0;
  for (let k = 0; k < count; k += 1) {
    const sine = Math.sin(Math.PI * ((k + 0.5) / count - 0.5));
    const relative = (median + amplitude * sine) / peak;
    sum += Math.sign(relative) * Math.abs(relative) ** p.stress_exponent * sine;
  }
  const logPeakRate = logRateAtOne(p, temperature, grainSize, fabricFactor)
    + p.stress_exponent * Math.log(peak);
  return Math.exp(logPeakRate) * sum * 2 / count / amplitude;
}

/** tan(delta) at frequencies (Hz), microstructure frozen. */
function tanDelta(p, frequencies, regime, temperature, grainSize, fabricFactor) {
  const dashpot = fluidity(p, regime, temperature, grainSize, fabricFactor);
  return frequencies.map((frequency) => {
    const omega = 2 * Math.PI * frequency;
    const denominator = p.kelvin_modulus ** 2 + (omega * p.kelvin_viscosity) ** 2;
    const storage = 1 / p.maxwell_modulus + p.kelvin_modulus / denominator;
    const loss = omega * p.kelvin_viscosity / denominator + dashpot / omega;
    return loss / storage;
  });
}

/**
 * Stress at strains, from rest at a constant strain rate.
 *
 * Two states along strain, stress over the reference stress and Kelvin strain, by the Rosenbrock
 * method of order 2 with an estimate of order 3 (Shampine and Reichelt 1997), steps chosen so that
 * the error stays below the tolerance.
 */
function constantRate(p, test, strains, tolerance = 1e-7) {
  const { strainRate, temperature, grainSize } = test;
  const scale = referenceStress(p, strainRate, temperature, grainSize);
  const n = p.stress_exponent;
  const elastic = p.maxwell_modulus / scale;
  const kelvinStress = scale / (p.kelvin_viscosity * strainRate);
  const kelvinStrain = p.kelvin_modulus / (p.kelvin_viscosity * strainRate);
  // Rate of the dashpot over the imposed one at the reference stress, as microstructure evolves.
  const softness = (strain) => {
    const size = p.steady_state_grain_size
      + (grainSize - p.steady_state_grain_size) * Math.exp(-strain / p.critical_strain_grain_size);
    const fabric = p.steady_state_fabric_factor
      + (1 - p.steady_state_fabric_factor) * Math.exp(-strain / p.critical_strain_fabric);
    return (size / grainSize) ** -p.grain_size_exponent * fabric ** -n;
  };
  const slope = (strain, y) => {
    const kelvin = kelvinStress * y[0] - kelvinStrain * y[1];
    const dashpot = softness(strain) * Math.sign(y[0]) * Math.abs(y[0]) ** n;
    return [elastic * (1 - kelvin - dashpot), kelvin];
  };
  const slopeByStress = (strain, y) => softness(strain) * n * Math.abs(y[0]) ** (n - 1);
  const d = 1 / (2 + Math.SQRT2);
  const e32 = 6 + Math.SQRT2;
  const found = [];
  let strain = 0;
  let y = [0, 0];
  let step = 1e-3 / elastic;
  let f0 = slope(strain, y);
  for (const target of strains) {
    let tries = 0;
    while (strain < target) {
      tries += 1;
      if (tries > 100000) return null;
      const rest = target - strain;
      const last = step >= rest;
      const h = last ? rest : step;
      // W = I - h d J, inverted by hand.
      const byStress = slopeByStress(strain, y);
      const w00 = 1 + h * d * elastic * (kelvinStress + byStress);
      const w01 = -h * d * elastic * kelvinStrain;
      const w10 = -h * d * kelvinStress;
      const w11 = 1 + h * d * kelvinStrain;
      const determinant = w00 * w11 - w01 * w10;
      const solve = (a, b) => [(w11 * a - w01 * b) / determinant,
        (w00 * b - w10 * a) / determinant];
      const delta = Math.max(1e-12, 1e-6 * h);
      const ahead = slope(strain + delta, y);
      const t = [(ahead[0] - f0[0]) / delta * h * d, (ahead[1] - f0[1]) / delta * h * d];
      const k1 = solve(f0[0] + t[0], f0[1] + t[1]);
      const f1 = slope(strain + h / 2, [y[0] + h / 2 * k1[0], y[1] + h / 2 * k1[1]]);
      const s = solve(f1[0] - k1[0], f1[1] - k1[1]);
      const k2 = [s[0] + k1[0], s[1] + k1[1]];
      const next = [y[0] + h * k2[0], y[1] + h * k2[1]];
      const f2 = slope(strain + h, next);
      const k3 = solve(
        f2[0] - e32 * (k2[0] - f1[0]) - 2 * (k1[0] - f0[0]) + t[0],
        f2[1] - e32 * (k2[1] - f1[1]) - 2 * (k1[1] - f0[1]) + t[1],
      );
      let error = 0;
      for (let i = 0; i < 2; i += 1) {
        const size = tolerance * (Math.max(Math.abs(y[i]), Math.abs(next[i])) + (i ? 1e-3 : 1e-2));
        error = Math.max(error, Math.abs(h / 6 * (k1[i] - 2 * k2[i] + k3[i])) / size);
      }
      if (error <= 1) {
        strain = last ? target : strain + h;
        y = next;
        f0 = f2;
        if (!last) step *= Math.min(5, 0.8 * Math.max(error, 1e-6) ** (-1 / 3));
      } else {
        step = h * Math.max(0.1, 0.8 * error ** (-1 / 3));
      }
    }
    found.push(y[0] * scale);
  }
  return found;
}

if (typeof module !== "undefined") {
  module.exports = { betaOfReferenceStress, constantRate, referenceStress, tanDelta };
}
