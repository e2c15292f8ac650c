// Tests a published scene from nginx, without a server of ours: with the page beside it, and from a page elsewhere
// (?scene=URL); what is fetched, and what goes wrong.
import assert from "node:assert/strict";
import {cpSync, existsSync, readdirSync, readFileSync, rmSync, writeFileSync} from "node:fs";
import {join} from "node:path";
import {after, before, test} from "node:test";
import {PNG} from "pngjs";

import {
  allHere,
  camera,
  canvasPicture,
  cleanUp,
  difference,
  figures,
  folder,
  launch,
  nginx,
  open,
  overlay,
  ranges,
  repeated,
  run,
  sampleMesh,
  sampleScene,
  serve,
  settled,
  site,
  still,
  until
} from "./lib.mjs";
import {meet, rayOf, readMesh} from "./mesh.mjs";

const kCors =
    'add_header Access-Control-Allow-Origin *; add_header Access-Control-Expose-Headers "Content-Range, ETag";';
let scene, published, browser;

before(async () => {
  scene = sampleScene();
  published = join(folder, "published");
  run("lumigrid", ["publish", scene, published, "--viewer", "on", "--web", site]);
  browser = await launch();
});
after(cleanUp);

async function drag(page, dx, dy) {
  await page.mouse.move(320, 180);
  await page.mouse.down();
  await page.mouse.move(320 + dx, 180 + dy, {steps: 3});
  await page.mouse.up();
  await settled(page);
}

/// Returns what a page that is opened at this permalink shows once everything is here. It asks for the images of 64
/// points, more than the sample scene's grid has. With the usual 8 a page of our server may draw from other images
/// where the choice is close: without a server, occlusion is judged by a coarser proxy
/// (docs/decisions/lines-of-sight.md). For the same reason one of the two may hold an image that this view does not
/// use.
async function freshView(url, link) {
  const settings = JSON.stringify({version: 1, points: 64});
  const origins = [{origin: new URL(url).origin, localStorage: [{name: "lumigrid.settings", value: settings}]}];
  const page = await open(browser, `${url}#${link}`, {storageState: {cookies: [], origins}});
  await allHere(page);
  const shown = {camera: await camera(page), figures: await figures(page), picture: await canvasPicture(page)};
  await page.close();
  return shown;
}

test("the first view is our server's, and the hull in scene.json fills nine tenths of it", async () => {
  const server = await serve(scene, {args: ["--no-frames"]});
  const seen = [];
  for (const {url} of [await nginx(published), server]) {
    const page = await open(browser, url);
    await settled(page);
    seen.push(await camera(page));
    await page.close();
  }
  assert.deepEqual(seen[0], seen[1]);

  const [px, py, pz, dx, dy, dz, ux, uy, uz, fov, , width, height] = seen[0];
  const right = [dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux];
  const length = Math.hypot(...right);
  const above = [right[1] * dz - right[2] * dy, right[2] * dx - right[0] * dz, right[0] * dy - right[1] * dx];
  const along = (axis, at) => axis[0] * at[0] + axis[1] * at[1] + axis[2] * at[2];
  const {hull} = JSON.parse(readFileSync(join(published, "scene.json"), "utf8"));
  const shares = hull.map(([x, y, z]) => {
    const at = [x - px, y - py, z - pz];
    const half = Math.tan(fov / 2) * length * along([dx, dy, dz], at);
    return Math.max(Math.abs(along(right, at)) * height / width, Math.abs(along(above, at))) / half;
  });
  assert.ok(Math.abs(Math.max(...shares) - 0.9) < 1e-3, String(shares));
});

