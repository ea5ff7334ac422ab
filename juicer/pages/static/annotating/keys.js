// Which key does what. Letters are those of the original tool.

export const KEYS = [
  { action: "accept", keys: ["Enter"], words: "accept the mark at this step, and go on" },
  { action: "earlier", keys: ["ArrowLeft", "j"], words: "one step earlier" },
  { action: "later", keys: ["ArrowRight", "k"], words: "one step later" },
  { action: "much-earlier", keys: ["Shift+ArrowLeft", "h"], words: "ten steps earlier" },
  { action: "much-later", keys: ["Shift+ArrowRight", "l"], words: "ten steps later" },
  { action: "first", keys: ["Home"], words: "first step" },
  { action: "last", keys: ["End"], words: "last step" },
  { action: "to-proposal", keys: ["p"], words: "back to the proposal" },
  { action: "mark", keys: ["Space"], words: "accept, and stay with this demonstration" },
  { action: "next-demonstration", keys: ["s"], words: "go on to the next demonstration" },
  { action: "skip", keys: ["ArrowDown", "Escape"], words: "leave it for later" },
  { action: "back", keys: ["ArrowUp"], words: "look at the one before" },
  { action: "undo", keys: ["Ctrl+z", "Backspace", "u"], words: "undo what was saved last" },
  { action: "accept-many", keys: ["a"], words: "accept all above 0.9, when this is offered" },
  { action: "help", keys: ["?"], words: "show or hide these keys" },
];

const NAMES = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" };
const BY_KEY = new Map(KEYS.flatMap(({ action, keys }) => keys.map((key) => [key, action])));

/** What a key event is called here, e.g. "Shift+ArrowLeft". */
export function nameOf(event) {
  if (event.altKey || event.metaKey) return "";
  const key = event.key === " " ? "Space" : event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.ctrlKey) return `Ctrl+${key}`;
  return event.shiftKey && key.length > 1 ? `Shift+${key}` : key;
}

/** Action of a key, or none; single characters can be switched off (WCAG 2.1.4). */
export function actionOf(name, letters) {
  return name.length === 1 && !letters ? undefined : BY_KEY.get(name);
}

/** How a key is written for people. */
export function written(key) {
  return key.split("+").map((part) => NAMES[part] ?? part).join(" ");
}
