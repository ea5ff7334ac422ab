// What the page shows of the entry that is being judged.

import { own } from "./queue.js";
import { prepared } from "./sheets.js";
import { drawTimeline } from "./timeline.js";

const VIEWS = ["front", "close", "wrist"];
const STRIP = ["close", "wrist"];
const NARROW = 640;
const MORE_LIKELY_THAN_NOT = 0.5;
const LATE_STEPS = 15;

const stepWords = (step) => (step === null ? "a step after the last" : `step ${step}`);

export const element = (id) => document.getElementById(id);

/** Have it read out. */
export function say(sentence) {
  element("announcements").textContent = sentence;
}

function made(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

export class Display {
  constructor(setting, sheets) {
    this.setting = setting;
    this.sheets = sheets;
    this.choices = new Map();
    this.side = 5;
  }

  show({ entry, cursor, queue, author, which, signals, sample }) {
    element("judging").hidden = !entry;
    element("nothing").hidden = Boolean(entry);
    element("expected").hidden = !entry;
    const left = queue.wanted(which, author).length;
    const failed = queue.entries.filter((each) => each.pending?.failed || each.pending?.refused).length;
    const marked = queue.entries.filter((each) => each.opinions.length || each.pending).length;
    element("progress").textContent = `${marked} of ${queue.entries.length} marked, ${left} to go`
      + (sample ? `; sample: ${sample} to go` : "") + (failed ? `; ${failed} not saved` : "");
    if (!entry) return this.#showNothing(queue, left);
    const state = this.setting.states[entry.state];
    element("what").textContent = state.name;
    element("where").textContent = `${entry.episode.log} · step ${cursor} of ${entry.episode.steps - 1}`;
    element("doubt").textContent = entry.proposal
      ? `proposal: step ${entry.proposal.step}, confidence ${entry.proposal.confidence.toFixed(2)}` : "nothing was proposed: mark it by hand";
    this.#showState(entry, author);
    element("definition-title").textContent = `Critical state: ${state.name}`;
    element("definition").textContent = state.definition;
    this.#drawViews(entry, cursor);
    this.#drawFilm(entry, cursor);
    drawTimeline(element("timeline"), entry.episode, signals, entry.state, cursor, this.#marks(entry, author));
    this.#showSlider(entry, cursor);
    element("judging").setAttribute("aria-busy", !(signals && this.sheets.has(entry.episode, cursor, this.side)));
    this.#listMarks(queue, entry, author);
  }

  /** Words for what came of an entry so far. */
  #showState(entry, author) {
    const mine = own(entry, author);
    const [words, kind] = entry.pending?.failed || entry.pending?.refused ? ["not saved", "bad"] : entry.disputed ? ["disputed", "bad"]
      : entry.pending ? ["saving …", ""] : mine ? [`✓ you marked ${stepWords(mine.step)}`, "good"]
      : entry.opinions.length ? [`✓ ${entry.opinions.at(-1).author} marked ${stepWords(entry.opinions.at(-1).step)}`, "good"] : ["", ""];
    element("state").textContent = words;
    element("state").className = `state ${kind}`;
  }

  #showNothing(queue, left) {
    const isDone = queue.entries.length > 0;
    element("nothing-title").textContent = isDone ? "Done" : "Nothing to annotate";
    element("nothing-text").textContent = !isDone ? "None of these demonstrations succeeded."
      : left ? "Choose above what to show." : "Every critical state of this choice is marked. Choose above to look at others, or undo with u.";
  }

  #showSlider(entry, cursor) {
    const timeline = element("timeline");
    const distance = entry.proposal ? cursor - entry.proposal.step : null;
    const words = distance === null ? "" : distance === 0 ? ", the proposal" : `, ${Math.abs(distance)} ${distance < 0 ? "before" : "after"} the proposal`;
    timeline.setAttribute("aria-valuemax", entry.episode.steps - 1);
    timeline.setAttribute("aria-valuenow", cursor);
    timeline.setAttribute("aria-valuetext", `step ${cursor}${words}`);
  }

  #marks(entry, author) {
    const marks = entry.opinions.filter((each) => each.step !== null)
      .map((each) => ({ step: each.step, words: each.author, kind: each.author === author ? "own" : "other", side: 1 }));
    if (entry.pending) marks.push({ step: entry.pending.step, words: author, kind: "own", side: 1 });
    if (entry.proposal) marks.unshift({ step: entry.proposal.step, words: "proposal", kind: "proposal", side: -1 });
    return marks;
  }

  #drawViews(entry, cursor) {
    for (const view of VIEWS) {
      const { context, width, height } = prepared(element(`view-${view}`));
      this.sheets.draw(context, entry.episode, cursor, view, 0, 0, width, height);
    }
  }

  #drawFilm(entry, cursor) {
    const canvas = element("frames");
    this.side = canvas.clientWidth < NARROW ? 3 : 5;
    const count = 2 * this.side + 1;
    const tile = canvas.clientWidth / count;
    const high = tile * 0.75;
    const text = 0.75 * parseFloat(getComputedStyle(document.documentElement).fontSize);
    const { context } = prepared(canvas, Math.round(text * 1.4 + STRIP.length * high));
    const colour = (name) => getComputedStyle(canvas).getPropertyValue(name).trim();
    context.font = `${text}px ${getComputedStyle(canvas).fontFamily}`;
    context.textBaseline = "middle";
    context.textAlign = "center";
    for (let place = 0; place < count; place += 1) {
      const step = cursor + place - this.side;
      if (step < 0 || step >= entry.episode.steps) continue;
      const isProposal = entry.proposal?.step === step;
      context.fillStyle = colour(isProposal ? "--accent" : step === cursor ? "--ink" : "--muted");
      context.fillText(isProposal ? `▼ ${step}` : step, (place + 0.5) * tile, text * 0.7);
      STRIP.forEach((view, row) => this.sheets.draw(context, entry.episode, step, view, place * tile + 1, text * 1.4 + row * high + 1, tile - 2, high - 2));
    }
    context.strokeStyle = colour("--accent");
    context.lineWidth = 3;
    context.strokeRect(this.side * tile + 1, text * 1.4 + 1, tile - 2, STRIP.length * high - 3);
  }

  /** How many steps from the cursor a place of the images is. */
  tileAt(x) {
    const count = 2 * this.side + 1;
    return Math.floor(x / (element("frames").clientWidth / count)) - this.side;
  }

  /** The critical states that the task expects of this demonstration, and what is marked of them. */
  #listMarks(queue, entry, author) {
    const rows = queue.entries.filter((each) => each.episode === entry.episode).map((each) => {
      const mine = own(each, author) ?? each.opinions.at(-1);
      const step = each.pending?.step ?? mine?.step;
      const words = step === undefined && !each.expected ? made("span", {}, "– before it begins?")
        : step === undefined ? made("span", { class: "bad" }, "○ missing")
        : each.disputed || each.pending?.refused ? made("span", { class: "bad" }, "≠ disputed") : made("span", { class: "good" }, `✓ ${stepWords(step)}`);
      return made("li", each === entry ? { "aria-current": "true" } : {}, made("span", {}, this.setting.states[each.state].name), words);
    });
    element("marks").replaceChildren(...rows);
  }

  /** A message with what can be done about it; none if there are no words. */
  notice(id, words, choices = []) {
    const box = element(id);
    box.hidden = !words;
    this.choices.set(id, new Map(choices.map((choice) => [choice.key, choice.action])));
    if (!words) return box.replaceChildren();
    const buttons = choices.map((choice) => {
      const button = made("button", { type: "button" }, `${choice.words} `, made("kbd", {}, choice.key));
      button.addEventListener("click", choice.action);
      if (choice.look) button.addEventListener("focus", choice.look);
      return button;
    });
    box.replaceChildren(made("p", {}, words), made("div", { class: "buttons" }, ...buttons));
  }

  /** Whether a message is shown that has a key. */
  offers(id, key) {
    return !element(id).hidden && Boolean(this.choices.get(id)?.has(key));
  }

  /** Do what a key does in a message; false if there is no such key. */
  press(id, key) {
    const offered = this.offers(id, key);
    if (offered) this.choices.get(id).get(key)();
    return offered;
  }

  progress(work) {
    element("progress").textContent = `Looking for critical states: ${work.proposed} of ${work.of} demonstrations`;
  }

  /** Ask what annotating took so far. */
  measured(server) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => server.get("/measures").then((found) => this.measures(found)).catch(() => {}), 500);
  }

  measures(found) {
    const paper = this.setting.paper;
    const shown = (value, digits, unit = "") => (value === null ? "–" : `${value.toFixed(digits)}${unit}`);
    const rows = [
      ["demonstrations judged", found.judged, paper ? 50 : "–"],
      ["minutes", shown(found.minutes, 1), paper ? paper.annotating_min : "–"],
      ["seconds a demonstration", shown(found.seconds, 1), paper ? (paper.annotating_min * 60 / 50).toFixed(0) : "–"],
      ["keys a demonstration", shown(found.keys, 2), "–"],
      ["agree with the proposal", found.agreement === null ? "–" : `${Math.round(100 * found.agreement)} %`, "–"],
      ["steps between annotators", shown(found.steps_between_annotators, 1), "–"],
      ["disputed", found.disputed, "–"],
    ];
    element("measures").replaceChildren(...rows.map(([name, ...values]) => made("tr", {},
      made("th", { scope: "row" }, name), ...values.map((value) => made("td", { class: "number" }, String(value))))));
  }

  /** A right and a wrong example of a critical state: where people and the proposal agree best, and the proposal is surest. */
  examples(entries, state) {
    const { right, wrong } = this.setting.states[state];
    const stepOf = (each) => each.agreed ?? (each.proposal?.confidence > MORE_LIKELY_THAN_NOT ? each.proposal.step : null);
    const sureness = (each) => each.proposal?.confidence ?? 0;
    const distance = (each) => (each.proposal ? Math.abs(stepOf(each) - each.proposal.step) : Infinity);
    const isFollowed = (each) => stepOf(each) + LATE_STEPS < each.episode.steps;
    const [found] = entries.filter((each) => each.state === state && stepOf(each) !== null && isFollowed(each))
      .sort((one, other) => distance(one) - distance(other) || sureness(other) - sureness(one));
    element("examples").hidden = !found;
    if (!found) return;
    const step = stepOf(found);
    this.#example("right", found, step, right);
    this.#example("wrong", found, step + LATE_STEPS, `${LATE_STEPS} steps later: ${wrong}`);
  }

  #example(id, { episode }, step, words) {
    const address = `${this.setting.address}/${episode.id}/${step}.jpg?count=1&view=close`;
    const image = element(id);
    if (image.getAttribute("src") !== address) image.src = address;
    image.alt = `Step ${step}: ${words}`;
    element(`${id}-text`).textContent = words;
  }

  keyRow(keys, words) {
    const cells = keys.flatMap((key, index) => [index ? " " : "", made("kbd", {}, key)]);
    return made("tr", {}, made("td", {}, ...cells), made("td", {}, words));
  }
}
