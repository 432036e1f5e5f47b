"use strict";
// The map: north up, metres east and north of the first drone's origin. Drawn anew at each state.

const SVG = "http://www.w3.org/2000/svg";
const SIZE = 600, MARGIN = 45, LEAST = 10;  // px, px, m across at least
const TRAIL = 600, TRAIL_STEP = 0.3;  // points, m between two

class FleetMap {
  constructor(svg) {
    this.svg = svg;
    this.trails = {};
    svg.setAttribute("viewBox", `0 0 ${SIZE} ${SIZE}`);
  }

  static colour(n) { return `hsl(${(n * 137.5) % 360} 65% 50%)`; }

  start(trails) { this.trails = structuredClone(trails); }

  draw(drones) {
    for (const d of drones) if (d.at && !d.lost) this.extend(d);
    const points = drones.flatMap(d => [...(d.at ? [d.at] : []), ...d.goals, ...(this.trails[d.name] ?? [])]);
    this.fit(points);
    this.svg.replaceChildren(...this.grid(), ...drones.flatMap((d, n) => this.drone(d, FleetMap.colour(n))));
  }

  extend(d) {
    const trail = this.trails[d.name] ??= [], last = trail.at(-1);
    if (last && Math.hypot(d.at[0] - last[0], d.at[1] - last[1]) < TRAIL_STEP) return;
    trail.push(d.at);
    if (trail.length > TRAIL) trail.shift();
  }

  fit(points) {
    const range = k => points.length ? [Math.min(...points.map(p => p[k])), Math.max(...points.map(p => p[k]))] : [0, 0];
    const [x, y] = [range(0), range(1)];
    this.across = Math.max(x[1] - x[0], y[1] - y[0], LEAST);
    this.middle = [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2];
    this.scale = (SIZE - 2 * MARGIN) / this.across;
  }

  place([x, y]) {
    return [SIZE / 2 + (x - this.middle[0]) * this.scale, SIZE / 2 - (y - this.middle[1]) * this.scale];
  }

  grid() {
    const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(s => s * 8 >= this.across) ?? 2000;
    const half = SIZE / 2 / this.scale, lines = [];
    for (const k of [0, 1]) {
      const first = Math.ceil((this.middle[k] - half) / step) * step;
      for (let v = first; v < this.middle[k] + half; v += step) {
        const at = this.place(k ? [0, v] : [v, 0])[k];
        lines.push(make("line", k ? {class: "grid", x1: 0, x2: SIZE, y1: at, y2: at}
                                  : {class: "grid", y1: 0, y2: SIZE, x1: at, x2: at}));
      }
    }
    const label = make("text", {class: "scale", x: 10, y: SIZE - 10});
    label.textContent = `grid ${step} m, north up`;
    return [...lines, label];
  }

  drone(d, colour) {
    const parts = [], trail = this.trails[d.name] ?? [];
    if (trail.length > 1) {
      parts.push(make("polyline", {class: "trail", stroke: colour, points: trail.map(p => this.place(p)).join(" ")}));
    }
    const here = d.at && this.place(d.at), next = d.goals[Math.max(d.companion.goal ?? 0, 0)];
    d.goals.forEach((g, n) => {
      const [x, y] = this.place(g);
      const ring = make("circle", {class: "goal", cx: x, cy: y, r: 7, stroke: colour});
      ring.append(titled(`${d.name}: goal ${n + 1}`));
      parts.push(ring);
    });
    if (!here) return parts;
    if (next && d.companion.phase === "fly") {
      const [x, y] = this.place(next);
      parts.push(make("line", {class: "way", x1: here[0], y1: here[1], x2: x, y2: y, stroke: colour}));
    }
    const group = make("g", {class: d.lost ? "lost" : "", "data-drone": d.name});
    const dot = make("circle", {class: "dot", cx: here[0], cy: here[1], r: 8, fill: colour});
    dot.append(titled(d.place ? `${d.name}: ${d.place.map(v => v.toFixed(6)).join(", ")}` : d.name));
    const name = make("text", {x: here[0] + 11, y: here[1] + 4});
    name.textContent = d.name;
    group.append(dot, name);
    return [...parts, group];
  }
}

function make(tag, attributes) {
  const element = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function titled(text) {
  const title = make("title", {});
  title.textContent = text;
  return title;
}
