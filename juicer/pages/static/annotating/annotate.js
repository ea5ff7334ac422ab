// The page on which critical states are marked: what the keys do.

import { Effort } from "./effort.js";
import { KEYS, actionOf, nameOf, written } from "./keys.js";
import { AGREEMENTS_BEFORE_OFFER, Queue, SAMPLE, SURE, own, sampleOf, startOf } from "./queue.js";
import { Server } from "./server.js";
import { Sheets } from "./sheets.js";
import { stepAt } from "./timeline.js";
import { Display, element, say } from "./display.js";

const POLL_MS = 400;
const AROUND = 5;
const MOST_TOGETHER = 500;
// What the server takes in one message.
const MOST_UNDONE = 2000;
const MOVES = new Set(["earlier", "later", "much-earlier", "much-later"]);
const setting = JSON.parse(element("annotate").dataset.setting);
const server = new Server(setting.address);
const effort = new Effort();
const signals = new Map();
let redraw = 0;
let explaining = null;
const sheets = new Sheets(setting.address, setting.sheet, (sheet) => {
  // An image does not say why it failed; of those that fail together, one is asked.
  if (sheet.failed) explaining ??= server.get(sheet.path).catch((error) => trouble(error.message)).finally(() => { explaining = null; });
  draw();
});
const display = new Display(setting, sheets);

let queue = new Queue([]);
let entry = null;
let cursor = 0;
let history = [];
let agreements = 0;
let audit = null;

const author = () => element("author").value.trim();
const which = () => element("which").value;
const letters = () => element("letters").checked;

function draw() {
  if (!redraw) redraw = requestAnimationFrame(() => { redraw = 0; show(); });
}

function show() {
  display.show({ entry, cursor, queue, author: author(), which: which(), signals: entry && signals.get(entry.episode.id), sample: sampleLeft() });
}

function trouble(sentence) {
  display.notice("trouble", sentence && `${sentence[0].toUpperCase()}${sentence.slice(1)}.`);
  offer();
}

/** As long as there are marks that could not be saved, saving them again is offered, whatever else is wrong. */
function unsaved() {
  const failed = queue.entries.map((each) => each.pending).filter((mark) => mark?.failed);
  const kept = failed.filter((mark) => !mark.isFinal);
  const hopeless = failed.filter((mark) => mark.isFinal);
  const choices = [];
  if (kept.length) choices.push({ words: "Try again", key: "Enter", action: () => retry(kept) });
  if (hopeless.length) choices.push({ words: `Drop ${hopeless.length} that cannot be saved`, key: "Delete", action: () => drop(hopeless) });
  display.notice("unsaved", failed.length ? `${failed.length} not saved, but kept here: ${(hopeless[0] ?? failed[0]).failed}.` : "", choices);
  offer();
}

function retry(failed) {
  for (const mark of failed) Object.assign(mark, { failed: "", isFinal: false });
  unsaved();
  for (const batch of new Set(failed.map((mark) => mark.batch))) send(batch.filter((mark) => failed.includes(mark)));
}

/** Give marks up that the server does not take; their entries are to be judged again. */
function drop(marks) {
  for (const mark of marks) Object.assign(mark.entry, { pending: null, judged: false });
  history = history.map((batch) => batch.filter((mark) => !marks.includes(mark))).filter((batch) => batch.length);
  unsaved();
  go(marks[0].entry);
}

/** What was refused for its author's name is told again under the corrected one. */
function rename() {
  const hopeless = queue.entries.map((each) => each.pending).filter((mark) => mark?.isFinal && mark.author !== author());
  for (const mark of hopeless) mark.author = author();
  if (author() && hopeless.length) retry(hopeless);
}

/** Ask for all that is needed to judge an entry, before it is its turn. */
function prefetch(wanted) {
  if (!wanted) return;
  sheets.prefetch(wanted.episode, startOf(wanted, author()), AROUND);
  const id = wanted.episode.id;
  if (signals.has(id)) return;
  signals.set(id, null);
  server.get(`/${id}/signals`).then((found) => { signals.set(id, found); draw(); }, (error) => { signals.delete(id); trouble(error.message); });
}

