"use strict";
(() => {
  const { labels, streams } = JSON.parse(document.getElementById("scrub-frames").textContent);
  const slider = document.getElementById("frame"), label = document.getElementById("label");
  const play = document.getElementById("play"), images = document.querySelectorAll("img.scrub");
  let timer = null;
  function show() {
    const frame = Number(slider.value);
    label.value = labels[frame];
    slider.setAttribute("aria-valuetext", labels[frame]);
    for (const image of images) {
      const uri = streams[Number(image.dataset.stream)][frame];
      image.style.visibility = uri ? "visible" : "hidden";
      if (uri) image.src = uri;
    }
  }
  function stop() {
    clearInterval(timer);
    timer = null;
    play.textContent = "Play";
  }
  function next() {
    slider.value = (Number(slider.value) + 1) % labels.length;
    show();
  }
  slider.addEventListener("input", () => { stop(); show(); });
  play.addEventListener("click", () => {
    if (timer) return stop();
    timer = setInterval(next, 150);
    play.textContent = "Stop";
  });
  show();
})();
