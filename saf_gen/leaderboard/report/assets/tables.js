"use strict";
// Every table sorts by any of its columns: text columns by text, others by the number that a cell begins with.
// Cells without a number come last; equal cells keep their order.

const DASH = "–";
const columnHeads = (table) => [...table.tHead.rows[table.tHead.rows.length - 1].cells];

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

document.querySelectorAll("table.sortable").forEach((table) => {
  columnHeads(table).forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    if (head.title) button.title = head.title;
    head.append(button);
    button.addEventListener("click", () => {
      // A column of fractions, which have bars, begins with the largest.
      const hasBars = table.tBodies[0].querySelector(`td:nth-child(${column + 1})[style]`) !== null;
      const order = head.getAttribute("aria-sort");
      sortTable(table, column, order === null ? hasBars : order === "ascending");
    });
  });
});
