// Tests the page as a visitor uses it: loading, mouse, touch, every key, links, notes, measuring, pictures, and
// failures.
import assert from "node:assert/strict";
import {readFileSync, writeFileSync} from "node:fs";
import {join} from "node:path";
import {after, before, test} from "node:test";
import {PNG} from "pngjs";

import {
  camera,
  canvasPicture,
  cleanUp,
  difference,
  figures,
  launch,
  open,
  overlay,
  sampleScene,
  serve,
  settled,
  still as stillCamera,
  until
} from "./lib.mjs";

let scene, server, browser, page;

before(async () => {
  scene = sampleScene();
  const box = JSON.parse(readFileSync(join(scene, "scene.json"), "utf8"));
  const middle = box.box_min.map((low, i) => (low + box.box_max[i]) / 2);
  writeFileSync(
      join(scene, "annotations.json"),
      JSON.stringify({
        version: 1,
        annotations: [
          {
            position: [middle[0], middle[1], box.box_max[2]],
            normal: [0, 0, 1],
            title: "The top <b>",
            text: "Seen from\nall sides & <script>alert(1)</script>"
          },
        ]
      }),
  );
  server = await serve(scene);
  browser = await launch();
  page = await open(browser, server.url);
  await settled(page);
});
after(cleanUp);

const eye = (view) => view.slice(0, 3);
const direction = (view) => view.slice(3, 6);
const distance = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));
const row = async (name) => (await overlay(page)).find((one) => one[0] === name);
const rows = async (name) => (await overlay(page)).filter((one) => one[0] === name);

/// Presses a key and waits until the page has drawn its effect.
async function press(key) {
  await page.locator("#view").focus();
  await page.keyboard.press(key);
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}
async function reset() {
  await press("Escape");
  await press("Home");
  await still();
}
const still = () => stillCamera(page);
const linked = () => until(
    () => page.evaluate(() => decodeURIComponent(location.hash.slice(1)) === window.lumigrid.permalink()),
    "this view's permalink in the address");

test("loads, draws and is at rest without a fault", async () => {
  const now = await figures(page);
  assert.ok(now.patches > 0 && now.triangles > 1000, JSON.stringify(now));
  assert.ok(now.imagesInUse > 0, "no image is blended");
  assert.equal(now.broken, 0);
  assert.deepEqual(page.faults, []);
  const picture = await canvasPicture(page);
  const covered = picture.data.filter((value, i) => i % 4 === 3 && value > 0).length / (picture.width * picture.height);
  assert.ok(covered > 0.05 && covered < 0.9, `the model covers ${covered} of the picture`);
  assert.match(await page.title(), /statue/);
});

test("left drag turns around the pivot, right drag moves, the wheel comes nearer", async () => {
  await reset();
  const start = await camera(page);
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(400, 180, {steps: 4});
  await page.mouse.up();
  const turned = await still();
  assert.ok(
      distance(eye(turned), eye(start)) > 0.05 * distance(eye(start), [0, 0, 0]), "orbiting did not move the eye");
  assert.ok(distance(direction(turned), direction(start)) > 0.1, "orbiting did not turn the view");

  await page.mouse.down({button: "right"});
  await page.mouse.move(360, 200, {steps: 4});
  await page.mouse.up({button: "right"});
  const moved = await still();
  assert.ok(distance(direction(moved), direction(turned)) < 1e-9, "panning turned the view");
  assert.ok(distance(eye(moved), eye(turned)) > 0, "panning did not move the eye");

  await page.mouse.wheel(0, -300);
  const nearer = await still();
  assert.ok(distance(direction(nearer), direction(moved)) < 1e-9);
  assert.ok(distance(eye(nearer), eye(moved)) > 0, "the wheel did not move the eye");
});

test("double click sets the pivot to the surface under the cursor", async () => {
  await reset();
  const start = await camera(page);
  await page.mouse.dblclick(320, 150);
  const there = await still();
  // The clicked point is the new pivot: turning keeps its place on the screen.
  assert.ok(distance(there, start) > 0, "nothing happened");
});

