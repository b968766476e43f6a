"use strict";
// Track over ground with plans, circle, fence and vessels; yaw spectrum.

const EARTH_M = 6371008.8, OLD_S = 5;
// MAV_CMD of mission items with a position, and the parameter of the circle radius: WAYPOINT 16, LOITER_UNLIM, _TURNS,
// _TIME 17 to 19, LOITER_TO_ALT 31, SPLINE_WAYPOINT 82. Fence: POLYGON_VERTEX and CIRCLE, each inclusion, exclusion.
const PLACES = { 16: null, 17: 3, 18: 3, 19: 3, 31: 2, 82: null };
const VERTEX = { 5001: "fence", 5002: "fence out" }, CIRCLES = { 5003: "fence", 5004: "fence out" };

const metres = ([latitude, longitude], [latitude0, longitude0]) => {
  const east = ((longitude - longitude0 + 540) % 360) - 180;
  return [(latitude - latitude0) * Math.PI / 180 * EARTH_M,
    east * Math.PI / 180 * EARTH_M * Math.cos(latitude0 * Math.PI / 180)];
};

class Track {
  constructor(card, voyage) {
    this.view = null; // [north, east, metres per pixel] after the user has moved it
    this.span = null;
    this.cursor = null;
    const header = addHtml(card, "header");
    addHtml(header, "span", {}, "Track");
    this.readout = addHtml(header, "span", { class: "readout" });
    for (const [text, title, action] of [["−", "show more", () => this.zoom(1.6)], ["+", "show less", () => this.zoom(0.625)],
      ["all", "show all", () => { this.view = null; this.draw(); }]]) {
      addHtml(header, "button", { type: "button", title }, text).addEventListener("click", action);
    }
    this.svg = addSvg(card, "svg", { class: "track", role: "img", "aria-label": "track over the ground, with plans" });
    this.listen();
    this.set(voyage);
  }

  set(voyage) {
    this.voyage = voyage;
    const { columns } = voyage;
    this.origin = voyage.origin || null;
    if (columns.lat_deg) {
      const first = columns.lat_deg.findIndex((value, i) => isKnown(value) && isKnown(columns.lon_deg[i]));
      if (first >= 0) this.origin = [columns.lat_deg[first], columns.lon_deg[first]];
      const positions = columns.lat_deg.map((value, i) => (this.origin && isKnown(value) && isKnown(columns.lon_deg[i])
        ? metres([value, columns.lon_deg[i]], this.origin) : [null, null]));
      this.north = positions.map((spot) => spot[0]);
      this.east = positions.map((spot) => spot[1]);
    } else {
      this.north = columns.north_m || [];
      this.east = columns.east_m || [];
    }
    this.shapes = this.origin ? shapesOf(voyage, this.origin) : [];
    this.draw();
  }

  follow(cursor, span) {
    const isChanged = !this.span || span[0] !== this.span[0] || span[1] !== this.span[1];
    this.cursor = cursor;
    this.span = span;
    if (isChanged) this.draw();
    else this.drawBoat();
  }

