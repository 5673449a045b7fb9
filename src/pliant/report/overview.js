const CHUNK = 100; // rows that are drawn at a time
const { cells, columns, pages, quantities } = data;
const count = columns.cell.length;
const all = Array.from({ length: count }, (_, n) => n);
const place = document.getElementById("list");
const cellOf = (n) => cells[columns.cell[n]];
/** null where nothing was measured. */
const inserted = (n) => (columns.fault[n] ? null : (columns.inserted[n] ?? columns.judged[n]));

// --- what is wanted: kept in the address, so that a link can say it ------------------------------

const NAMES = ["level", "reasoner", "peg", "condition", "outcome", "kind", "seed", "drawn", "least", "most", "against"];
let wanted = {};
let sorting = { by: "first", up: true };
let shown = [];
let drawn = 0;

const OUTCOMES = {
  inserted: ["inserted", (n) => inserted(n) === 1],
  failed: ["not inserted", (n) => inserted(n) === 0],
  faults: ["fault", (n) => columns.fault[n] === 1],
  disagreed: ["judged ≠ inserted", (n) => columns.inserted[n] !== null && columns.inserted[n] !== columns.judged[n]],
};

/** Whether the other reasoner inserted the same peg under the same draw. */
function insertedBy(other) {
  const key = (n) => { const { level, peg, condition } = cellOf(n); return JSON.stringify([level, peg, condition, columns.seed[n]]); };
  const theirs = new Map();
  for (const n of all) if (cellOf(n).reasoner === other) theirs.set(key(n), inserted(n) === 1);
  return (n) => theirs.get(key(n)) === true;
}

function seedTest(text) {
  const [low, high] = text.split("-").map((part) => Number.parseInt(part, 10));
  if (Number.isNaN(low)) return () => true;
  return (n) => columns.seed[n] >= low && columns.seed[n] <= (Number.isNaN(high ?? low) ? Infinity : high ?? low);
}

function tests() {
  const made = [];
  for (const name of ["level", "reasoner", "peg", "condition"]) {
    if (wanted[name]) made.push((n) => cellOf(n)[name] === wanted[name]);
  }
  if (OUTCOMES[wanted.outcome]) made.push(OUTCOMES[wanted.outcome][1]);
  if (wanted.kind) made.push((n) => data.kindNames[columns.kind[n]] === wanted.kind);
  if (wanted.seed) made.push(seedTest(wanted.seed));
  if (wanted.drawn in quantities) {
    const values = columns[wanted.drawn], least = Number(wanted.least), most = Number(wanted.most);
    const highest = values.reduce((a, b) => Math.max(a, b), -Infinity); // is in the last bin
    const constant = new Map(); // cells that do not draw it
    for (const n of all) {
      const seen = constant.get(columns.cell[n]);
      constant.set(columns.cell[n], seen === undefined || seen === values[n] ? values[n] : NaN);
    }
    made.push((n) => values[n] >= least && (values[n] < most || (values[n] === most && most === highest)) && Number.isNaN(constant.get(columns.cell[n])));
  }
  if (wanted.against) made.push(insertedBy(wanted.against));
  return made;
}

// --- columns ------------------------------------------------------------------------------------

const number = (v, digits) => (v === null || v === undefined ? "–" : v.toFixed(digits).replace("-", "−"));
const yesNo = (v) => (v === null ? "not known" : v ? "✓ yes" : "✗ no");
const voteClass = (v) => (v === null ? "vote none" : v ? "vote yes" : "vote no");
const text = (value) => ({ value, shown: value });
const amount = (values, digits) => (n) => ({ value: values[n] ?? -Infinity, shown: number(values[n], digits) });
const vote = (values) => (n) => ({ value: values[n] ?? -1, shown: yesNo(values[n]), kind: voteClass(values[n]) });

