"use strict";
// The page under way: what is so now, the plots as they grow, and a word when nothing comes any more.

const DEGREES = (value, digits = 1) => (known(value) ? `${value.toFixed(digits)}°` : "–");
const BESIDE = ["rudder", "position", "navigation", "estimate", "energy", "power", "traffic", "loop"];
const SHOWN = 12; // texts
const AGAIN_MS = 5000; // after an answer that is none, such as that there are too many readers

class Live {
  constructor(place) {
    this.title = document.querySelector("h1");
    this.banner = html(place, "p", { class: "banner", role: "status" }, "Waiting for the first words.");
    this.cards = html(place, "dl", { class: "now" });
    this.plots = html(place, "div");
    this.parts = html(place, "div", { class: "parts" });
    this.view = null;
    this.heard = 0;
    this.waiting = false;
    this.connect();
    setInterval(() => this.tellAge(), 1000);
  }

  connect() {
    const source = new EventSource("events");
    source.addEventListener("whole", (event) => this.take(JSON.parse(event.data), true));
    source.addEventListener("new", (event) => this.take(JSON.parse(event.data), false));
    source.addEventListener("end", () => { source.close(); this.over = true; this.tellAge(); });
    source.addEventListener("error", () => {
      this.lost = this.lost || Date.now();
      if (source.readyState === EventSource.CLOSED) setTimeout(() => this.connect(), AGAIN_MS); // else it does so itself
      this.tellAge();
    });
  }

