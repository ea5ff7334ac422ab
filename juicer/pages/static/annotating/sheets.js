// Images of steps, by sheets of a few steps each; drawn by the server, kept by the browser.

const MOST_SHEETS = 20;
const AGAIN_MS = 5000;

export class Sheets {
  /** @param layout width, height, steps and views of a sheet; `arrived` is called when one is there or has failed. */
  constructor(address, layout, arrived) {
    this.address = address;
    this.layout = layout;
    this.arrived = arrived;
    this.sheets = new Map();
  }

  /** The sheet that a step is on; asked for if it is not there yet, and again only some time after it has failed. */
  sheet(episode, step) {
    const first = step - (step % this.layout.steps);
    const path = `/${episode.id}/${first}.jpg`;
    let sheet = this.sheets.get(path);
    if (!sheet || (sheet.failed && performance.now() > sheet.failed + AGAIN_MS)) {
      sheet = { image: new Image(), path, first, ready: false, failed: 0 };
      this.sheets.set(path, sheet);
      sheet.image.onload = () => this.arrived(sheet, (sheet.ready = true));
      sheet.image.onerror = () => this.arrived(sheet, (sheet.failed = performance.now()));
      sheet.image.src = this.address + path;
      for (const old of [...this.sheets.keys()].slice(0, Math.max(0, this.sheets.size - MOST_SHEETS))) this.sheets.delete(old);
    }
    return sheet;
  }

  /** Ask for the steps around one. */
  prefetch(episode, step, around) {
    for (let at = Math.max(0, step - around); ; at = Math.min(at + this.layout.steps, step + around)) {
      if (at >= episode.steps) return;
      this.sheet(episode, at);
      if (at === step + around) return;
    }
  }

  /** Whether the steps around one are all there. */
  has(episode, step, around) {
    const from = Math.max(0, step - around);
    const to = Math.min(episode.steps - 1, step + around);
    for (let at = from - (from % this.layout.steps); at <= to; at += this.layout.steps) {
      if (!this.sheet(episode, at).ready) return false;
    }
    return true;
  }

  /** Draw one view of one step; an empty place until it is there. */
  draw(context, episode, step, view, x, y, width, height) {
    if (step < 0 || step >= episode.steps) return;
    const sheet = this.sheet(episode, step);
    if (!sheet.ready) return;
    const { width: w, height: h, views } = this.layout;
    context.drawImage(sheet.image, (step - sheet.first) * w, views.indexOf(view) * h, w, h, x, y, width, height);
  }
}

/** A canvas's context in units of CSS pixels, cleared. */
export function prepared(canvas, height) {
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  if (height) canvas.style.height = `${height}px`;
  else height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return { context, width, height };
}