test("WASD and the arrows fly", async () => {
  for (const key of ["w", "a", "s", "d", "q", "e", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"]) {
    await reset();
    const start = await camera(page);
    await page.keyboard.down(key);
    await page.waitForTimeout(250);
    await page.keyboard.up(key);
    const flown = await still();
    assert.ok(distance(eye(flown), eye(start)) > 0, `${key} did not fly`);
    assert.ok(distance(direction(flown), direction(start)) < 1e-9, `${key} turned the view`);
  }
});

test("F and Home go back to the whole model", async () => {
  await reset();
  const start = await camera(page);
  for (const key of ["f", "r", "Home"]) {
    await page.mouse.move(320, 180);
    await page.mouse.wheel(0, -500);
    await still();
    await press(key);
    const now = await still();
    assert.ok(
        distance(eye(now), eye(start)) < 0.5 * distance(eye(start), [0, 0, 0]),
        `${key}: ${eye(now)}, wanted ${eye(start)}`);
  }
});

test("bookmarks are kept and recalled, over a reload, too", async () => {
  await reset();
  const start = await camera(page);
  await page.keyboard.press("Control+Digit3");
  await page.mouse.move(320, 180);
  await page.mouse.wheel(0, -500);
  assert.ok(distance(eye(await still()), eye(start)) > 0);
  await press("3");
  assert.ok(distance(eye(await still()), eye(start)) < 1e-6 * distance(eye(start), [0, 0, 0]));
  await page.mouse.wheel(0, -500);
  await still();
  await page.reload();
  await settled(page);
  await press("3");
  assert.ok(distance(eye(await still()), eye(start)) < 1e-6 * distance(eye(start), [0, 0, 0]));
});

test("I, C, O, L, X and H switch what they say, on and off", async () => {
  await reset();
  const view = async () => (await row("view")).slice(1);
  for (const [key, place] of [["i", 0], ["c", 1], ["o", 2], ["l", 4]]) {
    const tool = `#tool-${key}`;
    await press(key);
    assert.equal((await view())[place], "1", `${key} on`);
    assert.equal(await page.locator(tool).getAttribute("aria-pressed"), "true");
    await press(key);
    assert.equal((await view())[place], "0", `${key} off`);
  }
  await press("x");
  assert.equal((await view())[3], "1", "x on");
  for (let i = 0; i < 8 && (await view())[3] === "1"; ++i) await press("x");
  assert.equal((await view())[3], "0", "x goes off again");
  await press("h");
  await until(() => page.locator("#help").isVisible(), "help");
  assert.ok((await page.locator("#help dt").count()) >= 12, "help lists the controls");
  await page.keyboard.press("Escape");
  await until(
      async () => !(await page.locator("#help").isVisible()) && (await row("help"))[1] === "0", "help to close");
  await press("h");
  await page.locator("#help .close").click();
  await until(async () => !(await page.locator("#help").isVisible()), "help to close");
});

test("statistics list the figures", async () => {
  await press("i");
  const text = async () => (await page.locator("#statistics").innerText()).toLowerCase();
  await until(async () => (await text()).includes("images"), "the figures");
  for (const word of ["images", "patches", "triangles"]) assert.match(await text(), new RegExp(word));
  await press("i");
});

test("colours, section and orthographic views change the picture and change it back", async () => {
  await reset();
  await settled(page);
  const plain = await canvasPicture(page);
  for (const key of ["c", "x", "o"]) {
    await press(key);
    await page.waitForTimeout(500);
    const other = await canvasPicture(page);
    assert.ok(difference(plain, other).mean > 0.5, `${key} changes nothing`);
    for (let i = 0; i < (key === "x" ? 8 : 1); ++i) {
      await press(key);
      const off = (await row("view")).slice(1)[{c: 1, o: 2, x: 3}[key]] === "0";
      if (off) break;
    }
    await settled(page);
    const back = difference(plain, await canvasPicture(page));
    assert.ok(back.mean < 0.5, `${key} leaves a difference of ${back.mean} levels`);
  }
});

test("a permalink leads back to the same view in another page", async () => {
  await reset();
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(250, 140, {steps: 3});
  await page.mouse.up();
  await still();
  await settled(page);
  await linked();
  const here = await camera(page);
  const link = page.url();
  assert.match(link, /#.{10,}/, "the page's address does not hold the view");
  const other = await open(browser, link);
  await settled(other);
  const there = await camera(other);
  const size = distance(eye(here), [0, 0, 0]);
  assert.ok(
      distance(eye(there), eye(here)) < 1e-6 * size && distance(direction(there), direction(here)) < 1e-6,
      `${there}, wanted ${here}`);
  const apart = difference(await canvasPicture(page), await canvasPicture(other));
  assert.ok(apart.mean < 1, `the pictures differ by ${apart.mean} levels`);
  await other.close();
});

test("V copies the link", async () => {
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await press("v");
  await page.waitForTimeout(300);
  const copied = await page.evaluate(() => navigator.clipboard.readText());
  assert.ok(copied.startsWith(server.url) && copied.includes("#"), copied);
});

test("a bad link is refused in plain words and changes nothing", async () => {
  await reset();
  const start = await camera(page);
  for (const hash of ["#v1;nonsense=99999999999999999999", "#%zz"]) {
    await until(async () => (await rows("toast")).length === 0, "what was said before to go");
    await page.evaluate((text) => (location.hash = text), hash);
    await until(async () => (await rows("toast")).some(([, , error]) => error === "1"), "what is wrong to be said");
    assert.deepEqual(await camera(page), start);
  }
  await page.reload();
  await settled(page);
});

test("a link is followed though the view's own comes into the address at once", async () => {
  await reset();
  const home = await page.evaluate(() => window.lumigrid.permalink());
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(250, 140, {steps: 3});
  await page.mouse.up();
  await still();
  await linked();
  const own = await page.evaluate(() => window.lumigrid.permalink());
  assert.notEqual(own, home);
  await page.evaluate(([to, back]) => {
    location.hash = to;
    history.replaceState(null, "", `#${back}`);
  }, [home, own]);
  await until(() => page.evaluate((to) => window.lumigrid.permalink() === to, home), "the view that the link names");
  await settled(page);
});

test("resizing redraws at the new size", async () => {
  for (const [width, height] of [[800, 500], [640, 360]]) {
    await page.setViewportSize({width, height});
    await until(async () => {
      const picture = await canvasPicture(page);
      return picture.width === width && picture.height === height;
    }, `a picture of ${width} x ${height}`);
    await settled(page);
    const view = await camera(page);
    assert.deepEqual(view.slice(11, 13), [width, height]);
  }
});

test("a lost graphics context comes back with the same picture", async () => {
  await reset();
  await settled(page);
  const before = await canvasPicture(page);
  const faults = page.faults.length;
  await page.evaluate(() => {
    const gl = document.getElementById("view").getContext("webgl2");
    window.lose = gl.getExtension("WEBGL_lose_context");
    window.lose.loseContext();
  });
  await page.waitForTimeout(300);
  await page.evaluate(() => window.lose.restoreContext());
  await page.waitForTimeout(300);
  await settled(page);
  const apart = difference(before, await canvasPicture(page));
  assert.ok(apart.covered > 0.05 && apart.mean < 0.5, `the pictures differ by ${apart.mean} levels`);
  page.faults.splice(faults);  // Chromium itself warns of the lost context
});

test("measuring takes the full-resolution surface from the server", async () => {
  await reset();
  await press("m");
  assert.notEqual((await row("mode"))[1], "0");
  await page.mouse.click(310, 150);
  await page.mouse.click(330, 200);
  const exact = async () => (await rows("label")).filter((label) => label[1] === "2" && label[6] === "0");
  for (let i = 0; i < 60 && (await exact()).length === 0; ++i) await page.waitForTimeout(100);
  const values = await exact();
  assert.ok(values.length > 0, `no exact value: ${JSON.stringify(await rows("label"))}`);
  assert.match(values[0][8], /\d/);
  await press("Escape");
  await press("Escape");
});

test("notes stand as pins, open with their text unharmed, and hide behind the surface", async () => {
  await reset();
  await settled(page);
  const pin = async () => (await rows("label")).find((label) => label[1] === "0");
  const found = await pin();
  assert.ok(found, "no pin");
  await page.evaluate(() => document.querySelector(".label.pin").click());
  await page.waitForTimeout(200);
  assert.equal(await page.locator("#card-title").innerText(), "The top <b>");
  assert.match(await page.locator("#card-text").innerText(), /<script>alert\(1\)<\/script>/);
  await page.locator("#card .close").click();
  await until(async () => !(await page.locator("#card").isVisible()), "the card to close");
});

test("P saves a picture from the server at any size, and what is on the screen", async () => {
  await reset();
  for (const [source, width, height] of [["server", 333, 222], ["screen", 640, 360]]) {
    await press("p");
    await page.selectOption("#picture-form select", source);
    if (source === "server") {
      await page.fill('#picture-form input[name="width"]', String(width));
      await page.fill('#picture-form input[name="height"]', String(height));
    }
    const download = page.waitForEvent("download", {timeout: 60000});
    await page.locator('#picture-form button[type="submit"]').click();
    const file = await (await download).path();
    const bytes = readFileSync(file);
    assert.equal(bytes.subarray(1, 4).toString(), "PNG");
    assert.deepEqual([bytes.readUInt32BE(16), bytes.readUInt32BE(20)], [width, height], source);
  }
});

test("the server's picture is what the client shows: cut, tinted, orthographic", async () => {
  // Compare the client's picture of patches with the server's, drawn with one sample a pixel, as both can, and the
  // tolerance that patches have without images.
  const settings = JSON.stringify({version: 1, antialias: false});
  const origins = [{origin: new URL(server.url).origin, localStorage: [{name: "lumigrid.settings", value: settings}]}];
  const patches = await open(browser, server.url, {storageState: {cookies: [], origins}});
  await settled(patches);
  const plain = await patches.evaluate(() => window.lumigrid.permalink());
  await patches.evaluate((link) => window.lumigrid.open(link), `${plain}&m=patches`);
  const all = {c: "Colours", x: "Section", o: "Orthographic"};
  for (const keys of ["", "c", "x", "o", "cxo"]) {
    for (const key of keys) await patches.keyboard.press(key);
    await stillCamera(patches);
    await settled(patches);
    await patches.waitForTimeout(500);
    await patches.keyboard.press("p");
    const asked = patches.waitForRequest(/\/render\?/);
    const download = patches.waitForEvent("download", {timeout: 60000});
    await patches.locator('#picture-form button[type="submit"]').click();
    const url = new URL((await asked).url());
    await download;
    for (const [key, name] of [["c", "colors"], ["x", "section"], ["o", "ortho_height"]])
      assert.equal(url.searchParams.has(name), keys.includes(key), `${all[key]}: ${url}`);
    url.searchParams.set("supersampling", "1");
    url.searchParams.set("tolerance", "1");
    const answer = await fetch(url);
    assert.equal(answer.status, 200, url.href);
    const apart = difference(PNG.sync.read(Buffer.from(await answer.arrayBuffer())), await canvasPicture(patches));
    console.log(`${keys || "plain"}: mean ${apart.mean.toFixed(3)}, outliers ${(100 * apart.outliers).toFixed(3)} %`);
    assert.ok(
        apart.covered > 0.05 && apart.mean < 1 && apart.outliers < 0.002,
        `${keys}: the pictures differ by ${apart.mean} levels, ${100 * apart.outliers} % by more than 8`);
    for (const key of keys)
      for (let i = 0; i < (key === "x" ? 3 : 1); ++i) await patches.keyboard.press(key);
  }
  await patches.close();
});

test("settings are kept over a reload", async () => {
  await press("g");
  await page.selectOption('#settings select[name="theme"]', {label: "dark"});
  await page.locator("#settings .close").click();
  assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), "dark");
  await page.reload();
  await settled(page);
  assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), "dark");
  await page.evaluate(() => localStorage.clear());
  await page.reload();
  await settled(page);
});

