"use strict";
// Shared by all plots: SVG elements, scales, ticks, number formats.

const SVG = "http://www.w3.org/2000/svg";

function draw(parent, name, attributes = {}, text = null) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  if (parent) parent.appendChild(made);
  return made;
}

function html(parent, name, attributes = {}, text = null) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  if (parent) parent.appendChild(made);
  return made;
}

const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
const known = (value) => value !== null && value !== undefined;

// A tick step of 1, 2 or 5 times a power of ten, or of a table, for at most the given number of ticks.
function niceStep(span, most, table = null) {
  const rough = Math.max(span, 1e-12) / Math.max(1, most);
  if (table) for (const step of table) if (step >= rough) return step;
  const power = 10 ** Math.floor(Math.log10(rough));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= rough * 0.999) return factor * power;
  return 10 * power;
}

function ticks(low, high, step) {
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9) * step; at <= high + step * 1e-9; at += step) found.push(at);
  return found;
}

function shown(value, step) {
  if (!known(value)) return "–";
  const digits = clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 6);
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text;
}

// A direction from 0 to below 360 degrees, also after rounding.
const compassText = (value, digits) => (known(value) ? ((Number(value.toFixed(digits)) % 360 + 360) % 360).toFixed(digits) : "–");

const TIMES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];

// A time of a voyage: seconds, hours and minutes, or the calendar time if known.
function momentText(time, span, begin) {
  if (known(begin)) {
    const text = new Date((begin + time) * 1000).toISOString();
    if (span > 3 * 86400) return text.slice(5, 10);
    return span > 43200 ? text.slice(5, 16).replace("T", " ") : text.slice(11, span > 600 ? 16 : 19);
  }
  if (span <= 7200) return `${shown(time, span > 20 ? 1 : 0.1)} s`;
  const minutes = Math.round(time / 60);
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")} h`;
}

// The angle at which the compass axis is cut so that few lines cross it: the middle of the widest gap, or the emptiest.
function cutOf(columns) {
  const bins = new Array(72).fill(0);
  for (const values of columns) for (const value of values) if (known(value)) {
    bins[((Math.floor(value / 5) % 72) + 72) % 72] += 1;
  }
  const lowest = Math.min(...bins);
  let best = 0, longest = 0, run = 0;
  for (let i = 0; i < 144; i += 1) {
    run = bins[i % 72] === lowest ? run + 1 : 0;
    if (run > longest && run <= 72) { longest = run; best = i - run / 2 + 0.5; }
  }
  return longest ? (best * 5) % 360 : 0;
}

const wrapped = (value, cut) => known(value) ? cut + ((((value - cut) % 360) + 360) % 360) : null;

function firstAfter(times, time) {
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] < time) low = middle + 1; else high = middle; }
  return low;
}

// The path of a line: first, lowest, highest and last value of each pixel column, so that no peak is lost.
function pathOf(times, values, first, last, x, y, jump, step) {
  const parts = [];
  let pen = false, before = null, column = null, low = null, high = null;
  const point = (i, join) => parts.push(`${join}${x(times[i]).toFixed(1)} ${y(values[i]).toFixed(1)}`);
  const flush = () => {
    if (column === null) return;
    for (const i of [...new Set([low, high])].sort((a, b) => a - b)) {
      if (pen && step) parts.push(`H${x(times[i]).toFixed(1)}`);
      point(i, pen ? "L" : "M");
      pen = true;
    }
    column = null;
  };
  for (let i = first; i < last; i += 1) {
    const value = values[i];
    if (!known(value) || (before !== null && jump && Math.abs(value - values[before]) > jump)) {
      flush();
      pen = false;
    }
    before = known(value) ? i : null;
    if (before === null) continue;
    const dot = Math.floor(x(times[i]));
    if (dot !== column) { flush(); column = dot; low = high = i; }
    if (value < values[low]) low = i;
    if (value > values[high]) high = i;
  }
  flush();
  return parts.join("");
}