  bounds() {
    const [first, last] = this.part();
    const points = [];
    for (let i = first; i < last; i += 1) if (isKnown(this.north[i])) points.push([this.north[i], this.east[i]]);
    const isComplete = last - first === this.north.length, [n0, e0] = points[points.length - 1] || [0, 0];
    const reachOf = (list) => list.reduce((most, [n, e]) => Math.max(most, Math.abs(n - n0), Math.abs(e - e0)), 250);
    // Far vessels would shrink the track to a dot; "show more" reveals them.
    const shapes = this.shapes.filter((shape) => shape.kind !== "vessel" || reachOf(shape.points) < 4 * reachOf(points));
    if (isComplete || !points.length) for (const shape of shapes) {
      const reach = shape.radius || 0;
      for (const [n, e] of shape.points) points.push([n - reach, e - reach], [n + reach, e + reach]);
    }
    const box = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [n, e] of points) {
      box[0] = Math.min(box[0], n); box[1] = Math.max(box[1], n);
      box[2] = Math.min(box[2], e); box[3] = Math.max(box[3], e);
    }
    return points.length ? box : [-10, 10, -10, 10];
  }

  part() {
    const times = this.voyage.columns.time_s || [];
    return this.span ? [Math.max(0, firstIndexFrom(times, this.span[0]) - 1), Math.min(times.length, firstIndexFrom(times, this.span[1]) + 1)]
      : [0, times.length];
  }

  draw() {
    const width = Math.max(240, this.svg.parentNode.clientWidth - 20), height = Math.min(460, Math.max(280, width));
    const [south, north, west, east] = this.bounds();
    const fit = Math.max((north - south) / (height - 70), (east - west) / (width - 90), 0.02);
    const [cn, ce, scale] = this.view || [(north + south) / 2, (east + west) / 2, fit];
    const x = (m) => width / 2 + 14 + (m - ce) / scale, y = (m) => (height - 20) / 2 - (m - cn) / scale;
    Object.assign(this, { width, height, x, y, at: [cn, ce, scale] });
    const { svg } = this;
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.style.height = `${height}px`;
    const step = niceStep(width * scale, width / 80), far = step >= 1000;
    for (const at of ticks(ce - (x(0) - x(0) + width / 2 + 14) * scale, ce + width / 2 * scale, step)) {
      addSvg(svg, "line", { class: "grid", x1: x(at), x2: x(at), y1: 0, y2: height - 18 });
      if (x(at) > 30 && x(at) < width - 20) addSvg(svg, "text", { x: x(at), y: height - 4, "text-anchor": "middle" }, distance(at, step, far));
    }
    for (const at of ticks(cn - height / 2 * scale, cn + height / 2 * scale, step)) {
      addSvg(svg, "line", { class: "grid", x1: 0, x2: width, y1: y(at), y2: y(at) });
      if (y(at) > 26 && y(at) < height - 30) addSvg(svg, "text", { x: 2, y: y(at) - 3 }, distance(at, step, far));
    }
    addSvg(svg, "text", { x: width - 2, y: height - 22, "text-anchor": "end" }, far ? "east (km)" : "east (m)");
    addSvg(svg, "text", { x: 2, y: 11 }, far ? "north (km)" : "north (m)");
    for (const shape of this.shapes) this.drawShape(shape, scale);
    const [first, last] = this.part();
    const path = (from, to) => {
      const parts = [];
      let px = null, py = null;
      for (let i = from; i < to; i += 1) {
        if (!isKnown(this.north[i])) { px = null; continue; }
        const qx = x(this.east[i]), qy = y(this.north[i]);
        if (px !== null && Math.hypot(qx - px, qy - py) < 0.7 && i < to - 1) continue;
        parts.push(`${px === null ? "M" : "L"}${qx.toFixed(1)} ${qy.toFixed(1)}`);
        [px, py] = [qx, qy];
      }
      return parts.join("");
    };
    if (last - first < this.north.length) addSvg(svg, "path", { class: "line whole", d: path(0, this.north.length) });
    addSvg(svg, "path", { class: "line", d: path(first, last) });
    const begin = this.north.findIndex(isKnown);
    if (begin >= 0) addSvg(svg, "circle", { class: "start", cx: x(this.east[begin]), cy: y(this.north[begin]), r: 4 })
      .appendChild(document.createElementNS(SVG, "title")).textContent = "start";
    this.boat = addSvg(svg, "g");
    this.drawBoat();
  }

  drawShape(shape, scale) {
    const { svg, x, y } = this;
    const points = shape.points.map(([n, e]) => `${x(e).toFixed(1)},${y(n).toFixed(1)}`).join(" ");
    const [n, e] = shape.points[0];
    if (shape.kind === "polygon") addSvg(svg, "polygon", { class: shape.look, points });
    if (shape.kind === "legs") addSvg(svg, "polyline", { class: "leg", points });
    if (shape.radius) addSvg(svg, "circle", { class: shape.look, cx: x(e), cy: y(n), r: shape.radius / scale });
    if (shape.kind === "spot") {
      addSvg(svg, "circle", { class: `spot${shape.now ? " now" : ""}`, cx: x(e), cy: y(n), r: 4 });
      addSvg(svg, "text", { x: x(e) + 7, y: y(n) - 5, class: "command" }, shape.label);
    }
    if (shape.kind === "home") {
      addSvg(svg, "path", { class: "home", d: `M${x(e)} ${y(n) - 7}l7 6v7h-14v-7z` }).appendChild(
        document.createElementNS(SVG, "title")).textContent = "home";
    }
    if (shape.kind === "rally") addSvg(svg, "path", { class: "home", d: `M${x(e)} ${y(n) - 7}l6 10h-12z` });
    if (shape.kind === "vessel") {
      const turn = isKnown(shape.course) ? ` rotate(${shape.course})` : "";
      addSvg(svg, "path", { class: "vessel", d: "M0 -8L5 6H-5z", transform: `translate(${x(e)} ${y(n)})${turn}` });
      const left = x(e) > this.width - 90;
      addSvg(svg, "text", { x: x(e) + (left ? -8 : 8), y: y(n) + 4, class: "goal", "text-anchor": left ? "end" : "start" }, shape.label);
    }
  }

  drawBoat() {
    const times = this.voyage.columns.time_s || [];
    const at = this.cursor === null ? times.length - 1 : nearest(times, this.cursor);
    let i = at;
    while (i > 0 && !isKnown(this.north[i])) i -= 1;
    this.boat.replaceChildren();
    if (i < 0 || !isKnown(this.north[i])) { this.readout.textContent = ""; return; }
    const columns = this.voyage.columns;
    const heading = (columns.true_heading_deg || [])[i] ?? (columns.heading_deg || [])[i];
    const turn = isKnown(heading) ? ` rotate(${heading})` : "";
    const age = times[at] - times[i]; // the last known position is old
    addSvg(this.boat, "path", { class: age > OLD_S ? "boat old" : "boat", d: isKnown(heading) ? "M0 -10L6 8L0 5L-6 8z" : "M-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0",
      transform: `translate(${this.x(this.east[i])} ${this.y(this.north[i])})${turn}` });
    this.readout.textContent = this.origin && columns.lat_deg && isKnown(columns.lat_deg[i])
      ? `${columns.lat_deg[i].toFixed(5)}, ${columns.lon_deg[i].toFixed(5)}`
      : `${Math.abs(this.north[i]).toFixed(0)} m ${this.north[i] < 0 ? "S" : "N"} ${Math.abs(this.east[i]).toFixed(0)} m ${this.east[i] < 0 ? "W" : "E"}`;
    if (age > OLD_S) this.readout.textContent += `, ${age.toFixed(0)} s old`;
  }

  zoom(factor, around = null) {
    const [cn, ce, scale] = this.at;
    const [n, e] = around || [cn, ce];
    this.view = [n + (cn - n) * factor, e + (ce - e) * factor, scale * factor];
    this.draw();
  }

  listen() {
    let start = null;
    this.svg.addEventListener("pointerdown", (event) => {
      start = [event.clientX, event.clientY, ...this.at];
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (!start || !event.buttons) return;
      const [px, py, cn, ce, scale] = start, dot = scale * this.width / this.svg.getBoundingClientRect().width;
      this.view = [cn + (event.clientY - py) * dot, ce - (event.clientX - px) * dot, scale];
      this.draw();
    });
    for (const name of ["pointerup", "pointercancel"]) this.svg.addEventListener(name, () => { start = null; });
    this.svg.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8);
    }, { passive: false });
    this.svg.addEventListener("dblclick", () => { this.view = null; this.draw(); });
  }
}