const COLUMNS = [
  { name: "page", label: "trial", of: (n) => ({ value: n in pages ? 0 : 1, shown: pageLink(n) }) },
  ...(new Set(cells.map((c) => c.level)).size > 1 ? [{ name: "level", label: "level", of: (n) => text(cellOf(n).level) }] : []),
  { name: "reasoner", label: "reasoner", of: (n) => text(cellOf(n).reasoner) },
  ...(cells.some((c) => c.model) ? [{ name: "model", label: "model", of: (n) => text(cellOf(n).model) }] : []),
  { name: "peg", label: "peg", of: (n) => text(cellOf(n).peg) },
  { name: "condition", label: "condition", of: (n) => text(cellOf(n).condition) },
  { name: "seed", label: "seed", of: amount(columns.seed, 0) },
  { name: "judged", label: "judged", of: vote(columns.judged.map((v, n) => (columns.fault[n] ? null : v))) },
  { name: "inserted", label: "inserted", of: vote(columns.inserted) },
  { name: "depth", label: "depth [mm]", of: amount(columns.depth, 1) },
  { name: "end", label: "end", of: (n) => text(data.ends[columns.end[n]]) },
  { name: "kind", label: "failure", of: (n) => text(data.kinds[columns.kind[n]] ?? "–") },
  { name: "executions", label: "executions", of: amount(columns.executions, 0) },
  ...Object.entries(quantities).map(([name, label]) => ({ name, label, of: amount(columns[name], 2) })),
  ...("decisions" in columns ? [
    { name: "decisions", label: "asked", of: amount(columns.decisions, 0) },
    { name: "fallbacks", label: "by the rules", of: amount(columns.fallbacks, 0) },
    { name: "clamped", label: "clamped", of: amount(columns.clamped, 0) },
    { name: "tokens", label: "tokens", of: amount(columns.tokens, 0) },
    { name: "cost_usd", label: "cost [USD]", of: amount(columns.cost_usd, 4) },
    { name: "latency_s", label: "waited [s]", of: amount(columns.latency_s, 1) },
  ] : []),
];

/** Faults first, then failures, and of these the ones that can be looked at. */
const first = (n) => 2 * (inserted(n) ?? -1) + (n in pages ? 0 : 1);

function pageLink(n) {
  if (n in pages) return element("a", { href: pages[n] }, "page");
  const command = cellOf(n).command.replace("SEED", columns.seed[n]);
  return element("details", {}, element("summary", {}, "no page"), element("code", {}, command));
}

// --- the list -----------------------------------------------------------------------------------

const body = element("tbody");
const status = element("p", { role: "status", class: "hint" });
const more = element("button", { type: "button", class: "more" });
const chips = element("div", { class: "chips" });
const controls = {};
const headers = {};

function options(name, label, entries) {
  const select = element("select", {}, element("option", { value: "" }, "any"));
  for (const [value, words] of entries) select.append(element("option", { value }, words));
  select.addEventListener("change", () => ask({ [name]: select.value }));
  controls[name] = select;
  return element("label", {}, label, select);
}

function distinct(name) {
  return [...new Set(cells.map((c) => c[name]))].map((v) => [v, v]);
}

