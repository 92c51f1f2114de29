// The page with sliders: what is drawn. The model is in burgers.js, the draws are in draws.js.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
const FRAME = { left: 62, right: 460, top: 14, bottom: 270 };
const STRAINS = 60;
const FREQUENCIES = Array.from({ length: 60 }, (_, k) => 10 ** (-4 + 4 * k / 59));

// name, words, unit, SI value of the unit, logarithmic
const PARAMETERS = [
  ["maxwell_modulus", "E_M, Maxwell modulus", "GPa", 1e9, true],
  ["kelvin_modulus", "E_K, Kelvin modulus", "GPa", 1e9, true],
  ["kelvin_viscosity", "η_K, Kelvin viscosity", "GPa s", 1e9, true],
  ["reference_stress", "S₀, reference stress", "MPa", 1e6, true],
  ["stress_exponent", "n, stress exponent", "", 1, false],
  ["grain_size_exponent", "p, grain size exponent", "", 1, false],
  ["activation_enthalpy", "Q, activation enthalpy", "kJ/mol", 1e3, false],
  ["steady_state_grain_size", "d_ss, steady grain size", "µm", 1e-6, true],
  ["steady_state_fabric_factor", "F_ss, steady fabric factor", "", 1, false],
  ["critical_strain_grain_size", "ε_c1, critical strain of grain size", "%", 1e-2, true],
  ["critical_strain_fabric", "ε_c2, critical strain of fabric", "%", 1e-2, true],
];

const state = { set: null, values: {}, conditions: {} };

function element(name, attributes = {}, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

/** Draws of a set, each an object with its reference stress. */
function drawsOf(set) {
  const names = Object.keys(set.draws);
  return set.draws[names[0]].map((_, i) => {
    const draw = Object.fromEntries(names.map((name) => [name, set.draws[name][i]]));
    draw.reference_stress = referenceStress(draw, set.strain_rate, set.temperature,
      set.initial_grain_size);
    return draw;
  });
}

function quantile(values, share) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.round(share * (sorted.length - 1))];
}

/** Parameters of the sliders, beta from the reference stress. */
function chosen() {
  const { set, values } = state;
  return { ...values,
    beta: betaOfReferenceStress(values, values.reference_stress, set.strain_rate,
      set.temperature, set.initial_grain_size) };
}

function curve(p) {
  const c = state.conditions;
  const strains = Array.from({ length: STRAINS }, (_, k) =>
    state.set.final_strain * ((k + 1) / STRAINS) ** 1.5);
  const test = { strainRate: c.strainRate, temperature: c.temperature, grainSize: c.grainSize };
  const stresses = constantRate(p, test, strains, 1e-4);
  return stresses && [[0, 0], ...strains.map((strain, k) => [strain * 100, stresses[k] / 1e6])];
}

/** tan(delta) at frequencies, under the conditions and with the microstructure that are chosen. */
function attenuation(p, frequencies) {
  const c = state.conditions;
  const regime = { median: c.median, amplitude: c.amplitude };
  const steady = document.getElementById("steady").checked;
  return tanDelta(p, frequencies, regime, c.temperature,
    steady ? p.steady_state_grain_size : c.grainSize, steady ? p.steady_state_fabric_factor : 1);
}

function spectrum(p) {
  const values = attenuation(p, FREQUENCIES);
  return FREQUENCIES.map((frequency, k) => [Math.log10(frequency), Math.log10(values[k])]);
}

function niceTicks(low, high) {
  const raw = (high - low) / 5;
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * size).find((s) => s >= raw);
  const ticks = [];
  for (let t = Math.ceil(low / step) * step; t <= high + 1e-9 * step; t += step) ticks.push(t);
  return ticks;
}

