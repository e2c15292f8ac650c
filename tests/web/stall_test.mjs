// Tests that interaction never waits for data: while the server is stopped, the view still turns and draws.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";

import {
  camera,
  canvasPicture,
  cleanUp,
  difference,
  launch,
  open,
  sampleScene,
  serve,
  settled,
  slowLink
} from "./lib.mjs";

let server, browser;
before(async () => {
  server = await serve(sampleScene());
  browser = await launch();
});
after(cleanUp);

test("a silent server stops no drag", async () => {
  const page = await open(browser, server.url);
  await settled(page);
  const start = await camera(page);
  const before = await canvasPicture(page);
  const drawn = await page.evaluate(() => window.lumigrid.framesDrawn());
  server.pause();
  await page.mouse.move(320, 180);
  await page.mouse.down();
  for (let i = 1; i <= 20; ++i) {
    await page.mouse.move(320 + 8 * i, 180 + 2 * i);
    await page.waitForTimeout(20);
  }
  await page.mouse.up();
  await page.waitForTimeout(200);
  const turned = await camera(page);
  const frames = (await page.evaluate(() => window.lumigrid.framesDrawn())) - drawn;
  const picture = await canvasPicture(page);
  server.resume();
  assert.notDeepEqual(turned, start);
  assert.ok(frames >= 2, `${frames} frames for 20 moves`);
  assert.ok(difference(before, picture).mean > 1, "the picture did not follow");
  await settled(page);
  assert.deepEqual(page.faults, []);
});

test("a thin link (384 kbit/s, 300 ms) shows something at once and all in the end", async () => {
  const link = await slowLink(server.port, 384_000 / 8, 0.3);
  const page = await open(browser, link.url);
  const first = await settledPatches(page);
  assert.ok(first.receivedBytes < 400_000, `${first.receivedBytes} bytes before the first picture`);
  await settled(page);
  assert.deepEqual(page.faults, []);
});

async function settledPatches(page) {
  for (;;) {
    const now = await page.evaluate(() => window.lumigrid?.figures());
    if (now?.triangles > 0) return now;
    await page.waitForTimeout(30);
  }
}