function go(to) {
  entry = to;
  if (entry) {
    cursor = startOf(entry, author());
    display.examples(queue.entries, entry.state);
    prefetch(entry);
    const second = queue.next(entry, which(), author());
    prefetch(second);
    if (second) prefetch(queue.next(second, which(), author()));
    const proposal = entry.proposal ? `proposal at step ${entry.proposal.step}, confidence ${entry.proposal.confidence.toFixed(2)}` : "nothing was proposed";
    say(`${setting.states[entry.state].name}, ${entry.episode.log}: ${proposal}`);
  } else say("nothing is left to judge");
  conflict();
  offer();
  show();
}

/** Show both marks if there are two of an entry, with what can be done. */
function conflict() {
  const mine = entry?.pending?.refused ? [{ author: `${author()} (not saved yet)`, step: entry.pending.step }] : [];
  const all = entry ? [...entry.opinions, ...mine] : [];
  if (!entry || !(entry.disputed || mine.length) || all.length < 2) return display.notice("conflict", "");
  const isOwn = entry.opinions.every((each) => each.author === author());
  const choices = all.filter((each) => each.step !== null).map((each, index) => ({
    words: `${each.author}: step ${each.step}`, key: String(index + 1), action: () => settle(each.step, true), look: () => move(each.step),
  }));
  const more = (words, action) => choices.push({ words, key: String(choices.length + 1), action });
  more("The step shown below", () => settle(cursor, true));
  if (mine.length && !isOwn) more("Save mine as well, and leave it open", () => settle(entry.pending.step, false));
  const who = isOwn ? "You marked this critical state differently elsewhere." : "Two people marked this critical state differently.";
  const until = entry.disputed ? "the proposal" : "what is saved";
  display.notice("conflict", `${who} Which step is right?${isOwn ? "" : ` Until one is chosen, training uses ${until}.`}`, choices);
  say(who);
}

function settle(step, settles) {
  const settled = entry;
  save([settled], () => step, settles);
  judgeSample(settled, isAsProposed(settled, step));
  go(queue.next(settled, which(), author()));
}

/** Save marks of entries; the page goes on meanwhile, and keeps each as `pending` of its entry until it is saved. */
function save(entries, stepOf, settles = false) {
  const { keys, seconds } = effort.take();
  const marks = entries.map((each, index) => ({
    entry: each, author: author(), step: stepOf(each), settles, keys: index ? 0 : keys, seconds: index ? 0 : seconds,
  }));
  for (const mark of marks) Object.assign(mark.entry, { pending: mark, judged: true, sampled: false });
  history.push(marks);
  for (const batch of parts(marks, MOST_TOGETHER)) {
    for (const mark of batch) mark.batch = batch;
    send(batch);
  }
}

/** Marks in messages of so many. */
function parts(marks, most) {
  const count = Math.ceil(marks.length / most);
  return Array.from({ length: count }, (_, index) => marks.slice(index * most, (index + 1) * most));
}

/** Tell the server marks of one author; what came of a mark is known when its `sent` is over. */
function send(marks) {
  const body = () => {
    for (const mark of marks) mark.after = mark.entry.newest;
    return { author: marks[0].author, marks: marks.map(told) };
  };
  const sent = server.tell("/marks", body).then(({ status, content }) => {
    queue.update(content.marks);
    // Who has marked this has marked more, which is to leave the queue.
    if (status === 409) refresh();
    return answered(marks, status === 409 ? comeOf : () => "done");
  }, (error) => {
    for (const mark of marks) Object.assign(mark, { failed: error.message, isFinal: error.isFinal });
    unsaved();
    draw();
  });
  for (const mark of marks) mark.sent = sent;
  return sent;
}

