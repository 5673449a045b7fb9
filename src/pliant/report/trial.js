const video = document.querySelector("video");
const cards = [...document.querySelectorAll(".card")];
const bar = document.querySelector(".timeline");
const buttons = bar ? [...bar.querySelectorAll("button")] : [];
const plots = [];
let current = -1;
let now = null; // on the robot's clock [s]

// --- executions -------------------------------------------------------------------------------

function mark(index) {
  if (index === current) return;
  current = index;
  for (const list of [buttons, cards]) {
    list.forEach((one, n) => {
      one.classList.toggle("current", n === index);
      if (n === index) one.setAttribute("aria-current", "true");
      else one.removeAttribute("aria-current");
    });
  }
  const button = buttons[index]; // its own bar scrolls to it, and not the page
  if (button) bar.scrollTo({ left: button.offsetLeft - (bar.clientWidth - button.offsetWidth) / 2 });
}

/** Show an execution: in the video if there is one, else its card; and where it is in the plots. */
function go(index, { play = false, scroll = "none" } = {}) {
  const { video: span, time } = data.executions[index];
  mark(index);
  showTime(time[0]);
  if (video && span) {
    // A little later than its first frame, so that rounding cannot show the one before.
    video.currentTime = span[0] + 0.001;
    if (scroll !== "none") video.scrollIntoView({ block: "center" });
    if (play) video.play();
  } else if (scroll !== "none") {
    unfold(cards[index]);
    cards[index].scrollIntoView({ block: "start" });
  }
}

/** The cards of a long trial are folded, but where a link leads, and on paper. */
function unfold(card) {
  const folded = card?.querySelector(":scope > details");
  if (folded) folded.open = true;
}

function followLink() {
  const card = cards.find(({ id }) => id && `#${id}` === location.hash);
  unfold(card);
  card?.scrollIntoView({ block: "start" });
}

addEventListener("hashchange", followLink);
addEventListener("beforeprint", () => cards.forEach(unfold));
if (location.hash) followLink();

buttons.forEach((button, index) => button.addEventListener("click", () => go(index, { scroll: video ? "none" : "card" })));
for (const button of document.querySelectorAll(".card button[data-execution]")) {
  button.addEventListener("click", () => go(Number(button.dataset.execution), { play: true, scroll: "video" }));
}
bar?.addEventListener("keydown", (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  const at = buttons.indexOf(document.activeElement);
  const next = event.key === "Home" ? 0 : event.key === "End" ? buttons.length - 1 : at + (step ?? NaN);
  if (!buttons[next]) return;
  event.preventDefault();
  buttons[next].focus();
});

// --- playback ---------------------------------------------------------------------------------

/** The robot's time at a time of the video, which stands still at each verdict. */
function robotTime(at) {
  for (const { video: [begins, judged, ends], time: [from, to] } of data.executions) {
    if (at < ends) return judged > begins ? from + (to - from) * Math.min(1, Math.max(0, at - begins) / (judged - begins)) : to;
  }
  return data.executions.at(-1).time[1];
}

/** The video's time at a time of the robot. */
function videoTime(at) {
  const { video: [begins, judged], time: [from, to] } = data.executions[executionAt(at)];
  return to > from ? begins + (judged - begins) * Math.min(1, Math.max(0, at - from) / (to - from)) : begins;
}

function executionAt(at) {
  return Math.max(0, data.executions.findLastIndex(({ time }) => at >= time[0]));
}

function follow() {
  const at = video.currentTime;
  const index = data.executions.findIndex(({ video: span }) => at < span[2]);
  mark(index < 0 ? data.executions.length - 1 : index);
  showTime(robotTime(at));
  if (!video.paused && !video.ended) requestAnimationFrame(follow);
}

if (video && data.executions.length) {
  for (const event of ["play", "seeked", "timeupdate"]) video.addEventListener(event, follow);
}

// --- plots ------------------------------------------------------------------------------------

function showTime(time) {
  now = time;
  for (const plot of plots) placeNow(plot);
}

function placeNow(plot) {
  if (now === null) return;
  const left = plot.valToPos(now, "x");
  plot.nowLine.hidden = !(left >= 0 && left <= plot.over.clientWidth);
  plot.nowLine.style.left = `${left}px`;
}

function range(of) {
  const values = data.traces[of].filter((v) => v !== null);
  for (const { goal } of data.executions) if (of in goal && goal[of] !== null) values.push(goal[of]);
  if (of === "compression") values.push(0, data.limits.compression[0]);
  const low = Math.min(...values), high = Math.max(...values);
  const margin = Math.max(0.06 * (high - low), data.tolerance[of] ?? 0.5);
  return [low - margin, high + margin];
}

