"use strict";
// Everything on the page can be read without this; it adds zooming, values, copying and definitions on touch.
const all = (selector, within = document) => [...within.querySelectorAll(selector)];

// Links into folded parts unfold them.
function unfold() {
  let target = null;
  try { target = document.getElementById(decodeURIComponent(location.hash.slice(1))); } catch { return; }
  if (!target) return;
  for (let part = target.closest("details"); part; part = part.parentElement.closest("details")) part.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", unfold);
unfold();

// The list of contents is in the way on a small screen.
const contents = document.getElementById("contents");
const small = matchMedia("(max-width: 60rem)");
const fold = () => { contents.open = !small.matches; };
small.addEventListener("change", fold);
fold();
contents.addEventListener("click", (event) => { if (small.matches && event.target.closest("a")) contents.open = false; });

// Where the reader is.
const links = new Map(all("a", contents).map((link) => [link.hash.slice(1), link]));
const seen = new IntersectionObserver((found) => {
  for (const one of found) {
    if (!one.isIntersecting) continue;
    for (const link of links.values()) link.removeAttribute("aria-current");
    links.get(one.target.id).setAttribute("aria-current", "true");
  }
}, { rootMargin: "0px 0px -75% 0px" });
for (const id of links.keys()) { const part = document.getElementById(id); if (part) seen.observe(part); }

// A figure can be zoomed and moved, and tells the reading or the point of a curve that is nearest.
const REACH = 24, SPACING = 3, DEEPEST = 40; // pixels, points between places on a curve, times
const told = document.createElement("div");
told.className = "told";
told.setAttribute("role", "status");
const ring = document.createElementNS("http://www.w3.org/2000/svg", "circle");
ring.setAttribute("class", "ring");
const clear = () => { told.remove(); ring.remove(); };
function explorer(svg) {
  const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
  const panels = JSON.parse(svg.dataset.panels), down = new Map();
  let view = [0, 0, width], places = null, here = -1;
  const show = (x, y, w) => {
    const size = Math.min(1, Math.max(1 / DEEPEST, w / width)), most = 1 - size;
    view = [Math.min(Math.max(x, 0), most * width), Math.min(Math.max(y, 0), most * height), size * width];
    svg.setAttribute("viewBox", [...view, size * height].join(" "));
    svg.classList.toggle("zoomed", size < 1);
    if (ring.parentNode === svg) tell(places[here]);
  };
  const reset = () => { clear(); show(0, 0, width); };
  const move = (right, below) => show(view[0] + right * view[2], view[1] + below * view[2], view[2]);
  const middle = () => [view[0] + view[2] / 2, view[1] + (view[2] * height) / width / 2];
  const zoom = (times, [x, y] = ring.parentNode === svg ? places[here].point : middle()) => {
    const w = Math.min(width, Math.max(width / DEEPEST, view[2] / times)), part = w / view[2];
    show(x - (x - view[0]) * part, y - (y - view[1]) * part, w);
  };
  const at = (event) => { const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()); return [p.x, p.y]; };
  const distance = ([x, y], [x2, y2]) => Math.hypot(x - x2, y - y2);
  function* placesOf(series) {
    for (const dot of all("use", series)) yield [[Number(dot.getAttribute("x")), Number(dot.getAttribute("y"))], true];
    for (const path of all("path", series).filter((one) => !one.closest("defs"))) {
      for (const run of path.getAttribute("d").split("M")) {
        let last = null;
        for (const [, x, y] of run.matchAll(/(-?[\d.]+) (-?[\d.]+)/g)) {
          const next = [Number(x), Number(y)], parts = last ? Math.ceil(distance(last, next) / SPACING) : 0;
          for (let k = 1; k <= parts; k++) yield [last.map((from, axis) => from + ((next[axis] - from) * k) / parts), false];
          last = next;
        }
      }
    }
  }
  const find = () => all("[data-series]", svg).flatMap((series) => {
    const [left, top, right, bottom] = panels[series.dataset.panel];
    const isInside = ([x, y]) => x >= left * width - 1 && x <= right * width + 1 && y >= top * height - 1 && y <= bottom * height + 1;
    return [...placesOf(series)].filter(([point]) => isInside(point)).map(([point, isRead]) => ({ point, isRead, series }));
  });
  function tell({ point: [x, y], series }) {
    const [left, top, right, bottom, ...axes] = panels[series.dataset.panel];
    const shares = [(x / width - left) / (right - left), (bottom - y / height) / (bottom - top)];
    const values = axes.map(([low, high, isLog, unit], k) => {
      const value = low + (high - low) * shares[k], step = Math.abs(high - low) / 2000;
      return `${Number((isLog ? 10 ** value : Math.round(value / step) * step).toPrecision(4))} ${unit}`.trim();
    });
    told.textContent = `${series.dataset.series}: ${values.join(", ")}`;
    const size = view[2] / width;
    for (const [name, value] of Object.entries({ cx: x, cy: y, r: 2.5 + 3 * size, "stroke-width": 1.5 * size })) ring.setAttribute(name, value);
    svg.append(ring);
    svg.parentElement.append(told);
    const corner = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    told.style.left = Math.max(4, Math.min(corner.x + 12, innerWidth - told.offsetWidth - 4)) + "px";
    told.style.top = Math.max(4, corner.y - told.offsetHeight - 10) + "px";
  }
  function nearest(event) {
    const pointer = at(event), pixels = svg.getScreenCTM().a;
    const away = (places ??= find()).map((one) => distance(one.point, pointer) * pixels * (one.isRead ? 0.5 : 1));
    here = away.reduce((best, one, k) => (one < away[best] ? k : best), 0);
    if (away[here] < REACH) tell(places[here]); else clear();
  }
  const step = (by) => {
    if (!(places ??= find()).length) return;
    const { point } = places[here = (here + by + places.length) % places.length], [x, y] = middle();
    const isSeen = Math.abs(point[0] - x) < view[2] / 2 && Math.abs(point[1] - y) < (view[2] * height) / width / 2;
    if (!isSeen) show(view[0] + point[0] - x, view[1] + point[1] - y, view[2]);
    tell(places[here]);
  };
  const on = (name, action) => svg.addEventListener(name, action, { passive: false });
  on("wheel", (event) => { if (event.ctrlKey || svg.closest(":focus")) { event.preventDefault(); zoom(1.002 ** -event.deltaY, at(event)); } });
  on("touchstart", (event) => { if (event.touches.length > 1) event.preventDefault(); });
  on("pointerdown", (event) => { down.set(event.pointerId, at(event)); nearest(event); });
  on("pointermove", (event) => {
    const from = down.get(event.pointerId), to = at(event), other = [...down].find(([id]) => id !== event.pointerId)?.[1];
    if (!from) nearest(event);
    else if (other) { zoom(distance(to, other) / distance(from, other), other); down.set(event.pointerId, at(event)); }
    else if (view[2] < width) { svg.setPointerCapture(event.pointerId); show(view[0] + from[0] - to[0], view[1] + from[1] - to[1], view[2]); }
  });
  for (const name of ["pointerup", "pointercancel", "pointerleave"]) on(name, (event) => { down.delete(event.pointerId); if (name === "pointerleave") clear(); });
  on("dblclick", reset);
  addEventListener("beforeprint", reset);
  return { "+": () => zoom(1.3), "-": () => zoom(1 / 1.3), 0: reset, ",": () => step(-1), ".": () => step(1), ArrowLeft: () => move(-0.1, 0), ArrowRight: () => move(0.1, 0), ArrowUp: () => move(0, -0.1), ArrowDown: () => move(0, 0.1) };
}

