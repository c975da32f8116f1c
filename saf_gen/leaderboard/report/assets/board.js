// The leaderboard of some of the sequences: the rule is that of saf_gen.leaderboard.report.page_data.

const known = JSON.parse(document.getElementById("data-of-records").textContent);
const DASH = "–";
const TIE = 1e-9;

/** Digits as Python prints them: a tie goes to the even digit, judged on the exact binary value. */
function fixed(number, digits) {
  const exact = Math.abs(number).toFixed(60);
  const dot = exact.indexOf(".");
  const rest = exact.slice(dot + 1 + digits);
  if (!/^50*$/.test(rest)) return number.toFixed(digits);
  const kept = exact.slice(0, dot + 1 + digits).replace(/\.$/, "");
  if (Number(kept.at(-1)) % 2 === 0) return (number < 0 ? "-" : "") + kept;
  return number.toFixed(digits);
}

const mean = (numbers) => numbers.reduce((sum, n) => sum + n, 0) / numbers.length;

/** Means over a scene's lights, then over scenes; null where nothing is known. */
function overScenes(records, values) {
  const scenes = new Map();
  for (const r of records) {
    if (values[r] === null) continue;
    const scene = known.scene[known.sequence[r]];
    const light = known.light[known.sequence[r]];
    if (!scenes.has(scene)) scenes.set(scene, new Map());
    if (!scenes.get(scene).has(light)) scenes.get(scene).set(light, []);
    scenes.get(scene).get(light).push(values[r]);
  }
  if (scenes.size === 0) return null;
  return mean([...scenes.values()].map((lights) => mean([...lights.values()].map(mean))));
}

function medianSize(records, values) {
  const sizes = records.map((r) => values[r]).filter((v) => v !== null).map(Math.abs).sort((a, b) => a - b);
  if (sizes.length === 0) return null;
  const half = Math.floor(sizes.length / 2);
  return sizes.length % 2 ? sizes[half] : (sizes[half - 1] + sizes[half]) / 2;
}

/** What a column says of these records of one method. */
function counted(column, records) {
  const values = known.values[column.value];
  if ("light" in column) records = records.filter((r) => known.light[known.sequence[r]] === column.light);
  if (column.rule === "mean") return overScenes(records, values);
  if (column.rule === "median") return medianSize(records, values);
  return records.reduce((sum, r) => sum + values[r], 0);
}

function inWords(column, value) {
  if (value === null || (column.rule === "count" && value === 0)) return DASH;
  // A share that ends in a half goes up, whatever its last bit: saf_gen.leaderboard.columns.percent.
  return column.digits < 0 ? `${fixed((value + TIE) * 100, 0)}%` : fixed(value, column.digits);
}

/** Ranks of the methods by success within 1 DoF, null for those without any to judge. */
function ranks(success) {
  const others = success.filter((s) => s !== null);
  return success.map((own) => {
    if (own === null) return null;
    const rank = 1 + others.filter((s) => s > own + TIE).length;
    return { rank, tied: others.filter((s) => Math.abs(s - own) <= TIE).length > 1 };
  });
}

