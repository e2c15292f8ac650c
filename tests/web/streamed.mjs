// Helpers that the tests of methods with a file of their own share.
import assert from "node:assert/strict";

import {camera, canvasPicture, difference, nativePictures, open, waitFor} from "./lib.mjs";

/// Waits for the page's view to be drawn from all that it needs. Returns its figures.
export const fine =
    (page) => waitFor(page, (now) => now.complete === 1 && now.drawn > 0, "everything that the view needs");

/// Expects the page's picture to be the one that the native client draws of the scene at `url` by that method, with
/// `options`.
export async function expectNative(page, url, method, options = []) {
  const [native] = nativePictures(url, [await camera(page)], ["--method", method, ...options]);
  const apart = difference(await canvasPicture(page), native);
  assert.ok(apart.covered > 0.05, "there is nothing in the pictures");
  assert.ok(apart.mean < 0.5 && apart.outliers < 0.002, `mean ${apart.mean} levels, outliers ${apart.outliers}`);
}

/// Expects that a page shows a scene by the WebAssembly of that name alone.
export async function expectProgram(browser, url, program) {
  const page = await open(browser, "about:blank");
  const fetched = [];
  page.on("request", (request) => /\.wasm$/.test(request.url()) && fetched.push(request.url().split("/").at(-1)));
  await page.goto(url);
  await fine(page);
  assert.ok(
      fetched.length >= 1 && fetched.every((name) => name.startsWith(`${program}-`)), `${url}: ${fetched.join()}`);
  await page.close();
}

/// Drags the pointer by a sixth of the picture's width.
export async function drag(page) {
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(420, 150, {steps: 5});
  await page.mouse.up();
}

/// Sets a number in the page's settings, whose dialog is open.
export async function setNumber(page, name, value) {
  const input = page.locator(`#settings input[name=${name}]`);
  await input.fill(String(value));
  await input.blur();
}
