// The form over the leaderboard chooses among rows that were computed before: a table body for each selection of
// sequences, the methods whose names hold all words, and the worst answers of both.

const board = document.getElementById("board");
if (board !== null) {
  const data = JSON.parse(document.getElementById("data-of-records").textContent);
  const form = document.getElementById("filters");
  const shown = document.getElementById("shown");
  const answers = document.getElementById("answers");
  const answerTable = answers.querySelector("table");
  const answerRow = answerTable.tBodies[0].rows[0];
  const maxAnswers = answerTable.tBodies[0].rows.length;
  const everySequence = { body: 0, sequences: data.sequences.map((_, number) => number) };
  const methodAt = columnHeads(board).findIndex((head) => head.textContent === "method");
  const methodOf = (row) => row.cells[methodAt].textContent;

  const showAnswers = (hasMethod, sequences, whose) => {
    const chosen = new Set(sequences);
    const found = data.answers.filter(([method, sequence]) => hasMethod(data.methods[method]) && chosen.has(sequence));
    const rows = found.slice(0, maxAnswers).map(([method, sequence, ...texts]) => {
      const row = answerRow.cloneNode(true);
      [data.methods[method], data.sequences[sequence], ...texts].forEach((text, column) => {
        (row.cells[column].firstElementChild ?? row.cells[column]).textContent = text;
      });
      return row;
    });
    answerTable.tBodies[0].replaceChildren(...rows);
    columnHeads(answerTable).forEach((head) => head.removeAttribute("aria-sort"));
    answers.querySelector("[role=status]").textContent =
      found.length > maxAnswers
        ? `The ${maxAnswers} worst of ${found.length} answers${whose}.`
        : `${found.length} answers${whose}, the worst first.`;
  };

  const selected = () => data.selections[Number(form.elements.selection.value) - 1] ?? everySequence;

  const update = () => {
    const { body: number, sequences } = selected();
    const words = form.elements.text.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
    const hasWords = (method) => words.every((word) => method.toLowerCase().includes(word));
    [...board.tBodies].forEach((body, at) => {
      body.hidden = at !== number;
      for (const row of body.rows) row.hidden = !hasWords(methodOf(row));
    });
    const methods = data.methods.filter(hasWords).length;
    shown.textContent =
      `${methods} of ${data.methods.length} methods, ${sequences.length} of ${data.sequences.length} sequences.`;
    showAnswers(hasWords, sequences, "");
  };

  board.addEventListener("click", (event) => {
    const row = event.target.closest("a")?.closest("tr");
    if (!row) return;
    showAnswers((method) => method === methodOf(row), selected().sequences, ` of ${methodOf(row)}`);
    answers.querySelector("details").open = true;
  });
  form.addEventListener("input", update);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(update));
  for (const control of [form, shown, answers.querySelector(".live")]) control.hidden = false;
  update();
}
