// Measures how long a view takes from the opening of the page until its picture is complete, on the loopback device:
//   LUMIGRID_BIN=build/release/bin LUMIGRID_SITE=build/web/site node tests/web/rest_bench.mjs SCENE [METHOD [WIDTH
// HEIGHT]]
// prints each of 5 runs, each in a browser context of its own, and their median. Limit for a million points: 3 s.
import {cleanUp, launch, open, serve, until} from "./lib.mjs";

const [scene, method = "pmr", width = 1280, height = 720] = process.argv.slice(2);
if (!scene) throw new Error("usage: node rest_bench.mjs SCENE [METHOD [WIDTH HEIGHT]]");
const viewport = {width: Number(width), height: Number(height)};
const kRuns = 5;
const kLimit = 3;  // seconds, for a million points
const isComplete = () => {
  const now = window.lumigrid?.figures();
  return now && now.complete === 1 && now.drawn + now.triangles > 0;
};
/// Reading a pixel waits for the picture that was drawn last.
const waitForPicture = () => {
  const gl = document.querySelector("canvas").getContext("webgl2");
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
};

try {
  const server = await serve(scene);
  const browser = await launch();
  const runs = [];
  for (let i = 0; i < kRuns; ++i) {
    const began = performance.now();
    const page = await open(browser, `${server.url}?method=${method}`, {viewport});
    await until(() => page.evaluate(isComplete), "a complete picture");
    await page.evaluate(waitForPicture);
    runs.push((performance.now() - began) / 1000);
    await page.close();
  }
  runs.sort((a, b) => a - b);
  console.log(`complete after ${runs.map((s) => s.toFixed(2)).join(", ")} s: median ${runs[2].toFixed(2)} s, ${
      (runs[2] / kLimit).toFixed(1)} times the limit`);
} finally {
  await cleanUp();
}
