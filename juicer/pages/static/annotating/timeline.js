// Signals of a demonstration, one below the other, with one cursor, and every mark on them.

import { prepared } from "./sheets.js";

const PADDING = 6;

function tracks(signals, state) {
  return [
    { name: "gripper", unit: "mm", factor: 1000, values: signals.gripper_width_m, filled: signals.closing },
    { name: "height", unit: "mm", factor: 1000, values: signals.height_m },
    { name: "speed", unit: "mm/s", factor: 1000, values: signals.speed_m_s },
    { name: "contacts", unit: "", factor: 1, values: signals.contacts },
    { name: "to target", unit: "mm", factor: 1000, values: signals.distance_m[state] ?? signals.distance_m[0] },
  ];
}

/** Where the plot begins and ends, in CSS pixels of the canvas. */
function bounds(canvas, em) {
  return { left: 5.4 * em, right: canvas.clientWidth - 5.4 * em };
}

/** Step at a place of the canvas. */
export function stepAt(canvas, steps, x) {
  const { left, right } = bounds(canvas, textSize());
  return Math.max(0, Math.min(steps - 1, Math.round(((x - left) / (right - left)) * (steps - 1))));
}

function textSize() {
  return 0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize);
}

/** Draw it: `marks` are {step, words, kind} with kind "proposal", "other" or "own". */
export function drawTimeline(canvas, episode, signals, state, cursor, marks) {
  const em = textSize();
  const row = 2.2 * em;
  const top = 1.5 * em;
  const rows = signals ? tracks(signals, state) : [];
  const { context, height } = prepared(canvas, Math.round(top + 5 * row + 0.3 * em));
  const { left, right } = bounds(canvas, em);
  const colour = (name) => getComputedStyle(canvas).getPropertyValue(name).trim();
  const x = (step) => left + (step / Math.max(1, episode.steps - 1)) * (right - left);
  const font = getComputedStyle(canvas).fontFamily;
  context.font = `${em}px ${font}`;
  context.textBaseline = "middle";
  rows.forEach((track, index) => {
    const y = top + index * row;
    const low = Math.min(...track.values);
    const high = Math.max(...track.values, low + 1e-6);
    const at = (value) => y + row - PADDING / 2 - ((value - low) / (high - low)) * (row - PADDING);
    context.strokeStyle = colour("--grid");
    context.beginPath();
    context.moveTo(left, y + row - 0.5);
    context.lineTo(right, y + row - 0.5);
    context.stroke();
    if (track.filled) {
      context.fillStyle = colour("--grid");
      track.filled.forEach((closing, step) => closing && context.fillRect(x(step), y + 1, x(1) - x(0) + 0.5, row - 2));
    }
    context.strokeStyle = colour("--second");
    context.lineWidth = 1.5;
    context.beginPath();
    track.values.forEach((value, step) => (step ? context.lineTo(x(step), at(value)) : context.moveTo(x(step), at(value))));
    context.stroke();
    context.lineWidth = 1;
    context.fillStyle = colour("--muted");
    context.textAlign = "right";
    context.fillText(track.name, left - 0.5 * em, y + row / 2);
    context.textAlign = "left";
    context.fillStyle = colour("--ink");
    context.fillText(`${(track.values[cursor] * track.factor).toFixed(0)} ${track.unit}`, right + 0.5 * em, y + row / 2);
  });
  for (const mark of marks) drawMark(context, mark, x(mark.step), top, height, em, colour);
  context.strokeStyle = context.fillStyle = colour("--ink");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x(cursor), top - 2);
  context.lineTo(x(cursor), height);
  context.stroke();
  context.lineWidth = 1;
  context.textAlign = "left";
  context.fillText(`step ${cursor}`, right + 0.5 * em, top / 2);
}

/** A proposal is dashed with a triangle, somebody else's a faint line with a name, one's own a full line with a square. */
function drawMark(context, mark, x, top, height, em, colour) {
  const own = mark.kind === "own";
  context.save();
  context.strokeStyle = context.fillStyle = colour(mark.kind === "proposal" ? "--accent" : own ? "--good" : "--muted");
  context.globalAlpha = mark.kind === "other" ? 0.75 : 1;
  context.setLineDash(mark.kind === "proposal" ? [5, 4] : []);
  context.lineWidth = own ? 2 : 1.5;
  context.beginPath();
  context.moveTo(x, top);
  context.lineTo(x, height);
  context.stroke();
  context.beginPath();
  if (mark.kind === "proposal") {
    context.moveTo(x - 0.4 * em, top - 0.6 * em);
    context.lineTo(x + 0.4 * em, top - 0.6 * em);
    context.lineTo(x, top);
  } else {
    context.rect(x - 0.3 * em, top - 0.6 * em, 0.6 * em, 0.6 * em);
  }
  if (mark.kind === "other") context.stroke();
  else context.fill();
  context.textAlign = mark.side < 0 ? "right" : "left";
  context.fillText(mark.words, x + mark.side * 0.6 * em, top / 2);
  context.restore();
}