  take(told, whole) {
    this.lost = 0;
    this.heard = Date.now();
    if (whole) {
      this.names = told.names;
      this.voyage = { columns: Object.fromEntries(told.names.map((name) => [name, []])), panels: told.panels, marks: [] };
      this.now = {};
    }
    for (const row of told.rows) this.names.forEach((name, i) => this.voyage.columns[name].push(row[i]));
    this.voyage.marks.push(...told.marks);
    this.now = { ...this.now, ...told.now };
    const newest = told.values || told.rows[told.rows.length - 1];
    this.values = newest ? Object.fromEntries(this.names.map((name, i) => [name, newest[i]])) : {};
    if (!this.waiting) { // as often as somebody looks, and not while nobody does
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.draw(); });
    }
  }

  draw() {
    const { now, voyage, values } = this, status = now.status || {};
    if (now.title) { this.title.textContent = now.title; document.title = `${DEGREES(values.heading_deg, 0)} ${now.title}`; }
    Object.assign(voyage, { plans: now.plans, item: now.item, first_item: now.first_item, target: now.target, begin_utc_s: now.begin_utc_s,
      vessels: vesselsOf(status, values) });
    if (!voyage.columns.lat_deg.some(known)) delete voyage.columns.lat_deg;
    const hasTrack = Boolean(voyage.columns.lat_deg);
    if (voyage.columns.time_s.length && (!this.view || this.hadTrack !== hasTrack)) {
      this.plots.replaceChildren();
      this.view = new VoyageView(html(this.plots, "div"), voyage);
      this.hadTrack = hasTrack;
    } else if (this.view) this.view.set(voyage);
    if (!voyage.columns.lat_deg) voyage.columns.lat_deg = voyage.columns.time_s.map(() => null);
    this.drawCards(status, values);
    this.drawParts(status);
    this.tellAge();
  }

  drawCards(status, values) {
    const place = status.position || {}, way = status.navigation || {};
    const heading = values.true_heading_deg ?? values.heading_deg ?? values.compass_deg;
    const turn = known(heading) ? ((heading % 360) + 360) % 360 : null;
    const cards = [
      ["heading", DEGREES(turn), known(values.true_heading_deg) ? `estimated ${DEGREES(values.heading_deg)}` : ""],
      ["goal", DEGREES(values.goal_deg), `off by ${DEGREES(values.error_deg)}`],
      ["rudder", DEGREES(values.rudder_deg), `commanded ${DEGREES(values.command_deg)}`],
      ["mode", status.mode || "–", status.mode ? (status.armed ? "armed" : "disarmed") : ""],
      ["over ground", known(place.sog_m_s) ? `${place.sog_m_s.toFixed(2)} m/s` : "–", `course ${DEGREES(place.cog_deg, 0)}`],
      ["ahead", known(way.distance_m) ? `${way.distance_m.toFixed(0)} m` : "–",
        known(way.item) ? `item ${way.item} of ${way.items}` : (way.activity || "").toLowerCase()],
      ["faults", status.faults ? String(status.faults.length) : "–", ((status.faults || [])[0] || {}).text || ""],
    ];
    this.cards.replaceChildren();
    this.cards.dataset.time = values.time_s;
    for (const [name, value, note] of cards) {
      const card = html(this.cards, "div");
      html(card, "dt", {}, name);
      html(card, "strong", { id: `now-${name.replace(" ", "-")}`, class: name === "faults" && value > "0" ? "bad" : "" }, value);
      html(card, "small", {}, note);
    }
  }

  drawParts(status) {
    this.parts.replaceChildren();
    const table = (title, rows) => {
      if (!rows.length) return;
      const card = html(this.parts, "div", { class: "card" });
      html(html(card, "header"), "span", {}, title);
      const body = html(card, "table");
      for (const [name, value, bad] of rows) {
        const row = html(body, "tr");
        html(row, "td", {}, name);
        html(row, "td", { class: bad ? "words bad" : "words" }, value);
      }
    };
    const since = (seconds) => (known(seconds) ? (seconds < 120 ? `${seconds.toFixed(0)} s` : `${(seconds / 60).toFixed(0)} min`) : "?");
    table("Faults", (status.faults || []).map((one) => [`${one.fault}, ${since(one.since_s)}`, one.text, true]));
    const [from, to] = this.view ? this.view.panels.extent() : [0, 1];
    table("What she said", this.voyage.marks.slice(-SHOWN).reverse().map(([time, severity, text]) => [
      momentText(time, Math.min(to - from, 599), this.voyage.begin_utc_s), text, severity <= SEVERE]));
    table("Devices", (status.devices || []).map((one) => [one.device, `${one.state}${known(one.rate_hz) ? `, ${one.rate_hz} Hz` : ""}`
      + `, ${one.rejected} bad${one.error ? `; ${one.error}` : ""}`, one.state !== "running"]));
    table("Links", (status.links || []).map((one) => [one.url, (one.peers.length ? one.peers.map((peer) => `${peer.address}, heard `
      + `${known(peer.heard_age_s) ? `${peer.heard_age_s} s ago` : "never"}`).join("; ") : "nobody")
      + (one.hindrance ? `; nothing leaves: ${one.hindrance}` : ""), Boolean(one.hindrance)]));
    table("Vessels", ((status.traffic || {}).nearest || []).map((one) => [one.title || String(one.mmsi),
      `${shown(one.distance_m, 1)} m, ${shown(one.bearing_deg, 1)}°, heard ${since(one.age_s)} ago`
      + (known(one.cpa_m) ? `; ${shown(one.cpa_m, 1)} m in ${since(one.cpa_in_s)}` : ""), one.near]));
    for (const name of BESIDE) {
      const part = status[name];
      if (part) table(name, Object.entries(part).filter(([, value]) => known(value) && typeof value !== "object" && value !== "")
        .map(([key, value]) => [key.replaceAll("_", " "), String(value), false]));
    }
  }

  tellAge() {
    const now = this.now || {}, age = Math.round((Date.now() - this.heard) / 1000);
    let text = "";
    if (this.over) text = "It has ended; this is what was seen of it.";
    else if (this.lost) text = `No connection for ${Math.round((Date.now() - this.lost) / 1000)} s; this is what was seen before.`;
    else if (now.freshness && now.freshness !== "running") text = `The autopilot says nothing: ${now.reason || now.freshness}.`;
    else if (!this.heard) text = "Waiting for the first words.";
    else if (age > 10) text = `Nothing new for ${age} s.`;
    this.banner.textContent = text;
    this.banner.hidden = !text;
  }
}

// Who is near, as the boat tells it: so far away and in that direction from where she is.
function vesselsOf(status, values) {
  const told = ((status.traffic || {}).nearest || []).filter((one) => known(one.distance_m) && known(one.bearing_deg));
  if (!known(values.lat_deg)) return [];
  return told.map((one) => {
    const angle = one.bearing_deg * Math.PI / 180, turn = 180 / Math.PI / EARTH_M;
    return { name: one.title || String(one.mmsi), course_deg: one.cog_deg,
      lat_deg: values.lat_deg + one.distance_m * Math.cos(angle) * turn,
      lon_deg: values.lon_deg + one.distance_m * Math.sin(angle) * turn / Math.cos(values.lat_deg * Math.PI / 180) };
  });
}

for (const place of document.querySelectorAll("#live")) new Live(place);
