// The sequence viewer: the slider, a pointer on the curves or the play button chooses the picture of the sweep.

const PICTURE_MS = 125;

document.querySelectorAll(".viewer").forEach((viewer) => {
  const { across, words, x } = JSON.parse(viewer.dataset.viewer);
  const view = viewer.querySelector(".view");
  const pictures = [...view.querySelectorAll("img")];
  const [play, slider, kind] = ["button", "input", "select"].map((name) => viewer.querySelector(name));
  const description = viewer.querySelector("output");
  const box = view.querySelector(".box");
  const plot = viewer.parentElement.querySelector(".chart");
  let timer = null;
  let chart = null; // drawn when it comes into view
  let placed = 0; // where this script has put the chart's pointer, which the chart reports later

  const show = ({ pointer = true } = {}) => {
    const at = Number(slider.value);
    const [column, row] = [at % across, Math.floor(at / across)];
    for (const picture of pictures) {
      picture.hidden = !picture.classList.contains(kind.value);
      picture.style.transform = `translate(${-100 * column / across}%, ${-100 * row / Math.ceil(x.length / across)}%)`;
    }
    box.hidden = kind.value === "spikes"; // these pictures show a smaller part than the box
    description.value = words[at];
    slider.setAttribute("aria-valuetext", words[at]);
    if (chart === null || !pointer) return; // a reader who points has moved the pointer already
    placed = chart.valToPos(x[at], "x");
    chart.setCursor({ left: placed, top: 0 });
  };
  const setPlaying = (playing) => {
    clearInterval(timer);
    timer = playing ? setInterval(() => {
      slider.value = String((Number(slider.value) + 1) % x.length);
      show();
    }, PICTURE_MS) : null;
    play.setAttribute("aria-pressed", String(playing));
    play.textContent = playing ? "❚❚" : "▶";
    description.setAttribute("aria-live", playing ? "off" : "polite");
  };
  const follow = () => {
    if (timer !== null || chart.cursor.left < 0 || Math.abs(chart.cursor.left - placed) < 1) return;
    const pointer = chart.posToVal(chart.cursor.left, "x");
    const distances = x.map((position) => Math.abs(position - pointer));
    slider.value = String(distances.indexOf(Math.min(...distances)));
    show({ pointer: false });
  };

  viewer.classList.add("live");
  for (const control of [viewer.querySelector(".controls"), description]) control.hidden = false;
  play.addEventListener("click", () => setPlaying(timer === null));
  slider.addEventListener("input", () => { setPlaying(false); show(); });
  kind.addEventListener("input", () => show());
  plot.addEventListener("drawn", ({ detail }) => {
    chart = detail;
    (chart.hooks.setCursor ??= []).push(follow);
    show();
  });
  show();
});
