"use strict";
// Live page: values with their ages, faults, growing plots, and a notice without new data.

const SECTIONS = { rudder: "Rudder", position: "Position", navigation: "Navigation", estimate: "Estimate", energy: "Rudder energy",
  power: "Battery and panels", wind: "Wind", depth: "Water depth", traffic: "Traffic", loop: "Control loop" };
const UNITS = Object.entries({ _deg2_s: "deg²/s", _deg_per_h: "deg/h", _per_h: "per hour", _deg_s: "deg/s", _m_s: "m/s", _deg: "deg",
  _percent: "%", _hz: "Hz", _ms: "ms", _wh: "Wh", _w: "W", _v: "V", _a: "A", _c: "°C", _m: "m", _s: "s" });
const WORDS = { ok: "valid", sog: "speed over ground", cog: "course over ground", lat: "latitude", lon: "longitude", reckoned: "dead reckoning",
  sd: "standard deviation", softness: "gain reduction" };
const MAX_EVENTS = 12;
const RETRY_MS = 5000; // retry after a refused connection, such as too many readers

class Live {
  constructor(place) {
    this.place = place;
    this.title = document.querySelector("h1");
    this.banner = addHtml(place, "p", { class: "banner", role: "status" }, "Waiting for the first report.");
    this.cards = addHtml(place, "dl", { class: "now" });
    this.faults = addHtml(place, "div", { class: "faults" });
    this.plots = addHtml(place, "div");
    this.parts = addHtml(place, "div", { class: "parts" });
    this.view = null;
    this.receivedAt = 0;
    this.waiting = false;
    this.connect();
    setInterval(() => this.showAge(), 1000);
  }

  connect() {
    const source = new EventSource("events");
    source.addEventListener("whole", (event) => this.receive(JSON.parse(event.data), true));
    source.addEventListener("new", (event) => this.receive(JSON.parse(event.data), false));
    source.addEventListener("end", () => { source.close(); this.hasEnded = true; this.showAge(); });
    source.addEventListener("error", () => {
      this.lostAt = this.lostAt || Date.now();
      if (source.readyState === EventSource.CLOSED) setTimeout(() => this.connect(), RETRY_MS); // otherwise EventSource reconnects
      this.showAge();
    });
  }

