// Tests the list of what a scene's host sends, when it is requested and when a scene cannot be shown.
import assert from "node:assert/strict";
import {join} from "node:path";
import {after, before, test} from "node:test";

import {cleanUp, folder, launch, nginx, open, run, sampleScene, site, until} from "./lib.mjs";

const kCors = 'add_header Access-Control-Allow-Origin "*" always;';
const kExpose = 'add_header Access-Control-Expose-Headers "Content-Length, Content-Range, ETag" always;';
const kForEver = "add_header Cache-Control \"public, max-age=31536000, immutable\";";
let published, browser;

before(async () => {
  published = join(folder, "published");
  run("lumigrid", ["publish", sampleScene(), published, "--viewer", "on", "--web", site]);
  browser = await launch();
});
after(cleanUp);

/// Returns the list as {header: {grade, nginx}} once it is open and complete.
async function list(page) {
  let rows;
  await until(async () => {
    rows = await page.locator("#check").evaluate((dialog) => {
      if (!dialog.open || dialog.querySelector("p").textContent.startsWith("Asking")) return [];
      return [...dialog.querySelectorAll("li")].map(
          (item) =>
              [item.querySelector("strong").textContent,
               {grade: item.className, text: item.innerText, nginx: item.querySelector("code")?.textContent ?? ""}]);
    });
    return rows.length > 0;
  }, "the list");
  return Object.fromEntries(rows);
}
async function checked(url) {
  const page = await open(browser, url);
  const found = await list(page);
  await page.close();
  return found;
}
const from = (pages, host) => `${pages.url}?check&scene=${encodeURIComponent(host.url)}`;

test("?check lists what the page's own host sends; the settings have a button for it", async () => {
  const host = await nginx(published, kForEver);
  const page = await open(browser, `${host.url}?check`);
  const found = await list(page);
  for (const header of ["Range", "Content-Range", "Accept-Ranges", "Content-Encoding", "ETag"])
    assert.equal(found[header].grade, "good", JSON.stringify(found[header]));
  assert.equal(found["Cache-Control"].grade, "slow", "scene.json is said never to change");
  assert.match(await page.locator("#check > p").innerText(), /could be better/);
  await page.keyboard.press("Escape");
  await until(async () => !(await page.locator("#check").isVisible()), "the list to close");
  await page.locator("#tool-g").click();
  await page.locator("#settings-check").click();
  assert.ok((await list(page)).Range);
  assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);
  await page.close();
});

test("each header that is taken away is named, and the line told mends it", async () => {
  const pages = await nginx(site);
  const cases = [
    ["Access-Control-Allow-Origin", "fails", "", ""],
    ["Access-Control-Expose-Headers", "slow", kCors, kCors],
    ["Range", "fails", `${kCors} ${kExpose} max_ranges 0;`, `${kCors} ${kExpose}`],
  ];
  for (const [header, grade, lines, rest] of cases) {
    const found = await checked(from(pages, await nginx(published, lines)));
    assert.equal(found[header]?.grade, grade, `${lines}: ${JSON.stringify(found)}`);
    const mended = await checked(from(pages, await nginx(published, `${rest} ${found[header].nginx}`)));
    assert.equal(mended[header].grade, "good", `${found[header].nginx}: ${JSON.stringify(mended)}`);
  }
  // A scene beside the page has no hidden headers.
  const untagged = await checked(`${(await nginx(published, "etag off;")).url}?check`);
  assert.equal(untagged.ETag.grade, "slow", JSON.stringify(untagged));
  assert.equal((await checked(`${(await nginx(published, untagged.ETag.nginx)).url}?check`)).ETag.grade, "good");
});

test("where a scene cannot be shown the list is a click away", async () => {
  const rangeless = await nginx(published, "max_ranges 0;");
  const page = await open(browser, rangeless.url);
  await until(() => page.locator("#problem-check").isVisible(), "the problem");
  await page.locator("#problem-check").click();
  const found = await list(page);
  assert.equal(found.Range.grade, "fails");
  assert.match(found.Range.nginx, /max_ranges/);
  assert.match(await page.locator("#check > p").innerText(), /cannot be shown/);
  await page.close();
});

test("a host that is not there, and a folder without a scene, are told too", async () => {
  const empty = await nginx(folder);
  const nothing = await checked(`${(await nginx(site)).url}?check&scene=${encodeURIComponent(`${empty.url}nowhere/`)}`);
  assert.deepEqual(Object.keys(nothing).length, 1, JSON.stringify(nothing));
  const pages = await nginx(site);
  const away = await checked(`${pages.url}?check&scene=${encodeURIComponent("http://127.0.0.1:1/")}`);
  assert.equal(away["scene.json"].grade, "fails");
});
