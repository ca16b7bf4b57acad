"use strict";
// Everything is on the page without this script; it adds sorting, filtering and folding.

function compare(a, b) {
  const x = a === "" ? NaN : Number(a), y = b === "" ? NaN : Number(b);
  if (a === "" || b === "") return (a === "") - (b === "");
  return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, "en", { numeric: true }) : x - y;
}

function sort(table, column, header) {
  const descending = header.getAttribute("aria-sort") === "none"
    ? header.classList.contains("number") // the largest number is what is looked for
    : header.getAttribute("aria-sort") === "ascending";
  for (const other of header.parentNode.children) other.setAttribute("aria-sort", "none");
  header.setAttribute("aria-sort", descending ? "descending" : "ascending");
  // a run has a body of two rows, any other row is one by itself
  const items = table.tBodies.length > 1 ? [...table.tBodies] : [...table.tBodies[0].rows];
  const keyed = items.map((item) => {
    const row = item.rows ? item.rows[0] : item, cell = row.cells[column];
    return [cell.dataset.value ?? cell.textContent.trim(), item];
  });
  keyed.sort(([a], [b]) => (descending && a !== "" && b !== "" ? compare(b, a) : compare(a, b)));
  const home = items[0].parentNode;
  for (const [, item] of keyed) home.appendChild(item);
}

for (const table of document.querySelectorAll("table.sortable")) {
  [...table.tHead.rows[0].cells].forEach((header, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...header.childNodes);
    header.append(button);
    button.addEventListener("click", () => sort(table, column, header));
  });
}

function unfold(button, open) {
  button.setAttribute("aria-expanded", String(open));
  document.getElementById(button.getAttribute("aria-controls")).hidden = !open;
}

const toggles = [...document.querySelectorAll(".toggle")];
for (const button of toggles) {
  unfold(button, false);
  button.addEventListener("click", () => unfold(button, button.getAttribute("aria-expanded") !== "true"));
}

const expand = document.getElementById("expand");
function unfoldAll(open) {
  expand.setAttribute("aria-pressed", String(open));
  for (const button of toggles) unfold(button, open);
}
expand.addEventListener("click", () => unfoldAll(expand.getAttribute("aria-pressed") !== "true"));

const filter = document.getElementById("filter");
const runs = [...document.querySelectorAll("table.runs tbody")];
function show() {
  for (const run of runs) run.hidden = filter.value !== "" && run.dataset.method !== filter.value;
  const left = runs.filter((run) => !run.hidden).length;
  document.getElementById("shown").textContent = `${left} of ${runs.length} runs`;
}
filter.addEventListener("change", show);
show();

for (const box of document.querySelectorAll(".scroll")) {
  const hint = () => {
    box.classList.toggle("scrolled", box.scrollLeft > 0);
    box.classList.toggle("beyond", box.scrollWidth - box.clientWidth - box.scrollLeft > 1);
  };
  box.addEventListener("scroll", hint, { passive: true });
  new ResizeObserver(hint).observe(box);
}

window.addEventListener("beforeprint", () => {
  unfoldAll(true);
  for (const box of document.querySelectorAll("details")) box.open = true;
});
