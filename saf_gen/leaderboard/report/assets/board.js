// The form above the leaderboard chooses among rows that are already computed: one table body for each selection of
// sequences, the methods whose names contain all words, and their worst answers. The choice is stored in the address,
// after the #, so that a link leads to the same view.

const board = document.getElementById("board");
if (board !== null) {
  const data = JSON.parse(document.getElementById("data-of-records").textContent);
  const form = document.getElementById("filters");
  const { text, selection, whole, first, second } = form.elements;
  const shown = document.getElementById("shown");
  const permalink = document.getElementById("permalink");
  const answers = document.getElementById("answers");
  const answerTable = answers.querySelector("table");
  const answerRow = answerTable.tBodies[0].rows[0];
  const maxAnswers = answerTable.tBodies[0].rows.length;
  const everySequence = { body: 0, sequences: data.sequences.map((_, number) => number), total: data.total };
  const methodAt = columnHeads(board).findIndex((head) => head.textContent === "method");
  const methodOf = (row) => row.cells[methodAt].textContent;
  let answersOf = ""; // the only method whose answers are listed

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
  const nameOf = (option) => (option.value === "0" ? "" : `${option.parentElement.label}: ${option.text}`);

  const readView = () => {
    const sorted = columnHeads(board).findIndex((head) => head.hasAttribute("aria-sort"));
    const order = sorted < 0 ? "" : columnHeads(board)[sorted].getAttribute("aria-sort");
    const view = {
      find: text.value.trim(),
      sequences: nameOf(selection.selectedOptions[0]),
      sort: sorted < 0 ? "" : columnNames(board)[sorted],
      order: order === "descending" ? order : "",
      columns: whole.checked ? "all" : "",
      method: first.value,
      beside: second.value,
      answers: answersOf,
    };
    return new URLSearchParams(Object.entries(view).filter(([, value]) => value !== "")).toString();
  };

  const setView = (hash) => {
    const view = new URLSearchParams(hash);
    const choose = (select, wanted, name) => {
      select.value = ([...select.options].find((option) => name(option) === wanted) ?? select.options[0]).value;
    };
    text.value = view.get("find") ?? "";
    whole.checked = view.get("columns") === "all";
    choose(selection, view.get("sequences") ?? "", nameOf);
    choose(first, view.get("method") ?? "", (option) => option.value);
    choose(second, view.get("beside") ?? "", (option) => option.value);
    const column = columnNames(board).indexOf(view.get("sort"));
    if (column < 0) unsortTable(board);
    else sortTable(board, column, view.get("order") === "descending");
    update();
    if (data.methods.includes(view.get("answers"))) showAnswersOf(view.get("answers"));
  };

  const writeAddress = () => {
    const view = readView();
    permalink.href = view ? `#${view}` : "#leaderboard";
    if (view || location.hash.includes("=")) history.replaceState(null, "", view ? `#${view}` : "#leaderboard");
  };

  const update = () => {
    const { body: number, sequences, total } = selected();
    const words = text.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
    const hasWords = (method) => words.every((word) => method.toLowerCase().includes(word));
    [...board.tBodies].forEach((body, at) => {
      body.hidden = at !== number;
      for (const row of body.rows) row.hidden = !hasWords(methodOf(row));
    });
    const methods = data.methods.filter(hasWords).length;
    shown.textContent =
      `${methods} of ${data.methods.length} methods, ${total} of ${data.total} sequences.`;
    answersOf = "";
    showAnswers(hasWords, selected(), "");
    compareMethods(board, data, { methods: [first.value, second.value], sequences, total, methodAt });
    fold();
    writeAddress();
  };

  const showAnswersOf = (method) => {
    answersOf = method;
    showAnswers((other) => other === method, selected(), ` of ${method}`);
    answers.querySelector("[role=status]").append(...linkPlugins(method));
    answers.querySelector("details").open = true;
    writeAddress();
  };

  for (const link of board.querySelectorAll("td.name a")) { // on a narrow screen a name breaks after these signs
    const parts = link.textContent.split(/(?<=[+:,=])/);
    link.replaceChildren(...parts.flatMap((part) => [part, document.createElement("wbr")]).slice(0, -1));
  }
  board.addEventListener("click", (event) => {
    const row = event.target.closest("a")?.closest("tr");
    if (!row) return;
    event.preventDefault(); // the link would replace the view in the address
    showAnswersOf(methodOf(row));
    answers.scrollIntoView();
    answers.querySelector("summary").focus({ preventScroll: true });
  });
  board.addEventListener("sorted", writeAddress);
  form.addEventListener("input", update);
  for (const select of [first, second]) select.addEventListener("input", update); // they are outside the form
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(() => setView("")));
  window.addEventListener("hashchange", () => { if (location.hash.includes("=")) setView(location.hash.slice(1)); });
  window.matchMedia("(max-width: 40rem)").addEventListener("change", fold);
  for (const control of [form, shown, ...document.querySelectorAll(".live")]) control.hidden = false;
  setView(location.hash.includes("=") ? location.hash.slice(1) : "");
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
