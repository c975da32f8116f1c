"use strict";
// The page asks for one picture after the other; what was turned since the last one goes with the request.
(() => {
  const get = (id) => document.getElementById(id);
  const setup = JSON.parse(get("setup").textContent);
  const KEPT = 600; // points of the chart
  const turned = { focus: setup.focus };
  const decoder = new TextDecoder();
  const drawn = [...setup.drawn];
  const points = [[], [], [], [], []]; // seconds, three scores, lens
  const ranges = drawn.map(() => [0, 0]); // of all scores since the page was opened, and 0: noise at rest stays small
  let plot = null;

  const fill = (select, values, chosen, write = String) => {
    for (const value of values) select.add(new Option(write(value), value, false, value === chosen));
  };
  fill(get("light"), setup.lights, "constant");
  fill(get("region"), setup.regions, setup.region);
  fill(get("window"), [50, 100, 200, 400, 1000], 200,
    (frames) => `${frames} readouts (${(frames / setup.readout_hz * 1e3).toPrecision(3)} ms)`);
  fill(get("method"), Object.keys(setup.methods), "sd+golden_section");
  const spell = () => { get("spelled").textContent = setup.methods[get("method").value]; };
  get("method").addEventListener("input", spell);
  spell();

  // --- what turns ---
  const focus = get("focus");
  focus.value = setup.focus;
  const turn = (to) => {
    focus.value = Math.min(Math.max(to, 0), 1);
    turned.focus = Number(focus.value);
  };
  focus.addEventListener("input", () => turn(Number(focus.value)));
  const wheel = (event) => {
    event.preventDefault();
    turn(Number(focus.value) - Math.sign(event.deltaY) * (event.shiftKey ? 0.001 : 0.005));
  };
  for (const place of [get("picture"), get("knob")]) place.addEventListener("wheel", wheel, { passive: false });

  for (const [name, gain] of Object.entries(setup.lamps)) {
    const label = document.createElement("label"), text = document.createElement("span");
    const slider = document.createElement("input"), shown = document.createElement("output");
    label.className = "lamp";
    text.textContent = name;
    // Doublings of the light; the left end is off.
    Object.assign(slider, { type: "range", min: -6, max: 4, step: 0.1, value: Math.log2(gain) });
    const set = () => {
      const value = Number(slider.value) <= -6 ? 0 : 2 ** Number(slider.value);
      shown.textContent = value === 0 ? "off" : `${value.toPrecision(2)} ×`;
      return value;
    };
    slider.addEventListener("input", () => { turned.lamps = { ...turned.lamps, [name]: set() }; });
    set();
    label.append(text, slider, shown);
    get("lamps").append(label);
  }

  const post = (path, body) => fetch(path, { method: "POST", body: JSON.stringify(body) });
  const tell = (text) => { get("problem").textContent = text; get("problem").hidden = !text; };
  get("run").addEventListener("click", async () => {
    const answer = await post("method", { name: get("method").value });
    if (!answer.ok) get("said").textContent = (await answer.json()).error;
  });
  get("stop").addEventListener("click", () => post("stop", {}));

  // --- what is shown ---
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const makePlot = () => {
    plot?.destroy();
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false } };
    const scores = drawn.map((label, n) => ({
      label, scale: `score ${n}`, stroke: colour(`--c${n + 1}`), width: 2, points: { show: false },
      value: (_, score) => (score == null ? "" : score.toPrecision(4)),
    }));
    plot = new uPlot({
      width: get("plot").clientWidth, height: 220, cursor: { drag: { x: false, y: false } },
      scales: { x: { time: false }, lens: { range: [0, 1] },
        ...Object.fromEntries(drawn.map((_, n) => [`score ${n}`, { range: () => ranges[n] }])) },
      series: [{ label: "s", value: (_, s) => (s == null ? "" : s.toFixed(2)) }, ...scores,
        { label: "lens", scale: "lens", stroke: colour("--c4"), width: 1, dash: [4, 3], points: { show: false },
          value: (_, at) => (at == null ? "" : at.toFixed(3)) }],
      axes: [axis, { ...axis, scale: "lens", size: 40 }],
    }, points, get("plot"));
  };
  drawn.forEach((name, n) => {
    const select = document.createElement("select");
    select.setAttribute("aria-label", `Measure ${n + 1}`);
    fill(select, setup.measures, name);
    select.addEventListener("input", () => {
      drawn[n] = select.value;
      points[n + 1].fill(null);
      ranges[n] = [0, 0];
      makePlot();
    });
    get("measures").append(select);
  });
  makePlot();
  new ResizeObserver(() => plot.setSize({ width: get("plot").clientWidth, height: 220 })).observe(get("plot"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", makePlot);

  const canvas = get("picture"), pen = canvas.getContext("2d");
  const show = (head, grey) => {
    if (canvas.width !== head.columns || canvas.height !== head.rows) {
      [canvas.width, canvas.height] = [head.columns, head.rows];
    }
    const image = pen.createImageData(head.columns, head.rows);
    const words = new Uint32Array(image.data.buffer);
    for (let n = 0; n < grey.length; n += 1) words[n] = 0xff000000 | grey[n] * 0x010101;
    pen.putImageData(image, 0, 0);
    get("where").textContent = `sent to ${head.focus.toFixed(3)}, at ${head.lens.toFixed(3)}`;
    get("state").textContent = `${head.seconds.toFixed(2)} s, ${head.columns} × ${head.rows} pixels`;
    get("speed").textContent = `${head.factor.toFixed(2)} × real time; possible: `
      + `${Math.round(head.possible).toLocaleString("en")} readouts/s, ${head.possible_factor.toFixed(2)} ×`;
    get("said").textContent = head.said;
    const mark = get("mark");
    mark.hidden = !(get("reveal").checked && head.truth !== null);
    if (!mark.hidden) { // a knob's centre stays half its width inside the ends
      mark.style.left = `calc(${head.truth} * (100% - 16px) + 7px)`;
      get("where").textContent += `; true focus ${head.truth.toFixed(3)}`;
    }
    for (const control of [focus, get("run"), get("region")]) control.disabled = head.running;
    if (head.running) { focus.value = head.lens; delete turned.focus; }
    [head.seconds, ...head.scores, head.lens].forEach((value, n) => {
      points[n].push(value);
      if (points[n].length > KEPT) points[n].shift();
    });
    head.scores.forEach((score, n) => {
      if (score !== null) ranges[n] = [Math.min(ranges[n][0], score), Math.max(ranges[n][1], score)];
    });
    plot.setData(points);
    if (plot.cursor.left < 0) plot.setLegend({ idx: points[0].length - 1 }); // what is now, unless somebody points
    document.body.dataset.pictures = Number(document.body.dataset.pictures ?? 0) + 1;
  };

  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const watch = async () => {
    let wasRunning = false;
    for (;;) {
      await new Promise(requestAnimationFrame); // a hidden page asks for nothing, and its camera stands still
      const asked = { ...turned, measures: drawn, window: Number(get("window").value), pace: Number(get("pace").value),
        region: get("region").value, light: get("light").value };
      for (const key of Object.keys(turned)) delete turned[key];
      try {
        const answer = await post("picture", asked);
        if (!answer.ok) {
          tell((await answer.json()).error);
          await wait(500);
          continue;
        }
        const bytes = await answer.arrayBuffer();
        const length = new DataView(bytes).getUint32(0, true);
        const head = JSON.parse(decoder.decode(new Uint8Array(bytes, 4, length)));
        if (wasRunning && !head.running) focus.value = head.focus;
        wasRunning = head.running;
        show(head, new Uint8Array(bytes, 4 + length));
        tell("");
      } catch (error) {
        tell(`The camera does not answer (${error.message}). Start saf-gen live again.`);
        await wait(1000);
      }
    }
  };
  watch();
})();
