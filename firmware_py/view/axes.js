"use strict";
// Shared by all plots: SVG elements, scales, ticks, number formats.

const SVG = "http://www.w3.org/2000/svg";

function addSvg(parent, name, attributes = {}, text = null) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  if (parent) parent.appendChild(element);
  return element;
}

function addHtml(parent, name, attributes = {}, text = null) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  if (parent) parent.appendChild(element);
  return element;
}

const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
const isKnown = (value) => value !== null && value !== undefined;

// A tick step of 1, 2 or 5 times a power of ten, or of a table, for at most the given number of ticks.
function niceStep(span, maxTicks, table = null) {
  const minStep = Math.max(span, 1e-12) / Math.max(1, maxTicks);
  if (table) for (const step of table) if (step >= minStep) return step;
  const power = 10 ** Math.floor(Math.log10(minStep));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= minStep * 0.999) return factor * power;
  return 10 * power;
}

function ticks(low, high, step) {
  const positions = [];
  for (let at = Math.ceil(low / step - 1e-9) * step; at <= high + step * 1e-9; at += step) positions.push(at);
  return positions;
}

function formatNumber(value, step) {
  if (!isKnown(value)) return "–";
  const digits = clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 6);
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text;
}

// A direction from 0 to below 360 degrees, also after rounding.
const compassText = (value, digits) => (isKnown(value) ? ((Number(value.toFixed(digits)) % 360 + 360) % 360).toFixed(digits) : "–");

const TIMES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];

// A time of a voyage: seconds, hours and minutes, or the calendar time if known.
function momentText(time, span, begin) {
  if (isKnown(begin)) {
    const text = new Date((begin + time) * 1000).toISOString();
    if (span > 3 * 86400) return text.slice(5, 10);
    return span > 43200 ? text.slice(5, 16).replace("T", " ") : text.slice(11, span > 600 ? 16 : 19);
  }
  if (span <= 7200) return `${formatNumber(time, span > 20 ? 1 : 0.1)} s`;
  const minutes = Math.round(time / 60);
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")} h`;
}

// Angle at which the compass axis is cut: the middle of the widest range with the fewest values, so that few lines cross it.
function findCutAngle(columns) {
  const bins = new Array(72).fill(0);
  for (const values of columns) for (const value of values) if (isKnown(value)) {
    bins[((Math.floor(value / 5) % 72) + 72) % 72] += 1;
  }
  const minCount = Math.min(...bins);
  let centre = 0, maxRun = 0, run = 0;
  for (let i = 0; i < 144; i += 1) {
    run = bins[i % 72] === minCount ? run + 1 : 0;
    if (run > maxRun && run <= 72) { maxRun = run; centre = i - run / 2 + 0.5; }
  }
  return maxRun ? (centre * 5) % 360 : 0;
}

const wrapAngle = (value, cut) => isKnown(value) ? cut + ((((value - cut) % 360) + 360) % 360) : null;

function firstIndexFrom(times, time) {
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] < time) low = middle + 1; else high = middle; }
  return low;
}

// Path of a line through the lowest and the highest value of each pixel column, so that no peak is lost.
// `jump`: difference of values at which the line is interrupted; `step`: a value is constant until the next one.
function linePath(times, values, first, last, x, y, jump, step) {
  const parts = [];
  let pen = false, previous = null, column = null, low = null, high = null;
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
    if (!isKnown(value) || (previous !== null && jump && Math.abs(value - values[previous]) > jump)) {
      flush();
      pen = false;
    }
    previous = isKnown(value) ? i : null;
    if (previous === null) continue;
    const pixel = Math.floor(x(times[i]));
    if (pixel !== column) { flush(); column = pixel; low = high = i; }
    if (value < values[low]) low = i;
    if (value > values[high]) high = i;
  }
  flush();
  return parts.join("");
}