test("the page beside the scene shows it as our server does, and asks for nothing twice", async () => {
  const host = await nginx(published);
  const page = await open(browser, host.url);
  await settled(page);
  const frames = [];
  const tell = (requests) =>
      frames.push({requests: requests.length, bytes: requests.reduce((sum, {bytes}) => sum + bytes, 0)});
  const all = host.requests();
  tell(all);
  for (const [dx, dy] of [[80, 0], [0, 40], [-200, 10]]) {
    await drag(page, dx, dy);
    const more = host.requests();
    tell(more);
    all.push(...more);
  }
  console.log(`requests and bytes a view: ${frames.map(({requests, bytes}) => `${requests}: ${bytes}`).join(", ")}`);
  assert.equal(repeated(all, page), 0, JSON.stringify(ranges(all)));
  assert.ok(all.every(({status}) => [200, 206, 304, 404].includes(status)));
  // Everything that the first view shows is here. New data are ahead of need, along the motion, and nothing is fetched
  // twice.
  await page.keyboard.press("Home");
  await still(page);
  await settled(page);
  const back = host.requests();
  assert.equal(repeated([...all, ...back], page), 0, JSON.stringify(ranges(back)));
  assert.ok(ranges(back).every(([uri]) => uri.endsWith(".lgk")), "no shape, table or index");
  assert.ok(back.reduce((sum, {bytes}) => sum + bytes, 0) < 0.1 * frames[0].bytes, JSON.stringify(back));
  assert.deepEqual(page.faults.filter((fault) => !/404/.test(fault)), []);

  const server = await serve(scene, {args: ["--no-frames"]});
  const link = await page.evaluate(() => window.lumigrid.permalink());
  await page.close();
  for (const method of ["patches", "lumigraph"]) {
    const fromHost = await freshView(host.url, `${link}&m=${method}`);
    const fromServer = await freshView(server.url, `${link}&m=${method}`);
    assert.deepEqual(fromHost.camera, fromServer.camera);
    assert.equal(fromHost.figures.triangles, fromServer.figures.triangles);
    assert.equal(fromHost.figures.imagesInUse, fromServer.figures.imagesInUse);
    const apart = difference(fromHost.picture, fromServer.picture);
    assert.ok(apart.covered > 0.05, "there is nothing in the pictures");
    assert.equal(apart.max, 0, `${method}: up to ${apart.max} levels apart, ${apart.mean} in the mean`);
  }
});

test("measuring reads the full-resolution patches around the rays, with no server of ours", async () => {
  const host = await nginx(published);
  const page = await open(browser, host.url);
  await settled(page);
  await page.waitForTimeout(500);
  const view = await still(page);
  host.requests();
  await page.locator("#view").focus();
  await page.keyboard.press("m");
  const clicks = [[310, 150], [335, 215]];
  for (const [x, y] of clicks) await page.mouse.click(x, y);
  const values = async () =>
      (await overlay(page)).filter((row) => row[0] === "label" && row[1] === "2" && row[6] === "0");
  await until(async () => (await values()).length === 1, "an exact distance");
  const [, measured, accuracy] = (await values())[0][8].match(/^([\d.]+) .* \u00b1 ([\d.e-]+)/).map(Number);

  // The scan itself, every triangle of it, gives the same points independently.
  const mesh = readMesh(sampleMesh());
  const [a, b] = clicks.map(([x, y]) => meet(mesh, rayOf(view, x, y)));
  const truth = Math.hypot(...a.map((value, i) => value - b[i]));
  const step = 0.5 * Number(`1e-${(String(measured).split(".")[1] ?? "").length}`);  // the text is rounded to this
  console.log(`measured ${measured} ± ${accuracy}, in the scan ${truth}`);
  assert.ok(Math.abs(measured - truth) <= accuracy + step, `measured ${measured} ± ${accuracy}, in the scan ${truth}`);
  assert.ok(accuracy < 1e-3 * truth, `± ${accuracy} of ${truth} is no full resolution`);
  const requests = host.requests();
  assert.ok(requests.some(({uri, range}) => uri.endsWith(".lgp") && range), "no patch was read");
  assert.ok(requests.every(({method, uri}) => method === "GET" && /\.lg[a-z]$/.test(uri)), JSON.stringify(requests));
  await page.keyboard.press("Escape");
  await page.close();
});

test("a page from elsewhere reads a scene that allows it, and says what is missing where it does not", async () => {
  const pages = await nginx(site);
  const allowed = await nginx(published, kCors);
  const page = await open(browser, `${pages.url}?scene=${encodeURIComponent(allowed.url)}`);
  await settled(page);
  assert.ok((await camera(page)) !== null);
  await page.close();

  const closed = await nginx(published);
  const refused = await open(browser, `${pages.url}?scene=${encodeURIComponent(closed.url)}`);
  await until(() => refused.locator("#problem").isVisible(), "the problem to be told");
  assert.match(await refused.locator("#problem").innerText(), /Access-Control-Allow-Origin/);
  await refused.close();
});

