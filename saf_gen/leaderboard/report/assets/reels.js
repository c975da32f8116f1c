// The sequence viewer: a slider, or a pointer on the curves, chooses the picture of the sweep.

document.querySelectorAll(".reel").forEach((reel) => {
  const { across, down, words, x } = JSON.parse(reel.dataset.reel);
  const view = reel.querySelector(".view");
  const picture = view.querySelector("img");
  const slider = reel.querySelector("input");
  const told = reel.querySelector("output");
  const plot = reel.parentElement.querySelector(".plot");
  const cursor = plot.querySelector(".cursor");

  const show = () => {
    const at = Number(slider.value);
    const column = at % across;
    const row = Math.floor(at / across);
    picture.style.transform = `translate(${(-100 * column) / across}%, ${(-100 * row) / down}%)`;
    cursor.style.left = `${100 * x[at]}%`;
    told.value = words[at];
    slider.setAttribute("aria-valuetext", words[at]);
  };
  const follow = (event) => {
    if (event.pointerType !== "mouse" && event.buttons === 0) return;
    const box = plot.getBoundingClientRect();
    const place = (event.clientX - box.left) / box.width;
    const away = x.map((here) => Math.abs(here - place));
    slider.value = String(away.indexOf(Math.min(...away)));
    show();
  };

  reel.classList.add("live");
  for (const part of [view.querySelector(".box"), reel.querySelector("label"), slider, told, cursor]) part.hidden = false;
  slider.addEventListener("input", show);
  plot.addEventListener("pointermove", follow);
  plot.addEventListener("pointerdown", follow);
  show();
});
