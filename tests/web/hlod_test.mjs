// Tests the method hlod in the browser: triangles and points streamed from a server of ours and from nginx, with the
// same pictures as the native client's.
import assert from "node:assert/strict";
import {join} from "node:path";
import {after, before, test} from "node:test";

import {
  canvasPicture,
  cleanUp,
  figures,
  folder,
  launch,
  nginx,
  open,
  repeated,
  run,
  sampleMesh,
  serve,
  site,
  still,
  until
} from "./lib.mjs";
import {drag, expectNative, expectProgram, fine, setNumber} from "./streamed.mjs";

let published, server, browser;
before(async () => {
  const scene = join(folder, "hlod.scene");
  run("lumigrid", ["build", sampleMesh(), "-o", scene, "--methods", "hlod"]);
  published = join(folder, "hlod.published");
  run("lumigrid", ["publish", scene, published, "--viewer", "on", "--web", site]);
  server = await serve(scene);
  browser = await launch();
});
after(cleanUp);

test("a server's triangles and points, as the native client draws them, also after a drag", async () => {
  const page = await open(browser, `${server.url}?method=hlod`);
  await fine(page);
  await expectNative(page, server.url, "hlod");
  await drag(page);
  await still(page);
  await fine(page);
  await expectNative(page, server.url, "hlod");
  assert.match(await page.evaluate(() => window.lumigrid.permalink()), /&m=hlod/);
  assert.deepEqual(page.faults, []);
  await page.close();
});

test("a link with m=hlod opens them on a static host; hardly a byte comes twice", async () => {
  const first = await open(browser, `${(await nginx(published)).url}?method=hlod`);
  await fine(first);
  const link = await first.evaluate(() => window.lumigrid.permalink());
  await first.close();
  const host = await nginx(published);
  const page = await open(browser, `${host.url}#${link}`);
  await fine(page);
  const twice = repeated(host.requests(), page);
  assert.ok(twice < 30_000, `${twice} bytes: more than the piece of a block at the end of the first answer`);
  await expectNative(page, host.url, "hlod");
  assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);  // it has no annotations
  await page.close();
});

test("a scene that has nothing else is shown without being asked for, by its own WebAssembly", async () => {
  for (const {url} of [server, await nginx(published)]) await expectProgram(browser, url, "hlod");
});

test("a published scene with splats and a hierarchy shows splats unless the hierarchy is named", async () => {
  const scene = join(folder, "splats-hlod.scene");
  const place = join(folder, "splats-hlod.published");
  run("lumigrid", ["build", sampleMesh(), "-o", scene, "--methods", "qsplat,hlod"]);
  run("lumigrid", ["publish", scene, place, "--viewer", "on", "--web", site]);
  const {url} = await nginx(place);
  await expectProgram(browser, url, "splats");
  await expectProgram(browser, `${url}#m=hlod`, "hlod");
  await expectProgram(browser, `${url}?method=hlod`, "hlod");
});

test("a link to umbrellas finds the triangles and points of a published scene that has no umbrellas", async () => {
  const page = await open(browser, `${(await nginx(published)).url}#m=pmr`);
  await until(async () => (await figures(page).catch(() => null))?.drawn > 0, "triangles and points");
  assert.match(page.url(), /m=hlod/);
  await page.close();
});

test("the error on the screen is a setting that takes effect at once, and statistics tell what is drawn", async () => {
  const page = await open(browser, `${server.url}?method=hlod`);
  const before = await fine(page);
  await page.keyboard.press("g");
  await setNumber(page, "error_px", 16);
  await until(async () => (await fine(page)).drawn < before.drawn / 2, "less detail");
  await setNumber(page, "error_px", 0.5);
  await until(async () => (await fine(page)).drawn === before.drawn, "as much as before");
  await page.keyboard.press("Escape");
  await page.keyboard.press("i");
  await until(async () => /nodes/.test(await page.locator("#statistics").innerText()), "nodes in the statistics");
  assert.match(await page.locator("#tool-l").getAttribute("title"), /light/, "the glass is for splats");
  await page.close();
});

/// How many pixels of `b` are darker than those of `a`, a share of all. Those of a shadow lose most of their light.
function darker(a, b) {
  let count = 0;
  for (let i = 0; i < a.data.length; i += 4) count += a.data[i + 3] && a.data[i + 1] > 1.3 * b.data[i + 1] + 8 ? 1 : 0;
  return count / (a.data.length / 4);
}

test("shadows fall where the native client's do, and move with the light that is dragged", async () => {
  const page = await open(browser, `${server.url}?method=hlod`);
  await fine(page);
  await page.keyboard.press("l");
  await fine(page);
  const lit = await canvasPicture(page);
  await page.keyboard.press("g");
  await page.locator("#settings select[name=shadows]").selectOption("hard");
  await page.keyboard.press("Escape");
  await until(async () => darker(lit, await canvasPicture(page)) > 0.001, "shadows");
  await fine(page);
  const light = async () => (await page.evaluate(() => window.lumigrid.permalink())).match(/&l=([^&]+)&s=hard/)[1];
  await expectNative(page, server.url, "hlod", ["--shadows", "hard", `--light=${await light()}`]);

  // The sun begins above left of the middle.
  const before = await canvasPicture(page), first = await light();
  const {width, height} = await page.evaluate(() => ({width: innerWidth, height: innerHeight}));
  const reach = 0.2 * Math.min(width, height);
  await page.mouse.move(width / 2 - reach, height / 2 - reach);
  await page.mouse.down();
  await page.mouse.move(width / 2 + 1.2 * reach, height / 2 - reach, {steps: 4});
  await page.mouse.up();
  await fine(page);
  assert.notEqual(await light(), first);
  const after = await canvasPicture(page);
  assert.ok(darker(before, after) > 0.001 && darker(after, before) > 0.001, "the shadows stay");
  await expectNative(page, server.url, "hlod", ["--shadows", "hard", `--light=${await light()}`]);
  assert.deepEqual(page.faults, []);
  await page.close();
});