test("a host without ranges, an empty folder and a damaged hierarchy are told in plain words", async () => {
  const told = async (url) => {
    const page = await open(browser, url);
    await until(() => page.locator("#problem").isVisible(), "the problem to be told");
    const text = await page.locator("#problem").innerText();
    await page.close();
    return text;
  };
  const rangeless = await nginx(published, "max_ranges 0;");
  assert.match(await told(rangeless.url), /range/i);

  const empty = await nginx(site);
  assert.match(await told(`${empty.url}?scene=${encodeURIComponent(empty.url)}`), /no scene/);

  const damaged = join(folder, "damaged");
  cpSync(published, damaged, {recursive: true});
  const records = readdirSync(damaged).find((name) => name.endsWith(".lgr"));
  const bytes = readFileSync(join(damaged, records));
  bytes.fill(0xff, 40, 64);
  writeFileSync(join(damaged, records), bytes);
  assert.match(await told((await nginx(damaged)).url), /records-.*damaged/i);
});

test("a lost pack is told once, and the shape is shown all the same", async () => {
  const lost = join(folder, "lost");
  cpSync(published, lost, {recursive: true});
  for (const name of readdirSync(join(lost, "images")).filter((name) => name.endsWith(".lgk")))
    rmSync(join(lost, "images", name));
  const page = await open(browser, (await nginx(lost)).url);
  await until(async () => (await page.locator("#toasts").innerText()).includes("pack-"), "the lost pack to be told");
  assert.ok((await figures(page)).triangles > 0);
  await page.close();
});

test("authors, background and north are shown as the scene says them, from a host and from our server", async () => {
  const shown = join(folder, "shown");
  cpSync(published, shown, {recursive: true});
  const authors = "A. <b>Nonymous</b> & Söhne";
  run("lumigrid", ["set", shown, "--attribution", authors, "--background", "#123456", "--north", "40"]);
  for (const url of [(await nginx(shown)).url, (await serve(shown)).url]) {
    const page = await open(browser, url);
    await settled(page);
    assert.equal(await page.locator("#attribution").innerText(), authors);
    assert.ok(await page.locator("#north").isVisible());
    const near = () => getComputedStyle(document.documentElement).getPropertyValue("--near").trim();
    assert.equal(await page.evaluate(near), "#123456");
    const corner = PNG.sync.read(await page.screenshot({clip: {x: 600, y: 10, width: 4, height: 4}})).data;
    assert.deepEqual([...corner.subarray(0, 3)], [0x12, 0x34, 0x56]);
    // Ink of the title that is seen on this ground, though the theme is a light one.
    assert.equal(await page.evaluate(() => document.documentElement.dataset.ground), "dark");
    const turn = async () => Number((await overlay(page)).find((row) => row[0] === "scene")[5]);
    const before = await turn();
    await drag(page, 100, 0);
    assert.ok(Math.abs((await turn()) - before) > 0.1, "the compass turns with the view");
    await page.close();
  }
  // A scene that says nothing has the theme's ground and no compass.
  const page = await open(browser, (await nginx(published)).url);
  await settled(page);
  assert.equal(await page.locator("#attribution").innerText(), "");
  assert.ok(!(await page.locator("#north").isVisible()));
  assert.equal(await page.evaluate(() => document.documentElement.dataset.ground), "");
  await page.close();
});

test("a scene without images is shown by its patches", async () => {
  const bare = join(folder, "bare.scene");
  if (!existsSync(bare)) {
    const mesh = join(folder, "bare.ply");
    run("lumigrid", ["sample", "--triangles", "20000", "-o", mesh]);
    run("lumigrid", ["build", mesh, "-o", bare, "--methods", "patch"]);
  }
  const out = join(folder, "bare-published");
  run("lumigrid", ["publish", bare, out, "--viewer", "on", "--web", site]);
  const page = await open(browser, (await nginx(out)).url);
  const now = await settled(page);
  assert.ok(now.triangles > 0 && now.imagesInUse === 0);
  const status = (await overlay(page)).find((row) => row[0] === "status");
  assert.equal(status[1], "2", status.join());
  await page.close();
});
