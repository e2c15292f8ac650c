// Tests splats in the browser: streamed from a server of ours and from nginx, with the same pictures as the native
// client's.
import assert from "node:assert/strict";
import {readdirSync, readFileSync, writeFileSync} from "node:fs";
import {join} from "node:path";
import {after, before, test} from "node:test";

import {
  camera,
  canvasPicture,
  cleanUp,
  difference,
  figures,
  folder,
  launch,
  nativePictures,
  newPage,
  nginx,
  open,
  ranges,
  repeated,
  run,
  sampleMesh,
  serve,
  site,
  still,
  until,
  waitFor
} from "./lib.mjs";

let scene, published, server, browser;
before(async () => {
  scene = join(folder, "splats.scene");
  run("lumigrid", ["build", sampleMesh({triangles: 60000}), "-o", scene, "--methods", "patch,qsplat"]);
  published = join(folder, "splats.published");
  run("lumigrid", ["publish", scene, published, "--viewer", "on", "--web", site]);
  server = await serve(scene, {args: ["--no-frames"]});
  browser = await launch();
});
after(cleanUp);

const fine = (page) => waitFor(page, (now) => now.complete === 1 && now.drawn > 0, "all splats of the view");

/// Waits until no block arrives any more, those ahead of need included.
async function quiet(page) {
  let last = -1;
  await until(async () => {
    await page.waitForTimeout(500);
    const {present} = await fine(page);
    const same = present === last;
    last = present;
    return same;
  }, "the last block");
  return last;
}

/// Waits for a page that finds out by itself that it needs its other program, and loads again.
const afterReload = (page, wanted, what) => until(async () => {
  const now = await figures(page).catch(() => null);  // it fails while the page is loaded again
  return now && wanted(now);
}, what);

async function expectNative(page, url) {
  const [native] = nativePictures(url, [await camera(page)], ["--method", "qsplat"]);
  const apart = difference(await canvasPicture(page), native);
  assert.ok(apart.covered > 0.05, "there is nothing in the pictures");
  assert.ok(apart.mean < 0.5 && apart.outliers < 0.002, `mean ${apart.mean} levels, outliers ${apart.outliers}`);
}

test("a server's splats, as the native client draws them, also after a drag", async () => {
  const page = await open(browser, `${server.url}?method=qsplat`);
  await fine(page);
  await expectNative(page, server.url);
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(420, 150, {steps: 5});
  await page.mouse.up();
  await still(page);
  await fine(page);
  await expectNative(page, server.url);
  assert.match(await page.evaluate(() => window.lumigrid.permalink()), /&m=qsplat/);
  assert.deepEqual(page.faults, []);
  await page.close();
});

test(
    "a link with m=qsplat opens them on a static host; no byte comes twice; another method loads the page again",
    async () => {
      const first = await open(browser, `${(await nginx(published)).url}?method=qsplat`);
      await fine(first);
      const link = await first.evaluate(() => window.lumigrid.permalink());
      await first.close();
      const host = await nginx(published);  // a log of its own: late answers to the first page are in the other
      const page = await open(browser, `${host.url}#${link}`);
      await quiet(page);
      const asked = host.requests();
      assert.equal(repeated(asked, page), 0, JSON.stringify(ranges(asked)));
      await expectNative(page, host.url);

      await Promise.all([
        page.waitForEvent("load"), page.evaluate((hash) => void (location.hash = hash), link.replace("&m=qsplat", ""))
      ]);
      await waitFor(page, (now) => now.triangles > 0 && now.drawn === 0, "patches");
      assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);  // it has no annotations
      await page.close();
    });

test("a coded tree's splats, from a server of ours and from a static host", async () => {
  const coded = join(folder, "coded.scene");
  const place = join(folder, "coded.published");
  run("lumigrid",
      ["build", sampleMesh({triangles: 60000}), "-o", coded, "--methods", "patch,qsplat", "--qsplat-coded"]);
  run("lumigrid", ["publish", coded, place, "--viewer", "on", "--web", site]);
  for (const host of [await serve(coded, {args: ["--no-frames"]}), await nginx(place)]) {
    const page = await open(browser, `${host.url}?method=qsplat`);
    await fine(page);
    await expectNative(page, host.url);
    assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);  // it has no annotations
    await page.close();
  }
});

