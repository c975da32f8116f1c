"use strict";
// Every table sorts by any of its columns: numbers by data-v, else text; what is unknown stays last.

function sortKey(row, column) {
  const cell = row.cells[column];
  if (cell.dataset.v !== undefined) return Number(cell.dataset.v);
  const text = cell.textContent;
  return text === "–" ? null : text;
}

function sortBy(table, column, descending) {
  table.dispatchEvent(new Event("sorting"));
  const body = table.tBodies[0];
  const sign = descending ? -1 : 1;
  const keyed = [...body.rows].map((row, place) => ({ row, place, key: sortKey(row, column) }));
  keyed.sort((a, b) => {
    if (a.key === null || b.key === null) return (a.key === null) - (b.key === null) || a.place - b.place;
    return sign * (a.key > b.key ? 1 : a.key < b.key ? -1 : 0) || a.place - b.place;
  });
  body.append(...keyed.map((k) => k.row));
  lastHeads(table).forEach((th, number) => {
    if (number === column) th.setAttribute("aria-sort", descending ? "descending" : "ascending");
    else th.removeAttribute("aria-sort");
  });
}

function lastHeads(table) {
  return [...table.tHead.rows[table.tHead.rows.length - 1].cells];
}

function makeSortable(table) {
  lastHeads(table).forEach((th, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...th.childNodes);
    if (th.title) button.title = th.title;
    th.append(button);
    button.addEventListener("click", () => {
      const first = table.tBodies[0].rows[0];
      const share = first !== undefined && first.cells[column].classList.contains("bar");
      const now = th.getAttribute("aria-sort");
      sortBy(table, column, now === null ? share : now === "ascending");
    });
  });
}

document.querySelectorAll("table.sortable").forEach(makeSortable);
