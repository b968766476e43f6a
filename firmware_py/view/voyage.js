"use strict";
// Replaces the data block of each voyage by its plots, and links them.

class VoyageView {
  constructor(place, voyage) {
    const grid = addHtml(null, "div", { class: "voyage" });
    place.replaceWith(grid);
    const left = addHtml(addHtml(grid, "div"), "div", { class: "card" });
    const right = addHtml(grid, "div");
    this.track = null;
    this.panels = new TimePanels(left, voyage, (cursor, span) => this.track && this.track.follow(cursor, span));
    const { columns } = voyage;
    if (columns.lat_deg || columns.north_m) {
      this.track = new Track(addHtml(right, "div", { class: "card" }), voyage);
    }
    if (voyage.spectrum) {
      const card = addHtml(right, "div", { class: "card" });
      this.spectrum = () => { card.replaceChildren(); drawSpectrum(card, voyage.spectrum); };
      this.spectrum();
    }
    if (!right.childNodes.length) grid.style.gridTemplateColumns = "minmax(0, 1fr)";
    let waiting = 0;
    window.addEventListener("resize", () => {
      cancelAnimationFrame(waiting);
      waiting = requestAnimationFrame(() => this.draw());
    });
  }

  draw() {
    this.panels.draw();
    if (this.track) this.track.draw();
    if (this.spectrum) this.spectrum();
  }

  set(voyage) {
    this.panels.set(voyage);
    if (this.track) this.track.set(voyage);
  }
}

for (const [number, data] of document.querySelectorAll("script.voyage").entries()) {
  const view = new VoyageView(data, JSON.parse(data.textContent));
  // A row of the event table moves the cursor of the first plots to its time.
  for (const row of number ? [] : document.querySelectorAll("tr[data-time]")) {
    row.tabIndex = 0;
    const show = () => {
      view.panels.point(Number(row.dataset.time));
      view.panels.svg.scrollIntoView({ behavior: "smooth", block: "nearest" });
    };
    row.addEventListener("click", show);
    row.addEventListener("keydown", (event) => { if (event.key === "Enter") show(); });
  }
}
