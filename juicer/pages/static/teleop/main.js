// The page of teleoperation: ties the connection, the operator's hands and the screen together.

import { button } from "./buttons.js";
import { Drafts } from "./drafts.js";
import { Input } from "./input.js";
import { Notices } from "./notices.js";
import { Screen } from "./screen.js";
import { Connection } from "./socket.js";
import { keyName, play } from "./words.js";

const element = (id) => document.getElementById(id);
const status = {};
const phases = {
  recording: "Recording", idle: "Idle", paused: "Paused", over: "Ended", watching: "Watching",
};
// By the kind of an order, how a status shows that the server obeyed it. Of the others, the refusal of something else is
// no news any more as soon as they are given.
const signs = {
  forget: (news) => news.drafts,
  pace: (news) => news.time_scale || news.undo_s,
  "take over": (news) => news.drives,
};
const notices = new Notices(element("problem"), ["connection", "refusal", "status", "greeting"]);
const drafts = new Drafts(element("draft-list"), { resume, forget });
// What the user did last, since the last refusal: a kind of order, or the number of the message that told of a key.
let done = null;
let isGreeted = false;
let screen = null;
let motions = new Set();
// Whether this page has begun something: a page of a rollout must not show another episode as if it were that rollout.
let hasBegun = false;

const connection = new Connection();
const input = new Input((message) => connection.send(message), () => Boolean(isShown() && status.drives));

connection.addEventListener("open", () => {
  input.restart();
  screen?.restart();
  notices.say("connection");
  drafts.free();
  if (element("show-numbers").checked) connection.send({ kind: "numbers" });
  input.isActive = document.hasFocus();
});
connection.addEventListener("closed", ({ detail }) => {
  Object.keys(status).forEach((name) => delete status[name]);
  done = null;
  say("connection", "Not connected");
  notices.say("status");
  notices.say("connection", detail || "The connection to the server is gone; this page connects again by itself");
});
connection.addEventListener("frame", async ({ detail: frame }) => {
  try {
    await screen?.paint(frame);
  } finally {
    // An image that cannot be shown must not hold up the next ones.
    connection.send({ kind: "painted", number: frame.number });
  }
  document.documentElement.dataset.heard = frame.heard;
  if (Number.isInteger(done) && frame.heard >= done) obeyed();
});
connection.addEventListener("message", ({ detail: { kind, ...content } }) => {
  if (kind === "greeting") greet(content);
  else if (kind === "refused") refused(content.sentence);
  else show(content);
});

input.addEventListener("change", ({ detail }) => {
  if (detail?.pressed) screen?.sent(detail.sequence, motions.has(detail.pressed));
  // Who drives on has done nothing new.
  if (detail?.action || (detail?.pressed && !motions.has(detail.pressed))) done = detail.sequence;
  for (const key of document.querySelectorAll("kbd[data-code]")) {
    key.classList.toggle("down", input.held.has(key.dataset.code));
  }
});
input.addEventListener("help", () => {
  element("keys").hidden = !element("keys").hidden;
});

function greet(content) {
  notices.say("greeting", content.problems.join("; "));
  say("own-keys", content.folder);
  const form = element("begin");
  // A rollout that is finished by hand has its task and randomness.
  if (form.task) {
    options(form.task, content.tasks);
    options(form.randomness, content.randomness);
  }
  options(form.keys, content.key_maps);
  // Later, the form holds what was chosen since.
  if (!isGreeted) remember(form);
  isGreeted = true;
  screen = new Screen(element("panes"), content.panes);
}

function remember(form) {
  for (const field of rememberedFields(form)) {
    const remembered = localStorage.getItem(`teleop.${field.name}`);
    if (remembered !== null && (field.tagName === "INPUT" || offers(field, remembered))) field.value = remembered;
  }
  element("take-over").operator.value = form.operator.value;
}

function rememberedFields(form) {
  return [...form.elements].filter(({ name, type }) => name && type !== "hidden" && type !== "checkbox");
}

/** Offers these values; what is chosen stays chosen if it is among them. */
function options(select, values) {
  const chosen = select.value;
  select.replaceChildren(...values.map((value) => new Option(value, value)));
  if (offers(select, chosen)) select.value = chosen;
}

function offers(select, value) {
  return [...select.options].some((each) => each.value === value);
}

/** Has the server do something. */
function order(message) {
  if (!signs[message.kind]) obeyed();
  done = message.kind;
  connection.send(message);
}