  receive(update, whole) {
    this.lostAt = 0;
    if (isKnown(update.now.age_s) || !this.receivedAt) this.receivedAt = Date.now() - 1000 * (update.now.age_s || 0);
    if (whole) {
      this.names = update.names;
      this.voyage = { columns: Object.fromEntries(update.names.map((name) => [name, []])), panels: update.panels, marks: [] };
      this.now = {};
    }
    for (const row of update.rows) this.names.forEach((name, i) => this.voyage.columns[name].push(row[i]));
    this.voyage.marks.push(...update.marks);
    this.now = { ...this.now, ...update.now };
    const newest = update.values || update.rows[update.rows.length - 1];
    this.values = newest ? Object.fromEntries(this.names.map((name, i) => [name, newest[i]])) : {};
    if (!this.waiting) { // once per frame, not in a hidden tab
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.draw(); });
    }
  }

  draw() {
    const { now, voyage, values } = this, status = now.status || {};
    if (now.title) { this.title.textContent = now.title; document.title = `${direction(values.heading_deg, 0)} ${now.title}`; }
    Object.assign(voyage, { plans: now.plans, item: now.item, first_item: now.first_item, target: now.target, begin_utc_s: now.begin_utc_s,
      vessels: vesselsOf(status, values) });
    if (!voyage.columns.lat_deg.some(isKnown)) delete voyage.columns.lat_deg;
    const hasTrack = Boolean(voyage.columns.lat_deg);
    if (voyage.columns.time_s.length && (!this.view || this.hadTrack !== hasTrack)) {
      this.plots.replaceChildren();
      this.view = new VoyageView(addHtml(this.plots, "div"), voyage);
      this.hadTrack = hasTrack;
    } else if (this.view) this.view.set(voyage);
    if (!voyage.columns.lat_deg) voyage.columns.lat_deg = voyage.columns.time_s.map(() => null);
    this.drawCards(status, values);
    this.drawFaults(status);
    this.drawParts(status);
    this.showAge();
  }

  drawCards(status, values) {
    const position = status.position || {}, navigation = status.navigation || {}, rudder = status.rudder || {};
    const faults = status.faults || [], unacknowledged = faults.filter((fault) => !isAcknowledged(status, fault));
    const own = (status.estimate || {}).heading_deg ?? status.heading_deg;
    const heading = [direction(own), "", status.heading_age_s, status.heading_ok === false];
    const cards = [
      ...(isKnown(values.true_heading_deg) ? [["heading", "true heading", direction(values.true_heading_deg), "simulated boat"],
        ["estimated-heading", "estimated heading", ...heading]] : [["heading", "heading", ...heading]]),
      ["goal", "goal", direction(status.goal_deg),
        status.heading_ok === false || !isKnown(status.error_deg) ? "" : `error ${formatNumber(-status.error_deg, 0.1)}°`],
      ["rudder", "rudder", isKnown(rudder.angle_deg ?? rudder.estimated_deg) ? `${formatNumber(rudder.angle_deg ?? rudder.estimated_deg, 0.1)}°` : "–",
        [isKnown(rudder.estimated_deg) ? "estimated" : "", isKnown(rudder.command_deg) ? `commanded ${formatNumber(rudder.command_deg, 0.1)}°` : ""]
          .filter(Boolean).join(", "), rudder.age_s, rudder.ok === false],
      ["mode", "mode", status.mode || "–", status.mode ? (status.armed ? "armed" : "disarmed") : ""],
      ["over-ground", "over ground", isKnown(position.sog_m_s) ? `${position.sog_m_s.toFixed(2)} m/s` : "–",
        isKnown(position.cog_deg) ? `course ${direction(position.cog_deg, 0)}` : "", position.age_s, position.ok === false],
      ["ahead", "ahead", isKnown(navigation.distance_m) ? `${navigation.distance_m.toFixed(0)} m` : "–",
        isKnown(navigation.item) ? `item ${navigation.item} of ${navigation.items}` : inWords(navigation.activity || ""), position.age_s, position.ok === false],
      ["faults", "faults", status.faults ? String(faults.length) : "–", unacknowledged.map((fault) => fault.text).join("; ")
        || (faults.length ? "acknowledged" : "")],
    ];
    this.cards.replaceChildren();
    this.cards.dataset.time = values.time_s;
    for (const [id, name, value, note, age, stale] of cards) {
      const card = addHtml(this.cards, "div", { class: stale && value !== "–" ? "stale" : "" });
      addHtml(card, "dt", {}, name);
      addHtml(card, "strong", { id: `now-${id}`, class: id === "faults" && unacknowledged.length ? "bad" : "" }, value);
      addHtml(card, "small", {}, note);
      if (value !== "–" && status.mode) addHtml(card, "small", { class: "age", "data-age": age ?? 0 });
    }
  }

  // Rebuilt only when the list changes, so that a press on a button is not lost.
  drawFaults(status) {
    const faults = status.faults || [];
    const key = JSON.stringify(faults.map((fault) => [fault.fault, isAcknowledged(status, fault)]));
    if (key !== this.faultsKey) {
      this.faultsKey = key;
      this.faults.replaceChildren();
      const body = faults.length ? tableCard(this.faults, "Active faults") : null;
      for (const fault of faults) {
        const isSeen = isAcknowledged(status, fault), row = addHtml(body, "tr");
        addHtml(row, "td", { "data-since": fault.fault });
        const cell = addHtml(row, "td", { class: isSeen ? "words" : "words bad" }, `${fault.text} (${fault.severity})`);
        addHtml(cell, "small", {}, fault.remedy ? `What to do: ${fault.remedy}` : "");
        const button = addHtml(addHtml(row, "td"), "button", { type: "button" }, isSeen ? "acknowledged" : "Acknowledge");
        button.disabled = isSeen;
        button.addEventListener("click", () => { acknowledge(status, fault); this.draw(); });
      }
    }
    for (const fault of faults) {
      const cell = this.faults.querySelector(`[data-since="${CSS.escape(fault.fault)}"]`);
      if (cell) cell.textContent = `for ${durationText(fault.since_s)}`;
    }
  }

  drawParts(status) {
    this.parts.replaceChildren();
    const table = (title, rows, age, stale) => {
      if (!rows.length) return;
      const body = tableCard(this.parts, title, stale, age);
      for (const [name, value, bad] of rows) {
        const row = addHtml(body, "tr");
        addHtml(row, "td", {}, name);
        addHtml(row, "td", { class: bad ? "words bad" : "words" }, value);
      }
    };
    const [from, to] = this.view ? this.view.panels.extent() : [0, 1];
    table("Events", this.voyage.marks.slice(-MAX_EVENTS).reverse().map(([time, severity, text]) => [
      momentText(time, Math.min(to - from, 599), this.voyage.begin_utc_s), text, isFailure(severity, text)]));
    const devices = status.devices || [];
    table("Devices", devices.map((device) => [inWords(device.device), [inWords(device.state), isKnown(device.rate_hz) ? `${device.rate_hz} Hz` : "",
      isKnown(device.age_s) ? `last message ${durationText(device.age_s)} ago` : "", `${device.rejected} rejected`, device.error].filter(Boolean).join(", "),
    device.state !== "running"]));
    table("Links", (status.links || []).map((one) => [one.url, (one.peers.length ? one.peers.map((peer) => `${peer.address}, `
      + `${isKnown(peer.heard_age_s) ? `last message ${durationText(peer.heard_age_s)} ago` : "nothing received"}`).join("; ") : "no peer")
      + (one.hindrance ? `; sending blocked: ${one.hindrance}` : ""), Boolean(one.hindrance)]));
    table("Vessels", ((status.traffic || {}).nearest || []).map((vessel) => [vessel.title || String(vessel.mmsi),
      `${formatNumber(vessel.distance_m, 1)} m, ${direction(vessel.bearing_deg, 0)}, report ${durationText(vessel.age_s)} ago`
      + (isKnown(vessel.cpa_m) ? `; closest approach ${formatNumber(vessel.cpa_m, 1)} m in ${durationText(vessel.cpa_in_s)}` : ""), vessel.near]));
    const power = devices.filter((device) => device.device.startsWith("power"));
    const measured = { position: status.position, rudder: status.rudder, energy: status.rudder, wind: status.wind, depth: status.depth,
      estimate: { age_s: status.heading_age_s, ok: status.heading_ok },
      power: power.length ? { age_s: Math.min(...power.map((device) => device.age_s ?? Infinity)), ok: power.some((device) => device.state === "running") } : null };
    for (const [name, title] of Object.entries(SECTIONS)) {
      const { age_s: age, ok } = measured[name] || {};
      table(title, Object.entries(status[name] || {}).filter(([key, value]) => isKnown(value) && typeof value !== "object" && value !== ""
        && key !== "age_s").map(([key, value]) => labelAndValue(key, value)), age ?? 0, ok === false);
    }
  }

  // Updates the ages and the notice without new data.
  showAge() {
    const now = this.now || {}, seconds = Math.round((Date.now() - this.receivedAt) / 1000);
    let text = "";
    if (this.hasEnded) text = "The run has ended; last values shown.";
    else if (this.lostAt) text = `No connection for ${Math.round((Date.now() - this.lostAt) / 1000)} s; last values shown.`;
    else if (now.freshness && now.freshness !== "running") text = `No report from the autopilot for ${Math.max(0, seconds)} s: ${now.reason || now.freshness}.`;
    else if (!this.receivedAt) text = "Waiting for the first report.";
    else if (seconds > 10) text = `No new report for ${seconds} s.`;
    this.banner.textContent = text;
    this.banner.hidden = !text;
    this.place.classList.toggle("stale", Boolean(text));
    for (const element of this.place.querySelectorAll("[data-age]")) {
      element.textContent = `${durationText(Number(element.dataset.age) + Math.max(0, seconds))} old`;
    }
  }
}

