// Comparison of two methods: their rows of the leaderboard, and their answers sequence by sequence.

// Returns links to the descriptions of the measure and the search of a method, if the page has them.
function linkPlugins(method) {
  const halves = method.replace(/@(target|frame)$/, "").split("+");
  const described = [...document.querySelectorAll(".plugin")];
  return halves.flatMap((half) => {
    const found = described.find((plugin) => plugin.querySelector("summary").textContent === half);
    if (!found) return [];
    const link = document.createElement("a");
    [link.href, link.textContent] = [`#${found.id}`, `what ${half} computes`];
    return [" ", link];
  });
}

function makeTable(caption, heads, rows) { // like the tables of the page
  const box = document.createElement("div");
  box.className = "wide";
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", caption);
  const table = box.appendChild(document.createElement("table"));
  table.createCaption().textContent = caption;
  const head = table.createTHead().insertRow();
  heads.forEach((text, column) => {
    const cell = head.appendChild(document.createElement("th"));
    [cell.scope, cell.textContent, cell.className] = ["col", text, column ? "" : "left"];
  });
  const body = table.createTBody();
  for (const texts of rows) {
    const row = body.insertRow();
    texts.forEach((content, column) => {
      const cell = row.insertCell();
      if (!column) cell.className = "name";
      cell.append(...[content].flat());
    });
  }
  makeSortable(table);
  return box;
}

function compareMethods(board, data, { methods, sequences: held, total, methodAt }) {
  const section = document.getElementById("compare");
  const status = section.querySelector("[role=status]");
  const place = document.getElementById("compared");
  const [one, two] = methods;
  const sequences = held.filter((sequence) => sequence < data.compared); // the page lacks answers on the others
  place.replaceChildren();
  if (!one || !two || one === two) {
    status.textContent = one && one === two
      ? "Choose two different methods."
      : "Choose two methods. They are compared on the sequences that the leaderboard shows.";
    return;
  }
  const rows = [...board.tBodies].find((body) => !body.hidden).rows;
  const [rowOfOne, rowOfTwo] = methods.map((method) => [...rows].find((row) => row.cells[methodAt].textContent === method));
  const figures = columnNames(board).map((name, column) => [name, rowOfOne, rowOfTwo].map((row, at) =>
    at ? row?.cells[column].textContent ?? DASH : name)).filter((_, column) => column !== methodAt);
  figures.push(["what they compute", ...methods.map((method) => linkPlugins(method))]);

  const ERROR = 5; // index of the error, in depths of focus, in a row of data.answers
  const errorsOf = (method) => new Map(data.answers
    .filter((answer) => data.methods[answer[0]] === method).map((answer) => [answer[1], answer[ERROR]]));
  const errors = methods.map(errorsOf);
  const nearer = { [one]: 0, [two]: 0, alike: 0, [DASH]: 0 };
  const lines = sequences.map((sequence) => {
    const [a, b] = errors.map((found) => found.get(sequence) ?? DASH);
    const [sizeOfA, sizeOfB] = [a, b].map((text) => Math.abs(parseFloat(text)));
    const better = Number.isNaN(sizeOfA - sizeOfB) ? DASH : sizeOfA < sizeOfB ? one : sizeOfB < sizeOfA ? two : "alike";
    nearer[better] += 1;
    return [data.sequences[sequence], a, b, better];
  });
  status.textContent = `${one} is nearer on ${nearer[one]}, ${two} on ${nearer[two]}, both alike on ${nearer.alike} of `
    + `${sequences.length} sequences${nearer[DASH] ? `; on ${nearer[DASH]} at least one has no error` : ""}.`
    + (sequences.length < total ? ` They are spread evenly over ${total}; records.jsonl has all.` : "");
  for (const table of [
    makeTable(`${one} compared with ${two}`, ["figure", one, two], figures),
    makeTable(`Errors of ${one} and ${two} in depths of focus`, ["sequence", one, two, "nearer"], lines),
  ]) {
    place.append(table);
    offerCsv(table);
  }
}
