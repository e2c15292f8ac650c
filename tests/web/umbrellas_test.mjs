// Tests points and umbrellas in the browser: streamed from a server of ours and from nginx, with the same pictures as
// the native client's.
import assert from "node:assert/strict";
import {writeFileSync} from "node:fs";
import {join} from "node:path";
import {after, before, test} from "node:test";

import {
  cleanUp,
  figures,
  folder,
  launch,
  newPage,
  nginx,
  open,
  repeated,
  run,
  serve,
  site,
  slowLink,
  still,
  until
} from "./lib.mjs";
import {drag, expectNative, expectProgram, fine, setNumber} from "./streamed.mjs";

/// Writes a cloud of a sphere with bumps, without faces or normals.
function writeCloud(path, count) {
  const golden = Math.PI * (3 - Math.sqrt(5));
  const lines = [
    "ply", "format ascii 1.0", `element vertex ${count}`, "property float x", "property float y", "property float z",
    "property uchar red", "property uchar green", "property uchar blue", "end_header"
  ];
  for (let i = 0; i < count; ++i) {
    const z = 1 - (2 * i + 1) / count;
    const turn = golden * i;
    const radius = 1 + 0.05 * Math.sin(5 * turn) * (1 - z * z);
    const around = radius * Math.sqrt(1 - z * z);
    const color = [0, 1, 2].map((k) => Math.round(140 + 100 * Math.sin(3 * z + k)));
    lines.push(`${around * Math.cos(turn)} ${around * Math.sin(turn)} ${radius * z} ${color.join(" ")}`);
  }
  writeFileSync(path, `${lines.join("\n")}\n`);
}

const cloud = join(folder, "cloud.ply");
let published, server, browser;
before(async () => {
  const scene = join(folder, "umbrellas.scene");
  writeCloud(cloud, 40000);
  run("lumigrid", ["build", cloud, "-o", scene, "--methods", "pmr"]);
  published = join(folder, "umbrellas.published");
  run("lumigrid", ["publish", scene, published, "--viewer", "on", "--web", site]);
  server = await serve(scene);
  browser = await launch();
});
after(cleanUp);

test("a server's umbrellas, as the native client draws them, also after a drag", async () => {
  const page = await open(browser, `${server.url}?method=pmr`);
  await fine(page);
  await expectNative(page, server.url, "pmr");
  await drag(page);
  await still(page);
  await fine(page);
  await expectNative(page, server.url, "pmr");
  assert.match(await page.evaluate(() => window.lumigrid.permalink()), /&m=pmr/);
  assert.deepEqual(page.faults, []);
  await page.close();
});

test("a link with m=pmr opens them on a static host; hardly a byte comes twice", async () => {
  const first = await open(browser, `${(await nginx(published)).url}?method=pmr`);
  await fine(first);
  const link = await first.evaluate(() => window.lumigrid.permalink());
  await first.close();
  const host = await nginx(published);
  const page = await open(browser, `${host.url}#${link}`);
  await fine(page);
  const twice = repeated(host.requests(), page);
  assert.ok(twice < 30_000, `${twice} bytes: more than the piece of a chunk at the end of the first answer`);
  await expectNative(page, host.url, "pmr");
  assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);  // it has no annotations
  await page.close();
});

test("a scene that has nothing else is shown without being asked for, by its own WebAssembly", async () => {
  for (const {url} of [server, await nginx(published)]) await expectProgram(browser, url, "umbrellas");
  const page = await open(browser, `${server.url}#m=qsplat`);
  await until(async () => (await figures(page).catch(() => null))?.drawn > 0 || /no splats/.test(
      await page.locator("body").innerText()), "umbrellas, or what is missing");
  await page.close();
});

test("a published scene with splats and umbrellas shows splats unless umbrellas are named", async () => {
  const scene = join(folder, "both.scene");
  const place = join(folder, "both.published");
  run("lumigrid", ["build", cloud, "-o", scene, "--methods", "qsplat,pmr"]);
  run("lumigrid", ["publish", scene, place, "--viewer", "on", "--web", site]);
  const {url} = await nginx(place);
  await expectProgram(browser, url, "splats");
  await expectProgram(browser, `${url}#m=lumigraph`, "splats");
  await expectProgram(browser, `${url}#m=pmr`, "umbrellas");
  await expectProgram(browser, `${url}?method=pmr`, "umbrellas");
  await expectProgram(browser, `${url}?method=pmr#m=qsplat`, "splats");
});

test("a link to splats finds the umbrellas of a published scene that has no splats", async () => {
  const page = await open(browser, `${(await nginx(published)).url}#m=qsplat`);
  await until(async () => (await figures(page).catch(() => null))?.drawn > 0, "umbrellas");
  assert.match(page.url(), /m=pmr/);
  await page.close();
});

test("the tolerance is a setting that takes effect at once, and statistics tell what is drawn", async () => {
  const page = await open(browser, `${server.url}?method=pmr`);
  const before = await fine(page);
  await page.keyboard.press("g");
  await setNumber(page, "tolerance", 8);
  await until(async () => (await fine(page)).drawn < before.drawn / 2, "fewer umbrellas");
  await setNumber(page, "tolerance", 1);
  await until(async () => (await fine(page)).drawn === before.drawn, "as many as before");
  await page.keyboard.press("Escape");
  await page.keyboard.press("i");
  await until(async () => /leaves/.test(await page.locator("#statistics").innerText()), "leaves in the statistics");
  assert.match(await page.locator("#tool-l").getAttribute("title"), /light/, "the glass is for splats");
  await page.close();
});

test("the progress bar grows in few steps, so that the page is seldom put together anew while it loads", async () => {
  const page = await newPage(await browser.newContext());
  await page.addInitScript(() => {
    window.widths = [];
    document.addEventListener("DOMContentLoaded", () => {
      const bar = document.querySelector("#bar div");
      new MutationObserver(() => window.widths.push(bar.style.width)).observe(bar, {attributeFilter: ["style"]});
    });
  });
  await page.goto(`${(await slowLink(server.port, 200_000, 0.02)).url}?method=pmr`);
  await fine(page);
  const widths = await page.evaluate(() => [...new Set(window.widths)]);
  assert.ok(widths.length > 3, `it grew: ${widths}`);
  assert.deepEqual(widths.filter((width) => parseFloat(width) % 5 !== 0), []);
  const transition = await page.locator("#bar div").evaluate((bar) => getComputedStyle(bar).transitionDuration);
  assert.equal(transition, "0s");
  await page.context().close();
});