const direction = (value, digits = 1) => (isKnown(value) ? `${compassText(value, digits)}°` : "–");
const inWords = (text) => String(text).toLowerCase().replaceAll("_", " ");

function durationText(seconds) {
  if (!isKnown(seconds) || !Number.isFinite(seconds)) return "unknown time";
  const rounded = Math.max(0, Math.round(seconds));
  return rounded < 120 ? `${rounded} s` : rounded < 7200 ? `${Math.round(rounded / 60)} min` : `${Math.round(rounded / 3600)} h`;
}

// The label in words, the value with its unit, of an entry of the status such as sog_m_s.
function labelAndValue(key, value) {
  const [end, unit] = UNITS.find(([suffix]) => key.endsWith(suffix)) || ["", ""];
  const words = key.slice(0, key.length - end.length).split("_").map((word) => WORDS[word] || word).join(" ");
  if (typeof value === "boolean") return [words, value ? "yes" : "no"];
  return [words, typeof value === "string" ? inWords(value) : `${value}${unit && ` ${unit}`}`];
}

function tableCard(place, title, stale = false, age = null) {
  const card = addHtml(place, "div", { class: stale ? "card stale" : "card" }), header = addHtml(card, "header");
  addHtml(header, "span", {}, title);
  if (age !== null) addHtml(header, "span", { class: "age", "data-age": age });
  return addHtml(card, "table");
}

// Faults that the reader of this browser has acknowledged: when each began, in the autopilot's own time.
const ACKNOWLEDGED = "rambler-acknowledged";
const startOf = (status, fault) => [status.pid, isKnown(fault.since_s) ? status.uptime_s - fault.since_s : 0];
let acknowledged = {};
try { acknowledged = JSON.parse(localStorage.getItem(ACKNOWLEDGED)) || {}; } catch { /* none stored */ }

function isAcknowledged(status, fault) {
  const [pid, began] = acknowledged[fault.fault] || [], [pidNow, beganNow] = startOf(status, fault);
  return pid === pidNow && Math.abs(began - beganNow) < 1;
}

function acknowledge(status, fault) {
  acknowledged[fault.fault] = startOf(status, fault);
  try { localStorage.setItem(ACKNOWLEDGED, JSON.stringify(acknowledged)); } catch { /* until the page is closed */ }
}

// Nearby vessels, placed by distance and bearing from the boat.
function vesselsOf(status, values) {
  const near = ((status.traffic || {}).nearest || []).filter((vessel) => isKnown(vessel.distance_m) && isKnown(vessel.bearing_deg));
  if (!isKnown(values.lat_deg)) return [];
  return near.map((vessel) => {
    const angle = vessel.bearing_deg * Math.PI / 180, turn = 180 / Math.PI / EARTH_M;
    return { name: vessel.title || String(vessel.mmsi), course_deg: vessel.cog_deg,
      lat_deg: values.lat_deg + vessel.distance_m * Math.cos(angle) * turn,
      lon_deg: values.lon_deg + vessel.distance_m * Math.sin(angle) * turn / Math.cos(values.lat_deg * Math.PI / 180) };
  });
}

for (const place of document.querySelectorAll("#live")) new Live(place);