test("touch: one finger turns, two fingers move and come nearer, a double tap sets the pivot", async () => {
  const phone = await open(
      browser, server.url, {viewport: {width: 390, height: 700}, hasTouch: true, isMobile: true, deviceScaleFactor: 2});
  await settled(phone);
  const touch = await phone.context().newCDPSession(phone);
  const send = (type, ...points) =>
      touch.send("Input.dispatchTouchEvent", {type, touchPoints: points.map(([x, y], id) => ({x, y, id}))});
  const rest = () => stillCamera(phone);
  const start = await camera(phone);
  await send("touchStart", [195, 350]);
  for (let i = 1; i <= 5; ++i) await send("touchMove", [195 + 12 * i, 350]);
  await send("touchEnd");
  const turned = await rest();
  assert.ok(distance(direction(turned), direction(start)) > 0.05, "one finger did not turn");

  await send("touchStart", [150, 350], [240, 350]);
  for (let i = 1; i <= 5; ++i) await send("touchMove", [150 - 8 * i, 350], [240 + 8 * i, 350]);
  await send("touchEnd");
  const nearer = await rest();
  assert.ok(distance(direction(nearer), direction(turned)) < 1e-6, "two fingers turned the view");
  assert.ok(distance(eye(nearer), eye(turned)) > 0, "two fingers did not move the eye");

  await phone.keyboard.press("Home");
  const whole = await rest();
  // On a busy machine two taps may come too far apart to be one gesture; then they are repeated.
  await until(async () => {
    for (let i = 0; i < 2; ++i) {
      await send("touchStart", [195, 330]);
      await send("touchEnd");
    }
    await phone.waitForTimeout(500);
    return distance(await camera(phone), whole) > 0;
  }, "a double tap to do something");
  assert.deepEqual(phone.faults, []);
  await phone.close();
});

