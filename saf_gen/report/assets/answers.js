// Single answers, the worst first, each with its line in records.jsonl: of the methods and sequences chosen.

const ANSWERS = 100;

function answerRow(r) {
  const row = document.createElement("tr");
  const add = (text, value, kind) => {
    const cell = row.insertCell();
    cell.textContent = text;
    if (value !== null && value !== undefined) cell.dataset.v = String(value);
    if (kind) cell.className = kind;
    return cell;
  };
  const value = (name) => known.values[name][r];
  const number = (name, digits) => {
    const held = value(name);
    add(held === null ? DASH : fixed(held, digits), held);
  };
  add(known.methods[known.method[r]], null, "left method");
  add(known.sequences[known.sequence[r]], null, "left method");
  add(known.status[r], null, "left");
  number("position", 4);
  number("truth", 4);
  number("dof", 2);
  number("blur", 1);
  const link = document.createElement("a");
  link.href = `records.jsonl#L${r + 1}`;
  link.textContent = `line ${r + 1}`;
  add("", r + 1).append(link);
  add(known.note[r] ?? "", null, "left note");
  return row;
}

const answers = document.getElementById("answers");
if (answers !== null && known.method.length > 0) {
  const body = answers.querySelector("tbody");
  const told = answers.querySelector("[role=status]");
  const size = (r) => (known.values.dof[r] === null ? Infinity : Math.abs(known.values.dof[r]));
  document.addEventListener("chosen", ({ detail }) => {
    const all = known.method
      .map((_, r) => r)
      .filter((r) => detail.chosen[known.sequence[r]] && detail.methods.has(known.methods[known.method[r]]));
    all.sort((a, b) => size(b) - size(a) || a - b);
    body.replaceChildren(...all.slice(0, ANSWERS).map(answerRow));
    lastHeads(answers.querySelector("table")).forEach((th) => th.removeAttribute("aria-sort"));
    told.textContent =
      all.length > ANSWERS ? `The ${ANSWERS} worst of ${all.length} answers.` : `${all.length} answers, the worst first.`;
  });
  answers.querySelector(".live").hidden = false;
}