function refused(sentence) {
  done = null;
  drafts.free();
  notices.say("refusal", sentence);
}

/** The user went on to something else, so that what was refused before is over. */
function obeyed() {
  done = null;
  notices.say("refusal");
}

/** Whether what goes on is what this page is for. */
function isShown() {
  const { origin } = element("begin").dataset;
  return status.going_on && (!origin || hasBegun || status.origin === origin);
}

function show(news) {
  const before = { ...status };
  Object.assign(status, news);
  // A device that is gone is a hand that let go of everything.
  if (before.spacemouse && !status.spacemouse && status.going_on) input.release();
  const shown = isShown();
  element("setup").hidden = shown;
  element("drive").hidden = !shown;
  if (element("occupied")) {
    element("occupied").hidden = shown || !status.going_on;
    if (status.task) say("occupied-by", episode());
  }
  showDriver(before, shown);
  if (news.key_list) showKeys(status.key_list);
  if (news.drafts) showDrafts(status.drafts);
  if (signs[done]?.(news)) obeyed();
  notices.say("status", shown ? status.problem : "");
  if (!shown) return;
  const phase = status.drives ? status.phase : "watching";
  element("state").dataset.phase = phase;
  say("phase", phases[phase]);
  say("sentence", status.drives ? status.sentence : watching());
  element("steering").disabled = !status.drives;
  say("demonstrations", status.demonstrations);
  say("corrections", status.corrections);
  say("target", status.target);
  say("checking", status.checking ? `(and ${status.checking} being checked)` : "saved");
  element("progress").max = status.target;
  element("progress").value = Math.min(status.demonstrations, status.target);
  say("episode", episode());
  if (news.kept) showKept(status.kept);
  say("logs-line", `logs: ${status.folder}`);
  if (news.time_scale) element("time-scale").value = status.time_scale;
  if (news.undo_s) element("undo-s").value = status.undo_s;
  if (news.numbers) say("number-list", numbers(status.numbers));
  announce(before, phase);
}

/** Whoever drives is named: a page that was given the controls unasked says the name that it remembers, or asks for one. */
function showDriver(before, shown) {
  const form = element("take-over");
  const name = form.operator.value.trim();
  const isSomebodyElse = shown && status.drives && status.operator !== name;
  if (isSomebodyElse && !before.drives && name) order({ kind: "take over", operator: name });
  form.hidden = !status.going_on || (status.drives && !isSomebodyElse);
  say("recorded-as", isSomebodyElse ? `You drive, and it is recorded as ${status.operator || "nobody"}'s.` : "");
  say("take-over-name", status.drives ? "Drive under this name" : "Take over the controls");
}

function watching() {
  if (!status.is_driven) return "Nobody drives; take over the controls to go on";
  return `Somebody else drives (${phases[status.phase].toLowerCase()}); you watch`;
}

function episode() {
  const { task, origin, step, acted, assembled, pairs, gripper_closes: closes, slow } = status;
  const seconds = (acted / 10).toFixed(1);
  return `${task}, ${origin}: ${seconds} s recorded in ${step} steps; ${assembled} of ${pairs} assembled; gripper ${closes ? "closed" : "open"}${slow ? "; slow" : ""}`;
}

function showKept(kept) {
  element("kept").replaceChildren(
    ...kept.map(({ name, verification: { verdict, sentence } }) => {
      const item = document.createElement("li");
      item.dataset.verdict = verdict;
      item.textContent = `${name}: ${sentence}`;
      return item;
    }),
  );
}

function showDrafts(left) {
  element("drafts").hidden = !left.length;
  if (!drafts.show(left)) element("setup-title").focus();
}

function resume({ task, draft }) {
  const { target, spacemouse, operator, keys } = element("begin").elements;
  element("take-over").operator.value = operator.value;
  hasBegun = true;
  order({
    kind: "resume", task, draft, target: Number(target.value), spacemouse: spacemouse.checked,
    operator: operator.value, keys: keys.value,
  });
}

function forget({ task, draft }) {
  order({ kind: "forget", task, draft });
}

