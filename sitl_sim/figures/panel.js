// Map, cameras, curves and events of a flight on one cursor. The page's #t=SECONDS is its place.
const flight = JSON.parse(document.getElementById("flight").textContent);
const at = (id) => document.getElementById(id);
const slider = at("time"), play = at("play"), shown = at("shown");
const plots = ["curves", "timeline"].map(at).filter(Boolean);
const end = flight.t[flight.t.length - 1];
const places = at("map").data.findIndex((trace) => trace.name === "now");
let now = 0, playing = false, drawn = -1;

function index(times, time) {  // of the last of them at or before `time`
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-9) low = middle + 1; else high = middle;
  }
  return Math.max(low - 1, 0);
}

function show(time, link = true) {
  now = Math.min(Math.max(time, 0), end);
  slider.value = now;
  shown.textContent = now.toFixed(1) + " s";
  const k = index(flight.t, now);
  if (k !== drawn) {
    drawn = k;
    Plotly.restyle("map", {x: [flight.x.map((x) => x[k])], y: [flight.y.map((y) => y[k])]}, [places]);
  }
  if (flight.pictures) {
    const n = index(flight.pictures.t, now);
    document.querySelectorAll("#cameras img").forEach((image, i) => {
      image.src = "data:image/jpeg;base64," + flight.pictures.jpeg[i][n];
    });
    at("taken").textContent = flight.pictures.t[n].toFixed(1) + " s";
  }
  plots.forEach(place);
  let last = null;
  for (const row of document.querySelectorAll("#events tr")) {
    row.classList.toggle("past", Number(row.dataset.t) <= now + 0.05);
    if (row.classList.contains("past")) last = row;
  }
  if (last) last.parentElement.closest("div").scrollTop = last.offsetTop - 60;
  if (link) history.replaceState(null, "", "#t=" + now.toFixed(1));
}

function place(plot) {  // the cursor's line
  const axis = plot._fullLayout.xaxis, size = plot._fullLayout._size;
  const line = plot.querySelector(".cursor");
  line.style.left = axis._offset + axis.l2p(now) + "px";
  line.style.top = size.t + "px";
  line.style.height = size.h + "px";
}

function start(on) {
  playing = on;
  play.textContent = on ? "❚❚" : "▶";
  if (on && now >= end) show(0);
  let before = performance.now();
  const step = (stamp) => {
    if (!playing) return;
    show(now + Math.max(stamp - before, 0) / 1000 * Number(at("speed").value), false);
    before = stamp;
    if (now >= end) start(false); else requestAnimationFrame(step);
  };
  if (on) requestAnimationFrame(step); else show(now);
}

for (const plot of plots) {
  const line = document.createElement("div");
  line.className = "cursor";
  plot.append(line);
  const seek = (event) => {
    const axis = plot._fullLayout.xaxis;
    show(axis.p2l(event.clientX - plot.getBoundingClientRect().left - axis._offset));
  };
  plot.addEventListener("pointerdown", seek);
  plot.addEventListener("pointermove", (event) => event.buttons === 1 && seek(event));
  plot.on("plotly_afterplot", () => place(plot));
}
slider.max = end;
slider.addEventListener("input", () => show(Number(slider.value)));
play.addEventListener("click", () => start(!playing));
document.addEventListener("keydown", (event) => {
  if (event.target.matches("input,select,button")) return;
  if (event.key === " ") { event.preventDefault(); start(!playing); }
  if (event.key === "ArrowRight") show(now + 0.2);
  if (event.key === "ArrowLeft") show(now - 0.2);
});
const linked = () => {
  const found = /^#t=([0-9.]+)$/.exec(location.hash);
  if (found) show(Number(found[1]), false);
};
window.addEventListener("hashchange", () => { linked(); at("flown").scrollIntoView(); });
show(flight.start, false);
linked();
