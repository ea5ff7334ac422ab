// What the operator's hands do, as one state that is sent again and again: lost or repeated messages do no harm.

const SEND_EVERY_MS = 40;
const BUTTONS = [
  "A", "B", "X", "Y", "LB", "RB", "LT", "RT", "Back", "Start", "LS", "RS", "Up", "Down", "Left", "Right", "Guide",
];
const LT = 6;
const RT = 7;
// Keys of the page itself; and those with which browsers copy.
const PAGE_KEYS = new Set(["Tab", "Escape"]);

const takesText = (target) =>
  target instanceof HTMLInputElement && target.type !== "checkbox" ? true : target instanceof HTMLSelectElement;

/** Whether a key presses what has the focus. */
const presses = (code, target) => (code === "Space" || code === "Enter") && target.matches?.("button, a, input, summary");

export class Input extends EventTarget {
  #keys = new Set();
  #edges = {};
  #sequence = 0;
  #pads = new Map();
  #waking = new Set();
  #source = "keyboard";
  #bound = new Set();
  #send;
  #drives;
  isActive = false;

  /** Where messages go, and a function that says whether what the hands do counts: else nothing is sent. */
  constructor(send, drives) {
    super();
    this.#send = send;
    this.#drives = drives;
    addEventListener("keydown", (event) => this.#down(event));
    addEventListener("keyup", (event) => this.#up(event));
    addEventListener("blur", () => this.release());
    addEventListener("focus", () => (this.isActive = true));
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
    addEventListener("gamepaddisconnected", () => this.release());
    setInterval(() => this.#beat(), SEND_EVERY_MS);
  }

  /** Keys that mean something; others are the browser's. */
  bind(codes) {
    this.#bound = new Set(codes);
  }

  get drives() {
    return this.#drives();
  }

  get held() {
    return this.#keys;
  }

  /** A new connection counts from zero. */
  restart() {
    this.#edges = {};
    this.#sequence = 0;
  }

  /** A press of a button on the page. */
  press(action) {
    this.#edges[action] = (this.#edges[action] ?? 0) + 1;
    this.#tell(null, action);
  }

  /** Hands off: nothing is held, and nothing more is sent until something is done again. */
  release() {
    this.#keys.clear();
    this.isActive = false;
    this.#send({ kind: "release" });
    this.dispatchEvent(new Event("change"));
  }

  #down(event) {
    const { code } = event;
    if (takesText(event.target) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (code === "Slash" || event.key === "?") {
      event.preventDefault();
      this.dispatchEvent(new Event("help"));
      return;
    }
    if (!this.#drives() || PAGE_KEYS.has(code) || !this.#bound.has(code) || presses(code, event.target)) return;
    event.preventDefault();
    if (event.repeat || this.#keys.has(code)) return;
    this.#source = "keyboard";
    this.#keys.add(code);
    this.#edges[code] = (this.#edges[code] ?? 0) + 1;
    this.#tell(code);
  }

  #up(event) {
    if (!this.#keys.delete(event.code)) return;
    // Else a button that has the focus would be pressed by the space bar.
    event.preventDefault();
    this.#tell();
  }

  #tell(pressed = null, action = null) {
    if (!this.#drives()) return;
    this.isActive = true;
    const pad = this.#pad();
    const held = [...this.#keys, ...pad.held];
    this.#sequence += 1;
    this.#send({ source: this.#source, sequence: this.#sequence, held, edges: this.#edges, axes: pad.axes });
    this.dispatchEvent(new CustomEvent("change", { detail: { sequence: this.#sequence, pressed, action } }));
  }

  #beat() {
    const pad = this.#pad();
    if (pad.moved) {
      this.#source = "gamepad";
      this.isActive = true;
    }
    if (this.isActive && document.hasFocus()) this.#tell();
  }

  /** The first gamepad in the standard mapping: what is held, counted presses, and its axes. */
  #pad() {
    const pad = [...navigator.getGamepads?.() ?? []].find((each) => each?.connected && each.mapping === "standard");
    if (!pad || !this.#drives()) {
      this.#pads.clear();
      this.#waking.clear();
      return { held: [], axes: null, moved: false };
    }
    // A page sees a gamepad only once something is pressed: that press woke it, and is not meant for the robot.
    if (!this.#pads.size) pad.buttons.forEach(({ pressed }, index) => pressed && this.#waking.add(index));
    const held = [];
    let moved = pad.axes.some((value) => Math.abs(value) > 0.15);
    pad.buttons.forEach(({ pressed }, index) => {
      const name = BUTTONS[index];
      if (!pressed) this.#waking.delete(index);
      if (!name || index === LT || index === RT || this.#waking.has(index)) return;
      if (pressed) held.push(name);
      if (pressed && !this.#pads.get(name)) this.#edges[name] = (this.#edges[name] ?? 0) + 1;
      this.#pads.set(name, pressed);
      moved ||= pressed;
    });
    const triggers = [LT, RT].map((index) => (this.#waking.has(index) ? 0 : pad.buttons[index]?.value ?? 0));
    moved ||= triggers.some((value) => value > 0.05);
    const axes = [...pad.axes.slice(0, 4), ...triggers].map((value) => Math.max(-1, Math.min(1, value)));
    return { held, axes, moved };
  }
}
