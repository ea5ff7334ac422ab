// Keys and time that judging takes, as they are saved with each mark.

const LONGEST_PAUSE_MS = 60_000;

export class Effort {
  constructor() {
    this.begin();
  }

  begin() {
    this.keys = 0;
    this.ms = 0;
    this.last = performance.now();
  }

  /** Something was pressed or clicked. A longer pause counts as a minute: nobody was looking. */
  note(keys = 1) {
    const now = performance.now();
    this.ms += Math.min(now - this.last, LONGEST_PAUSE_MS);
    this.last = now;
    this.keys += keys;
  }

  /** What it took since the last time; counting begins anew. */
  take() {
    const taken = { keys: this.keys, seconds: Math.round(this.ms / 10) / 100 };
    this.begin();
    return taken;
  }
}
