"use strict";
// Sorting, filters, and the runs behind a row. Text from results only ever becomes text, never markup.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const whole = (run) => Object.fromEntries(Object.entries(run).map(([key, value]) => [key, Array.isArray(value) ? data.parts[value[0]] : value]));

  const element = (name, text, ...children) => {
    const made = document.createElement(name);
    if (text !== "") made.textContent = text;
    made.append(...children);
    return made;
  };

  // What stands first in a cell as a number; NaN if nothing does.
  const number = (text) => parseFloat(text.replace(/,/g, ""));

  const sort = (head) => {
    const place = [...head.parentNode.children].indexOf(head);
    const body = head.closest("table").tBodies[0];
    const numeric = head.classList.contains("number");
    const descending = head.ariaSort ? head.ariaSort === "ascending" : numeric;
    for (const other of head.parentNode.children) other.ariaSort = null;
    head.ariaSort = descending ? "descending" : "ascending";
    const rows = [...body.rows].map((row) => ({ row, text: row.cells[place].textContent }));
    const missing = ({ text }) => text === "–" || (numeric && Number.isNaN(number(text)));
    const order = numeric ? (a, b) => number(a.text) - number(b.text) : (a, b) => a.text.localeCompare(b.text);
    rows.sort((a, b) => missing(a) - missing(b) || (missing(a) ? 0 : (descending ? -1 : 1) * order(a, b)));
    body.append(...rows.map(({ row }) => row));
  };

  const ticked = (id) => new Set([...document.querySelectorAll(`#${id} input:checked`)].map((box) => box.value));

  const filter = () => {
    const tracks = ticked("tracks");
    const access = ticked("access");
    const known = new Set([...document.querySelectorAll("#access input")].map((box) => box.value));
    const pair = document.getElementById("pair").value;
    for (const section of document.querySelectorAll("section")) section.hidden = !tracks.has(section.id);
    for (const row of document.querySelectorAll("tbody tr[data-access]")) {
      const needs = row.dataset.access.split(" ").filter((word) => known.has(word));
      row.hidden = !needs.every((word) => access.has(word)) || (pair !== "" && row.dataset.pair !== "" && row.dataset.pair !== pair);
    }
    for (const table of document.querySelectorAll("section table")) {
      const rows = [...table.tBodies[0].rows];
      const unseen = rows.filter((row) => row.hidden).length;
      table.parentNode.nextElementSibling.textContent = unseen ? `${unseen} of ${rows.length} rows are hidden by the filters.` : "";
    }
  };

  const shown = (value, digits) => (typeof value === "number" ? value.toLocaleString("en", { maximumFractionDigits: digits }) : value ?? "–");

  const columns = [
    ["pair", (run) => run.task],
    ["method", (run) => run.method],
    ["samples", (run) => shown(run.samples, 0)],
    ["preset", (run) => run.variant],
    ["seed", (run) => run.seed],
    ["normalised return", (run) => shown(run.normalized_return, 3)],
    ["return", (run) => shown(run.returns.policy.mean, 1)],
    ["grounded", (run) => shown(run.returns.grounded?.mean, 1)],
    ["action error", (run) => shown(run.action_transformation_error.value, 4)],
    ["transition error", (run) => shown(run.transition_error.value, 4)],
    ["min", (run) => shown(run.wall_clock_s.total / 60, 1)],
    ["commit", (run) => (run.commit ?? "–").slice(0, 10)],
  ];

  const runsTable = (runs) => {
    const head = element("tr", "", ...columns.map(([name]) => element("th", name)), element("th", "file"));
    const rows = runs.map((run) => {
      const link = element("a", "result.json");
      link.href = run.link;
      return element("tr", "", ...columns.map(([, cell]) => element("td", String(cell(run)))), element("td", "", link));
    });
    return element("table", "", element("thead", "", head), element("tbody", "", ...rows));
  };

  const wide = (table) => {
    const made = element("div", "", table);
    made.className = "wide";
    return made;
  };

  const leaves = (value, path) =>
    value !== null && typeof value === "object" && !Array.isArray(value)
      ? Object.entries(value).flatMap(([key, one]) => leaves(one, path === "" ? key : `${path}.${key}`))
      : [[path, Array.isArray(value) ? JSON.stringify(value) : String(value)]];

  const settings = (runs) => {
    const groups = new Map();
    for (const run of runs) {
      const key = run.settings[0];
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(run);
    }
    return [...groups].flatMap(([key, own]) => {
      const names = [...new Set(own.map((run) => `${run.method} on ${run.task}, ${run.variant}`))].join("; ");
      const rows = leaves(data.parts[key], "").map(([name, value]) => element("tr", "", element("td", "", element("code", name)), element("td", value)));
      return [element("h3", `Settings: ${names}`), rows.length ? wide(element("table", "", element("tbody", "", ...rows))) : element("p", "None.")];
    });
  };

  const all = (run) => {
    const made = element("details", "", element("summary", `All that ${run.method} on ${run.task}, seed ${run.seed}, came to`));
    made.firstChild.addEventListener("click", () => made.children.length > 1 || made.append(element("pre", JSON.stringify(whole(run), null, 1))));
    return made;
  };

  const dialog = document.querySelector("dialog");
  const show = (row) => {
    const runs = row.dataset.runs.split(" ").map((place) => data.runs[place]);
    const title = row.closest(".table").previousElementSibling.textContent;
    document.getElementById("what").textContent = `${title}: ${runs.length === 1 ? "a run" : `${runs.length} runs`}`;
    const again = element("p", "Repeat one with ", element("code", "python -m mpge_bench run --config RESULT.JSON --out again"), ".");
    document.getElementById("shown").replaceChildren(wide(runsTable(runs.map(whole))), again, ...settings(runs), element("h3", "Everything"), ...runs.map(all));
    dialog.showModal();
    dialog.scrollTop = 0;
  };

  for (const button of document.querySelectorAll("th button")) button.addEventListener("click", () => sort(button.parentNode));
  for (const row of document.querySelectorAll("tr[data-runs]")) row.addEventListener("click", () => window.getSelection().isCollapsed && show(row));
  document.querySelector(".filters").addEventListener("change", filter);
  document.getElementById("close").addEventListener("click", () => dialog.close());
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  filter();
})();