test("what is seen through the magnifying glass is finer, all else the same", async () => {
  const page = await open(browser, `${server.url}?method=qsplat`);
  await page.evaluate(() => localStorage.setItem("lumigrid.settings", JSON.stringify({version: 1, cutoff: 12})));
  await page.reload();
  const before = await fine(page);
  const without = await canvasPicture(page);
  await page.keyboard.press("l");
  await until(async () => (await fine(page)).drawn > before.drawn * 1.1, "more splats");
  await fine(page);
  const through = await canvasPicture(page);
  const radius = 0.18 * 360;  // share of the view's shorter side (client/app/app_tools.cpp)
  let inside = 0, outside = 0;
  for (let i = 0; i < through.data.length; i += 4) {
    const off = Math.hypot(((i / 4) % 640) + 0.5 - 320, Math.floor(i / 4 / 640) + 0.5 - 180);
    const differs = [0, 1, 2, 3].some((c) => through.data[i + c] !== without.data[i + c]);
    if (differs && off < radius) ++inside;
    if (differs && off > radius + 24) ++outside;
  }
  assert.ok(inside > 500, `${inside} pixels changed in the glass`);
  assert.equal(outside, 0);
  await page.close();
});

test("the magnifying glass, by key and by button, and the statistics", async () => {
  const page = await open(browser, `${server.url}?method=qsplat`);
  await fine(page);
  await page.keyboard.press("l");
  await until(async () => (await page.locator("#lines line").count()) >= 64, "the glass's rim");
  assert.equal(await page.locator("#tool-l").getAttribute("aria-pressed"), "true");
  await page.locator("#tool-l").click();
  await until(async () => (await page.locator("#lines line").count()) === 0, "its end");
  await page.keyboard.press("i");
  await until(async () => /blocks/.test(await page.locator("#statistics").innerText()), "blocks in the statistics");
  assert.equal(await page.locator("#name").innerText(), "statue-60000", "of the mesh: the address has no folder");
  await page.goto(`${server.url}?method=patches`);
  await waitFor(page, (now) => now.triangles > 0, "patches");
  assert.match(await page.locator("#tool-l").getAttribute("title"), /light/, "not the glass");
  await page.close();
});

/// Returns the names of the WebAssembly files that a page fetches from here on.
function wasmOf(page) {
  const names = [];
  page.on(
      "request",
      (request) => /\.wasm$/.test(request.url()) && names.push(new URL(request.url()).pathname.split("/").at(-1)));
  return names;
}

test("a page of splats fetches the WebAssembly of splats early and no other", async () => {
  const page = await open(browser, "about:blank");
  const fetched = wasmOf(page);
  await page.goto(`${server.url}?method=qsplat`);
  await fine(page);
  assert.ok(fetched.length >= 1 && fetched.every((name) => name.startsWith("splats-")), fetched.join());
  const link = await page.evaluate(() => window.lumigrid.permalink());
  assert.deepEqual(
      await page.evaluate(
          () => [...document.querySelectorAll("link[rel=preload], link[rel=modulepreload]")]
                    .map(({rel}) => rel)
                    .sort()),
      ["modulepreload", "preload"]);
  await page.close();

  const linked = await open(browser, "about:blank");
  const again = wasmOf(linked);
  await linked.goto(`${server.url}#${link}`);
  await fine(linked);
  assert.ok(again.every((name) => name.startsWith("splats-")), again.join());
  assert.deepEqual(linked.faults, []);
  await linked.close();
});

test("shape and size of splats are settings that take effect without loading the page again", async () => {
  const page = await open(browser, `${server.url}?method=qsplat`);
  const before = await fine(page);
  const circles = await canvasPicture(page);
  await page.evaluate(() => (window.sameDocument = true));
  await page.keyboard.press("g");
  const differs = async (from) => {
    const {data} = await canvasPicture(page);
    return data.some((value, i) => value !== from.data[i]);
  };
  await page.locator("#settings select[name=splat]").selectOption({label: "square"});
  await until(() => differs(circles), "squares");
  await page.locator("#settings input[name=cutoff]").fill("12");
  await page.locator("#settings input[name=cutoff]").blur();
  await until(async () => (await fine(page)).drawn < before.drawn / 2, "fewer splats");
  await page.locator("#settings input[name=cutoff]").fill("1");
  await page.locator("#settings input[name=cutoff]").blur();
  await until(async () => (await fine(page)).drawn === before.drawn, "as many as before");
  await page.locator("#settings select[name=splat]").selectOption({label: "circle"});
  await until(async () => !(await differs(circles)), "circles");
  assert.equal(await page.evaluate(() => window.sameDocument), true);
  await page.close();
});

