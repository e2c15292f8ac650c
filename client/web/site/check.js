// Sends a published scene's host the requests that viewers need, and shows the answers, header by header
// (client/source/host_check.h judges them). This is a bundle of its own, fetched when it is needed.
import createCheck from "client_web_check.js";

import {callsOf} from "./calls.js";
import {element} from "./dom.js";
import {partOf} from "./static_scene.js";

const kAsked = 16;
const kScene = 0, kRange = 1, kNextRange = 2;

/// Returns the length of the body, which is read only until it is longer than requested.
async function bytesOf(answer) {
  const reader = answer.body?.getReader();
  let bytes = 0;
  while (reader && bytes <= kAsked) {
    const {done, value} = await reader.read();
    if (done) break;
    bytes += value.length;
  }
  await reader?.cancel();
  return bytes;
}

/// Returns whether an object exists that CORS hides from this page.
async function isThereWithoutCors(url) {
  const stop = new AbortController();
  try {
    await fetch(url, {mode: "no-cors", cache: "no-store", signal: stop.signal});
    return true;
  } catch {
    return false;
  } finally {
    stop.abort();
  }
}

/// Hands one answer to the judge. Returns the text of scene.json, null when it did not arrive.
async function requestAndJudge(judge, which, url, headers = {}) {
  let answer;
  try {
    answer = await fetch(url, {headers, cache: "no-store"});
  } catch {
    judge.call("takeAnswer", which, 0, (await isThereWithoutCors(url)) ? 1 : 0, 0);
    return null;
  }
  const text = which === kScene ? await answer.text().catch(() => "") : "";
  judge.call("takeAnswer", which, answer.status, 0, which === kScene ? text.length : await bytesOf(answer));
  for (const [name, value] of answer.headers) judge.call("takeHeader", which, name.toLowerCase(), value);
  return answer.ok ? text : null;
}

function patchesOf(text) {
  try {
    return partOf(JSON.parse(text)?.parts ?? [], "patch-", ".lgp");
  } catch {
    return null;
  }
}

/// Returns rows: grade (0 good, 1 could be better, 2 fails), its name, header, finding, what to change, line of nginx.
/// `base`: the scene's folder.
async function findings(base) {
  const judge = callsOf(await createCheck({locateFile: () => new URL(CHECK_WASM, document.baseURI).href}));
  judge.call("beginCheck", new URL(base).origin === location.origin ? 0 : 1);
  const scene = await requestAndJudge(judge, kScene, new URL("scene.json", base));
  if (scene !== null) {
    const patches = patchesOf(scene);
    if (!patches)
      return [
        ["2", "fails", "scene.json", "Names no published hierarchy.", "Put there what lumigrid publish wrote.", ""]
      ];
    const url = new URL(patches.file, base);
    await requestAndJudge(judge, kRange, url, {Range: "bytes=0-15"});
    await requestAndJudge(judge, kNextRange, url, {Range: "bytes=16-31"});
  }
  return judge.rows("findings");
}

function item([grade, name, header, what, todo, nginx]) {
  const parts = {em: name, strong: header, p: `${what} ${todo}`.trim(), code: nginx};
  return element(
      "li", {className: ["good", "slow", "fails"][Number(grade)]},
      ...Object.entries(parts).filter(([, text]) => text).map(([tag, textContent]) => element(tag, {textContent})));
}

/// Opens the dialog and fills it. Throws when the judge itself cannot be loaded.
export async function showCheck(dialog, base) {
  const list = dialog.querySelector("ul");
  const note = dialog.querySelector("p");
  note.textContent = `Asking ${new URL(base).host} …`;
  list.replaceChildren();
  if (!dialog.open) dialog.showModal();
  const rows = await findings(base);
  const worst = Math.max(...rows.map(([grade]) => Number(grade)));
  note.textContent = `${base}: ${
          ["all that viewers need is there.", "scenes are shown; some things could be better.",
           "scenes cannot be shown from here as it is."][worst]}`;
  list.replaceChildren(...rows.map(item));
}