const distance = (value, step, far) => (far ? formatNumber(value / 1000, step / 1000) : formatNumber(value, step));

// Shapes of the chart besides the track; points are metres north and east of the origin.
function shapesOf(voyage, origin) {
  const plans = voyage.plans || {}, shapes = [];
  const at = (item) => metres([item[5], item[6]], origin);
  let vertices = [];
  for (const item of plans.fence || []) {
    if (VERTEX[item[0]]) {
      vertices.push(at(item));
      if (vertices.length >= item[1]) { shapes.push({ kind: "polygon", look: VERTEX[item[0]], points: vertices }); vertices = []; }
    } else if (CIRCLES[item[0]]) shapes.push({ kind: "ring", look: CIRCLES[item[0]], points: [at(item)], radius: item[1] });
  }
  const legs = [], first = voyage.first_item || 0; // displayed number of the first item
  (plans.mission || []).forEach((item, number) => {
    if (!(item[0] in PLACES) || (!item[5] && !item[6])) return;
    const spot = at(item), radius = PLACES[item[0]] ? Math.abs(item[PLACES[item[0]]] || 0) : 0;
    legs.push(spot);
    shapes.push({ kind: "spot", points: [spot], label: String(number + first), radius, look: "circle", now: number + first === voyage.item });
  });
  if (legs.length > 1) shapes.unshift({ kind: "legs", points: legs });
  for (const item of plans.rally || []) shapes.push({ kind: "rally", points: [at(item)] });
  if (plans.home) shapes.push({ kind: "home", points: [metres(plans.home, origin)] });
  if (voyage.target) {
    const [latitude, longitude, radius] = voyage.target;
    shapes.push({ kind: "target", look: "circle", points: [metres([latitude, longitude], origin)], radius });
  }
  for (const vessel of voyage.vessels || []) {
    shapes.push({ kind: "vessel", points: [metres([vessel.lat_deg, vessel.lon_deg], origin)], course: vessel.course_deg,
      label: vessel.name });
  }
  return shapes;
}

