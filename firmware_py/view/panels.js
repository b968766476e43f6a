"use strict";
// Lines over time in panels: drag to zoom, move to read values, marks for events.

const LEFT = 46, RIGHT = 10, STRIP = 16, HEAD = 20, GAP = 10, FOOT = 22;
// Failures are red: warnings and graver, but not the ordered end of a program by a signal.
const isFailure = (severity, text) => severity <= 4 && !text.startsWith("SIG");

class TimePanels {
  constructor(card, voyage, notify) {
    this.notify = notify; // (time or null, [from, to]) to the other plots
    this.range = null;
    this.cursor = null;
    const header = addHtml(card, "header");
    addHtml(header, "span", {}, "Time series");
    this.readout = addHtml(header, "span", { class: "readout", "aria-live": "off" });
    this.buttons = [["−", "show more", () => this.zoom(2)], ["+", "show less", () => this.zoom(0.5)],
      ["all", "show all", () => this.setRange(null)]].map(([text, title, action]) => {
      const button = addHtml(header, "button", { type: "button", title }, text);
      button.addEventListener("click", action);
      return button;
    });
    this.svg = addSvg(card, "svg", { class: "time", role: "img", "aria-label": "heading, rudder and more over time" });
    this.listen();
    this.set(voyage);
  }

  set(voyage) {
    this.voyage = voyage;
    this.times = voyage.columns.time_s || [];
    this.panels = voyage.panels.map((panel) => ({
      ...panel,
      lines: panel.lines.filter((line) => (voyage.columns[line.column] || []).some(isKnown)),
    })).filter((panel) => panel.lines.length && (panel.lines[0].column !== "faults"
      || voyage.columns.faults.some((count) => count > 0)));
    this.draw();
  }

  extent() {
    const times = this.times;
    return this.range || (times.length ? [times[0], Math.max(times[times.length - 1], times[0] + 1)] : [0, 1]);
  }

  setRange(range) {
    const times = this.times;
    if (range && times.length) {
      const from = Math.max(range[0], times[0]), to = Math.min(range[1], times[times.length - 1]);
      range = to - from < 0.5 || (from <= times[0] && to >= times[times.length - 1]) ? null : [from, to];
      if (range === null && to - from < 0.5) return;
    }
    this.range = range;
    this.draw();
    this.notify(this.cursor, this.extent());
  }

  zoom(factor) {
    const [from, to] = this.extent();
    const middle = this.cursor !== null && this.cursor > from && this.cursor < to ? this.cursor : (from + to) / 2;
    const half = (to - from) * factor / 2;
    this.setRange([middle - half, middle + half]);
  }

  draw() {
    const width = Math.max(260, this.svg.parentNode.clientWidth - 20);
    const heights = this.panels.map((panel) => (panel.tall ? 150 : 92));
    const height = STRIP + heights.reduce((sum, panelHeight) => sum + panelHeight + HEAD + GAP, 0) + FOOT;
    const [from, to] = this.extent();
    const x = (time) => LEFT + (time - from) / (to - from) * (width - LEFT - RIGHT);
    Object.assign(this, { width, height, x, when: (px) => from + (px - LEFT) / (width - LEFT - RIGHT) * (to - from) });
    this.svg.replaceChildren();
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.style.height = `${height}px`;
    const step = niceStep(to - from, (width - LEFT - RIGHT) / 85, TIMES);
    // Ticks at whole days and hours of the calendar.
    const shift = isKnown(this.voyage.begin_utc_s) ? this.voyage.begin_utc_s : 0;
    const tickTimes = ticks(from + shift, to + shift, step).map((at) => at - shift);
    this.legends = [];
    this.fields = [];
    let top = STRIP;
    this.panels.forEach((panel, i) => {
      this.drawPanel(panel, top + HEAD, heights[i], tickTimes);
      top += HEAD + heights[i] + GAP;
    });
    for (const at of tickTimes) {
      const px = x(at);
      if (px < LEFT - 1 || px > width - 8) continue;
      const anchor = px > width - 30 ? "end" : px < LEFT + 8 ? "start" : "middle";
      addSvg(this.svg, "text", { x: px, y: height - 8, "text-anchor": anchor },
        momentText(at, to - from, this.voyage.begin_utc_s));
    }
    this.drawMarks(from, to);
    this.selection = addSvg(this.svg, "rect", { class: "pick", y: STRIP, height: height - FOOT - STRIP, width: 0, x: -9 });
    this.line = addSvg(this.svg, "line", { class: "cursor", y1: STRIP, y2: height - FOOT, x1: -9, x2: -9 });
    this.buttons[0].disabled = this.buttons[2].disabled = !this.range;
    this.read();
  }