/** Draw lines into an svg: `thin` and one thick one, with axes. */
function plot(id, thin, thick, axes) {
  const svg = document.getElementById(id);
  svg.replaceChildren();
  const lines = [...thin, thick].filter(Boolean);
  const xs = lines.flat().map((point) => point[0]);
  const ys = lines.flat().map((point) => point[1]);
  const [x0, x1] = [Math.min(...xs), Math.max(...xs)];
  const low = axes.log ? Math.floor(Math.min(...ys)) : 0;
  const high = axes.log ? Math.ceil(Math.max(...ys)) : Math.max(...ys) * 1.05;
  const x = (value) => FRAME.left + (value - x0) / (x1 - x0) * (FRAME.right - FRAME.left);
  const y = (value) => FRAME.bottom - (value - low) / (high - low) * (FRAME.bottom - FRAME.top);
  svg.append(element("rect", { class: "frame", x: FRAME.left, y: FRAME.top,
    width: FRAME.right - FRAME.left, height: FRAME.bottom - FRAME.top }));
  const number = (value) => (axes.log ? `1e${Math.round(value)}` : Number(value.toPrecision(6)));
  const whole = (ticks) => (axes.log ? ticks.filter((t) => Math.abs(t - Math.round(t)) < 1e-9) : ticks);
  for (const tick of whole(niceTicks(x0, x1))) {
    svg.append(element("text", { x: x(tick), y: FRAME.bottom + 18, "text-anchor": "middle" }, number(tick)));
  }
  for (const tick of whole(niceTicks(low, high))) {
    svg.append(element("line", { class: "tick", x1: FRAME.left, x2: FRAME.right, y1: y(tick), y2: y(tick) }));
    svg.append(element("text", { x: FRAME.left - 6, y: y(tick) + 4, "text-anchor": "end" }, number(tick)));
  }
  svg.append(element("text", { x: (FRAME.left + FRAME.right) / 2, y: 308, "text-anchor": "middle" }, axes.x));
  svg.append(element("text", { x: 14, y: 142, "text-anchor": "middle", transform: "rotate(-90 14 142)" }, axes.y));
  const path = (line) => line.map((point, i) =>
    `${i ? "L" : "M"}${x(point[0]).toFixed(1)} ${y(point[1]).toFixed(1)}`).join("");
  for (const line of thin.filter(Boolean)) svg.append(element("path", { class: "draw", d: path(line) }));
  for (const [strain, stress] of axes.readings || []) {
    if (strain <= x1 && stress <= high) {
      svg.append(element("circle", { class: "reading", cx: x(strain), cy: y(stress), r: 1.8 }));
    }
  }
  if (thick) svg.append(element("path", { class: "chosen", d: path(thick) }));
}

function say(id, figure, text) {
  document.getElementById(id).textContent = text;
  document.getElementById(figure).setAttribute("aria-label", text);
}

let pending = false;
function update() {
  if (pending) return;
  pending = true;
  requestAnimationFrame(() => {
    pending = false;
    redraw();
  });
}

function redraw() {
  const { set, conditions: c } = state;
  const p = chosen();
  const asMeasured = c.temperature === set.temperature && c.strainRate === set.strain_rate
    && c.grainSize === set.initial_grain_size;
  const readings = asMeasured
    ? set.readings.strain.map((strain, k) => [strain * 100, set.readings.stress[k] / 1e6]) : [];
  const thickCurve = curve(p);
  plot("curve", state.draws.map(curve), thickCurve,
    { x: "strain (%)", y: "stress (MPa)", readings });
  const top = thickCurve ? Math.max(...thickCurve.map((point) => point[1])) : NaN;
  say("curve-text", "curve", `Stress against strain; largest stress ${top.toPrecision(3)} MPa`
    + (asMeasured ? `; dots: ${set.kind} readings.` : "; readings are hidden: conditions are not theirs."));
  plot("spectrum", state.draws.map(spectrum), spectrum(p),
    { x: "frequency (Hz)", y: "tan δ", log: true });
  const [there] = attenuation(p, [1e-3]);
  say("spectrum-text", "spectrum", `Attenuation of cycles of ${(c.median / 1e6).toPrecision(3)} ± `
    + `${(c.amplitude / 1e6).toPrecision(3)} MPa; tan δ at 1 mHz is ${there.toPrecision(3)}.`);
}

