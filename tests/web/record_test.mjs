// Tests that the page records a person's hand as a camera path.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {after, before, test} from "node:test";

import {cleanUp, launch, open, sampleScene, serve, still, until} from "./lib.mjs";

let server, browser;
before(async () => {
  server = await serve(sampleScene(), {args: ["--no-frames"]});
  browser = await launch();
});
after(cleanUp);

test("?record saves the way of the camera from the first picture to the click, in its own time", async () => {
  const page = await open(browser, `${server.url}?record`);
  const button = page.locator("#record");
  await until(() => button.isVisible(), "the first picture");
  const start = await still(page);
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(420, 150, {steps: 5});
  await page.mouse.up();
  await page.keyboard.press("x");  // a section
  const end = await still(page);
  await page.waitForTimeout(500);
  const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
  const path = JSON.parse(readFileSync(await download.path(), "utf8"));

  assert.equal(path.version, 1);
  assert.equal(path.frames_per_second, 60);
  assert.ok(path.frames.length > 30, `${path.frames.length} frames in over half a second`);
  const [first, last] = [path.frames[0], path.frames.at(-1)];
  for (const [frame, view] of [[first, start], [last, end]]) {
    assert.deepEqual([...frame.position, ...frame.direction, ...frame.up], view.slice(0, 9));
    assert.deepEqual([frame.width, frame.height], view.slice(11, 13));
    assert.ok(Math.abs(frame.fov_y_degrees - view[9] * 180 / Math.PI) < 1e-9);
  }
  assert.notDeepEqual(first.position, last.position);
  assert.equal(first.section, undefined);
  assert.deepEqual([...last.section.normal, last.section.offset], end.slice(13));
  assert.deepEqual(page.faults, []);
  await page.close();
});

test("nothing is recorded unasked", async () => {
  const page = await open(browser, server.url);
  await still(page);
  assert.equal(await page.locator("#record").count(), 0);
  await page.close();
});
