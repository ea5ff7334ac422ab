// What is wrong, of every source by itself: one that has nothing more to say does not silence the others.

/** A sentence from words of the server. */
export const sentence = (words) => (words ? `${words[0].toUpperCase()}${words.slice(1)}.` : "");

export class Notices {
  #place;
  #lines = new Map();

  /** Where they are shown, and their sources in the order in which they are. */
  constructor(place, sources) {
    this.#place = place;
    for (const source of sources) {
      const line = document.createElement("p");
      line.dataset.source = source;
      line.hidden = true;
      this.#lines.set(source, line);
    }
    place.replaceChildren(...this.#lines.values());
  }

  /** What a source says now; nothing takes back what it said before. */
  say(source, words = "") {
    const line = this.#lines.get(source);
    const text = sentence(words);
    // The same words again would be read out again.
    if (line.textContent !== text) line.textContent = text;
    line.hidden = !text;
    this.#place.hidden = [...this.#lines.values()].every(({ hidden }) => hidden);
  }
}