function showKeys(keys) {
  input.bind(keys.flatMap((each) => each.keys));
  motions = new Set(keys.filter(({ is_motion: moves }) => moves).flatMap((each) => each.keys));
  element("key-list").replaceChildren(
    ...keys.map(({ text, keys: codes }) => {
      const term = document.createElement("dt");
      term.append(
        ...codes.map((code) => {
          const key = document.createElement("kbd");
          key.dataset.code = code;
          key.textContent = keyName(code);
          return key;
        }),
      );
      const meaning = document.createElement("dd");
      meaning.textContent = text;
      const row = document.createElement("div");
      row.append(term, meaning);
      return row;
    }),
  );
  const actions = keys.filter(({ meaning }) => ["undo", "undo_more", "success", "discard", "reset", "pause", "proceed"].includes(meaning));
  element("actions").replaceChildren(
    ...actions.map(({ meaning, text, keys: [code] }) => {
      const made = button(text[0].toUpperCase() + text.slice(1), () => input.press(meaning));
      made.title = `Key ${keyName(code)}`;
      return made;
    }),
  );
}

function numbers({ proprioception: p, part_poses: parts }) {
  const row = (name, values) => `${name.padEnd(9)}${values.map((value) => value.toFixed(3).padStart(7)).join("")}`;
  const rows = [row("gripper", p.slice(0, 3)), row("width", p.slice(15))];
  for (let index = 0; index < parts.length; index += 7) rows.push(row(`part ${index / 7}`, parts.slice(index, index + 7)));
  return rows.join("\n");
}

function announce(before, phase) {
  const newest = status.kept[0];
  // What lies in the folder of another task is no news.
  if (newest && before.kept && before.folder === status.folder && JSON.stringify(before.kept[0]) !== JSON.stringify(newest)) {
    caption(`${newest.name}: ${newest.verification.sentence}`, newest.verification.verdict);
  } else if (before.phase && before.phase !== status.phase && (phase === "paused" || phase === "over")) {
    caption(status.sentence, phase);
  }
}

/** What a sound says is written, too. */
function caption(sentence, sound) {
  say("announcements", sentence);
  if (element("sound").checked) play(sound);
}

function say(id, text) {
  const place = element(id);
  if (place.textContent !== String(text)) place.textContent = text;
}

element("begin").addEventListener("submit", (event) => {
  event.preventDefault();
  for (const { name, value } of rememberedFields(event.target)) localStorage.setItem(`teleop.${name}`, value);
  const { target, episode, step, ...choice } = Object.fromEntries(new FormData(event.target));
  const rollout = choice.artifact ? { kind: "correct", episode: Number(episode), step: Number(step) } : { kind: "begin" };
  element("take-over").operator.value = choice.operator;
  hasBegun = !status.going_on || status.drives;
  if (status.drives) order({ kind: "end" });
  order({ ...choice, ...rollout, target: Number(target), spacemouse: event.target.spacemouse.checked });
  document.activeElement?.blur();
  input.isActive = true;
});
element("take-over").addEventListener("submit", (event) => {
  event.preventDefault();
  element("begin").operator.value = event.target.operator.value;
  localStorage.setItem("teleop.operator", event.target.operator.value);
  order({ kind: "take over", operator: event.target.operator.value });
  document.activeElement?.blur();
  input.isActive = true;
});
element("end").addEventListener("click", () => order({ kind: "end" }));
for (const id of ["time-scale", "undo-s"]) {
  let isPointedAt = false;
  element(id).addEventListener("pointerdown", () => { isPointedAt = true; });
  element(id).addEventListener("keydown", () => { isPointedAt = false; });
  element(id).addEventListener("change", ({ target }) => {
    order({
      kind: "pace", time_scale: Number(element("time-scale").value), undo_s: Number(element("undo-s").value),
    });
    // Else the next keys would choose in the list instead of driving. Who uses the keyboard stays there.
    if (isPointedAt) target.blur();
  });
}
addEventListener("click", ({ detail }) => {
  // Of a mouse: else Space and Enter would press the button again instead of driving. Who uses the keyboard stays there.
  if (detail && input.drives) setTimeout(() => document.activeElement.matches(".buttons *") && document.activeElement.blur());
});
element("show-numbers").addEventListener("change", ({ target }) => {
  element("numbers").hidden = !target.checked;
  if (target.checked) connection.send({ kind: "numbers" });
});
element("show-numbers").checked = new URLSearchParams(location.search).has("numbers");
element("numbers").hidden = !element("show-numbers").checked;

setInterval(() => {
  if (!screen || !connection.isOpen || !status.going_on) return;
  const { latencyMs, framesPerSecond, dropped } = screen.figures;
  say("connection", `Key to screen ${latencyMs ?? "–"} ms · ${framesPerSecond.toFixed(0)} frames/s · ${dropped} dropped`);
}, 500);

// For tests and measurements: what the page shows, as values.
window.teleop = { status, input, get figures() { return screen?.figures; } };
