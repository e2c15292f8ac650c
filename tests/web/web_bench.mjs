// Measures the costs of the page beside those that it is compared with, in one run:
//   LUMIGRID_BIN=build/release/bin LUMIGRID_SITE=build/web/site node tests/web/web_bench.mjs SCENE [--json]
//   1. bytes before the first picture by kind (compressed, as they travel), and of the WebAssembly: limits 350 kB and
//      154 kB
//   2. milliseconds a frame in Chromium and in the native client, same view, same software GL, each with the GPU's work
//      done: median of the medians of 5 runs of 12 frames
//   3. milliseconds from a move of the mouse to the frame that follows it, in a drag begun at the first picture, on the
//      local link and on one of 384 kbit/s and 300 ms
import {readFileSync, writeFileSync} from "node:fs";
import {join} from "node:path";

import {camera, cleanUp, folder, launch, open, run, serve, settled, slowLink, until} from "./lib.mjs";

const scene = process.argv[2];
if (!scene) throw new Error("usage: node web_bench.mjs SCENE [--json]");
const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
const result = {scene};
// With these flags Chromium draws frames as fast as it can, as the native client does.
const kFree = ["--disable-gpu-vsync", "--disable-frame-rate-limit"];

const kindOf = (url) =>
    (url.endsWith(".wasm")           ? "wasm" :
         url.endsWith(".js")         ? "scripts" :
         url.endsWith(".css")        ? "style" :
         url.includes("annotations") ? "notes" :
                                       "page");

/// Returns the figures of the first frame that shows the model.
async function firstFigures(page) {
  let first = null;
  await until(
      async () => (first = await page.evaluate(() => window.lumigrid?.firstPicture())), "a first picture", 120000);
  return first;
}

async function firstPicture(browser, url) {
  const context = await browser.newContext({viewport: {width: 1280, height: 720}});
  const page = await context.newPage();
  page.faults = [];
  const cdp = await context.newCDPSession(page);
  await cdp.send("Network.enable");
  const bytes = {};
  const urls = new Map();
  cdp.on("Network.responseReceived", ({requestId, response}) => urls.set(requestId, response.url));
  cdp.on("Network.loadingFinished", ({requestId, encodedDataLength}) => {
    const kind = kindOf(urls.get(requestId) ?? "");
    bytes[kind] = (bytes[kind] ?? 0) + encodedDataLength;
  });
  const started = performance.now();
  await page.goto(url, {waitUntil: "commit"});
  const seen = await firstFigures(page);
  const seconds = (performance.now() - started) / 1000;
  bytes.patches = seen.receivedPatchBytes;
  bytes.images = seen.receivedImageBytes;
  bytes.other = seen.receivedBytes - seen.receivedPatchBytes - seen.receivedImageBytes - seen.receivedFrameBytes;
  await settled(page);
  await page.waitForTimeout(500);
  return {page, seconds, bytes, total: Object.values(bytes).reduce((a, b) => a + b, 0)};
}

/// Times frames of the present view in the page, waiting for the GPU after each.
const timeFrames = (page, count) => page.evaluate((frames) => {
  const gl = document.getElementById("view").getContext("webgl2");
  const pixel = new Uint8Array(4);
  const times = [];
  for (let i = 0; i < frames; ++i) {
    const begin = performance.now();
    window.lumigrid.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    times.push(performance.now() - begin);
  }
  return times;
}, count);

function nativeFrames(url, view, count) {
  const [px, py, pz, dx, dy, dz, ux, uy, uz, fov, , width, height] = view;
  const frame = {
    position: [px, py, pz],
    direction: [dx, dy, dz],
    up: [ux, uy, uz],
    fov_y_degrees: (fov * 180) / Math.PI,
    width,
    height
  };
  const path = join(folder, "bench-path.json");
  // The first few frames wait for data, and fill caches and shaders.
  writeFileSync(path, JSON.stringify({frames: Array(count + 3).fill(frame)}));
  const lines =
      run("lumigrid-view", [url.replace(/^http/, "ws"), "--headless", "--path", path, "--no-frames", "--json"]);
  return lines.trim()
      .split("\n")
      .map((line) => JSON.parse(line))
      .filter((line) => line.draw_ms !== undefined)
      .slice(3)
      .map((line) => line.draw_ms);
}

