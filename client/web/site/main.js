// The page finds the scene, starts the client, and carries out its requests.
import "./early.js";

import {loadAnnotations} from "./annotations.js";
import {loadCore} from "./core.js";
import {element} from "./dom.js";
import {listen} from "./input.js";
import {Overlay, showProblem} from "./overlay.js";
import {openPicture} from "./picture.js";
import {keepSettings, restoreSettings, settingValue, showSettings} from "./settings.js";
import {openLink, socketUrl} from "./socket.js";
import {openStaticScene, openStreamedScene, OtherMethod, readScene} from "./static_scene.js";
import {makeTools} from "./tools.js";

/// Memory budget on phones, unless the settings name another: everything that grows with the scene.
const kPhoneMegabytes = 64;
/// At rest, toasts, permalinks and lost images are noticed within this time.
const kIdleMilliseconds = 100;
const kStatisticsMilliseconds = 250;
/// More device pixels than this per screen pixel cost time and are not visible.
const kMaxRatio = 2;

// build_site.mjs replaces these names when it builds the page.
const checkScript = new URL(CHECK_SCRIPT, document.baseURI).href;
const recordScript = new URL(RECORD_SCRIPT, document.baseURI).href;
const files = {
  viewerWasm: new URL(VIEWER_WASM, document.baseURI).href,
  decodeWasm: new URL(DECODE_WASM, document.baseURI).href,
  worker: new URL(DECODE_WORKER, document.baseURI).href
};

/// The method for which the page was loaded. Those that stream a file of their own have programs of their own.
const method = window.lumigridMethod();
const programs = new Map([
  ["qsplat", [SPLATS_WASM, SPLATS_SCRIPT]], ["pmr", [UMBRELLAS_WASM, UMBRELLAS_SCRIPT]],
  ["hlod", [HLOD_WASM, HLOD_SCRIPT]]
]);
const program = programs.get(method.name);
const [streamedWasm, streamedScript] = (program ?? []).map((name) => new URL(name, document.baseURI).href);
const streamed = Boolean(program);
if (streamed) files.viewerWasm = streamedWasm;

const canvas = document.getElementById("view");
const now = () => performance.now() / 1000;
const phone = matchMedia("(pointer: coarse)").matches && Math.min(screen.width, screen.height) < 700;

let core, overlay, link;
let ratio = 1;
let scheduled = false;
let takingIn = false;
let failed = false;
let contextLost = false;
let framesDrawn = 0;
let first = null;  // figures of the first frame that shows the model
const bookmarksStore = () => `lumigrid.bookmarks ${new URL(location.pathname + location.search, location.href).href}`;

// ---- the loop ----

function schedule() {
  if (scheduled || failed || document.hidden) return;
  scheduled = true;
  requestAnimationFrame(turn);
}

/// Takes in what came of a published scene as soon as the page has time, rather than with its next picture.
function takeInSoon() {
  if (takingIn) return;
  takingIn = true;
  setTimeout(() => {
    takingIn = false;
    if (!failed && !document.hidden) pumpStatic?.(now());
    schedule();
  });
}

function draw() {
  ++framesDrawn;
  const error = core.text("frame", now());
  if (error) return fail("The picture cannot be drawn", error);
  if (first) return;
  const seen = core.figures();
  if (seen.triangles > 0 || seen.drawn > 0) first = seen;
}

function turn() {
  scheduled = false;
  if (failed) return;
  pumpStatic?.(now());
  const wanted = core.call("advance", now());
  if (wanted && !contextLost) draw();
  carryOut();
  overlay.update();
  link?.flush();
  pumpStatic?.(now());  // a drawn frame has told the session its view
  if (core.call("advance", now()) && !contextLost) schedule();
}

function fail(title, advice) {
  failed = true;
  overlay.problem(title, advice, () => location.reload());
}

const showToast = (text, error = true) => {
  core.call("showToast", text, error ? 1 : 0);
  schedule();
};