  drawPanel(panel, top, height, tickTimes) {
    const { svg, x, times, width } = this;
    const [from, to] = this.extent();
    const first = Math.max(0, firstIndexFrom(times, from) - 1), last = Math.min(times.length, firstIndexFrom(times, to) + 1);
    let columns = panel.lines.map((line) => this.voyage.columns[line.column]);
    if (panel.wrap) {
      const cut = findCutAngle(columns.map((values) => values.slice(first, last)));
      columns = columns.map((values) => values.map((value) => wrapAngle(value, cut)));
    }
    const [low, high] = limits(panel, columns, first, last);
    const y = (value) => top + height - (value - low) / (high - low) * height;
    const step = niceStep(high - low, panel.tall ? 5 : 4, panel.wrap ? [1, 2, 5, 10, 15, 30, 45, 90, 180] : null);
    const inside = addSvg(svg, "svg", { x: LEFT, y: top, width: width - LEFT - RIGHT, height,
      viewBox: `${LEFT} ${top} ${width - LEFT - RIGHT} ${height}` });
    this.fields.push([inside, top, height]);
    if (panel.band) addSvg(inside, "rect", { class: "band", x: LEFT, width, y: y(panel.band), height: y(-panel.band) - y(panel.band) });
    for (const at of tickTimes) addSvg(inside, "line", { class: "grid", x1: x(at), x2: x(at), y1: top, y2: top + height });
    for (const at of ticks(low, high, step)) {
      addSvg(inside, "line", { class: panel.zero && Math.abs(at) < step / 9 ? "zero" : "grid", x1: LEFT, x2: width, y1: y(at), y2: y(at) });
      addSvg(svg, "text", { x: LEFT - 5, y: clamp(y(at) + 4, top + 8, top + height + 3), "text-anchor": "end" },
        panel.wrap ? compassText(at, 0) : formatNumber(at, step));
    }
    panel.lines.forEach((line, i) => addSvg(inside, "path", {
      class: `line ${line.look}`, "data-column": line.column,
      d: linePath(times, columns[i], first, last, x, y, panel.wrap ? 180 : 0, panel.step),
    }));
    addSvg(svg, "rect", { class: "frame", x: LEFT, y: top, width: width - LEFT - RIGHT, height });
    const title = addSvg(svg, "text", { class: "title", x: LEFT, y: top - 6 }, panel.title);
    const texts = panel.lines.map((line) => ({ line, label: addSvg(svg, "text", { class: line.look, y: top - 6 }) }));
    this.legends.push({ title, texts, wrap: panel.wrap, step: step / 50 });
  }

  drawMarks(from, to) {
    this.marks = [];
    for (const [time, severity, text] of this.voyage.marks) {
      if (time < from || time > to) continue;
      const px = this.x(time), bad = isFailure(severity, text) ? " bad" : "";
      for (const [field, top, high] of bad ? this.fields : []) {
        addSvg(field, "line", { class: "mark bad", x1: px, x2: px, y1: top, y2: top + high });
      }
      const flag = addSvg(this.svg, "path", { class: `flag${bad}`, d: `M${px - 4} 4h8l-4 9z` });
      addSvg(flag, "title", {}, `${momentText(time, to - from, this.voyage.begin_utc_s)} ${text}`);
      this.marks.push({ px, time, text, bad });
    }
  }

