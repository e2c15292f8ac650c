// Shows the overlay on top of the picture. All text is set as text, never as HTML.

const byId = (id) => document.getElementById(id);

/// Gives `parent` one child per row, and reuses those that are there.
function keep(parent, count, make) {
  while (parent.childElementCount > count) parent.lastElementChild.remove();
  while (parent.childElementCount < count) parent.append(make());
  return [...parent.children];
}

function element(tag, className, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

const kLabelClasses = ["pin", "point", "value", "handle"];
const kStatus = {
  connecting: 0,
  loading: 1,
  ready: 2,
  lost: 3,
  refused: 4
};
const kStatusText = ["Connecting …", "Loading …", "", "Connection lost", "Refused"];

/// `check()` shows what the scene's host sends; null with a server of ours.
export function makeOverlay(core, {ratio, press, retry, check}) {
  const annotations = [];
  let labelsShown = "";
  let closedByUs = false;  // the next "close" of the help dialog is our own doing

  function showLabels(labels) {
    const signature = labels.map((row) => row[1] + ":" + row[2]).join();
    const box = byId("labels");
    if (signature !== labelsShown) {
      // Labels rarely come or go; moving ones keep their element, and with it the keyboard's focus.
      box.replaceChildren(...labels.map(([, kind, index]) => makeLabel(Number(kind), Number(index))));
      labelsShown = signature;
    }
    [...box.children].forEach((at, i) => {
      const [, kind, , x, y, visible, rough, open, text] = labels[i];
      at.hidden = visible !== "1";
      at.classList.toggle("rough", rough === "1");
      at.classList.toggle("open", open === "1");
      const words = at.firstElementChild;
      if (words && words.textContent !== text) words.textContent = text;
      if (kind === "0") at.setAttribute("aria-label", `Note: ${text}`);
      at.style.transform = `translate(${Number(x) / ratio()}px, ${Number(y) / ratio()}px)`;
    });
  }

  function makeLabel(kind, index) {
    const at = element(kind === 0 ? "button" : "div", "label " + kLabelClasses[kind]);
    if (kind === 0) {
      at.type = "button";
      at.addEventListener(
          "click", () => press(() => core.call("showAnnotation", at.classList.contains("open") ? -1 : index)));
    }
    if (kind === 0 || kind === 2) at.append(element("span"));
    return at;
  }

  function showLines(lines) {
    const made =
        keep(byId("lines"), lines.length, () => document.createElementNS("http://www.w3.org/2000/svg", "line"));
    made.forEach((line, i) => {
      const [, x0, y0, x1, y1, rough] = lines[i];
      const place = {x1: x0, y1: y0, x2: x1, y2: y1};
      for (const [name, value] of Object.entries(place)) line.setAttribute(name, Number(value) / ratio());
      line.classList.toggle("rough", rough === "1");
    });
  }

  function showToasts(toasts) {
    const made = keep(byId("toasts"), toasts.length, () => element("div"));
    made.forEach((at, i) => {
      const [, , error, text] = toasts[i];
      at.classList.toggle("error", error === "1");
      if (at.textContent !== text) at.textContent = text;
    });
  }

  function showStatus([, kindText, text, advice]) {
    const kind = Number(kindText);
    const line = kind === kStatus.lost ? text || kStatusText[kind] : kStatusText[kind];
    const state = byId("state");
    if (state.textContent !== line) state.textContent = line;
    byId("title").hidden = byId("name").textContent === "" && line === "";
    // There is nothing to look at yet, and nothing will come by itself, so the problem is shown in the middle of the
    // page.
    const bare = byId("name").textContent === "";
    if (kind === kStatus.refused || (kind === kStatus.lost && bare))
      showProblem(text || kStatusText[kind], advice, retry);
    else if (!fatal)
      byId("problem").hidden = true;
  }

  let fatal = false;
  function showProblem(title, advice, again) {
    const box = byId("problem");
    box.querySelector("h2").textContent = title;
    box.querySelector("p").textContent = advice;
    const button = box.querySelector(".again");
    button.hidden = !again;
    button.onclick = again;
    byId("problem-check").hidden = !check;
    byId("problem-check").onclick = check;
    box.hidden = false;
  }

  function showCard(row) {
    const card = byId("card");
    const annotation = row && annotations[Number(row[1])];
    card.hidden = !annotation;
    if (!annotation) return;
    byId("card-title").textContent = annotation.title;
    byId("card-text").textContent = annotation.text;
  }

  function showLegend(shown) {
    const box = byId("legend");
    box.hidden = !shown;
    if (!shown || box.childElementCount > 1) return;
    const steps = core.rows("legend");
    steps.forEach(([pixels, ...color], i) => {
      const row = element("span");
      const swatch = element("i");
      swatch.style.background = `rgb(${color.join()})`;
      row.append(swatch, i + 1 < steps.length ? `up to ${pixels}` : "more");
      box.append(row);
    });
  }

  function showHelp(shown) {
    const dialog = byId("help");
    if (shown && !dialog.open) {
      const list = dialog.querySelector("dl");
      list.replaceChildren(
          ...core.rows("help").flatMap(([input, effect]) => [element("dt", "", input), element("dd", "", effect)]));
      dialog.showModal();
    } else if (!shown && dialog.open) {
      closedByUs = true;
      dialog.close();
    }
  }

  // The client closes the help, whoever asked for it: events of the dialog come late, and could meet the next opening.
  const help = byId("help");
  const helpGone = () => press(() => core.call("showHelp", 0));
  for (const wish of ["cancel", "submit"])
    help.addEventListener(wish, (event) => {
      event.preventDefault();
      helpGone();
    });
  help.addEventListener("close", () => {
    if (!closedByUs) helpGone();
    closedByUs = false;
  });
  byId("card").querySelector(".close").addEventListener("click", () => press(() => core.call("showAnnotation", -1)));

  let version = -1;
  return {
    annotations,
    /// Shows a problem that waiting cannot solve.
    problem(title, advice, again) {
      fatal = true;
      showProblem(title, advice, again);
    },
    update() {
      const now = core.call("overlayVersion");
      if (now === version) return;
      version = now;
      const rows = core.rows("overlay");
      const all = (name) => rows.filter((row) => row[0] === name);
      const one = (name) => rows.find((row) => row[0] === name);
      const [, name] = one("scene");
      if (byId("name").textContent !== name) {
        byId("name").textContent = name;
        document.title = name ? `${name} - Lumigrid` : "Lumigrid";
      }
      showStatus(one("status"));
      const [, active, share] = one("progress");
      const bar = byId("bar");
      bar.hidden = active !== "1";
      bar.firstElementChild.style.width = `${100 * Number(share)}%`;
      bar.setAttribute("aria-valuenow", Math.round(100 * Number(share)));
      const [, mode, hint] = one("mode");
      byId("hint").hidden = hint === "";
      if (byId("hint").textContent !== hint) byId("hint").textContent = hint;
      byId("view").classList.toggle("measuring", mode !== "0");
      const [, statistics, colours, orthographic, section, lens] = one("view");
      byId("statistics").hidden = statistics !== "1";
      showLegend(colours === "1");
      const pressed = {i: statistics, c: colours, o: orthographic, x: section, l: lens, m: mode === "0" ? "0" : "1"};
      for (const [key, on] of Object.entries(pressed))
        byId(`tool-${key}`)?.setAttribute("aria-pressed", on === "1" ? "true" : "false");
      showToasts(all("toast"));
      showLabels(all("label"));
      showLines(all("line"));
      showCard(one("annotation"));
      showHelp(one("help")[1] === "1");
    },
    updateStatistics() {
      if (byId("statistics").hidden) return;
      const lines = core.rows("statistics");
      const rows = keep(byId("statistics").firstElementChild, lines.length, () => {
        const row = element("tr");
        row.append(element("th"), element("td"));
        return row;
      });
      rows.forEach((row, i) => {
        row.children[0].textContent = lines[i][0];
        row.children[1].textContent = lines[i][1];
      });
    },
  };
}
