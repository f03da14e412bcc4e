"use strict";
// Follows the server's state, draws image and tag in the screen's own pixels, and confirms it.
const CARD_MM = [85.6, 53.98];
const byId = (id) => document.getElementById(id);
const [target, image, tag, status] = ["target", "image", "tag", "status"].map(byId);
let news = null;
let trial = 96 / 25.4 * devicePixelRatio; // a CSS millimetre, until calibrated with a card
let isCalibrating = false;

const post = (path, value) => fetch(path, {
  method: "POST", headers: { "X-Evrig": "stimulus" }, body: JSON.stringify(value),
});

// Lengths are given in the screen's pixels and set in the page's.
const place = (element, left, top, width, height) => {
  const css = (px) => `${px / devicePixelRatio}px`;
  Object.assign(element.style,
    { left: css(left), top: css(top), width: css(width), height: css(height) });
};

const drawTag = (cells, side) => {
  tag.width = tag.height = cells.length;
  const context = tag.getContext("2d");
  cells.forEach((row, y) => [...row].forEach((cell, x) => {
    context.fillStyle = cell === "1" ? "#fff" : "#000";
    context.fillRect(x, y, 1, 1);
  }));
  tag.style.imageRendering = "pixelated";
};

const layOut = (scale) => {
  const { image_mm, gap_mm, tag_mm, cells } = news.target;
  const [p, g, t] = [image_mm, gap_mm, tag_mm].map((mm) => Math.round(mm * scale));
  const needed = [p + g + t, Math.max(p, t)];
  const page = [innerWidth, innerHeight].map((css) => css * devicePixelRatio);
  const [left, top] = [0, 1].map((i) => Math.max(0, Math.round((page[i] - needed[i]) / 2)));
  const bottom = top + needed[1];
  place(image, left, bottom - p, p, p);
  place(tag, left + p + g, bottom - t, t, t);
  drawTag(cells, t);
  const fits = needed[0] <= page[0] && needed[1] <= page[1];
  return { needed_px: needed, width_px: page[0], height_px: page[1], fits };
};

const afterNextFrames = (then) =>
  requestAnimationFrame(() => requestAnimationFrame(then));

const show = async () => {
  const { state, label, n } = news;
  const scale = state.px_per_mm;
  document.body.classList.toggle("calibrating", isCalibrating || scale === null);
  showCard(scale);
  const words = state.is_paused ? "paused (space goes on)" : "space pauses";
  status.textContent =
    `${state.index + 1} of ${n}: ${label} · ${words} · arrows turn · c calibrates · f full screen`;
  if (scale === null) return;
  const wanted = `/image/${state.index}`;
  if (image.getAttribute("src") !== wanted) {
    image.src = wanted;
    try { await image.decode(); } catch { status.textContent = `${label} cannot be drawn`; return; }
  }
  const fit = layOut(scale);
  target.style.visibility = "visible";
  // An image is on the screen one frame after the one in which it was drawn.
  afterNextFrames(() => post("/shown", {
    sequence: state.sequence, index: state.index, px_per_mm: scale,
    device_pixel_ratio: devicePixelRatio, ...fit,
  }));
};

const showCard = (scale) => {
  const shown = isCalibrating || scale === null ? trial : scale;
  const [width, height] = CARD_MM.map((mm) => `${mm * shown / devicePixelRatio}px`);
  Object.assign(byId("outline").style, { width, height });
  byId("scale").textContent = `${shown.toFixed(3)} pixels a millimetre`;
};

const follow = async () => {
  for (;;) {
    const known = news === null ? 0 : news.state.sequence;
    try {
      const answer = await (await fetch(`/state?after=${known}`)).json();
      const isNew = news === null || answer.state.sequence !== known;
      news = answer;
      if (isNew) await show();
    } catch {
      status.textContent = "evrig has ended; start it again and reload";
      await new Promise((go) => setTimeout(go, 1000));
    }
  }
};

addEventListener("keydown", (event) => {
  if (news === null) return;
  const isOpen = isCalibrating || news.state.px_per_mm === null;
  const step = event.shiftKey ? 1.02 : 1.001;
  if (isOpen && event.key === "ArrowUp") { trial *= step; showCard(news.state.px_per_mm); }
  else if (isOpen && event.key === "ArrowDown") { trial /= step; showCard(news.state.px_per_mm); }
  else if (isOpen && event.key === "Enter") { isCalibrating = false; post("/scale", { px_per_mm: trial }); }
  else if (event.key === "c") { isCalibrating = true; trial = news.state.px_per_mm ?? trial; show(); }
  else if (event.key === "f") document.documentElement.requestFullscreen();
  else if (event.key === " ") post("/pause", { is_paused: !news.state.is_paused });
  else if (event.key === "ArrowRight") post("/step", { by: 1 });
  else if (event.key === "ArrowLeft") post("/step", { by: -1 });
  else return;
  event.preventDefault();
});
addEventListener("resize", () => { if (news !== null) show(); });
document.addEventListener("fullscreenchange", () =>
  document.body.classList.toggle("full", document.fullscreenElement !== null));
follow();