  // Shows the values at the cursor, or the last ones, next to the line names.
  read() {
    const { times } = this;
    const at = this.cursor === null ? times.length - 1 : nearest(times, this.cursor);
    const px = this.cursor === null ? -9 : this.x(this.cursor);
    this.line.setAttribute("x1", px);
    this.line.setAttribute("x2", px);
    for (const legend of this.legends) {
      const words = legend.texts.map(({ line }) => {
        const value = this.voyage.columns[line.column][at];
        return [line.label, legend.wrap ? compassText(value, 1) : formatNumber(value, legend.step)];
      });
      const isSingle = words.length === 1, place = (texts) => {
        let right = LEFT + legend.title.getComputedTextLength() + 12;
        legend.texts.forEach(({ label }, i) => {
          label.textContent = texts[i];
          label.setAttribute("x", right);
          right += label.getComputedTextLength() + 12;
        });
        return right <= this.width + 12;
      };
      // Without space for both, names are shown, and values while the pointer is over the plot.
      if (!place(words.map(([name, value]) => (isSingle ? value : `${name} ${value}`)))) {
        place(words.map(([name, value]) => (this.cursor === null ? name : value)));
      }
    }
    const nearMark = this.cursor === null ? null : this.marks.reduce((best, mark) => (
      Math.abs(mark.px - px) <= (best ? Math.abs(best.px - px) : 8) ? mark : best), null);
    const [from, to] = this.extent();
    const moment = at < 0 ? "" : momentText(times[at], Math.min(to - from, 599), this.voyage.begin_utc_s);
    this.readout.textContent = nearMark ? `${moment}: ${nearMark.text}` : this.cursor === null ? "" : moment;
    this.readout.className = nearMark && nearMark.bad ? "readout bad" : "readout";
  }

  point(time) {
    this.cursor = time;
    this.read();
    this.notify(time, this.extent());
  }

  listen() {
    const place = (event) => (event.clientX - this.svg.getBoundingClientRect().left)
      * this.width / this.svg.getBoundingClientRect().width;
    let start = null;
    this.svg.addEventListener("pointerdown", (event) => { start = place(event); });
    this.svg.addEventListener("pointermove", (event) => {
      const px = clamp(place(event), LEFT, this.width - RIGHT);
      this.point(this.when(px));
      if (start === null || !event.buttons) return;
      this.selection.setAttribute("x", Math.min(start, px));
      this.selection.setAttribute("width", Math.abs(px - start));
    });
    const end = (event) => {
      const px = clamp(place(event), LEFT, this.width - RIGHT);
      this.selection.setAttribute("width", 0);
      if (start !== null && event.type === "pointerup" && Math.abs(px - start) > 12) {
        this.setRange([this.when(Math.min(start, px)), this.when(Math.max(start, px))]);
      }
      start = null;
    };
    for (const name of ["pointerup", "pointercancel"]) this.svg.addEventListener(name, end);
    this.svg.addEventListener("pointerleave", () => { start = null; this.selection.setAttribute("width", 0); this.point(null); });
    this.svg.addEventListener("dblclick", () => this.setRange(null));
  }
}

function nearest(times, time) {
  const after = clamp(firstIndexFrom(times, time), 0, times.length - 1);
  return after > 0 && time - times[after - 1] < times[after] - time ? after - 1 : after;
}

function limits(panel, columns, first, last) {
  const values = [];
  for (const column of columns) for (let i = first; i < last; i += 1) if (isKnown(column[i])) values.push(column[i]);
  if (panel.band) {
    const sizes = values.map(Math.abs).sort((a, b) => a - b);
    const largest = sizes.length ? sizes[sizes.length - 1] : 0;
    const reach = Math.max(2 * panel.band, Math.min(1.1 * largest, 5 * (sizes[Math.floor(sizes.length * 0.6)] || 0)));
    return [-reach, reach];
  }
  let low = Infinity, high = -Infinity;
  for (const value of values) { if (value < low) low = value; if (value > high) high = value; }
  if (!values.length) [low, high] = [0, 1];
  if (panel.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
  const span = Math.max(panel.min_span, 0.01 * Math.max(Math.abs(low), Math.abs(high)), 1e-6); // also for a constant
  const missing = Math.max(0, span - (high - low)) / 2, margin = 0.06 * Math.max(high - low, span);
  const foot = panel.zero && low === 0 ? 0 : missing + margin;
  return [low - foot, high + (foot ? missing : 2 * missing) + margin];
}