function build() {
  const seed = element("input", { type: "text", inputmode: "numeric", size: "8", placeholder: "7 or 1-30" });
  seed.addEventListener("input", () => ask({ seed: seed.value.trim() }));
  controls.seed = seed;
  const reset = element("button", { type: "button" }, "Show all");
  reset.addEventListener("click", () => ask(Object.fromEntries(NAMES.map((name) => [name, ""]))));
  const used = [...new Set(columns.kind)].filter((k) => k >= 0).sort((a, b) => a - b);
  const form = element("form", { class: "filters", "aria-label": "Which trials" },
    ...(distinct("level").length > 1 ? [options("level", "level", distinct("level"))] : []),
    options("reasoner", "reasoner", distinct("reasoner")),
    options("peg", "peg", distinct("peg")),
    options("condition", "condition", distinct("condition")),
    options("outcome", "outcome", Object.entries(OUTCOMES).map(([value, [words]]) => [value, words])),
    options("kind", "failure", used.map((k) => [data.kindNames[k], data.kinds[k]])),
    element("label", {}, "seed", seed),
    reset,
  );
  form.addEventListener("submit", (event) => event.preventDefault());
  const head = element("tr");
  for (const { name, label } of COLUMNS) {
    const button = element("button", { type: "button" }, label);
    button.addEventListener("click", () => sortBy(name));
    headers[name] = element("th", { scope: "col" }, button);
    head.append(headers[name]);
  }
  const caption = element("caption", {}, "Failures first. A column's name sorts by it. “no page” says the command that runs the trial again and makes one; PEG.yaml in it stands for your own peg file.");
  const table = element("table", {}, caption, element("thead", {}, head), body);
  more.addEventListener("click", () => draw());
  place.replaceChildren(form, chips, status, element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Trials" }, table), more);
}

function sortBy(name) {
  sorting = { by: name, up: sorting.by === name ? !sorting.up : true };
  list();
}

/** Change what is wanted, and with it the address. */
function ask(change) {
  wanted = Object.fromEntries(Object.entries({ ...wanted, ...change }).filter(([, value]) => value));
  const query = new URLSearchParams(wanted).toString();
  history.replaceState(null, "", query ? `#${query}` : "#trials");
  list();
}

function list() {
  const kept = tests();
  shown = all.filter((n) => kept.every((test) => test(n)));
  const column = COLUMNS.find(({ name }) => name === sorting.by);
  const keys = new Map(shown.map((n) => [n, column ? column.of(n).value : first(n)]));
  const order = sorting.up ? 1 : -1;
  shown.sort((a, b) => {
    const [x, y] = [keys.get(a), keys.get(b)];
    return (x < y ? -order : x > y ? order : first(a) - first(b)) || a - b;
  });
  for (const [name, header] of Object.entries(headers)) {
    if (name === sorting.by) header.setAttribute("aria-sort", sorting.up ? "ascending" : "descending");
    else header.removeAttribute("aria-sort");
  }
  for (const [name, control] of Object.entries(controls)) {
    if (control !== document.activeElement || control.tagName === "SELECT") control.value = wanted[name] ?? "";
  }
  chips.replaceChildren(...extra());
  body.replaceChildren();
  drawn = 0;
  draw();
}

/** What is wanted and has no control of its own: each can be taken back. */
function extra() {
  const made = [];
  const chip = (words, names) => {
    const button = element("button", { type: "button" }, `${words} ✕`);
    button.addEventListener("click", () => ask(Object.fromEntries(names.map((name) => [name, ""]))));
    made.push(button);
  };
  if (wanted.drawn in quantities) chip(`${quantities[wanted.drawn]} ${wanted.least} to ${wanted.most}`, ["drawn", "least", "most"]);
  if (wanted.against) chip(`inserted by ${wanted.against}`, ["against"]);
  return made;
}

function draw() {
  const rows = document.createDocumentFragment();
  for (const n of shown.slice(drawn, drawn + CHUNK)) {
    const row = element("tr");
    for (const { of } of COLUMNS) {
      const { shown: content, kind } = of(n);
      row.append(element("td", kind ? { class: kind } : {}, content));
    }
    rows.append(row);
  }
  drawn = Math.min(drawn + CHUNK, shown.length);
  body.append(rows);
  status.textContent = `${shown.length} of ${count} trials, ${shown.filter((n) => inserted(n) === 1).length} inserted${faulted(shown)}; ${drawn} listed.`;
  more.hidden = drawn >= shown.length;
  more.textContent = `List ${Math.min(CHUNK, shown.length - drawn)} more`;
}

function faulted(numbers) {
  const many = numbers.filter((n) => columns.fault[n]).length;
  return many ? `, ${many} ${many === 1 ? "fault" : "faults"}` : "";
}

/** Follow a link that says which trials are wanted. */
function heed(moved) {
  if (!location.hash.includes("=")) return;
  const asked = new URLSearchParams(location.hash.slice(1));
  wanted = Object.fromEntries(NAMES.filter((name) => asked.get(name)).map((name) => [name, asked.get(name)]));
  sorting = { by: "first", up: true };
  list();
  if (moved) document.getElementById("trials").scrollIntoView();
}

build();
list();
heed(true);
addEventListener("hashchange", () => heed(true));
