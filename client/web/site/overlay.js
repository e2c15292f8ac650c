// Shows the overlay on top of the picture.
import {element, svgElement} from "./dom.js";

const byId = (id) => document.getElementById(id);

/// Gives `parent` one child per row, and reuses those that are there.
function resizeChildren(parent, count, make) {
  while (parent.childElementCount > count) parent.lastElementChild.remove();
  while (parent.childElementCount < count) parent.append(make());
  return [...parent.children];
}

const kLabelClasses = ["pin", "point", "value", "handle"];
const kLost = 3, kRefused = 4;  // as Status::Kind in client/app/app.h
/// The progress bar grows by so many percent at a time: each time the browser puts the whole page together anew, which
/// takes software GL about 15 ms of the cores that decode.
const kBarStep = 5;
const kStatusText = ["Connecting …", "Loading …", "", "Connection lost", "Refused"];

/// Shows a problem in the middle of the page, with buttons for what `again` and `check` are there.
export function showProblem(title, advice, again, check) {
  const box = byId("problem");
  box.querySelector("h2").textContent = title;
  box.querySelector("p").textContent = advice;
  for (const [button, act] of [[box.querySelector(".again"), again], [byId("problem-check"), check]])
    Object.assign(button, {hidden: !act, onclick: act});
  box.hidden = false;
}

/// Shows the labels, lines and panels over the picture, of a method for which isStreamed() or not. `press(act)` runs
/// what a click does; `retry()` tries the server again; `check()` shows what the scene's host sends, and is null with a
/// server of ours.
export class Overlay {
  constructor(core, {streamed, ratio, press, retry, check}) {
    this.annotations = [];  // {title, text} by number
    this.background = "";   // the scene's, #rrggbb; empty: it has none
    this.core = core;
    this.options = {streamed, ratio, press, retry, check};
    this.labelsShown = "";
    this.closingHelp = false;  // the next "close" of the help dialog is our own doing
    this.fatal = false;
    this.version = -1;
    this.listenToHelp();
    byId("card").querySelector(".close").addEventListener("click", () => this.showAnnotation(-1));
  }

  /// Shows what has changed since the last call.
  update() {
    const now = this.core.call("overlayVersion");
    if (now === this.version) return;
    this.version = now;
    const rows = this.core.rows("overlay");
    const all = (name) => rows.filter((row) => row[0] === name);
    const one = (name) => rows.find((row) => row[0] === name);
    this.showScene(one("scene"));
    this.showStatus(one("status"));
    this.showProgress(one("progress"));
    this.showModes(one("mode"), one("view"));
    this.showToasts(all("toast"));
    this.showLabels(all("label"));
    this.showLines(all("line"));
    this.showCard(one("annotation"));
    this.showHelp(one("help")[1] === "1");
  }

  updateStatistics() {
    if (byId("statistics").hidden) return;
    const lines = this.core.rows("statistics");
    const makeRow = () => element("tr", {}, element("th"), element("td"));
    const rows = resizeChildren(byId("statistics").firstElementChild, lines.length, makeRow);
    rows.forEach((row, i) => [...row.children].forEach((cell, j) => (cell.textContent = lines[i][j])));
  }

  /// Shows a problem that waiting cannot solve.
  problem(title, advice, again) {
    this.fatal = true;
    showProblem(title, advice, again, this.options.check);
  }

  showScene([, name, , attribution, background, north]) {
    byId("north").toggleAttribute("hidden", !north);
    if (north) byId("north").firstElementChild.style.transform = `rotate(${north}rad)`;
    if (byId("name").textContent === name) return;
    byId("name").textContent = name;
    byId("attribution").textContent = attribution;
    document.title = name ? `${name} - Lumigrid` : "Lumigrid";
    this.showBackground(background);
  }

  /// Shows the scene's background in place of the theme's, and title and credits in ink that is seen on it.
  showBackground(background) {
    this.background = background;
    const {style, dataset} = document.documentElement;
    for (const stop of ["--near", "--far"]) style.setProperty(stop, background);
    const [red, green, blue] = [1, 3, 5].map((at) => parseInt(background.slice(at, at + 2), 16));
    dataset.ground = background && (0.3 * red + 0.59 * green + 0.11 * blue < 128 ? "dark" : "light");
  }

  showStatus([, kindText, text, advice]) {
    const kind = Number(kindText);
    const line = kind === kLost ? text || kStatusText[kind] : kStatusText[kind];
    const state = byId("state");
    if (state.textContent !== line) state.textContent = line;
    byId("title").hidden = byId("name").textContent === "" && line === "";
    // There is nothing to look at yet, and nothing will come by itself, so the problem is shown in the middle of the
    // page.
    const bare = byId("name").textContent === "";
    if (kind === kRefused || (kind === kLost && bare))
      showProblem(text || kStatusText[kind], advice, this.options.retry, this.options.check);
    else if (!this.fatal)
      byId("problem").hidden = true;
  }

