// The form above the leaderboard chooses among rows that are already computed: one table body for each selection of
// sequences, the methods whose names contain all words, and their worst answers.

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

const board = document.getElementById("board");
if (board !== null) {
  const data = JSON.parse(document.getElementById("data-of-records").textContent);
  const form = document.getElementById("filters");
  const { text, selection, whole } = form.elements;
  const shown = document.getElementById("shown");
  const answers = document.getElementById("answers");
  const answerTable = answers.querySelector("table");
  const answerRow = answerTable.tBodies[0].rows[0];
  const maxAnswers = answerTable.tBodies[0].rows.length;
  const everySequence = { body: 0, sequences: data.sequences.map((_, number) => number), total: data.total };
  const methodAt = columnHeads(board).findIndex((head) => head.textContent === "method");
  const methodOf = (row) => row.cells[methodAt].textContent;

  const showAnswers = (hasMethod, { sequences, total }, whose) => {
    const chosen = new Set(sequences);
    const all = total * data.methods.filter(hasMethod).length; // the page of a large evaluation holds only some of them
    const found = data.answers.filter(([method, sequence]) => hasMethod(data.methods[method]) && chosen.has(sequence));
    const rows = found.slice(0, maxAnswers).map(([method, sequence, ...texts]) => {
      const row = answerRow.cloneNode(true);
      [data.methods[method], data.sequences[sequence], ...texts].forEach((cell, column) => {
        (row.cells[column].firstElementChild ?? row.cells[column]).textContent = cell;
      });
      return row;
    });
    answerTable.tBodies[0].replaceChildren(...rows);
    rows.forEach((row, at) => writtenOrder.set(row, at));
    columnHeads(answerTable).forEach((head) => head.removeAttribute("aria-sort"));
    answers.querySelector("[role=status]").textContent =
      found.length < all && all < data.total * data.methods.length
        ? `The ${rows.length} worst of the ${found.length} answers${whose} in this page; records.jsonl has ${all}.`
        : all > maxAnswers
          ? `The ${maxAnswers} worst of ${all} answers${whose}.`
          : `${all} answers${whose}, the worst first.`;
  };

  // Style rules hide columns for which there is no space; a group heading spans the columns that remain.
  const fold = () => {
    board.classList.toggle("folded", !whole.checked);
    const isShown = columnHeads(board).map((head) => getComputedStyle(head).display !== "none");
    let at = 0;
    for (const cell of board.tHead.rows.length > 1 ? board.tHead.rows[0].cells : []) {
      const span = isShown.slice(at, (at += Number(cell.dataset.span))).filter(Boolean).length;
      cell.hidden = span === 0;
      cell.colSpan = Math.max(span, 1);
    }
  };

  const selected = () => data.selections[Number(selection.value) - 1] ?? everySequence;

  const update = () => {
    const { body: number, total } = selected();
    const words = text.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
    const hasWords = (method) => words.every((word) => method.toLowerCase().includes(word));
    [...board.tBodies].forEach((body, at) => {
      body.hidden = at !== number;
      for (const row of body.rows) row.hidden = !hasWords(methodOf(row));
    });
    const methods = data.methods.filter(hasWords).length;
    shown.textContent =
      `${methods} of ${data.methods.length} methods, ${total} of ${data.total} sequences.`;
    showAnswers(hasWords, selected(), "");
    fold();
  };

  const showAnswersOf = (method) => {
    showAnswers((other) => other === method, selected(), ` of ${method}`);
    answers.querySelector("[role=status]").append(...linkPlugins(method));
    answers.querySelector("details").open = true;
  };

  for (const link of board.querySelectorAll("td.name a")) { // on a narrow screen a name breaks after these signs
    const parts = link.textContent.split(/(?<=[+:,=])/);
    link.replaceChildren(...parts.flatMap((part) => [part, document.createElement("wbr")]).slice(0, -1));
  }
  board.addEventListener("click", (event) => {
    const row = event.target.closest("a")?.closest("tr");
    if (!row) return;
    event.preventDefault(); // the list is opened and scrolled into view here
    showAnswersOf(methodOf(row));
    answers.scrollIntoView();
    answers.querySelector("summary").focus({ preventScroll: true });
  });
  form.addEventListener("input", update);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => { unsortTable(board); update(); }));
  window.matchMedia("(max-width: 40rem)").addEventListener("change", fold);
  for (const control of [form, shown, ...document.querySelectorAll(".live")]) control.hidden = false;
  update();
}

// A link to something in closed details elements, or to a folded section, opens them.
const openTarget = () => {
  const target = location.hash.length > 1 ? document.getElementById(location.hash.slice(1)) : null;
  for (let around = target; around; around = around.parentElement) if (around.tagName === "DETAILS") around.open = true;
  const fold = target?.querySelector(":scope > details.fold");
  if (fold) fold.open = true;
};
window.addEventListener("hashchange", openTarget);
openTarget();