/** A slider with its number; `set` receives SI values. */
function slider(parent, name, words, unit, size, logarithmic, range, value, set) {
  const label = document.createElement("label");
  label.className = "slider";
  const output = document.createElement("output");
  const input = document.createElement("input");
  const to = logarithmic ? Math.log : (v) => v;
  const from = logarithmic ? Math.exp : (v) => v;
  const show = (v) => { output.textContent = `${(v / size).toPrecision(4)} ${unit}`.trim(); };
  Object.assign(input, { type: "range", id: name, min: to(range[0]), max: to(range[1]), step: "any" });
  input.value = to(value);
  input.addEventListener("input", () => {
    const v = from(Number(input.value));
    show(v);
    set(v);
    update();
  });
  show(value);
  label.append(words, output, input);
  document.getElementById(parent).append(label);
}

function sliders() {
  document.querySelectorAll("#sliders label.slider").forEach((label) => label.remove());
  const { set, conditions: c } = state;
  for (const [name, words, unit, size, logarithmic] of PARAMETERS) {
    const values = state.draws.map((draw) => draw[name]);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const range = logarithmic ? [low / 1.5, high * 1.5]
      : [low - 0.5 * (high - low) - 1e-9, high + 0.5 * (high - low) + 1e-9];
    slider("parameters", name, words, unit, size, logarithmic, range, state.values[name],
      (v) => { state.values[name] = v; });
  }
  const t = set.temperature;
  slider("test", "temperature", "temperature", "K", 1, false, [0.94 * t, Math.min(1.06 * t, set.material === "ice" ? 273 : 3000)],
    c.temperature, (v) => { c.temperature = v; });
  slider("test", "strainRate", "strain rate", "1/s", 1, true, [set.strain_rate / 100, set.strain_rate * 10],
    c.strainRate, (v) => { c.strainRate = v; });
  slider("test", "grainSize", "grain size at the start", "µm", 1e-6, true,
    [set.initial_grain_size / 10, set.initial_grain_size * 10], c.grainSize, (v) => { c.grainSize = v; });
  slider("cycles", "median", "median stress", "MPa", 1e6, true, [c.median / 20, c.median * 10],
    c.median, (v) => { c.median = v; });
  slider("cycles", "amplitude", "amplitude", "MPa", 1e6, true, [c.amplitude / 20, c.amplitude * 10],
    c.amplitude, (v) => { c.amplitude = v; });
}

function place(values) {
  state.values = { ...values };
  sliders();
  update();
}

function median() {
  place(Object.fromEntries(PARAMETERS.map(([name]) =>
    [name, quantile(state.draws.map((draw) => draw[name]), 0.5)])));
}

function choose(index) {
  const set = DRAWS[index];
  state.set = set;
  state.draws = drawsOf(set);
  const stress = quantile(state.draws.map((draw) => draw.reference_stress), 0.5);
  state.conditions = { temperature: set.temperature, strainRate: set.strain_rate,
    grainSize: set.initial_grain_size, median: 0.2 * stress, amplitude: 0.03 * stress };
  document.getElementById("about").textContent =
    `${set.id}: ${set.material}, ${set.kind} data. ${set.source}. ${set.verdicts.join(" ")}`;
  median();
}

const select = document.getElementById("set");
DRAWS.forEach((set, index) => {
  const option = document.createElement("option");
  option.value = index;
  option.textContent = `${set.id} (${set.material}, ${set.kind})`;
  select.append(option);
});
select.addEventListener("change", () => choose(Number(select.value)));
let next = 0;
document.getElementById("draw").addEventListener("click", () => {
  next = (next + 1) % state.draws.length;
  place(state.draws[next]);
});
document.getElementById("median").addEventListener("click", median);
document.getElementById("steady").addEventListener("change", update);
document.getElementById("sliders").addEventListener("submit", (event) => event.preventDefault());
choose(0);
