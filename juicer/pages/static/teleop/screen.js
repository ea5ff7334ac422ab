// What the operator sees: a canvas an image, and how long it took from a key to the screen.

const MEASURED = 40;

const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];

/** Ends the waiting of every message up to the one that a frame answers. */
function collect(waiting, answered, times, now) {
  for (const [sequence, at] of waiting) {
    if (sequence > answered) break;
    times.push(now - at);
    waiting.delete(sequence);
  }
  times.splice(0, Math.max(times.length - MEASURED, 0));
}

export class Screen {
  #canvases = [];
  #sentAt = new Map();
  #latencies = [];
  #waiting = new Map();
  #motions = [];
  #paints = [];
  #lastNumber = -1;
  #dropped = 0;
  #painted = [];

  constructor(place, panes) {
    const policies = document.createElement("div");
    policies.className = "policies";
    // The canvases are in the order in which images come, wherever they stand on the page.
    const figures = panes.map((pane) => [pane, this.#figure(pane)]);
    policies.append(...figures.filter(([pane]) => pane.of_policy).map(([, figure]) => figure));
    place.replaceChildren(...figures.filter(([pane]) => !pane.of_policy).map(([, figure]) => figure), policies);
    place.firstChild.className = "main";
  }

  #figure({ name, title, width, height }) {
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = title;
    const canvas = document.createElement("canvas");
    Object.assign(canvas, { width, height });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", title);
    canvas.dataset.pane = name;
    figure.append(caption, canvas);
    this.#canvases.push(canvas.getContext("2d", { alpha: false }));
    return figure;
  }

  /** A message left; the first frame that was made after it arrived ends the time from key to screen. */
  sent(sequence, moves) {
    this.#sentAt.set(sequence, performance.now());
    if (moves) this.#waiting.set(sequence, performance.now());
  }

  /** A connection that begins counts anew. */
  restart() {
    this.#sentAt.clear();
    this.#waiting.clear();
    this.#lastNumber = -1;
    this.#painted = [];
  }

  /** Paints a frame; resolves once it is on the screen. */
  async paint(frame) {
    const bitmaps = await Promise.all(
      frame.images.map((jpeg) => (jpeg ? createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })) : null)),
    );
    await new Promise(requestAnimationFrame);
    bitmaps.forEach((bitmap, index) => {
      const canvas = this.#canvases[index];
      // A frame holds only the images that are new, and one that holds few is here before an earlier one that holds all.
      if (bitmap && canvas && frame.number > (this.#painted[index] ?? -1)) {
        canvas.drawImage(bitmap, 0, 0, canvas.canvas.width, canvas.canvas.height);
        this.#painted[index] = frame.number;
      }
      bitmap?.close();
    });
    this.#count(frame);
  }

  #count({ number, heard, movedBy }) {
    const now = performance.now();
    if (this.#lastNumber >= 0) this.#dropped += Math.max(number - this.#lastNumber - 1, 0);
    this.#lastNumber = Math.max(this.#lastNumber, number);
    this.#paints.push(now);
    while (this.#paints[0] < now - 2000) this.#paints.shift();
    collect(this.#sentAt, heard, this.#latencies, now);
    collect(this.#waiting, movedBy, this.#motions, now);
  }

  /** Figures of the connection. */
  get figures() {
    const seconds = Math.max((this.#paints.at(-1) - this.#paints[0]) / 1000, 0.001);
    return {
      latencyMs: this.#latencies.length ? Math.round(median(this.#latencies)) : null,
      motionMs: this.#motions.length ? Math.round(median(this.#motions)) : null,
      latencies: this.#latencies,
      motions: this.#motions,
      framesPerSecond: this.#paints.length > 1 ? (this.#paints.length - 1) / seconds : 0,
      dropped: this.#dropped,
    };
  }
}
