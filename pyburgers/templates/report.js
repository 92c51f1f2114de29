"use strict";
// Everything on the page can be read without this; it adds enlarging, copying and definitions on touch.
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

// A picture moves into the dialog and back, so that its parts keep their names.
const dialog = document.getElementById("enlarged");
const stage = dialog.querySelector(".stage");
let place = null;
function enlarge(picture) {
  place = picture;
  dialog.setAttribute("aria-label", picture.dataset.title);
  stage.replaceChildren(picture.querySelector("svg"));
  dialog.showModal();
}
dialog.addEventListener("close", () => { place.append(stage.firstElementChild); });
dialog.addEventListener("click", (event) => { if (event.target.closest("svg, button") || event.target === dialog) dialog.close(); });
for (const picture of all(".picture")) {
  const button = document.createElement("button");
  button.className = "enlarge";
  button.textContent = "⤢";
  button.setAttribute("aria-label", "Enlarge: " + picture.dataset.title);
  button.addEventListener("click", () => enlarge(picture));
  picture.nextElementSibling.prepend(button);
  picture.addEventListener("click", (event) => { if (event.target.closest("svg")) enlarge(picture); });
}

// Tables of results as text for other programs.
const cells = (row) => [...row.cells];
const quoted = (text) => /[",\n]/.test(text) ? '"' + text.replaceAll('"', '""') + '"' : text;
const asCsv = (table) => [...table.rows].map((row) => cells(row).map((cell) => quoted(cell.innerText.trim())).join(",")).join("\n") + "\n";
const marks = { "\\": "\\textbackslash{}", "{": "\\{", "}": "\\}", "&": "\\&", "%": "\\%", "$": "\\$", "#": "\\#", "_": "\\_", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}", "±": "$\\pm$", "−": "$-$", "µ": "$\\mu$", "·": "$\\cdot$", "×": "$\\times$", "–": "--", "‑": "-", "⁻": "$^{-}$", "⁶": "$^{6}$", "∞": "$\\infty$" };
const escaped = (text) => [...text.trim()].map((letter) => marks[letter] ?? letter).join("");
function asLatex(table) {
  const [head, ...body] = [...table.rows].map((row) => cells(row).map((cell) => cell.dataset.tex ?? escaped(cell.innerText)).join(" & ") + " \\\\");
  const columns = cells(table.rows[0]).map((cell) => cell.classList.contains("words") ? "l" : "r").join("");
  return ["\\begin{tabular}{" + columns + "}", "\\hline", head, "\\hline", ...body, "\\hline", "\\end{tabular}", ""].join("\n");
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