const told = ({ entry: { episode, state }, after, step, settles, keys, seconds }) =>
  ({ episode: episode.id, critical_state: state, after, step, settles, keys, seconds });

const since = (mark) => mark.entry.opinions.filter((each) => each.version > mark.after);

/** What was saved of a mark, if it was. */
const savedAs = (mark) => since(mark).find((each) => each.author === mark.author && each.step === mark.step);

/** What comes of a mark among marks that the server did not save, because there was something newer about one of them. */
function comeOf(mark) {
  // The answer to an earlier attempt was lost, or a later mark has taken its place.
  if (mark.entry.pending !== mark || savedAs(mark)) return "done";
  return since(mark).every((each) => isSame(each.step, mark.step)) ? "again" : "refused";
}

function answered(marks, outcomeOf) {
  const { done = [], refused = [], again = [] } = Object.groupBy(marks, outcomeOf);
  for (const mark of done) {
    mark.version = savedAs(mark)?.version;
    if (mark.entry.pending === mark) mark.entry.pending = null;
  }
  for (const mark of refused) mark.refused = true;
  history = history.map((batch) => batch.filter((mark) => !mark.refused)).filter((batch) => batch.length);
  const sent = again.length ? send(again) : null;
  display.measured(server);
  const disputed = which() === "disputed" ? undefined : done.find((mark) => mark.entry.disputed);
  const open = refused[0] ?? disputed;
  if (open) go(open.entry);
  else if (!again.length) say("saved");
  draw();
  return sent;
}

function accept(goOn) {
  if (!entry) return;
  if (!author()) {
    trouble("say first who you are: what is saved names its author");
    element("author").focus();
    return;
  }
  // Whoever goes on quickly must not decide by the way.
  if (!element("conflict").hidden) return say("choose first which of the marks is right");
  trouble("");
  const accepted = entry;
  const agrees = isAsProposed(accepted, cursor);
  agreements = agrees ? agreements + 1 : 0;
  save([accepted], () => cursor);
  accepted.cursor = null;
  judgeSample(accepted, agrees);
  const same = queue.entries.filter((each) => each.episode === accepted.episode && queue.isWanted(each, which(), author()));
  go(goOn ? queue.next(accepted, which(), author()) : same[0] ?? accepted);
}

const isSame = (one, other) => one !== null && Math.abs(one - other) <= setting.same;

const isAsProposed = (each, step) => Boolean(each.proposal) && isSame(each.proposal.step, step);

/** Offer to accept the rest together, once a few proposals were right. */
function offer() {
  const sure = ["open", "mine"].includes(which()) ? queue.sure(which(), author()) : [];
  const isBusy = audit || ["conflict", "trouble", "unsaved"].some((id) => !element(id).hidden);
  if (isBusy || agreements < AGREEMENTS_BEFORE_OFFER || sure.length <= SAMPLE) return display.notice("offer", "");
  display.notice("offer", `${agreements} proposals in a row were right. The ${sure.length} that are left above ${SURE} can be accepted together, after you have seen ${SAMPLE} of them.`,
    [{ words: `Draw ${SAMPLE} at random, and accept the others if these are right`, key: "a", action: startAudit }]);
}

function startAudit() {
  const sure = queue.sure(which(), author());
  const sample = sampleOf(sure, SAMPLE);
  for (const each of sample) each.sampled = true;
  audit = { sample, rest: sure.filter((each) => !each.sampled) };
  display.notice("offer", "");
  go(queue.next(null, which(), author()));
}

/** How many of the sample are still to be judged. */
const sampleLeft = () => (audit ? audit.sample.filter((each) => each.sampled).length : 0);