test("a hidden tab draws nothing", async () => {
  const drawn = () => page.evaluate(() => window.lumigrid.framesDrawn());
  await page.evaluate(() => {
    Object.defineProperty(document, "hidden", {value: true, configurable: true});
    document.dispatchEvent(new Event("visibilitychange"));
  });
  const before = await drawn();
  await page.mouse.wheel(0, -200);
  await page.waitForTimeout(500);
  assert.equal(await drawn(), before);
  await page.evaluate(() => {
    delete document.hidden;
    document.dispatchEvent(new Event("visibilitychange"));
  });
  await reset();
  assert.ok((await drawn()) > before, "it did not wake up");
});

test("at rest nothing is drawn again", async () => {
  await settled(page);
  await page.waitForTimeout(600);
  const before = await page.evaluate(() => window.lumigrid.framesDrawn());
  await page.waitForTimeout(1000);
  assert.equal(await page.evaluate(() => window.lumigrid.framesDrawn()), before);
});

test("a server that restarts is found again", async () => {
  const {port} = server;
  const faults = page.faults.length;
  await server.stop();
  await until(async () => (await row("status"))[1] === "3", "the loss to be said");
  assert.match(await page.locator("#state").innerText(), /\w/);
  server = await serve(scene, {port});
  await until(async () => ["1", "2"].includes((await row("status"))[1]), "the server to be found again");
  await press("Home");
  await settled(page);
  page.faults.splice(faults);  // Chromium itself reports the lost connection
});

test("nothing went wrong on the way", () => assert.deepEqual(page.faults, []));
