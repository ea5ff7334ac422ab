// An episode step by step. What is shown is addressed by its step: sheets of small images while one scrubs,
// and one large image of the step at which one stays.

import { NO_ANSWER } from "./answers.js";

const SHEET = 50, COLUMNS = 10, WIDTH = 160, FRONT = 120, WRIST = 90;
const KEPT_SHEETS = 12, OVERVIEW = 12, SETTLED_MS = 120;

const frames = document.querySelector("#frames");
const { artifact, episode } = frames.dataset;
const length = Number(frames.dataset.length), hz = Number(frames.dataset.hz);
const screen = document.querySelector("#screen"), pen = screen.getContext("2d");
const position = document.querySelector("#position"), where = document.querySelector("#where");
const correct = document.querySelector("#correct");
const play = document.querySelector("#play"), speed = document.querySelector("#speed");

const sheets = new Map();
let step = Math.min(Number(frames.dataset.frame), length);
let settling = 0, request = new AbortController();

async function image(name, parameters, signal) {
  const query = new URLSearchParams({ artifact, episode, ...parameters });
  let answer, content;
  try {
    answer = await fetch(`/episodes/${name}.jpg?${query}`, { signal });
    content = await answer.blob();
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error(NO_ANSWER);
  }
  if (!answer.ok) throw new Error(await refusal(answer.status, content));
  return createImageBitmap(content);
}

async function refusal(status, content) {
  try {
    return JSON.parse(await content.text()).error ?? `the server answers ${status}`;
  } catch {
    return `the server answers ${status}; reload this page`;
  }
}

function sheetOf(wanted) {
  const first = wanted - (wanted % SHEET);
  let sheet = sheets.get(first);
  if (!sheet) {
    sheet = { loading: image("sheet", { first, count: SHEET }), bitmap: null };
    sheet.loading.then((bitmap) => { sheet.bitmap = bitmap; }, (error) => {
      // Whoever asks for it next may have more luck.
      if (sheets.get(first) === sheet) sheets.delete(first);
      stop();
      say(error);
    });
    if (sheets.size >= KEPT_SHEETS) sheets.delete(sheets.keys().next().value);
    sheets.set(first, sheet);
  }
  return sheet;
}

function say(error) {
  if (error.name === "AbortError") return;
  const sentence = `${error.message.charAt(0).toUpperCase()}${error.message.slice(1)}.`;
  document.querySelector("#announcements").textContent = sentence;
  where.textContent = sentence;
}

function drawSmall(bitmap, place) {
  const [x, y] = [(place % COLUMNS) * WIDTH, Math.floor(place / COLUMNS) * (FRONT + WRIST)];
  pen.drawImage(bitmap, x, y, WIDTH, FRONT, 0, 0, 480, 360);
  pen.drawImage(bitmap, x, y + FRONT, WIDTH, WRIST, 480, 0, 640, 360);
}

function show(wanted) {
  step = Math.max(0, Math.min(length, wanted));
  position.value = step;
  const told = step === length ? `end, ${step}` : `step ${step} of ${length}`;
  where.textContent = `${told}, ${(step / hz).toFixed(1)} s`;
  position.setAttribute("aria-valuetext", told);
  if (correct) correct.href = `/teleop?${new URLSearchParams({ artifact, episode, frame: step })}`;
  const sheet = sheetOf(step), asked = step;
  if (sheet.bitmap) drawSmall(sheet.bitmap, step % SHEET);
  else sheet.loading.then((bitmap) => { if (step === asked) drawSmall(bitmap, asked % SHEET); }, () => {});
  mark();
  request.abort();
  clearTimeout(settling);
  settling = setTimeout(settle, SETTLED_MS);
}

function mark() {
  for (const button of strip.children) {
    const isCurrent = Number(button.dataset.step) <= step && step < Number(button.dataset.next);
    if (isCurrent) button.setAttribute("aria-current", "step");
    else button.removeAttribute("aria-current");
  }
}

async function settle() {
  if (playing) return;
  history.replaceState(null, "", `?${new URLSearchParams({ artifact, episode, frame: step })}`);
  request = new AbortController();
  const asked = step;
  try {
    const bitmap = await image("still", { frame: asked }, request.signal);
    if (step === asked && !playing) pen.drawImage(bitmap, 0, 0);
    if (asked - (asked % SHEET) + SHEET <= length) sheetOf(asked - (asked % SHEET) + SHEET);
    await overview();
  } catch (error) {
    say(error);
  }
}

let playing = false, began = 0, from = 0;

function toggle() {
  playing = !playing;
  if (playing && step === length) show(0);
  play.textContent = playing ? "Pause" : "Play";
  play.setAttribute("aria-pressed", playing);
  if (!playing) return settle();
  [began, from] = [performance.now(), step];
  requestAnimationFrame(advance);
}

function advance(now) {
  if (!playing) return;
  const wanted = from + Math.floor(((now - began) / 1000) * hz * Number(speed.value));
  const ahead = wanted - (wanted % SHEET) + SHEET;
  if (ahead <= length) sheetOf(ahead);
  // Where images are not there yet, playing waits: every step is shown.
  if (!sheetOf(Math.min(wanted, length)).bitmap) [began, from] = [now, step];
  else if (wanted !== step) show(wanted);
  if (step >= length) return toggle();
  requestAnimationFrame(advance);
}

const strip = document.querySelector("#strip");
let isFilling = false;

async function overview() {
  if (isFilling || strip.children.length) return;
  const stride = Math.max(1, Math.ceil((length + 1) / OVERVIEW));
  isFilling = true;
  const bitmap = await image("sheet", { first: 0, stride, count: OVERVIEW }).finally(() => { isFilling = false; });
  for (let place = 0, its = 0; its <= length; place += 1, its += stride) {
    const button = document.createElement("button"), canvas = document.createElement("canvas");
    Object.assign(canvas, { width: WIDTH, height: FRONT + WRIST });
    const [x, y] = [(place % COLUMNS) * WIDTH, Math.floor(place / COLUMNS) * (FRONT + WRIST)];
    canvas.getContext("2d").drawImage(bitmap, x, y, WIDTH, FRONT + WRIST, 0, 0, WIDTH, FRONT + WRIST);
    Object.assign(button, { type: "button", ariaLabel: `Step ${its}` });
    Object.assign(button.dataset, { step: its, next: its + stride });
    button.append(canvas);
    strip.append(button);
  }
  mark();
}

function stop() {
  if (playing) toggle();
}

position.addEventListener("input", () => { stop(); show(Number(position.value)); });
play.addEventListener("click", toggle);
speed.addEventListener("change", () => { [began, from] = [performance.now(), step]; });
frames.addEventListener("click", (event) => {
  const target = event.target.closest("[data-step]");
  if (target) { stop(); show(Number(target.dataset.step)); }
});

const moves = {
  ArrowLeft: (far) => step - far,
  ArrowRight: (far) => step + far,
  Home: () => 0,
  End: () => length,
};
addEventListener("keydown", (event) => {
  const at = event.target;
  if (event.ctrlKey || event.metaKey || event.altKey || at.matches("select")) return;
  if (at !== document.body && !frames.contains(at) && at.id !== "main") return;
  if (event.code in moves) {
    stop();
    show(moves[event.code](event.shiftKey ? 10 : 1));
  } else if (event.code === "Space" && !at.matches("button")) {
    toggle();
  } else return;
  event.preventDefault();
});

show(step);
overview().catch(say);
