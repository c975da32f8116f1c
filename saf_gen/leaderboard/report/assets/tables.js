"use strict";
// Every table sorts by any of its columns: text columns by text, others by the number that a cell begins with.
// Cells without a number come last; equal cells keep their order. The visible cells of a table can be saved as CSV.

const DASH = "–";
const columnHeads = (table) => [...table.tHead.rows[table.tHead.rows.length - 1].cells];
const writtenOrder = new WeakMap(); // position of each row, to restore the original order

function unsortTable(table) {
  for (const body of table.tBodies) {
    body.append(...[...body.rows].sort((a, b) => (writtenOrder.get(a) ?? 0) - (writtenOrder.get(b) ?? 0)));
  }
  columnHeads(table).forEach((head) => head.removeAttribute("aria-sort"));
}

function sortTable(table, column, descending) {
  const isText = columnHeads(table)[column].classList.contains("left");
  const sign = descending ? -1 : 1;
  const keyOf = (row) => {
    const text = row.cells[column].textContent;
    return isText ? text : parseFloat(text);
  };
  const isMissing = (key) => Number.isNaN(key) || key === DASH;
  for (const body of table.tBodies) {
    const keyed = [...body.rows].map((row) => ({ row, key: keyOf(row) }));
    keyed.sort((a, b) => {
      if (isMissing(a.key) || isMissing(b.key)) return isMissing(a.key) - isMissing(b.key);
      return sign * (a.key > b.key ? 1 : a.key < b.key ? -1 : 0);
    });
    body.append(...keyed.map((item) => item.row));
  }
  columnHeads(table).forEach((head, number) => {
    if (number === column) head.setAttribute("aria-sort", descending ? "descending" : "ascending");
    else head.removeAttribute("aria-sort");
  });
}

// Returns the headings, each after the heading of its group, which makes it unique.
function columnNames(table) {
  const groups = [...(table.tHead.rows.length > 1 ? table.tHead.rows[0].cells : [])]
    .flatMap((cell) => Array(Number(cell.dataset.span)).fill(cell.textContent));
  return columnHeads(table).map((head, at) => [groups[at], head.textContent.trim()].filter(Boolean).join(": "));
}

// Returns the visible columns and rows as CSV (RFC 4180). A text that a spreadsheet would run as a formula gets an apostrophe.
function tableToCsv(table) {
  const heads = columnHeads(table);
  const shown = heads.map((head, column) => column).filter((column) => getComputedStyle(heads[column]).display !== "none");
  const lines = [...table.tBodies].filter((body) => !body.hidden).flatMap((body) => [...body.rows])
    .filter((row) => !row.hidden).map((row) => [...row.cells].map((cell) => cell.textContent.trim()));
  const quote = (text) => {
    const safe = /^[=+@\t]|^-(?![\d.])/.test(text) ? `'${text}` : text;
    return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
  };
  return [columnNames(table), ...lines].map((cells) => `${shown.map((column) => quote(cells[column])).join(",")}\r\n`).join("");
}

function offerCsv(box) {
  const table = box.querySelector("table");
  const button = document.createElement("button");
  [button.type, button.className, button.textContent] = ["button", "csv", "CSV"];
  button.setAttribute("aria-label", `CSV of the table: ${table.caption.textContent}`);
  button.addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([tableToCsv(table)], { type: "text/csv" }));
    link.download = `${table.caption.textContent.replace(/[^\w.-]+/g, "_")}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
  box.after(button);
}

function makeSortable(table) {
  for (const body of table.tBodies) [...body.rows].forEach((row, at) => writtenOrder.set(row, at));
  columnHeads(table).forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    if (head.title) button.title = head.title;
    head.append(button);
    button.addEventListener("click", () => {
      // The first click sorts a column of fractions, whose cells have bars, from the largest.
      const hasBars = table.tBodies[0].querySelector(`td:nth-child(${column + 1})[style]`) !== null;
      const order = head.getAttribute("aria-sort");
      sortTable(table, column, order === null ? hasBars : order === "ascending");
    });
  });
}

document.querySelectorAll("table.sortable").forEach(makeSortable);
document.querySelectorAll(".wide").forEach(offerCsv);