  showProgress([, active, share]) {
    const bar = byId("bar");
    bar.hidden = active !== "1";
    const percent = kBarStep * Math.floor(100 * Number(share) / kBarStep);
    bar.firstElementChild.style.width = `${percent}%`;
    bar.setAttribute("aria-valuenow", percent);
  }

  showModes([, mode, hint], [, statistics, colours, orthographic, section, lens]) {
    byId("hint").hidden = hint === "";
    if (byId("hint").textContent !== hint) byId("hint").textContent = hint;
    byId("view").classList.toggle("measuring", mode !== "0");
    byId("statistics").hidden = statistics !== "1";
    this.showLegend(colours === "1");
    const pressed = {i: statistics, c: colours, o: orthographic, x: section, l: lens, m: mode === "0" ? "0" : "1"};
    for (const [key, on] of Object.entries(pressed))
      byId(`tool-${key}`)?.setAttribute("aria-pressed", on === "1" ? "true" : "false");
  }

  showLegend(shown) {
    const box = byId("legend");
    box.hidden = !shown;
    if (!shown || box.childElementCount > 1) return;
    const steps = this.core.rows("legend");
    steps.forEach(([pixels, ...color], i) => {
      const swatch = element("i");
      swatch.style.background = `rgb(${color.join()})`;
      box.append(element("span", {}, swatch, i + 1 < steps.length ? `up to ${pixels}` : "more"));
    });
    if (this.options.streamed) box.append(element("span", {}, "hatched: finer is to come"));
  }

  showToasts(toasts) {
    const made = resizeChildren(byId("toasts"), toasts.length, () => element("div"));
    made.forEach((at, i) => {
      const [, , error, text] = toasts[i];
      at.classList.toggle("error", error === "1");
      if (at.textContent !== text) at.textContent = text;
    });
  }

  showLabels(labels) {
    const signature = labels.map((row) => row[1] + ":" + row[2]).join();
    const box = byId("labels");
    if (signature !== this.labelsShown) {
      // Labels rarely come or go; moving ones keep their element, and with it the keyboard's focus.
      box.replaceChildren(...labels.map(([, kind, index]) => this.makeLabel(Number(kind), Number(index))));
      this.labelsShown = signature;
    }
    const ratio = this.options.ratio();
    [...box.children].forEach((at, i) => {
      const [, kind, , x, y, visible, rough, open, text] = labels[i];
      at.hidden = visible !== "1";
      at.classList.toggle("rough", rough === "1");
      at.classList.toggle("open", open === "1");
      const words = at.firstElementChild;
      if (words && words.textContent !== text) words.textContent = text;
      if (kind === "0") at.setAttribute("aria-label", `Note: ${text}`);
      at.style.transform = `translate(${Number(x) / ratio}px, ${Number(y) / ratio}px)`;
    });
  }

  makeLabel(kind, index) {
    const at = element(kind === 0 ? "button" : "div", {className: "label " + kLabelClasses[kind]});
    if (kind === 0) {
      at.type = "button";
      at.addEventListener("click", () => this.showAnnotation(at.classList.contains("open") ? -1 : index));
    }
    if (kind === 0 || kind === 2) at.append(element("span"));
    return at;
  }

  showLines(lines) {
    const made = resizeChildren(byId("lines"), lines.length, () => svgElement("line"));
    made.forEach((line, i) => {
      const [, x0, y0, x1, y1, rough] = lines[i];
      const place = {x1: x0, y1: y0, x2: x1, y2: y1};
      for (const [name, value] of Object.entries(place)) line.setAttribute(name, Number(value) / this.options.ratio());
      line.classList.toggle("rough", rough === "1");
    });
  }

  showAnnotation(index) { this.options.press(() => this.core.call("showAnnotation", index)); }

  showCard(row) {
    const card = byId("card");
    const annotation = row && this.annotations[Number(row[1])];
    card.hidden = !annotation;
    if (!annotation) return;
    byId("card-title").textContent = annotation.title;
    byId("card-text").textContent = annotation.text;
  }

  showHelp(shown) {
    const dialog = byId("help");
    if (shown && !dialog.open) {
      const list = dialog.querySelector("dl");
      list.replaceChildren(...this.core.rows("help").flatMap(
          ([input, effect]) => [element("dt", {textContent: input}), element("dd", {textContent: effect})]));
      dialog.showModal();
    } else if (!shown && dialog.open) {
      this.closingHelp = true;
      dialog.close();
    }
  }

  /// The client closes the help, whoever asked for it: events of the dialog come late, and could meet the next opening.
  listenToHelp() {
    const help = byId("help");
    const closeHelp = () => this.options.press(() => this.core.call("showHelp", 0));
    for (const request of ["cancel", "submit"])
      help.addEventListener(request, (event) => {
        event.preventDefault();
        closeHelp();
      });
    help.addEventListener("close", () => {
      if (!this.closingHelp) closeHelp();
      this.closingHelp = false;
    });
  }
}
