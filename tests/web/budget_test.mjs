// Tests that the memory budget holds over a tour, by our own count and by one made at WebGL's calls, and that nothing
// grows from lap to lap. tour_bench.mjs makes the same tour longer.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";

import {canvasPicture, cleanUp, figures, launch, nginx, open, run, sampleScene, serve, settled, site} from "./lib.mjs";
import {openCounted, phone, summary, tour} from "./tour.mjs";

let scene, server, browser;
before(async () => {
  scene = sampleScene({triangles: 200000, grid: 4, face: 256});
  server = await serve(scene);
  browser = await launch();
});
after(cleanUp);

async function toured(page, budget) {
  const found = await tour(page, {seconds: 12, steps: 6, look: 250});
  for (const one of found.samples) {
    assert.equal(one.budget, budget);
    assert.ok(one.memory <= budget, `after ${one.seconds} s: ${one.memory} of ${budget} bytes`);
    assert.ok(one.gpu <= one.memory, "the GPU's bytes are among them");
    assert.equal(
        one.gl, one.gpu,
        `after ${one.seconds} s: ${one.gl} bytes were allocated by WebGL's calls, ${one.gpu} are counted`);
    assert.ok(one.triangles > 0, "nothing is drawn");
  }
  const all = summary(found);
  assert.ok(all.samples > 20, `${all.samples} looks`);
  assert.ok(
      all.growth_wasm <= 0.1,
      `WebAssembly's memory grew from ${found.laps[1].wasm} to ${found.laps.at(-1).wasm} bytes over the same laps`);
  assert.ok(
      all.growth_heap <= 0.3,
      `JavaScript's heap grew from ${found.laps[1].heap} to ${found.laps.at(-1).heap} bytes over the same laps`);
  assert.deepEqual(page.faults, []);
  return all;
}

test("16 MB hold over a tour; the picture gets coarser instead", async () => {
  const page = await openCounted(browser, server.url, {viewport: {width: 640, height: 360}});
  await settled(page);
  await page.evaluate(
      () => localStorage.setItem("lumigrid.settings", JSON.stringify({version: 1, memory_megabytes: 16})));
  await page.reload();
  await settled(page);
  const all = await toured(page, 16e6);
  assert.ok(all.most_memory > 8e6, `a tour that needs ${all.most_memory} bytes tests no budget`);
  const covered = (await canvasPicture(page)).data.some((value, i) => i % 4 === 3 && value > 0);
  assert.ok(covered, "the picture is empty");
  await page.close();
});

test("a phone's 64 MB hold over a tour of a published scene", async () => {
  const published = `${scene}.published`;
  run("lumigrid", ["publish", scene, published, "--viewer", "on", "--web", site]);
  const page = await openCounted(browser, (await nginx(published)).url, {...phone, deviceScaleFactor: 1});
  await settled(page);
  await toured(page, 64e6);
  await page.close();
});

test("a phone starts with 64 MB", async () => {
  const page = await open(browser, server.url, phone);
  await settled(page);
  assert.equal((await figures(page)).memoryBudget, 64e6);
  await page.close();
});
