// How keys are called, and how things sound.

const NAMES = {
  Space: "Space", ShiftLeft: "Shift", ShiftRight: "Shift right",
  ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", Period: ".", Semicolon: ";", Comma: ",",
  Slash: "/", Minus: "-", Equal: "=", BracketLeft: "[", BracketRight: "]", Quote: "'", Backquote: "`",
};
const HERTZ = { verified: [660, 880], rejected: [220, 165], over: [440], paused: [330] };
const NOTE_S = 0.12;

let letters = null;
navigator.keyboard?.getLayoutMap?.().then((map) => (letters = map), () => {});

/** A key's name on this keyboard, as far as the browser knows it. */
export function keyName(code) {
  return NAMES[code] ?? letters?.get(code) ?? code.replace(/^(Key|Digit)/, "").toLowerCase();
}

/** A few short notes. */
export function play(sound) {
  const notes = HERTZ[sound] ?? [];
  if (!notes.length) return;
  const context = new AudioContext();
  notes.forEach((hertz, index) => {
    const tone = new OscillatorNode(context, { frequency: hertz });
    const volume = new GainNode(context, { gain: 0.1 });
    tone.connect(volume).connect(context.destination);
    tone.start(context.currentTime + index * NOTE_S);
    tone.stop(context.currentTime + (index + 1) * NOTE_S);
    if (index === notes.length - 1) tone.onended = () => context.close();
  });
}
