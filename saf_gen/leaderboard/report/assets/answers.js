// Single answers, the worst first, of the methods and sequences chosen; a line's number opens its record.

const ANSWERS = 100;

/** Every key of the record at place r, in the order of the file: saf_gen.leaderboard.report.compact_records says where it is held. */
function recordOf(r) {
  const own = {
    method: known.methods[known.method[r]],
    sequence: known.sequences[known.sequence[r]],
    status: known.status[r],
    note: known.note[r] ?? "",
  };
  const found = {
    known: (name) => own[name],
    value: (_, { held, flag }) => {
      const value = known.values[held][r];
      return flag && value !== null ? value === 1 : value;
    },
    all: (_, { held }) => held,
    sequence: (_, { held }) => held[known.sequence[r]],
    method: (_, { held }) => held[known.method[r]],
    record: (_, { held }) => held[r],
  };
  return Object.fromEntries(Object.entries(known.facts).map(([name, fact]) => [name, found[fact.by](name, fact)]));
}

function factInWords(name, value) {
  if (name === "trace" && typeof value === "number") return `${value} steps, in the file`;
  if (Array.isArray(value)) return value.length ? value.map((v) => v ?? DASH).join(", ") : DASH;
  return value === null || value === "" ? DASH : String(value);
}

/** A row over all columns with the record at place r. */
function recordRow(r, columns) {
  const row = document.createElement("tr");
  row.className = "record";
  const cell = row.insertCell();
  cell.colSpan = columns;
  const list = document.createElement("dl");
  for (const [name, value] of Object.entries(recordOf(r))) {
    const pair = document.createElement("div");
    const [term, said] = [document.createElement("dt"), document.createElement("dd")];
    term.textContent = name;
    said.textContent = factInWords(name, value);
    pair.append(term, said);
    list.append(pair);
  }
  cell.append(list);
  return row;
}

function toggleRecord(button, r) {
  const row = button.closest("tr");
  const opened = button.getAttribute("aria-expanded") === "true";
  button.setAttribute("aria-expanded", String(!opened));
  if (opened) row.nextElementSibling.remove();
  else row.after(recordRow(r, row.cells.length));
}

function answerRow(r) {
  const row = document.createElement("tr");
  const add = (text, value, kind) => {
    const cell = row.insertCell();
    cell.textContent = text;
    if (value !== null && value !== undefined) cell.dataset.v = String(value);
    if (kind) cell.className = kind;
    return cell;
  };
  const number = (name, digits) => {
    const held = known.values[name][r];
    add(held === null ? DASH : fixed(held, digits), held);
  };
  add(known.methods[known.method[r]], null, "left method");
  add(known.sequences[known.sequence[r]], null, "left method");
  add(known.status[r], null, "left");
  number("position", 4);
  number("truth", 4);
  number("dof", 2);
  number("blur", 1);
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = `line ${r + 1}`;
  button.setAttribute("aria-expanded", "false");
  button.addEventListener("click", () => toggleRecord(button, r));
  add("", r + 1).append(button);
  add(known.note[r] ?? "", null, "left note");
  return row;
}

const answers = document.getElementById("answers");
if (answers !== null && known.method.length > 0) {
  const table = answers.querySelector("table");
  const told = answers.querySelector("[role=status]");
  const size = (r) => (known.values.dof[r] === null ? Infinity : Math.abs(known.values.dof[r]));
  // A record stands under its answer, so it is shut before answers change places.
  table.addEventListener("sorting", () => {
    for (const row of table.querySelectorAll("tr.record")) {
      row.previousElementSibling.querySelector("button").setAttribute("aria-expanded", "false");
      row.remove();
    }
  });
  document.addEventListener("chosen", ({ detail }) => {
    const all = known.method
      .map((_, r) => r)
      .filter((r) => detail.chosen[known.sequence[r]] && detail.methods.has(known.methods[known.method[r]]));
    all.sort((a, b) => (size(a) === size(b) ? a - b : size(b) - size(a)));
    table.tBodies[0].replaceChildren(...all.slice(0, ANSWERS).map(answerRow));
    lastHeads(table).forEach((th) => th.removeAttribute("aria-sort"));
    told.textContent =
      all.length > ANSWERS ? `The ${ANSWERS} worst of ${all.length} answers.` : `${all.length} answers, the worst first.`;
  });
  answers.querySelector(".live").hidden = false;
}