// A picture moves into the dialog and back, so that its parts keep their names.
const dialog = document.getElementById("enlarged");
const stage = dialog.querySelector(".stage");
let place = null;
function enlarge(picture) {
  place = picture;
  dialog.setAttribute("aria-label", picture.dataset.title);
  stage.replaceChildren(picture.querySelector("svg"));
  dialog.showModal();
  stage.focus();
}
dialog.addEventListener("close", () => { place.append(stage.querySelector("svg")); });
dialog.addEventListener("click", (event) => { if (event.target.closest("button") || event.target === dialog) dialog.close(); });
const explorers = new Map();
for (const picture of all(".picture")) {
  const svg = picture.querySelector("svg");
  explorers.set(svg, explorer(svg));
  const button = document.createElement("button");
  button.className = "enlarge";
  button.textContent = "⤢";
  button.setAttribute("aria-label", "Enlarge: " + picture.dataset.title);
  button.addEventListener("click", () => enlarge(picture));
  picture.nextElementSibling.prepend(button);
}
for (const part of [stage, ...all(".picture")]) {
  part.addEventListener("keydown", (event) => {
    const svg = part.querySelector("svg"), isArrow = event.key.startsWith("Arrow");
    const action = explorers.get(svg)[event.key === "=" ? "+" : event.key];
    if (!action || event.ctrlKey || event.metaKey || (isArrow && !svg.classList.contains("zoomed"))) return;
    event.preventDefault();
    action();
  });
}