/** Verdicts as shades, goals with their tolerance, limits: behind the measured line. */
function drawBehind(plot, of) {
  const { ctx, bbox } = plot;
  const x = (v) => plot.valToPos(v, "x", true), y = (v) => plot.valToPos(v, of, true);
  const scale = devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const { success, time: [from, to], goal, owned } of data.executions) {
    ctx.fillStyle = colour(success ? "success-shade" : "failure-shade");
    ctx.fillRect(x(from), bbox.top, x(to) - x(from), bbox.height);
    if (!success) hatch(ctx, x(from), bbox.top, x(to) - x(from), bbox.height, scale);
    if (!(of in goal) || goal[of] === null) continue;
    if (owned.includes(of)) {
      const top = y(goal[of] + data.tolerance[of]);
      ctx.fillStyle = colour("tolerance");
      ctx.fillRect(x(from), top, x(to) - x(from), y(goal[of] - data.tolerance[of]) - top);
    }
    line(ctx, colour("ink"), [6 * scale, 4 * scale], scale, [x(from), y(goal[of])], [x(to), y(goal[of])]);
  }
  const [low, high] = [plot.scales[of].min, plot.scales[of].max];
  for (const limit of data.limits[of]) {
    if (limit < low || limit > high) continue;
    line(ctx, colour("limit"), [2 * scale, 3 * scale], 2 * scale, [bbox.left, y(limit)], [bbox.left + bbox.width, y(limit)]);
    ctx.fillStyle = colour("limit");
    ctx.font = `${12 * scale}px system-ui, sans-serif`;
    ctx.fillText(`limit ${limit}`, bbox.left + 6 * scale, y(limit) + 14 * scale);
  }
  ctx.restore();
}

/** Tell a failure without its colour: strokes, and a cross above. */
function hatch(ctx, left, top, wide, high, scale) {
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, wide, high);
  ctx.clip();
  ctx.globalAlpha = 0.35;
  for (let at = left - high; at < left + wide; at += 14 * scale) {
    line(ctx, colour("failure-ink"), [], scale, [at, top + high], [at + high, top]);
  }
  ctx.globalAlpha = 1;
  if (wide >= 9 * scale) {
    ctx.fillStyle = colour("failure-ink");
    ctx.font = `bold ${11 * scale}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.fillText("✗", left + wide / 2, top + 11 * scale);
  }
  ctx.restore();
}

function line(ctx, stroke, dash, width, from, to) {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width;
  ctx.setLineDash(dash);
  ctx.beginPath();
  ctx.moveTo(...from);
  ctx.lineTo(...to);
  ctx.stroke();
  ctx.setLineDash([]);
}

function width(place) {
  return Math.max(200, Math.floor(place.clientWidth));
}

function plot(place) {
  const of = place.dataset.of;
  const unit = of === "roll" ? "°" : "mm";
  const ink = () => colour("ink");
  const axis = { stroke: ink, font: "12px system-ui, sans-serif", grid: { stroke: () => colour("line"), width: 1 }, ticks: { stroke: () => colour("line"), width: 1 } };
  const made = new uPlot(
    {
      width: width(place),
      height: 190,
      cursor: { sync: { key: "trial" }, y: false, drag: { x: true, y: false } },
      scales: { x: { time: false }, [of]: { range: () => range(of) } },
      series: [
        { label: "time", value: (_, v) => (v === null ? "–" : `${v.toFixed(2)} s`) },
        { label: of, scale: of, stroke: () => colour("trace"), width: 2, spanGaps: false, points: { show: false }, value: (_, v) => (v === null ? "–" : `${v.toFixed(1)} ${unit}`) },
      ],
      axes: [{ ...axis, size: 30, values: (_, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, scale: of, size: 60 }],
      hooks: { drawClear: [(u) => drawBehind(u, of)], setScale: [(u) => u.nowLine && placeNow(u)], setSize: [(u) => u.nowLine && placeNow(u)] },
    },
    [data.traces.time, data.traces[of]],
    place,
  );
  made.nowLine = element("div", { class: "now", hidden: "" });
  made.over.append(made.nowLine);
  made.over.addEventListener("click", (event) => {
    if (!data.executions.length) return;
    const at = made.posToVal(event.offsetX, "x");
    mark(executionAt(at));
    showTime(at);
    if (video && data.executions[executionAt(at)].video) video.currentTime = videoTime(at) + 0.001;
  });
  return made;
}

function redraw() {
  for (const one of plots) one.redraw(false, true);
}

if (data.traces.time.length) {
  const places = [...document.querySelectorAll(".plot")];
  if (typeof uPlot === "undefined") {
    for (const place of places) place.textContent = "The plots need the folder “assets” of the run, and it is not there.";
  } else {
    plots.push(...places.map(plot));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    matchMedia("print").addEventListener("change", redraw);
    addEventListener("resize", () => {
      places.forEach((place, n) => plots[n].setSize({ width: width(place), height: plots[n].height }));
    });
  }
}