/// Returns milliseconds from moving the mouse to the frame that follows, over a drag.
async function dragLatencies(page) {
  await page.evaluate(() => {
    window.latencies = [];
    let moved = null;
    document.getElementById("view").addEventListener(
        "pointermove", () => (moved ??= [performance.now(), window.lumigrid.framesDrawn()]));
    const watch = () => {
      if (moved && window.lumigrid.framesDrawn() !== moved[1]) {
        window.latencies.push(performance.now() - moved[0]);
        moved = null;
      }
      window.watching = requestAnimationFrame(watch);
    };
    watch();
  });
  await page.mouse.move(400, 360);
  await page.mouse.down();
  for (let i = 1; i <= 60; ++i) {
    await page.mouse.move(400 + 6 * i, 360 + i);
    await page.waitForTimeout(16);
  }
  await page.mouse.up();
  return page.evaluate(() => (cancelAnimationFrame(window.watching), window.latencies));
}

try {
  const server = await serve(scene, {args: ["--no-frames"]});
  const browser = await launch("mesa", kFree);

  // The thin link shows how much must have arrived, since nothing more arrives meanwhile.
  const thin = await slowLink(server.port, 384_000 / 8, 0.3);
  const slow = await firstPicture(browser, thin.url);
  await slow.page.close();
  const first = await firstPicture(browser, server.url);
  result.first_picture = {
    bytes: slow.bytes,
    total: slow.total,
    limit: 350_000,
    seconds: slow.seconds,
    local_total: first.total,
    local_seconds: first.seconds
  };
  result.wasm = {bytes: first.bytes.wasm, limit: 154_000};

  const view = await camera(first.page);
  const medians = {chromium: [], native: []};
  for (let i = 0; i < 5; ++i) {
    medians.chromium.push(median((await timeFrames(first.page, 15)).slice(3)));
    medians.native.push(median(nativeFrames(server.url, view, 12)));
  }
  result.frame = {chromium_ms: median(medians.chromium), native_ms: median(medians.native), size: view.slice(11, 13)};
  result.frame.ratio = result.frame.chromium_ms / result.frame.native_ms;
  await first.page.close();

  const intervals = {};
  for (const [name, url] of [["local", server.url], ["thin", thin.url]]) {
    const runs = [];
    for (let i = 0; i < 3; ++i) {
      const page = await open(browser, url, {viewport: {width: 1280, height: 720}});
      await firstFigures(page);
      runs.push(median(await dragLatencies(page)));
      await page.close();
    }
    intervals[name] = median(runs);
  }
  result.drag = {local_ms: intervals.local, thin_ms: intervals.thin, ratio: intervals.thin / intervals.local};

  if (process.argv.includes("--json")) {
    console.log(JSON.stringify(result));
  } else {
    console.log(`first picture after ${slow.seconds.toFixed(1)} s and ${
        slow.total} bytes (limit 350000) at 384 kbit/s and 300 ms, ${first.seconds.toFixed(2)} s and ${
        first.total} bytes on the local link: ${
        Object.entries(slow.bytes).map(([kind, size]) => `${kind} ${size}`).join(", ")}`);
    console.log(`wasm ${result.wasm.bytes} bytes compressed (limit ${result.wasm.limit})`);
    console.log(`frame: Chromium ${result.frame.chromium_ms.toFixed(1)} ms, native ${
        result.frame.native_ms.toFixed(1)} ms: ratio ${result.frame.ratio.toFixed(2)} (wanted at most 2)`);
    console.log(`drag: ${intervals.local.toFixed(1)} ms from mouse to frame on the local link, ${
        intervals.thin.toFixed(1)} ms at 384 kbit/s and 300 ms: ratio ${result.drag.ratio.toFixed(2)}`);
  }
} finally {
  await cleanUp();
}
