// The budget of memory holds at every frame of a tour, and what it costs is said.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { canvasPicture, cleanUp, figures, launch, open, sampleScene, serve, settled } from "./lib.mjs";

let server, browser;
before(async () => {
  server = await serve(sampleScene({ triangles: 200000, grid: 4, face: 256 }));
  browser = await launch();
});
after(cleanUp);

/// Drags and zooms; after each step the counted bytes must be within the budget. The most that was seen.
async function tour(page, steps) {
  let most = 0;
  for (let i = 0; i < steps; ++i) {
    await page.mouse.move(320, 180);
    await page.mouse.down();
    await page.mouse.move(320 + 90 * Math.cos(i), 180 + 40 * Math.sin(1.7 * i), { steps: 2 });
    await page.mouse.up();
    await page.mouse.wheel(0, i % 4 < 2 ? -300 : 300);
    for (let k = 0; k < 4; ++k) {
      const now = await figures(page);
      most = Math.max(most, now.memoryBytes);
      assert.ok(now.memoryBytes <= now.memoryBudget, `step ${i}: ${now.memoryBytes} of ${now.memoryBudget} bytes`);
      assert.ok(now.gpuBytes <= now.memoryBytes, "the GPU's bytes are among them");
      assert.ok(now.triangles > 0, "nothing is drawn");
      await page.waitForTimeout(40);
    }
  }
  return most;
}

test("16 MB hold over a tour; the picture gets coarser instead", async () => {
  const page = await open(browser, server.url);
  await settled(page);
  await page.evaluate(() => localStorage.setItem("lumigrid.settings", JSON.stringify({ version: 1, memory_megabytes: 16 })));
  await page.reload();
  await settled(page);
  assert.equal((await figures(page)).memoryBudget, 16e6);
  const most = await tour(page, 25);
  assert.ok(most > 8e6, `a tour that needs ${most} bytes tests no budget`);
  const covered = (await canvasPicture(page)).data.some((value, i) => i % 4 === 3 && value > 0);
  assert.ok(covered, "the picture is empty");
  assert.deepEqual(page.faults, []);
  await page.close();
});

test("a phone starts with 64 MB", async () => {
  const page = await open(browser, server.url, { viewport: { width: 390, height: 700 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
  await settled(page);
  assert.equal((await figures(page)).memoryBudget, 64e6);
  await page.close();
});
