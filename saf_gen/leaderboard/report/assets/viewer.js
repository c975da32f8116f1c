// The sequence viewer: a slider, or a pointer on the curves, chooses the picture of the sweep.

document.querySelectorAll(".viewer").forEach((viewer) => {
  const { across, words, x } = JSON.parse(viewer.dataset.viewer);
  const view = viewer.querySelector(".view");
  const picture = view.querySelector("img");
  const slider = viewer.querySelector("input");
  const description = viewer.querySelector("output");
  const plot = viewer.parentElement.querySelector(".plot");
  const cursor = plot.querySelector(".cursor");

  const show = () => {
    const at = Number(slider.value);
    const [column, row] = [at % across, Math.floor(at / across)];
    picture.style.transform = `translate(${-100 * column / across}%, ${-100 * row / Math.ceil(x.length / across)}%)`;
    cursor.style.left = `${100 * x[at]}%`;
    description.value = words[at];
    slider.setAttribute("aria-valuetext", words[at]);
  };
  const follow = (event) => {
    if (event.pointerType !== "mouse" && event.buttons === 0) return;
    const box = plot.getBoundingClientRect();
    const pointer = (event.clientX - box.left) / box.width;
    const distances = x.map((position) => Math.abs(position - pointer));
    slider.value = String(distances.indexOf(Math.min(...distances)));
    show();
  };

  viewer.classList.add("live");
  for (const control of [view.querySelector(".box"), viewer.querySelector("label"), slider, description, cursor]) {
    control.hidden = false;
  }
  slider.addEventListener("input", show);
  plot.addEventListener("pointermove", follow);
  plot.addEventListener("pointerdown", follow);
  show();
});
