// Tests several scenes of one server: the list, and each as if it were the only one.
import assert from "node:assert/strict";
import {basename} from "node:path";
import {after, before, test} from "node:test";

import {canvasPicture, cleanUp, difference, launch, open, overlay, sampleScene, serve, settled, until} from "./lib.mjs";

let scenes, server, browser;
before(async () => {
  scenes = [sampleScene({triangles: 20000}), sampleScene({shape: "relief", triangles: 20000})];
  server = await serve(scenes[0], {args: [scenes[1]]});
  browser = await launch();
});
after(cleanUp);

test("the list leads to each scene, which is drawn, measured and pictured as if it were alone", async () => {
  const page = await open(browser, server.url);
  assert.deepEqual(await page.locator("a").allInnerTexts(), scenes.map((scene) => basename(scene)));
  const pictures = [];
  for (const scene of scenes) {
    await page.goto(server.url);
    await page.getByText(basename(scene), {exact: true}).click();
    await settled(page);
    assert.equal(await page.locator("#name").innerText(), basename(scene));
    pictures.push(await canvasPicture(page));

    await page.locator("#view").focus();
    await page.keyboard.press("m");
    await page.mouse.click(310, 190);
    await page.mouse.click(330, 200);
    const exact = async () =>
        (await overlay(page)).filter((row) => row[0] === "label" && row[1] === "2" && row[6] === "0");
    await until(async () => (await exact()).length === 1, "an exact distance");
    await page.keyboard.press("Escape");
    const render = page.waitForResponse(/\/render\?/);
    await page.keyboard.press("p");
    await page.locator('#picture-form button[type="submit"]').click();
    assert.equal((await render).status(), 200);
  }
  assert.ok(difference(...pictures).mean > 1, "both show the same");
  assert.deepEqual(page.faults, []);
  await page.close();
});

test("an address without its slash leads there, and one of no scene is told", async () => {
  const page = await open(browser, `${server.url}${basename(scenes[1])}`);
  await settled(page);
  assert.equal(new URL(page.url()).pathname, `/${basename(scenes[1])}/`);
  await page.close();
  const none = await fetch(`${server.url}nobody/`);
  assert.equal(none.status, 404);
  assert.match(await none.text(), /lists them/);
});
