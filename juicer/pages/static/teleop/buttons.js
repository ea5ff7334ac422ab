// Buttons, those among them that ask before they do what cannot be undone.

const ASKED_FOR_MS = 5000;
const DOUBLE_CLICK_MS = 500;

export function button(text, action) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.addEventListener("click", action);
  return made;
}

/** A button whose first press asks; the question goes away with the focus, or after a few seconds. */
export function askingButton(text, question, action) {
  let askedAt = null;
  let timer = null;
  const takeBack = () => {
    clearTimeout(timer);
    askedAt = null;
    made.textContent = text;
  };
  const ask = (now) => {
    askedAt = now;
    made.textContent = question;
    timer = setTimeout(takeBack, ASKED_FOR_MS);
  };
  const made = button(text, ({ detail, timeStamp }) => {
    if (askedAt === null) ask(timeStamp);
    // The second click of a double click is no answer to a question that only just appeared.
    else if (detail <= 1 && timeStamp - askedAt > DOUBLE_CLICK_MS) {
      takeBack();
      action();
    }
  });
  made.addEventListener("blur", takeBack);
  // Nor is a key that is still held.
  made.addEventListener("keydown", (event) => event.repeat && event.preventDefault());
  return made;
}