/// Shows once what cannot be shown of a published scene though the rest goes on, such as a lost pack.
function tellStaticProblem() {
  if (!pumpStatic) return;
  const problem = core.text("staticProblem");
  if (problem && problem !== staticProblem && !core.refused())
    showToast(problem);  // a refusal is shown in the middle of the page instead
  staticProblem = problem;
}

// ---- the client's requests ----

async function copyLink(hash) {
  const url = keepLink(hash);
  try {
    await navigator.clipboard.writeText(url);
    showToast("link copied", false);
  } catch {
    // Pages without https may not use that function.
    const text = element("textarea", {value: url});
    document.body.append(text);
    text.select();
    const copied = document.execCommand("copy");
    text.remove();
    canvas.focus();
    if (copied)
      showToast("link copied", false);
    else
      showToast("the link is in the address bar: copy it from there");
  }
}

/// Goes to the view that the address names, if any. The client reports what is wrong with it.
function openHash() {
  if (location.hash.length < 2 || /^#m=[a-z]*$/.test(location.hash)) return;
  let text = location.hash;
  try {
    text = decodeURIComponent(text);
  } catch {
    // It is not encoded as URLs are, so it is used as it stands.
  }
  core.text("openPermalink", text);
}

/// Puts a view into the page's address without an entry in the history, and returns the address.
function keepLink(hash) {
  const url = new URL(location.href);
  url.hash = hash;
  history.replaceState(null, "", url);
  return url.href;
}

function keepBookmarks() {
  const kept = {};
  for (let slot = 1; slot <= 9; ++slot) {
    const text = core.text("bookmark", slot);
    if (text) kept[slot] = text;
  }
  try {
    localStorage.setItem(bookmarksStore(), JSON.stringify(kept));
  } catch {
    showToast("this browser keeps no bookmarks for this page");
  }
}

function restoreBookmarks() {
  try {
    const kept = JSON.parse(localStorage.getItem(bookmarksStore()) ?? "{}");
    for (let slot = 1; slot <= 9; ++slot)
      if (typeof kept?.[slot] === "string") core.text("setBookmark", slot, kept[slot]);
  } catch {
    // There are no bookmarks when the entry is not ours, or storage is not allowed.
  }
}

async function pick(_, id, ox, oy, oz, dx, dy, dz) {
  const answer = (kind, point = [0, 0, 0], normal = [0, 0, 0], accuracy = 0) => {
    core.call("answerPick", id, kind, ...point, ...normal, accuracy);
    schedule();
  };
  const unknown = 2;
  if (!server) return answer(unknown);
  try {
    const reply = await fetch(new URL(`pick?${new URLSearchParams({ox, oy, oz, dx, dy, dz})}`, server));
    if (!reply.ok) throw new Error(`the server answered ${reply.status}`);
    const found = await reply.json();
    if (found.hit)
      answer(0, found.point, found.normal, found.accuracy);
    else
      answer(1);
  } catch {
    answer(unknown);
  }
}

function savePicture(query) {
  openPicture({
    dialog: document.getElementById("picture"),
    canvas,
    query: overlay.background ? `${query}&background=${overlay.background.slice(1)}` : query,
    server: streamed ? null : server,
    draw,
    name: document.getElementById("name").textContent,
    say: showToast
  });
}

function openSettings() {
  const shown = {method: streamed ? method.name : core.text("method")};
  showSettings(document.getElementById("settings"), core, shown, settingChanged);
}

/// These carry out the client's requests, in the order of RequestKind (client/app/app.h). Each gets text, id, ray.
const kRequests = [copyLink, keepLink, savePicture, keepBookmarks, keepAndApply, openSettings, pick];

function carryOut() {
  for (const [kind, id, text, ...ray] of core.rows("takeRequests"))
    kRequests[kind](text, Number(id), ...ray.map(Number));
}

function keepAndApply() {
  const error = keepSettings(core);
  if (error) showToast(error);
  applyTheme();
}

function settingChanged(error, name) {
  schedule();
  if (error || name !== "method") return;
  carryOut();                      // keeps it
  load(settingValue(core, name));  // loads at once, since the address names what is shown
}

// ---- the page around it ----

function applyTheme() {
  const wanted = settingValue(core, "theme");
  const dark = wanted === "dark" || (wanted !== "light" && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = dark ? "dark" : "light";
}

function resize() {
  ratio = Math.min(devicePixelRatio || 1, kMaxRatio);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  core.call("resize", width, height, ratio);
  // A canvas that changed its size is empty until it is drawn.
  if (!contextLost && !failed) draw();
  schedule();
}

function watchContext() {
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();  // without this the browser would not restore it
    contextLost = true;
    core.call("loseContext");
    showToast("the graphics driver restarts the view …", false);
  });
  canvas.addEventListener("webglcontextrestored", () => {
    contextLost = false;
    const error = core.text("restoreContext");
    if (error) fail("The picture cannot be drawn again", error);
    schedule();
  });
}

