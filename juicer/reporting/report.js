"use strict";
// Without this script the page says the same: episodes as plain text, every curve, no buttons to copy.
(() => {
  const make = (tag, text = "", attributes = {}) => {
    const element = document.createElement(tag);
    element.textContent = text;
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };

  const copied = async (text) => {
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Where the browser gives a page no clipboard, an old way still works.
      const area = make("textarea", text);
      document.body.append(area);
      area.select();
      const done = document.execCommand("copy");
      area.remove();
      return done;
    }
    return true;
  };

  const copyButton = (text) => {
    const button = make("button", "Copy", { type: "button", class: "copy" });
    button.addEventListener("click", async () => {
      button.textContent = (await copied(text)) ? "Copied" : "Select it and copy";
      setTimeout(() => (button.textContent = "Copy"), 2000);
    });
    return button;
  };

  const commandLine = (text) => {
    const line = make("div", "", { class: "command" });
    const pre = make("pre");
    pre.append(make("code", text));
    line.append(pre, copyButton(text));
    return line;
  };

  for (const line of document.querySelectorAll(".command")) {
    line.append(copyButton(line.querySelector("code").textContent));
  }

  for (const button of document.querySelectorAll(".seek")) {
    button.addEventListener("click", () => {
      const video = button.closest("article").querySelector("video");
      video.pause();
      video.currentTime = Number(button.dataset.seconds);
    });
  }

  for (const box of document.querySelectorAll(".legend input")) {
    box.hidden = false;
    box.addEventListener("change", () => {
      for (const line of document.querySelectorAll(`.run-group-${box.dataset.group}`)) {
        line.style.display = box.checked ? "" : "none";
      }
    });
  }

  // The episodes of a model become a table when they are unfolded for the first time: there may be thousands.
  const COLUMNS = ["episode", "initial state", "outcome", "parts", "steps", "milestones"];
  const MILESTONES = 5;
  const filter = document.getElementById("outcome");
  const tables = [];

  const parsed = (text) =>
    text.split("\n").filter(Boolean).map((line) => {
      const cells = line.split("\t");
      const reached = cells[MILESTONES] === "none" ? [] : cells[MILESTONES].split(", ");
      return { cells, reached };
    });

  const sortKey = (row, column) => {
    if (column === MILESTONES) return row.reached.length;
    const number = Number(row.cells[column]);
    return Number.isNaN(number) ? row.cells[column] : number;
  };

  const tableRow = (row, model) => {
    const line = make("tr");
    row.cells.forEach((cell, column) => {
      const last = row.reached.at(-1);
      const told = column === MILESTONES ? `${row.reached.length} of ${model.dataset.milestones}` : cell;
      const field = make("td", told, { "data-label": COLUMNS[column] });
      if (column === MILESTONES && last) field.append(make("span", `, last ${last}`, { class: "note" }));
      if (column === 2) field.className = cell === "success" ? "good" : "bad";
      line.append(field);
    });
    const button = make("button", "Replay", { type: "button", "aria-expanded": "false" });
    const field = make("td", "", { class: "action" });
    field.append(button);
    line.append(field);
    button.addEventListener("click", () => {
      if (row.details) {
        row.details.remove();
        row.details = null;
      } else {
        row.details = make("tr", "", { class: "details" });
        const wide = make("td", "", { colspan: COLUMNS.length + 1 });
        const steps = row.reached.length ? row.reached.join(", ") : "none";
        wide.append(make("p", `Milestones and their steps: ${steps}`, { class: "note" }));
        wide.append(commandLine(`juicer replay ${model.dataset.evaluation} --episode ${row.cells[0]}`));
        row.details.append(wide);
        line.after(row.details);
      }
      button.setAttribute("aria-expanded", String(Boolean(row.details)));
    });
    return line;
  };

  const unfolded = (model) => {
    const text = model.querySelector(".rows");
    const rows = parsed(text.textContent);
    const table = make("table", "", { class: "folding episodes" });
    const head = make("tr");
    const body = make("tbody");
    const state = { column: 0, sign: 1 };
    const show = () => {
      const wanted = rows.filter((row) => !filter.value || row.cells[2] === filter.value);
      wanted.sort((a, b) => {
        const [left, right] = [sortKey(a, state.column), sortKey(b, state.column)];
        return state.sign * (left < right ? -1 : left > right ? 1 : 0);
      });
      for (const row of rows) row.details = null;
      body.replaceChildren(...wanted.map((row) => tableRow(row, model)));
      if (!wanted.length) {
        const none = make("tr");
        none.append(make("td", "None ended so.", { colspan: COLUMNS.length + 1, class: "note" }));
        body.append(none);
      }
      [...head.children].slice(0, COLUMNS.length).forEach((cell, column) => {
        const sorted = state.column === column ? (state.sign > 0 ? "ascending" : "descending") : "none";
        cell.setAttribute("aria-sort", sorted);
      });
    };
    COLUMNS.forEach((name, column) => {
      const cell = make("th", "", { scope: "col" });
      const button = make("button", name, { type: "button", class: "sort" });
      button.addEventListener("click", () => {
        state.sign = state.column === column ? -state.sign : 1;
        state.column = column;
        show();
      });
      cell.append(button);
      head.append(cell);
    });
    head.append(make("th"));
    const group = make("thead");
    group.append(head);
    table.append(group, body);
    text.replaceWith(table);
    show();
    tables.push(show);
  };

  const models = [...document.querySelectorAll("details.model")];
  for (const model of models) {
    model.addEventListener("toggle", () => {
      if (model.open && model.querySelector(".rows")) unfolded(model);
    });
  }
  if (models.length) {
    const found = models.flatMap((model) => parsed(model.querySelector(".rows").textContent).map((row) => row.cells[2]));
    for (const outcome of new Set(found)) filter.append(make("option", outcome));
    filter.addEventListener("change", () => tables.forEach((show) => show()));
    const unfold = document.getElementById("unfold");
    unfold.addEventListener("click", () => {
      const open = !models.every((model) => model.open);
      for (const model of models) model.open = open;
      unfold.textContent = open ? "Fold all" : "Unfold all";
    });
    document.querySelector(".controls").hidden = false;
  }
})();