/** The sample is over when all of it was right, or one was not: on a second look as well. */
function judgeSample(judged, agrees) {
  if (!isOfSample(judged)) return;
  if (!agrees) {
    for (const each of audit.sample) each.sampled = false;
    audit = null;
    agreements = 0;
    trouble("one of the sample was wrong, so the others are shown one by one");
  } else if (!sampleLeft()) {
    const rest = audit.rest.filter((each) => queue.isWanted(each, which(), author()));
    audit = null;
    agreements = 0;
    if (rest.length) save(rest, (each) => each.proposal.step);
    say(`${rest.length} accepted together`);
  }
}

const isOfSample = (each) => Boolean(audit?.sample.includes(each));

/** Take back what the annotator saved last, all of it or none; one of a sample is then still to be judged. */
async function undo() {
  const place = history.findLastIndex((marks) => marks[0].author === author());
  const mine = entry && own(entry, author());
  const undone = place >= 0 ? history.splice(place, 1)[0] : mine ? [{ entry, author: mine.author, version: mine.version }] : [];
  if (!undone.length) return say("there is nothing to undo");
  trouble("");
  agreements = 0;
  try {
    await takeBack(undone);
  } catch (error) {
    history.push(undone);
    const gone = undone.filter((mark) => mark.isUndone).length;
    const what = gone ? `${gone} of ${undone.length} were undone, and the rest` : "nothing was undone, and it";
    return trouble(`${what} can be tried again: ${error.message}`);
  }
  for (const mark of undone) {
    const each = mark.entry;
    Object.assign(each, { judged: false, sampled: isOfSample(each) });
    if (!mark.version) each.cursor = mark.step;
    if (each.pending === mark) each.pending = null;
  }
  unsaved();
  display.measured(server);
  go(undone[0].entry);
  say("undone");
}

/** Have those of some marks taken back that were saved; throws a sentence, also if there is something newer about one. */
async function takeBack(marks) {
  const { keys, seconds } = effort.take();
  await Promise.all(marks.map((mark) => mark.sent));
  // What could not be saved may have been: its answer may be all that was lost.
  if (marks.some((mark) => mark.failed)) await update();
  for (const mark of marks) mark.version ??= savedAs(mark)?.version;
  const saved = marks.filter((mark) => mark.version);
  // When a later part fails, all are tried again: the server takes nothing back twice.
  for (const [index, part] of parts(saved, MOST_UNDONE).entries()) await takeBackTogether(part, index ? 0 : keys, index ? 0 : seconds);
}

async function takeBackTogether(marks, keys, seconds) {
  const body = () => {
    for (const mark of marks) mark.after = mark.entry.newest;
    return { author: marks[0].author, marks: marks.map((mark, index) => ({
      episode: mark.entry.episode.id, critical_state: mark.entry.state, after: mark.after, undoes: mark.version,
      keys: index ? 0 : keys, seconds: index ? 0 : seconds,
    })) };
  };
  const { status, content } = await server.tell("/undo", body);
  queue.update(content.marks);
  if (status !== 409) return marks.forEach((mark) => { mark.isUndone = true; });
  const newer = marks.find((mark) => mark.entry.newest !== mark.after);
  if (newer) go(newer.entry);
  throw new Error(content.error);
}

function move(to) {
  if (!entry) return;
  cursor = Math.max(0, Math.min(entry.episode.steps - 1, to));
  entry.cursor = cursor;
  sheets.prefetch(entry.episode, cursor, AROUND);
  draw();
}

function skip() {
  if (entry) go(queue.next(entry, which(), author()) ?? entry);
}

function nextDemonstration() {
  if (!entry) return;
  const last = queue.entries.filter((each) => each.episode === entry.episode).at(-1);
  go(queue.next(last, which(), author()) ?? entry);
}

const ACTIONS = {
  accept: () => accept(true),
  mark: () => accept(false),
  earlier: () => move(cursor - 1),
  later: () => move(cursor + 1),
  "much-earlier": () => move(cursor - 10),
  "much-later": () => move(cursor + 10),
  first: () => move(0),
  last: () => move(Infinity),
  "to-proposal": () => entry?.proposal && move(entry.proposal.step),
  "next-demonstration": nextDemonstration,
  skip,
  back: () => entry && go(queue.entries.at(queue.entries.indexOf(entry) - 1)),
  undo,
  "accept-many": () => display.press("offer", "a"),
  help: () => element("keys").showModal(),
};