function watchPage() {
  // The canvas has the keyboard focus from the beginning; its ring is shown only to users of the Tab key.
  addEventListener("keydown", ({key}) => key === "Tab" && document.body.classList.add("by-keyboard"));
  addEventListener("pointerdown", () => document.body.classList.remove("by-keyboard"));
  new ResizeObserver(resize).observe(canvas);
  document.addEventListener("visibilitychange", () => {
    core.call("setHidden", document.hidden ? 1 : 0);
    schedule();
  });
  const motion = matchMedia("(prefers-reduced-motion: reduce)");
  const setMotion = () => core.call("setReducedMotion", motion.matches ? 1 : 0);
  motion.addEventListener("change", setMotion);
  setMotion();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", applyTheme);
  addEventListener("hashchange", (event) => {
    // Restore the address as it was set: keepLink() may have put the view's own link there since.
    history.replaceState(null, "", event.newURL);
    const {name} = window.lumigridMethod();
    if (name !== method.name && (streamed || programs.has(name))) return location.reload();
    openHash();
    schedule();
  });
  setInterval(() => {
    if (document.hidden || failed) return;
    if (pumpStatic?.(now()) || core.call("advance", now())) schedule();
    tellStaticProblem();
    carryOut();
    overlay.update();
  }, kIdleMilliseconds);
  setInterval(() => overlay.updateStatistics(), kStatisticsMilliseconds);
}

// ---- start ----

/// The URL beside which /render, /pick and annotations.json lie; null without a server of ours.
let server = null;
/// Takes in data of a published scene and requests more; null with a server.
let pumpStatic = null;
let staticProblem = "";

/// The scene of a streamed method, which is read while the program is loaded and WebGL starts; null without one.
let reading = null;

function readEarly() {
  const base = staticBase() ?? new URL("./", location.href).href;
  if (!streamed || !/^https?:/.test(base)) return;
  reading = readScene(base);
  reading.catch(() => {});  // openStatic() reports it
}

async function start() {
  const bare = (title, advice) => showProblem(title, advice, () => location.reload());
  if (typeof WebAssembly !== "object" || !("OffscreenCanvas" in window))
    return bare(
        "This browser is too old for the viewer",
        "It needs WebAssembly, WebGL2 and OffscreenCanvas: a Chrome, Edge or Firefox of the last years, or Safari " +
            "from 16.4 on.");
  readEarly();
  try {
    core = await loadCore(files, streamed ? (await import(streamedScript)).default : undefined);
  } catch (error) {
    return bare("The viewer could not be loaded", `${error.message}. Check the connection and try again.`);
  }
  core.changed = schedule;
  const scene = staticBase();
  const checkHost = () => showHostCheck(scene);
  if (phone) core.text("initialSetting", "memory_megabytes", kPhoneMegabytes);
  restoreSettings(core);
  applyTheme();
  if (!core.call("start", "#view", method.name))
    return bare(
        "There is no WebGL2 here",
        "Switch on hardware acceleration in the browser's settings, update the graphics driver, or try another " +
            "browser.");
  overlay = new Overlay(core, {
    streamed,
    ratio: () => ratio,
    press: (act) => {
      act();
      schedule();
    },
    retry: () => link?.retry(),
    check: scene && checkHost,
  });
  makeTools(document.getElementById("tools"), method.name === "qsplat", (key) => {
    core.call("key", `Key${key.toUpperCase()}`, key, 1, 0, now());
    core.call("key", `Key${key.toUpperCase()}`, key, 0, 0, now());
    schedule();
  });
  watchContext();
  resize();
  watchPage();
  listen(canvas, core, now, schedule);
  restoreBookmarks();
  openHash();
  canvas.focus({preventScroll: true});
  if (new URLSearchParams(location.search).has("record")) recordHand();
  if (!scene) return openServer();
  const button = document.getElementById("settings-check");
  button.hidden = false;
  button.onclick = checkHost;
  if (new URLSearchParams(location.search).has("check")) checkHost();
  await openStatic(scene);
}