function drawSpectrum(card, spectrum) {
  addHtml(addHtml(card, "header"), "span", {}, "Yaw spectrum (deg²/Hz)");
  const width = Math.max(240, card.clientWidth - 20), height = 220, bottom = height - 34, top = 22;
  const svg = addSvg(card, "svg", { role: "img", "aria-label": "spectrum of the yaw", viewBox: `0 0 ${width} ${height}` });
  svg.style.height = `${height}px`;
  const hertz = spectrum.frequency_hz, low = Math.log10(hertz[0]), high = Math.log10(hertz[hertz.length - 1]);
  const values = spectrum.lines.flatMap((line) => line[2]).filter((value) => value > 0);
  const most = Math.ceil(Math.log10(Math.max(...values, 1e-3))), least = Math.max(most - 6, Math.floor(Math.log10(Math.min(...values, 1e3))));
  const x = (f) => LEFT + (Math.log10(f) - low) / (high - low) * (width - LEFT - RIGHT);
  const y = (v) => bottom - (clamp(Math.log10(Math.max(v, 1e-30)), least, most) - least) / (most - least) * (bottom - top);
  for (let power = least; power <= most; power += 1) {
    addSvg(svg, "line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(10 ** power), y2: y(10 ** power) });
    if ((power - least) % 2 === 0) addSvg(svg, "text", { x: LEFT - 5, y: y(10 ** power) + 4, "text-anchor": "end" }, power < 4 && power > -4 ? String(Number((10 ** power).toPrecision(1))) : `1e${power}`);
  }
  for (const period of [100, 50, 20, 10, 5, 2, 1, 0.5]) {
    if (x(1 / period) < LEFT || x(1 / period) > width - RIGHT) continue;
    addSvg(svg, "line", { class: "grid", x1: x(1 / period), x2: x(1 / period), y1: top, y2: bottom });
    addSvg(svg, "text", { x: x(1 / period), y: bottom + 14, "text-anchor": "middle" }, String(period));
  }
  addSvg(svg, "text", { x: width - RIGHT, y: height - 4, "text-anchor": "end" }, "period (s)");
  for (const [f, label] of spectrum.marks) {
    addSvg(svg, "line", { class: "mark bad", x1: x(f), x2: x(f), y1: top, y2: bottom });
    addSvg(svg, "text", { class: "bad", x: clamp(x(f), LEFT + 50, width - 60), y: height - 4, "text-anchor": "middle" }, label);
  }
  let right = LEFT;
  for (const [label, look, line] of spectrum.lines) {
    addSvg(svg, "path", { class: `line ${look}`, d: line.map((value, i) => `${i ? "L" : "M"}${x(hertz[i]).toFixed(1)} ${y(value).toFixed(1)}`).join("") });
    const text = addSvg(svg, "text", { class: look, x: right, y: 12 }, label);
    right += text.getComputedTextLength() + 12;
  }
  addSvg(svg, "rect", { class: "frame", x: LEFT, y: top, width: width - LEFT - RIGHT, height: bottom - top });
}