test(
    "the method is a setting: it loads the page again, which keeps its view, and is kept for the next visit",
    async () => {
      const context = await browser.newContext({viewport: {width: 640, height: 360}});
      const page = await newPage(context);
      await page.goto(server.url);
      await waitFor(page, (now) => now.triangles > 0, "patches");
      await page.mouse.move(320, 180);
      await page.mouse.down();
      await page.mouse.move(400, 150, {steps: 3});
      await page.mouse.up();
      const before = await still(page);
      await until(() => /#v=1/.test(page.url()), "the view in the address");
      await page.keyboard.press("g");
      await Promise.all(
          [page.waitForEvent("load"), page.locator("#settings select[name=method]").selectOption({label: "qsplat"})]);
      await fine(page);
      const after = await camera(page);
      before.forEach(
          (value, k) => assert.ok(
              Math.abs(value - after[k]) < 1e-5 * Math.max(1, Math.abs(value)), `${k}: ${value}, ${after[k]}`));

      const next = await newPage(context);
      const fetched = wasmOf(next);
      await next.goto(server.url);
      await fine(next);
      assert.ok(fetched.every((name) => name.startsWith("splats-")), fetched.join());

      // A link overrules the setting, and so does a scene that has no splats.
      await next.goto(`${server.url}?method=patches`);
      await waitFor(next, (now) => now.triangles > 0 && now.drawn === 0, "patches");
      assert.match(await next.evaluate(() => window.lumigrid.permalink()), /m=patches/);
      const plain = join(folder, "plain.scene");
      run("lumigrid", ["build", sampleMesh({triangles: 10000}), "-o", plain, "--methods", "patch"]);
      const other = await serve(plain, {args: ["--no-frames"]});
      await next.goto(other.url);
      await next.evaluate(
          () => localStorage.setItem("lumigrid.settings", JSON.stringify({version: 1, method: "qsplat"})));
      await next.goto(`${other.url}?again`);
      await afterReload(next, (now) => now.triangles > 0, "patches, for want of splats");
      await context.close();
    });

test("a point cloud, which has splats only, is served and published, and shown without being asked for", async () => {
  const count = 8000;
  const golden = Math.PI * (3 - Math.sqrt(5));
  const lines = [
    "ply", "format ascii 1.0", `element vertex ${count}`, "property float x", "property float y", "property float z",
    "end_header"
  ];
  for (let i = 0; i < count; ++i) {
    const z = 1 - (2 * i + 1) / count;
    const r = Math.sqrt(1 - z * z);
    lines.push(`${r * Math.cos(golden * i)} ${r * Math.sin(golden * i)} ${z}`);
  }
  const cloud = join(folder, "cloud.ply");
  writeFileSync(cloud, `${lines.join("\n")}\n`);
  const alone = join(folder, "cloud.scene");
  const place = join(folder, "cloud.published");
  run("lumigrid", ["build", cloud, "-o", alone, "--methods", "qsplat"]);
  run("lumigrid", ["publish", alone, place, "--viewer", "on", "--web", site]);
  const host = await nginx(place);
  const own = await serve(alone);
  for (const {url} of [host, own]) {
    const page = await open(browser, "about:blank");
    const fetched = wasmOf(page);
    await page.goto(url);
    await quiet(page);
    await expectNative(page, url);
    assert.ok(fetched.every((name) => name.startsWith("splats-")), fetched.join());
    await page.close();
  }

  // A link that names another method, and a page that does not know the scene, both find the splats.
  const {url: elsewhere} = await serve(place, {args: ["--open"]});
  for (const url of [`${own.url}#m=lumigraph`, `${server.url}?scene=${elsewhere}`]) {
    const page = await open(browser, "about:blank");
    await page.goto(url);
    await afterReload(page, (now) => now.drawn > 0, "splats");
    await page.close();
  }
});

test("a host without ranges is named", async () => {
  const host = await nginx(published, "max_ranges 0;");
  const page = await open(browser, `${host.url}?method=qsplat`);
  await until(async () => /ignores Range/.test(await page.locator("body").innerText()), "the reason");
  await page.close();
});

// Builds of the same sources differ by up to 300 bytes, with a compiler cache and without.
for (const [viewer, most] of Object.entries({viewer: 196_000, splats: 177_500, umbrellas: 182_000, hlod: 198_800}))
  test(`the WebAssembly ${viewer} has at most ${most} bytes, compressed`, () => {
    const found = readdirSync(site).filter((name) => name.startsWith(`${viewer}-`) && name.endsWith(".wasm.br"));
    assert.equal(found.length, 1);
    const bytes = readFileSync(join(site, found[0])).length;
    assert.ok(bytes <= most, `${found[0]} has ${bytes}`);
  });

test("the page is the same wherever it was built", () => {
  const source = new URL("../..", import.meta.url).pathname;
  const found = readdirSync(site).filter((name) => name.endsWith(".wasm"));
  assert.ok(found.length > 0);
  for (const name of found) assert.ok(!readFileSync(join(site, name)).includes(source), name);
});