/// Returns the folder of a published scene, which the address names (?scene=URL), or the page that lies beside it; null
/// with a server of ours.
function staticBase() {
  const named = new URLSearchParams(location.search).get("scene") ??
      document.querySelector('meta[name="lumigrid-scene"]').content;
  if (!named) return null;
  const url = new URL(named, document.baseURI);
  url.hash = url.search = "";
  if (url.pathname.endsWith("/scene.json")) url.pathname = url.pathname.slice(0, -"scene.json".length);
  if (!url.pathname.endsWith("/")) url.pathname += "/";
  return url.href;
}

/// Shows the list of what the scene's host sends. Its program is fetched when it is needed.
async function showHostCheck(base) {
  document.getElementById("settings").close();
  try {
    const {showCheck} = await import(checkScript);
    await showCheck(document.getElementById("check"), base);
  } catch (error) {
    showToast(`the host cannot be checked: ${error.message}`);
  }
}

async function recordHand() {
  const {record} = await import(recordScript);
  record(window.lumigrid, (name) => showToast(`way of the camera saved as ${name}`, false));
}

/// Loads the page again with another method; a link keeps its view.
function load(other) {
  const url = new URL(location.href);
  const view = url.hash.slice(1).replace(/(^|&)m=[^&]*/, "");
  url.hash = view ? `${view}&m=${other}` : `m=${other}`;
  history.replaceState(null, "", url);
  location.reload();
}

async function openStatic(base) {
  try {
    if (!/^https?:/.test(base))
      throw Object.assign(
          new Error(`${base} cannot be read`), {advice: "A scene's address begins with http:// or https://."});
    pumpStatic = await (
        streamed ? openStreamedScene(method.name, base, reading, core, takeInSoon) :
                   openStaticScene(base, core, schedule));
  } catch (error) {
    if (error instanceof OtherMethod && (!streamed || !method.said)) return load(error.method);
    return fail(error.message, error.advice ?? "Try again; if it stays, the page and the scene do not fit together.");
  }
  schedule();
  loadAnnotations(new URL("annotations.json", base), core, overlay.annotations, showToast);
}

function openServer() {
  server = new URL("./", location.href);
  if (streamed) return openStatic(server.href);
  link = openLink(socketUrl(server), core, schedule, load);
  loadAnnotations(new URL("annotations.json", server), core, overlay.annotations, showToast);
}

// This object is for pages that embed the viewer, and for its tests (docs/viewer.md).
window.lumigrid = {
  figures: () => core?.figures() ?? null,
  camera: () => core?.rows("camera")[0]?.map(Number) ?? null,
  permalink: () => core?.text("permalink") ?? "",
  open: (link) => core?.text("openPermalink", link) ?? "not started",
  settings: () => core?.rows("settings") ?? [],
  overlay: () => core?.rows("overlay") ?? [],
  /// Returns the canvas alone as a PNG's data URL, transparent where nothing is drawn.
  picture: () => {
    draw();
    return canvas.toDataURL("image/png");
  },
  framesDrawn: () => framesDrawn,
  firstPicture: () => first,
  draw,
};

start();
