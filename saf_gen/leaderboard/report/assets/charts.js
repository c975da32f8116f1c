// The charts, drawn by uPlot from their data: curves with the answers above them, paths of the lens, profiles. A drag
// zooms, a double click shows all again, and the legend has the values under the pointer. A chart is drawn when it
// comes into view, because most are in folded sections.

const DASHES = [[], [7, 2], [2, 2], [8, 2, 2, 2], [4, 2], [11, 3], [6, 2, 2, 2, 2, 2], [2, 3]];
const [INK, SOFT] = [-1, -2]; // styles of lines that belong to no method
const ROW = 0.11; // height of a row of answers, as a part of that of the curves
const HEIGHT = 250, ROW_PX = 24;
const named = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const styleOf = (number) => ({
  stroke: () => (number === INK ? named("--ink") : number === SOFT ? named("--soft") : named(`--c${(number % 8) + 1}`)),
  dash: number === SOFT ? [9, 3] : DASHES[number < 0 ? 0 : (number + Math.floor(number / 8)) % 8],
});

function drawMark(ctx, number, x, y) { // as many shapes as colours, which not everybody can tell apart
  const r = 4 * devicePixelRatio;
  ctx.fillStyle = styleOf(number).stroke();
  ctx.strokeStyle = named("--paper");
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash([]);
  ctx.beginPath();
  const corners = [0, 4, 4, 3, 3, 5, 6, 8][number % 8];
  if (corners === 0) ctx.arc(x, y, r, 0, 2 * Math.PI);
  for (let corner = 0; corner < corners; corner += 1) {
    const angle = 2 * Math.PI * (corner / corners + [0, 1 / 8, 0, -1 / 4, 1 / 4, -1 / 4, 0, 0][number % 8]);
    ctx.lineTo(x + 1.15 * r * Math.cos(angle), y + 1.15 * r * Math.sin(angle));
  }
  ctx.closePath();
  ctx.fill();
  ctx.stroke();
}

function drawChart(box) {
  const given = JSON.parse(box.dataset.chart);
  const { rows = [], marks = [], bands = [], levels = [], at = [], area, lines } = given;
  const all = area ? [area, ...lines] : lines;
  const top = 1.03 + ROW * rows.length;
  const heightOf = ([row, place]) => 1.03 + ROW * (rows.length - 1 - row + 0.15 + 0.7 * (1 - place));
  const number = (value) => (value == null ? "–" : given.percent ? `${(100 * value).toFixed(0)} %` : Number(value.toPrecision(4)).toString());
  const axis = { stroke: () => named("--soft"), grid: { stroke: () => named("--line"), width: 1 }, ticks: { show: false } };
  const sideways = { font: "11px system-ui", labelFont: "12px system-ui", labelSize: 18 };
  const within = (u, draw) => { // draws inside the plot, below or above the lines
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    u.ctx.clip();
    draw(u.ctx);
    u.ctx.restore();
  };
  const drawBelow = (u) => within(u, (ctx) => {
    ctx.fillStyle = named("--band");
    ctx.globalAlpha = 0.45;
    for (const [from, to] of bands) {
      const [left, right] = [from, to].map((x) => u.valToPos(x, "x", true));
      ctx.fillRect(Math.min(left, right), u.bbox.top, Math.max(Math.abs(right - left), 1), u.bbox.height);
    }
    for (const [from, to] of levels) {
      const [low, high] = [from, to].map((y) => u.valToPos(y, "y", true));
      ctx.fillRect(u.bbox.left, high, u.bbox.width, Math.max(low - high, 1));
    }
  });
  const drawAbove = (u) => within(u, (ctx) => {
    ctx.strokeStyle = named("--ink");
    ctx.lineWidth = 1.2 * devicePixelRatio;
    ctx.setLineDash([]);
    for (const x of at) {
      ctx.beginPath();
      ctx.moveTo(u.valToPos(x, "x", true), u.bbox.top);
      ctx.lineTo(u.valToPos(x, "x", true), u.bbox.top + u.bbox.height);
      ctx.stroke();
    }
    for (const mark of marks) drawMark(ctx, mark[3], u.valToPos(mark[2], "x", true), u.valToPos(heightOf(mark), "y", true));
  });
  const splits = [0, 0.25, 0.5, 0.75, 1, ...rows.map((_, row) => 1.03 + ROW * (rows.length - 0.5 - row))];
  const spread = all.flatMap((line) => line.x).filter((x) => x !== null && (!given.log || x > 0));
  const ends = [Math.min(...spread), Math.max(...spread)];
  const widest = Math.max(3, ...rows.map((name) => name.length));
  const chart = new uPlot(
    {
      width: box.clientWidth,
      height: HEIGHT + ROW_PX * rows.length,
      scales: { x: { time: false, distr: given.log ? 3 : 1, range: (u, low, high) => (low === null ? ends : [low, high]) },
        y: { range: [0, top] } },
      series: [{ label: given.x, value: (u, x) => number(given.percent ? null : x) },
        ...all.map((line) => ({ label: line.label, ...styleOf(line.style), width: 1.5, spanGaps: true, points: { show: false },
          value: (u, y) => number(y),
          ...(line === area ? { stroke: "transparent", fill: () => named("--area"), dash: [] } : {}) }))],
      axes: [
        { ...axis, ...sideways, label: given.x, size: 24, values: (u, ticks) => ticks.map((x) => (x === null ? "" : Number(x.toPrecision(6)).toString())) },
        { ...axis, ...sideways, label: given.y, splits: () => splits, size: Math.min(Math.max(40, 6.2 * widest + 8), box.clientWidth / 3),
          values: () => splits.map((y, place) => (place < 5 ? (given.percent ? `${100 * y} %` : String(y)) : rows[place - 5])) },
      ],
      cursor: { y: false, drag: { x: true, y: false } },
      hooks: { drawClear: [drawBelow], draw: [drawAbove],
        ready: [(u) => box.dispatchEvent(new CustomEvent("drawn", { detail: u }))] },
    },
    uPlot.join(all.map((line) => [line.x, line.y])),
    box,
  );
  new ResizeObserver(() => {
    if (box.clientWidth && box.clientWidth !== chart.width) chart.setSize({ width: box.clientWidth, height: chart.height });
  }).observe(box);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => chart.redraw());
}

const arriving = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting) continue;
    arriving.unobserve(target);
    drawChart(target);
  }
}, { rootMargin: "200px" });
document.querySelectorAll(".chart").forEach((box) => arriving.observe(box));
