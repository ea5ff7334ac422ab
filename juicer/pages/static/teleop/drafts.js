// Interrupted episodes: a row each, which stays in its place as long as what it says holds.

import { askingButton, button } from "./buttons.js";
import { sentence } from "./notices.js";

export class Drafts {
  #list;
  #orders;
  #rows = new Map();

  /** Where they are listed, and what their buttons order: functions of an episode, by name. */
  constructor(list, orders) {
    this.#list = list;
    this.#orders = orders;
  }

  /** Shows these and no others; false if the focus was in the list and has no place there any more. */
  show(drafts) {
    const focused = [...this.#list.children].findIndex((row) => row.contains(document.activeElement));
    this.#rows = new Map(drafts.map((draft) => [JSON.stringify(draft), this.#row(draft)]));
    this.#place([...this.#rows.values()]);
    return focused < 0 || this.#focus(focused);
  }

  /** The server answered, or will not: what is still there can be pressed again. */
  free() {
    for (const row of this.#list.children) setDisabled(row, false);
  }

  /** The row that says the same of the same episode already, or a new one. */
  #row(draft) {
    return this.#rows.get(JSON.stringify(draft)) ?? this.#made(draft);
  }

  #made(draft) {
    const row = document.createElement("li");
    row.tabIndex = -1;
    const about = document.createElement("span");
    about.textContent = draft.problem ? sentence(draft.problem) : interrupted(draft);
    if (draft.problem) about.className = "bad";
    const order = (name) => () => {
      setDisabled(row, true);
      this.#orders[name](draft);
    };
    row.append(about, ...(draft.problem ? [] : [button("Go on with it", order("resume"))]));
    row.append(askingButton("Remove it", "Really remove it", order("forget")));
    return row;
  }

  /** Only rows that are not where they belong are touched: one that is moved loses the focus. */
  #place(rows) {
    for (const row of [...this.#list.children]) if (!rows.includes(row)) row.remove();
    rows.forEach((row, index) => {
      const here = this.#list.children[index];
      if (row !== here) this.#list.insertBefore(row, here ?? null);
    });
  }

  /** Keeps the focus in the list: where it was, or else on the row that took that place. */
  #focus(index) {
    if (this.#list.contains(document.activeElement)) return true;
    const row = this.#list.children[index] ?? this.#list.lastElementChild;
    if (row) focusIn(row);
    return Boolean(row);
  }
}

/** A disabled button cannot keep the focus: its row holds it meanwhile. */
function setDisabled(row, disabled) {
  if (disabled && row.contains(document.activeElement)) row.focus();
  for (const each of row.querySelectorAll("button")) each.disabled = disabled;
  if (!disabled && row === document.activeElement) focusIn(row);
}

function focusIn(row) {
  row.querySelector("button:last-of-type").focus();
}

function interrupted({ task, operator, began, seconds, parent_step: from }) {
  const when = began.slice(0, 16).replace("T", " ");
  const correction = from === null ? "" : `, finishing a rollout from step ${from} on`;
  return `${task}${correction}${operator ? `, ${operator}` : ""}, begun ${when}: ${seconds.toFixed(1)} s recorded`;
}