// Tables of results as text for other programs.
const cells = (row) => [...row.cells];
const asText = (text) => /^[=+@-]/.test(text) && Number.isNaN(Number(text.replace(/ ± [\d.]+$/, ""))) ? "'" + text : text; // no formula of a spreadsheet
const quoted = (text) => /[",\n]/.test(text) ? '"' + text.replaceAll('"', '""') + '"' : text;
const textOf = (cell) => {
  const copy = cell.cloneNode(true);
  for (const sub of all("sub", copy)) sub.prepend("_");
  return copy.textContent.trim().replace(/\s+/g, " ").replaceAll("‑", "-");
};
// The fits behind a table, and the answers that are not yes, as a comment.
const about = (table, sign) => { const told = table.closest("[data-about]")?.dataset.about; return told ? `${sign} ${told.replace(/\s+/g, " ")}\n` : ""; };
const asCsv = (table) => about(table, "#") + [...table.rows].map((row) => cells(row).map((cell) => quoted(asText(textOf(cell)))).join(",")).join("\n") + "\n";
const marks = { "\\": "\\textbackslash{}", "{": "\\{", "}": "\\}", "&": "\\&", "%": "\\%", "$": "\\$", "#": "\\#", "_": "\\_", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "±": "$\\pm$", "−": "$-$", "µ": "$\\mu$", "·": "$\\cdot$", "×": "$\\times$", "–": "--", "⁻": "$^{-}$", "³": "$^{3}$", "⁶": "$^{6}$", "∞": "$\\infty$", "Δ": "$\\Delta$", "α": "$\\alpha$", "β": "$\\beta$", "δ": "$\\delta$", "ε": "$\\epsilon$", "ε̇": "$\\dot\\epsilon$", "η": "$\\eta$", "σ": "$\\sigma$", "τ": "$\\tau$", "φ": "$\\phi$" };
const escaped = (text) => text.replace(/.\u0307?/gsu, (letter) => marks[letter] ?? letter);
function asLatex(table) {
  const [head, ...body] = [...table.rows].map((row) => cells(row).map((cell) => cell.dataset.tex ?? escaped(textOf(cell))).join(" & ") + " \\\\");
  const columns = cells(table.rows[0]).map((cell) => cell.classList.contains("words") ? "l" : "r").join("");
  return about(table, "%") + ["\\begin{tabular}{" + columns + "}", "\\hline", head, "\\hline", ...body, "\\hline", "\\end{tabular}", ""].join("\n");
}
async function copy(text) {
  try { await navigator.clipboard.writeText(text); return true; } catch { /* pages from files may not */ }
  const field = document.createElement("textarea");
  field.value = text;
  document.body.append(field);
  field.select();
  const done = document.execCommand("copy");
  field.remove();
  return done;
}
for (const table of all("table.results")) {
  const bar = document.createElement("div");
  bar.className = "copy";
  for (const [name, written] of [["CSV", asCsv], ["LaTeX", asLatex]]) {
    const button = document.createElement("button");
    const say = (text, label) => { button.textContent = text; button.setAttribute("aria-label", label); };
    say(name, "Copy " + name);
    button.addEventListener("click", async () => {
      const done = (await copy(written(table))) ? "Copied" : "Not copied";
      say(done, done);
      setTimeout(() => say(name, "Copy " + name), 1500);
    });
    bar.append(button);
  }
  table.parentElement.before(bar);
}

// Definitions where there is no pointer to hover with.
addEventListener("click", (event) => {
  all(".definition").forEach((one) => one.remove());
  const word = event.target.closest("abbr[title]");
  if (!word) return;
  const note = document.createElement("div");
  note.className = "definition";
  note.setAttribute("role", "status");
  note.textContent = word.title;
  document.body.append(note);
  const at = word.getBoundingClientRect();
  note.style.top = at.bottom + scrollY + 4 + "px";
  note.style.left = Math.max(4, Math.min(at.left, innerWidth - note.offsetWidth - 8)) + scrollX + "px";
});

// On paper nothing is folded.
let folded = [];
addEventListener("beforeprint", () => { folded = all("main details:not([open])"); for (const part of folded) part.open = true; });
addEventListener("afterprint", () => { for (const part of folded) part.open = false; });