const board = document.getElementById("board");
if (board !== null) {
  const names = lastHeads(board).map((th) => th.dataset.name);
  const methodAt = names.indexOf("method");
  const rankAt = names.indexOf("rank");
  const byMethod = new Map([...board.tBodies[0].rows].map((row) => [row.cells[methodAt].textContent, row]));
  const asWritten = new Map(
    [...byMethod].map(([method, row]) => [
      method,
      { kind: row.className, cells: [...row.cells].map((c) => [c.textContent, c.dataset.v, c.getAttribute("style"), c.className]) },
    ]),
  );
  const form = document.getElementById("filters");
  const status = document.getElementById("shown");
  const selects = [];

  const addSelect = (label, choices, name) => {
    const wrap = document.createElement("label");
    const select = document.createElement("select");
    wrap.append(label, select);
    select.name = name;
    select.add(new Option("all", ""));
    choices.forEach((choice, number) => select.add(new Option(choice, String(number))));
    form.insertBefore(wrap, form.querySelector("button"));
    return select;
  };
  const measures = [...new Set(known.methods.map((m) => m.split("+")[0]))].sort();
  const searches = [...new Set(known.methods.map((m) => m.split("+").slice(1).join("+")))].sort();
  const measure = addSelect("Measure", measures, "measure");
  const search = addSelect("Search", searches, "search");
  for (const axis of known.axes) selects.push([axis, addSelect(axis.title, axis.bins, axis.name)]);

  const setCell = (cell, text, value, share) => {
    cell.firstChild ? (cell.firstChild.textContent = text) : (cell.textContent = text);
    if (value === null) delete cell.dataset.v;
    else cell.dataset.v = String(value);
    if (share) {
      cell.classList.remove("ends");
      cell.classList.toggle("bar", value !== null);
      cell.setAttribute("style", value === null ? "" : `--v:${value}`);
    }
  };

  const writeBack = () => {
    for (const [method, row] of byMethod) {
      const held = asWritten.get(method);
      row.className = held.kind;
      [...row.cells].forEach((cell, column) => {
        const [text, value, style, kind] = held.cells[column];
        setCell(cell, text, value === undefined ? null : value, false);
        cell.className = kind;
        if (style === null) cell.removeAttribute("style");
        else cell.setAttribute("style", style);
      });
    }
  };

  const recount = (chosen) => {
    const records = new Map(known.methods.map((m) => [m, []]));
    known.sequence.forEach((s, r) => {
      if (chosen[s]) records.get(known.methods[known.method[r]]).push(r);
    });
    const success = known.methods.map((m) => overScenes(records.get(m), known.values.one));
    const standing = ranks(success);
    known.methods.forEach((method, number) => {
      const row = byMethod.get(method);
      row.className = standing[number] !== null && standing[number].rank === 1 ? "first" : "";
      known.columns.forEach((column, at) => {
        if (at === methodAt) return;
        const cell = row.cells[at];
        if (at === rankAt) {
          const own = standing[number];
          setCell(cell, own === null ? DASH : `${own.rank}${own.tied ? "=" : ""}`, own && own.rank, false);
        } else if (column === null) {
          setCell(cell, DASH, null, false);
        } else {
          const value = counted(column, records.get(method));
          setCell(cell, inWords(column, value), value, column.digits < 0 && cell.matches(".bar, [style]"));
        }
      });
    });
    const last = Infinity;
    const error = new Map(known.methods.map((m) => [m, medianSize(records.get(m), known.values.dof)]));
    const order = known.methods.map((m, i) => [standing[i] ? standing[i].rank : last, error.get(m) ?? last, m]);
    order.sort((a, b) => a[0] - b[0] || (a[1] < b[1] ? -1 : a[1] > b[1] ? 1 : a[2] < b[2] ? -1 : 1));
    board.tBodies[0].append(...order.map(([, , m]) => byMethod.get(m)));
  };

  const update = () => {
    const chosen = known.sequences.map((_, s) =>
      selects.every(([axis, select]) => select.value === "" || axis.of[s] === Number(select.value)),
    );
    const some = chosen.some((c) => !c);
    const sorted = lastHeads(board).findIndex((th) => th.hasAttribute("aria-sort"));
    const way = sorted < 0 ? null : lastHeads(board)[sorted].getAttribute("aria-sort");
    if (some) recount(chosen);
    else {
      writeBack();
      board.tBodies[0].append(...known.methods.map((m) => byMethod.get(m)));
    }
    if (sorted >= 0) sortBy(board, sorted, way === "descending");
    const words = form.elements.text.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
    const shown = known.methods.filter((method) => {
      const [own, ...rest] = method.split("+");
      const fits =
        (measure.value === "" || own === measures[Number(measure.value)]) &&
        (search.value === "" || rest.join("+") === searches[Number(search.value)]) &&
        words.every((word) => method.toLowerCase().includes(word));
      byMethod.get(method).hidden = !fits;
      return fits;
    });
    const sequences = chosen.filter(Boolean).length;
    status.textContent =
      `${shown.length} of ${known.methods.length} methods, ${sequences} of ${known.sequences.length} sequences.` +
      (some ? " Intervals are of all sequences only, so they are left out." : "");
    document.dispatchEvent(new CustomEvent("chosen", { detail: { chosen, methods: new Set(shown) } }));
  };

  form.addEventListener("input", update);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(update));
  form.hidden = false;
  status.hidden = false;
  document.addEventListener("DOMContentLoaded", update);
}
