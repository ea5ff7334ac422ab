// What is asked of the server and told to it. What is told goes out one after the other.

import { NO_ANSWER } from "../answers.js";

export class Server {
  constructor(address) {
    this.address = address;
    this.last = Promise.resolve();
    this.waiting = 0;
  }

  /** JSON from an address below the page's; throws a sentence. */
  async get(path) {
    return (await this.#ask(path)).content;
  }

  /** Tell something; `body` is called when its turn has come. Resolves to {status, content}; throws a sentence. */
  tell(path, body) {
    this.waiting += 1;
    const turn = this.last.then(() => this.#ask(path, {
      method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body()),
    }));
    const done = turn.finally(() => { this.waiting -= 1; });
    this.last = done.catch(() => {});
    return done;
  }

  async #ask(path, options = {}) {
    let answer;
    try {
      answer = await fetch(this.address + path, { headers: { accept: "application/json" }, ...options });
    } catch {
      throw new Error(NO_ANSWER);
    }
    const content = await answer.json().catch(() => ({ error: `the server answers ${answer.status}` }));
    const isConflict = answer.status === 409 && content.marks;
    if (!answer.ok && !isConflict) {
      // What the server does not understand it will not understand the next time.
      throw Object.assign(new Error(content.error ?? `the server answers ${answer.status}`), { isFinal: answer.status === 400 });
    }
    return { status: answer.status, content };
  }
}
