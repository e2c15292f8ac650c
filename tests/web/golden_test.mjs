// Tests that the browser draws the same picture as the native client, on Mesa and on SwiftShader, an independent
// implementation.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";

import {
  allHere,
  camera,
  canvasPicture,
  cleanUp,
  difference,
  launch,
  nativePictures,
  open,
  sampleScene,
  serve,
  settled,
  still
} from "./lib.mjs";

let server;
// Without prefetching both clients hold the same images.
before(async () => (server = await serve(sampleScene(), {args: ["--no-frames", "--prefetch", "0"]})));
after(cleanUp);

/// Returns permalinks of a few views, found by dragging.
async function someViews(browser) {
  const page = await open(browser, server.url);
  const links = [];
  for (let i = 0; i < 3; ++i) {
    await page.mouse.move(320, 180);
    await page.mouse.down();
    await page.mouse.move(320 + 70 * i, 180 - 30 * i, {steps: 3});
    await page.mouse.up();
    await page.mouse.wheel(0, -100 * i);
    await still(page);
    await settled(page);
    links.push(await page.evaluate(() => window.lumigrid.permalink()));
  }
  await page.close();
  return links;
}

// Each row has the limit of the mean in levels of 255, and of the outliers (over 8 levels) as a share of the picture.
for (const [gl, mean, outliers] of [["mesa", 1, 0.002], ["swiftshader", 1, 0.002]])
  test(`as the native client draws it: ${gl}`, async () => {
    const browser = await launch(gl);
    for (const link of await someViews(browser)) {
      const page = await open(browser, `${server.url}#${link}`);
      await allHere(page);
      const picture = await canvasPicture(page);
      const [native] = nativePictures(server.url, [await camera(page)], ["--no-frames"]);
      const apart = difference(picture, native);
      assert.ok(apart.covered > 0.05, "there is nothing in the pictures");
      assert.ok(
          apart.mean < mean && apart.outliers < outliers,
          `${link}: mean ${apart.mean} levels, outliers ${apart.outliers}`);
      console.log(
          `${gl} ${link}: mean ${apart.mean.toFixed(3)} levels, outliers ${(100 * apart.outliers).toFixed(3)} %`);
      assert.deepEqual(page.faults, []);
      await page.close();
    }
    await browser.close();
  });