function pressed(event) {
  const name = nameOf(event);
  const dialog = element("keys");
  if (dialog.open) {
    if (name === "?" && !event.repeat) dialog.close();
    return;
  }
  if (event.target.matches("input, select, textarea")) return;
  const action = actionOf(name, letters());
  // A key that is held must not decide on what nobody has seen; on a button neither, which it would press again.
  if (event.repeat && !MOVES.has(action)) return action && event.preventDefault();
  const isOperated = event.target.closest("button, a, summary") && (name === "Enter" || name === "Space");
  if (isOperated) return;
  if (display.press("unsaved", name)) return event.preventDefault();
  const isChoice = /^[1-9]$/.test(name) && letters() && display.offers("conflict", name);
  if (!action && !isChoice) return;
  event.preventDefault();
  if (action !== "help") effort.note();
  if (isChoice) display.press("conflict", name);
  else ACTIONS[action]();
}

function listen() {
  document.addEventListener("keydown", pressed);
  for (const [id, action] of Object.entries({
    accept: "accept", earlier: "earlier", later: "later", "to-proposal": "to-proposal", undo: "undo", skip: "skip",
  })) element(id).addEventListener("click", ACTIONS[action]);
  document.addEventListener("click", (event) => event.target.closest("button") && effort.note(), { capture: true });
  element("show-keys").addEventListener("click", ACTIONS.help);
  const timeline = element("timeline");
  const seek = (event) => entry && move(stepAt(timeline, entry.episode.steps, event.offsetX));
  timeline.addEventListener("pointerdown", (event) => { effort.note(); timeline.setPointerCapture(event.pointerId); seek(event); });
  timeline.addEventListener("pointermove", (event) => event.buttons && seek(event));
  element("frames").addEventListener("click", (event) => { effort.note(); move(cursor + display.tileAt(event.offsetX)); });
  for (const id of ["author", "which", "letters"]) remember(id);
  element("which").addEventListener("change", () => { for (const each of queue.entries) each.judged = false; go(queue.next(null, which(), author())); });
  element("author").addEventListener("change", () => { trouble(""); rename(); go(queue.next(null, which(), author())); });
  element("author").addEventListener("keydown", (event) => event.key === "Enter" && element("timeline").focus());
  addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("beforeunload", (event) => (server.waiting || queue.entries.some((each) => each.pending)) && event.preventDefault());
  document.addEventListener("visibilitychange", () => !document.hidden && entry && refresh());
}

/** What was chosen on this page is chosen when it is opened again. */
function remember(id) {
  const input = element(id);
  const key = `annotate-${id}`;
  const kept = localStorage.getItem(key);
  if (input.type === "checkbox") input.checked = kept !== "false";
  else if (kept !== null) input.value = kept;
  input.addEventListener("change", () => localStorage.setItem(key, input.type === "checkbox" ? input.checked : input.value));
}

/** Take over what others have said meanwhile. */
async function refresh() {
  try {
    await update();
    draw();
  } catch (error) {
    trouble(error.message);
  }
}

async function update() {
  const work = await server.get("/work");
  queue.update(work.episodes.flatMap((episode) => episode.marks.map((mark) => ({ episode: episode.id, ...mark }))));
}

async function start() {
  for (;;) {
    const work = await server.get("/work");
    display.progress(work);
    if (work.ready) {
      queue = new Queue(work.episodes);
      display.measures(work.measures);
      go(queue.next(null, which(), author()));
      element(author() ? "timeline" : "author").focus();
      return;
    }
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
}

element("key-list").replaceChildren(...KEYS.map(({ keys, words }) => display.keyRow(keys.map(written), words)));
listen();
start().catch((error) => trouble(error.message));
